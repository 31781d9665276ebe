"""Joint columns of a table: positions in SI units, and what is wrong with them: degrees under a radian header, cells outside the limits."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from urdfcal.base.geometry import DEG, Mask, Matrix, Vector
from urdfcal.base.tables import Table
from urdfcal.robot.robot import Robot
from urdfcal.robot.urdf_tree import FARTHEST, UrdfJoint
from urdfcal.sensors.sensor import QUANTITIES

_TURNS = 4 * math.pi  # a continuous joint is hardly ever farther from zero than this, unless it is in degrees
_CLOSE = 1e-6  # by which a position may pass a limit


def require_joints(table: Table, robot: Robot) -> None:
    """Refuse a table without a column for each measured joint.

    Raises:
        MeasurementError: naming the first that is missing.
    """
    for joint in robot.chain.inputs:
        table.require(joint.name, "a column for each joint on the way")


def joint_positions(table: Table, robot: Robot) -> Matrix:
    """Positions of the robot's measured joints, (n, joints), [rad] or [m].

    Raises:
        MeasurementError: a joint's column is missing, or holds something else than numbers.
    """
    require_joints(table, robot)
    return np.column_stack([_positions(table, joint) for joint in robot.chain.inputs])


def limit_warnings(table: Table, robot: Robot, q: Matrix) -> Iterator[str]:
    """What is to be said of joints that are outside their limits in some poses.

    Raises:
        MeasurementError: most of a joint's cells make sense as degrees only.
    """
    for joint, positions in zip(robot.chain.inputs, q.T, strict=True):
        outside = ~_within(joint, positions)
        _refuse_degrees(table, joint, positions, outside)
        if outside.any():
            many = f"{outside.sum()} of {len(table)} cells lie" if outside.sum() > 1 else "a cell lies"
            yield str(table.fail(int(np.argmax(outside)), joint.name, f"{many} outside the joint's limits {_told_limits(joint)}"))


def _positions(table: Table, joint: UrdfJoint) -> Vector:
    units = QUANTITIES["length" if joint.prismatic else "angle"]
    way_out = f"expected the joint's position in {next(iter(units))} (or say [deg], [mm] in the header)"
    return table.numbers(joint.name, units, way_out, most=FARTHEST)


def _refuse_degrees(table: Table, joint: UrdfJoint, positions: Vector, outside: Mask) -> None:
    degrees = outside & _within(joint, positions * DEG)
    if not joint.prismatic and 2 * degrees.sum() > len(table):
        found = f"{degrees.sum()} of {len(table)} cells lie outside the limits {_told_limits(joint)} and inside them as degrees"
        raise table.fail(int(np.argmax(outside)), joint.name, f"{found}; write '{joint.name} [deg]' in the header")


def _limits(joint: UrdfJoint) -> tuple[float, float]:
    return (-_TURNS, _TURNS) if joint.type == "continuous" else (joint.lower, joint.upper)


def _told_limits(joint: UrdfJoint) -> str:
    lower, upper = _limits(joint)
    return f"{lower:.4g} to {upper:.4g} {'m' if joint.prismatic else 'rad'}"


def _within(joint: UrdfJoint, positions: Vector) -> Mask:
    lower, upper = _limits(joint)
    return (positions >= lower - _CLOSE) & (positions <= upper + _CLOSE)
