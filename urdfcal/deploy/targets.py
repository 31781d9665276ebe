"""Targets in files: where each of their numbers stands in the text, and the text with other numbers at these places, all else as it was."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from urdfcal.base.errors import InputError, UsageError
from urdfcal.base.geometry import DEG, MM, Array3, Mask, Matrix, Vector
from urdfcal.base.reading import PROGRAM, content_of
from urdfcal.deploy.false_targets import FalseTargets, Placements, Reached, false_joints, false_placements, reach, solved, spoken
from urdfcal.deploy.orientations import Orientation
from urdfcal.robot.urdf_xml import FARTHEST
from urdfcal.robot.way import Way

_DIGITS = {1.0: 9, MM: 5, DEG: 6}  # behind the point that a number at least gets, by its unit's size: under a micrometre and a microradian
_NEXT = 10 * DEG  # [rad], [m] by which the positions of one placement are near those of the one before
_LEAST, _MOST = 8, 128  # placements that are sought at once
_MOST_TIMES = 2.0  # how many times
_COUPLED = 3  # joints that an arm has at least whose third axis is counted with the second
_LINES = 10  # that a message names
_EXPONENT = re.compile(r"[eE]")


@dataclass(frozen=True)
class Number:
    """A number that stands in a text.

    Attributes:
        start, end: From where to where.
        unit: Size of its unit in SI.
        value: [rad], [m] or without unit.
        comma: Whether decimals stand behind a comma there.
    """

    start: int
    end: int
    unit: float
    value: float
    comma: bool = False

    def written(self, text: str, value: float) -> tuple[int, int, str]:
        """Its place, and another value as it is written there: with its decimals, and as many more as a micrometre needs."""
        old, digits = text[self.start : self.end], _DIGITS.get(self.unit, 9)
        if abs(value - self.value) < 0.5 * 10.0**-digits * self.unit:
            return self.start, self.end, old
        decimals = 0 if _EXPONENT.search(old) else len(old.partition("," if self.comma else ".")[2])
        new = f"{value / self.unit:.{max(decimals, digits)}f}"
        whole, _, part = new.partition(".")
        part = part[:decimals] + part[decimals:].rstrip("0")
        new = f"{whole}{',' if self.comma else '.'}{part}" if part else whole
        return self.start, self.end, "+" + new if old.startswith("+") and not new.startswith("-") else new


@dataclass(frozen=True)
class Target:
    """A place that a robot is to go to.

    Attributes:
        line: Where it stands.
        numbers: Positions of the joints, or x, y, z and an orientation.
        orientation: How the latter is written; None where the numbers are positions.
        T_base_frame: The frame that the placement is told in, as the robot's base sees it, (4, 4).
        T_flange_tcp: The point that it is about, as the tool's link sees it, (4, 4).
        near: Positions in whose configuration it is reached, (k,), if the file says.
        fits: Whether positions (n, k) are in the configuration that the file names, (n,); None where it names none.
        coupling: From positions as the controller counts them to those of the description's joints, (k, k); None where they are the same.
    """

    line: int
    numbers: tuple[Number, ...]
    orientation: Orientation | None = None
    T_base_frame: Matrix = field(default_factory=lambda: np.eye(4))
    T_flange_tcp: Matrix = field(default_factory=lambda: np.eye(4))
    near: Vector | None = None
    fits: Callable[[Matrix], Mask] | None = None
    coupling: Matrix | None = None

    @property
    def values(self) -> Vector:
        """The numbers in SI."""
        return np.array([number.value for number in self.numbers])

    @property
    def positions(self) -> Vector:
        """Of the description's joints, where the numbers are positions, (k,)."""
        return self.values if self.coupling is None else np.asarray(self.coupling @ self.values)

    def numbers_at(self, q: Vector) -> Vector:
        """The numbers that tell positions of the description's joints, (k,)."""
        return np.asarray(q if self.coupling is None else np.linalg.solve(self.coupling, q))

    def placement(self) -> Matrix:
        """Placement of the tool's link in the robot's base, (4, 4)."""
        assert self.orientation is not None
        return np.asarray(self.T_base_frame @ self.orientation.frame(self.values) @ np.linalg.inv(self.T_flange_tcp))

    def numbers_of(self, placement: Matrix) -> Vector:
        """The numbers that tell a placement of the tool's link in the robot's base."""
        assert self.orientation is not None
        told = np.linalg.inv(self.T_base_frame) @ placement @ self.T_flange_tcp
        return np.concatenate([told[:3, 3], self.orientation.numbers(told[:3, :3], self.values[3:])])


