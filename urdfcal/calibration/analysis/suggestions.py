"""Whether further measurements would be worth the trouble: what is open before and after them.

More range of a joint may help with every instrument; with lasers alone a second beam, or a screen that stands elsewhere; with targets
their orientation. Touches are left alone: which poses reach a socket or a plane is for whoever stands beside the robot to say.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product

import numpy as np
import pinocchio as pin

from urdfcal.base.geometry import DEG, MM, Mask, Matrix, Vector, X, Y
from urdfcal.base.terminal import rounded
from urdfcal.calibration.analysis.more_poses import FURTHER, covariance, information_of_a_pose, without_lost
from urdfcal.calibration.analysis.prediction import default_far, default_tool, spread
from urdfcal.calibration.analysis.tool_accuracy import motion_up_to_constants
from urdfcal.calibration.problem import Problem, problem_of
from urdfcal.calibration.start.nominal import nominal_fit
from urdfcal.estimation.ekf import Belief, told
from urdfcal.estimation.identifiability import identify
from urdfcal.estimation.noise import Noise
from urdfcal.model.error_model import ErrorModel
from urdfcal.model.gauge import build_error_model, missing_screen_parameters
from urdfcal.model.jacobian import arm_motion
from urdfcal.model.options import ModelOptions
from urdfcal.model.parameters import INSTRUMENTS
from urdfcal.robot.configurations import joint_limits
from urdfcal.robot.robot import Robot
from urdfcal.robot.urdf_tree import UrdfJoint
from urdfcal.sensors.measurements import Measurements, as_measured, spots_measured, start_sigma
from urdfcal.sensors.readings import Readings, blank_readings
from urdfcal.sensors.registry import SENSORS
from urdfcal.sensors.spots import beams_at, beams_of, spot_jacobian

_GOOD = 0.1  # share of what the priors hold possible that a link's error is to come under
_WORTH_A_WORD = 0.15  # share of the open uncertainty that a suggestion must remove beyond what as many more of the same poses would
_SPREADS = 60 * DEG, -60 * DEG, 30 * DEG, -30 * DEG  # angles between a laser and the second one that is tried, until one is seen
_MOVED_SCREEN = {"trans_x": -0.3, "rot_y": 20 * DEG, "rot_z": 20 * DEG}  # another session's screen that is tried, [m] and [rad]
_ELSEWHERE = "tried elsewhere"
_REACH = 3.0  # [m] longest beam of a pose that is suggested


@dataclass(frozen=True)
class Suggestion:
    """Measurements that would help.

    Attributes:
        words: What to measure.
        gain: Share of the open uncertainty that they remove, beyond what as many more of the same poses would.
        determines: Parameters that would be determined in addition.
    """

    words: str
    gain: float
    determines: tuple[str, ...] = ()


def whitened(errors: ErrorModel, data: Measurements, noise: Noise, x: Vector) -> Matrix:
    """Jacobian of everything that was measured, in units of its noise, (m, p)."""
    linearisation = problem_of(errors, data, noise).linearise(x)
    return noise.weights(linearisation).jacobian(linearisation)


def posterior_of(errors: ErrorModel, H: Matrix) -> Matrix:
    """Covariance that measurements with this whitened Jacobian leave of the prior, (p, p)."""
    return told(Belief.independent(errors.mean, errors.sigma), H).P


def open_share(errors: ErrorModel, P: Matrix) -> float:
    """How much of the prior is left: the sum of posterior over prior variances of the robot's own parameters."""
    own = np.array([parameter.kind not in INSTRUMENTS for parameter in errors.parameters])
    return float(np.sum((np.diag(P)[: len(own)] / errors.sigma**2)[own]))


def determined_names(errors: ErrorModel, P: Matrix) -> list[str]:
    """The robot's own parameters that are determined under a posterior; rows of P behind ours are left out."""
    p = len(errors.names)
    found = identify(errors.names, errors.mean, P[:p, :p], errors.sigma).determined
    return [each.name for each, yes in zip(errors.parameters, found, strict=True) if yes and each.kind not in INSTRUMENTS]


