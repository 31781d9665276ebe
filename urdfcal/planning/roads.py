"""Ways around: from pose to pose over positions that are free, where the straight line is not.

All poses and some free positions are stations; straight lines lead from each to its nearest ones, and are looked at only when a shortest
way would go along them (Bohlin and Kavraki, 2000, lazy PRM). What was found on one leg serves all others. Where no such way is left,
trees grow from both ends (Kuffner and LaValle, 2000, RRT-Connect); their stations stay.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable

import numpy as np

from urdfcal.base.geometry import Matrix, Vector
from urdfcal.base.interrupts import enough

Reach = Callable[[Vector, Vector], float]  # up to which share the straight line from one position to another is free

_NEIGHBOURS = 12
_LOOKS = 60  # at lines on the search for one way over stations
_GROWN = 300  # positions towards which the trees grow
_MOST_LOOKS = 800  # at lines on the search for all ways around
_BACK = 0.02  # share of a line's free part that a tree's station stays back from what is in the way
_LEAST = 0.02  # share of a line that is worth a station


def times_between(one: Matrix, other: Matrix, speeds: Vector) -> Matrix:
    """Seconds from each of some positions (n, inputs) to each of others (m, inputs), (n, m)."""
    return np.asarray((np.abs(one[:, None] - other[None]) / speeds).max(axis=2))


class Roads:
    """Stations, and what is known of the lines between them."""

    def __init__(self, q: Matrix, through: Matrix, speeds: Vector, reach: Reach) -> None:
        """Begin with poses (n, inputs), the first stations, and other free positions (m, inputs)."""
        self.q, self.speeds, self.reach = np.vstack([q, through]), speeds, reach
        self._free: dict[tuple[int, int], bool] = {}
        self.looks = 0
        self._found: dict[tuple[int, int], Matrix | None] = {}

    def way(self, one: int, other: int) -> Matrix | None:
        """A free way from one station to another, (stations, inputs), both included; None where none was found."""
        pair = min(one, other), max(one, other)
        if pair not in self._found:
            if enough():  # what was not looked at by now is not
                return None
            rows = [*pair] if self._is_free(*pair) else self._along(*pair) or self._grown(*pair)
            self._found[pair] = self._shortened(rows) if rows else None
        found = self._found[pair]
        return found if found is None or one < other else found[::-1]

    def _is_free(self, one: int, other: int) -> bool:
        pair = min(one, other), max(one, other)
        if pair not in self._free:
            self._free[pair] = self._looked(self.q[pair[0]], self.q[pair[1]]) >= 1
        return self._free[pair]

    def _looked(self, a: Vector, b: Vector) -> float:
        self.looks += 1
        return self.reach(a, b)

    def _along(self, one: int, other: int) -> list[int] | None:
        """Stations of the shortest way whose lines are all free."""
        times = self._lines()
        for _ in range(_LOOKS if self.looks < _MOST_LOOKS and not enough() else 0):
            rows = _shortest(times, one, other)
            if rows is None:
                return None
            bad = [(a, b) for a, b in itertools.pairwise(rows) if not self._is_free(a, b)]
            if not bad:
                return rows
            for a, b in bad:
                times[a, b] = times[b, a] = np.inf
        return None

    def _lines(self) -> Matrix:
        """Seconds along the lines that may be free, (stations, stations); inf where there is none."""
        times = times_between(self.q, self.q, self.speeds)
        np.fill_diagonal(times, np.inf)
        far = times > np.sort(times, axis=1)[:, [min(_NEIGHBOURS, len(times)) - 1]]
        known = np.full(times.shape, np.nan)
        for (a, b), free in self._free.items():
            known[a, b] = known[b, a] = free
        return np.where((far & far.T & ~(known == 1)) | (known == 0), np.inf, times)

    def _grown(self, one: int, other: int) -> list[int] | None:
        """Stations of a way between two trees; None where they do not meet."""
        here, there = {one: -1}, {other: -1}
        for towards in np.random.default_rng(0).integers(0, len(self.q), _GROWN):
            if self.looks >= _MOST_LOOKS or enough():
                return None
            station = self._extended(here, self.q[towards])
            if station is not None:
                nearest = self._nearest(there, self.q[station])
                met = station if self._is_free(nearest, station) else self._extended(there, self.q[station])
                if met == station:
                    rows = [*_back(here, station)[::-1], *_back(there, nearest)]
                    return rows if rows[0] == one else rows[::-1]
            here, there = there, here
        return None

    def _nearest(self, tree: dict[int, int], q: Vector) -> int:
        rows = np.array(list(tree))
        return int(rows[np.argmin(times_between(q[None], self.q[rows], self.speeds)[0])])

    def _extended(self, tree: dict[int, int], towards: Vector) -> int | None:
        """A new station of a tree, as far towards a position as the line from the nearest one is free; None where that is nowhere."""
        nearest = self._nearest(tree, towards)
        share = self._looked(self.q[nearest], towards)
        share = 1.0 if share >= 1 else share - _BACK
        if share < _LEAST:
            return None
        self.q = np.vstack([self.q, self.q[nearest] + share * (towards - self.q[nearest])])
        station = len(self.q) - 1
        tree[station], self._free[nearest, station] = nearest, True
        return station

    def _shortened(self, rows: list[int]) -> Matrix:
        """The way with stations left out that straight free lines go past."""
        kept, here = [rows[0]], 0
        while here < len(rows) - 1:
            here = next(far for far in range(len(rows) - 1, here, -1) if far == here + 1 or self._is_free(rows[here], rows[far]))
            kept.append(rows[here])
        return self.q[kept]


def _back(tree: dict[int, int], station: int) -> list[int]:
    """From a station to the root."""
    found = []
    while station >= 0:
        found.append(station)
        station = tree[station]
    return found


def _shortest(times: Matrix, one: int, other: int) -> list[int] | None:
    """Rows of the shortest way over lines of some lengths, (n, n); None where there is none."""
    from scipy.sparse.csgraph import dijkstra

    _, before = dijkstra(times, indices=one, return_predecessors=True)
    rows = [other]
    while rows[-1] != one:
        rows.append(int(before[rows[-1]]))
        if rows[-1] < 0:
            return None
    return rows[::-1]
