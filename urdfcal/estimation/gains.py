"""What a further pose would gain: by how much it lowers the mean squared error of what is predicted.

With P the covariance of the parameters so far and M the mean of J'J over what is predicted, J its derivative per parameter, the mean
squared error is tr(P M). A pose with the whitened Jacobian H leaves P - P H' (I + H P H')^-1 H P, so it gains

    tr((I + H P H')^-1 H P M P H').
"""

from __future__ import annotations

import numpy as np

from urdfcal.base.geometry import Array3, Matrix, Vector


def gains(H: Array3, P: Matrix, M: Matrix) -> Vector:
    """By how much each pose would lower tr(P M), (m,).

    Args:
        H: Whitened Jacobians of the poses, (m, k, p).
        P: Covariance of the parameters, (p, p).
        M: Mean of J'J over what is predicted, (p, p).
    """
    HP = H @ P
    S = HP @ H.transpose(0, 2, 1) + np.eye(H.shape[1])
    return np.asarray(np.trace(np.linalg.solve(S, HP @ M @ HP.transpose(0, 2, 1)), axis1=1, axis2=2))
