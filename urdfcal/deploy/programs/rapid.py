r"""RAPID: `robtarget` and `jointtarget`, declared or written into the move, [mm] and [deg]; quaternions with w first.

A robtarget is of the tool's frame in the work object's, which the moves to it name: `\WObj:=name` and the tool, `tooldata` and `wobjdata`
with numbers in the same file, or stated by the user. Of its confdata cf1, cf4 and cf6 are quadrants, floor(angle / 90 deg), of the axes
1, 4 and 6.
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
_QUADRANT = 90 * DEG
_ROOM = 5 * DEG  # by which an axis may be over the border of its quadrant


class _Reading:
    """The declarations of a module, and with which tool and work object its moves go where."""

    def __init__(self, program: Program) -> None:
        self.program, self.tokens = program, program.tokens
        self.frames: dict[str, Matrix] = {"tool0": np.eye(4), "wobj0": np.eye(4)} | {
            name.lower(): frame for name, frame in program.frames.items()
        }
        self.named: dict[str, int] = {}  # where the value of a robtarget begins
        self.used: dict[int, tuple[str, str]] = {}  # tool and work object by where a target begins
        self.said: list[str] = []

    def file(self) -> TargetFile:
        for index, token in enumerate(self.tokens):
            if token.text.lower() in ("robtarget", "tooldata", "wobjdata") and self._text(index + 2) == ":=":
                self._declared(token.text.lower(), index + 1)
        for index, token in enumerate(self.tokens):
            if token.text.lower().startswith("move") and token.kind == "name":
                self._move(index)
        targets = [target for index, token in enumerate(self.tokens) if token.text == "[" and (target := self._target(index)) is not None]
        return TargetFile(self.program.path, self.program.text, self.program.encoding, tuple(targets), tuple(self.said))

    def _text(self, index: int) -> str:
        return self.tokens[index].text if index < len(self.tokens) else ""

    def _declared(self, kind: str, at: int) -> None:
        name, value = self.tokens[at].text.lower(), at + 2
        if kind == "robtarget":
            self.named[name] = value
        elif self._text(value) == "[" and (frame := self._frame(kind, value)) is not None:
            self.frames.setdefault(name, frame)

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
        bare = next((at for at in range(index, end) if (self._text(at), self._text(at + 1).lower()) == ("\\", "wobj")), end)
        tool, wobj = self._text(bare - 1), self._text(bare + 3) if bare < end else "wobj0"
        for at in range(index + 1, end):
            text = self._text(at).lower()
            if text in _OFFSET and self._text(at + 1) == "(":
                self.said.append(
                    f"{self.program.path}:{self.program.line(self.tokens[at].start)}: {self._text(at)} goes from a corrected target on by "
                    "nominal geometry; write the target out where that matters"
                )
            value = self.named.get(text, at if text == "[" and self._text(at + 1) == "[" else None)
            if value is None:
                continue
            before = self.used.setdefault(value, (tool.lower(), wobj.lower()))
            if before != (tool.lower(), wobj.lower()):
                raise self.program.fail(
                    self.tokens[value], f"is gone to with {' in '.join(before)} and with {tool} in {wobj}; give each a target of its own"
                )

    def _target(self, at: int) -> Target | None:
        parts = self.program.parts(at)
        line = self.program.line(self.tokens[at].start)
        if len(parts) == 2:
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
