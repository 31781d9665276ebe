"""Poses chosen one by one so that a criterion gets as small as it can: greedy design, then exchanges.

With P the covariance of the parameters so far and M the mean of J'J over the workspace, J the motion of the tool's origin per parameter,
the tool's mean squared error is tr(P M). What a further pose gains of it is worked out in `estimation.gains`, and of all candidates the
one that gains most is taken, pose after pose. What so many poses gain grows with ever smaller steps, of which
greedy choices are known to get the better part (Krause, Singh and Guestrin, 2008, for mutual information), though not all. So poses
are then exchanged (Fedorov, 1972): each in turn is taken out, and the candidate that gains most without it is put in its place, until
none gains. Other criteria (`criteria`) are served in the same way.
"""

from __future__ import annotations

import numpy as np

from urdfcal.base.geometry import Array3, Matrix, Vector
from urdfcal.base.interrupts import enough
from urdfcal.planning.criteria import Criterion, Rows

_PASSES = 30  # of exchanges over all poses
_ROUNDING = 1e-9  # share of a gain


def greedy(H: Array3, criterion: Criterion, n: int, known: Matrix | None = None) -> tuple[Rows, Vector]:
    """Choose poses.

    Args:
        H: Whitened Jacobians of the candidates, (m, k, p).
        criterion: What is to be made small.
        n: How many, at most m.
        known: Information of what was measured before, the sum of its H'H, (p, p).

    Returns:
        Which candidates, (n,), in the order in which they were chosen, and what is left before the first and after each, (n + 1,).
    """
    told = _nothing(H) if known is None else known
    chosen: list[int] = []
    left = [criterion.left(told)]
    for _ in range(n):
        gain = criterion.gains(H, told, np.array(chosen, dtype=np.intp))
        gain[chosen] = -np.inf
        best = int(np.argmax(gain))
        chosen.append(best)
        told = told + information(H[best])
        left.append(criterion.left(told))
    return np.array(chosen, dtype=np.intp), np.array(left)


def exchanged(H: Array3, criterion: Criterion, chosen: Rows, known: Matrix | None = None) -> tuple[Rows, Vector]:
    """As many poses that are no worse: each one exchanged for the candidate that gains most in its place, until none gains.

    Args:
        H: Whitened Jacobians of the candidates, (m, k, p).
        criterion: What is to be made small.
        chosen: Which candidates were chosen so far, (n,).
        known: Information of what was measured before, (p, p).

    Returns:
        As `greedy`: which candidates, the most telling first, and what is left before the first and after each.
    """
    chosen = chosen.copy()
    before = _nothing(H) if known is None else known
    for _ in range(_PASSES):
        swapped = False
        for place in range(len(chosen)):
            if enough():
                break
            others = np.delete(chosen, place)
            gain = criterion.gains(H, before + information(H[others]), others)
            gain[others] = -np.inf
            best = int(np.argmax(gain))
            if gain[best] - gain[chosen[place]] > _ROUNDING * abs(gain[best]):
                chosen[place], swapped = best, True
        if not swapped:
            break
    order, left = greedy(H[chosen], criterion, len(chosen), known)
    return chosen[order], left


def fewest(H: Array3, criterion: Criterion, chosen: Rows, left: Vector, enough: float, known: Matrix | None = None) -> tuple[Rows, Vector]:
    """As few of greedily chosen poses (n,), exchanged, as leave no more than is enough; all of them where that is not reached.

    Args:
        H: Whitened Jacobians of the candidates, (m, k, p).
        criterion: What is to be made small.
        chosen: Which candidates were chosen, in the order in which they were.
        left: What that left, (n + 1,).
        enough: What may be left.
        known: Information of what was measured before, (p, p).
    """
    n = max(1, int(np.argmax(np.append(left[1:-1] <= enough, True))) + 1)
    best = exchanged(H, criterion, chosen[:n], known)
    while n > 1 and best[1][-1] <= enough:
        n -= 1
        fewer = exchanged(H, criterion, best[0][:n], known)
        if fewer[1][-1] > enough:
            break
        best = fewer
    return best


def information(H: Array3) -> Matrix:
    """The sum of H'H over some poses, (..., k, p) -> (p, p)."""
    rows = H.reshape(-1, H.shape[-1])
    return np.asarray(rows.T @ rows)


def expected(H: Array3, criterion: Criterion, rows: Rows, known: Matrix | None = None) -> float:
    """What is left of a criterion once some of the candidates were measured."""
    return criterion.left(information(H[rows]) + (0.0 if known is None else known))


def _nothing(H: Array3) -> Matrix:
    return np.zeros((H.shape[-1],) * 2)