@dataclass(frozen=True)
class TargetFile:
    """A file with targets.

    Attributes:
        path: The file.
        text: Its text; line ends as they are.
        encoding: Of its bytes.
        targets: In the file's order.
        said: What is left as it stands, and why, for warnings.
    """

    path: Path
    text: str
    encoding: str
    targets: tuple[Target, ...]
    said: tuple[str, ...] = ()

    def with_numbers(self, values: Sequence[Vector | None]) -> bytes:
        """The file with other numbers at the places of its targets, in SI; None leaves a target as it is."""
        changes = [
            number.written(self.text, float(value))
            for target, row in zip(self.targets, values, strict=True)
            if row is not None
            for number, value in zip(target.numbers, row, strict=True)
        ]
        pieces, end = [], 0
        for start, stop, new in sorted(changes):
            pieces += [self.text[end:start], new]
            end = stop
        return "".join([*pieces, self.text[end:]]).encode(self.encoding)


def with_coupled_axes(file: TargetFile, joints: int, factor: float) -> TargetFile:
    """The file for a controller that counts axis 3 from the horizontal: the description's joint 3 is its J3 and `factor` times its J2.

    Raises:
        UsageError: the robot has no third joint, or the factor is none.
    """
    if not abs(factor) <= _MOST_TIMES:
        raise UsageError(f"--j23 {factor:g}: expected 1 or -1, or 0 where nothing is coupled")
    if joints < _COUPLED:
        raise UsageError(f"--j23 {factor:g}: is about the third joint, and {joints} move the tool")
    C = np.eye(joints)
    C[2, 1] = factor
    coupled = (replace(each, coupling=C, near=None if each.near is None else C @ each.near) for each in file.targets)
    return replace(file, targets=tuple(coupled))


def text_of(path: Path) -> tuple[str, str]:
    """A file's text and its encoding; controllers write UTF-8 or Latin-1.

    Raises:
        InputError: it cannot be read, or is no regular file.
    """
    content = content_of(path, PROGRAM)
    encoding = "utf-8-sig" if content.startswith(b"\xef\xbb\xbf") else "utf-8"
    try:
        return content.decode(encoding), encoding
    except UnicodeDecodeError:
        return content.decode("latin-1"), "latin-1"


@dataclass(frozen=True, eq=False)
class Corrected:
    """What became of one target.

    Attributes:
        target: As it stood.
        values: Its numbers now, in SI.
        before_mm, before_deg: How far off the real tool was.
        left_mm, left_deg: How far off it is now.
        q: Positions at which the real robot has its tool there, (k,).
        said: What is to be said of it; the empty string where the tool comes where it was wanted.
    """

    target: Target
    values: Vector
    before_mm: float
    before_deg: float
    left_mm: float
    left_deg: float
    q: Vector
    said: str


def corrected(file: TargetFile, nominal: Way, real: Placements, near: Vector | None = None) -> list[Corrected]:
    """False targets for all targets of a file.

    Args:
        file: The targets.
        nominal: As the controller has the robot.
        real: Where the real robot has the tool's link at positions, (n, k) -> (n, 4, 4).
        near: Positions in whose configuration the first target is reached, (k,), where the file does not say.

    Raises:
        InputError: a placement stands before anything that says its configuration, or cannot be reached by the nominal robot.
    """
    _require_near(file)
    found: dict[int, Corrected] = {}
    jointed = [row for row, target in enumerate(file.targets) if target.orientation is None]
    placed = [row for row, target in enumerate(file.targets) if target.orientation is not None]
    if jointed:
        targets = false_joints(nominal, real, np.array([file.targets[row].positions for row in jointed]))
        found |= _told(file, nominal, jointed, targets, lambda index, target: target.numbers_at(targets.reached.q[index]))
    if placed:
        wanted = np.array([file.targets[row].placement() for row in placed])
        false = false_placements(nominal, real, wanted, _nominal(file, nominal, placed, wanted, near))
        found |= _told(file, nominal, placed, false, lambda index, target: target.numbers_of(false.placements[index]))
    return [found[row] for row in range(len(file.targets))]


def _require_near(file: TargetFile) -> None:
    """Refuse numbers that no robot has.

    Raises:
        InputError: names the line.
    """
    for target in file.targets:
        for number in target.numbers:
            if not abs(number.value) <= FARTHEST:
                raise InputError(f"{file.text[number.start : number.end]} is farther than any robot goes", file.path, target.line)


