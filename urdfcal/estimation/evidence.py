"""Prior scales and spot noise chosen by the data: type-II maximum likelihood, MacKay's fixed point.

How large the errors of a robot's joints are is itself unknown. With the residual linearised at the present estimate, y = J dx + noise,
the scale of each group of parameters that makes the data most probable satisfies

    scale_g^2 = (sum of dx_i^2 + nu s_g^2) / (gamma_g + nu),   gamma_g = sum of (1 - P_ii / scale_g^2),
    noise^2   = |y - J dx|^2 / (n - gamma)

The scales themselves are known only so well: log s_g has a variance of about 1 / (2 (gamma_g + 1)), gamma_g being how many parameters
decided it. A sigma that is to hold the truth as often as it says must know of that. So the covariance is taken under scales wider by
1.65 of those standard deviations (a right-hand 95 % limit), and to it is added what the estimate moves by with the scales,

    P = P(s') + sum over g of 2 / (gamma_g + 1) u_g u_g',    u_g = dx / d log s_g^2 = P (x - x0)_g / s_g^2

(after Kass and Steffey, Approximate Bayesian inference in conditionally independent hierarchical models, 1989; the wide limit because
few parameters decide a scale, and its distribution leans to the large side).

Where joints give way, too, the scales of that are chosen alike: of their sag about the joint's axis and across it, of encoders, gears and
approach.

gamma counts the parameters that the data, not the prior, decide (MacKay, Bayesian interpolation, 1992). A start value s_g enters as
nu observations, so that a few poses cannot talk a scale to zero. Groups are the joints' translations, their rotations across the
axis and their zero offsets; mount, screen and beams keep the priors that are stated.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from urdfcal.base.geometry import Matrix, Vector
from urdfcal.base.progress import each
from urdfcal.estimation.ekf import Belief, Estimate, iterated_schedule
from urdfcal.estimation.noise import LEAST_FREEDOM, Noise
from urdfcal.estimation.prior import Prior
from urdfcal.estimation.residual import Linearisation, Linearise

START_SCALES = {"translation": 0.3e-3, "rotation": 0.7e-3, "zero": 3e-3}  # [m], [rad]: within 2.5 times of real arms'
SOFT_SCALES = {"sag": 1.5e-3, "sag across": 0.15e-3}  # [rad] of the joints' deflections, where they are estimated
SOFT_SCALES |= {"scale": 1e-3, "eccentricity": 0.5e-3, "gear": 0.2e-3, "approach": 0.3e-3}  # a share, [rad], and [rad] or, of slides, [m]
LEAST_POSES = 20  # with fewer the scales cannot be told from the errors themselves
_NU = 1.0
_WIDE = 1.65  # standard deviations of a scale's logarithm by which it is taken wider for the covariance
_ROUNDS, _FIXED_POINT_ROUNDS = 8, 300
_REST = 1e-3


@dataclass(frozen=True)
class Evidence:
    """Scales that the data chose.

    Attributes:
        scales: Prior standard deviation of each group, [m] and [rad].
        noise: Noise that was chosen with them.
        groups: Group of each parameter, the empty string for none.
    """

    scales: dict[str, float]
    noise: Noise
    groups: tuple[str, ...]


def by_evidence(linearise: Linearise, prior: Prior, noise: Noise, first: Estimate) -> tuple[Prior, Estimate, Evidence]:
    """Choose scales by evidence and refit, in turn, until both stand still.

    Args:
        linearise: Residual and Jacobian of the whole set at a state.
        prior: Before the data; parameters that are in no group keep theirs.
        noise: Of the measurements; estimated with the scales unless stated.
        first: Fit with that prior, where the first linearisation is taken.

    Returns:
        The prior with the chosen scales, the fit under it, and the scales.
    """
    starts = START_SCALES | {group: scale for group, scale in SOFT_SCALES.items() if group in prior.groups}
    found, scales, chosen = first, dict(starts), first.noise.released(noise)
    for _ in each(range(_ROUNDS), "choice of prior scales"):
        before = np.array([*scales.values(), *chosen.sigma])
        scales, chosen = _chosen(linearise, prior, chosen, noise.sigma, found.belief.x, scales)
        prior = prior.with_scales(scales)
        belief = Belief.independent(prior.mean, prior.sigma)
        found = iterated_schedule(linearise, belief, chosen.hold(), start=found.belief.x)
        if np.max(np.abs(np.array([*scales.values(), *chosen.sigma]) / before - 1)) < _REST:
            break
    unsure = Belief(found.belief.x, covariance_of_uncertain_scales(prior, found.belief))
    return prior, replace(found, belief=unsure, noise=chosen), Evidence(scales, chosen, prior.groups)


def covariance_of_uncertain_scales(prior: Prior, belief: Belief) -> Matrix:
    """Covariance of the parameters that knows how little is known of the scales, (p, p)."""
    P, sigma, dx = belief.P, prior.sigma, belief.x - prior.mean
    wide, moved = sigma.copy(), np.zeros_like(P)
    for group in START_SCALES | SOFT_SCALES:
        own = prior.members(group)
        if own.any():
            decided = float(np.sum(1 - np.diag(P)[own] / sigma[own] ** 2))
            wide[own] *= np.exp(_WIDE / np.sqrt(2 * (decided + 1)))
            u = P @ np.where(own, dx / sigma**2, 0.0)
            moved += 2 / (decided + 1) * np.outer(u, u)
    information = np.linalg.inv(P) - np.diag(1 / sigma**2) + np.diag(1 / wide**2)
    whole = np.linalg.inv(information) + moved
    return np.asarray((whole + whole.T) / 2)


def _chosen(
    linearise: Linearise, prior: Prior, noise: Noise, usual: Vector, x: Vector, scales: dict[str, float]
) -> tuple[dict[str, float], Noise]:
    """MacKay's fixed point at one linearisation; noise of which the data tell too little is no larger than usual, (kinds,)."""
    linearisation = linearise(x)
    sums = _sums(linearisation, noise, x, prior.mean)
    members = {group: prior.members(group) for group in scales}
    A, b = np.array([sums_of_kind.A for sums_of_kind in sums]), np.array([sums_of_kind.b for sums_of_kind in sums])
    factor, scales = np.ones(len(sums)), dict(scales)
    least, most = np.append(noise.times(0.0).sigma / noise.sigma, 1.0), np.append(usual / noise.sigma, 1.0)
    fixed = np.append(noise.stated, True) | (np.array([sums_of_kind.count for sums_of_kind in sums]) == 0)
    for _ in range(_FIXED_POINT_ROUNDS):
        sigma = prior.with_scales(scales).sigma
        P = np.linalg.inv(np.tensordot(factor**-2, A, 1) + np.diag(1 / sigma**2))
        dx = P @ (factor**-2 @ b)
        decided = 1 - np.diag(P) / sigma**2
        last = np.array([*scales.values(), *factor])
        for group, own in members.items():
            if own.any():
                scales[group] = _scale(dx[own], decided[own], (START_SCALES | SOFT_SCALES)[group])
        own_factors = np.array([each.factor(dx, P, size, limit) for each, size, limit in zip(sums, factor, most, strict=True)])
        factor = np.asarray(np.where(fixed, factor, np.maximum(own_factors, least)))
        if np.max(np.abs(np.array([*scales.values(), *factor]) / last - 1)) < _REST / 10:
            break
    if linearisation.poses is None or noise.held:
        return scales, noise.times(factor[:-1])
    apart = noise.told_apart(linearisation, factor[:-1], ~fixed[:-1])
    return scales, replace(apart, common=np.where(noise.stated, noise.common, apart.common))


