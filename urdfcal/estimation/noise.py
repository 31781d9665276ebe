"""What the measurements are worth: noise of the readings and of the joints, the weights that follow, and whether residuals scatter so.

Joint readings are inputs: their noise reaches a reading through the joint Jacobian and differs from pose to pose, so the covariance of
one pose's numbers is R_i = R_readings + J_q R_q J_q'.

A fit draws predictions towards what was measured. With H the whitened Jacobian and P the covariance of the parameters, a whitened
residual has the variance 1 - h, h = diag(H P H') its leverage, so that the degrees of freedom of some numbers are sum(1 - h).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from urdfcal.base.geometry import Array3, Matrix, Vector
from urdfcal.estimation.residual import Linearisation

_LEAST_SIGMA = 1e-6  # [m], [rad] or [px]; no sensor sees less, and noise-free simulations end here
LEAST_FREEDOM = 20.0  # degrees of freedom; with fewer the residual says too little of the noise, and the start value stays
_CLOSE = 1e-3

_SURE = 4.0  # sigmas of chi-squared beyond which it is no chance


@dataclass(frozen=True)
class Weights:
    """Whitening of each pose's numbers: either factors (n, m) or (), or matrices (n, m, m)."""

    factor: Any

    @staticmethod
    def uniform(sigma: float) -> Weights:
        """The same standard deviation for every number."""
        return Weights(np.asarray(1 / sigma))

    def residual(self, linearisation: Linearisation) -> Vector:
        """Residual in units of its standard deviation, (n m,)."""
        return self._whitened(linearisation.residual[..., None]).ravel()

    def jacobian(self, linearisation: Linearisation) -> Matrix:
        """Jacobian of the whitened residual's prediction, (n m, p)."""
        return self._whitened(linearisation.jacobian).reshape(-1, linearisation.jacobian.shape[-1])

    def _whitened(self, rows: Array3) -> Array3:
        if self.factor.ndim == 3:
            return np.asarray(self.factor @ rows)
        return np.asarray(rows * (self.factor[..., None] if self.factor.ndim else self.factor))


