"""Whether further measurements would be worth the trouble: what is open before and after them.

Where instruments beside lasers measure, more range of a joint or the orientation of a target may help. Touches are left alone: which
poses reach a socket or a plane is for whoever stands beside the robot to say.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace

import numpy as np

from urdfcal.base.geometry import DEG, MM, Matrix, Vector
from urdfcal.calibration.problem import Problem, problem_of
from urdfcal.calibration.start.nominal import nominal_fit
from urdfcal.estimation.ekf import Belief, compress, update
from urdfcal.estimation.identifiability import identify
from urdfcal.estimation.noise import Noise
from urdfcal.model.error_model import ErrorModel
from urdfcal.model.gauge import build_error_model
from urdfcal.model.options import ModelOptions
from urdfcal.model.parameters import INSTRUMENTS
from urdfcal.robot.configurations import joint_limits
from urdfcal.robot.robot import Robot
from urdfcal.sensors.measurements import Measurements, as_measured, start_sigma
from urdfcal.sensors.readings import Readings, blank_readings

_WORTH_A_WORD = 0.15  # share of the open uncertainty that a suggestion must remove beyond what as many more of the same poses would


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
    rows, _ = compress(H, np.zeros(len(H)), errors.sigma)
    return update(Belief.independent(errors.mean, errors.sigma), np.zeros(len(rows)), rows, np.eye(len(rows)))[0].P


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

    def rows(self, data: Measurements) -> Matrix:
        """Whitened Jacobian of some measurements, (m, p)."""
        return whitened(self.errors, data, self.noise, self.x)


def reading_suggestions(trial: Trial, rng: np.random.Generator) -> Iterator[Suggestion]:
    """Further measurements that remove more of the open uncertainty than as many more of the same would."""
    H = trial.rows(trial.data)
    same = posterior_of(trial.errors, np.vstack([H, H]))
    known, before = set(determined_names(trial.errors, same)), open_share(trial.errors, same)
    if all(reading.kind.anywhere for reading in trial.data.readings):
        for words, further in _more_range(trial, rng):
            yield from if_worth(trial.errors, words, before, posterior_of(trial.errors, np.vstack([H, trial.rows(further)])), known)
    for words, P in _orientations(trial):
        yield from if_worth(trial.errors, words, before, P, known)


def _more_range(trial: Trial, rng: np.random.Generator) -> Iterator[tuple[str, Measurements]]:
    """As many poses again, each with one joint anywhere within its limits."""
    lower, upper = joint_limits(trial.robot)
    for index, joint in enumerate(trial.robot.chain.inputs):
        q = trial.data.q.copy()
        q[:, index] = rng.uniform(lower[index], upper[index], len(q))
        if not is_wider(q[:, index], trial.data.q[:, index]):
            continue
        unit, size = ("mm", MM) if joint.prismatic else ("deg", DEG)
        has = f"{trial.data.q[:, index].min() / size:.0f} to {trial.data.q[:, index].max() / size:.0f} {unit}"
        words = (
            f"more range of {joint.name}: it moves from {has}, its limits are {lower[index] / size:.0f} to {upper[index] / size:.0f} {unit}"
        )
        moved = replace(trial.data, q=q, lengths=())
        yield words, replace(moved, readings=tuple(_as_predicted(trial, moved, reading) for reading in trial.data.readings))


def _as_predicted(trial: Trial, data: Measurements, own: Readings) -> Readings:
    """Readings that leave no residual to speak of; only an orientation's derivative depends on it."""
    return replace(own, values=predicted_axes(trial, data, own.target)) if own.sensor == "orientation" else own


def _orientations(trial: Trial) -> Iterator[tuple[str, Matrix]]:
    """The same poses with the orientation of a target read, too, where only its place was."""
    turned = {reading.target for reading in trial.data.readings if reading.sensor == "orientation"}
    for reading in trial.data.readings:
        if reading.sensor != "point" or reading.target in turned:
            continue
        values = np.where(reading.seen[:, None], predicted_axes(trial, trial.data, reading.target), np.nan)
        nothing = np.full(len(values), np.nan)
        axes = Readings("orientation", reading.target, reading.link, values, np.full(len(values), ""), nothing)
        words = f"the orientation of {reading.target} too, or further points on {reading.link} that are not in line with it"
        yield words, _posterior_with(trial, replace(trial.data, readings=(*trial.data.readings, axes)))


def _posterior_with(trial: Trial, data: Measurements) -> Matrix:
    """Posterior of our parameters, first in their order, where the same poses were measured with more instruments."""
    robot, names = as_measured(trial.robot, data), trial.errors.names
    errors = build_error_model(robot.chain, robot.rig, trial.options, trial.errors.sessions)
    further = (parameter for parameter in errors.parameters if parameter.kind == "target" and parameter.name not in names)
    errors = replace(errors, parameters=(*trial.errors.parameters, *further))
    noise = replace(trial.noise, sigma=start_sigma(data), stated=True)
    nominal = nominal_fit(errors, data, noise)
    return posterior_of(nominal.errors, whitened(nominal.errors, data, noise, nominal.x))


def predicted_axes(trial: Trial, data: Measurements, target: str) -> Matrix:
    """Orientation of a target in its measuring frame at some poses, as unit quaternions x, y, z, w, (n, 4)."""
    blank = replace(data, readings=(blank_readings("orientation", target, target, len(data)),), lengths=())
    axes: Matrix = Problem(trial.errors, blank).read(trial.x)[0]
    return axes