def if_worth(errors: ErrorModel, words: str, before: float, P: Matrix, known: Collection[str]) -> Iterator[Suggestion]:
    """The suggestion, if it removes enough of what was open before, or determines what is not known yet."""
    gain = 1 - open_share(errors, P) / before
    more = tuple(name for name in determined_names(errors, P) if name not in known)
    if gain > _WORTH_A_WORD or more:
        yield Suggestion(words, gain, more)


def is_wider(new: Vector, old: Vector) -> bool:
    """Whether one joint's positions reach farther than others."""
    return bool(np.ptp(new) > 1.2 * np.ptp(old) + 1e-9)


def in_words(positions: Vector, joint: UrdfJoint) -> str:
    """The range of a joint's positions, in mm or degrees."""
    unit, size = ("mm", MM) if joint.prismatic else ("deg", DEG)
    return f"{positions.min() / size:.0f} to {positions.max() / size:.0f} {unit}"


@dataclass(frozen=True)
class Trial:
    """What further measurements are tried against.

    Attributes:
        robot: The robot with its instruments.
        errors: Parameters and priors.
        options: What is to be calibrated.
        data: The poses that there are.
        noise: Assumed noise.
        x: Where the measurement is linearised, (p,).
    """

    robot: Robot
    errors: ErrorModel
    options: ModelOptions
    data: Measurements
    noise: Noise
    x: Vector

    @property
    def lasers_alone(self) -> bool:
        """Whether nothing but spots was measured."""
        return not self.data.instruments.needed

    def rows(self, data: Measurements) -> Matrix:
        """Whitened Jacobian of some measurements, (m, p)."""
        return whitened(self.errors, data, self.noise, self.x)

    @cached_property
    def measured(self) -> Matrix:
        """Whitened Jacobian of the poses that there are, (m, p)."""
        return self.rows(self.data)

    def posterior_with(self, extra: Matrix) -> Matrix:
        """Covariance that the poses that there are and further rows of the whitened Jacobian leave, (p, p)."""
        return posterior_of(self.errors, np.vstack([self.measured, extra]))


def suggestions(trial: Trial, rng: np.random.Generator) -> tuple[Suggestion, ...]:
    """Further measurements that remove more of the open uncertainty than as many more of the same would, best first."""
    same = trial.posterior_with(trial.measured)
    known, before = set(determined_names(trial.errors, same)), open_share(trial.errors, same)
    worth = list(_more_poses(trial, rng))
    worth += [each for words, P in _candidates(trial, rng) for each in if_worth(trial.errors, words, before, P, known)]
    if trial.lasers_alone:
        worth += _missing_yaw(trial)
    return tuple(sorted(worth, key=lambda suggestion: -suggestion.gain))


def _more_poses(trial: Trial, rng: np.random.Generator) -> Iterator[Suggestion]:
    """So many poses of the same kind that a link's error, up to constants, comes under a share of what the priors hold possible."""
    link, errors = default_tool(trial.robot), trial.errors
    a_pose, measured = information_of_a_pose(errors, trial.data, trial.noise, trial.x, rng), trial.measured.T @ trial.measured
    A = motion_up_to_constants(trial.robot, errors, trial.x, link, trial.data.q, rng, default_far(trial.robot))

    def left(further: int) -> float:
        return float(np.sqrt(np.mean(spread(A, covariance(measured + further * a_pose, errors.sigma)) ** 2)))

    nominal, now = float(np.sqrt(np.mean(spread(A, np.diag(errors.sigma**2)) ** 2))), left(0)
    if now <= _GOOD * nominal:
        return
    needed = next((further for further in FURTHER if left(further) <= _GOOD * nominal), None)
    if needed is not None:
        then = left(needed)
        poses = trial.data.pose_count + needed
        words = f"more poses: about {poses} of the same kind, which leave {link} {rounded(then / MM, 2)} mm off up to a constant"
        yield Suggestion(f"{words}, now {rounded(now / MM, 2)} mm", 1 - then / now)


