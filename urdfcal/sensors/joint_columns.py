"""Joint columns of a table: positions in SI units, and what is wrong with them: degrees under a radian header, cells outside the limits.

A turning joint is at the same place a full turn away. A controller that counts from 0 to 360 deg, where the limits have -180 to 180,
reads half of them outside: such readings are taken by whole turns to where the limits have them. In a header that says [deg] any
number of turns will do. Under radians a column of degrees looks alike, so there a reading is taken by one turn at most, and only in a
column in which one turn explains nearly all that lies outside.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from urdfcal.base.geometry import DEG, Mask, Matrix, Vector
from urdfcal.base.tables import Table
from urdfcal.robot.configurations import has_room
from urdfcal.robot.robot import Robot
from urdfcal.robot.urdf_tree import UrdfJoint
from urdfcal.robot.urdf_xml import FARTHEST
from urdfcal.sensors.column_names import misspelt
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
    missing = [name for name in robot.chain.input_names if name not in table.names]
    if missing:
        raise table.fail(None, missing[0], _missing(table, robot, missing))


def _missing(table: Table, robot: Robot, missing: Sequence[str]) -> str:
    """What is to be said of joints without a column."""
    first, *others = missing
    if (recorded := f"{first}.pos") in table.names:
        return (
            f"is missing, and '{recorded}' does not say its unit, which LeRobot has as degrees or as -100 to 100 of the calibrated range; "
            f"write '{first} [deg]' if these are degrees, else record them so (use_degrees), since a share of a range is no angle"
        )
    too = f", and so {'are' if len(others) > 1 else 'is'} {', '.join(map(repr, others))}" if others else ""
    return f"is missing{too}; expected a column for each joint on the way{misspelt(first, table, robot)}"


@dataclass(frozen=True)
class JointColumns:
    """The columns of a robot's measured joints, read once.

    Attributes:
        table: The table.
        robot: Whose joints they are.
    """

    table: Table
    robot: Robot

    @cached_property
    def positions(self) -> Matrix:
        """Positions, (n, joints), [rad] or [m]; readings of whole turns more or less are inside the limits.

        Raises:
            MeasurementError: a joint's column is missing, or holds something else than numbers.
        """
        return np.column_stack([column.read + column.turns * _TURN for column in self._columns])

    def warnings(self) -> Iterator[str]:
        """What is to be said of joints that are outside their limits in some poses, or whole turns away from them.

        Raises:
            MeasurementError: most of a joint's cells make sense as degrees only.
        """
        outside = [column for column in self._columns if column.outside.any()]
        for column in outside:
            column.refuse_degrees(self.table)
        yield from (column.told_outside(self.table) for column in outside if has_room(column.joint))
        held = [column.joint.name for column in outside if not has_room(column.joint)]
        if held:
            yield self._told_held(held)
        if any(column.turns.any() for column in self._columns):
            yield self._told_turns()

    @cached_property
    def _columns(self) -> tuple[_Column, ...]:
        require_joints(self.table, self.robot)
        return tuple(_Column(joint, *_read(self.table, joint)) for joint in self.robot.chain.inputs)

    def _told_held(self, names: Sequence[str]) -> str:
        """One line about joints that move though their limits leave them no room."""
        return (
            f"{self.robot.description.label}: lower and upper limit of {', '.join(names)} are the same, which leaves no workspace; their "
            f"positions are taken as {self.table.path} has them, predictions are over the range of these, and no wider one is suggested"
        )

    def _told_turns(self) -> str:
        """One line about all readings that were moved."""
        moved = np.array([column.turns != 0 for column in self._columns])
        names = [column.joint.name for column in self._columns if column.turns.any()]
        cells = f"{moved.sum()} of {moved.size} cells are" if moved.sum() > 1 else "a cell is"
        words = f"{cells} a full turn or more outside the limits of {', '.join(names)} and taken for the same place inside"
        return str(self.table.fail(int(np.argmax(moved.any(axis=0))), names[0], words))


@dataclass(frozen=True)
class _Column:
    """One joint's readings, (n,), [rad] or [m], and whether its header says that they are in degrees."""

    joint: UrdfJoint
    read: Vector
    degrees: bool

    @cached_property
    def turns(self) -> Vector:
        """By how many whole turns each reading is to be moved to lie within the limits, (n,); 0 where it stays."""
        joint, read = self.joint, self.read
        if joint.type != "revolute":
            return np.zeros(len(read))
        up, down = np.ceil((joint.lower - _CLOSE - read) / _TURN), np.floor((joint.upper + _CLOSE - read) / _TURN)
        outside, turns = ~self._within(read), np.where(read < joint.lower, up, down)
        turns = np.where(outside & self._within(read + turns * _TURN), turns, 0.0)
        if self.degrees:
            return turns
        once = np.abs(turns) == 1
        return np.where(once, turns, 0.0) if once.sum() >= _MOST_OUTSIDE * outside.sum() else np.zeros(len(read))

    @cached_property
    def outside(self) -> Mask:
        """Which readings lie outside the limits, and no turn brings inside, (n,)."""
        return np.asarray(~self._within(self.read) & (self.turns == 0))

    def refuse_degrees(self, table: Table) -> None:
        """Refuse a column most of which is outside the limits, and inside them as degrees, unless its header says that it is in degrees."""
        share = self.outside & self._within(self.read * DEG)
        if not (self.joint.prismatic or self.degrees) and 2 * share.sum() > len(table):
            found = f"{share.sum()} of {len(table)} cells lie outside the limits {self._limits_in_words()} and inside them as degrees"
            raise table.fail(int(np.argmax(self.outside)), self.joint.name, f"{found}; write '{self.joint.name} [deg]' in the header")

    def told_outside(self, table: Table) -> str:
        """One line about readings outside the limits."""
        many = f"{self.outside.sum()} of {len(table)} cells lie" if self.outside.sum() > 1 else "a cell lies"
        words = f"{many} outside the joint's limits {self._limits_in_words()}"
        return str(table.fail(int(np.argmax(self.outside)), self.joint.name, words))

    @property
    def _limits(self) -> tuple[float, float]:
        return (-_TURNS, _TURNS) if self.joint.type == "continuous" else (self.joint.lower, self.joint.upper)

    def _limits_in_words(self) -> str:
        lower, upper = (limit / DEG if self.degrees else limit for limit in self._limits)
        return f"{lower:.4g} to {upper:.4g} {'m' if self.joint.prismatic else 'deg' if self.degrees else 'rad'}"

    def _within(self, positions: Vector) -> Mask:
        lower, upper = self._limits
        return (positions >= lower - _CLOSE) & (positions <= upper + _CLOSE)


def _read(table: Table, joint: UrdfJoint) -> tuple[Vector, bool]:
    units = QUANTITIES["length" if joint.prismatic else "angle"]
    way_out = f"expected the joint's position in {next(iter(units))} (or say [deg], [mm] in the header)"
    return table.numbers(joint.name, units, way_out, most=FARTHEST), table.units.get(joint.name) == "deg"
