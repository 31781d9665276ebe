"""What was understood of a file of measurements: joints and their ranges, readings, poses, units, and what is missing."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from urdfcal.base.geometry import Mask
from urdfcal.base.tables import Table
from urdfcal.base.terminal import many
from urdfcal.robot.configurations import has_room
from urdfcal.robot.robot import Robot
from urdfcal.sensors.measurements import Measurements
from urdfcal.sensors.readings import Readings
from urdfcal.sensors.registry import noun
from urdfcal.sensors.sensor import QUANTITIES, Quantity

_LITTLE = 0.2  # share of its limits below which a joint hardly moved
_FEW = 20  # poses
_MANY = 4  # numbered targets on one link, as the corners of a board are


@dataclass(frozen=True)
class JointRange:
    """What was read of one joint.

    Attributes:
        name: Of the joint.
        prismatic: Whether it slides.
        unit: Of its column.
        stated: Whether the file states the unit; else it is the default.
        lower, upper: Least and largest position, [rad] or [m].
        limits: The joint's own, [rad] or [m]; None if it has none.
    """

    name: str
    prismatic: bool
    unit: str
    stated: bool
    lower: float
    upper: float
    limits: tuple[float, float] | None

    @property
    def share(self) -> float | None:
        """Which share of its limits it moved through; None without limits."""
        return None if self.limits is None else (self.upper - self.lower) / (self.limits[1] - self.limits[0])


@dataclass(frozen=True)
class ReadingCount:
    """What one sensor read of one target.

    Attributes:
        readings: The readings.
        columns: Their columns in the file.
        units: Units of these, without repetition; empty for labels and plain numbers.
        stated: Whether the file states them.
    """

    readings: Readings
    columns: tuple[str, ...]
    units: tuple[str, ...]
    stated: bool

    @property
    def seen(self) -> int:
        """In how many rows it was read."""
        return int(self.readings.seen.sum())

    @property
    def partly(self) -> Mask:
        """In which rows some of its numbers are missing that others have, (n,)."""
        measured = self.readings.measured
        return np.asarray(self.readings.seen & ~measured[:, measured.any(axis=0)].all(axis=1))


@dataclass(frozen=True)
class Overview:
    """What was understood of a file.

    Attributes:
        robot: As the measurements see it.
        data: The measurements.
        joints: Those on the way.
        readings: By sensor and target.
    """

    robot: Robot
    data: Measurements
    joints: tuple[JointRange, ...]
    readings: tuple[ReadingCount, ...]

    @property
    def copies(self) -> int:
        """Rows that are copies of others."""
        return len(self.data) - len(self.data.without_copies())

    @property
    def unread(self) -> int:
        """Rows in which nothing was read."""
        return int(np.count_nonzero(~self.data.observed))

    def _in_part(self, each: ReadingCount) -> str:
        """`2 of 40 points of tool0 lack a coordinate, the first in line 7`."""
        partly, line = each.partly, self.data.lines
        first = "" if line is None else f", {'the first ' if partly.sum() > 1 else ''}in line {line[int(np.argmax(partly))]}"
        verb = "lack" if partly.sum() > 1 else "lacks"
        points = f"{each.seen} {noun(each.readings.noise, each.seen)}"
        return f"{partly.sum()} of {points} of {each.readings.label} {verb} a coordinate{first}"

    def missing(self) -> Iterator[str]:
        """What the file lacks for a good calibration, one line each."""
        for each in self.readings:
            lacking = [ending for ending in each.readings.kind.endings if f"{each.readings.label}.{ending}" not in each.columns]
            if each.readings.sensor == "point" and lacking:
                yield f"{each.readings.label} has no {', '.join(f'.{ending}' for ending in lacking)}: those coordinates are not used"
            if each.partly.any():
                yield f"{self._in_part(each)}; what else was read there is used"
        still = [joint.name for joint in self.joints if joint.share is not None and joint.share < _LITTLE]
        if still:
            yield f"{', '.join(still)} moved through less than {_LITTLE:.0%} of the limits: errors there show little"
        if self.data.pose_count < _FEW:
            yield f"only {many(self.data.pose_count, 'different pose')}: {_FEW} or more are better"
        if not (self.data.sets == "test").any():
            yield "no test poses: mark some in a column 'set', or use fit --holdout 0.3"


def overview(table: Table, robot: Robot, data: Measurements) -> Overview:
    """What was understood.

    Args:
        table: The file with our names for its columns.
        robot: As the measurements see it.
        data: What was read from the table.
    """
    return Overview(robot, data, tuple(_joints(table, robot, data)), tuple(_count(table, each) for each in data.readings))


def _joints(table: Table, robot: Robot, data: Measurements) -> Iterator[JointRange]:
    for joint, positions in zip(robot.chain.inputs, data.q.T, strict=True):
        limits = (joint.lower, joint.upper) if joint.type != "continuous" and has_room(joint) else None
        unit = table.units.get(joint.name, "m" if joint.prismatic else "rad")
        yield JointRange(
            joint.name, joint.prismatic, unit, joint.name in table.units, float(positions.min()), float(positions.max()), limits
        )


def _count(table: Table, readings: Readings) -> ReadingCount:
    columns = {f"{readings.label}.{ending}": quantity for ending, quantity in readings.kind.endings.items()}
    present = [name for name in columns if name in table.names]
    units = dict.fromkeys(unit for name in present if (unit := table.units.get(name, _default(columns[name]))))
    return ReadingCount(readings, tuple(present), tuple(units), any(name in table.units for name in present))


def _default(quantity: Quantity) -> str:
    """The unit of a column that states none."""
    return "px" if quantity == "pixel" else next(iter(QUANTITIES[quantity]), "")


def by_board(found: Overview) -> list[list[ReadingCount]]:
    """What is told in one line: all that one instrument reads of a board, or of a link with many numbered targets; else one by one."""
    groups: dict[tuple[str, ...], list[ReadingCount]] = {}
    for each in found.readings:
        own = each.readings
        numbered = own.target.partition(":")[2].isdigit()
        key = (own.sensor, own.link, own.instrument) if numbered else (own.sensor, own.target, own.instrument, "alone")
        groups.setdefault(key, []).append(each)
    return [part for group in groups.values() for part in ([group] if len(group) >= _MANY else [[each] for each in group])]


def told(group: Sequence[ReadingCount]) -> str:
    """`40 points`, `40 points, 2 in part`, of all of a group."""
    part, seen = sum(int(each.partly.sum()) for each in group), sum(each.seen for each in group)
    return f"{seen} {noun(group[0].readings.noise, seen)}{f', {part} in part' if part else ''}"
