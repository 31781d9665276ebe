"""Readings on a bench that do not fit the others: found one after the other, left out, and named.

A mistyped reading is one laser's in one row, a mistyped distance all of a row's. With r the residual of some readings S and H the fit's
hat matrix, leaving S out lowers the sum of squares by r' (I - H)^-1 r. Over the mean square of what is left that is F-distributed, or
chi-squared over a stated noise that the rest bears out; the tail beyond it, times the number of candidates, must be under 1 %. Nobody
reads a ruler better than to 0.05 mm, so that a few readings that agree by chance make no misreading of the next.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from urdfcal.base.geometry import MM, Matrix, Vector
from urdfcal.vision.bench.beams import LEAST_DOF, BenchReadings, BenchResult, beams_from_bench, freedom, jacobian, solved, start

_ALARM = 0.01  # chance of an alarm on a healthy bench
_RULER = 0.05 * MM
_ALIKE = 3.0  # mean squares within this factor do not say which reading is the wrong one


@dataclass(frozen=True)
class Misreading:
    """Readings of one row that do not fit the others.

    Attributes:
        row: Index of the row.
        lasers: Whose readings; all of the row's where its distance may be wrong.
        off: How far they are at most from where the other readings have them, [m].
    """

    row: int
    lasers: tuple[str, ...]
    off: float


@dataclass(frozen=True)
class _Candidate:
    """A misreading that may be one.

    Attributes:
        misreading: What would be left out.
        spare: Tail probability of what the fit gains without it.
        left: Mean square of what is left, in units of the assumed noise's square.
        dof: Degrees of freedom that are left.
    """

    misreading: Misreading
    spare: float
    left: float
    dof: int


def beams_without_misreadings(
    readings: BenchReadings, squareness: float, noise: float | None = None
) -> tuple[BenchResult, list[Misreading], list[Misreading]]:
    """The beam directions from the readings that fit each other; arguments as of `beams_from_bench`.

    Returns:
        The result, what was left out, and what may be wrong but was not left out: too few readings say which of them it is.

    Raises:
        UsageError: as `beams_from_bench`.
    """
    left_out: list[Misreading] = []
    while True:
        result = beams_from_bench(readings, squareness, noise)
        candidates = sorted(_candidates(readings, squareness, result), key=lambda candidate: candidate.spare)
        if not candidates or candidates[0].spare * len(candidates) > _ALARM:
            return result, left_out, []
        best = candidates[0]
        doubtful = _one_a_row([best, *(other for other in candidates if other.left < _ALIKE * best.left)])
        if len(doubtful) > 1 or (noise is None and best.dof < LEAST_DOF):
            return result, left_out, doubtful
        left_out.append(best.misreading)
        readings = _without(readings, best.misreading)


def _one_a_row(candidates: Iterable[_Candidate]) -> list[Misreading]:
    """The first of each row."""
    firsts: dict[int, Misreading] = {}
    for candidate in candidates:
        firsts.setdefault(candidate.misreading.row, candidate.misreading)
    return list(firsts.values())


def _without(readings: BenchReadings, misreading: Misreading) -> BenchReadings:
    spots = readings.spots.copy()
    spots[misreading.row, [readings.lasers.index(laser) for laser in misreading.lasers]] = np.nan
    return replace(readings, spots=spots)


def _candidates(readings: BenchReadings, squareness: float, result: BenchResult) -> Iterator[_Candidate]:
    """Every reading, and every row of several, that the rest can do without."""
    x, covariance, residual = solved(readings, start(readings), squareness, result.noise)
    by_x = jacobian(x, readings.distance) / result.noise
    hat, r = by_x @ covariance @ by_x.T, residual.ravel() / result.noise
    total = float(np.nansum(r**2)) + (float(x[-2:] @ x[-2:]) / squareness**2 if squareness > 0 else 0.0)
    seen = np.isfinite(readings.spots[..., 0])
    for row in range(len(seen)):
        own = np.flatnonzero(seen[row])
        for chosen in [own[[k]] for k in range(len(own))] + ([own] if len(own) > 1 else []):
            dof = freedom(readings) - 2 * len(chosen)
            if dof > 0 and all(_enough(readings, row, int(laser)) for laser in chosen):
                places = (2 * (row * len(readings.lasers) + chosen)[:, None] + (0, 1)).ravel()
                off, gain = _left_out(r[places], hat[np.ix_(places, places)])
                left = max((total - gain) / dof, (_RULER / result.noise) ** 2)
                lasers = tuple(readings.lasers[laser] for laser in chosen)
                misreading = Misreading(row, lasers, float(np.linalg.norm(off.reshape(-1, 2), axis=1).max()) * result.noise)
                yield _Candidate(misreading, _tail(gain, len(places), dof, left, result.stated), left, dof)


def _enough(readings: BenchReadings, row: int, laser: int) -> bool:
    """Whether a laser is read at two distances without a row."""
    rest = np.delete(readings.distance, row)[np.isfinite(np.delete(readings.spots[:, laser, 0], row))]
    return len(set(rest.tolist())) > 1


def _left_out(r: Vector, hat: Matrix) -> tuple[Vector, float]:
    """What the other readings leave of some residuals, and by how much the sum of squares falls without them."""
    off = np.asarray(np.linalg.solve(np.eye(len(r)) - hat, r))
    return off, float(r @ off)


def _tail(gain: float, count: int, dof: int, left: float, stated: bool) -> float:
    """The chance of such a gain on a healthy bench; a stated noise that what is left does not bear out counts for nothing."""
    from scipy.special import chdtrc, fdtrc

    borne_out = stated and chdtrc(dof, dof * left) > _ALARM
    return float(chdtrc(count, gain) if borne_out else fdtrc(count, dof, gain / count / left))