@dataclass(frozen=True)
class Noise:
    """Standard deviations of what was measured.

    Attributes:
        sigma: Of each kind of number, (kinds,), where the measurement states none of its own: [m], [rad] or [px]; one may be given alone.
        joint_sigma: Of each measured joint, (inputs,), [rad] or [m].
        stated: Whether each sigma was stated, (kinds,); if not, it is estimated from the residual. One for all may be given.
    """

    sigma: Any
    joint_sigma: Vector
    stated: Any = True

    def __post_init__(self) -> None:
        sigma = np.atleast_1d(np.asarray(self.sigma, dtype=float))
        object.__setattr__(self, "sigma", sigma)
        object.__setattr__(self, "stated", np.broadcast_to(np.asarray(self.stated, dtype=bool), sigma.shape))

    @property
    def spot_sigma(self) -> float:
        """That of the first kind; of a spot coordinate where lasers were seen, [m]."""
        return float(self.sigma[0])

    @property
    def of_joints(self) -> bool:
        """Whether any joint reading is noisy."""
        return bool(np.any(self.joint_sigma))

    @property
    def all_stated(self) -> bool:
        """Whether none of them is estimated."""
        return bool(self.stated.all())

    def weights(self, linearisation: Linearisation) -> Weights:
        """Whitening at one linearisation."""
        if not self.of_joints:
            return Weights(1 / self.of_numbers(linearisation))
        return Weights(np.linalg.inv(np.linalg.cholesky(self.pose_covariance(linearisation))))

    def pose_covariance(self, linearisation: Linearisation) -> Array3:
        """R_i = R_spot + J_q R_q J_q' of every pose, (n, m, m); what was not measured has unit variance."""
        reach = linearisation.joint_jacobian * self.joint_sigma if self.of_joints else np.zeros((*linearisation.residual.shape, 1))
        R = reach @ reach.transpose(0, 2, 1)
        numbers = np.arange(linearisation.residual.shape[1])
        R[:, numbers, numbers] += np.where(linearisation.measured, self.of_numbers(linearisation) ** 2, 1.0)
        return np.asarray(R)

    def times(self, factor: Any) -> Noise:
        """The same with every sigma, or each by its own factor (kinds,), that many times as large."""
        return replace(self, sigma=np.maximum(self.sigma * factor, _LEAST_SIGMA))

    def of_numbers(self, linearisation: Linearisation) -> Matrix:
        """Standard deviation of each number, the readings of joints left out, (n, m)."""
        return np.where(np.isnan(linearisation.stated_sigma), self.sigma[linearisation.kinds], linearisation.stated_sigma)

    def chi_squared(self, linearisation: Linearisation) -> float:
        """Sum of the squared whitened residuals."""
        whitened = self.weights(linearisation).residual(linearisation)
        return float(whitened @ whitened)

    def estimated(self, linearisation: Linearisation, degrees_of_freedom: Any) -> Noise:
        """The noise that would make chi-squared of each kind equal its degrees of freedom (kinds,), one fixed-point step on from this.

        Both are of numbers that do not state their noise.

        What was stated stays, and so does a kind with fewer than LEAST_FREEDOM: a fit that nearly runs through its data says nothing
        of their noise.
        """
        freedom = np.atleast_1d(degrees_of_freedom)
        squares = (self.weights(linearisation).residual(linearisation) ** 2).reshape(linearisation.residual.shape)
        chi_squared = linearisation.of_kinds(squares * linearisation.unstated)
        fixed = self.stated | (freedom < LEAST_FREEDOM)
        return self.times(np.where(fixed, 1.0, np.sqrt(chi_squared / np.maximum(freedom, 1.0))))

    def close_to(self, other: Noise, linearisation: Linearisation) -> bool:
        """Whether another estimate of the noise is the same for all purposes: joint readings may hide a sensor's own noise."""
        own, old = (np.diagonal(each.pose_covariance(linearisation), axis1=1, axis2=2)[linearisation.measured] for each in (self, other))
        return bool(np.max(np.abs(np.sqrt(own / old) - 1), initial=0.0) < _CLOSE)


@dataclass(frozen=True)
class Misfit:
    """How a kind of reading scatters.

    Attributes:
        chi_squared: Per degree of freedom.
        freedom: Degrees of freedom.
    """

    chi_squared: float
    freedom: float

    @property
    def odd(self) -> bool:
        """Whether it is no chance that they scatter more, or less, than the noise says."""
        return self.freedom >= LEAST_FREEDOM and abs(self.sigmas) > _SURE

    @property
    def sigmas(self) -> float:
        """How many of its own standard deviations chi-squared is too large."""
        return (self.chi_squared - 1) / float(np.sqrt(2 / max(self.freedom, 1.0)))


def misfits(linearisation: Linearisation, noise: Noise, P: Matrix) -> tuple[Misfit, ...]:
    """One for each kind of reading, in the order of the noise.

    Args:
        linearisation: Residual and Jacobian at the estimate.
        noise: Of the measurements.
        P: Covariance of the parameters, (p, p).

    Returns:
        Of a kind of which any state their own noise, that of those alone.
    """
    weights, read = noise.weights(linearisation), linearisation.read
    stating = read & ~linearisation.unstated
    own = np.where((linearisation.of_kinds(stating) > 0)[linearisation.kinds], stating, read)
    squares = np.where(own, (weights.residual(linearisation) ** 2).reshape(own.shape), 0.0)
    free = np.where(own, 1 - linearisation.leverages(weights.jacobian(linearisation), P), 0.0)
    return tuple(
        Misfit(float(chi_squared / max(freedom, 1.0)), float(freedom))
        for chi_squared, freedom in zip(linearisation.of_kinds(squares), linearisation.of_kinds(free), strict=True)
    )
