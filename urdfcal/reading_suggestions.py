"""What would help where instruments beside lasers measure: more range of a joint, or the orientation of a target.

Touches are left alone: which poses reach a socket or a plane is for whoever stands beside the robot to say.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from urdfcal.error_model import ErrorModel
from urdfcal.evaluation import as_measured
from urdfcal.frame_jacobian import ArmKinematics, motion_at
from urdfcal.gauge import ModelOptions, build_error_model
from urdfcal.geometry import DEG, MM, Matrix, Vector
from urdfcal.measurements import Measurements
from urdfcal.noise import Noise
from urdfcal.nominal import nominal_fit
from urdfcal.readings import Readings
from urdfcal.robot import Robot
from urdfcal.simulation import joint_limits
from urdfcal.spot_model import start_sigma
from urdfcal.suggestions import Suggestion, determined_names, if_worth, is_wider, open_share, posterior_of, whitened
from urdfcal.target_model import seen_motion

_ANYWHERE = ("point", "orientation", "distance")  # what can be read at any pose, unlike touches


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
    if trial.data.readings and all(each.kind in _ANYWHERE for each in trial.data.readings) and not trial.data.lasers:
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
        yield words, replace(moved, readings=tuple(_as_predicted(trial, moved, each) for each in trial.data.readings))


def _as_predicted(trial: Trial, data: Measurements, own: Readings) -> Readings:
    """Readings that leave no residual to speak of; only an orientation's derivative depends on it."""
    return replace(own, values=predicted_axes(trial, data, own.target)) if own.kind == "orientation" else own


def _orientations(trial: Trial) -> Iterator[tuple[str, Matrix]]:
    """The same poses with the orientation of a target read, too, where only its place was."""
    turned = {each.target for each in trial.data.readings if each.kind == "orientation"}
    for own in trial.data.readings:
        if own.kind != "point" or own.target in turned:
            continue
        values = np.where(own.seen[:, None], predicted_axes(trial, trial.data, own.target), np.nan)
        nothing = np.full(len(values), np.nan)
        axes = Readings("orientation", own.target, own.link, values, np.full(len(values), ""), nothing)
        words = f"the orientation of {own.target} too, or further points on {own.link} that are not in line with it"
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
    arm, names = ArmKinematics(trial.errors.chain), [frame.name for frame in trial.errors.chain.frames]
    positions, frame = arm.chain_positions(data.q), 1 + names[1:].index(target)
    found = np.empty((len(data), 4))
    for session in trial.errors.sessions:
        rows = np.flatnonzero(data.sessions == session) if len(trial.errors.sessions) > 1 else np.arange(len(data))
        placed = trial.errors.placements(trial.x, session)
        _, R, _, _ = seen_motion(trial.errors, motion_at(arm, placed, positions[rows]), placed, frame)
        found[rows] = [pin.Quaternion(axes).coeffs() for axes in R]
    return found
