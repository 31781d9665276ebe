"""URScript: `movej`, `movel`, `movep`, `movec` to poses `p[x, y, z, rx, ry, rz]` [m], [rad] and joints `[q1, ..., q6]` [rad].

A target may stand in the call or be given a name before it. A pose is of the point that `set_tcp(p[...])` names, else of that which the
user states as `--frame tcp=X,Y,Z,RX,RY,RZ`, in the robot's own base.
"""

from __future__ import annotations

import numpy as np

from urdfcal.base.geometry import DEG, Matrix
from urdfcal.base.terminal import many
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
        self.tcp: Matrix | None = next((frame for name, frame in program.frames.items() if name.lower() == "tcp"), None)
        self.known = self.tcp is not None
        self.tcp = np.eye(4) if self.tcp is None else self.tcp
        self.untold: list[int] = []  # lines of poses of which nothing says what point they are of
        self.changed: dict[str, int] = {}  # names of which a part is given something else, and where
        self.gone: set[str] = set()  # names that a move goes to
        self.said: list[str] = []
        self.named: dict[str, list[int]] = {}  # where the values begin that a name is given
        self.found: dict[int, Target] = {}  # by where they begin

    def file(self) -> TargetFile:
        depth = 0  # of calls, whose `a=1.4` names an argument
        for index, token in enumerate(self.tokens):
            depth += (token.text == "(") - (token.text == ")")
            if self._is(index + 1, "=") and depth == 0:
                self.named.setdefault(token.text, []).append(index + 2)
        for index, token in enumerate(self.tokens):
            if token.kind == "name" and self._is(index + 1, "("):
                self._call(index)
            elif token.text in self.named and self._is(index + 1, "[") and self._is(self.program.closing(index + 1) + 1, "="):
                line = self.program.line(token.start)
                self.changed.setdefault(token.text, line)
        self._say()
        targets = tuple(self.found[begin] for begin in sorted(self.found))
        return TargetFile(self.program.path, self.program.text, self.program.encoding, targets, tuple(self.said))

    def _say(self) -> None:
        """What a user has to know of what was taken for granted."""
        for name, line in self.changed.items():
            if name in self.gone:
                self.said.append(
                    f"{self.program.path}:{line}: {name} is changed as the program runs, and goes from a corrected target on by nominal "
                    "geometry; write the target out where that matters"
                )
        if self.untold:
            more = f" (and {many(len(self.untold) - 1, 'more pose')})" if len(self.untold) > 1 else ""
            self.said.append(
                f"{self.program.path}:{self.untold[0]}{more}: no set_tcp stands before it, and the flange is taken for the point that the "
                "pose is of; --frame tcp=X,Y,Z,RX,RY,RZ states another, in m and rad"
            )

    def _is(self, index: int, text: str) -> bool:
        return index < len(self.tokens) and self.tokens[index].text == text

    def _call(self, index: int) -> None:
        token = self.tokens[index]
        parts = [(self._behind_name(start), end) for start, end in self.program.parts(index + 1)]
        if token.text == "set_tcp":
            numbers = self._pose(parts[0][0]) if parts else None
            self.tcp, self.known = None if numbers is None else ROTATION_VECTOR.frame([each.value for each in numbers]), True
        for start, _ in parts[: _MOVES.get(token.text, 0)]:
            self._target(start, token)

    def _behind_name(self, at: int) -> int:
        """Where an argument's value begins: behind `q=` in `q=[...]`."""
        return at + 2 if self.tokens[at].kind == "name" and self._is(at + 1, "=") else at

    def _target(self, at: int, move: Token) -> None:
        """The target that begins at a token; a name stands for every value that it is given."""
        token = self.tokens[at]
        if token.kind == "name" and token.text in self.named:
            self.gone.add(token.text)
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
        line = self.program.line(self.tokens[at].start)
        if not self.known and line not in self.untold:
            self.untold.append(line)
        target = Target(line, pose or (), ROTATION_VECTOR, T_flange_tcp=self.tcp)
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
