"""How the tour goes from pose to pose where it does not go straight, as comments of the table of poses: written here and read again.

    # ways around, by positions of turn, lift in rad (m where they slide):
    #   p03 to p04: 0.100000 -0.200000; 0.150000 -0.100000
    # no free way from p07 to p08

The table stays one of measurements, and what is driven can be looked at.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from urdfcal.base.geometry import Matrix
from urdfcal.output.drives import pose_names
from urdfcal.planning.approach import back_off
from urdfcal.planning.plan import PosePlan
from urdfcal.planning.tour import Tour, legs

_DECIMALS = 6
_FARTHEST = 1e6  # [rad] or [m]; beyond there is no position
_MOST = 1000  # stations of one way that are read
_HEAD = re.compile(r"# ways around, by positions of (.+) in rad \(m where they slide\):")
_WAY = re.compile(r"#   (\S+) to (\S+): ([-+.\de; ]+)")
_NONE = re.compile(r"# no free way from (\S+) to (\S+)")

Pair = tuple[str, str]


@dataclass(frozen=True)
class WaysAround:
    """What a table of poses says of the ways between them.

    Attributes:
        joints: Whose positions they go by.
        stations: Positions to go by from one pose to another, (k, joints), [rad] or [m], by their names.
        blocked: Pairs of poses between which no free way was found.
    """

    joints: tuple[str, ...] = ()
    stations: Mapping[Pair, Matrix] = field(default_factory=dict)
    blocked: frozenset[Pair] = frozenset()


def ways_lines(plan: PosePlan, tour: Tour, both_sides: bool) -> list[str]:
    """The comments; none where all ways are straight."""
    found = [f"  {one} to {other}: {_written(stations)}" for (one, other), stations in _ways(plan, tour, both_sides)]
    names = pose_names(len(plan), both_sides)
    head = [f"ways around, by positions of {', '.join(plan.joints)} in rad (m where they slide):"] if found else []
    return [*head, *found, *(f"no free way from {names[leg][-1]} to {names[leg + 1][0]}" for leg in tour.blocked)]


def _ways(plan: PosePlan, tour: Tour, both_sides: bool) -> Iterator[tuple[Pair, Matrix]]:
    """Where it goes by between any two readings that it does not go straight between."""
    names, there = pose_names(len(plan), both_sides), plan.q[tour.order]
    back = back_off(plan.robot) * both_sides
    if both_sides:
        yield from (((one, other), (q + back)[None]) for (one, other), q in zip(names, there, strict=True))
    for leg, way in enumerate(legs(plan.q, tour)):
        by = [*way[1:-1], *([way[-1] - back] if both_sides else [])]
        if by and leg not in tour.blocked:
            yield (names[leg][-1], names[leg + 1][0]), np.array(by)


def _written(stations: Matrix) -> str:
    return "; ".join(" ".join(f"{position + 0.0:.{_DECIMALS}f}" for position in row) for row in stations)


def read_ways(lines: Sequence[str]) -> WaysAround:
    """What comments say of ways; what is none of it, or no number, is some other comment."""
    joints: tuple[str, ...] = ()
    stations: dict[Pair, Matrix] = {}
    blocked = set()
    for line in lines:
        if head := _HEAD.fullmatch(line):
            joints = tuple(head[1].split(", "))
        elif (way := _WAY.fullmatch(line)) and (found := _numbers(way[3], len(joints))) is not None:
            stations[way[1], way[2]] = found
        elif none := _NONE.fullmatch(line):
            blocked.add((none[1], none[2]))
    return WaysAround(joints, stations, frozenset(blocked))


def _numbers(text: str, count: int) -> Matrix | None:
    """Positions (k, count); None where the text has none."""
    rows = [row.split() for row in text.split(";")]
    if not count or len(rows) > _MOST or any(len(row) != count for row in rows):
        return None
    try:
        found = np.array([[float(word) for word in row] for row in rows])
    except ValueError:
        return None
    return found if (np.abs(found) < _FARTHEST).all() else None
