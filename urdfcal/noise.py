"""What the measurements are worth: spot noise, joint noise, and the weights that follow from them.

Joint readings are inputs: their noise reaches a spot through the joint Jacobian and differs from pose to pose, so the covariance of
one pose's spots is R_i = R_spot + J_q R_q J_q'.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from urdfcal.geometry import MM, Array3, Matrix, Vector

START_SPOT_SIGMA = 1.0 * MM
_LEAST_SPOT_SIGMA = 1e-6  # [m]; no camera sees less, and noise-free simulations end here
LEAST_FREEDOM = 20.0  # degrees of freedom; with fewer the residual says too little of the noise, and the start value stays
_CLOSE = 1e-3


@dataclass(frozen=True)
class Linearisation:
    """Residual and Jacobian of a whole set of poses at one state.

    Attributes:
        residual: m - h(x), (n, m), 0 where nothing was measured.
        jacobian: (n, m, p), 0 where nothing was measured.
        joint_jacobian: Derivative by the measured joints, (n, m, inputs).
        measured: Which of the m numbers of each pose were measured, (n, m).
        stated_sigma: Standard deviation stated with each number, (n, m), nan for none.
        trouble: A key of `ekf.STOPS` if the model cannot produce what was measured, else empty.
    """

    residual: Matrix
    jacobian: Array3
    joint_jacobian: Array3
    measured: Any
    stated_sigma: Matrix
    trouble: str = ""

    @property
    def usable(self) -> bool:
        """Whether the model produces everything that was measured."""
        return not self.trouble

    @property
    def count(self) -> int:
        """How many numbers were measured."""
        return int(np.count_nonzero(self.measured))

    @property
    def rms(self) -> float:
        """Root of the mean squared residual of the measured numbers."""
        return float(np.linalg.norm(self.residual) / np.sqrt(max(self.count, 1)))


@dataclass(frozen=True)
class Weights:
    """Whitening of each pose's numbers: either factors (n, m) or (), or matrices (n, m, m)."""

    factor: Any

    @staticmethod
    def uniform(sigma: float) -> Weights:
        """The same standard deviation for every number."""
        return Weights(np.asarray(1 / sigma))

    def residual(self, here: Linearisation) -> Vector:
        """Residual in units of its standard deviation, (n m,)."""
        return self._whitened(here.residual[..., None]).ravel()

    def jacobian(self, here: Linearisation) -> Matrix:
        """Jacobian of the whitened residual's prediction, (n m, p)."""
        return self._whitened(here.jacobian).reshape(-1, here.jacobian.shape[-1])

    def _whitened(self, rows: Array3) -> Array3:
        if self.factor.ndim == 3:
            return np.asarray(self.factor @ rows)
        return np.asarray(rows * (self.factor[..., None] if self.factor.ndim else self.factor))


@dataclass(frozen=True)
class Noise:
    """Standard deviations of what was measured.

    Attributes:
        spot_sigma: Of a spot coordinate, [m], where the measurement states none of its own.
        joint_sigma: Of each measured joint, (inputs,), [rad] or [m].
        stated: Whether spot_sigma was stated; if not, it is estimated from the residual.
    """

    spot_sigma: float
    joint_sigma: Vector
    stated: bool = True

    def weights(self, here: Linearisation) -> Weights:
        """Whitening at one linearisation."""
        if not np.any(self.joint_sigma):
            return Weights(1 / self._sigma(here))
        return Weights(np.linalg.inv(np.linalg.cholesky(self.pose_covariance(here))))

    def pose_covariance(self, here: Linearisation) -> Array3:
        """R_i = R_spot + J_q R_q J_q' of every pose, (n, m, m); what was not measured has unit variance."""
        reach = here.joint_jacobian * self.joint_sigma if np.any(self.joint_sigma) else np.zeros((*here.residual.shape, 1))
        R = reach @ reach.transpose(0, 2, 1)
        numbers = np.arange(here.residual.shape[1])
        R[:, numbers, numbers] += np.where(here.measured, self._sigma(here) ** 2, 1.0)
        return np.asarray(R)

    def times(self, factor: float) -> Noise:
        """The same with the spot noise that many times as large."""
        return replace(self, spot_sigma=max(self.spot_sigma * factor, _LEAST_SPOT_SIGMA))

    def _sigma(self, here: Linearisation) -> Matrix:
        return np.where(np.isnan(here.stated_sigma), self.spot_sigma, here.stated_sigma)

    def chi_squared(self, here: Linearisation) -> float:
        """Sum of the squared whitened residuals."""
        whitened = self.weights(here).residual(here)
        return float(whitened @ whitened)

    def estimated(self, here: Linearisation, degrees_of_freedom: float) -> Noise:
        """The spot noise that would make chi-squared equal its degrees of freedom, one fixed-point step on from this one.

        With fewer than LEAST_FREEDOM it stays as it is: a fit that nearly runs through its data says nothing of their noise.
        """
        if degrees_of_freedom < LEAST_FREEDOM:
            return self
        ratio = self.chi_squared(here) / degrees_of_freedom
        return self.times(float(np.sqrt(ratio)))

    def close_to(self, other: Noise) -> bool:
        """Whether another estimate of the spot noise is the same for all purposes."""
        return abs(self.spot_sigma / other.spot_sigma - 1) < _CLOSE
