"""Fits that outliers do not bend: iteratively reweighted least squares, and a gate that takes outliers out and lets them back in.

An *observation* is one block of numbers of a pose: a spot (two), a point (three), an orientation (three), a distance (one). The weight
of one with m numbers and squared Mahalanobis distance d2 is

    Student-t, nu degrees:  (nu + m) / (nu + d2)
    Huber, limit k:         min(1, k sqrt(m / 2) / sqrt(d2))

The scale that d2 is measured in is the robust one of the present residuals, so that it is wide at the start, where honest geometric
errors are far larger than the noise, and shrinks as they are explained.

A wrong joint reading can turn a beam away from the screen, where it has no residual at all. Such spots are left out of a step, as are
those so far off that they have no say but could bar the way, and all are looked at again after it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from urdfcal.base.geometry import Array3, Mask, Matrix, Vector
from urdfcal.estimation.chi_squared import MEDIANS, medians
from urdfcal.estimation.ekf import Belief, Estimate, Sweep, iterated_schedule, taken_in
from urdfcal.estimation.noise import LEAST_FREEDOM, Noise
from urdfcal.estimation.pose_means import scatter_within
from urdfcal.estimation.residual import Linearisation, Linearise

Loss = Literal["student", "huber"]
_NU = 4.0
_HUBER = 2.0
_NO_SAY = 100.0  # [scales] spots farther off than this are left out of a step
_ROUNDS = 60
_GATE_ROUNDS = 10
_CHANCE = 0.01  # probability that a gate takes out any spot of a clean set
_MARGIN = 3.0  # times that a spot that was not fitted must be farther off to be one: the model's own faults have long tails
_MOST_OUT = 0.4  # share of outliers beyond which there is no telling which is which


def mahalanobis_squared(linearisation: Linearisation, noise: Noise, uncertainty: Matrix | None = None) -> Matrix:
    """Squared Mahalanobis distance of every observation, (n, blocks), chi-squared with its numbers' degrees; nan where there is none.

    Args:
        linearisation: Residual and Jacobian.
        noise: Of the measurements.
        uncertainty: Covariance of the parameters, (p, p), for what was not fitted: S = R + J P J' in place of R.
    """
    if uncertainty is None and not noise.of_joints:  # numbers of a pose are independent
        squared = linearisation.residual**2 / noise.variances(linearisation)
        columns = [squared[:, block.columns].sum(axis=1) for block in linearisation.blocks]
    else:
        covariance = noise.pose_covariance(linearisation)
        if uncertainty is not None:
            covariance = covariance + linearisation.jacobian @ uncertainty @ linearisation.jacobian.transpose(0, 2, 1)
        columns = [_squared(linearisation.residual, covariance, block.columns) for block in linearisation.blocks]
    return np.where(degrees(linearisation) > 0, np.column_stack(columns), np.nan)


def _squared(residual: Matrix, covariance: Array3, columns: slice) -> Vector:
    """Of the residual of some numbers of every pose r' S^-1 r, (n,)."""
    own = residual[:, columns]
    return np.asarray(np.einsum("ni,ni->n", own, np.linalg.solve(covariance[:, columns, columns], own[..., None])[..., 0]))


def degrees(linearisation: Linearisation) -> Matrix:
    """How many numbers of every observation were measured, (n, blocks)."""
    return np.column_stack([np.count_nonzero(linearisation.measured[:, block.columns], axis=1) for block in linearisation.blocks])


def robust_scale(d2: Matrix, freedom: Matrix | None = None) -> float:
    """How many times wider than assumed the bulk scatters, from the median squared distance; two degrees of freedom by default."""
    return float(np.sqrt(np.nanmedian(d2 / (MEDIANS[2] if freedom is None else medians(freedom)))))


def kind_scales(linearisation: Linearisation, d2: Matrix) -> Vector:
    """The robust scale of every kind of noise, (kinds,), of what does not state its own if there is any; 1 where nothing was measured."""
    scales, kinds, stating = observation_scales(linearisation, d2), _kinds(linearisation), _stating(linearisation)
    found = np.ones(len(linearisation.counts))
    for kind in range(len(found)):
        for own in (np.isfinite(d2) & (kinds == kind) & apart for apart in (stating, ~stating)):
            if own.any():
                found[kind] = scales[own][0]
    return found


def observation_scales(linearisation: Linearisation, d2: Matrix) -> Matrix:
    """The robust scale of the sort that each observation is of, (n, blocks): its kind, those that state their own noise apart."""
    freedom, scales, kinds, stating = degrees(linearisation), np.ones_like(d2), _kinds(linearisation), _stating(linearisation)
    for kind in np.unique(kinds):
        for own in ((kinds == kind) & apart for apart in (stating, ~stating)):
            own = own & ~_known(linearisation)
            if np.isfinite(d2[own]).any():
                scales[own] = robust_scale(d2[own], freedom[own])
    return scales


