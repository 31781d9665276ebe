"""Noise beyond what is stated with each reading.

What a column states is what the sensor knows of itself: how well a camera finds a spot. An arm that does not come back to where it
was, and what no error model follows, come on top, and no column tells how much. Where readings scatter more than they state, the
rest is estimated and added to each of them, s_i^2 = stated_i^2 + extra^2, by kind, so that their shares stay: a spot that is seen at
a slant still counts for less.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from urdfcal.base.geometry import Matrix, Vector
from urdfcal.calibration.problem import Problem
from urdfcal.estimation.ekf import Belief, posterior
from urdfcal.estimation.noise import Noise
from urdfcal.estimation.pose_means import beyond
from urdfcal.estimation.residual import Linearisation
from urdfcal.sensors.measurements import Measurements
from urdfcal.sensors.registry import WORDS

MORE = 2.0  # sigmas of chi-squared beyond which noise is added: little is lost where that was chance
_ROUNDS = 20
_SAME = 0.01  # share of s by which it may be off


def without_stated_noise(data: Measurements) -> Measurements:
    """The same measurements as if none stated its noise."""
    readings = tuple(replace(reading, sigma=np.full_like(reading.sigma, np.nan)) for reading in data.readings)
    return replace(data, readings=readings)


def extra_noise(fitted: Problem, x: Vector, noise: Noise, data: Measurements, kinds: Sequence[str]) -> dict[str, float]:
    """What has to be added to the stated noise, by kind, [m], [rad] or [px]: the s that makes chi-squared its degrees of freedom.

    Both change with s, since precise readings draw the fit more. So in turn: residuals and leverages of the linearised fit with the
    present s, and the s that suits them.

    Args:
        fitted: Model of what was fitted, without outliers.
        x: Where it is linearised, (p,).
        noise: Of the joints, and of readings that state none.
        data: The measurements with what they state.
        kinds: Kinds that scatter more than they state.
    """
    linearisation, errors = fitted.linearise(x), fitted.errors
    sigma, prior = Problem(errors, data).stated_sigma, Belief.independent(errors.mean, errors.sigma)
    index = {kind: data.kinds.index(kind) for kind in kinds}
    extra = dict.fromkeys(kinds, 0.0)
    variance = _variance(linearisation, sigma, noise)
    own = {kind: linearisation.measured[: len(data)] & np.isfinite(variance) & (linearisation.kinds == index[kind]) for kind in kinds}
    for _ in range(_ROUNDS):
        last, now = extra, _with_sigma(linearisation, sigma, {index[kind]: s for kind, s in extra.items()})
        squares, free = (each[: len(data)] for each in _refitted(now, noise, prior, x))
        extra = {kind: beyond(variance[rows], squares[rows], float(free[rows].sum())) for kind, rows in own.items()}
        if all(abs(extra[kind] - last[kind]) <= _SAME * extra[kind] for kind in kinds):
            break
    return {kind: s for kind, s in extra.items() if s > 0}


def _with_sigma(linearisation: Linearisation, sigma: Matrix, extra: Mapping[int, float]) -> Linearisation:
    """The set with every number's stated noise (n, m) widened by that of its kind."""
    wider = np.array([extra.get(kind, 0.0) for kind in linearisation.kinds.tolist()])
    stated = linearisation.stated_sigma.copy()
    stated[: len(sigma)] = np.hypot(sigma, wider)
    return replace(linearisation, stated_sigma=stated)


def _refitted(linearisation: Linearisation, noise: Noise, prior: Belief, x: Vector) -> tuple[Matrix, Matrix]:
    """Squared residuals once the linearised set was fitted from x with this noise, and their degrees of freedom 1 - h, both (n, m)."""
    weights, P = noise.weights(linearisation), posterior(linearisation, prior, noise)
    H = weights.jacobian(linearisation)
    gradient = H.T @ weights.residual(linearisation) + (prior.x - x) / np.diag(prior.P)
    squares = (linearisation.residual - linearisation.jacobian @ (P @ gradient)) ** 2
    if linearisation.poses is None:
        return squares, 1 - linearisation.leverages(H, P)
    variance = np.diagonal(noise.pose_covariance(linearisation), axis1=1, axis2=2)
    drawn = np.sum((linearisation.jacobian @ P) * linearisation.jacobian, axis=-1) / variance
    return linearisation.shares * squares, linearisation.shares * (1 - drawn)


def _variance(linearisation: Linearisation, sigma: Matrix, noise: Noise) -> Matrix:
    """Variance of every number as it is stated with it and as the readings of the joints explain it, (n, m); nan where none is stated."""
    of_joints = np.sum((linearisation.joint_jacobian * noise.joint_sigma) ** 2, axis=-1)[: len(sigma)] if noise.of_joints else 0.0
    return np.asarray(sigma**2 + of_joints)


def widened(data: Measurements, extra: Mapping[str, float]) -> Measurements:
    """The measurements with more noise than they state."""
    if not extra:
        return data
    readings = tuple(replace(reading, sigma=np.hypot(reading.sigma, extra.get(reading.noise, 0.0))) for reading in data.readings)
    return replace(data, readings=readings)


def in_words(extra: Mapping[str, float]) -> tuple[str, ...]:
    """A warning for each kind that scatters more than it states."""
    warnings = []
    for kind, size in extra.items():
        warnings.append(
            f"the {WORDS[kind].several} scatter more than their .sigma columns state: {WORDS[kind].told(size)} were added to "
            "each in quadrature, as noise that the sensor does not know of"
        )
    return tuple(warnings)
