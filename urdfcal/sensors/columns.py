"""Columns of a measurements file: which sensor and which target each name means, and what is written back."""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass

from urdfcal.base.errors import no_such
from urdfcal.robot.robot import Robot
from urdfcal.sensors.readings import Readings
from urdfcal.sensors.registry import SENSORS
from urdfcal.sensors.sensor import Sensor
from urdfcal.sensors.targets import QUATERNION

_OF_TARGETS = {ending: sensor.name for sensor in SENSORS.values() if not sensor.beam for ending in sensor.endings}
_OF_LASERS = {ending: sensor.name for sensor in SENSORS.values() if sensor.beam for ending in sensor.endings}
_OF_NOISE = {sensor.sigma_ending for sensor in SENSORS.values() if sensor.sigma_ending}
_FIGAROH = re.compile(r"(x|y|z|phix|phiy|phiz)(\d+)")
_FIGAROH_WORDS = {"phix": "roll", "phiy": "pitch", "phiz": "yaw"}


@dataclass(frozen=True)
class ReadingColumn:
    """A column of readings.

    Attributes:
        name: As in the header, without its unit.
        target: The target's name.
        link: The link that it is on.
        ending: What stands behind the target's name.
        sensor: Name of the sensor that reads it; the empty string where it states the noise of the others.
    """

    name: str
    target: str
    link: str
    ending: str
    sensor: str

    @property
    def kind(self) -> Sensor:
        """How it is read."""
        return SENSORS[self.sensor]


def reading_columns(names: Iterable[str], robot: Robot, lasers: Sequence[str]) -> tuple[ReadingColumn, ...]:
    """The columns that mean a target on a link of this robot, or the spots of one of these lasers."""
    found = []
    for name in names:
        target, dot, ending = name.rpartition(".")
        link = target if target in robot.tree.links else target.rpartition(":")[0]
        known = _OF_LASERS if target in lasers else _OF_TARGETS
        if dot and link in robot.tree.links and (ending in known or ending in _OF_NOISE):
            found.append(ReadingColumn(name, target, link, ending, known.get(ending, "")))
    read = {column.target for column in found if column.sensor}
    return tuple(column for column in found if column.target in read)


def refusal(columns: Sequence[ReadingColumn], units: Mapping[str, str]) -> tuple[str, str] | None:
    """The first column that cannot be taken as it is, and why: a unit that means nothing, half a name, two orientations."""
    turned: dict[str, ReadingColumn] = {}
    for column in columns:
        if column.target.endswith(":"):
            return column.name, f"the label behind '{column.target}' is empty; expected {column.link}.{column.ending}, or a label"
        if column.sensor and column.kind.touches and column.name in units:
            return column.name, f"the unit '{units[column.name]}' of a label means nothing; expected '{column.name}' alone"
        if column.sensor == "orientation":
            first = turned.setdefault(column.target, column)
            if (first.ending in QUATERNION) != (column.ending in QUATERNION):
                return column.name, f"the orientation is in '{first.name}', too; leave one of the two out"
    return None


def lost_column(names: Collection[str], robot: Robot) -> tuple[str, str] | None:
    """Where a header means nothing at all: the first column that looks like a target's, and what is wrong with its link or its ending."""
    known, links = set(names), robot.tree.links
    for name in names:
        target, dot, ending = name.rpartition(".")
        link = target if target in links else target.partition(":")[0]
        spot = ending in ("y", "z") and f"{target}.x" not in known  # which has reasons of its own to be lost
        if dot and ending in _OF_TARGETS and link not in links and not spot:
            return name, no_such("link", link, links)
        if dot and link in links and ending not in _OF_TARGETS and ending not in _OF_NOISE:
            return name, f"the ending '.{ending}' means nothing; expected one of {', '.join(f'.{own}' for own in _OF_TARGETS)}"
    return None


def figaroh_name(cell: str, target: str) -> str:
    """Our name of figaroh's column x1, phiz2 ...; the empty string for any other."""
    match = _FIGAROH.fullmatch(cell.strip())
    if match is None:
        return ""
    label = "" if match[2] == "1" else f":{match[2]}"
    return f"{target}{label}.{_FIGAROH_WORDS.get(match[1], match[1])}"


def written_columns(readings: Readings) -> list[tuple[str, list[str]]]:
    """Header and cells of some readings, SI."""
    name, how = readings.target, readings.kind
    if how.touches:
        columns = [(f"{name}.{ending}", [" ".join(str(label).split()) for label in readings.labels]) for ending in how.endings]
    else:
        columns = [(f"{name}.{ending}", cells(column)) for ending, column in how.written(readings.values).items()]
    if how.sigma_ending and any(math.isfinite(sigma) for sigma in readings.sigma.tolist()):
        columns.append((f"{name}.{how.sigma_ending}", cells(readings.sigma)))
    return columns


def cells(numbers: Iterable[float]) -> list[str]:
    """Numbers as cells, empty for nan."""
    return ["" if math.isnan(number) else f"{number:.12g}" for number in numbers]