def _kinds(linearisation: Linearisation) -> Matrix:
    """Index of the noise of each observation, (n, blocks)."""
    return np.broadcast_to([block.kind for block in linearisation.blocks], (len(linearisation.residual), len(linearisation.blocks)))


def _stating(linearisation: Linearisation) -> Mask:
    """Which observations state their own noise, (n, blocks)."""
    return np.column_stack([np.isfinite(linearisation.stated_sigma[:, block.columns]).any(axis=1) for block in linearisation.blocks])


def _known(linearisation: Linearisation) -> Mask:
    """Rows that are known beforehand and were not read, (n, 1)."""
    rows = np.arange(len(linearisation.residual))[:, None]
    return np.asarray(rows >= len(linearisation.residual) - linearisation.known)


@dataclass(frozen=True)
class Observations:
    """Everything that was measured, of which any may be left out.

    Attributes:
        linearise: Residual and Jacobian of the whole set at a state.
        made: What was measured, (n, blocks); what is known beforehand included.
        known: How many rows at the end are that.
    """

    linearise: Linearise
    made: Mask
    known: int = 0

    @staticmethod
    def of(linearise: Linearise, x: Vector) -> Observations:
        """Those of a set, as any state x tells."""
        linearised = linearise(x)
        return Observations(linearise, linearised.made, linearised.known)

    def at(self, x: Vector, kept: Mask) -> Linearisation:
        """The set at x as if what is not kept (n, blocks) had not been measured."""
        return self.linearise(x).without(~kept)

    def reached(self, x: Vector) -> tuple[Linearisation, Mask]:
        """The set at x without what is out of the sensor's reach there, and what that is not, (n, blocks)."""
        linearisation = self.linearise(x)
        met = np.ones_like(self.made) if linearisation.lost is None else ~linearisation.lost
        return linearisation.without(~met), met

    def too_few(self, kept: Mask) -> bool:
        """Whether so many readings are left out that there is no telling which are right."""
        read = slice(len(self.made) - self.known)
        return bool(np.mean(kept[read][self.made[read]]) < 1 - _MOST_OUT)


def iteratively_reweighted(
    observed: Observations, prior: Belief, noise: Noise, *, loss: Loss = "student", start: Vector | None = None
) -> Estimate:
    """Maximum a posteriori estimate under Student's or Huber's distribution, by iteratively reweighted steps.

    Spot noise that is not stated is the robust scale of the residual.

    Args:
        observed: What was measured.
        prior: Before the data.
        noise: Of the measurements.
        loss: `student` or `huber`.
        start: Where to begin; the prior mean by default.
    """
    belief = Belief(prior.x if start is None else start, prior.P)
    estimate, heard = Estimate(belief, "max_sweeps", noise), np.empty(0, dtype=bool)
    linearisation, met = observed.reached(belief.x)
    history: list[Sweep] = []
    for _ in range(_ROUNDS):
        if not linearisation.usable or observed.too_few(met):
            return replace(
                estimate, stop=linearisation.trouble or "left_screen", history=history or [Sweep(belief.x, np.nan, linearisation.rms)]
            )
        scaled = _rescaled(noise, linearisation, belief, prior)
        d2, last = mahalanobis_squared(linearisation, scaled), heard
        heard, weights = met & ~(d2 > _NO_SAY**2), _weights(d2, degrees(linearisation), loss)
        estimate = iterated_schedule(
            lambda state, heard=heard, weights=weights: _weighted(observed.at(state, heard), weights),  # type: ignore[misc]
            prior,
            scaled.hold(),
            start=belief.x,
            max_sweeps=3,
        )
        history += estimate.history[:1] if not history else []
        history += estimate.history[-1:]
        moved = np.max(np.abs(estimate.belief.x - belief.x) / np.sqrt(np.diag(estimate.belief.P)))
        belief = estimate.belief
        linearisation, met = observed.reached(belief.x)
        if moved < 1e-3 and np.array_equal(heard, last) and scaled.close_to(_rescaled(noise, linearisation, belief, prior), linearisation):
            belief = Belief(belief.x, _covariance(observed.at(belief.x, heard), scaled, estimate.belief, prior, loss))
            return replace(estimate, belief=belief, stop="converged", noise=scaled.released(noise), history=history)
    return replace(estimate, stop="max_sweeps", noise=scaled.released(noise), history=history)


