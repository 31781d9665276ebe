"""Normal equations as sums over all numbers: what a fit needs of a linearisation, and no more.

Of J and the residual r, side by side, only the products [J r]' [J r] are kept: one for each kind of noise of the numbers that state none of
their own, unweighted, and one of those that do, in units of it. Whatever the noise is taken for, the whitened sums follow from these,

    H'H = sum over kinds of J_k'J_k / sigma_k^2,    H'e and e'e alike,

so that steps, degrees of freedom, prior scales and covariances share one sweep. Only where the readings of joints are noisy, or poses were
read several times, the whitening is no factor a number, and the sums are taken of whitened rows.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from urdfcal.base.geometry import Array3, Matrix, Vector


@dataclass(frozen=True)
class Normal:
    """Sums of whitened rows.

    Attributes:
        A: H'H, (p, p).
        b: H'e, (p,).
        c: e'e.
    """

    A: Matrix
    b: Vector
    c: float

    @staticmethod
    def of(products: Matrix) -> Normal:
        """From [H e]'[H e], (p + 1, p + 1)."""
        return Normal(products[:-1, :-1], products[:-1, -1], float(products[-1, -1]))

    @staticmethod
    def of_rows(H: Matrix, e: Vector) -> Normal:
        """From whitened rows, (N, p) and (N,)."""
        return Normal(H.T @ H, H.T @ e, float(e @ e))

    def moved(self, dx: Vector) -> Normal:
        """The same with e + H dx in place of e."""
        Adx = self.A @ dx
        return Normal(self.A, self.b + Adx, self.c + 2 * float(self.b @ dx) + float(dx @ Adx))


@dataclass(frozen=True)
class Sums:
    """[J r]'[J r] of a linearisation by kind of noise.

    Attributes:
        plain: Of numbers that state no noise of their own, (kinds, p + 1, p + 1).
        stated: Of those that do, in units of it, (kinds, p + 1, p + 1).
        known: Of what is known beforehand, in units of its standard deviation, (p + 1, p + 1).
    """

    plain: Array3
    stated: Array3
    known: Matrix

    def whitened(self, sigma: Vector) -> Normal:
        """The normal equations where each kind has this noise, (kinds,)."""
        weights = np.asarray(sigma) ** -2.0
        return Normal.of(np.tensordot(weights, self.plain, 1) + self.stated.sum(axis=0) + self.known)

    def plus(self, known: Matrix) -> Sums:
        """The same with more that is known beforehand."""
        return Sums(self.plain, self.stated, self.known + known)


class Numbers:
    """The numbers of all poses, sorted for sums: by kind, and by whether they state their own noise.

    Attributes:
        kinds: How many kinds there are.
        sigma: Standard deviation that each states, (n, m), nan where it states none.
        columns: Of each kind, which of the m numbers are of it.
        some, all: Of each kind, whether any of its numbers state their noise, and whether all do.
    """

    def __init__(self, kinds: npt.NDArray[np.intp], sigma: Matrix) -> None:
        """Of numbers of some kinds, (m,), of which each may state its own standard deviation, (n, m)."""
        self.kinds, self.sigma = int(np.max(kinds, initial=-1)) + 1, sigma
        self.columns, stating = [np.flatnonzero(kinds == kind) for kind in range(self.kinds)], ~np.isnan(sigma)
        self.some, self.all = ([bool(how(stating[:, own])) for own in self.columns] for how in (np.any, np.all))


class Summing:
    """Takes sums of a linearisation part by part.

    Attributes:
        sums: So far.
    """

    def __init__(self, parameters: int, numbers: Numbers) -> None:
        """Of some numbers by so many parameters."""
        size = numbers.kinds, parameters + 1, parameters + 1
        self.numbers, self.sums = numbers, Sums(np.zeros(size), np.zeros(size), np.zeros(size[1:]))

    def add(self, columns: Array3, rows: slice | npt.NDArray[np.intp]) -> None:
        """Add [J r] of some rows, (p + 1, m, n of them)."""
        numbers = self.numbers
        for kind, own in enumerate(numbers.columns):
            part = (columns if numbers.kinds == 1 else columns[:, own]).reshape(len(columns), -1)
            if not numbers.some[kind]:
                self.sums.plain[kind] += part @ part.T
                continue
            sigma = numbers.sigma[rows][:, own].T.ravel()
            stated = part * np.where(np.isnan(sigma), 0.0, 1 / sigma)
            self.sums.stated[kind] += stated @ stated.T
            if not numbers.all[kind]:
                rest = part * np.isnan(sigma)
                self.sums.plain[kind] += rest @ rest.T
