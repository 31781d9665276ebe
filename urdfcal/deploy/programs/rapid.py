r"""RAPID: `robtarget` and `jointtarget`, declared or written into the move, [mm] and [deg]; quaternions with w first.

A robtarget is of the tool's frame in the work object's, which the moves to it name: `\WObj:=name` and the tool, `tooldata` and `wobjdata`
with numbers in the same file, or stated by the user. Targets may stand in arrays, and be given to a name later on. Of its
confdata cf1, cf4 and cf6 are quadrants, floor(angle / 90 deg), of the axes 1, 4 and 6.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from urdfcal.base.geometry import DEG, MM, Mask, Matrix
from urdfcal.deploy.orientations import QUATERNION_W_FIRST
from urdfcal.deploy.programs.scan import Program
from urdfcal.deploy.targets import Number, Target, TargetFile

COMMENT, QUOTES = "!", '"'
_PLACE, _QUATERNION = (MM,) * 3, (1.0,) * 4
_OFFSET = ("offs", "reltool")
_MOVES = ("move", "trigg", "search", "arc", "spot", "paint", "disp")  # what the names of instructions that move begin with
_LEAST = 4  # arguments: where to, speed, zone and tool
_TARGETS = ("robtarget", "jointtarget")
_QUADRANT = 90 * DEG
_ROOM = 5 * DEG  # by which an axis may be over the border of its quadrant


class _Reading:
    """The declarations of a module, and with which tool and work object its moves go where."""

    def __init__(self, program: Program) -> None:
        self.program, self.tokens = program, program.tokens
        self.frames: dict[str, Matrix] = {"tool0": np.eye(4), "wobj0": np.eye(4)} | {
            name.lower(): frame for name, frame in program.frames.items()
        }
        self.named: dict[str, list[int]] = {}  # where the values begin that a target is given
        self.worked_out: set[str] = set()  # targets that are given what is no list of numbers
        self.joint_targets: set[int] = set()  # where values of a jointtarget begin
        self.used: dict[int, tuple[str, str]] = {}  # tool and work object by where a target begins
        self.said: list[str] = []

    def file(self) -> TargetFile:
        self._declarations()
        for index, token in enumerate(self.tokens):
            if token.kind == "name" and token.text.lower().startswith(_MOVES) and self._text(index + 1) not in (":=", "("):
                self._move(index)
        targets = [target for index, token in enumerate(self.tokens) if token.text == "[" and (target := self._target(index)) is not None]
        return TargetFile(self.program.path, self.program.text, self.program.encoding, tuple(targets), tuple(self.said))

    def _text(self, index: int) -> str:
        return self.tokens[index].text if index < len(self.tokens) else ""

    def _declarations(self) -> None:
        """Targets, tools and work objects that are given values; what is given to a part of a target is told."""
        types: dict[str, str] = {}
        for index, token in enumerate(self.tokens):
            kind = token.text.lower()
            if kind in (*_TARGETS, "tooldata", "wobjdata") and index + 1 < len(self.tokens):
                types.setdefault(self._text(index + 1).lower(), kind)
        for index, token in enumerate(self.tokens):
            name, value = token.text.lower(), self._value_of(index)
            if value is None:
                continue
            kind = types.get(name, "")
            if kind in _TARGETS:
                self._give(name, kind, value)
            elif kind and self._text(value) == "[" and (frame := self._frame(kind, value)) is not None:
                self.frames.setdefault(name, frame)
            elif types.get(name.partition(".")[0]) in _TARGETS:
                self._say(index, f"{token.text} is changed as the program runs, by nominal geometry; write the target out")

    def _value_of(self, index: int) -> int | None:
        """Where the value begins that a name, or an element of an array, is given; None where it is given none."""
        at = index + 1
        if self._text(at) == "{":
            at = self.program.closing(at) + 1
        return at + 1 if self.tokens[index].kind == "name" and self._text(at) == ":=" and at + 1 < len(self.tokens) else None

    def _give(self, name: str, kind: str, value: int) -> None:
        values = self._literals(value)
        if not values:
            self.worked_out.add(name)
        self.named.setdefault(name, []).extend(values)
        if kind == "jointtarget":
            self.joint_targets.update(values)

    def _literals(self, at: int) -> list[int]:
        """Where targets begin in a value: itself, or the elements of an array."""
        if self._text(at) != "[":
            return []
        parts = self.program.parts(at)
        first = parts[0][0] if parts else at
        if self._text(first) == "[" and self._text(first + 1) == "[":
            return [each for start, _ in parts for each in self._literals(start)]
        return [at]

    def _say(self, index: int, words: str) -> None:
        self.said.append(f"{self.program.path}:{self.program.line(self.tokens[index].start)}: {words}")

    def _frame(self, kind: str, at: int) -> Matrix | None:
        """The frame in `[TRUE, [[x, y, z], [q]], ...]`, or in `[FALSE, TRUE, "", [[x, y, z], [q]], [[x, y, z], [q]]]`."""
        parts = self.program.parts(at)
        holds = self._text(parts[0][0]).upper() == "TRUE"
        placed: Matrix = np.eye(4)
        for start, _ in parts[1:2] if kind == "tooldata" else parts[3:5]:
            frame = self._pose(start)
            if frame is None or holds != (kind == "tooldata"):
                return None  # the robot holds the work, and the tool stands by: not what is understood here
            placed = placed @ frame
        return placed

    def _pose(self, at: int) -> Matrix | None:
        parts = self.program.parts(at) if self._text(at) == "[" else []
        numbers = self._lists(parts[:2], (_PLACE, _QUATERNION)) if len(parts) == 2 else None
        return None if numbers is None else QUATERNION_W_FIRST.frame([each.value for each in numbers])

    def _lists(self, parts: Sequence[tuple[int, int]], units: Sequence[Sequence[float]]) -> tuple[Number, ...] | None:
        found: list[Number] = []
        for (start, _), own in zip(parts, units, strict=True):
            numbers = self.program.list_of(start, own) if self._text(start) == "[" else None
            if numbers is None:
                return None
            found += numbers
        return tuple(found)

    def _move(self, index: int) -> None:
        r"""`MoveL [\Conc,] target [, ...], speed, zone, tool [\WObj:=name];` up to the semicolon."""
        end = next((at for at in range(index, len(self.tokens)) if self._text(at) == ";"), len(self.tokens))
        words = [self._text(start).lower() for start in self._arguments(index + 1, end)]
        tool = next((word for word in reversed(words) if word in self.frames), None)
        if len(words) < _LEAST or (tool is None and not self._text(index).lower().startswith("move")):
            return  # a name that begins like an instruction's
        tool = words[-1] if tool is None else tool
        wobj = next((self._text(at + 3).lower() for at in range(index, end) if self._is_wobj(at)), "wobj0")
        for at in range(index + 1, end):
            text = self._text(at).lower()
            if text in _OFFSET and self._text(at + 1) == "(":
                self._say(at, f"{self._text(at)} goes from a corrected target on by nominal geometry; write it out where that matters")
            if text in self.worked_out:
                self._say(at, f"{self._text(at)} is worked out as the program runs, and not corrected; write the target out")
            for value in self.named.get(text, [at] if text == "[" and self._text(at + 1) == "[" else []):
                self._use(value, tool, wobj)

    def _use(self, value: int, tool: str, wobj: str) -> None:
        before = self.used.setdefault(value, (tool, wobj))
        if before != (tool, wobj) and value not in self.joint_targets:
            raise self.program.fail(
                self.tokens[value], f"is gone to with {' in '.join(before)} and with {tool} in {wobj}; give each a target of its own"
            )

    def _is_wobj(self, at: int) -> bool:
        return (self._text(at), self._text(at + 1).lower(), self._text(at + 2)) == ("\\", "wobj", ":=")

    def _arguments(self, begin: int, end: int) -> list[int]:
        """Where the arguments between commas begin, which stand in no brackets."""
        found, at = [begin], begin
        while at < end:
            if self._text(at) in ("(", "[", "{"):
                at = self.program.closing(at)
            elif self._text(at) == ",":
                found.append(at + 1)
            at += 1
        return found

    def _target(self, at: int) -> Target | None:
        parts = self.program.parts(at)
        line = self.program.line(self.tokens[at].start)
        if len(parts) == 2 and (at in self.joint_targets or at in self.used):
            joints = self._lists(parts[:1], ((DEG,) * 6,)) if self._is_external(parts[1]) else None
            return None if joints is None else Target(line, joints[: self.program.joints])
        if len(parts) != 4 or not self._is_external(parts[3]):
            return None
        numbers, conf = self._lists(parts[:2], (_PLACE, _QUATERNION)), self._lists(parts[2:3], ((1.0,) * 4,))
        if numbers is None or conf is None:
            return None
        if at not in self.used:
            self.said.append(f"{self.program.path}:{line}: no move of this file goes to this target; it is left as it stands")
            return None
        tool, wobj = self.used[at]
        for name in (tool, wobj):
            if name not in self.frames:
                raise self.program.fail(
                    self.tokens[at], f"is gone to with '{name}', whose numbers do not stand in this file; --frame {name}=X,Y,Z,q1,q2,q3,q4"
                )
        quadrants = [int(each.value) for each in conf[:3]]
        return Target(line, numbers, QUATERNION_W_FIRST, self.frames[wobj], self.frames[tool], fits=_in_quadrants(quadrants))

    def _is_external(self, part: tuple[int, int]) -> bool:
        return self._text(part[0]) == "[" and self.program.list_of(part[0], (1.0,) * 6) is not None


def _in_quadrants(quadrants: Sequence[int]) -> Callable[[Matrix], Mask]:
    """Whether the axes 1, 4 and 6 are in these quadrants, or hardly over their border."""

    def fits(q: Matrix) -> Mask:
        axes = q[:, [0, 3, 5]]
        low = np.array(quadrants) * _QUADRANT
        return np.asarray(((axes > low - _ROOM) & (axes < low + _QUADRANT + _ROOM)).all(axis=1))

    return fits


def read(program: Program) -> TargetFile:
    """Targets of a RAPID module.

    Raises:
        InputError: the tool or work object of a target is not known, or there are two.
    """
    return _Reading(program).file()