def _rescaled(noise: Noise, linearisation: Linearisation, belief: Belief, prior: Belief) -> Noise:
    """Noise at the robust scale of the residuals; never under what is stated, nor what is usual where too few residuals tell."""
    return _with_common(_at_scale(noise, linearisation, belief, prior), linearisation)


def _with_common(noise: Noise, linearisation: Linearisation) -> Noise:
    """The same with the share in common that readings of one pose show, by their median scatter; all of it where too few tell."""
    if linearisation.poses is None:
        return noise
    within = scatter_within(linearisation, noise.of_numbers(linearisation), robust=True)
    return replace(noise, common=np.where(within.freedom >= LEAST_FREEDOM, np.clip(1 - within.variance, 0.0, 1.0), 1.0))


def _at_scale(noise: Noise, linearisation: Linearisation, belief: Belief, prior: Belief) -> Noise:
    scales = kind_scales(linearisation, mahalanobis_squared(linearisation, noise))
    if linearisation.count - _used(belief, prior) < LEAST_FREEDOM:
        return noise.times(np.maximum(scales, 1.0))
    return noise.times(np.where(noise.stated, np.maximum(scales, 1.0), scales * _room(linearisation, belief, prior)))


def _used(belief: Belief, prior: Belief) -> float:
    """How many numbers the parameters used up."""
    return len(belief.x) - float(np.sum(np.diag(belief.P) / np.diag(prior.P)))


def _room(linearisation: Linearisation, belief: Belief, prior: Belief) -> float:
    """How many times smaller than the noise residuals are for the parameters having been fitted to them."""
    return (
        float(np.sqrt(linearisation.count / max(linearisation.count - _used(belief, prior), LEAST_FREEDOM)))
        if linearisation.count > LEAST_FREEDOM
        else 1.0
    )


def _covariance(linearisation: Linearisation, noise: Noise, belief: Belief, prior: Belief, loss: Loss) -> Matrix:
    """Covariance of an M-estimate, (p, p): it uses the share kappa = E[psi']^2 / E[psi^2] of what the data tell of x.

    The expectations are means over all numbers, E[psi^2] = E[w^2 d2] / m with Huber's n / (n - p) for few of them, and
    E[psi'] = E[w + 2 d2 w' / m] (Huber, Robust Statistics, 1981, chapter 7; Maronna, Annals of Statistics 4, 1976).
    """
    d2, m = np.nan_to_num(mahalanobis_squared(linearisation, noise)), degrees(linearisation)
    weights = np.where(m > 0, _weights(d2, m, loss), 0.0)
    slope = weights**2 * d2 / (_NU + m) if loss == "student" else np.where(weights < 1, weights / 2, 0.0)
    squared = np.sum(weights**2 * d2) / max(int(m.sum()), 1) * _room(linearisation, belief, prior) ** 2
    of_bulk = (np.sum(m * weights - 2 * slope) / max(int(m.sum()), 1)) ** 2
    kappa = min(of_bulk / max(squared, np.finfo(float).tiny), 1.0)  # where a fit runs through its data, residuals say nothing
    normal = noise.normal(linearisation)
    return taken_in(prior, replace(normal, A=kappa * normal.A)).P


def _weights(d2: Matrix, freedom: Matrix, loss: Loss) -> Matrix:
    safe = np.nan_to_num(d2)
    if loss == "student":
        return np.asarray((_NU + freedom) / (_NU + safe))
    return np.asarray(np.minimum(1.0, _HUBER * np.sqrt(freedom / 2 / np.maximum(safe, 1e-12))))


def _weighted(linearisation: Linearisation, weights: Matrix) -> Linearisation:
    """The same set with every observation's rows scaled by the root of its weight."""
    root = np.ones_like(linearisation.residual)
    for column, block in enumerate(linearisation.blocks):
        root[:, block.columns] = np.sqrt(weights[:, column, None])
    return replace(
        linearisation,
        residual=linearisation.residual * root,
        jacobian=lambda: linearisation.jacobian * root[..., None],
        root=root,
        joint_jacobian=linearisation.joint_jacobian * root[..., None],
    )


