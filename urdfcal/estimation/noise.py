"""What the measurements are worth: noise of the readings and of the joints, the weights that follow, and whether residuals scatter so.

Joint readings are inputs: their noise reaches a reading through the joint Jacobian and differs from pose to pose, so the covariance of
one pose's numbers is R_i = R_readings + J_q R_q J_q'. Several readings of one pose count as their mean (`pose_means.py`).

A fit draws predictions towards what was measured. With H the whitened Jacobian and P the covariance of the parameters, a whitened
residual has the variance 1 - h, h = diag(H P H') its leverage, so that the degrees of freedom of some numbers are sum(1 - h).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from urdfcal.base.geometry import Array3, Mask, Matrix, Vector
from urdfcal.estimation.normal import Normal
from urdfcal.estimation.pose_means import PoseMeans, beyond, scatter_within
from urdfcal.estimation.residual import Linearisation

_LEAST_SIGMA = 1e-6  # [m], [rad] or [px]; no sensor sees less, and noise-free simulations end here
LEAST_FREEDOM = 20.0  # degrees of freedom; with fewer the residual says too little of the noise, and the start value stays
_CLOSE = 1e-3

_SURE = 4.0  # sigmas of chi-squared beyond which it is no chance


@dataclass(frozen=True)
class Weights:
    """Whitening of each pose's numbers: either factors (n, m) or (), or matrices (n, m, m).

    Attributes:
        factor: Of the n rows, or where some are readings of one pose, of the poses' means.
        means: From rows to poses; None where every row is a pose of its own.
    """

    factor: Any
    means: PoseMeans | None = None

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

    def normal(self, linearisation: Linearisation) -> Normal:
        """Sums of the whitened rows."""
        if self.factor.ndim or linearisation.known or np.isfinite(linearisation.stated_sigma).any():
            return Normal.of_rows(self.jacobian(linearisation), self.residual(linearisation))
        return Normal.of(linearisation.sums.plain.sum(axis=0) * self.factor**2)

    def _whitened(self, rows: Array3) -> Array3:
        return self._scaled(rows) if self.means is None else self.means.spread(self._scaled(self.means.gathered(rows)))

    def of_poses(self, rows: Array3) -> Array3:
        """Whitened numbers of poses, (poses, m, c), from those of readings, (n, m, c)."""
        return self._scaled(rows if self.means is None else self.means.gathered(rows))

    def _scaled(self, rows: Array3) -> Array3:
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
        common: Share of the variance sigma^2 that all readings of one pose have in common, (kinds,): the intraclass correlation. It means
            something only where poses were read several times, and is 1 where they do not tell. One for all may be given.
        held: Whether nothing of it is estimated any more.
    """

    sigma: Any
    joint_sigma: Vector
    stated: Any = True
    common: Any = 1.0
    held: bool = False

    def __post_init__(self) -> None:
        sigma = np.atleast_1d(np.asarray(self.sigma, dtype=float))
        object.__setattr__(self, "sigma", sigma)
        object.__setattr__(self, "stated", np.broadcast_to(np.asarray(self.stated, dtype=bool), sigma.shape))
        object.__setattr__(self, "common", np.broadcast_to(np.asarray(self.common, dtype=float), sigma.shape))

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

    @property
    def sigma_in_common(self) -> Vector:
        """Standard deviation of what all readings of one pose have in common, (kinds,)."""
        return np.asarray(self.sigma * np.sqrt(self.common))

    def settled(self, linearisation: Linearisation) -> bool:
        """Whether a set tells nothing of the noise that is not known."""
        return self.held or (self.all_stated and linearisation.poses is None)

    def hold(self) -> Noise:
        """The same, of which nothing is estimated any more."""
        return replace(self, stated=True, held=True)

    def released(self, like: Noise) -> Noise:
        """The same, of which is estimated what is estimated of another one."""
        return replace(self, stated=like.stated, held=like.held)

    def weights(self, linearisation: Linearisation) -> Weights:
        """Whitening at one linearisation."""
        if linearisation.poses is not None:
            return Weights(*self._of_poses(linearisation))
        if not self.of_joints:
            return Weights(1 / (self.of_numbers(linearisation) if linearisation.stating else self.sigma[linearisation.kinds]))
        return Weights(np.linalg.inv(np.linalg.cholesky(self.pose_covariance(linearisation))))

    def normal(self, linearisation: Linearisation) -> Normal:
        """The whitened normal equations of one linearisation."""
        if self._a_factor_each(linearisation):
            return linearisation.sums.whitened(self.sigma[: len(linearisation.sums.plain)])
        weights = self.weights(linearisation)
        return Normal.of_rows(weights.jacobian(linearisation), weights.residual(linearisation))

    def _a_factor_each(self, linearisation: Linearisation) -> bool:
        """Whether whitening is a factor a number, so that its sums follow from those that are not whitened (`normal.py`)."""
        return linearisation.poses is None and not self.of_joints

    def by_kind(self, linearisation: Linearisation) -> Iterator[Normal]:
        """The same of each kind's numbers that state no noise of their own and, last, of all that do."""
        if self._a_factor_each(linearisation):
            sums = linearisation.sums
            yield from (Normal.of(own / sigma**2) for own, sigma in zip(sums.plain, self.sigma.tolist(), strict=False))
            yield Normal.of(sums.stated.sum(axis=0) + sums.known)
            return
        weights, unstated = self.weights(linearisation), np.isnan(linearisation.stated_sigma)
        H, e, count = weights.jacobian(linearisation), weights.residual(linearisation), len(linearisation.counts)
        kinds = np.where(unstated, linearisation.kinds, count).ravel()
        yield from (Normal.of_rows(H[kinds == kind], e[kinds == kind]) for kind in range(count + 1))

    def decided(self, linearisation: Linearisation, P: Matrix, stating: Any = False) -> Vector:
        """How many parameters of covariance P the numbers of each kind decide that do not state their noise, or that do, (kinds,).

        That is the sum of their leverages.
        """
        stating = np.broadcast_to(stating, linearisation.counts.shape)
        if self._a_factor_each(linearisation):
            sums = linearisation.sums
            A = np.where(stating[:, None, None], sums.stated, sums.plain / self.sigma[: len(sums.plain), None, None] ** 2)
            return np.asarray(np.tensordot(A[:, :-1, :-1], P, 2))
        leverages = linearisation.leverages(self.weights(linearisation).jacobian(linearisation), P)
        own = linearisation.read & (np.isnan(linearisation.stated_sigma) != stating[linearisation.kinds])
        return linearisation.of_kinds(np.where(own, leverages, 0.0))

    def _of_poses(self, linearisation: Linearisation) -> tuple[Any, PoseMeans]:
        """Factor and means of the weights where some rows are readings of one pose; they share the readings of the joints."""
        means = PoseMeans.of(linearisation, self.of_numbers(linearisation))
        variance = self._variance_of_means(linearisation, means)
        if not self.of_joints:
            return 1 / np.sqrt(variance), means
        reach = means.gathered(linearisation.joint_jacobian * self.joint_sigma)
        return np.linalg.inv(np.linalg.cholesky(reach @ reach.transpose(0, 2, 1) + _diagonal(variance))), means

    def _variance_of_means(self, linearisation: Linearisation, means: PoseMeans) -> Matrix:
        """1 - rho + rho k of every number of a pose, (poses, m)."""
        rho = self.common[linearisation.kinds]
        return np.asarray(1 - rho + rho * means.readings)

    def log_determinant(self, linearisation: Linearisation) -> float:
        """Logarithm of the determinant of the covariance of all numbers that were measured; of poses read several times, of their means."""
        if linearisation.poses is not None:
            factor, means = self._of_poses(linearisation)
            sizes = np.log(np.diagonal(factor, axis1=1, axis2=2) if factor.ndim == 3 else factor)
            precise = means.gathered(np.ones((*means.unit.shape, 1)))[..., 0]
            return float(-2 * np.sum(np.where(means.seen, sizes + np.log(np.where(means.seen, precise, 1.0)), 0.0)))
        if self.of_joints:
            return float(np.sum(np.linalg.slogdet(self.pose_covariance(linearisation))[1]))
        return float(np.sum(np.log(self.of_numbers(linearisation)[linearisation.measured] ** 2)))

    def pose_covariance(self, linearisation: Linearisation) -> Array3:
        """R_i = R_spot + J_q R_q J_q' of every row, (n, m, m); what was not measured has unit variance."""
        reach = linearisation.joint_jacobian * self.joint_sigma if self.of_joints else np.zeros((*linearisation.residual.shape, 1))
        R = reach @ reach.transpose(0, 2, 1)
        numbers = np.arange(linearisation.residual.shape[1])
        R[:, numbers, numbers] += self.variances(linearisation)
        return np.asarray(R)

    def variances(self, linearisation: Linearisation) -> Matrix:
        """Variance of each number, the readings of joints left out, (n, m); 1 of what was not measured."""
        return np.where(linearisation.measured, self.of_numbers(linearisation) ** 2, 1.0)

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
        of their noise. What the readings of one pose have in common is estimated either way.
        """
        if self.held:
            return self
        freedom = np.atleast_1d(degrees_of_freedom)
        squares = (self.weights(linearisation).residual(linearisation) ** 2).reshape(linearisation.residual.shape)
        chi_squared = linearisation.of_kinds(squares * linearisation.unstated)
        factor, tells = np.sqrt(chi_squared / np.maximum(freedom, 1.0)), freedom >= LEAST_FREEDOM
        if linearisation.poses is not None:
            return self.told_apart(linearisation, factor, tells)
        return self.times(np.where(self.stated | ~tells, 1.0, factor))

    def told_apart(self, linearisation: Linearisation, factor: Vector, tells: Mask) -> Noise:
        """The noise that means of poses ask for, with what readings of one pose show of their own.

        Where too few readings tell that, all of it is the pose's; where too few means tell theirs, what a pose has in common stays.

        Args:
            linearisation: Of which some rows are readings of one pose.
            factor: How many times as much as they should the means of each kind scatter, (kinds,).
            tells: Of which kinds there are means enough to say so, (kinds,).
        """
        sigma = self.of_numbers(linearisation)
        within, means = scatter_within(linearisation, sigma), PoseMeans.of(linearisation, sigma)
        variance, found, shares = self._variance_of_means(linearisation, means), self.sigma.copy(), self.common.copy()
        for kind in np.flatnonzero(linearisation.counts).tolist():
            own = means.seen & (linearisation.kinds == kind)
            ask = variance[own] * (factor[kind] ** 2 if tells[kind] else 1.0)
            alone = within.variance[kind] if within.freedom[kind] >= LEAST_FREEDOM else 0.0
            found[kind], shares[kind] = self._split(kind, means.readings[own], ask, alone, within.freedom[kind], bool(tells[kind]))
        return replace(self, sigma=np.maximum(found, _LEAST_SIGMA), common=shares)

    def _split(self, kind: int, readings: Vector, ask: Vector, alone: float, freedom: float, tells: bool) -> tuple[float, float]:
        """Standard deviation of a reading of one kind, and the share that its pose has in common.

        Args:
            kind: Index of the kind.
            readings: How many readings each mean has, (k,).
            ask: Variances that the means ask for, in units of independent readings', (k,).
            alone: Variance of what each reading has of its own, in units of sigma^2.
            freedom: Degrees of freedom of that.
            tells: Whether the means tell anything.
        """
        sigma, stated = float(self.sigma[kind]), bool(self.stated[kind])
        common = float(self.common[kind]) if not stated else max(1 - alone, 0.0)
        if tells:
            common = float(np.mean(ask / readings)) if alone == 0 else beyond(alone / readings, ask / readings, len(ask)) ** 2
        whole = alone + common
        share = common / whole if whole > 0 else 1.0
        if stated:
            return sigma, share
        if common == 0:  # nothing in common: means and scatter tell of the same
            whole = (freedom * alone + float(np.sum(ask))) / (freedom + len(ask))
        return sigma * float(np.sqrt(whole)), share

    def close_to(self, other: Noise, linearisation: Linearisation) -> bool:
        """Whether another estimate of the noise is the same for all purposes: joint readings may hide a sensor's own noise."""
        if np.max(np.abs(self.common - other.common)) >= _CLOSE:
            return False
        if not (self.of_joints or other.of_joints):
            unstated = linearisation.of_kinds(linearisation.unstated) > 0
            return bool(np.max(np.abs(self.sigma / other.sigma - 1)[: len(unstated)][unstated], initial=0.0) < _CLOSE)
        own, old = (np.diagonal(each.pose_covariance(linearisation), axis1=1, axis2=2)[linearisation.measured] for each in (self, other))
        return bool(np.max(np.abs(np.sqrt(own / old) - 1), initial=0.0) < _CLOSE)


def _diagonal(rows: Matrix) -> Array3:
    """Rows (n, m) as diagonal matrices, (n, m, m)."""
    return np.asarray(rows[:, :, None] * np.eye(rows.shape[1]))


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
    read = linearisation.read
    stating = read & ~linearisation.unstated
    states = linearisation.of_kinds(stating) > 0
    own = np.where(states[linearisation.kinds], stating, read)
    squares = np.where(own, (noise.weights(linearisation).residual(linearisation) ** 2).reshape(own.shape), 0.0)
    free = linearisation.of_kinds(np.where(own, linearisation.shares, 0.0)) - noise.decided(linearisation, P, states)
    return tuple(
        Misfit(float(chi_squared / max(freedom, 1.0)), float(freedom))
        for chi_squared, freedom in zip(linearisation.of_kinds(squares), free, strict=True)
    )
