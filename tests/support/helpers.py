"""Second witnesses shared by the tests: finite differences, and comparisons that speak millimetres."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from urdfcal.base.geometry import Matrix, Vector, distance_mm_mrad
from urdfcal.calibration.analysis.prediction import spread, tool_jacobian
from urdfcal.model.error_model import ErrorModel
from urdfcal.robot.robot import Robot, robot_from
from urdfcal.sensors.measurements import Measurements
from urdfcal.sensors.spots import beams_at

ROBOTS = ("arm7", "arm4", "panda", "ur5", "tiago")


def without_meshes(robot: Robot) -> Robot:
    """The robot without the shapes of its description: views draw simple ones, and read no meshes."""
    text = re.sub(rb"<(visual|collision)\b.*?</\1>", b"", robot.description.text, flags=re.DOTALL)
    return robot_from(replace(robot.description, text=text))


def with_joint(index: int, factor: float = 1.0, shift: float = 0.0) -> Callable[[Measurements], Measurements]:
    """A mistake in one joint's readings."""
    keep = np.eye(100)[index] == 1
    return lambda data: replace(data, q=np.where(keep[: data.q.shape[1]], data.q * factor + shift, data.q))


def central_differences(function: Callable[[Vector], Matrix], x: Vector, step: float = 1e-5) -> Matrix:
    """Derivative of an array by each component of x, stacked on a new last axis."""
    columns = []
    for index in range(len(x)):
        shift = np.zeros_like(x)
        shift[index] = step
        columns.append((function(x + shift) - function(x - shift)) / (2 * step))
    return np.stack(columns, axis=-1)


def assert_poses_close(actual: object, desired: object, *, mm: float = 1e-6, mrad: float = 1e-6) -> None:
    """Fail with the distance between two placements."""
    off_mm, off_mrad = distance_mm_mrad(actual, desired)
    assert off_mm <= mm, f"off by {off_mm:.3g} mm and {off_mrad:.3g} mrad"
    assert off_mrad <= mrad, f"off by {off_mm:.3g} mm and {off_mrad:.3g} mrad"


def poses_in_view(robot: Robot, errors: ErrorModel, x: Vector, count: int, rng: np.random.Generator, least_zx: float = 0.3) -> Matrix:
    """Random joint positions at which every beam meets the screen at no grazing angle and within 3 m, limits apart."""
    found = np.empty((0, len(robot.chain.inputs)))
    while len(found) < count:
        q = rng.uniform(-2.5, 2.5, (2000, len(robot.chain.inputs)))
        q[:, [joint.prismatic for joint in robot.chain.inputs]] *= 0.1
        beams = beams_at(errors, x, q)
        good = (np.abs(beams.direction[..., 0]) > least_zx) & (beams.length > 0) & (beams.length < 3)
        found = np.vstack([found, q[good.all(axis=1)]])
    return found[:count]


def tool_sigma(robot: Robot, errors: ErrorModel, covariance: Matrix, x: Vector, link: str, q: Matrix) -> Matrix:
    """Predicted error of a link's pose relative to the base link: see `prediction`.

    Args:
        robot: Nominal robot; left unchanged.
        errors: Names, order and units of the parameters.
        covariance: Of the parameters, (p, p).
        x: Error parameters, (p,), [m] and [rad].
        link: A link that the calibrated joints move; joints of no concern to the calibration stay at neutral.
        q: Measured joint positions, (n, inputs), [rad] or [m].

    Returns:
        (n, 2): root of the expected squared position error [m] and rotation error [rad].

    Raises:
        RobotError: no such link, or no calibrated joint moves it.
        ShapeMismatch: covariance, x or q does not fit.
    """
    jacobian = tool_jacobian(robot, errors, x, link, q)
    return np.stack([spread(jacobian[:, :3], covariance), spread(jacobian[:, 3:], covariance)], axis=-1)
