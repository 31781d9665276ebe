"""A robot put to its measurements without any fit of the robot: instruments, noise, and how far everything is apart."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from urdfcal.error_model import ErrorModel
from urdfcal.error_table import SpotTable
from urdfcal.errors import ShapeMismatch, UsageError
from urdfcal.gauge import ModelOptions, build_error_model
from urdfcal.geometry import Vector
from urdfcal.measurements import Measurements
from urdfcal.noise import Noise
from urdfcal.nominal import nominal_fit
from urdfcal.robot import Robot
from urdfcal.spot_model import SpotModel, kinds_of, start_sigma


def evaluate(robot: Robot, data: Measurements, options: ModelOptions | None = None) -> SpotTable:
    """Distances of a robot as its URDF has it; where targets were measured, from measuring frames and offsets that suit it best.

    Args:
        robot: The robot.
        data: The measurements.
        options: Of which only what concerns the instruments matters.
    """
    robot = as_measured(robot, data)
    errors = build_error_model(robot.chain, robot.rig, options, data.session_names or ("",)) if data.readings else _bare(robot, data)
    return nominal_fit(errors, data, noise_of(data, {}, np.zeros(len(robot.chain.inputs)))).table(data)


def as_measured(robot: Robot, data: Measurements) -> Robot:
    """The robot with the instruments that some measurements were made with."""
    return robot.seen_by(data.instruments, robot.lasers if data.lasers else ()) if data.readings else robot


def _bare(robot: Robot, data: Measurements) -> ErrorModel:
    return ErrorModel(robot.chain, (), (), sessions=data.session_names or ("",))


def beams_that_miss(robot: Robot, data: Measurements) -> tuple[str, ...]:
    """A warning where a beam was seen that does not meet the screen in the robot as its URDF has it."""
    _, length = SpotModel(_bare(robot, data), data).predict(np.empty(0))
    with np.errstate(invalid="ignore"):
        lost = data.seen & ~((length > 0) & np.isfinite(length))
    if not lost.any():
        return ()
    pose, laser = np.argwhere(lost)[0]
    return (
        f"{data.where(int(pose))}: {data.lasers[laser]} was seen, but in this robot its beam points away from the screen "
        f"({np.count_nonzero(lost)} such spots); their distances mean nothing",
    )


def noise_of(data: Measurements, known: Mapping[str, float], joint_sigma: Vector) -> Noise:
    """Noise of every kind of measurement: as known by kind, stated with the measurements, or where its estimation starts."""
    sigma, stated = start_sigma(data), np.zeros(len(kinds_of(data)), dtype=bool)
    for kind, name in enumerate(kinds_of(data)):
        of_targets = [each.sigma[each.seen] for each in data.readings if each.kind == name]
        own = data.sigma[data.seen] if name == "spot" else np.concatenate(of_targets)
        if name in known:
            sigma[kind], stated[kind] = known[name], True
        elif not len(own):  # nothing to estimate it from, and nothing that it matters to
            stated[kind] = True
        elif np.isfinite(own).all():
            sigma[kind], stated[kind] = np.sqrt(np.mean(own**2)), True
    return Noise(sigma, joint_sigma, stated)


def joint_sigmas(robot: Robot, joint_sigma: float | Vector) -> Vector:
    """Standard deviation of every measured joint: one number for all turning joints, or one a joint, (inputs,)."""
    turning = np.array([0.0 if joint.prismatic else 1.0 for joint in robot.chain.inputs])
    sigmas = np.asarray(joint_sigma, dtype=float)
    if sigmas.ndim and sigmas.shape != turning.shape:
        raise ShapeMismatch(f"the joint noise is one number, or {len(turning)}; found shape {sigmas.shape}")
    if not (np.isfinite(sigmas).all() and (sigmas >= 0).all()):
        raise UsageError("the joint noise must be finite and not negative")
    return sigmas * turning if sigmas.ndim == 0 else sigmas


def fit_and_test(data: Measurements, test: Measurements | None = None) -> tuple[Measurements, Measurements | None]:
    """The poses to fit, and those to test: marked in the data, or given apart.

    Raises:
        UsageError: nothing is left to fit, or test poses come from both.
    """
    fit_set, marked = data.split()
    if fit_set.empty:
        raise UsageError("no pose is left to fit: every row with a measurement is marked as test")
    if test is not None and len(marked):
        raise UsageError("the measurements mark test poses in their 'set' column, and other test poses were given; use one of the two")
    return fit_set, test if test is not None else marked if len(marked) else None
