"""URScript: `movej`, `movel`, `movep`, `movec` to poses `p[x, y, z, rx, ry, rz]` [m], [rad] and joints `[q1, ..., q6]` [rad].

A target may stand in the call or be given a name before it. A pose is of the point that `set_tcp(p[...])` names, in the robot's own base.
"""

from __future__ import annotations

import numpy as np

from urdfcal.base.geometry import DEG, Matrix
from urdfcal.deploy.orientations import ROTATION_VECTOR
from urdfcal.deploy.programs.scan import Program, Token, number
from urdfcal.deploy.targets import Number, Target, TargetFile

COMMENT, QUOTES = "#", "\"'"
_MOVES = {"movej": 1, "movel": 1, "movep": 1, "movec": 2, "servoj": 1}
_WAY_OUT = "write the target as numbers, p[x, y, z, rx, ry, rz] or [q1, ...], in the call or under a name"


class _Reading:
    """What is known at a place of the program: named targets, and the tool's point."""

    def __init__(self, program: Program) -> None:
        self.program, self.tokens = program, program.tokens
        self.tcp: Matrix | None = np.eye(4)
        self.named: dict[str, list[int]] = {}  # where the values begin that a name is given
        self.found: dict[int, Target] = {}  # by where they begin

    def file(self) -> TargetFile:
        for index, token in enumerate(self.tokens):
            if self._is(index + 1, "="):
                self.named.setdefault(token.text, []).append(index + 2)
        for index, token in enumerate(self.tokens):
            if token.kind == "name" and self._is(index + 1, "("):
                self._call(index)
        targets = tuple(self.found[begin] for begin in sorted(self.found))
        return TargetFile(self.program.path, self.program.text, self.program.encoding, targets)

    def _is(self, index: int, text: str) -> bool:
        return index < len(self.tokens) and self.tokens[index].text == text

    def _call(self, index: int) -> None:
        token, parts = self.tokens[index], self.program.parts(index + 1)
        if token.text == "set_tcp":
            numbers = self._pose(parts[0][0]) if parts else None
            self.tcp = None if numbers is None else ROTATION_VECTOR.frame([each.value for each in numbers])
        for start, _ in parts[: _MOVES.get(token.text, 0)]:
            self._target(start, token)

    def _target(self, at: int, move: Token) -> None:
        """The target that begins at a token; a name stands for every value that it is given."""
        token = self.tokens[at]
        if token.kind == "name" and token.text in self.named:
            for value in self.named[token.text]:
                self._value(value, move, self.tokens[value])
            return
        if token.text == "get_inverse_kin":
            self._value(self.program.parts(at + 1)[0][0], move, token)
            return
        self._value(at, move, token)

    def _value(self, at: int, move: Token, said: Token) -> None:
        pose, joints = self._pose(at), self._joints(at)
        if pose is None and joints is None:
            raise self.program.fail(said, f"{move.text} goes to '{said.text} ...', which is worked out as the program runs; {_WAY_OUT}")
        if joints is not None:
            self.found[at] = Target(self.program.line(self.tokens[at].start), joints)
            return
        if self.tcp is None:
            raise self.program.fail(said, "the point that set_tcp names is worked out as the program runs; write it as p[...]")
        target = Target(self.program.line(self.tokens[at].start), pose or (), ROTATION_VECTOR, T_flange_tcp=self.tcp)
        before = self.found.get(at)
        if before is not None and not np.allclose(before.T_flange_tcp, self.tcp):
            raise self.program.fail(self.tokens[at], "is gone to with two tools (set_tcp); give each a target of its own")
        self.found[at] = target

    def _pose(self, at: int) -> tuple[Number, ...] | None:
        if not (self._is(at, "p") and self._is(at + 1, "[")):
            return None
        return self._list(at + 1, 6)

    def _joints(self, at: int) -> tuple[Number, ...] | None:
        return self._list(at, self.program.joints) if self._is(at, "[") else None

    def _list(self, at: int, count: int) -> tuple[Number, ...] | None:
        parts = self.program.parts(at)
        found = [self._number(start, end) for start, end in parts]
        return tuple(each for each in found if each is not None) if len(parts) == count and None not in found else None

    def _number(self, start: int, end: int) -> Number | None:
        """A number, or `d2r(number)`."""
        token = self.tokens[start]
        if end - start == 1 and token.kind == "number":
            return number(token, 1.0)
        if token.text == "d2r" and end - start == 4 and self.tokens[start + 2].kind == "number":
            return number(self.tokens[start + 2], DEG)
        return None


def read(program: Program) -> TargetFile:
    """Targets of a URScript program.

    Raises:
        InputError: a target is worked out as the program runs.
    """
    return _Reading(program).file()
