"""KRL: `{X .., Y .., Z .., A .., B .., C .., S .., T ..}` [mm], [deg] and `{A1 .., ..., A6 ..}` [deg], in .src and .dat files.

A placement is of $TOOL in $BASE: what stands as numbers before it in the text, `TOOL_DATA[n]` and `BASE_DATA[n]` by the numbers in the
point's FDAT, or what the user states. Of S and T, T says the signs of the axes: bit i - 1 is set where axis i is below zero.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from urdfcal.base.geometry import DEG, MM, Mask, Matrix
from urdfcal.deploy.orientations import KUKA_ANGLES
from urdfcal.deploy.programs.scan import Program, Token, number
from urdfcal.deploy.targets import Number, Target, TargetFile

COMMENT, QUOTES = ";|^&", '"'
_PLACED = {"X": MM, "Y": MM, "Z": MM, "A": DEG, "B": DEG, "C": DEG}
_RELATIVE = ("LIN_REL", "PTP_REL", "CIRC_REL", "SLIN_REL", "SPTP_REL")
_MOVES = ("PTP", "LIN", "CIRC", "SPTP", "SLIN", "SCIRC")
_ROOM = 2 * DEG  # by which an axis may be on the other side of zero


class _Aggregate(NamedTuple):
    """`{key value, ...}`, with what is given it."""

    at: Token
    name: str
    entries: dict[str, Token]


class _Reading:
    """The aggregates of a file in order, and the frames that hold."""

    def __init__(self, program: Program) -> None:
        self.program, self.tokens = program, program.tokens
        self.frames = {name.upper(): frame for name, frame in program.frames.items()}
        self.held: dict[str, str] = {}  # name of a frame that holds for $TOOL or $BASE
        self.said: list[str] = []

    def file(self) -> TargetFile:
        aggregates = [
            found for index, token in enumerate(self.tokens) if token.text == "{" and (found := self._aggregate(index)) is not None
        ]
        for each in aggregates:
            if (each.name.startswith(("$TOOL", "$BASE", "TOOL_DATA", "BASE_DATA"))) and set(_PLACED) <= set(each.entries):
                self.frames[each.name if "[" in each.name else f"{each.name}@{each.at.start}"] = self._frame(each)
        numbers = {each.name: each.entries for each in aggregates if {"TOOL_NO", "BASE_NO"} <= set(each.entries)}
        targets = []
        for each in aggregates:
            if each.name in ("$TOOL", "$BASE"):
                self.held[each.name] = f"{each.name}@{each.at.start}"
            elif not each.name.startswith(("TOOL_DATA", "BASE_DATA")) and each.name not in numbers:
                targets += self._target(each, numbers)
        return TargetFile(self.program.path, self.program.text, self.program.encoding, tuple(targets), tuple(self.said))

    def _aggregate(self, index: int) -> _Aggregate | None:
        """The aggregate that opens at a token, with those of its entries that are a word each; None without any."""
        entries: dict[str, Token] = {}
        for start, end in self.program.parts(index):
            start += 2 if end - start > 2 and self.tokens[start + 1].text == ":" else 0  # {E6POS: X ...}
            if end - start == 2 and self.tokens[start].kind == "name":
                entries[self.tokens[start].text.upper()] = self.tokens[start + 1]
        return _Aggregate(self.tokens[index], self._name(index), entries) if entries else None

    def _name(self, index: int) -> str:
        """What the aggregate is given to, `BASE_DATA[3]`; the move that it stands in, or the empty string."""
        before = [token.text.upper() for token in self.tokens[max(index - 5, 0) : index]]
        if before[-1:] == ["="]:
            return "".join(before[-5:-1]) if before[-2:-1] == ["]"] else before[-2]
        return next((word for word in before[::-1][:1] if word in (*_MOVES, *_RELATIVE)), "")

    def _frame(self, each: _Aggregate) -> Matrix:
        return KUKA_ANGLES.frame([number.value for number in self._numbers(each)])

    def _numbers(self, each: _Aggregate) -> tuple[Number, ...]:
        return tuple(self._number(each, key, unit) for key, unit in _PLACED.items())

    def _number(self, each: _Aggregate, key: str, unit: float) -> Number:
        token = each.entries[key]
        if token.kind != "number":
            raise self.program.fail(each.at, f"{key} is '{token.text}', which is worked out as the program runs; write it as a number")
        return number(token, unit)

    def _target(self, each: _Aggregate, numbers: dict[str, dict[str, Token]]) -> list[Target]:
        line = self.program.line(each.at.start)
        axes = {f"A{axis + 1}": DEG for axis in range(self.program.joints)}
        where = f"{self.program.path}:{line}"
        if each.name in _RELATIVE:
            self.said.append(f"{where}: {each.name} goes from a corrected target on by nominal geometry; write it out where that matters")
            return []
        if set(axes) <= set(each.entries):
            return [Target(line, tuple(self._number(each, key, unit) for key, unit in axes.items()))]
        if not set(_PLACED) & set(each.entries) and not set(axes) & set(each.entries):
            return []
        if not set(_PLACED) <= set(each.entries):
            if each.name in _MOVES:
                raise self.program.fail(each.at, f"{each.name} goes to a target that is not whole; write X, Y, Z, A, B, C or all axes")
            self.said.append(f"{where}: is not whole (X, Y, Z, A, B, C or all axes), and left as it stands")
            return []
        frames = {kind: self._held(each, kind, numbers) for kind in ("BASE", "TOOL")}
        turn = each.entries.get("T")
        fits = None if turn is None or turn.kind != "number" else _with_signs(int(float(turn.text)), self.program.joints)
        return [Target(line, self._numbers(each), KUKA_ANGLES, frames["BASE"], frames["TOOL"], fits=fits)]

    def _held(self, each: _Aggregate, kind: str, numbers: dict[str, dict[str, Token]]) -> Matrix:
        """The frame in which a target is told, or that it is told of."""
        own = numbers.get(f"F{each.name.removeprefix('X')}", {}).get(f"{kind}_NO")
        name = self.held.get(f"${kind}", "") if own is None else f"{kind}_DATA[{own.text}]"
        if own is not None and float(own.text) == 0 and name not in self.frames:
            return np.eye(4)
        if not name:
            return self.frames.get(f"${kind}", np.eye(4))
        if name not in self.frames:
            raise self.program.fail(each.at, f"is told with {name}, whose numbers do not stand in this file; --frame {name}=X,Y,Z,A,B,C")
        return self.frames[name]


def _with_signs(turn: int, joints: int) -> Callable[[Matrix], Mask]:
    """Whether the axes have the signs of T, or are hardly on the other side of zero."""
    below = np.array([bool(turn >> axis & 1) for axis in range(joints)])

    def fits(q: Matrix) -> Mask:
        return np.asarray(np.where(below, q < _ROOM, q > -_ROOM).all(axis=1))

    return fits


def read(program: Program) -> TargetFile:
    """Targets of a KRL file.

    Raises:
        InputError: a target is worked out as the program runs, is not whole, or told with a frame that is not known.
    """
    return _Reading(program).file()
