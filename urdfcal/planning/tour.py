"""In which order to visit poses: a short way in the joints' own time, each leg a straight line between joint positions.

Moving from one pose to the next takes as long as the slowest joint at full speed. The tour begins at the pose nearest to where the robot
stands and goes on to the nearest that is left; then parts of it are turned round as long as that makes it shorter (2-opt). A leg whose
straight line is not free goes around.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from urdfcal.base.geometry import Mask, Matrix, Vector
from urdfcal.robot.robot import Robot

STEP = 0.02  # [rad] and [m] of the joint that moves most, between two looks at a leg
_USUAL_SPEED = 1.0  # [rad/s] or [m/s] where a description states none
_SHORTER = 1e-9  # [s] by which a turn must shorten the tour
_COARSE = 16  # steps of a leg between its first looks
_TRIED = 20  # detours that are looked at for a leg that is not free

Free = Callable[[Matrix], Mask]
Rows = npt.NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class Tour:
    """An order of poses.

    Attributes:
        order: Rows of the poses, (n,).
        seconds: What each leg takes at full speed, (n - 1,).
        vias: Positions to go through on a leg whose straight line is not free, (stations, inputs), by the leg's number.
        blocked: Numbers of legs for which no way was found.
    """

    order: Rows
    seconds: Vector
    vias: dict[int, Matrix]
    blocked: tuple[int, ...]


def speeds_of(robot: Robot) -> Vector:
    """Full speed of every measured joint, [rad/s] or [m/s]."""
    limits = robot.model.velocityLimit
    found = np.array([limits[robot.model.joints[robot.model.getJointId(name)].idx_v] for name in robot.chain.input_names])
    return np.where(np.isfinite(found) & (found > 0), found, _USUAL_SPEED)


def times_between(one: Matrix, other: Matrix, speeds: Vector) -> Matrix:
    """Seconds from each of some positions (n, inputs) to each of others (m, inputs), (n, m)."""
    return np.asarray((np.abs(one[:, None] - other[None]) / speeds).max(axis=2))


def shortest(q: Matrix, speeds: Vector, start: Vector) -> Rows:
    """A short tour of positions (n, inputs) from where the robot stands, (inputs,)."""
    times = times_between(q, q, speeds)
    order, left = [int(np.argmin(times_between(start[None], q, speeds)[0]))], set(range(len(q)))
    left.remove(order[0])
    while left:
        rest = sorted(left)
        order.append(rest[int(np.argmin(times[order[-1], rest]))])
        left.remove(order[-1])
    return _turned(np.array(order, dtype=np.intp), times)


def _turned(order: Rows, times: Matrix) -> Rows:
    """The tour with parts turned round until none is worth it; its first pose stays."""
    better = True
    while better:
        better = False
        for first in range(1, len(order) - 1):
            before, here, lasts = order[first - 1], order[first], np.arange(first + 1, len(order))
            behind = np.append(order[first + 2 :], -1)
            gain = times[before, here] - times[before, order[lasts]]
            gain += np.where(behind >= 0, times[order[lasts], behind] - times[here, behind], 0.0)
            best = int(np.argmax(gain))
            if gain[best] > _SHORTER:
                last = int(lasts[best])
                order[first : last + 1] = order[first : last + 1][::-1]
                better = True
    return order


def toured(q: Matrix, robot: Robot, start: Vector, free: Free | None, through: Matrix) -> Tour:
    """A tour whose legs are free.

    Args:
        q: Positions, (n, inputs), [rad] or [m].
        robot: The robot, for its speeds.
        start: Where it stands.
        free: Which positions it may take; None for all.
        through: Free positions that a leg may go through where its straight line is not free, (m, inputs).
    """
    speeds = speeds_of(robot)
    order = shortest(q, speeds, start)
    there = q[order]
    seconds = _leg_times(there, speeds)
    if free is None:
        return Tour(order, seconds, {}, ())
    vias: dict[int, Matrix] = {}
    blocked = []
    for leg, (a, b) in enumerate(itertools.pairwise(there)):
        if straight_is_free(a, b, free):
            continue
        around = _via(a, b, through, speeds, free)
        if around is None:
            blocked.append(leg)
        else:
            vias[leg] = around
            seconds[leg] = _leg_times(np.vstack([a, around, b]), speeds).sum()
    return Tour(order, seconds, vias, tuple(blocked))


def straight_is_free(a: Vector, b: Vector, free: Free) -> bool:
    """Whether every position on the straight line between two is free, looked at in steps."""
    way = on_the_way(a, b)
    coarse = np.arange(0, len(way), _COARSE)
    return bool(free(way[coarse]).all()) and bool(free(np.delete(way, coarse, axis=0)).all())


def on_the_way(a: Vector, b: Vector) -> Matrix:
    """Positions from one to the other, both included, (steps, inputs)."""
    steps = max(2, int(np.ceil(np.abs(b - a).max() / STEP)) + 1)
    return np.asarray(a + np.linspace(0, 1, steps)[:, None] * (b - a))


def _leg_times(stations: Matrix, speeds: Vector) -> Vector:
    """Seconds from each of some stations (n, inputs) to the next, (n - 1,)."""
    return np.asarray((np.abs(np.diff(stations, axis=0)) / speeds).max(axis=1))


def _via(a: Vector, b: Vector, through: Matrix, speeds: Vector, free: Free) -> Matrix | None:
    """A way around, (stations, inputs): over one of some positions, else from station to station between two growing trees."""
    both = times_between(np.stack([a, b]), through, speeds).sum(axis=0)
    for row in np.argsort(both)[:_TRIED]:
        via = through[row]
        if straight_is_free(a, via, free) and straight_is_free(via, b, free):
            return np.asarray(via[None])
    return _connected(a, b, through, speeds, free)


@dataclass
class _Tree:
    """Positions that are reached from a root by straight free lines."""

    q: list[Vector]
    parents: list[int]

    def grown(self, towards: Vector, speeds: Vector, free: Free) -> int:
        """The station that was reached from the nearest one, on the way to a position: as far as all is free."""
        nearest = int(np.argmin(times_between(towards[None], np.array(self.q), speeds)[0]))
        way = on_the_way(self.q[nearest], towards)
        stop = _free_until(way, free)
        if stop < 1:
            return nearest
        self.q.append(way[stop])
        self.parents.append(nearest)
        return len(self.q) - 1

    def back(self, station: int) -> list[Vector]:
        """From a station to the root."""
        found = []
        while station >= 0:
            found.append(self.q[station])
            station = self.parents[station]
        return found


def _free_until(way: Matrix, free: Free) -> int:
    """The last row up to which all of a way is free; looked at in parts, as far as that is so."""
    for start in range(0, len(way), _COARSE):
        part = free(way[start : start + _COARSE])
        if not part.all():
            return start + int(np.argmin(part)) - 1
    return len(way) - 1


def _connected(a: Vector, b: Vector, through: Matrix, speeds: Vector, free: Free) -> Matrix | None:
    """Rapidly exploring trees from both ends (Kuffner and LaValle, 2000, RRT-Connect), shortened; None where they do not meet."""
    one, other = _Tree([a], [-1]), _Tree([b], [-1])
    for towards in np.random.default_rng(0).permutation(through):
        station = one.grown(towards, speeds, free)
        met = other.grown(one.q[station], speeds, free)
        if np.array_equal(other.q[met], one.q[station]):
            way = [*one.back(station)[::-1], *other.back(met)[1:]]
            return _shortened(way if np.array_equal(way[0], a) else way[::-1], free)[1:-1]
        one, other = other, one
    return None


def _shortened(way: list[Vector], free: Free) -> Matrix:
    """The way with stations left out that straight free lines go past."""
    kept, here = [way[0]], 0
    while here < len(way) - 1:
        here = next(far for far in range(len(way) - 1, here, -1) if far == here + 1 or straight_is_free(way[here], way[far], free))
        kept.append(way[here])
    return np.array(kept)


def legs(q: Matrix, tour: Tour) -> list[Matrix]:
    """The stations of every leg: the pose that it begins at, where it goes through, the pose that it leads to."""
    there = q[tour.order]
    return [np.array([there[leg], *tour.vias.get(leg, ()), there[leg + 1]]) for leg in range(len(there) - 1)]