def _candidates(trial: Trial, rng: np.random.Generator) -> Iterator[tuple[str, Matrix]]:
    """Further measurements, and the posterior with them."""
    if trial.lasers_alone:
        yield from _range_on_the_screen(trial, rng)
        yield from _second_beam(trial)
        yield from _moved_screen(trial)
    elif all(reading.kind.anywhere for reading in trial.data.readings):
        yield from _range_anywhere(trial, rng)
    yield from _told_more(trial)


def _range_on_the_screen(trial: Trial, rng: np.random.Generator) -> Iterator[tuple[str, Matrix]]:
    """As many poses again, each with one joint anywhere within its limits at which the beams still meet the screen."""
    robot, errors, data = trial.robot, trial.errors, trial.data
    lower, upper = joint_limits(robot)
    for index, joint in enumerate(robot.chain.inputs):
        q = np.repeat(data.q, 8, axis=0)
        q[:, index] = rng.uniform(lower[index], upper[index], len(q))
        q = q[_meets_screen(errors, q)][rng.permutation(np.count_nonzero(_meets_screen(errors, q)))][: len(data)]
        if len(q) < len(data) // 2 or not is_wider(q[:, index], data.q[:, index]):
            continue
        poses = spots_measured(robot, q, np.zeros((len(q), len(robot.rig.lasers), 2)))
        first = replace(poses, sessions=np.full(len(q), errors.sessions[0]))
        has, reach = in_words(data.q[:, index], joint), in_words(q[:, index], joint)
        words = f"more range of {joint.name}: it moves from {has}, the beams stay on the screen from {reach}"
        yield words, trial.posterior_with(whitened(errors, first, trial.noise, errors.mean))


def _meets_screen(errors: ErrorModel, q: Matrix) -> Mask:
    return np.asarray(beams_at(errors, errors.mean, q).makes_spot(farthest=_REACH).all(axis=1))


def _second_beam(trial: Trial) -> Iterator[tuple[str, Matrix]]:
    """A further beam turned away from the one that is seen, where only one is."""
    errors, data = trial.errors, trial.data
    if (np.count_nonzero(data.seen, axis=1) > 1).any() or any(parameter.kind == "beam" for parameter in errors.parameters):
        return
    seen = int(np.argmax(data.seen.any(axis=0)))
    motion = arm_motion(errors, data.q, errors.mean, errors.sessions[0])
    own = motion.frames[errors.chain.laser_frames[seen]]
    for angle, axis in product(_SPREADS, (X, Y)):
        beams = beams_of(own[:, None, :, 3], (own[:, :, :3] @ pin.exp3(axis * angle)[:, 2])[:, None])
        hits = beams.makes_spot(farthest=_REACH)[:, 0]
        if hits.mean() > 0.5:
            J = (spot_jacobian(beams.spots, beams.direction)[:, 0] @ motion.jac1)[hits]
            words = f"a second beam, turned by about {abs(angle) / DEG:.0f} deg against {trial.robot.rig.lasers[seen]}"
            yield words, trial.posterior_with(J.reshape(-1, J.shape[-1]) / trial.noise.spot_sigma)
            return


def _moved_screen(trial: Trial) -> Iterator[tuple[str, Matrix]]:
    """The same poses seen on a screen that stands elsewhere."""
    robot, errors, data = trial.robot, trial.errors, trial.data
    if not errors.chain.steps[0].forward and errors.chain.screen_joint is None:
        return
    free = replace(trial.options, fix=(), only=())
    every = build_error_model(robot.chain, robot.rig, free, (*errors.sessions, _ELSEWHERE)).parameters
    further = tuple(parameter for parameter in every if f":{_ELSEWHERE}." in parameter.name)
    moved = replace(errors, parameters=(*errors.parameters, *further), sessions=(*errors.sessions, _ELSEWHERE))
    x = moved.mean.copy()
    for name, value in _MOVED_SCREEN.items():
        x[[own == f"{robot.rig.base}:{_ELSEWHERE}.{name}" for own in moved.names]] = value
    again = replace(data.with_spots(np.where(np.isnan(data.spots), np.nan, 0.0)), sessions=np.full(len(data), _ELSEWHERE))
    linearisation = without_lost(problem_of(moved, again, trial.noise).linearise(x))
    extra = trial.noise.weights(linearisation).jacobian(linearisation)
    wide = np.hstack([trial.measured, np.zeros((len(trial.measured), len(further)))])
    words = "the same poses once more with the screen moved and turned (mark them as another `session`)"
    yield words, posterior_of(moved, np.vstack([wide, extra]))


