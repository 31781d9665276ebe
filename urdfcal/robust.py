"""Fits that outliers do not bend: iteratively reweighted least squares, and a gate that takes outliers out and lets them back in.

The weight of a spot with squared Mahalanobis distance d2 (two coordinates) is

    Student-t, nu degrees:  (nu + 2) / (nu + d2)
    Huber, limit k:         min(1, k / sqrt(d2))

The scale that d2 is measured in is the robust one of the present residuals, so that it is wide at the start, where honest geometric
errors are far larger than the noise, and shrinks as they are explained.

A wrong joint reading can turn a beam away from the screen, where it has no residual at all. Such spots are left out of a step, as are
those so far off that they have no say but could bar the way, and all are looked at again after it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from urdfcal.ekf import Belief, Estimate, Linearise, Sweep, iterated_schedule
from urdfcal.geometry import MM, Matrix, Vector
from urdfcal.measurements import Mask, Measurements
from urdfcal.noise import LEAST_FREEDOM, Linearisation, Noise

Loss = Literal["student", "huber"]
_NU = 4.0
_HUBER = 2.0
_NO_SAY = 100.0  # [scales] spots farther off than this are left out of a step
_MEDIAN_OF_CHI2 = 2 * np.log(2.0)  # of two degrees of freedom
_ROUNDS = 60
_GATE_ROUNDS = 10
_CHANCE = 0.01  # probability that a gate takes out any spot of a clean set
_MARGIN = 3.0  # times that a spot that was not fitted must be farther off to be one: the model's own faults have long tails
_MOST_OUT = 0.4  # share of outliers beyond which there is no telling which is which


@dataclass(frozen=True)
class Outlier:
    """A spot that was left out.

    Attributes:
        pose: Label of the pose, with the file's line where there is one.
        laser: Laser link.
        distance_mm: Distance from where the calibrated robot has it; None where it has none, since the beam does not meet the screen.
        reason: Why it was left out, in words.
    """

    pose: str
    laser: str
    distance_mm: float | None
    reason: str


def squared_distances(here: Linearisation, noise: Noise, uncertainty: Matrix | None = None) -> Matrix:
    """Squared Mahalanobis distance of every spot, (n, lasers), chi-squared with two degrees; nan where none was measured.

    Args:
        here: Residual and Jacobian.
        noise: Of the measurements.
        uncertainty: Covariance of the parameters, (p, p), for spots that were not fitted: S = R + J P J' in place of R.
    """
    covariance = noise.pose_covariance(here)
    if uncertainty is not None:
        covariance = covariance + here.jacobian @ uncertainty @ here.jacobian.transpose(0, 2, 1)
    n, numbers = here.residual.shape
    spots = here.residual.reshape(n, numbers // 2, 2)
    blocks = np.stack([covariance[:, k : k + 2, k : k + 2] for k in range(0, numbers, 2)], axis=1)
    d2 = np.einsum("nli,nli->nl", spots, np.linalg.solve(blocks, spots[..., None])[..., 0])
    return np.where(here.measured[:, ::2], d2, np.nan)


def robust_scale(d2: Matrix) -> float:
    """How many times wider than assumed the bulk of the spots scatters, from the median squared distance."""
    return float(np.sqrt(np.nanmedian(d2) / _MEDIAN_OF_CHI2))


@dataclass(frozen=True)
class Spots:
    """The measured spots, of which any may be left out.

    Attributes:
        linearise: Residual and Jacobian of the whole set at a state.
        missed: Which of the beams that were seen do not meet the screen at a state, (n, lasers).
        seen: Which beams were seen, (n, lasers).
    """

    linearise: Linearise
    missed: Callable[[Vector], Mask]
    seen: Mask

    def at(self, x: Vector, kept: Mask) -> Linearisation:
        """The set at x as if the spots that are not kept (n, lasers) had not been seen."""
        return self._without(self.linearise(x), x, kept)

    def reached(self, x: Vector) -> tuple[Linearisation, Mask]:
        """The set at x without the beams that do not meet the screen there, and which those are not, (n, lasers)."""
        here = self.linearise(x)
        met = np.ones_like(self.seen) if here.usable else ~self.missed(x)
        return self._without(here, x, met), met

    def too_few(self, kept: Mask) -> bool:
        """Whether so many are left out that there is no telling which are right."""
        return bool(np.mean(kept[self.seen]) < 1 - _MOST_OUT)

    def _without(self, here: Linearisation, x: Vector, kept: Mask) -> Linearisation:
        if kept.all():
            return here
        rows = np.repeat(kept, 2, axis=1)
        left = replace(
            here,
            residual=np.where(rows, here.residual, 0.0),
            jacobian=np.where(rows[..., None], here.jacobian, 0.0),
            joint_jacobian=np.where(rows[..., None], here.joint_jacobian, 0.0),
            measured=here.measured & rows,
        )
        return left if here.usable else replace(left, trouble=self._trouble(left, x, kept))

    def _trouble(self, left: Linearisation, x: Vector, kept: Mask) -> str:
        if (self.missed(x) & kept).any():
            return "left_screen"
        return "" if np.isfinite(left.residual).all() and np.isfinite(left.jacobian).all() else "not_finite"


def reweighted(spots: Spots, prior: Belief, noise: Noise, *, loss: Loss = "student", start: Vector | None = None) -> Estimate:
    """Maximum a posteriori estimate under Student's or Huber's distribution, by iteratively reweighted steps.

    Spot noise that is not stated is the robust scale of the residual.

    Args:
        spots: What was measured.
        prior: Before the data.
        noise: Of the measurements.
        loss: `student` or `huber`.
        start: Where to begin; the prior mean by default.
    """
    belief = Belief(prior.x if start is None else start, prior.P)
    estimate, heard = Estimate(belief, "max_sweeps", noise), np.empty(0, dtype=bool)
    here, met = spots.reached(belief.x)
    history: list[Sweep] = []
    for _ in range(_ROUNDS):
        if not here.usable or spots.too_few(met):
            return replace(estimate, stop=here.trouble or "left_screen", history=history or [Sweep(belief.x, np.nan, here.rms)])
        scaled = _rescaled(noise, here, belief, prior)
        d2, last = squared_distances(here, scaled), heard
        heard, weights = met & ~(d2 > _NO_SAY**2), _weights(d2, loss)
        estimate = iterated_schedule(
            lambda state, heard=heard, weights=weights: _weighted(spots.at(state, heard), weights),  # type: ignore[misc]
            prior,
            replace(scaled, stated=True),
            start=belief.x,
            max_sweeps=3,
        )
        history += estimate.history[:1] if not history else []
        history += estimate.history[-1:]
        moved = np.max(np.abs(estimate.belief.x - belief.x) / np.sqrt(np.diag(estimate.belief.P)))
        belief = estimate.belief
        here, met = spots.reached(belief.x)
        if moved < 1e-3 and np.array_equal(heard, last) and scaled.close_to(_rescaled(noise, here, belief, prior)):
            return replace(estimate, stop="converged", noise=replace(scaled, stated=noise.stated), history=history)
    return replace(estimate, stop="max_sweeps", noise=replace(scaled, stated=noise.stated), history=history)


def _rescaled(noise: Noise, here: Linearisation, belief: Belief, prior: Belief) -> Noise:
    """Noise at the robust scale of the residuals; never under what is stated."""
    scale = robust_scale(squared_distances(here, noise))
    return noise.times(max(scale, 1.0) if noise.stated else scale * _room(here, belief, prior))


def _room(here: Linearisation, belief: Belief, prior: Belief) -> float:
    """How many times smaller than the noise residuals are for the parameters having been fitted to them."""
    used = len(belief.x) - float(np.sum(np.diag(belief.P) / np.diag(prior.P)))
    return float(np.sqrt(here.count / max(here.count - used, LEAST_FREEDOM))) if here.count > LEAST_FREEDOM else 1.0


def _weights(d2: Matrix, loss: Loss) -> Matrix:
    safe = np.nan_to_num(d2)
    if loss == "student":
        return np.asarray((_NU + 2) / (_NU + safe))
    return np.asarray(np.minimum(1.0, _HUBER / np.sqrt(np.maximum(safe, 1e-12))))


def _weighted(here: Linearisation, weights: Matrix) -> Linearisation:
    """The same set with every spot's rows scaled by the root of its weight."""
    root = np.repeat(np.sqrt(weights), 2, axis=1)
    return replace(
        here, residual=here.residual * root, jacobian=here.jacobian * root[..., None], joint_jacobian=here.joint_jacobian * root[..., None]
    )


