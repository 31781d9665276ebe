"""What makes poses good ones: the criteria of optimal design, each as something that is to be made small.

With N the information of the poses, the sum of their whitened H'H, and D the prior standard deviations:

    I        tr(P M), P = (N + D^-2)^-1: the tool's mean squared error over a workspace (`selection`)
    D        det: the volume of the parameters' uncertainty
    A        tr: the mean variance of the parameters in units of their priors
    E        the largest such variance of any direction
    O1 - O5  the observability indices, by the singular values of the stacked H D (`estimation.identifiability` has them)

All but the first look at those directions alone that all candidates together tell anything of, since what nobody can see would decide all
by itself, and they count the prior as rows of its own, [H D V; I], so that they are defined from the first pose on.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
import numpy.typing as npt

from urdfcal.base.geometry import Array3, Matrix, Vector
from urdfcal.calibration.analysis.more_poses import covariance
from urdfcal.estimation.gains import gains
from urdfcal.estimation.identifiability import indices

NAMES = ("I", "D", "A", "E", "O1", "O2", "O3", "O4", "O5")
_SEEN = 1.0  # [prior variances] of a direction that candidates tell more of than the prior does
_AT_ONCE = 64  # candidates whose eigenvalues are found at once
_TINY = 1e-12
Rows = npt.NDArray[np.intp]


class Criterion(Protocol):
    """What is to be made small."""

    def left(self, N: Matrix) -> float:
        """What there is of it once poses of information N (p, p) were measured."""

    def gains(self, H: Array3, N: Matrix, taken: Rows) -> Vector:
        """By how much each of some candidates with the whitened Jacobians H (m, k, p) would make it smaller, (m,).

        Those of which it is clear that another one, none of the taken rows, is better may have -inf.
        """


@dataclass(frozen=True, eq=False)
class Traced:
    """tr(P M): of the mean J'J over a workspace, the tool's mean squared error.

    Attributes:
        sigma: Prior standard deviations, (p,).
        M: (p, p).
    """

    sigma: Vector
    M: Matrix

    def left(self, N: Matrix) -> float:
        """See `Criterion`."""
        return float(np.sum(covariance(N, self.sigma) * self.M))

    def gains(self, H: Array3, N: Matrix, taken: Rows) -> Vector:
        """See `Criterion`."""
        return gains(H, covariance(N, self.sigma), self.M)


@dataclass(frozen=True, eq=False)
class Volume:
    """The logarithm of the determinant of the covariance, in units of the prior.

    Attributes:
        scaled: From whitened Jacobians (..., p) to those of seen directions in units of the prior, (p, r).
    """

    scaled: Matrix

    def left(self, N: Matrix) -> float:
        """See `Criterion`."""
        return -float(np.linalg.slogdet(_with_prior(self.scaled.T @ N @ self.scaled))[1])

    def gains(self, H: Array3, N: Matrix, taken: Rows) -> Vector:
        """See `Criterion`."""
        rows = H @ self.scaled
        before = np.linalg.inv(_with_prior(self.scaled.T @ N @ self.scaled))
        return np.asarray(np.linalg.slogdet(_with_prior(rows @ before @ rows.transpose(0, 2, 1)))[1])


@dataclass(frozen=True, eq=False)
class Spectral:
    """Some index of the singular values of the stacked Jacobian, which is to be large.

    Attributes:
        scaled: As for `Volume`.
        index: Of singular values in rising order, (..., r) -> (...).
        summed: Whether it is that of all of them, 1 / (1/s_1 + ... + 1/s_r), and not of the first and last alone.
    """

    scaled: Matrix
    index: Callable[[Matrix], Vector]
    summed: bool = False

    def left(self, N: Matrix) -> float:
        """See `Criterion`."""
        return -float(self._of(self.scaled.T @ N @ self.scaled))

    def gains(self, H: Array3, N: Matrix, taken: Rows) -> Vector:
        """See `Criterion`; what cannot be the best by its bound is not worked out."""
        rows, before = H @ self.scaled, self.scaled.T @ N @ self.scaled
        bounds = self._bounds(rows, before)
        bounds[taken] = -np.inf
        after, order = np.full(len(rows), -np.inf), np.argsort(-bounds)
        for start in range(0, len(order), _AT_ONCE):
            part = rows[order[start : start + _AT_ONCE]]
            if after.max() >= bounds[order[start]]:
                break
            after[order[start : start + _AT_ONCE]] = self._of(before + part.transpose(0, 2, 1) @ part)
        return np.asarray(after - self._of(before))

    def _bounds(self, rows: Array3, before: Matrix) -> Vector:
        """What the index is at most after each candidate, (m,).

        The smallest eigenvalue rises by no more than the candidate tells of its direction, the largest does not fall; and the sum of
        1 / s is convex, so that it lies above its tangent.
        """
        values, vectors = np.linalg.eigh(_with_prior(before))
        told = np.sum((rows @ vectors) ** 2, axis=1)
        if self.summed:
            return np.asarray(1 / np.maximum(np.sum(values**-0.5) - told @ values**-1.5 / 2, _TINY))
        s = np.repeat(np.sqrt(values)[None], len(rows), axis=0)
        s[:, 0] = np.sqrt(values[0] + told[:, 0])
        return np.asarray(self.index(s))

    def _of(self, information: Array3) -> Vector:
        return self.index(np.sqrt(np.linalg.eigvalsh(_with_prior(information))))


_INDEX: dict[str, Callable[[Matrix], Vector]] = {
    "E": lambda s: s[..., 0] ** 2,
    "O2": lambda s: s[..., 0] / s[..., -1],
    "O3": lambda s: s[..., 0],
    "O4": lambda s: s[..., 0] ** 2 / s[..., -1],
    "O5": lambda s: 1 / np.sum(1 / s, axis=-1),
}


@dataclass(frozen=True, eq=False)
class Design:
    """What is chosen from, and what for.

    Attributes:
        H: Whitened Jacobians of all candidates, (m, k, p).
        sigma: Prior standard deviations, (p,).
        M: Mean of J'J over the workspace, J the motion of the tool, (p, p).
        known: Information of what was measured before, (p, p).
    """

    H: Array3
    sigma: Vector
    M: Matrix
    known: Matrix

    def by(self, name: str) -> Criterion:
        """The criterion of a name, one of NAMES."""
        if name == "I":
            return Traced(self.sigma, self.M)
        if name == "A":
            return Traced(self.sigma, self._seen @ self._seen.T / np.outer(self.sigma, self.sigma))
        scaled = self.sigma[:, None] * self._seen
        return Volume(scaled) if name in ("D", "O1") else Spectral(scaled, _INDEX[name], name == "O5")

    @cached_property
    def _seen(self) -> Matrix:
        """Directions in units of the prior that all candidates together tell of, as columns (p, r)."""
        rows = self.H.reshape(-1, self.H.shape[-1])
        values, vectors = np.linalg.eigh((rows.T @ rows + self.known) * np.outer(self.sigma, self.sigma))
        return np.asarray(vectors[:, values > min(_SEEN, values[-1] / 2)])

    def value(self, name: str, N: Matrix, poses: int) -> float:
        """What a criterion is for poses of information N, as it is defined: [mm] for I, in units of the prior for the others."""
        if name == "I":
            return float(np.sqrt(self.by(name).left(N))) * 1e3
        scaled = self.sigma[:, None] * self._seen
        s = np.sqrt(np.linalg.eigvalsh(_with_prior(scaled.T @ N @ scaled)))[::-1]
        by_name = {"D": float(np.exp(-2 * np.mean(np.log(s)))), "A": self.by("A").left(N) / len(s), "E": float(s[-1] ** -2)}
        return by_name[name] if name in by_name else indices(s, max(poses, 1))[name]


def _with_prior(information: Array3) -> Array3:
    return np.asarray(information + np.eye(information.shape[-1]))
