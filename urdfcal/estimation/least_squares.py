"""Plain least squares by SciPy's Levenberg-Marquardt with the analytic Jacobian; the prior enters as extra residuals.

minimise |W (m - h(x))|^2 + (x - x0)' P0^-1 (x - x0)
"""

from __future__ import annotations

import numpy as np

from urdfcal.base.geometry import Matrix, Vector
from urdfcal.estimation.ekf import Belief, Estimate, Sweep, degrees_of_freedom
from urdfcal.estimation.noise import Noise
from urdfcal.estimation.residual import Linearise

_ROUNDS = 20


def levenberg_marquardt(
    linearise: Linearise,
    prior: Belief,
    noise: Noise,
    *,
    start: Vector | None = None,
    tolerance: float = 1e-12,
    max_sweeps: int | None = None,
) -> Estimate:
    """The maximum a posteriori estimate by Levenberg-Marquardt.

    Weights are taken at the start of each round and held while SciPy works; spot noise that is not stated is estimated between rounds.

    Args:
        linearise: Residual and Jacobian of the whole set at a state.
        prior: Before the data.
        noise: Of the measurements.
        start: Where to begin; the prior mean if None.
        tolerance: SciPy's ftol, xtol and gtol.
        max_sweeps: How many residuals SciPy may ask for.
    """
    from scipy.optimize import least_squares

    scale, x = np.sqrt(np.diag(prior.P)), prior.x if start is None else start
    history = [Sweep(x, np.nan, linearise(x).rms)]
    for _ in range(_ROUNDS):
        linearisation = linearise(x)
        if not linearisation.usable:
            return Estimate(Belief(x, prior.P), linearisation.trouble, noise, history)
        weights, last = noise.weights(linearisation), x

        def residuals(u: Vector, weights: object = weights) -> Vector:
            return np.concatenate([-weights.residual(linearise(prior.x + scale * u)), u])  # type: ignore[attr-defined]

        def jacobian(u: Vector, weights: object = weights) -> Matrix:
            return np.vstack([weights.jacobian(linearise(prior.x + scale * u)) * scale, np.eye(len(u))])  # type: ignore[attr-defined]

        found = least_squares(
            residuals, (x - prior.x) / scale, jac=jacobian, method="lm", ftol=tolerance, xtol=tolerance, gtol=tolerance, max_nfev=max_sweeps
        )
        x = prior.x + scale * found.x
        linearisation = linearise(x)
        history.append(Sweep(x, float(np.linalg.norm(x - last)), linearisation.rms))
        J = jacobian(found.x)
        P = np.linalg.inv(J.T @ J) * np.outer(scale, scale)
        belief = Belief(x, (P + P.T) / 2)
        if not found.success:
            return Estimate(belief, "max_sweeps", noise, history)
        better = noise.estimated(linearisation, degrees_of_freedom(linearisation, noise, belief))
        rest = np.max(np.abs(x - last) / np.sqrt(np.diag(P))) < 1e-6
        if better.close_to(noise, linearisation) and (rest or not noise.of_joints):
            return Estimate(belief, "converged", noise, history)
        noise = better
    return Estimate(belief, "max_sweeps", noise, history)