def gate(
    spots: Spots, prior: Belief, noise: Noise, first: Estimate, *, begin: Vector | None = None, **schedule: Any
) -> tuple[Estimate, Mask | None]:
    """Take out spots that the fit cannot explain, refit, and let back in what then fits.

    A spot is out when its beam does not meet the screen, or when its squared Mahalanobis distance (its share of the NIS) is beyond
    what chance gives any spot of a clean set of this size, at the scale of the bulk of the residuals. If the first fit finds none it
    stands. Otherwise a robust fit tells which they are.

    Args:
        spots: What was measured.
        prior: Before the data.
        noise: As stated, or where to start.
        first: Fit of all spots.
        begin: Where the robust fit begins; the prior mean if None.
        schedule: Passed on to the iterated schedule.

    Returns:
        The fit without outliers, and which spots it kept, (n, lasers); None if all.
    """
    if first.converged and inside(spots, prior, first).all():
        return first, None
    estimate = reweighted(spots, prior, noise, start=begin)
    kept = np.empty(0, dtype=bool)
    for _ in range(_GATE_ROUNDS):
        last, kept = kept, inside(spots, prior, estimate)
        if spots.too_few(kept):
            return first, None
        if np.array_equal(kept, last):
            break
        estimate = iterated_schedule(
            lambda state, kept=kept: spots.at(state, kept),  # type: ignore[misc]
            prior,
            noise,
            start=estimate.belief.x,
            **schedule,
        )
    return estimate, None if kept.all() else kept


