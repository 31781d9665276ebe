"""What an online calibration knows beside its belief: the robot as the readings so far see it, and the poses that came."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import ceil
from typing import Any

import numpy as np

from urdfcal.base.errors import RigError, UsageError
from urdfcal.base.geometry import Matrix, Vector
from urdfcal.base.terminal import many
from urdfcal.calibration.analysis.stream import Row, as_measurements
from urdfcal.calibration.reach import draw_poses
from urdfcal.calibration.start.nominal import NominalFit, nominal_fit
from urdfcal.estimation.noise import Noise
from urdfcal.model.error_model import ErrorModel
from urdfcal.model.jacobian import CHUNK
from urdfcal.robot.robot import Robot
from urdfcal.sensors.joined import joined
from urdfcal.sensors.measurements import Measurements, spots_measured
from urdfcal.sensors.repeats import read_again

_PLENTY = 1.5  # numbers to each of a measuring frame's and a target's before these are found from nothing
_LEAST_POSES = 3  # and poses
WORKSPACE = 50  # configurations over which accuracy is predicted


class NotYet(Exception):
    """Something cannot be placed yet; says what it takes."""


@dataclass(frozen=True)
class Seen:
    """The robot as the readings so far see it.

    Attributes:
        robot: With its instruments.
        errors: The error model, with everything placed that is.
        kinds: Of noise, in its order.
        tool: Link whose accuracy is predicted.
        workspace: Configurations over which it is, (n, inputs).
        views: Poses with every beam on the screen, (n, inputs).
        placed: What is where it was found: measuring frames by session, targets and places, as `shown_by` has them; None before anything.
    """

    robot: Robot
    errors: ErrorModel
    kinds: tuple[str, ...]
    tool: str
    workspace: Matrix
    views: Matrix
    placed: frozenset[Thing] | None

    def knows(self, pose: Measurements) -> bool:
        """Whether a pose shows nothing but what was placed before."""
        return (
            self.placed is not None
            and pose.joints == self.robot.chain.input_names
            and set(pose.session_names) <= set(self.errors.sessions)
            and set(pose.kinds) <= set(self.kinds)
            and set(pose.lasers) <= set(self.robot.rig.lasers)
            and shown_by(pose).keys() <= self.placed
        )


def shown_by(pose: Measurements) -> dict[Thing, int]:
    """What a pose shows of all that has a place to be found, and how many numbers were read of each."""
    found: dict[Thing, int] = {}
    targets = {target.name: target for target in pose.instruments.targets}
    session = pose.session_names[0] if pose.session_names else ""
    for own in (own for own in pose.readings if not own.kind.beam and own.seen.any()):
        target = targets[own.target]
        turned = bool(target.board) or any(name.startswith("rot_") for name in own.kind.offset)
        things = [Thing(target.placed_by, "trans", 3), *([Thing(target.placed_by, "rot", 3)] if turned else [])]
        things += [Thing(own.instrument or "the measuring frame", session, 6)] if own.kind.seen_from == "frame" else []
        things += [Thing(place.name, "", len(place.names), shared=True) for place in own.places]
        for thing in things:
            found[thing] = found.get(thing, 0) + own.numbers
    return found


@dataclass(frozen=True)
class Thing:
    """Something whose place is found from what is read.

    Attributes:
        name: Of a target, of what measures, or of a place.
        part: Of a target which of its numbers; of what measures the session.
        size: How many numbers place it.
        shared: Whether it is a place that poses share.
    """

    name: str
    part: str
    size: int
    shared: bool = False


def ready(waiting: Sequence[Measurements], placed: frozenset[Thing]) -> tuple[list[int], frozenset[Thing]]:
    """Which of the poses that wait show enough of whatever is new in them, and all that can be placed with them.

    Args:
        waiting: Poses.
        placed: What was placed before.

    Raises:
        NotYet: says how much was read of what.
    """
    shows = [{thing: numbers for thing, numbers in shown_by(pose).items() if thing not in placed} for pose in waiting]
    short = _short(shows)
    while (rows := [row for row, new in enumerate(shows) if not short & new.keys()]) and (more := _short([shows[row] for row in rows])):
        short |= more
    new = frozenset(thing for row in rows for thing in shows[row])
    tried = rows or range(len(waiting))
    _require_enough([shows[row] for row in tried], [waiting[row].numbers for row in tried])
    return rows, placed | new


def _short(shows: Sequence[Mapping[Thing, int]]) -> set[Thing]:
    """Things of which too little is shown for themselves alone."""
    numbers, poses = Counter[Thing](), Counter[Thing]()
    for new in shows:
        numbers.update(new)
        poses.update(new.keys())
    return {own for own in numbers if numbers[own] < own.size or (not own.shared and poses[own] < _LEAST_POSES)}


def _require_enough(shows: Sequence[Mapping[Thing, int]], numbers: Sequence[int]) -> None:
    """Refuse to place what was read too little of.

    Raises:
        NotYet: says how much there is.
    """
    new = dict.fromkeys(thing for own in shows for thing in own)
    wide = sum(thing.size for thing in new if not thing.shared)
    read, needed = sum(numbers), ceil(_PLENTY * wide) + sum(thing.size for thing in new if thing.shared)
    short = _short(shows)
    if read < needed or short:
        what = ", ".join(dict.fromkeys(thing.name for thing in new if not short or thing in short))
        poses = f"{many(len(shows), 'pose')} {'waits' if len(shows) == 1 else 'wait'}"
        raise NotYet(f"{poses} until {what} can be placed: {read} numbers were read, it takes {needed} in {_LEAST_POSES} poses or more")


class History:
    """All poses that the belief holds; joint positions in an array that grows by doubling."""

    def __init__(self) -> None:
        self.parts, self.count, self.numbers = list[tuple[int, Measurements | Row]](), 0, 0
        self._q = np.empty((0, 0))

    def __len__(self) -> int:
        """Number of poses."""
        return self.count

    def holds(self, q: Vector) -> bool:
        """Whether this is a further reading of a pose that is held."""
        return bool(self.count) and read_again(self._q[: self.count], q)

    def add(self, number: int, poses: Measurements, again: bool) -> None:
        """A pose, by the number in which it came; or a set without any, for what it would be of."""
        self.parts.append((number, poses))
        for q in poses.q:
            self._keep(q)
        self.numbers += 0 if again else poses.numbers

    def add_row(self, number: int, row: Row, numbers: int) -> None:
        """The same of a pose in its layout, and how many numbers it adds."""
        self.parts.append((number, row))
        self._keep(row.q)
        self.numbers += numbers

    def _keep(self, q: Vector) -> None:
        if self.count == len(self._q):
            old = self._q if self.count else np.empty((0, len(q)))
            self._q = np.concatenate([old, np.empty((max(self.count, CHUNK), len(q)))])
        self._q[self.count] = q
        self.count += 1

    def measurements(self) -> Measurements:
        """All of them, in the order in which they came.

        Raises:
            UsageError: there are none, nor lasers that they could be of.
        """
        if not self.parts:
            raise UsageError("no pose was taken yet")
        return in_order(self.parts)


def in_order(parts: Sequence[tuple[int, Measurements | Row]]) -> Measurements:
    """Poses in the order in which they came."""
    return joined(as_measurements([part for _, part in sorted(parts, key=lambda part: part[0])]))


def no_spots(robot: Robot) -> Measurements | None:
    """No poses of a robot's lasers; None where it has none that could be read."""
    try:
        lasers = len(robot.rig.lasers)
    except RigError:  # a tracker or a camera needs neither lasers nor a screen, and what is read will tell
        return None
    return spots_measured(robot, np.empty((0, len(robot.chain.inputs))), np.empty((0, lasers, 2)))


