"""The languages that there are, by the endings of their files."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from urdfcal.base.errors import UsageError
from urdfcal.base.geometry import DEG, MM, Matrix
from urdfcal.deploy.orientations import FIXED_ANGLES, KUKA_ANGLES, QUATERNION_W_FIRST, ROTATION_VECTOR, Orientation
from urdfcal.deploy.programs import fanuc, krl, rapid, urscript
from urdfcal.deploy.programs.scan import Program, tokens_of
from urdfcal.deploy.targets import TargetFile, text_of
from urdfcal.robot.way import Way


class Language(NamedTuple):
    """A language: its name, what begins a comment, what strings stand between, how frames are stated and in which unit, and its reader."""

    name: str
    comment: str
    quotes: str
    frames: Orientation
    unit: float
    read: Callable[[Program], TargetFile]


_KRL = Language("KRL", krl.COMMENT, krl.QUOTES, KUKA_ANGLES, MM, krl.read)
_RAPID = Language("RAPID", rapid.COMMENT, rapid.QUOTES, QUATERNION_W_FIRST, MM, rapid.read)
_URSCRIPT = Language("URScript", urscript.COMMENT, urscript.QUOTES, ROTATION_VECTOR, 1.0, urscript.read)
LANGUAGES: Mapping[str, Language] = {
    ".script": _URSCRIPT,
    ".urscript": _URSCRIPT,
    ".mod": _RAPID,
    ".modx": _RAPID,
    ".prg": _RAPID,
    ".src": _KRL,
    ".dat": _KRL,
    ".ls": Language("Fanuc TP", fanuc.COMMENT, fanuc.QUOTES, FIXED_ANGLES, MM, fanuc.read),
}


def is_program(path: Path) -> bool:
    """Whether a file is called a program."""
    return path.suffix.lower() in LANGUAGES


def read_program(path: Path, way: Way, frames: Sequence[str] = ()) -> TargetFile:
    """Read the targets of a program.

    Args:
        path: The program; its ending says the language.
        way: The joints, and the link that tools are told on.
        frames: `NAME=X,Y,Z,...` in the language's own numbers: [mm], [deg]; URScript's [m], [rad].

    Raises:
        InputError: a target cannot be resolved; names its line and the way out.
        UsageError: a frame is not stated as the language has them.
    """
    language = LANGUAGES[path.suffix.lower()]
    text, encoding = text_of(path)
    stated = dict(_stated(each, language) for each in frames)
    found = language.read(Program(path, text, encoding, tokens_of(text, language.comment, language.quotes), len(way.names), stated))
    if not found.targets:
        points = path.with_suffix(".dat")
        hint = f"; its points stand in {points}" if language is _KRL and points != path and points.exists() else ""
        raise UsageError(f"{path}: has no targets that are numbers; expected a {language.name} program with some{hint}")
    return found


def _stated(text: str, language: Language) -> tuple[str, Matrix]:
    name, mark, numbers = text.partition("=")
    try:
        values = [float(word) for word in numbers.split(",")]
    except ValueError:
        values = []
    if not mark or len(values) != 3 + language.frames.count or not np.isfinite(values).all():
        units = "mm" if language.unit == MM else "m"
        raise UsageError(
            f"--frame {text}: expected NAME=X,Y,Z in {units} and {language.frames.name}{' in deg' if language.frames.turns else ''}, "
            f"{3 + language.frames.count} numbers"
        )
    if language.read is urscript.read and name.strip().lower() != "tcp":
        raise UsageError(f"--frame {text}: URScript programs name no frames; --frame tcp=X,Y,Z,RX,RY,RZ states the tool's point")
    turn = DEG if language.frames.turns else 1.0
    return name.strip(), language.frames.frame([value * language.unit for value in values[:3]] + [value * turn for value in values[3:]])
