"""What residuals say of something that the model lacks: a score test, with evidence in place of a p-value.

A nuisance is a few columns B beside the Jacobian, with unknown coefficients b ~ N(0, tau^2): y = H x + B b + noise, all whitened. What
the fit has left of the data, r = y - H x, is M y with M = I - H P H' = (I + H P0 H')^-1, so that without another fit

    s = B' M y = B' r,    F = B' M B,    b | y ~ N(C s, C),  C = (F + tau^-2 I)^-1

and the log evidence for the nuisance is, with the eigenvalues l_i of F and w the score in their directions,

    gain(tau) = 1/2 sum of [-N log(1 - q / y'M y) - log(1 + tau^2 l_i)],    q = sum of tau^2 w_i^2 / (1 + tau^2 l_i)

of N numbers, less those that went into the parameters: how large the noise is does not count, whether it was stated or not, so that noise
that is merely larger than it should be is no nuisance. How large a nuisance may be is not known beforehand: tau is the best of a few
sizes, and what looking at several costs is taken off the gain, log of their number.

One that stands out explains some of what others seem to. So it goes into H, with its prior into P0, before they are asked again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from urdfcal.base.geometry import Array3, Matrix, Vector
from urdfcal.estimation.ekf import Belief
from urdfcal.estimation.noise import Noise
from urdfcal.estimation.normal import Normal
from urdfcal.estimation.residual import Linearisation

SIZES = np.array([0.1, 0.3, 1.0, 3.0, 10.0])  # times the usual one that a nuisance may have
_EXACT = 1e-4  # share of the noise's variance, under which data are exact and say nothing more
_DIGITS = 1e12  # times as well as before that data may tell a parameter for sums in double precision
_NEAR_ALL = 0.98  # share of the misfit beyond which nothing explains it

Rows = npt.NDArray[np.intp]


@dataclass(frozen=True)
class Fitted:
    """A fit to which questions are put, whitened.

    Attributes:
        H: Jacobian, (N, p), by the parameters in units of their prior sigmas.
        y: Data less what the prior expects, (N,).
        numbers: Degrees of freedom: how many numbers there are, less the parameters that they decide.
        roots: What whitens further columns once more, (rows, m, m), where noise was added since; None where none was.
    """

    H: Matrix
    y: Vector
    numbers: float
    roots: Array3 | None = None

    @staticmethod
    def of(linearisation: Linearisation, noise: Noise, x: Vector, prior: Belief) -> Fitted:
        """A fit, from its linearisation at the estimate x; readings of one pose are one row, moved together by noise of joints."""
        weights, sigma = noise.weights(linearisation), np.sqrt(np.diag(prior.P))
        H = weights.of_poses(linearisation.jacobian).reshape(-1, len(x)) * sigma
        y = weights.of_poses(linearisation.residual[..., None]).ravel() + H @ ((x - prior.x) / sigma)
        decided = float(np.sum(1 - np.diag(np.linalg.inv(H.T @ H + np.eye(H.shape[1])))))
        return Fitted(H, y, max(linearisation.count - decided, 1.0))

    def thinned(self, rows: int, stride: int) -> Fitted:
        """The same fit of one row of so many, of `rows` in all."""
        H, y = (own.reshape(rows, -1, *own.shape[1:])[::stride] for own in (self.H, self.y))
        roots = None if self.roots is None else self.roots[::stride]
        return Fitted(H.reshape(-1, H.shape[-1]), y.ravel(), self.numbers * len(H) / rows, roots)

    def spread(self, roots: Array3) -> Fitted:
        """The same fit where the noise of some numbers belongs together: rows times the roots of its inverse, (rows, m, m)."""
        return replace(self, H=rows_times(roots, self.H), y=rows_times(roots, self.y[:, None])[:, 0], roots=roots)

    def weighed(self, weights: Vector) -> tuple[float, float]:
        """Log evidence, and what there is to explain, of the same fit where every number is so many times as precise, (N,)."""
        rows = self._side_by_side * weights[:, None]
        normal = Normal.of(rows.T @ rows)
        information = normal.A + np.eye(len(normal.b))
        total = normal.c - float(normal.b @ np.linalg.solve(information, normal.b))
        return -0.5 * (self.numbers * float(np.log(total)) + float(np.linalg.slogdet(information)[1])), total

    @cached_property
    def _side_by_side(self) -> Matrix:
        return np.column_stack([self.H, self.y])

    def _spread(self, columns: Matrix) -> Matrix:
        return columns if self.roots is None else rows_times(self.roots, columns)

    @cached_property
    def tells(self) -> bool:
        """Whether there is anything left to explain, and digits to do so: not of exact data."""
        return self.total > _EXACT * self.numbers and float(np.max(np.sum(self.H**2, axis=0), initial=0.0)) < _DIGITS

    @cached_property
    def log_evidence(self) -> float:
        """Of the data, less what their whitening adds and a constant."""
        volume = float(np.linalg.slogdet(self._information)[1])
        return -0.5 * (self.numbers * float(np.log(self.total)) + volume)

    def predicted(self, folds: Sequence[Rows], rows: int) -> float:
        """Log density of the numbers of some rows, each fold predicted by a fit of all others, the noise included that they tell.

        What the poses of a fold have in common beyond the parameters' mean is left out.

        Args:
            folds: Rows of each fold.
            rows: How many there are in all.
        """
        H, y = self.H.reshape(rows, -1, self.H.shape[1]), self.y.reshape(rows, -1)
        A, b = self.H.T @ self.H, self.H.T @ self.y
        density = 0.0
        for held in folds:
            own, left = H[held].reshape(-1, H.shape[2]), np.delete(np.arange(rows), held)
            P = np.linalg.inv(A - own.T @ own + np.eye(len(b)))
            x = P @ (b - own.T @ y[held].ravel())
            rest = float(np.sum((y[left] - H[left] @ x) ** 2)) + float(x @ x)
            scale = rest / max(self.numbers * len(left) / rows, 1.0)
            seen = np.abs(H[held]).sum(axis=2) > 0
            spread = H[held] @ P @ H[held].transpose(0, 2, 1) + np.eye(H.shape[1])
            off = np.where(seen, y[held] - H[held] @ x, 0.0)
            squares = float(np.sum(off * np.linalg.solve(spread, off[..., None])[..., 0]))
            density -= 0.5 * (squares / scale + float(np.sum(np.linalg.slogdet(spread)[1])) + np.count_nonzero(seen) * float(np.log(scale)))
        volume = 0.0 if self.roots is None else float(np.sum(np.linalg.slogdet(self.roots)[1]))
        return density + volume

    def beside(self, B: Matrix) -> Fitted:
        """The same fit with whitened columns in it, in units of their prior sigmas."""
        return replace(self, H=np.column_stack([self.H, self._spread(B)]))

    @cached_property
    def P(self) -> Matrix:
        """Covariance of the parameters, in units of their prior sigmas, (p, p)."""
        return np.asarray(np.linalg.inv(self._information))

    @cached_property
    def _information(self) -> Matrix:
        return np.asarray(self.H.T @ self.H + np.eye(self.H.shape[1]))

    @cached_property
    def x(self) -> Vector:
        """The parameters, in units of their prior sigmas, (p,)."""
        return np.asarray(self.P @ (self.H.T @ self.y))

    @cached_property
    def r(self) -> Vector:
        """What is left, M y, (N,)."""
        return np.asarray(self.y - self.H @ self.x)

    @cached_property
    def total(self) -> float:
        """What there is to explain: y' M y, as what is left and how far the parameters had to go."""
        return float(self.r @ self.r + self.x @ self.x)

    def asked(self, B: Matrix) -> Score:
        """What the residual says of some whitened columns, (N, k)."""
        B = self._spread(B)
        through = self.H.T @ B
        F = B.T @ B - through.T @ self.P @ through
        return Score(B.T @ self.r, (F + F.T) / 2, self.total, self.numbers)

    def asked_in_pairs(self, column: Vector, one: Matrix, other: Matrix) -> Pairs:
        """The same of many pairs of columns that are one column, (N,), times waves over the rows, (rows, pairs), each pair by itself."""
        rows = len(one)
        column, H = self._spread(column[:, None]).reshape(rows, -1), self.H.reshape(rows, -1, self.H.shape[1])
        left, share = np.sum(column * self.r.reshape(rows, -1), axis=1), np.sum(column**2, axis=1)
        through = np.matmul(column[:, None], H)[:, 0]
        s = np.stack([left @ one, left @ other], axis=1)
        ways = np.stack([through.T @ one, through.T @ other])
        beside = np.stack([self.P @ way for way in ways])
        across = share @ (one * other)
        F = np.array([[share @ one**2, across], [across, share @ other**2]]) - np.einsum("apk,bpk->abk", ways, beside)
        return Pairs(s, F.transpose(2, 0, 1), self.total, self.numbers)


