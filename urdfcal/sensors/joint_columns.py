"""Joint columns of a table: positions in SI units, and what is wrong with them: degrees under a radian header, cells outside the limits.

A turning joint is at the same place a full turn away. A controller that counts from 0 to 360 deg, where the limits have -180 to 180,
reads half of them outside: such readings are taken by whole turns to where the limits have them. In a header that says [deg] any
number of turns will do. Under radians a column of degrees looks alike, so there a reading is taken by one turn at most, and only in a
column in which one turn explains nearly all that lies outside.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from urdfcal.base.geometry import DEG, Mask, Matrix, Vector
from urdfcal.base.tables import Table
from urdfcal.robot.configurations import has_room
from urdfcal.robot.robot import Robot
from urdfcal.robot.urdf_tree import FARTHEST, UrdfJoint
from urdfcal.sensors.sensor import QUANTITIES

_TURNS = 4 * math.pi  # a continuous joint is hardly ever farther from zero than this, unless it is in degrees
_CLOSE = 1e-6  # by which a position may pass a limit
_TURN = 2 * math.pi
_MOST_OUTSIDE = 0.9  # share of a column's radians outside the limits that one turn must explain


def require_joints(table: Table, robot: Robot) -> None:
    """Refuse a table without a column for each measured joint.

    Raises:
        MeasurementError: naming the first that is missing.
    """
    for joint in robot.chain.inputs:
        table.require(joint.name, "a column for each joint on the way")


def joint_positions(table: Table, robot: Robot) -> Matrix:
    """Positions of the robot's measured joints, (n, joints), [rad] or [m]; readings of whole turns more or less are inside the limits.

    Raises:
        MeasurementError: a joint's column is missing, or holds something else than numbers.
    """
    require_joints(table, robot)
    columns = [_positions(table, joint) for joint in robot.chain.inputs]
    return np.column_stack([read + _turns(table, joint, read) * _TURN for joint, read in zip(robot.chain.inputs, columns, strict=True)])


def limit_warnings(table: Table, robot: Robot) -> Iterator[str]:
    """What is to be said of joints that are outside their limits in some poses, or whole turns away from them.

    Raises:
        MeasurementError: most of a joint's cells make sense as degrees only.
    """
    columns = [_positions(table, joint) for joint in robot.chain.inputs]
    turns = [_turns(table, joint, positions) for joint, positions in zip(robot.chain.inputs, columns, strict=True)]
    held: list[str] = []
    for joint, positions, whole in zip(robot.chain.inputs, columns, turns, strict=True):
        outside = ~_within(joint, positions) & (whole == 0)
        _refuse_degrees(table, joint, positions, outside)
        if outside.any() and not has_room(joint):
            held.append(joint.name)
        elif outside.any():
            many = f"{outside.sum()} of {len(table)} cells lie" if outside.sum() > 1 else "a cell lies"
            limits = _told_limits(joint, _in_degrees(table, joint))
            yield str(table.fail(int(np.argmax(outside)), joint.name, f"{many} outside the joint's limits {limits}"))
    if held:
        yield _told_held(table, robot, held)
    if np.any(turns):
        yield _told_turns(table, robot, np.array(turns))


def _told_held(table: Table, robot: Robot, names: list[str]) -> str:
    """One line about joints that move though their limits leave them no room."""
    return (
        f"{robot.description.label}: lower and upper limit of {', '.join(names)} are the same, which leaves no workspace; their positions "
        f"are taken as {table.path} has them, predictions are over the range of these, and no wider one is suggested"
    )


def _turns(table: Table, joint: UrdfJoint, positions: Vector) -> Vector:
    """By how many whole turns each reading is to be moved to lie within the limits, (n,); 0 where it stays."""
    if joint.type != "revolute":
        return np.zeros(len(positions))
    up, down = np.ceil((joint.lower - _CLOSE - positions) / _TURN), np.floor((joint.upper + _CLOSE - positions) / _TURN)
    outside, turns = ~_within(joint, positions), np.where(positions < joint.lower, up, down)
    turns = np.where(outside & _within(joint, positions + turns * _TURN), turns, 0.0)
    if _in_degrees(table, joint):
        return turns
    once = np.abs(turns) == 1
    return np.where(once, turns, 0.0) if once.sum() >= _MOST_OUTSIDE * outside.sum() else np.zeros(len(positions))


def _told_turns(table: Table, robot: Robot, turns: Matrix) -> str:
    """One line about all readings that were moved, (joints, n)."""
    names = [joint.name for joint, own in zip(robot.chain.inputs, turns, strict=True) if own.any()]
    count, row = np.count_nonzero(turns), int(np.argmax(turns.any(axis=0)))
    cells = f"{count} of {turns.size} cells are" if count > 1 else "a cell is"
    return str(
        table.fail(
            row, names[0], f"{cells} a full turn or more outside the limits of {', '.join(names)} and taken for the same place inside"
        )
    )


def _positions(table: Table, joint: UrdfJoint) -> Vector:
    units = QUANTITIES["length" if joint.prismatic else "angle"]
    way_out = f"expected the joint's position in {next(iter(units))} (or say [deg], [mm] in the header)"
    return table.numbers(joint.name, units, way_out, most=FARTHEST)


def _refuse_degrees(table: Table, joint: UrdfJoint, positions: Vector, outside: Mask) -> None:
    degrees = outside & _within(joint, positions * DEG)
    if not (joint.prismatic or _in_degrees(table, joint)) and 2 * degrees.sum() > len(table):
        found = f"{degrees.sum()} of {len(table)} cells lie outside the limits {_told_limits(joint)} and inside them as degrees"
        raise table.fail(int(np.argmax(outside)), joint.name, f"{found}; write '{joint.name} [deg]' in the header")


def _limits(joint: UrdfJoint) -> tuple[float, float]:
    return (-_TURNS, _TURNS) if joint.type == "continuous" else (joint.lower, joint.upper)


def _in_degrees(table: Table, joint: UrdfJoint) -> bool:
    return table.units.get(joint.name) == "deg"


def _told_limits(joint: UrdfJoint, degrees: bool = False) -> str:
    lower, upper = (limit / DEG if degrees else limit for limit in _limits(joint))
    return f"{lower:.4g} to {upper:.4g} {'m' if joint.prismatic else 'deg' if degrees else 'rad'}"


def _within(joint: UrdfJoint, positions: Vector) -> Mask:
    lower, upper = _limits(joint)
    return (positions >= lower - _CLOSE) & (positions <= upper + _CLOSE)
