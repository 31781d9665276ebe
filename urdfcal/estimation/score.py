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

All of this is algebra on the products of columns, [C e]' [C e], C those of the fit and of all that is asked, however many rows there are.
The residual e is taken at the estimate, d in units of the prior sigmas, so that y = e + H d, and nothing cancels: with u = P (H'e - d),
which is hardly anything there, the fit is at d + u, and what it leaves is r = e - H u.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from urdfcal.base.geometry import Array3, Matrix, Vector

SIZES = np.array([0.1, 0.3, 1.0, 3.0, 10.0])  # times the usual one that a nuisance may have
_EXACT = 1e-4  # share of the noise's variance, under which data are exact and say nothing more
_DIGITS = 1e12  # times as well as before that data may tell a parameter for sums in double precision
_NEAR_ALL = 0.98  # share of the misfit beyond which nothing explains it

Rows = npt.NDArray[np.intp]
AnyPrecision = npt.NDArray[np.float64] | npt.NDArray[np.float32]
ComplexMatrix = npt.NDArray[np.complex128] | npt.NDArray[np.complex64]


@dataclass(frozen=True)
class Kept:
    """Columns that are in a fit, of all that there are.

    Attributes:
        own: Which of them, (p,).
        scale: How many times their usual size these are expected to be, (p,).
    """

    own: Rows
    scale: Vector

    @staticmethod
    def first(count: int) -> Kept:
        """So many that come first."""
        return Kept(np.arange(count), np.ones(count))

    def beside(self, columns: Rows, size: float) -> Kept:
        """These and further ones, so many times as large as usual."""
        return Kept(np.append(self.own, columns), np.append(self.scale, np.full(len(columns), size)))

    def rows(self, columns: Array3) -> Array3:
        """These of all columns and, behind them, the residual, (p + 1, m, n), from (columns + 1, m, n)."""
        own = columns.take(np.append(self.own, len(columns) - 1), axis=0)
        own[:-1] *= self.scale[:, None, None]
        return own


@dataclass(frozen=True)
class Fitted:
    """A fit to which questions are put, whitened.

    Attributes:
        products: [C e]'[C e] of columns C in units of their usual sizes and the residual e at some state, (columns + 1, columns + 1).
        kept: Which of the columns are in the fit.
        at: The state where the residual was taken, less what the prior expects, in units of what is expected, (p,).
        numbers: Degrees of freedom: how many numbers there are, less the parameters that they decide.
    """

    products: Matrix
    kept: Kept
    at: Vector
    numbers: float

    @staticmethod
    def of(products: Matrix, at: Vector, count: float) -> Fitted:
        """A fit of so many numbers whose columns come first."""
        kept = Kept.first(len(at))
        decided = float(np.sum(1 - np.diag(Fitted(products, kept, at, count).P)))
        return Fitted(products, kept, at, max(count - decided, 1.0))

    def beside(self, columns: Rows, size: float) -> Fitted:
        """The same fit with further columns in it, so many times as large as usual."""
        return replace(self, kept=self.kept.beside(columns, size), at=np.append(self.at, np.zeros(len(columns))))

    def put_to(self, products: Matrix) -> Fitted:
        """The same fit of rows that were whitened further, or have further columns."""
        return replace(self, products=products)

    def alone(self, products: Matrix, share: float = 1.0) -> Fitted:
        """The same fit whose columns are all that there are, of other rows, (p + 1, p + 1), with so large a share of the numbers."""
        return replace(self, products=products, kept=Kept.first(len(self.at)), numbers=self.numbers * share)

    @property
    def own(self) -> Matrix:
        """[H e]'[H e], (p + 1, p + 1)."""
        return np.block([[self.A, self.b[:, None]], [self.b, self.products[-1, -1]]])

    @cached_property
    def A(self) -> Matrix:
        """H'H, (p, p)."""
        own, scale = self.kept.own, self.kept.scale
        return np.asarray(self.products[own[:, None], own] * (scale[:, None] * scale))

    @cached_property
    def b(self) -> Vector:
        """H'e, (p,)."""
        return np.asarray(self.products[self.kept.own, -1] * self.kept.scale)

    @cached_property
    def tells(self) -> bool:
        """Whether there is anything left to explain, and digits to do so: not of exact data."""
        return self.total > _EXACT * self.numbers and float(np.max(np.diag(self.A), initial=0.0)) < _DIGITS

    @cached_property
    def _information(self) -> Matrix:
        return self.A + np.eye(len(self.at))

    @cached_property
    def P(self) -> Matrix:
        """Covariance of the parameters, in units of their prior sigmas, (p, p)."""
        return np.asarray(np.linalg.inv(self._information))

    @cached_property
    def step(self) -> Vector:
        """How far the parameters are from where the residual was taken, (p,)."""
        return np.asarray(self.P @ (self.b - self.at))

    @property
    def x(self) -> Vector:
        """The parameters, in units of their prior sigmas, (p,)."""
        return self.at + self.step

    @cached_property
    def total(self) -> float:
        """What there is to explain: y' M y, as what is left and how far the parameters had to go."""
        return float(self.products[-1, -1] + self.at @ self.at - (self.b - self.at) @ self.step)

    @cached_property
    def log_evidence(self) -> float:
        """Of the data, less what their whitening adds and a constant."""
        volume = float(np.linalg.slogdet(self._information)[1])
        return -0.5 * (self.numbers * float(np.log(self.total)) + volume)

    def asked(self, columns: Rows) -> Score:
        """What the residual says of some columns, (k,)."""
        through = self.products[self.kept.own[:, None], columns] * self.kept.scale[:, None]
        F = self.products[columns[:, None], columns] - through.T @ self.P @ through
        return Score(self.products[columns, -1] - through.T @ self.step, (F + F.T) / 2, self.total, self.numbers)

    def left(self, columns: Array3) -> Array3:
        """What asks about columns that are not among these: L^-1 H with L L' = H'H + I and, behind it, what is left, r, (p + 1, m, n).

        Args:
            columns: All columns and the residual, (columns + 1, m, n).
        """
        rows = self.kept.rows(columns)
        rows[-1] -= np.tensordot(self.step, rows[:-1], 1)
        rows[:-1] = np.tensordot(np.linalg.inv(np.linalg.cholesky(self._information)), rows[:-1], 1)
        return rows

    def asked_of(self, left: Array3, B: Array3) -> Score:
        """What the residual says of columns B, (k, m, n), that are not among these; `left` as above."""
        flat, rows = B.reshape(len(B), -1), left.reshape(len(left), -1)
        through = rows @ flat.T
        return Score(through[-1], flat @ flat.T - through[:-1].T @ through[:-1], self.total, self.numbers)

    def asked_in_waves(self, left: AnyPrecision, column: AnyPrecision, waves: ComplexMatrix) -> Pairs:
        """The same of pairs of columns that are one column times sin k q and cos k q, for every k by itself.

        Sums of squares of waves are those of waves that are twice as short, k and all cycles on from there as sums of a product.

        Args:
            left: As above; it may be in single precision, which is enough to tell which pair is the best.
            column: The one column, (m, n), in the same precision.
            waves: exp(i k q) for k = 1 ... K at every row, (n, K), in the same.
        """
        share, shortest = np.einsum("mn,mn->n", column, column), waves[:, -1]
        rows = np.concatenate([np.einsum("pmn,mn->pn", left, column), [share, share * shortest.real, share * shortest.imag]])
        sums = (rows @ waves.view(left.dtype)).view(waves.dtype)
        known, s, (one, real, imaginary) = sums[:-4], sums[-4], sums[-3:]
        twice = np.concatenate([one, real + 1j * imaginary])[1::2]
        sines, cosines = known.imag, known.real
        own, across, other = (np.einsum("pk,pk->k", *pair) for pair in ((sines, sines), (sines, cosines), (cosines, cosines)))
        F = np.empty((len(s), 2, 2))
        F[:, 0, 0], F[:, 1, 1] = 0.5 * (share.sum() - twice.real) - own, 0.5 * (share.sum() + twice.real) - other
        F[:, 0, 1] = F[:, 1, 0] = 0.5 * twice.imag - across
        return Pairs(np.stack([s.imag, s.real], axis=1), F, self.total, self.numbers)


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
    def gains(self) -> Vector:
        """Log evidence of each, less what looking at several sizes costs, (k,): that of two columns, written out."""
        (one, other), grown = self.s.T[:, :, None], SIZES**2
        first, across, second = 1 + grown * self.F[:, :1, 0], grown * self.F[:, :1, 1], 1 + grown * self.F[:, 1:, 1]
        volume = first * second - across**2
        explained = grown * (second * one**2 - 2 * across * one * other + first * other**2) / volume
        return np.asarray(0.5 * (fits_better_by(explained, self.total, self.numbers) - np.log(volume)).max(axis=1))


def log_evidences(products: Array3, at: Vector, numbers: float) -> Vector:
    """Log evidence of fits, (fits,), whose columns are all that there are, from [H e]'[H e], (fits, p + 1, p + 1)."""
    information, b = products[:, :-1, :-1] + np.eye(len(at)), products[:, :-1, -1] - at
    steps = np.linalg.solve(information, b[..., None])[..., 0]
    totals = products[:, -1, -1] + at @ at - np.sum(b * steps, axis=1)
    return np.asarray(-0.5 * (numbers * np.log(totals) + np.linalg.slogdet(information)[1]))


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
