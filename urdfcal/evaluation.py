"""A robot put to its measurements without any fit of the robot: instruments, noise, and how far everything is apart."""

from __future__ import annotations

import numpy as np

from urdfcal.error_model import ErrorModel
from urdfcal.error_table import SpotTable
from urdfcal.errors import UsageError
from urdfcal.gauge import ModelOptions, build_error_model, of_these_poses
from urdfcal.known_noise import noise_of
from urdfcal.measurements import Measurements
from urdfcal.nominal import nominal_fit
from urdfcal.robot import Robot
from urdfcal.spot_model import SpotModel


def evaluate(robot: Robot, data: Measurements, options: ModelOptions | None = None) -> SpotTable:
    """Distances of a robot as its URDF has it; where targets were measured, from measuring frames and offsets that suit it best.

    Args:
        robot: The robot.
        data: The measurements.
        options: Of which only what concerns the instruments matters.
    """
    robot = as_measured(robot, data)
    errors = _with_instruments(robot, data, options or ModelOptions()) if data.readings else _bare(robot, data)
    return nominal_fit(errors, data, noise_of(data, {}, np.zeros(len(robot.chain.inputs)))).table(data)


def as_measured(robot: Robot, data: Measurements) -> Robot:
    """The robot with the instruments that some measurements were made with."""
    return robot.seen_by(data.instruments, robot.lasers if data.lasers else ()) if data.readings else robot


def _with_instruments(robot: Robot, data: Measurements, options: ModelOptions) -> ErrorModel:
    sessions = data.session_names or ("",)
    return build_error_model(robot.chain, robot.rig, of_these_poses(robot.chain, robot.rig, options, sessions), sessions)


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