@dataclass(frozen=True)
class Score:
    """A nuisance as the residual has it, in units of its usual size.

    Attributes:
        s: Score, (k,).
        F: Information beside the parameters, (k, k).
        total: What there is to explain.
        numbers: Degrees of freedom.
    """

    s: Vector
    F: Matrix
    total: float
    numbers: float

    def part(self, columns: Rows) -> Score:
        """Of some of the columns."""
        return replace(self, s=self.s[columns], F=self.F[np.ix_(columns, columns)])

    def gains_of_parts(self, parts: Sequence[Rows]) -> list[float]:
        """Log evidence of each of some parts by itself, [nats]: those of one size at once."""
        gains, sizes = np.empty(len(parts)), np.array([len(columns) for columns in parts])
        for size in np.unique(sizes):
            own = np.flatnonzero(sizes == size)
            columns = np.array([parts[number] for number in own.tolist()])
            found = gains_of(self.s[columns], self.F[columns[:, :, None], columns[:, None]], self.total, self.numbers)
            gains[own] = found.max(axis=1) - np.log(len(SIZES))
        return gains.tolist()

    @cached_property
    def gains(self) -> Vector:
        """Log evidence for every one of SIZES."""
        return gains_of(self.s, self.F, self.total, self.numbers)

    @property
    def gain(self) -> float:
        """Log evidence of the nuisance, [nats]."""
        return float(self.gains.max() - np.log(len(SIZES)))

    @property
    def explained(self) -> float:
        """Share of what there is to explain that the nuisance explains."""
        explained, _ = explained_by(self.s, self.F)
        return float(explained[np.argmax(self.gains)] / self.total)

    @property
    def size(self) -> float:
        """How many times the usual one, by the data."""
        return float(SIZES[int(np.argmax(self.gains))])