def gate(
    observed: Observations, prior: Belief, noise: Noise, first: Estimate, *, begin: Vector | None = None, **schedule: Any
) -> tuple[Estimate, Mask | None]:
    """Take out spots that the fit cannot explain, refit, and let back in what then fits.

    A spot is out when its beam does not meet the screen, or when its squared Mahalanobis distance (its share of the NIS) is beyond
    what chance gives any spot of a clean set of this size, at the scale of the bulk of the residuals. If the first fit finds none it
    stands. Otherwise a robust fit tells which they are.

    Args:
        observed: What was measured.
        prior: Before the data.
        noise: As stated, or where to start.
        first: Fit of all spots.
        begin: Where the robust fit begins; the prior mean if None.
        schedule: Passed on to the iterated schedule.

    Returns:
        The fit without outliers, and which spots it kept, (n, blocks); None if all.
    """
    if first.converged and inliers(observed, prior, first).all():
        return first, None
    estimate = iteratively_reweighted(observed, prior, noise, start=begin)
    kept = np.empty(0, dtype=bool)
    for _ in range(_GATE_ROUNDS):
        last, kept = kept, inliers(observed, prior, estimate)
        if observed.too_few(kept):
            return first, None
        if np.array_equal(kept, last):
            break
        estimate = iterated_schedule(
            lambda state, kept=kept: observed.at(state, kept),  # type: ignore[misc]
            prior,
            noise,
            start=estimate.belief.x,
            **schedule,
        )
    return estimate, None if kept.all() else kept


def inliers(observed: Observations, prior: Belief, found: Estimate) -> Mask:
    """Which spots chance could have put where they are, at the scale of the bulk, (n, blocks).

    What was not seen counts as inside, and so does what is known beforehand, since it was not read.
    """
    linearisation, met = observed.reached(found.belief.x)
    if observed.too_few(met):
        return met
    d2 = mahalanobis_squared(linearisation, found.noise)
    scales = observation_scales(linearisation, d2)  # an estimate may hold the outliers
    known = _stating(linearisation) | found.noise.stated[_kinds(linearisation)]
    if linearisation.count - _used(found.belief, prior) < LEAST_FREEDOM:
        known = np.ones_like(known)
    least = np.where(known, 1.0, (found.noise.times(0.0).sigma / found.noise.sigma)[_kinds(linearisation)])  # no sensor sees less
    scales = np.maximum(np.where(known, scales, scales * _room(linearisation, found.belief, prior)), least)
    return np.asarray(met & (~(d2 > _limits(linearisation) * scales**2) | _known(linearisation)))


def gross_outliers(observed: Observations, found: Estimate) -> Mask:
    """Which spots of poses that were not fitted are gross outliers, no matter of a calibration that is not good enough, (n, blocks).

    Their beam does not meet the screen, or their distance in units of what noise and the parameters' uncertainty explain is far
    beyond chance even at the scale of the bulk of these poses: a calibration that fails on all of them has no outliers.
    """
    linearisation, met = observed.reached(found.belief.x)
    if observed.too_few(met):
        return np.zeros_like(met)
    d2 = mahalanobis_squared(linearisation, found.noise, found.belief.P)
    scales = _MARGIN * np.maximum(observation_scales(linearisation, d2), 1.0)
    out = np.asarray(~met | (d2 > _limits(linearisation) * scales**2))
    return np.zeros_like(out) if observed.too_few(~out) else out


def conceivable(observed: Observations, found: Estimate) -> Mask:
    """Which observations chance could have put where they are, parameters being no surer than they are, (n, blocks)."""
    linearisation, met = observed.reached(found.belief.x)
    return np.asarray(met & ~(mahalanobis_squared(linearisation, found.noise, found.belief.P) > _limits(linearisation)))


def within_noise(linearisation: Linearisation, noise: Noise) -> Mask:
    """Which observations noise alone could have put where they are, (n, blocks)."""
    return np.asarray(~(mahalanobis_squared(linearisation, noise) > _limits(linearisation)))


def ordinary(linearisation: Linearisation, noise: Noise, kept: Mask) -> Mask:
    """Which observations lie no farther off than chance puts them at the scale of the bulk of those that were kept, (n, blocks)."""
    d2 = mahalanobis_squared(linearisation, noise)
    scales = observation_scales(linearisation, np.where(kept, d2, np.nan))
    return np.asarray(~(d2 > _limits(linearisation) * np.maximum(scales, 1.0) ** 2))


def _limits(linearisation: Linearisation) -> Matrix:
    """The squared distance that chance gives no observation of a clean set of this size, (n, blocks).

    Chi-squared of two degrees is exponential; to others the same probability is carried over by Wilson and Hilferty's cube root.
    """
    freedom = degrees(linearisation)
    pairs = -2 * np.log(_CHANCE / max(int(np.count_nonzero((freedom > 0) & ~_known(linearisation))), 1))
    z = ((pairs / 2) ** (1 / 3) - (1 - 1 / 9)) / np.sqrt(1 / 9)
    m = np.maximum(freedom, 1)
    return np.asarray(np.where(freedom == 2, pairs, m * (1 - 2 / (9 * m) + z * np.sqrt(2 / (9 * m))) ** 3))
