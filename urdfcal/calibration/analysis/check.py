"""What a set of measurements can and cannot determine, without fitting, and which further ones would help."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from urdfcal.base.foreign_text import shown
from urdfcal.base.geometry import Vector
from urdfcal.calibration.analysis.suggestions import Suggestion, Trial, posterior_of, suggestions, whitened
from urdfcal.calibration.start.begin import with_scale
from urdfcal.calibration.start.nominal import nominal_fit
from urdfcal.estimation.identifiability import Identifiability, Observability, identify, observe
from urdfcal.estimation.noise import Noise
from urdfcal.model.error_model import ErrorModel
from urdfcal.model.gauge import build_error_model, model_warnings
from urdfcal.model.options import LENS, ModelOptions
from urdfcal.robot.robot import Robot
from urdfcal.sensors.measurements import Measurements, as_measured, copies_warning, fit_and_test, refining, require_measured
from urdfcal.sensors.stated_noise import joint_sigmas, noise_of, stated_noise


@dataclass(frozen=True, repr=False)
class Check:
    """What measurements can determine.

    Attributes:
        robot: The robot.
        errors: Parameters and priors.
        data: The poses.
        noise: Assumed noise.
        observability: Rank, hidden and weak directions, indices: what is seen at all.
        predicted: What a fit would determine, given noise and priors.
        sigma: Standard deviation that a fit would claim for each parameter, (p,).
        suggestions: What would help, best first.
        warnings: What the chosen error model cannot follow.
    """

    robot: Robot
    errors: ErrorModel
    data: Measurements
    noise: Noise
    observability: Observability
    predicted: Identifiability
    sigma: Vector
    suggestions: tuple[Suggestion, ...]
    warnings: tuple[str, ...]

    def __repr__(self) -> str:
        """In a line."""
        decided = f"a fit would determine {self.predicted.rank} of {len(self.errors.names)} directions"
        return f"<{type(self).__name__} for {shown(self.robot.name)} by {self.data.counted} with {self.data.summary}: {decided}>"


def check(
    robot: Robot,
    data: Measurements,
    *,
    options: ModelOptions | None = None,
    spot_sigma: float | None = None,
    sigmas: Mapping[str, float] | None = None,
    joint_sigma: float | Vector = 0.0,
    rng: np.random.Generator | None = None,
) -> Check:
    """Tell what the fit poses of some measurements can determine; the spots' values play no part, only which were seen.

    Readings of other instruments do play one: measuring frames, targets and places are put where they suit the nominal robot best.

    Args:
        robot: Nominal robot.
        data: Joint positions, and which beams were seen.
        options: What is to be calibrated.
        spot_sigma: Noise of a spot coordinate, [m].
        sigmas: The same of other readings by kind, [m], [rad] or [px]. What is stated neither so nor with the measurements is as noisy
            as `start_sigma` of its kind has it.
        joint_sigma: Noise of a joint reading, [rad].
        rng: For the poses that suggestions are tried with; seeded by default.

    Raises:
        UsageError: noise is stated of what was not measured, or is not above zero.
    """
    require_measured(robot, data, "check")
    options, rng = options or ModelOptions(), rng or np.random.default_rng(0)
    data = refining(data, LENS in options.estimate)
    fit_set = _with_known_places(fit_and_test(data)[0])
    robot = as_measured(robot, fit_set)
    errors, no_scale = with_scale(build_error_model(robot.chain, robot.rig, options, fit_set.session_names), fit_set)
    stated = stated_noise(fit_set, spot_sigma, sigmas)
    noise = replace(noise_of(fit_set, stated, joint_sigmas(robot, joint_sigma)), stated=True)
    nominal = nominal_fit(errors, fit_set, noise)
    errors = nominal.errors
    H = whitened(errors, fit_set, noise, nominal.x)
    P = posterior_of(errors, H)
    predicted = identify(errors.names, errors.mean, P, errors.sigma)
    return Check(
        robot=robot,
        errors=errors,
        data=fit_set,
        noise=noise,
        observability=observe(errors.names, H, errors.sigma, fit_set.pose_count),
        predicted=predicted,
        sigma=np.sqrt(np.diag(P)),
        suggestions=suggestions(Trial(robot, errors, options, fit_set, noise, nominal.x), rng),
        warnings=(
            *data.warnings,
            *copies_warning(data, fit_set),
            *model_warnings(robot, options),
            *((no_scale,) if no_scale else ()),
        ),
    )


def _with_known_places(data: Measurements) -> Measurements:
    """Without the known lengths between places that none of these poses touches."""
    touched = {place.name for place in data.instruments.places}
    return replace(data, lengths=tuple(known for known in data.lengths if {known.one, known.other} <= touched))