def _missing_yaw(trial: Trial) -> Iterator[Suggestion]:
    missing = missing_screen_parameters(trial.robot.chain, trial.robot.rig, trial.errors)
    if missing:
        yield Suggestion("--estimate screen: the base frame lies on the screen, whose placement is not complete without it", 1.0, missing)


def _range_anywhere(trial: Trial, rng: np.random.Generator) -> Iterator[tuple[str, Matrix]]:
    """As many poses again, each with one joint anywhere within its limits."""
    lower, upper = joint_limits(trial.robot)
    for index, joint in enumerate(trial.robot.chain.inputs):
        q = trial.data.q.copy()
        q[:, index] = rng.uniform(lower[index], upper[index], len(q))
        if not is_wider(q[:, index], trial.data.q[:, index]):
            continue
        has, limits = in_words(trial.data.q[:, index], joint), in_words(np.array([lower[index], upper[index]]), joint)
        words = f"more range of {joint.name}: it moves from {has}, its limits are {limits}"
        moved = replace(trial.data, q=q, lengths=())
        further = replace(moved, readings=tuple(_as_predicted(trial, moved, reading) for reading in trial.data.readings))
        yield words, trial.posterior_with(trial.rows(further))


def _as_predicted(trial: Trial, data: Measurements, own: Readings) -> Readings:
    """Readings that leave no residual to speak of: the derivative of some, as of orientations, depends on it."""
    read = predicted(trial, data, own.sensor, own.target, own.instrument)
    return replace(own, values=np.where(own.seen[:, None], read, own.values))


def _told_more(trial: Trial) -> Iterator[tuple[str, Matrix]]:
    """The same poses with more read of a target, as its orientation where only its place was."""
    read = {(reading.sensor, reading.label) for reading in trial.data.readings}
    for reading in trial.data.readings:
        more = reading.kind.told_more_by
        if not more or (more, reading.label) in read:
            continue
        values = np.where(reading.seen[:, None], predicted(trial, trial.data, more, reading.target, reading.instrument), np.nan)
        none = np.full(len(values), np.nan)
        further = Readings(more, reading.target, reading.link, values, np.full(len(values), ""), none, reading.instrument)
        words = f"the {SENSORS[more].words.one} of {reading.target} too, or further points on {reading.link} that are not in line with it"
        yield words, _posterior_with(trial, replace(trial.data, readings=(*trial.data.readings, further)))


def _posterior_with(trial: Trial, data: Measurements) -> Matrix:
    """Posterior of our parameters, first in their order, where the same poses were measured with more instruments."""
    robot, names = as_measured(trial.robot, data), trial.errors.names
    errors = build_error_model(robot.chain, robot.rig, trial.options, trial.errors.sessions)
    further = (parameter for parameter in errors.parameters if parameter.kind == "target" and parameter.name not in names)
    errors = replace(errors, parameters=(*trial.errors.parameters, *further))
    noise = replace(trial.noise, sigma=start_sigma(data), stated=True, common=1.0)
    nominal = nominal_fit(errors, data, noise)
    return posterior_of(nominal.errors, whitened(nominal.errors, data, noise, nominal.x))


def predicted(trial: Trial, data: Measurements, sensor: str, target: str, instrument: str = "") -> Matrix:
    """What a sensor would read of a target at some poses, as readings keep it, (n, stored)."""
    blank = replace(data, readings=(blank_readings(sensor, target, target, len(data), instrument),), lengths=())
    read: Matrix = Problem(trial.errors, blank).read(trial.x)[0]
    return read