@dataclass(frozen=True)
class _Sums:
    """What one kind of measurement contributes, whitened by the noise assumed: J'J, J'y, y'y and how many numbers."""

    A: Matrix
    b: Vector
    c: float
    count: float

    def factor(self, dx: Vector, P: Matrix, size: float, most: float) -> float:
        """How many times larger its noise is, by the misfit over its degrees of freedom.

        Too few of them do not tell. Then it may be what narrower priors made of it, and is held to what is usual.
        """
        freedom = self.count - float(np.sum(P * self.A)) / size**2
        if freedom < LEAST_FREEDOM:
            return min(size, most)
        misfit = float(self.c - 2 * self.b @ dx + dx @ self.A @ dx)
        return float(np.sqrt(max(misfit, 1e-12 * self.c) / freedom))


def _sums(linearisation: Linearisation, noise: Noise, x: Vector, mean: Vector) -> list[_Sums]:
    """One for each kind of noise, and a last one for what states its own."""
    stated, dx = ~np.isnan(linearisation.stated_sigma), x - mean
    kinds = np.where(stated, len(linearisation.counts), linearisation.kinds).ravel()
    counts = np.bincount(kinds, np.ravel(linearisation.shares), minlength=len(linearisation.counts) + 1).tolist()
    every = [*noise.by_kind(linearisation)]
    return [_Sums(own.A, own.b, own.c, count) for own, count in zip((each.moved(dx) for each in every), counts, strict=True)]


def _scale(dx: Vector, decided: Matrix, start: float) -> float:
    return float(np.sqrt((np.sum(dx**2) + _NU * start**2) / (decided.sum() + _NU)))
