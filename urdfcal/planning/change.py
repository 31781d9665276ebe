"""What a few poses, measured once and again later, tell of a change of the robot.

A change d of the joints' parameters moves what is read by H d. Where the instrument and its targets stand is found anew each time, so that
what is told of d is N = N_jj - N_jo (N_oo + D_oo^-2)^-1 N_oj, the other parameters marginalised; both times are noisy, which halves it. The
chi-square of the difference then has the noncentrality d' N d / 2.
"""

from __future__ import annotations

import math

import numpy as np

from urdfcal.base.geometry import MM, Array3, Matrix, Vector
from urdfcal.model.error_model import ErrorModel
from urdfcal.planning.selection import information

USUAL_CHANGE = 0.1  # of the joints' prior: a millimetre and a tenth of a degree where that is as usual
DETECTED, FALSE_ALARMS = 0.9, 0.01
_CHANGES = 400  # random ones
_MOST = 1e6  # [mm] of the tool; what needs a larger change is not seen at all


def changing(errors: ErrorModel) -> Vector:
    """Standard deviation of every parameter between two checks, (p,): joints by a tenth of their prior, all else as if it were new."""
    scale = [USUAL_CHANGE if parameter.kind == "joint" else 1.0 for parameter in errors.parameters]
    return np.asarray(errors.sigma * np.array(scale))


def detected_mm(errors: ErrorModel, H: Array3, M: Matrix, rng: np.random.Generator) -> float:
    """The tool's RMS change over the workspace that check poses show in nine of ten random changes of that size, at 1 % false alarms, [mm].

    Infinite where no change that could be is large enough.

    Args:
        errors: The error model.
        H: Whitened Jacobians of the poses, (n, k, p).
        M: Mean of J'J over the workspace, (p, p).
        rng: Draws the changes.
    """
    from scipy.stats import chi2, ncx2

    joint = np.array([parameter.kind == "joint" for parameter in errors.parameters])
    N, sigma = information(H), errors.sigma
    other = N[np.ix_(~joint, ~joint)] + np.diag(sigma[~joint] ** -2.0)
    told = (N[np.ix_(joint, joint)] - N[np.ix_(joint, ~joint)] @ np.linalg.solve(other, N[np.ix_(~joint, joint)])) / 2
    d = rng.normal(0.0, changing(errors)[joint], (_CHANGES, int(joint.sum())))
    moved = np.sqrt(np.einsum("ni,ij,nj->n", d, M[np.ix_(joint, joint)], d))
    per_mm = np.einsum("ni,ij,nj->n", d, told, d) * (MM / moved) ** 2
    numbers = int(np.any(H != 0, axis=2).sum())
    freedom = max(1, numbers - int((np.diag(N)[~joint] > 0).sum()))
    alarm = chi2.ppf(1 - FALSE_ALARMS, freedom)
    low, high = 0.0, 1e-3
    while high < _MOST and np.mean(ncx2.sf(alarm, freedom, per_mm * high**2)) < DETECTED:
        high *= 2
    if high >= _MOST:
        return math.inf
    for _ in range(30):
        middle = (low + high) / 2
        low, high = (low, middle) if np.mean(ncx2.sf(alarm, freedom, per_mm * middle**2)) >= DETECTED else (middle, high)
    return high