def poses_on_screen(robot: Robot, errors: ErrorModel, rng: np.random.Generator) -> Matrix:
    """Random configurations with every beam on the screen, (WORKSPACE, inputs); none where they are too rare, or there are no lasers."""
    none = np.empty((0, len(robot.chain.inputs)))
    if not robot.rig.lasers:
        return none
    try:
        return draw_poses(robot, errors, errors.mean, WORKSPACE, rng)
    except UsageError:  # too rare to be found at random: the error of the spots stays unknown, that of the tool does not
        return none


def placed_instruments(errors: ErrorModel, data: Measurements, noise: Noise) -> NominalFit:
    """Everything that measures, where it suits the nominal robot best.

    Raises:
        NotYet: it was seen or touched too seldom.
    """
    try:
        return nominal_fit(errors, data, noise)
    except UsageError as told:
        raise NotYet(str(told)) from None


class Rows:
    """Rows of tables as they came, for what they did not read to be told from columns that come later."""

    def __init__(self, robot: Robot) -> None:
        self._links, self._rows, self._blanks = robot.tree.links, dict[int, dict[str, Any]](), dict[str, Any]()

    def keep(self, number: int, table: Mapping[str, Any]) -> None:
        """The rows of a table that could be read, the first by the number in which it came."""
        for name, values in table.items():
            link = _label(name).partition("@")[0]
            if link in self._links or link.rpartition(":")[0] in self._links:
                self._blanks.setdefault(name, np.asarray(values)[:1])
        count = max((len(values) for values in table.values()), default=0)
        self._rows |= {number + row: {name: values[row : row + 1] for name, values in table.items()} for row in range(count)}

    def row(self, number: int) -> dict[str, Any] | None:
        """One of them with all columns; None for what did not come as a row."""
        return self.with_blanks(self._rows[number]) if number in self._rows else None

    def with_blanks(self, table: Mapping[str, Any]) -> dict[str, Any]:
        """A table with empty cells where other rows had readings and it has none; their order is that of the chain's joints."""
        rows, read = max((len(values) for values in table.values()), default=0), {_label(name) for name in table}
        known = [(name, like) for name, like in self._blanks.items() if name in table or _label(name) not in read]
        filled = {name: table.get(name, _blank(like, rows)) for name, like in known}
        return {**filled, **{name: values for name, values in table.items() if name not in filled}}  # all in one order


def _label(column: str) -> str:
    """Target and instrument of a column of readings; the empty string for others."""
    return column.rpartition(".")[0]


def _blank(like: Any, rows: int) -> Any:
    """Cells in which nothing was read."""
    return np.full((rows, *like.shape[1:]), np.nan) if like.dtype.kind in "fiu" else np.full((rows, *like.shape[1:]), "")
