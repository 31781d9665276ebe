"""Questions to the residuals, and their answers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from urdfcal.calibration.asking.stands_out import StandsOut
from urdfcal.model.rig_terms import RigTerm

NAMED = 3.0  # [nats] from which an answer is told
HEARD = 2.0  # [nats] from which it widens what is predicted

Rows = npt.NDArray[np.intp]


@dataclass(frozen=True)
class Question:
    """Columns that are asked about together.

    Attributes:
        what: What would cause them.
        where: The joint; the empty string where it is of all of them, or of the rig.
        columns: Which they are.
        price: Log of how many questions of this sort there are.
    """

    what: str
    where: str
    columns: Rows
    price: float = 0.0


@dataclass(frozen=True)
class Answer:
    """What stands out.

    Attributes:
        what, where: As of the question.
        gain: Log evidence, [nats].
        columns: Which they are; none of a gear, whose columns are not among those of all questions, and of a noise.
        size: How many times the usual one they are expected to be, by the data.
        rig: Terms of the rig that it is; none where the arm does it.
        gear: Of a gear, which of the turning joints has it, and its cycles a turn; None of others.
        share: Of what the fit leaves unexplained, which it explains.
        noise: Of a noise of the joints' readings, its standard deviation beside noise of sensors as it was, [rad].
        joint_sigma: Noise of the joints' readings that it is, [rad].
        left: Share of their own noise that it leaves to sensors.
    """

    what: str
    where: str
    gain: float
    columns: Rows = field(default_factory=lambda: np.empty(0, dtype=np.intp), repr=False)
    size: float = 1.0
    rig: tuple[RigTerm, ...] = ()
    gear: tuple[int, int] | None = None
    share: float = 0.0
    noise: float = 0.0
    joint_sigma: float = 0.0
    left: float = 1.0

    def enters(self, before: Sequence[Answer]) -> bool:
        """Whether it is surely there, and belongs into the fit and not into a compensation: the rig does it, or it is noise.

        What goes with the pose, as the arm's doings do, cannot be told from those in a fit that does not know of them.

        Args:
            before: What stands out more.
        """
        known = not any(answer.of_the_arm for answer in before) or self.goes_with_time
        return not self.of_the_arm and known and self.gain >= NAMED

    @property
    def of_the_arm(self) -> bool:
        """Whether the arm does it."""
        return not self.rig and not self.joint_sigma

    @property
    def goes_with_time(self) -> bool:
        """Whether it has nothing to do with where the arm is."""
        return self.what in ("joint_noise", "drift", "temperature")

    @property
    def cycles(self) -> int:
        """A turn of the joint, of a gear's harmonic; 0 of others."""
        return self.gear[1] if self.gear is not None else 0

    @property
    def told(self) -> StandsOut:
        """As a result tells it."""
        return StandsOut(self.what, self.where, self.gain, cycles=self.cycles, share=self.share)

    @property
    def name(self) -> str:
        """Which columns these are: a drift that wanders is another one."""
        return self.rig[0].what if self.rig else f"{self.what} {self.where}"
