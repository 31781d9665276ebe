"""Noise beyond what is stated with each reading.

What a column states is what the sensor knows of itself: how well a camera finds a spot. An arm that does not come back to where it
was, and what no error model follows, come on top, and no column tells how much. Where readings scatter more than they state, the
rest is estimated and added to each of them, s_i^2 = stated_i^2 + extra^2, by kind, so that their shares stay: a spot that is seen at
a slant still counts for less.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from urdfcal.fit_result import FitResult
from urdfcal.geometry import Matrix, Vector
from urdfcal.measurements import Measurements
from urdfcal.noise import LEAST_FREEDOM, Linearisation, Noise
from urdfcal.reading_kinds import KINDS
from urdfcal.spot_model import SpotModel, kinds_of, model_for

_SURE = 4.0  # sigmas of chi-squared beyond which there is more noise than stated
_STILL = 1e-9  # share of s^2


def states_noise(data: Measurements) -> bool:
    """Whether any reading states its own noise."""
    own = [data.sigma[data.seen], *(each.sigma[each.seen] for each in data.readings)]
    return any(np.isfinite(sigma).any() for sigma in own)


def without_stated_noise(data: Measurements) -> Measurements:
    """The same measurements as if none stated its noise."""
    readings = tuple(replace(each, sigma=np.full_like(each.sigma, np.nan)) for each in data.readings)
    return replace(data, sigma=np.full_like(data.sigma, np.nan), readings=readings)


def extra_noise(loosely: FitResult, data: Measurements) -> dict[str, float]:
    """What has to be added to the stated noise, by kind, [m], [rad] or [px]; nothing of kinds that scatter as they state.

    Args:
        loosely: The fit of these measurements without what they state.
        data: The measurements with what they state.
    """
    noise = loosely.estimate.noise
    if not loosely.converged:
        return {}
    here = model_for(loosely.errors, loosely.data, noise).linearise(loosely.x)
    known_of, found = _stated_variance(here, SpotModel(loosely.errors, data).stated_sigma, noise), {}
    for kind, name in enumerate(kinds_of(data)):
        own = here.measured[: len(data)] & np.isfinite(known_of) & (here.kinds == kind)
        free = np.count_nonzero(own) * loosely.freedom / max(here.count, 1)
        if free < LEAST_FREEDOM:
            continue
        known, seen = known_of[own], here.residual[: len(data)][own] ** 2 * np.count_nonzero(own) / free
        if np.mean(seen / known) > 1 + _SURE * np.sqrt(2 / free):
            found[name] = _beyond(known, seen)
    return found


def _stated_variance(here: Linearisation, sigma: Matrix, noise: Noise) -> Matrix:
    """Variance of every number as it is stated with it and as the readings of the joints explain it, (n, m); nan where none is stated."""
    of_joints = np.sum((here.joint_jacobian * noise.joint_sigma) ** 2, axis=-1)[: len(sigma)] if noise.of_joints else 0.0
    return np.asarray(sigma**2 + of_joints)


def _beyond(known: Vector, seen: Vector) -> float:
    """The s with mean(seen / (known + s^2)) = 1, where that mean is above 1 at s = 0; all of them squares.

    The mean falls with s^2 and is convex, so that Newton's steps from 0 rise to the solution and never pass it.
    """
    s_squared, step = 0.0, np.inf
    while step > _STILL * s_squared:
        weights = 1 / (known + s_squared)
        step = float((np.mean(seen * weights) - 1) / np.mean(seen * weights**2))
        s_squared += step
    return float(np.sqrt(s_squared))


def widened(data: Measurements, extra: Mapping[str, float]) -> Measurements:
    """The measurements with more noise than they state."""
    if not extra:
        return data
    readings = tuple(replace(each, sigma=np.hypot(each.sigma, extra.get(each.kind, 0.0))) for each in data.readings)
    return replace(data, sigma=np.hypot(data.sigma, extra.get("spot", 0.0)), readings=readings)


def in_words(extra: Mapping[str, float]) -> tuple[str, ...]:
    """A warning for each kind that scatters more than it states."""
    warnings = []
    for kind, size in extra.items():
        warnings.append(
            f"the {KINDS[kind].several} scatter more than their .sigma columns state: {KINDS[kind].told(size)} were added to "
            "each in quadrature, as noise that the sensor does not know of"
        )
    return tuple(warnings)
