"""What residuals say of something that the model lacks: a score test, with evidence in place of a p-value.

A nuisance is a few columns B beside the Jacobian, with unknown coefficients b ~ N(0, tau^2): y = H x + B b + noise, all whitened. What
the fit has left of the data, r = y - H x, is M y with M = I - H P H' = (I + H P0 H')^-1, so that without another fit

    s = B' M y = B' r,    F = B' M B,    b | y ~ N(C s, C),  C = (F + tau^-2 I)^-1

and the log evidence for the nuisance is, with the eigenvalues l_i of F and w the score in their directions,

    gain(tau) = 1/2 sum of [tau^2 w_i^2 / (1 + tau^2 l_i) - log(1 + tau^2 l_i)]

where the noise is stated. Where it is estimated, what the nuisance explains leaves less of it: q, the first sum, is to be read as
-N log(1 - q / y'M y) of N numbers. How large a nuisance may be is not known beforehand: tau is the best of a few sizes, and what looking
at several costs is taken off the gain, log of their number.

One that stands out explains some of what others seem to. So it goes into H, with its prior into P0, before they are asked again.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from urdfcal.base.geometry import Array3, Matrix, Vector
from urdfcal.estimation.ekf import Belief
from urdfcal.estimation.noise import Noise
from urdfcal.estimation.residual import Linearisation

SIZES = np.array([0.1, 0.3, 1.0, 3.0, 10.0])  # times the usual one that a nuisance may have
_NEAR_ALL = 0.98  # share of the misfit beyond which nothing explains it

Columns = Sequence[int] | npt.NDArray[np.intp]


@dataclass(frozen=True)
class Fitted:
    """A fit to which questions are put, whitened.

    Attributes:
        H: Jacobian, (N, p), by the parameters in units of their prior sigmas.
        y: Data less what the prior expects, (N,).
        numbers: How many numbers decide the noise; none where it is stated.
    """

    H: Matrix
    y: Vector
    numbers: int

    @staticmethod
    def of(linearisation: Linearisation, noise: Noise, x: Vector, prior: Belief) -> Fitted:
        """A fit, from its linearisation at the estimate x."""
        weights, sigma = noise.weights(linearisation), np.sqrt(np.diag(prior.P))
        H = weights.jacobian(linearisation) * sigma
        y = weights.residual(linearisation) + H @ ((x - prior.x) / sigma)
        return Fitted(H, y, 0 if noise.all_stated else linearisation.count)

    def beside(self, B: Matrix) -> Fitted:
        """The same fit with whitened columns in it, in units of their prior sigmas."""
        return replace(self, H=np.column_stack([self.H, B]))

    @cached_property
    def P(self) -> Matrix:
        """Covariance of the parameters, in units of their prior sigmas, (p, p)."""
        return np.linalg.inv(self.H.T @ self.H + np.eye(self.H.shape[1]))

    @cached_property
    def r(self) -> Vector:
        """What is left, M y, (N,)."""
        return self.y - self.H @ (self.P @ (self.H.T @ self.y))

    @cached_property
    def total(self) -> float:
        """Y' M y: what there is to explain."""
        return float(self.y @ self.r)

    def asked(self, B: Matrix) -> Score:
        """What the residual says of some whitened columns, (N, k)."""
        through = self.H.T @ B
        F = B.T @ B - through.T @ self.P @ through
        return Score(B.T @ self.r, (F + F.T) / 2, self.total, self.numbers)

    def asked_in_pairs(self, columns: Array3) -> Iterator[Score]:
        """The same of many pairs of whitened columns, (N, 2, pairs), each pair by itself."""
        through = np.einsum("np,nck->pck", self.H, columns, optimize=True)
        s = np.einsum("n,nck->kc", self.r, columns, optimize=True)
        F = np.einsum("nck,ndk->kcd", columns, columns, optimize=True) - np.einsum("pck,pq,qdk->kcd", through, self.P, through, optimize=True)
        for own, information in zip(s, F, strict=True):
            yield Score(own, information, self.total, self.numbers)


@dataclass(frozen=True)
class Score:
    """A nuisance as the residual has it, in units of its usual size.

    Attributes:
        s: Score, (k,).
        F: Information beside the parameters, (k, k).
        total: What there is to explain.
        numbers: How many numbers decide the noise; none where it is stated.
    """

    s: Vector
    F: Matrix
    total: float
    numbers: int

    def part(self, columns: Columns) -> Score:
        """Of some of the columns."""
        return replace(self, s=self.s[columns], F=self.F[np.ix_(columns, columns)])

    @cached_property
    def _directions(self) -> tuple[Vector, Vector]:
        """Information and squared score along the principal directions."""
        values, vectors = np.linalg.eigh(self.F)
        return np.maximum(values, 0.0), (vectors.T @ self.s) ** 2

    @cached_property
    def gains(self) -> Vector:
        """Log evidence for every one of SIZES."""
        values, squares = self._directions
        grown = SIZES[:, None] ** 2
        explained = (grown * squares / (1 + grown * values)).sum(axis=1)
        if self.numbers:
            explained = -self.numbers * np.log1p(-np.minimum(explained / self.total, _NEAR_ALL))
        return np.asarray(0.5 * (explained - np.log1p(grown * values).sum(axis=1)))

    @property
    def gain(self) -> float:
        """Log evidence of the nuisance, [nats]."""
        return float(self.gains.max() - np.log(len(SIZES)))

    @property
    def size(self) -> float:
        """How many times the usual one, by the data."""
        return float(SIZES[int(np.argmax(self.gains))])
