"""Fits that outliers do not bend: iteratively reweighted least squares, and a gate that takes outliers out and lets them back in.

The weight of a spot with squared Mahalanobis distance d2 (two coordinates) is

    Student-t, nu degrees:  (nu + 2) / (nu + d2)
    Huber, limit k:         min(1, k / sqrt(d2))

The scale that d2 is measured in is the robust one of the present residuals, so that it is wide at the start, where honest geometric
errors are far larger than the noise, and shrinks as they are explained.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from urdfcal.ekf import Belief, Estimate, Linearise, Sweep, iterated_schedule
from urdfcal.geometry import MM, Matrix, Vector
from urdfcal.measurements import Mask, Measurements
from urdfcal.noise import Linearisation, Noise

Loss = Literal["student", "huber"]
_NU = 4.0
_HUBER = 2.0
_MEDIAN_OF_CHI2 = 2 * np.log(2.0)  # of two degrees of freedom
_ROUNDS = 60
_GATE_ROUNDS = 10
_CHANCE = 0.01  # probability that a gate takes out any spot of a clean set
_MOST_OUT = 0.4  # share of outliers beyond which there is no telling which is which


@dataclass(frozen=True)
class Outlier:
    """A spot that was left out.

    Attributes:
        pose: Label of the pose, with the file's line where there is one.
        laser: Laser link.
        distance_mm: Distance from where the calibrated robot has it.
        reason: Why it was left out, in words.
    """

    pose: str
    laser: str
    distance_mm: float
    reason: str


def squared_distances(here: Linearisation, noise: Noise) -> Matrix:
    """Squared Mahalanobis distance of every spot, (n, lasers), chi-squared with two degrees; nan where none was measured."""
    covariance = noise.pose_covariance(here)
    n, numbers = here.residual.shape
    spots = here.residual.reshape(n, numbers // 2, 2)
    blocks = np.stack([covariance[:, k : k + 2, k : k + 2] for k in range(0, numbers, 2)], axis=1)
    d2 = np.einsum("nli,nli->nl", spots, np.linalg.solve(blocks, spots[..., None])[..., 0])
    return np.where(here.measured[:, ::2], d2, np.nan)


def robust_scale(d2: Matrix) -> float:
    """How many times wider than assumed the bulk of the spots scatters, from the median squared distance."""
    return float(np.sqrt(np.nanmedian(d2) / _MEDIAN_OF_CHI2))


def reweighted(linearise: Linearise, prior: Belief, noise: Noise, *, loss: Loss = "student", start: Vector | None = None) -> Estimate:
    """Maximum a posteriori estimate under Student's or Huber's distribution, by iteratively reweighted steps.

    Spot noise that is not stated is the robust scale of the residual.

    Args:
        linearise: Residual and Jacobian of the whole set at a state.
        prior: Before the data.
        noise: Of the measurements.
        loss: `student` or `huber`.
        start: Where to begin; the prior mean by default.
    """
    x = prior.x if start is None else start
    estimate = Estimate(Belief(x, prior.P), "max_sweeps", noise)
    history: list[Sweep] = []
    for _ in range(_ROUNDS):
        here = linearise(x)
        if not here.usable:
            return replace(estimate, stop=here.trouble, history=history or [Sweep(x, np.nan, here.rms)])
        scaled = _rescaled(noise, here)
        weights = _weights(squared_distances(here, scaled), loss)
        estimate = iterated_schedule(
            lambda state, weights=weights: _weighted(linearise(state), weights),  # type: ignore[misc]
            prior,
            replace(scaled, stated=True),
            start=x,
            max_sweeps=3,
        )
        history += estimate.history[:1] if not history else []
        history += estimate.history[-1:]
        sigma = np.sqrt(np.diag(estimate.belief.P))
        moved, x = np.max(np.abs(estimate.belief.x - x) / sigma), estimate.belief.x
        if moved < 1e-3 and scaled.close_to(_rescaled(noise, linearise(x))):
            return replace(estimate, stop="converged", noise=replace(scaled, stated=noise.stated), history=history)
    return replace(estimate, stop="max_sweeps", noise=replace(scaled, stated=noise.stated), history=history)


def _rescaled(noise: Noise, here: Linearisation) -> Noise:
    """Noise at the robust scale of the residuals; never under what is stated."""
    scale = robust_scale(squared_distances(here, noise))
    return noise.times(max(scale, 1.0) if noise.stated else scale)


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


def without(here: Linearisation, kept: Mask) -> Linearisation:
    """The same set as if the spots that are not kept (n, lasers) had not been seen."""
    rows = np.repeat(kept, 2, axis=1)
    return replace(
        here,
        residual=np.where(rows, here.residual, 0.0),
        jacobian=here.jacobian * rows[..., None],
        joint_jacobian=here.joint_jacobian * rows[..., None],
        measured=here.measured & rows,
    )


def gate(
    linearise: Linearise, prior: Belief, noise: Noise, first: Estimate, *, begin: Vector | None = None, **schedule: Any
) -> tuple[Estimate, Mask | None]:
    """Take out spots that the fit cannot explain, refit, and let back in what then fits.

    A spot is out when its squared Mahalanobis distance (its share of the NIS) is beyond what chance gives any spot of a clean set of
    this size, at the scale of the bulk of the residuals. If the first fit finds none it stands. Otherwise a robust fit tells which
    they are.

    Args:
        linearise: Residual and Jacobian of the whole set at a state.
        prior: Before the data.
        noise: As stated, or where to start.
        first: Fit of all spots.
        begin: Where the robust fit begins; the prior mean if None.
        schedule: Passed on to the iterated schedule.

    Returns:
        The fit without outliers, and which spots it kept, (n, lasers); None if all.
    """
    here = linearise(first.belief.x)
    if not here.usable or (first.converged and _inside(here, first.noise)[here.measured[:, ::2]].all()):
        return first, None
    estimate = reweighted(linearise, prior, noise, start=begin)
    kept = np.empty(0, dtype=bool)
    for _ in range(_GATE_ROUNDS):
        here = linearise(estimate.belief.x)
        if not here.usable:
            return first, None
        inside = _inside(here, estimate.noise)
        out = 1 - inside[here.measured[:, ::2]].mean()
        if out > _MOST_OUT:
            return first, None
        if np.array_equal(inside, kept):
            break
        kept = inside
        estimate = iterated_schedule(
            lambda state, kept=kept: without(linearise(state), kept),  # type: ignore[misc]
            prior,
            noise,
            start=estimate.belief.x,
            **schedule,
        )
    return estimate, kept if not kept[here.measured[:, ::2]].all() else None


def _inside(here: Linearisation, noise: Noise) -> Mask:
    """Which spots chance could have put where they are, at the scale of the bulk; what was not measured counts as inside."""
    d2 = squared_distances(here, noise)
    scale = max(robust_scale(d2), 1.0) if noise.stated else robust_scale(d2)  # noise that was estimated may hold the outliers themselves
    limit = -2 * np.log(_CHANCE / max(here.count // 2, 1)) * scale**2  # chi-squared of two degrees is exponential
    return np.asarray(np.isnan(d2) | (d2 <= limit))


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
