"""Columns of instruments beside lasers: what the header's names mean, and what is written back."""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from urdfcal.base.errors import no_such
from urdfcal.robot.robot import Robot
from urdfcal.sensors.readings import STORED, Readings

QUATERNION = ("qx", "qy", "qz", "qw")
ROLL_PITCH_YAW = ("roll", "pitch", "yaw")
LENGTH_WORDS = ("x", "y", "z", "distance")
ANGLE_WORDS = ROLL_PITCH_YAW
_KINDS = {
    **dict.fromkeys("xyz", "point"),
    **dict.fromkeys((*QUATERNION, *ROLL_PITCH_YAW), "orientation"),
    "distance": "distance",
    "plane": "plane",
    "socket": "socket",
    "sigma": "sigma",
    "u": "pixel",
    "v": "pixel",
    "sigma_px": "sigma_px",
}
_PIXELS = ("u", "v", "sigma_px")
_FIGAROH = re.compile(r"(x|y|z|phix|phiy|phiz)(\d+)")
_FIGAROH_WORDS = {"phix": "roll", "phiy": "pitch", "phiz": "yaw"}


@dataclass(frozen=True)
class TargetColumn:
    """A column of a target.

    Attributes:
        name: As in the header, without its unit.
        target: The target's name.
        link: The link that it is on.
        what: The name's ending.
        kind: What is read, or `sigma`, or `sigma_px`.
    """

    name: str
    target: str
    link: str
    what: str
    kind: str


def target_columns(names: Iterable[str], robot: Robot, lasers: Sequence[str]) -> tuple[TargetColumn, ...]:
    """The columns that mean a target on a link of this robot; of lasers, only their pixels are among them."""
    found = []
    for name in names:
        target, dot, what = name.rpartition(".")
        link = target if target in robot.tree.links else target.rpartition(":")[0]
        if dot and what in _KINDS and link in robot.tree.links and (target not in lasers or what in _PIXELS):
            found.append(TargetColumn(name, target, link, what, _KINDS[what]))
    read = {column.target for column in found if not column.kind.startswith("sigma")}
    return tuple(column for column in found if column.target in read)


def refusal(columns: Sequence[TargetColumn], units: Mapping[str, str]) -> tuple[str, str] | None:
    """The first column of a target that cannot be taken as it is, and why: a unit that means nothing, half a name, two orientations."""
    turned: dict[str, TargetColumn] = {}
    for column in columns:
        if column.target.endswith(":"):
            return column.name, f"the label behind '{column.target}' is empty; expected {column.link}.{column.what}, or a label"
        if column.kind in ("plane", "socket") and column.name in units:
            return column.name, f"the unit '{units[column.name]}' of a label means nothing; expected '{column.name}' alone"
        first = turned.setdefault(column.target, column) if column.kind == "orientation" else column
        if column.kind == "orientation" and (first.what in QUATERNION) != (column.what in QUATERNION):
            return column.name, f"the orientation is in '{first.name}', too; leave one of the two out"
    return None


def lost_column(names: Collection[str], robot: Robot) -> tuple[str, str] | None:
    """Where a header means nothing at all: the first column that looks like a target's, and what is wrong with its link or its ending."""
    known, links, kinds = set(names), robot.tree.links, [kind for kind in _KINDS if not kind.startswith("sigma")]
    for name in names:
        target, dot, what = name.rpartition(".")
        link = target if target in links else target.partition(":")[0]
        spot = what in ("y", "z") and f"{target}.x" not in known  # which has reasons of its own to be lost
        if dot and what in kinds and link not in links and not spot:
            return name, no_such("link", link, links)
        if dot and link in links and what not in _KINDS:
            return name, f"the ending '.{what}' means nothing; expected one of {', '.join(f'.{kind}' for kind in kinds)}"
    return None


def blank_readings(column: TargetColumn, target: str, kind: str) -> Readings:
    """Readings of no pose, to tell which links matter before any row is read."""
    known = kind if kind in STORED else "point"
    return Readings(known, target, column.link, np.empty((0, STORED[known])), np.empty(0, dtype=str), np.empty(0))


def figaroh_name(cell: str, target: str) -> str:
    """Our name of figaroh's column x1, phiz2 ...; the empty string for any other."""
    match = _FIGAROH.fullmatch(cell.strip())
    if match is None:
        return ""
    label = "" if match[2] == "1" else f":{match[2]}"
    return f"{target}{label}.{_FIGAROH_WORDS.get(match[1], match[1])}"


def written_columns(readings: Readings) -> list[tuple[str, list[str]]]:
    """Header and cells of some readings, SI."""
    name, columns = readings.target, []
    if readings.kind in ("plane", "socket"):
        columns.append((f"{name}.{readings.kind}", [" ".join(str(label).split()) for label in readings.labels]))
    else:
        words = {"point": ("x", "y", "z"), "orientation": QUATERNION, "distance": ("distance",), "pixel": ("u", "v")}[readings.kind]
        read = [(word, column) for word, column in zip(words, readings.values.T, strict=True) if not np.isnan(column).all()]
        columns += [(f"{name}.{word}", _cells(column)) for word, column in read]
    if not np.isnan(readings.sigma).all():
        columns.append((f"{name}.{'sigma_px' if readings.kind == 'pixel' else 'sigma'}", _cells(readings.sigma)))
    return columns


def _cells(numbers: Iterable[float]) -> list[str]:
    return ["" if math.isnan(number) else f"{number:.12g}" for number in numbers]
