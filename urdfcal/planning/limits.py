"""Narrower limits of joints, from a file: what the cell, its cables or its owner leave of those that the robot has.

A YAML names the unit above the joints, a CSV has it beside each:

    deg: {shoulder_pan_joint: [-90, 90]}     # or rad
    mm: {rail: [0, 800]}                     # or m, of joints that slide

    joint,lower,upper,unit
    shoulder_pan_joint,-90,90,deg
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from urdfcal.base.errors import RigError, no_such
from urdfcal.base.files import read_yaml
from urdfcal.base.geometry import DEG, MM, Matrix
from urdfcal.base.tables import read_table
from urdfcal.calibration.rig_file import in_words
from urdfcal.robot.configurations import joint_limits
from urdfcal.robot.robot import Robot

_UNITS = {"deg": DEG, "rad": 1.0, "mm": MM, "m": 1.0}
_SLIDES = ("mm", "m")
_Number = Annotated[float, Field(ge=-1e6, le=1e6, allow_inf_nan=False)]
_Two = tuple[_Number, _Number]


class LimitsFile(BaseModel):
    """The whole file; every entry may be missing."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    deg: dict[str, _Two] = {}
    rad: dict[str, _Two] = {}
    mm: dict[str, _Two] = {}
    m: dict[str, _Two] = {}


@dataclass(frozen=True)
class _Stated:
    """What is said of one joint: its name, unit and limits in that, and the line."""

    joint: str
    unit: str
    lower: float
    upper: float
    line: int | None


def read_limits(path: str | Path, robot: Robot) -> Matrix:
    """Lower and upper limits of the measured joints, (2, inputs), [rad] or [m]: those of the robot, narrowed by a file.

    Raises:
        InputError: the file cannot be read or names no such joint, a unit that the joint does not have, or limits that leave no room.
    """
    path, names = Path(path), robot.chain.input_names
    limits, said = joint_limits(robot), set()
    for own in _stated(path):
        if own.joint not in names:
            raise RigError(no_such("measured joint", own.joint, names), path, own.line)
        if own.joint in said:
            raise RigError(f"joint '{own.joint}' stands twice", path, own.line)
        said.add(own.joint)
        column = names.index(own.joint)
        _require_unit(own, robot.chain.inputs[column].prismatic, path)
        lower, upper = own.lower * _UNITS[own.unit], own.upper * _UNITS[own.unit]
        if robot.chain.inputs[column].type != "continuous":
            lower, upper = max(lower, limits[0, column]), min(upper, limits[1, column])
        if not upper > lower:
            has = f"{limits[0, column] / _UNITS[own.unit]:g} to {limits[1, column] / _UNITS[own.unit]:g} {own.unit}"
            raise RigError(
                f"joint '{own.joint}': {own.lower:g} to {own.upper:g} {own.unit} leaves no room in the robot's own limits, {has}",
                path,
                own.line,
            )
        limits[:, column] = lower, upper
    return limits


def _require_unit(own: _Stated, slides: bool, path: Path) -> None:
    if own.unit not in _UNITS:
        raise RigError(f"joint '{own.joint}': found unit '{own.unit}', expected {', '.join(_UNITS)}", path, own.line)
    if (own.unit in _SLIDES) != slides:
        expected = "mm or m" if slides else "deg or rad"
        raise RigError(f"joint '{own.joint}' {'slides' if slides else 'turns'}: found {own.unit}, expected {expected}", path, own.line)


def _stated(path: Path) -> Iterator[_Stated]:
    return _in_table(path) if path.suffix.lower() in (".csv", ".tsv", ".txt") else _in_yaml(path)


def _in_yaml(path: Path) -> Iterator[_Stated]:
    file = read_yaml(path, RigError)
    if not isinstance(file.content, dict):
        raise RigError(f"holds a {type(file.content).__name__}, expected entries such as `deg: {{joint1: [-90, 90]}}`", path, file.line())
    try:
        stated = LimitsFile.model_validate(file.content)
    except ValidationError as error:
        found = error.errors()[0]
        raise RigError(in_words(found, lambda steps: list(_UNITS)), path, file.line(found["loc"])) from None
    for unit in _UNITS:
        for joint, (lower, upper) in getattr(stated, unit).items():
            yield _Stated(joint, unit, lower, upper, file.line((unit, joint)))


def _in_table(path: Path) -> Iterator[_Stated]:
    table = read_table(path, "joint,lower,upper,unit", "one row a joint")
    for column in ("joint", "lower", "upper", "unit"):
        table.require(column, "joint, lower, upper and unit")
    lower, upper = (table.numbers(column, {"": 1.0}) for column in ("lower", "upper"))
    for row, line in enumerate(table.lines):
        columns = table.columns
        yield _Stated(columns["joint"][row], columns["unit"][row].strip(), float(lower[row]), float(upper[row]), line)