def inside(spots: Spots, prior: Belief, found: Estimate) -> Mask:
    """Which spots chance could have put where they are, at the scale of the bulk; what was not seen counts as inside, (n, lasers)."""
    here, met = spots.reached(found.belief.x)
    if spots.too_few(met):
        return met
    d2 = squared_distances(here, found.noise)
    scale = _rescaled(found.noise, here, found.belief, prior).spot_sigma / found.noise.spot_sigma  # an estimate may hold the outliers
    return np.asarray(met & ~(d2 > _limit(here) * scale**2))


def beyond_belief(spots: Spots, found: Estimate) -> Mask:
    """Which spots of poses that were not fitted are gross outliers, no matter of a calibration that is not good enough, (n, lasers).

    Their beam does not meet the screen, or their distance in units of what noise and the parameters' uncertainty explain is far
    beyond chance even at the scale of the bulk of these poses: a calibration that fails on all of them has no outliers.
    """
    here, met = spots.reached(found.belief.x)
    if spots.too_few(met):
        return np.zeros_like(met)
    d2 = squared_distances(here, found.noise, found.belief.P)
    scale = _MARGIN * max(robust_scale(d2), 1.0)
    out = np.asarray(~met | (d2 > _limit(here) * scale**2))
    return np.zeros_like(out) if spots.too_few(~out) else out


def _limit(here: Linearisation) -> float:
    """The squared distance that chance gives no spot of a clean set of this size; chi-squared of two degrees is exponential."""
    return float(-2 * np.log(_CHANCE / max(here.count // 2, 1)))


def swapped_poses(data: Measurements, spots: Any, inside_mm: float) -> list[tuple[int, int, int]]:
    """Poses at which two beams were read for each other: each measured spot lies at the other's predicted place.

    Args:
        data: Measurements.
        spots: Predicted spots, (n, lasers, 2), [m].
        inside_mm: How near counts as at the place, [mm].

    Returns:
        (pose, laser, laser) for each.
    """
    found = []
    lasers = len(data.lasers)
    for one in range(lasers):
        for other in range(one + 1, lasers):
            own = [np.linalg.norm(data.spots[:, k] - spots[:, k], axis=-1) / MM for k in (one, other)]
            crossed = [np.linalg.norm(data.spots[:, k] - spots[:, j], axis=-1) / MM for k, j in ((one, other), (other, one))]
            with np.errstate(invalid="ignore"):
                swapped = (np.minimum(*own) > inside_mm) & (np.maximum(*crossed) < inside_mm)
            found += [(int(pose), one, other) for pose in np.flatnonzero(swapped)]
    return found
