"""Targets as a table: joints by name, or x, y, z and an orientation, and both where the joints say in which configuration."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from urdfcal.base.errors import UsageError
from urdfcal.base.geometry import DEG, MM, Vector
from urdfcal.base.tables import ANGLES, LENGTHS, Table, read_table
from urdfcal.deploy.orientations import FIXED_ANGLES, KUKA_ANGLES, QUATERNION, ROTATION_VECTOR, Orientation
from urdfcal.deploy.targets import Number, Target, TargetFile, text_of
from urdfcal.robot.way import Way

_DEGREES = {"deg": DEG, "rad": 1.0}
_NONE = {"": 1.0}
_ORIENTATIONS: dict[tuple[str, ...], tuple[Orientation, Mapping[str, float]]] = {
    ("qx", "qy", "qz", "qw"): (QUATERNION, _NONE),
    ("roll", "pitch", "yaw"): (FIXED_ANGLES, ANGLES),
    ("rx", "ry", "rz"): (ROTATION_VECTOR, ANGLES),
    ("A", "B", "C"): (KUKA_ANGLES, _DEGREES),
}
_PLACE = ("x", "y", "z")
_LINES = re.compile(r"\r\n|\n|\r")
_WHAT = "the joints, or x, y, z and qx, qy, qz, qw; roll, pitch, yaw; rx, ry, rz; or A, B, C"


def read_targets(path: Path, way: Way) -> TargetFile:
    """Read a table of targets.

    Args:
        path: CSV. Columns named after the joints [rad], [m]; or `x, y, z` [m] with `qx, qy, qz, qw`, `roll, pitch, yaw` [rad], `rx, ry, rz`
            [rad] or `A, B, C` [deg]; other units by the header. Others are kept.
        way: The joints, and the link that placements are of.

    Raises:
        MeasurementError: naming line and column.
        UsageError: the file is a workbook.
    """
    table = read_table(path, _WHAT, "one row a target")
    if path.suffix.lower() in (".xlsx", ".xls"):
        raise UsageError(f"{path}: is a workbook, whose other bytes cannot be kept; save it as CSV")
    text, encoding = text_of(path)
    placed = _placement_columns(table)
    units: dict[str, Mapping[str, float]] = {}
    jointed = [name for name in way.names if name in table.names]
    if jointed and len(jointed) < len(way.names):
        missing = next(name for name in way.names if name not in table.names)
        raise table.fail(None, missing, f"is missing; expected a column for each of {', '.join(way.names)}")
    if not jointed and placed is None:
        raise table.fail(None, way.names[0], f"is missing, and so are x, y, z; expected {_WHAT}")
    for joint in way.inputs if jointed else ():
        units[joint.name] = LENGTHS if joint.prismatic else ANGLES
    if placed is not None:
        units |= dict.fromkeys(_PLACE, LENGTHS) | dict.fromkeys(placed, _ORIENTATIONS[placed][1])
    values = {name: table.numbers(name, own, most=1e6) for name, own in units.items()}
    factors = {name: own.get(table.units.get(name, next(iter(own))), 1.0) for name, own in units.items()}
    spans = list(_spans(table, text))
    comma = table.separator != "," and any("," in text[slice(*row[name])] for row in spans for name in units)

    def numbers(row: int, names: tuple[str, ...]) -> tuple[Number, ...]:
        return tuple(Number(*spans[row][name], factors[name], float(values[name][row]), comma) for name in names)

    targets = []
    for row, (line, _) in enumerate(table.body):
        positions = numbers(row, way.names) if jointed else ()
        near = np.array([number.value for number in positions]) if jointed else None
        if placed is None:
            targets.append(Target(line, positions))
        else:
            targets.append(
                _placed(table, row, Target(line, numbers(row, (*_PLACE, *placed)), _ORIENTATIONS[placed][0], near=near), placed[0])
            )
    return TargetFile(path, text, encoding, tuple(targets))


def _placement_columns(table: Table) -> tuple[str, ...] | None:
    """Names of the orientation's columns, where the table has placements."""
    if not set(_PLACE) & set(table.names):
        return None
    for name in _PLACE:
        table.require(name, "x, y and z")
    whole = [names for names in _ORIENTATIONS if set(names) <= set(table.names)]
    if len(whole) != 1:
        raise table.fail(None, "x", f"{'more than one' if whole else 'no'} orientation stands beside x, y, z; expected {_WHAT}")
    return whole[0]


def _placed(table: Table, row: int, target: Target, column: str) -> Target:
    assert target.orientation is not None
    if not np.isfinite(target.orientation.quaternions(target.values[None, 3:])).all():
        raise table.fail(row, column, "the quaternion has not the length 1; expected x, y, z, w")
    return target


def _spans(table: Table, text: str) -> Iterator[dict[str, tuple[int, int]]]:
    """Where the numbers of each row stand in the text, by column."""
    starts = [0, *(match.end() for match in _LINES.finditer(text))]
    places = table.positions or range(len(table.names))
    for line, row in table.body:
        cells = list(_cells(row, table.separator))
        yield {
            name: (starts[line - 1] + start, starts[line - 1] + end)
            for name, (start, end) in zip(table.names, (cells[place] for place in places), strict=True)
        }


def _cells(row: str, separator: str) -> Iterator[tuple[int, int]]:
    """Where the content of each cell begins and ends, without blanks and quotes."""
    cell = r"\S+" if separator == " " else rf'"(?:[^"]|"")*"|[^{re.escape(separator)}]*'
    at = 0
    for match in re.finditer(cell, row):
        if separator != " " and match.start() < at:
            continue
        content = match.group().strip().strip('"').strip()
        start = match.start() + match.group().find(content)
        yield start, start + len(content)
        at = match.end() + 1


def near_from(text: str, way: Way) -> Vector:
    """Positions as `--near` states them: `0,-90,90,0,0,0`, deg and mm.

    Raises:
        UsageError: they are not as many numbers as there are joints.
    """
    words = re.split(r"[,\s]+", text.strip())
    try:
        numbers = [float(word) for word in words]
    except ValueError:
        numbers = []
    if len(numbers) != len(way.names) or not np.isfinite(numbers).all():
        raise UsageError(f"--near {text}: expected {len(way.names)} numbers, in deg (mm where a joint slides): {', '.join(way.names)}")
    return np.array(numbers) * [MM if joint.prismatic else DEG for joint in way.inputs]
