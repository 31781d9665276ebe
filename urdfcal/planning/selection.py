"""Poses chosen one by one so that what is predicted of the tool gets as sure as it can: greedy I-optimal design.

With P the covariance of the parameters so far and M the mean of J'J over the workspace, J the motion of the tool's origin per parameter,
the tool's mean squared error is tr(P M). A further pose with the whitened Jacobian H leaves P - P H' (I + H P H')^-1 H P, so it gains

    tr((I + H P H')^-1 H P M P H'),

and of all candidates the one that gains most is taken, pose after pose. What so many poses gain grows with ever smaller steps, of which
greedy choices are known to get the better part (Krause, Singh and Guestrin, 2008, for mutual information), though not all.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from urdfcal.base.geometry import Array3, Matrix, Vector
from urdfcal.calibration.analysis.more_poses import covariance


def greedy(H: Array3, sigma: Vector, M: Matrix, n: int) -> tuple[npt.NDArray[np.intp], Vector]:
    """Choose poses.

    Args:
        H: Whitened Jacobians of the candidates, (m, k, p).
        sigma: Prior standard deviations, (p,).
        M: Mean of J'J over the workspace, (p, p).
        n: How many, at most m.

    Returns:
        Which candidates, (n,), in the order in which they were chosen, and tr(P M) before the first and after each, (n + 1,).
    """
    information, P = np.zeros_like(M), np.diag(sigma**2)
    chosen: list[int] = []
    left = [float(np.sum(P * M))]
    for _ in range(n):
        gain = gains(H, P, M)
        gain[chosen] = -np.inf
        best = int(np.argmax(gain))
        chosen.append(best)
        information = information + H[best].T @ H[best]
        P = covariance(information, sigma)
        left.append(float(np.sum(P * M)))
    return np.array(chosen, dtype=np.intp), np.array(left)


def gains(H: Array3, P: Matrix, M: Matrix) -> Vector:
    """By how much each candidate would lower tr(P M), (m,)."""
    HP = H @ P
    S = HP @ H.transpose(0, 2, 1) + np.eye(H.shape[1])
    return np.asarray(np.trace(np.linalg.solve(S, HP @ M @ HP.transpose(0, 2, 1)), axis1=1, axis2=2))


def expected(H: Array3, sigma: Vector, M: Matrix, rows: npt.NDArray[np.intp]) -> float:
    """tr(P M) once some of the candidates were measured."""
    stacked = H[rows].reshape(-1, H.shape[2])
    return float(np.sum(covariance(stacked.T @ stacked, sigma) * M))
