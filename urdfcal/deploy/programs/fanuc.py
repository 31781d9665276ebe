"""Fanuc's TP programs as text (.ls): the positions `P[n]{ ... };`, X Y Z [mm], W P R [deg] about fixed axes, or J1 .. J6 [deg].

A placement is of the tool frame UT in the user frame UF, whose numbers stand in the controller: `--frame UF1=X,Y,Z,W,P,R`; frame 0 is the
robot's own. J1 to J6 are taken for the description's joints in order; that J3 is counted from the horizontal, `--j23` says. What the
letters of CONFIG mean for a robot is its maker's; where they change from one placement to the next, that is said.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from urdfcal.base.geometry import DEG, MM, Matrix
from urdfcal.deploy.orientations import FIXED_ANGLES
from urdfcal.deploy.programs.fanuc_motions import configuration, said_of_configurations, said_of_motions, steps_of
from urdfcal.deploy.programs.scan import Program, Token, number
from urdfcal.deploy.targets import Target, TargetFile

COMMENT, QUOTES = r"^\s*\d*:\s*!", "'\""
_PLACED = {"X": MM, "Y": MM, "Z": MM, "W": DEG, "P": DEG, "R": DEG}
_UNITS = {"mm": MM, "deg": DEG}


def read(program: Program) -> TargetFile:
    """Targets of a TP program.

    Raises:
        InputError: a position is told in a frame that is not stated, or has no numbers (`********`).
    """
    tokens, targets = program.tokens, list[Target]()
    configured: list[tuple[int, str, str]] = []
    begun = next(
        (index for index, token in enumerate(tokens) if token.text == "POS" and index and tokens[index - 1].text == "/"), len(tokens)
    )
    steps, index = steps_of(program, begun), begun
    while index < len(tokens):
        if tokens[index].text != "{":
            index += 1
            continue
        end = program.closing(index)
        if (name := _position(tokens, index)) not in steps:
            targets.append(_target(program, index, end))
            configured.append((targets[-1].line, name, configuration(program, index, end)))
        index = end
    said = (*said_of_motions(program, begun, steps), *said_of_configurations(program, configured))
    return TargetFile(program.path, program.text, program.encoding, tuple(targets), said)


def _position(tokens: Sequence[Token], index: int) -> str:
    """Which position a `{` opens: the number in `P[n]`, or `P[n:"..."]`."""
    at = next((at for at in range(index - 1, max(index - 6, -1), -1) if tokens[at].text == "["), None)
    return tokens[at + 1].text if at is not None and at + 1 < len(tokens) else ""


def _target(program: Program, begin: int, end: int) -> Target:
    at, line = program.tokens[begin], program.line(program.tokens[begin].start)
    found = _entries(program, begin, end)
    axes = {f"J{axis + 1}": DEG for axis in range(program.joints)}
    units = axes if "J1" in found else _PLACED
    for key, unit in units.items():
        if key not in found or found[key].kind != "number":
            raise program.fail(at, f"position has no number for {key}; expected {', '.join(units)}, as a taught position has")
        _require_unit(program, found[key], unit)
    numbers = tuple(number(found[key], unit) for key, unit in units.items())
    if units is axes:
        return Target(line, numbers)
    frames = {name: _frame(program, at, name, found) for name in ("UF", "UT")}
    return Target(line, numbers, FIXED_ANGLES, frames["UF"], frames["UT"])


def _entries(program: Program, begin: int, end: int) -> Mapping[str, Token]:
    """Values of `key = value` and `key : value`."""
    found = {}
    for index in range(begin, end - 2):
        key, mark, value = program.tokens[index : index + 3]
        if key.kind == "name" and mark.text in ("=", ":"):
            found[key.text.upper()] = value
    return found


def _require_unit(program: Program, token: Token, unit: float) -> None:
    behind = program.text[token.end :].split(maxsplit=1)
    word = behind[0].strip(",;}").lower() if behind else ""
    if word in _UNITS and _UNITS[word] != unit:
        raise program.fail(token, f"{token.text} is in {word}, where {'mm' if unit == MM else 'deg'} are expected")


def _frame(program: Program, at: Token, name: str, found: Mapping[str, Token]) -> Matrix:
    own = found.get(name)
    index = own.text if own is not None and own.kind == "number" else "F" if own is not None else "0"
    frame = next((frame for stated, frame in program.frames.items() if stated.upper() == f"{name}{index}"), None)
    if frame is None and index != "0":
        raise program.fail(at, f"is told with {name} {index}, whose numbers stand in the controller; --frame {name}{index}=X,Y,Z,W,P,R")
    return np.eye(4) if frame is None else frame
