"""What a set of measurements can and cannot determine, without fitting, and which further ones would help."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
import pinocchio as pin

from urdfcal.base.geometry import DEG, MM, Mask, Matrix, Vector, X, Y
from urdfcal.calibration.analysis.suggestions import (
    Suggestion,
    Trial,
    determined_names,
    if_worth,
    is_wider,
    open_share,
    posterior_of,
    reading_suggestions,
    whitened,
)
from urdfcal.calibration.problem import problem_of
from urdfcal.calibration.start.begin import with_scale
from urdfcal.calibration.start.nominal import nominal_fit
from urdfcal.estimation.identifiability import Identifiability, Observability, identify, observe
from urdfcal.estimation.noise import Noise
from urdfcal.estimation.residual import Linearisation
from urdfcal.model.error_model import ErrorModel
from urdfcal.model.gauge import build_error_model, missing_screen_parameters, model_warnings
from urdfcal.model.jacobian import ArmKinematics, motion_at
from urdfcal.model.options import ModelOptions
from urdfcal.robot.configurations import joint_limits
from urdfcal.robot.robot import Robot
from urdfcal.sensors.measurements import Measurements, as_measured, fit_and_test, measurements_from
from urdfcal.sensors.spots import beams_at, beams_of, spot_jacobian
from urdfcal.sensors.stated_noise import joint_sigmas, noise_of, stated_noise

_SPREADS = 60 * DEG, -60 * DEG, 30 * DEG, -30 * DEG  # angles between a laser and the second one that is tried, until one is seen
_MOVED_SCREEN = {"trans_x": -0.3, "rot_y": 20 * DEG, "rot_z": 20 * DEG}  # another session's screen that is tried, [m] and [rad]
_ELSEWHERE = "tried elsewhere"
_REACH = 3.0  # [m] longest beam of a pose that is suggested


@dataclass(frozen=True)
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
            as `reading_kinds.KINDS` has it.
        joint_sigma: Noise of a joint reading, [rad].
        rng: For the poses that suggestions are tried with; seeded by default.

    Raises:
        UsageError: noise is stated of what was not measured, or is not above zero.
    """
    options, rng = options or ModelOptions(), rng or np.random.default_rng(0)
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
    if fit_set.instruments.needed:
        tried = list(reading_suggestions(Trial(robot, errors, options, fit_set, noise, nominal.x), rng))
    else:
        tried = [*_tried(robot, errors, options, fit_set, noise, H, rng), *_missing_yaw(robot, errors)]
    return Check(
        robot=robot,
        errors=errors,
        data=fit_set,
        noise=noise,
        observability=observe(errors.names, H, errors.sigma, len(fit_set)),
        predicted=predicted,
        sigma=np.sqrt(np.diag(P)),
        suggestions=tuple(sorted(tried, key=lambda suggestion: -suggestion.gain)),
        warnings=(*data.warnings, *model_warnings(robot, errors, options), *((no_scale,) if no_scale else ())),
    )


def _with_known_places(data: Measurements) -> Measurements:
    """Without the known lengths between places that none of these poses touches."""
    touched = {place.name for place in data.instruments.places}
    return replace(data, lengths=tuple(known for known in data.lengths if {known.one, known.other} <= touched))


def _tried(
    robot: Robot, errors: ErrorModel, options: ModelOptions, data: Measurements, noise: Noise, H: Matrix, rng: np.random.Generator
) -> Iterator[Suggestion]:
    """Candidate measurements that remove more of the open uncertainty than as many more of the same would."""
    same = posterior_of(errors, np.vstack([H, H]))
    known = set(determined_names(errors, same))
    candidates = [*_more_range(robot, errors, data, noise, rng), *_second_beam(robot, errors, data, noise)]
    for words, extra in candidates:
        P = posterior_of(errors, np.vstack([H, extra]))
        yield from if_worth(errors, words, open_share(errors, same), P, known)
    if errors.chain.steps[0].forward or errors.chain.screen_joint is not None:
        yield from if_worth(errors, _SESSION_WORDS, open_share(errors, same), _with_session(robot, errors, options, data, noise, H), known)


_SESSION_WORDS = "the same poses once more with the screen moved and turned (mark them as another `session`)"


