"""In which order to visit poses: a short way in the joints' own time, each leg a straight line between joint positions.

Moving from one pose to the next takes as long as the slowest joint at full speed. The tour begins at the pose nearest to where the robot
stands and goes on to the nearest that is left; then parts of it are turned round as long as that makes it shorter (2-opt). A leg whose
straight line is not free goes around (`roads`).
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from urdfcal.base.geometry import Matrix, Vector
from urdfcal.base.progress import each
from urdfcal.planning.roads import Reach, Roads, times_between
from urdfcal.robot.robot import Robot

_USUAL_SPEED = 1.0  # [rad/s] or [m/s] where a description states none
_SHORTER = 1e-9  # [s] by which a turn must shorten the tour

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

    @property
    def drivable(self) -> range:
        """Places in the order of the most poses that can be driven to, one after the other."""
        ends = [*(leg + 1 for leg in self.blocked), len(self.order)]
        return max((range(begin, end) for begin, end in zip([0, *ends[:-1]], ends, strict=True)), key=len)


def speeds_of(robot: Robot) -> Vector:
    """Full speed of every measured joint, [rad/s] or [m/s]."""
    limits = robot.model.velocityLimit
    found = np.array([limits[robot.model.joints[robot.model.getJointId(name)].idx_v] for name in robot.chain.input_names])
    return np.where(np.isfinite(found) & (found > 0), found, _USUAL_SPEED)


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


def toured(q: Matrix, robot: Robot, start: Vector, reach: Reach | None, through: Matrix) -> Tour:
    """A tour whose legs are free.

    Where legs are blocked, poses that can be reached from each other are visited one after the other, so that no more legs are blocked than
    the free space, as far as it was found, has parts.

    Args:
        q: Positions, (n, inputs), [rad] or [m].
        robot: The robot, for its speeds.
        start: Where it stands.
        reach: How far straight ways are free; None if all are.
        through: Free positions that a leg may go through where its straight line is not free, (m, inputs).
    """
    speeds = speeds_of(robot)
    order = shortest(q, speeds, start)
    if reach is None:
        return Tour(order, _leg_times(q[order], speeds), {}, ())
    roads = Roads(q, through, speeds, reach)
    order, ways = _driven(order, roads)
    seconds = _leg_times(q[order], speeds)
    vias, blocked = {}, []
    for leg, way in enumerate(ways):
        if way is None:
            blocked.append(leg)
        elif len(way) > 2:
            vias[leg], seconds[leg] = way[1:-1], _leg_times(way, speeds).sum()
    return Tour(order, seconds, vias, tuple(blocked))


def _driven(order: Rows, roads: Roads) -> tuple[Rows, list[Matrix | None]]:
    """The order with what can be reached from each other together, and the way of every leg; None where there is none."""
    legs = list(itertools.pairwise(order.tolist()))
    ways = [roads.way(a, b) for a, b in each(legs, "leg", len(legs))]
    if all(way is not None for way in ways):
        return order, ways
    stretches = np.split(order, [leg + 1 for leg, way in enumerate(ways) if way is None])
    groups: list[list[Rows]] = []
    for stretch in stretches:
        own = next((group for group in groups if roads.way(int(group[-1][-1]), int(stretch[0])) is not None), None)
        groups.append([stretch]) if own is None else own.append(stretch)
    together = np.concatenate([stretch for group in groups for stretch in group])
    return together, [roads.way(a, b) for a, b in itertools.pairwise(together.tolist())]


def _leg_times(stations: Matrix, speeds: Vector) -> Vector:
    """Seconds from each of some stations (n, inputs) to the next, (n - 1,)."""
    return np.asarray((np.abs(np.diff(stations, axis=0)) / speeds).max(axis=1))


def legs(q: Matrix, tour: Tour) -> list[Matrix]:
    """The stations of every leg: the pose that it begins at, where it goes through, the pose that it leads to."""
    there = q[tour.order]
    return [np.array([there[leg], *tour.vias.get(leg, ()), there[leg + 1]]) for leg in range(len(there) - 1)]
