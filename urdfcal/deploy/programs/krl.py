"""KRL: `{X .., Y .., Z .., A .., B .., C .., S .., T ..}` [mm], [deg] and `{A1 .., ..., A6 ..}` [deg], in .src and .dat files.

A placement is of $TOOL in $BASE: what they are given before it in the text (numbers, a FRAME of the file, `TOOL_DATA[n]`, `BASE_DATA[n]`,
`BAS(#TOOL, n)`), those of the numbers in the point's FDAT, or what the user states. Of S and T, T says the signs of the axes: bit i - 1
is set where axis i is below zero.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from urdfcal.base.geometry import DEG, MM, Mask, Matrix
from urdfcal.base.terminal import many
from urdfcal.deploy.orientations import KUKA_ANGLES
from urdfcal.deploy.programs.scan import Program, Token, number
from urdfcal.deploy.targets import Number, Target, TargetFile

COMMENT, QUOTES = ";|^&", '"'
_PLACED = {"X": MM, "Y": MM, "Z": MM, "A": DEG, "B": DEG, "C": DEG}
_RELATIVE = ("LIN_REL", "PTP_REL", "CIRC_REL", "SLIN_REL", "SPTP_REL")
_MOVES = ("PTP", "LIN", "CIRC", "SPTP", "SLIN", "SCIRC")
_ROOM = 2 * DEG  # by which an axis may be on the other side of zero
_HELD = ("$TOOL", "$BASE")
_NULL = ("$NULLFRAME", "$WORLD")


class _Aggregate(NamedTuple):
    """`{key value, ...}`, with what is given it, as what type, and whether it stands on either side of a `:`."""

    at: Token
    name: str
    entries: dict[str, Token]
    type: str
    offset: bool
    chained: bool

    @property
    def place(self) -> str:
        """A name of its own for what $TOOL and $BASE are given."""
        return f"{self.name}@{self.at.start}"


class _Reading:
    """The aggregates of a file in order, and the frames that hold."""

    def __init__(self, program: Program) -> None:
        self.program, self.tokens = program, program.tokens
        self.frames = dict.fromkeys(_NULL, np.eye(4)) | {name.upper(): frame for name, frame in program.frames.items()}
        self.held: dict[str, str] = {}  # name of a frame that holds for $TOOL or $BASE
        self.known: set[str] = set()  # frames whose numbers stand in the file
        self.twice: set[str] = set()  # and those that have other numbers later on
        self.said: list[str] = []
        self.untold: dict[str, list[int]] = {}  # lines of placements for which $TOOL or $BASE was given nothing

    def file(self) -> TargetFile:
        aggregates = [
            found for index, token in enumerate(self.tokens) if token.text == "{" and (found := self._aggregate(index)) is not None
        ]
        given = self._given()
        held = {name for _, _, name in given}
        for each in aggregates:
            if self._is_frame(each, held) and set(_PLACED) <= set(each.entries):
                self._keep(each.place if each.name in _HELD else each.name, self._frame(each))
        numbers = {each.name: each.entries for each in aggregates if {"TOOL_NO", "BASE_NO"} <= set(each.entries)}
        targets = []
        for each in aggregates:
            self.held |= {kind: name for start, kind, name in given if start < each.at.start}
            if not self._is_frame(each, held) and each.name not in numbers:
                targets += self._target(each, numbers)
        self._say_untold()
        return TargetFile(self.program.path, self.program.text, self.program.encoding, tuple(targets), tuple(self.said))

    def _keep(self, name: str, frame: Matrix) -> None:
        if name in self.known and not np.allclose(self.frames[name], frame, atol=1e-9):
            self.twice.add(name)
        self.known.add(name)
        self.frames[name] = frame

    def _given(self) -> list[tuple[int, str, str]]:
        """Where $TOOL and $BASE are given a frame, and its name."""
        found = []
        for index, token in enumerate(self.tokens):
            words = [each.text.upper() for each in self.tokens[index : index + 6]]
            if words[0] in _HELD and words[1:2] == ["="]:
                found.append((token.start, words[0], self._assigned(index + 2, words[0])))
            elif words[:3] == ["BAS", "(", "#"] and f"${words[3]}" in _HELD and words[4:5] == [","]:
                name = "$NULLFRAME" if words[5] == "0" else f"{words[3]}_DATA[{words[5]}]"
                found.append((token.start, f"${words[3]}", name))
        return found

    def _assigned(self, index: int, kind: str) -> str:
        """The name of what stands behind a `=` up to the end of its line."""
        if index >= len(self.tokens):
            return ""
        begin = self.tokens[index]
        end = self.program.closing(index) if begin.text == "{" else index
        line = self.program.line(self.tokens[end].start)
        while end + 1 < len(self.tokens) and self.program.line(self.tokens[end + 1].start) == line:
            end += 1
        alone = begin.text == "{" and self.program.closing(index) == end
        return f"{kind}@{begin.start}" if alone else "".join(token.text.upper() for token in self.tokens[index : end + 1])

    @staticmethod
    def _is_frame(each: _Aggregate, held: set[str]) -> bool:
        """Whether it is a frame to tell targets in, and no target."""
        return each.name.startswith((*_HELD, "TOOL_DATA", "BASE_DATA")) or each.type == "FRAME" or bool(each.name and each.name in held)

    def _say_untold(self) -> None:
        for kind, lines in self.untold.items():
            whose = "flange" if kind == "$TOOL" else "robot's own base"
            more = f" (and {many(len(lines) - 1, 'more placement')})" if len(lines) > 1 else ""
            self.said.append(
                f"{self.program.path}:{lines[0]}{more}: this file gives {kind} nothing before it, and the {whose} is taken; "
                f"--frame '{kind}=X,Y,Z,A,B,C' states another"
            )

    def _aggregate(self, index: int) -> _Aggregate | None:
        """The aggregate that opens at a token, with those of its entries that are a word each; None without any."""
        entries: dict[str, Token] = {}
        name, type_ = self._name(index), self._type(index)
        for start, end in self.program.parts(index):
            if end - start > 2 and self.tokens[start + 1].text == ":":  # {E6POS: X ...}
                type_ = self.tokens[start].text.upper()
                start += 2
            if end - start == 2 and self.tokens[start].kind == "name":
                entries[self.tokens[start].text.upper()] = self.tokens[start + 1]
        behind = self.program.closing(index) + 1
        chained = behind < len(self.tokens) and self.tokens[behind].text == ":"
        return _Aggregate(self.tokens[index], name, entries, type_, self._before(index, 1) == ":", chained) if entries else None

    def _before(self, index: int, by: int) -> str:
        return self.tokens[index - by].text.upper() if index >= by else ""

    def _type(self, index: int) -> str:
        """The type that is declared with what an aggregate is given to."""
        if self._before(index, 1) != "=":
            return ""
        return self._before(index, 6) if self._before(index, 2) == "]" else self._before(index, 3)

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
        if each.name in _RELATIVE or each.offset:
            what = each.name if each.name in _RELATIVE else "':{...}'"
            self.said.append(f"{where}: {what} goes from a corrected target on by nominal geometry; write it out where that matters")
            return []
        if each.name.startswith("$"):
            self.said.append(f"{where}: {each.name} is the controller's own, and left as it stands")
            return []
        if each.chained and set(_PLACED) <= set(each.entries):
            raise self.program.fail(each.at, "is told with ':', which is worked out as the program runs; write the target out")
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
            if f"${kind}" not in self.frames:
                self.untold.setdefault(f"${kind}", []).append(self.program.line(each.at.start))
            return self.frames.get(f"${kind}", np.eye(4))
        if ":" in name or name in self.twice:
            why = "is given numbers twice" if name in self.twice else "is worked out as the program runs"
            raise self.program.fail(each.at, f"is told with {name}, which {why}; give it numbers of its own, in a file of its own")
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