def _nominal(file: TargetFile, way: Way, rows: Sequence[int], wanted: Array3, near: Vector | None) -> Matrix:
    """Positions at which the controller reaches the placements of a file, each in the configuration of what is said of it or before it.

    Raises:
        InputError: nothing says the configuration of a placement, or it is out of reach.
    """
    own = [file.targets[row].near for row in rows]
    if all(each is not None for each in own):
        reached = solved(way, wanted, np.array(own))
        _require_none(
            file, [(file.targets[row], why) for index, row in enumerate(rows) if (why := _why_not(file.targets[row], reached, index))]
        )
        return reached.q
    found: list[Vector] = []
    missed: list[tuple[Target, str]] = []
    size = _LEAST
    while len(found) < len(rows):
        first = len(found)
        target = file.targets[rows[first]]
        begin = _near(file, way, rows, first, found[-1] if found else near)
        block = _following(file, rows, first, size)
        more = _chained(way, [file.targets[row] for row in block], wanted[first : first + len(block)], begin)
        size = min(_MOST, 2 * size) if len(more) == len(block) else max(_LEAST, len(more))
        if not more:
            reached = solved(way, wanted[first][None], begin[None], target.fits)
            why = _why_not(target, reached, 0)
            missed += [(target, why)] if why else []
            more = [begin if why else reached.q[0]]
        found += more
    _require_none(file, missed)
    return np.array(found)


def _near(file: TargetFile, way: Way, rows: Sequence[int], first: int, before: Vector | None) -> Vector:
    """Positions in whose configuration a placement is reached: its own, those of the joint target before it, or of the placement before.

    Raises:
        InputError: nothing says it.
    """
    target = file.targets[rows[first]]
    if target.near is not None:
        return target.near
    between = file.targets[rows[first - 1] + 1 if first else 0 : rows[first]]
    if between:
        return between[-1].positions
    if before is None and target.fits is not None:
        return np.asarray(np.clip(np.zeros(len(way.names)), *way.limits))
    if before is None:
        raise InputError(
            "nothing says in which configuration this placement is reached, no joint target stands before it; "
            "--near names positions of the joints",
            file.path,
            target.line,
        )
    return before


def _following(file: TargetFile, rows: Sequence[int], first: int, size: int) -> Sequence[int]:
    """Placements from one on that follow each other without a joint target, or positions of their own, between them."""
    end = first + 1
    while end < min(first + size, len(rows)) and rows[end] == rows[end - 1] + 1 and file.targets[rows[end]].near is None:
        end += 1
    return rows[first:end]


def _chained(way: Way, targets: Sequence[Target], wanted: Array3, begin: Vector) -> list[Vector]:
    """Positions of the first of several placements, all sought at once from where the first is: as long as each is near the one before.

    So near to one way to reach the placement before there is no other one to reach this; it is what would be found from there.
    """
    reached, found = reach(way, way.placements, wanted, np.repeat(begin[None], len(wanted), axis=0)), list[Vector]()
    for target, q, whole in zip(targets, reached.q, reached.whole, strict=True):
        fits = target.fits is None or bool(target.fits(q[None])[0])
        if not whole or not fits or np.abs(q - begin).max() > _NEXT:
            break
        found.append(q)
        begin = q
    return found


def _why_not(target: Target, reached: Reached, index: int) -> str:
    """What keeps the nominal robot from a target; the empty string where nothing does."""
    if not reached.whole[index]:
        return f": {reached.left_mm[index]:.3f} mm and {reached.left_deg[index]:.4f} deg are left over"
    named = target.fits is not None and not target.fits(reached.q[index][None])[0]
    return " in the configuration that is named" if named else ""


def _require_none(file: TargetFile, missed: Sequence[tuple[Target, str]]) -> None:
    """Refuse targets that the nominal robot does not reach.

    Raises:
        InputError: names the first of them, and the lines of others.
    """
    if not missed:
        return
    (first, why), *others = missed
    lines = [str(target.line) for target, _ in others]
    named = f"{', '.join(lines[:_LINES])}{' ...' if len(lines) > _LINES else ''}"
    more = "" if not lines else f", nor that on line {named}" if len(lines) == 1 else f", nor those on lines {named}"
    raise InputError(
        f"the nominal robot does not reach this target{why}{more}; see whether base, tool and the frames of the file are those of the "
        "controller",
        file.path,
        first.line,
    )


def _told(
    file: TargetFile, way: Way, rows: Sequence[int], targets: FalseTargets, numbers: Callable[[int, Target], Vector]
) -> dict[int, Corrected]:
    words = spoken(way, targets)
    return {
        row: _corrected(file.targets[row], targets, index, numbers(index, file.targets[row]), words[index])
        for index, row in enumerate(rows)
    }


def _corrected(target: Target, targets: FalseTargets, index: int, values: Vector, said: str) -> Corrected:
    reached = targets.reached
    return Corrected(
        target,
        values,
        float(targets.before_mm[index]),
        float(targets.before_deg[index]),
        float(reached.left_mm[index]),
        float(reached.left_deg[index]),
        reached.q[index],
        said,
    )