def _more_range(
    robot: Robot, errors: ErrorModel, data: Measurements, noise: Noise, rng: np.random.Generator
) -> Iterator[tuple[str, Matrix]]:
    """As many poses again, each with one joint anywhere within its limits at which the beams still meet the screen."""
    lower, upper = joint_limits(robot)
    for index, joint in enumerate(robot.chain.inputs):
        q = np.repeat(data.q, 8, axis=0)
        q[:, index] = rng.uniform(lower[index], upper[index], len(q))
        q = q[_meets_screen(errors, q)][rng.permutation(np.count_nonzero(_meets_screen(errors, q)))][: len(data)]
        if len(q) < len(data) // 2 or not is_wider(q[:, index], data.q[:, index]):
            continue
        poses = measurements_from(robot, q, np.zeros((len(q), len(robot.rig.lasers), 2)))
        first = replace(poses, sessions=np.full(len(q), errors.sessions[0]))
        unit, size = ("mm", MM) if joint.prismatic else ("deg", DEG)
        reach = f"{q[:, index].min() / size:.0f} to {q[:, index].max() / size:.0f} {unit}"
        has = f"{data.q[:, index].min() / size:.0f} to {data.q[:, index].max() / size:.0f} {unit}"
        words = f"more range of {joint.name}: it moves from {has}, the beams stay on the screen from {reach}"
        yield words, whitened(errors, first, noise, errors.mean)


def _meets_screen(errors: ErrorModel, q: Matrix) -> Mask:
    return np.asarray(beams_at(errors, errors.mean, q).makes_spot(farthest=_REACH).all(axis=1))


def _second_beam(robot: Robot, errors: ErrorModel, data: Measurements, noise: Noise) -> Iterator[tuple[str, Matrix]]:
    """A further beam turned away from the one that is seen, where only one is."""
    if (np.count_nonzero(data.seen, axis=1) > 1).any() or any(parameter.kind == "beam" for parameter in errors.parameters):
        return
    seen = int(np.argmax(data.seen.any(axis=0)))
    arm, placed = ArmKinematics(errors.chain), errors.placements(errors.mean, errors.sessions[0])
    motion = motion_at(arm, placed, arm.chain_positions(data.q))
    own = motion.frames[errors.chain.laser_frames[seen]]
    for angle, axis in product(_SPREADS, (X, Y)):
        beams = beams_of(own[:, None, :, 3], (own[:, :, :3] @ pin.exp3(axis * angle)[:, 2])[:, None])
        hits = beams.makes_spot(farthest=_REACH)[:, 0]
        if hits.mean() > 0.5:
            J = (spot_jacobian(beams.spots, beams.direction)[:, 0] @ motion.jac1)[hits]
            yield (
                f"a second beam, turned by about {abs(angle) / DEG:.0f} deg against {robot.rig.lasers[seen]}",
                J.reshape(-1, J.shape[-1]) / noise.spot_sigma,
            )
            return


def _with_session(robot: Robot, errors: ErrorModel, options: ModelOptions, data: Measurements, noise: Noise, H: Matrix) -> Matrix:
    """Posterior of our parameters with the same poses seen on a screen that stands elsewhere."""
    free = replace(options, fix=(), only=())
    every = build_error_model(robot.chain, robot.rig, free, (*errors.sessions, _ELSEWHERE)).parameters
    further = tuple(parameter for parameter in every if f":{_ELSEWHERE}." in parameter.name)
    moved = replace(errors, parameters=(*errors.parameters, *further), sessions=(*errors.sessions, _ELSEWHERE))
    x = moved.mean.copy()
    for name, value in _MOVED_SCREEN.items():
        x[[own == f"{robot.rig.base}:{_ELSEWHERE}.{name}" for own in moved.names]] = value
    again = replace(data.with_spots(np.where(np.isnan(data.spots), np.nan, 0.0)), sessions=np.full(len(data), _ELSEWHERE))
    linearisation = problem_of(moved, again, noise).linearise(x)
    extra = noise.weights(linearisation).jacobian(_without_lost(linearisation))
    wide = np.hstack([H, np.zeros((len(H), len(further)))])
    return posterior_of(moved, np.vstack([wide, extra]))


def _without_lost(linearisation: Linearisation) -> Linearisation:
    """Beams that no longer meet a moved screen do not count."""
    bad = ~np.isfinite(linearisation.jacobian).all(axis=2) | (np.abs(linearisation.jacobian).max(axis=2) > 1e2)
    return replace(linearisation, jacobian=np.where(bad[..., None], 0.0, linearisation.jacobian))


def _missing_yaw(robot: Robot, errors: ErrorModel) -> Iterator[Suggestion]:
    missing = missing_screen_parameters(robot.chain, robot.rig, errors)
    if missing:
        yield Suggestion("--estimate screen: the base frame lies on the screen, whose placement is not complete without it", 1.0, missing)
