"""Poses chosen one by one so that what is predicted of the tool gets as sure as it can: greedy I-optimal design.

With P the covariance of the parameters so far and M the mean of J'J over the workspace, J the motion of the tool's origin per parameter,
the tool's mean squared error is tr(P M). What a further pose gains of it is worked out in `estimation.gains`, and of all candidates the
one that gains most is taken, pose after pose. What so many poses gain grows with ever smaller steps, of which
greedy choices are known to get the better part (Krause, Singh and Guestrin, 2008, for mutual information), though not all. So poses
are then exchanged (Fedorov, 1972): each in turn is taken out, and the candidate that gains most without it is put in its place, until
none gains.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from urdfcal.base.geometry import Array3, Matrix, Vector
from urdfcal.base.interrupts import enough
from urdfcal.calibration.analysis.more_poses import covariance
from urdfcal.estimation.gains import gains

_PASSES = 10  # of exchanges over all poses
_ROUNDING = 1e-9  # share of a gain


def greedy(H: Array3, sigma: Vector, M: Matrix, n: int, known: Matrix | None = None) -> tuple[npt.NDArray[np.intp], Vector]:
    """Choose poses.

    Args:
        H: Whitened Jacobians of the candidates, (m, k, p).
        sigma: Prior standard deviations, (p,).
        M: Mean of J'J over the workspace, (p, p).
        n: How many, at most m.
        known: Information of what was measured before, the sum of its H'H, (p, p).

    Returns:
        Which candidates, (n,), in the order in which they were chosen, and tr(P M) before the first and after each, (n + 1,).
    """
    told = np.zeros_like(M) if known is None else known
    P = covariance(told, sigma)
    chosen: list[int] = []
    left = [float(np.sum(P * M))]
    for _ in range(n):
        gain = gains(H, P, M)
        gain[chosen] = -np.inf
        best = int(np.argmax(gain))
        chosen.append(best)
        told = told + information(H[best])
        P = covariance(told, sigma)
        left.append(float(np.sum(P * M)))
    return np.array(chosen, dtype=np.intp), np.array(left)


def exchanged(
    H: Array3, sigma: Vector, M: Matrix, chosen: npt.NDArray[np.intp], known: Matrix | None = None
) -> tuple[npt.NDArray[np.intp], Vector]:
    """As many poses that are no worse: each one exchanged for the candidate that gains most in its place, until none gains.

    Args:
        H: Whitened Jacobians of the candidates, (m, k, p).
        sigma: Prior standard deviations, (p,).
        M: Mean of J'J over the workspace, (p, p).
        chosen: Which candidates were chosen so far, (n,).
        known: Information of what was measured before, (p, p).

    Returns:
        As `greedy`: which candidates, the most telling first, and tr(P M) before the first and after each.
    """
    chosen = chosen.copy()
    before = np.zeros_like(M) if known is None else known
    for _ in range(_PASSES):
        swapped = False
        for place in range(len(chosen)):
            if enough():
                break
            others = np.delete(chosen, place)
            gain = gains(H, covariance(before + information(H[others]), sigma), M)
            gain[others] = -np.inf
            best = int(np.argmax(gain))
            if gain[best] > gain[chosen[place]] * (1 + _ROUNDING):
                chosen[place], swapped = best, True
        if not swapped:
            break
    order, left = greedy(H[chosen], sigma, M, len(chosen), known)
    return chosen[order], left


def information(H: Array3) -> Matrix:
    """The sum of H'H over some poses, (..., k, p) -> (p, p)."""
    rows = H.reshape(-1, H.shape[-1])
    return np.asarray(rows.T @ rows)


def expected(H: Array3, sigma: Vector, M: Matrix, rows: npt.NDArray[np.intp], known: Matrix | None = None) -> float:
    """tr(P M) once some of the candidates were measured."""
    return float(np.sum(covariance(information(H[rows]) + (0.0 if known is None else known), sigma) * M))