@dataclass(frozen=True)
class Pairs:
    """Many nuisances of two columns each, in units of their usual size.

    Attributes:
        s: Scores, (k, 2).
        F: Information beside the parameters, (k, 2, 2).
        total, numbers: As of a `Score`.
    """

    s: Matrix
    F: Array3
    total: float
    numbers: float

    @cached_property
    def best(self) -> int:
        """Which of them has the greatest gain: that of two columns, written out."""
        (one, other), grown = self.s.T[:, :, None], SIZES**2
        first, across, second = 1 + grown * self.F[:, :1, 0], grown * self.F[:, :1, 1], 1 + grown * self.F[:, 1:, 1]
        volume = first * second - across**2
        explained = grown * (second * one**2 - 2 * across * one * other + first * other**2) / volume
        return int(np.argmax((fits_better_by(explained, self.total, self.numbers) - np.log(volume)).max(axis=1)))

    def score(self, number: int) -> Score:
        """One of them."""
        return Score(self.s[number], self.F[number], self.total, self.numbers)


def rows_times(roots: Array3, columns: Matrix) -> Matrix:
    """Matrices (rows, m, m) times the numbers of each row, (rows m, k)."""
    rows, m = roots.shape[:2]
    return np.asarray((roots @ columns.reshape(rows, m, -1)).reshape(rows * m, -1))


def gains_of(s: Matrix, F: Array3, total: float, numbers: float) -> Matrix:
    """Log evidence for every one of SIZES, (..., sizes), of scores (..., k) with information (..., k, k)."""
    explained, volume = explained_by(s, F)
    return np.asarray(0.5 * (fits_better_by(explained, total, numbers) - volume))


def explained_by(s: Matrix, F: Array3) -> tuple[Matrix, Matrix]:
    """What each of SIZES explains of chi-squared, and log det(1 + tau^2 F), (..., sizes) both."""
    values, vectors = np.linalg.eigh(F)
    values, squares = np.maximum(values, 0.0)[..., None, :], ((vectors.swapaxes(-1, -2) @ s[..., None])[..., 0] ** 2)[..., None, :]
    grown = SIZES[:, None] ** 2
    return (grown * squares / (1 + grown * values)).sum(axis=-1), np.log1p(grown * values).sum(axis=-1)


def fits_better_by(explained: Matrix, total: float, numbers: float) -> Matrix:
    """Twice the log likelihood gained where so much of chi-squared is explained."""
    return np.asarray(-numbers * np.log1p(-np.minimum(explained / total, _NEAR_ALL)))
