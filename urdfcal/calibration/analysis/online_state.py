"""What is known after a pose of an online calibration, and how far off the tool is to be expected by it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from urdfcal.base.foreign_text import shown
from urdfcal.base.geometry import MM, Vector
from urdfcal.base.terminal import many, rounded
from urdfcal.calibration.analysis.forecast import Forecast
from urdfcal.estimation.ekf import Belief
from urdfcal.estimation.noise import Misfit, Noise


@dataclass(frozen=True, repr=False)
class OnlineState:
    """What is known after a pose.

    Attributes:
        poses: How many poses the belief holds.
        belief: Mean and covariance of the parameters, [m] and [rad].
        noise: Of readings and joints, as assumed in the belief.
        nis: Normalised innovation squared of the last pose: chi-squared if pose and model are sound.
        gate: Its 99.9 % quantile; 0 where the pose had no reading.
        skipped: Why the last pose was left out; empty if it was not.
        relinearised: Whether the whole history was linearised afresh at this pose.
        extra_noise: What readings scatter beyond the noise that was stated with them, by kind, [m], [rad] or [px].
        misfit: Chi-squared of the history where it was linearised last, of the kind of reading that scatters most; None before.
        waiting: Why some poses are not in the belief yet; empty if none waits.
        enough: Whether tool_sigma_mm is under the target, and the noise it rests on is known and no smaller than it is seen to be.
        forecast: How errors of the parameters would show.
    """

    poses: int
    belief: Belief
    noise: Noise
    nis: float
    gate: float
    skipped: str
    relinearised: bool
    extra_noise: Mapping[str, float]
    misfit: Misfit | None
    waiting: str
    enough: bool
    forecast: Forecast

    @cached_property
    def tool_sigma_mm(self) -> float:
        """Predicted position error of the tool relative to the base link (see `prediction`): RMS over the workspace, [mm]."""
        return self.forecast.tool_rms(self.belief.P) / MM

    @cached_property
    def tool_sigma_max_mm(self) -> float:
        """The same at the worst configuration of the workspace, [mm]."""
        return self.forecast.tool_worst(self.belief.P) / MM

    @cached_property
    def tool_sigma_mrad(self) -> float:
        """Predicted rotation error of the tool, RMS over the workspace, [mrad]."""
        return self.forecast.rotation_rms(self.belief.P) * 1e3

    @cached_property
    def spot_sigma_mm(self) -> float:
        """Predicted error of a spot, without the noise of seeing it: RMS over configurations with every beam on the screen, [mm].

        nan where such configurations are too rare.
        """
        return self.forecast.spot_rms(self.belief.P) / MM

    @property
    def x(self) -> Vector:
        """Estimated parameters, (p,), [m] and [rad]."""
        return self.belief.x

    @property
    def sigma(self) -> Vector:
        """Their standard deviations, (p,), [m] and [rad]."""
        return np.sqrt(np.diag(self.belief.P))

    @property
    def within_gate(self) -> bool:
        """Whether the last pose is one that could be expected."""
        return self.nis <= self.gate

    def __repr__(self) -> str:
        """In a line."""
        accuracy = f"tool predicted to be {rounded(self.tool_sigma_mm, 3)} mm off (RMS), {rounded(self.tool_sigma_max_mm, 3)} mm at worst"
        said = "".join(f"; {words}" for words in ("enough" if self.enough else "", self.skipped, self.waiting) if words)
        return f"<{type(self).__name__} after {many(self.poses, 'pose')}: {accuracy}{shown(said)}>"
