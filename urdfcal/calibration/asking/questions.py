"""Questions to the residuals, and their answers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from urdfcal.base.geometry import Array3, Matrix
from urdfcal.calibration.asking.stands_out import StandsOut
from urdfcal.estimation.score import Fitted
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
        columns: Whitened, in units of the size that the data give them, (N, k).
        rig: Terms of the rig that it is; none where the arm does it.
        cycles: A turn of the joint, of a gear's harmonic.
        share: Of what the fit leaves unexplained, which it explains.
        noise: Of a noise, roots of the inverse covariance of each row's numbers beside their own, (rows, m, m).
        joint_sigma: Noise of the joints' readings that it is, [rad].
        left: Share of their own noise that it leaves to sensors.
    """

    what: str
    where: str
    gain: float
    columns: Matrix = field(repr=False)
    rig: tuple[RigTerm, ...] = ()
    cycles: int = 0
    share: float = 0.0
    noise: Array3 | None = field(default=None, repr=False)
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

    def within(self, fitted: Fitted) -> Fitted:
        """A fit with this in it."""
        return fitted.beside(self.columns) if self.noise is None else fitted.spread(self.noise)

    @property
    def told(self) -> StandsOut:
        """As a result tells it."""
        return StandsOut(self.what, self.where, self.gain, cycles=self.cycles, share=self.share)

    @property
    def name(self) -> str:
        """Which columns these are: a drift that wanders is another one."""
        return self.rig[0].what if self.rig else f"{self.what} {self.where}"
