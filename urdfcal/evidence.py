"""Prior scales and spot noise chosen by the data: type-II maximum likelihood, MacKay's fixed point.

How large the errors of a robot's joints are is itself unknown. With the residual linearised at the present estimate, y = J dx + noise,
the scale of each group of parameters that makes the data most probable satisfies

    scale_g^2 = (sum of dx_i^2 + nu s_g^2) / (gamma_g + nu),   gamma_g = sum of (1 - P_ii / scale_g^2),
    noise^2   = |y - J dx|^2 / (n - gamma)

gamma counts the parameters that the data, not the prior, decide (MacKay, Bayesian interpolation, 1992). A start value s_g enters as
nu observations, so that a few poses cannot talk a scale to zero. Groups are the joints' translations, their rotations across the
axis and their zero offsets; mount, screen and beams keep the priors that are stated.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from urdfcal.ekf import Belief, Estimate, Linearise, iterated_schedule
from urdfcal.error_model import ErrorModel, Parameter
from urdfcal.geometry import Matrix, Vector
from urdfcal.noise import Noise

START_SCALES = {"translation": 0.3e-3, "rotation": 0.7e-3, "zero": 3e-3}  # [m] and [rad]: quartiles of real arms lie around them
LEAST_POSES = 20  # with fewer the scales cannot be told from the errors themselves
_NU = 1.0
_ROUNDS, _FIXED_POINT_ROUNDS = 8, 300
_REST = 1e-3


@dataclass(frozen=True)
class Evidence:
    """Scales that the data chose.

    Attributes:
        scales: Prior standard deviation of each group, [m] and [rad].
        spot_sigma: Noise of a spot coordinate, [m].
    """

    scales: dict[str, float]
    spot_sigma: float


def group_of(parameter: Parameter) -> str:
    """Which scale a parameter's prior has: `translation`, `rotation`, `zero`, or empty where its prior is kept."""
    if parameter.kind != "joint":
        return ""
    return "translation" if parameter.unit == "m" else "zero" if parameter.name.endswith(".d_theta") else "rotation"


def by_evidence(
    linearise: Linearise, errors: ErrorModel, noise: Noise, first: Estimate, keep: Sequence[str] = ()
) -> tuple[ErrorModel, Estimate, Evidence]:
    """Choose scales by evidence and refit, in turn, until both stand still.

    Args:
        linearise: Residual and Jacobian of the whole set at a state.
        errors: Parameters, with the priors that mount, screen and beams keep.
        noise: Of the measurements; estimated with the scales unless stated.
        first: Fit with the priors of `errors`, where the first linearisation is taken.
        keep: Parameters whose stated prior is kept.

    Returns:
        The error model with the chosen priors, the fit under them, and the scales.
    """
    groups = ["" if parameter.name in keep else group_of(parameter) for parameter in errors.parameters]
    found, scales, spot = first, dict(START_SCALES), first.noise.spot_sigma
    for _ in range(_ROUNDS):
        before = np.array([*scales.values(), spot])
        scales, spot = _chosen(linearise, errors, groups, replace(noise, spot_sigma=spot), found.belief.x, scales)
        errors = _with_scales(errors, groups, scales)
        prior = Belief(errors.mean, np.diag(errors.sigma**2))
        found = iterated_schedule(linearise, prior, replace(noise, spot_sigma=spot, stated=True), start=found.belief.x)
        if np.max(np.abs(np.array([*scales.values(), spot]) / before - 1)) < _REST:
            break
    return errors, replace(found, noise=replace(found.noise, stated=noise.stated)), Evidence(scales, spot)


def _with_scales(errors: ErrorModel, groups: Sequence[str], scales: dict[str, float]) -> ErrorModel:
    chosen = [
        replace(parameter, sigma=scales[group]) if group else parameter for parameter, group in zip(errors.parameters, groups, strict=True)
    ]
    return replace(errors, parameters=tuple(chosen))


def _chosen(
    linearise: Linearise, errors: ErrorModel, groups: Sequence[str], noise: Noise, x: Vector, scales: dict[str, float]
) -> tuple[dict[str, float], float]:
    """MacKay's fixed point at one linearisation."""
    here = linearise(x)
    weights = noise.weights(here)
    J, r = weights.jacobian(here), weights.residual(here)
    y = r + J @ (x - errors.mean)
    A, b, c, n = J.T @ J, J.T @ y, float(y @ y), here.count
    members = {group: np.array([own == group for own in groups]) for group in scales}
    factor, scales = 1.0, dict(scales)
    for _ in range(_FIXED_POINT_ROUNDS):
        sigma = np.array([scales[group] if group else parameter.sigma for group, parameter in zip(groups, errors.parameters, strict=True)])
        P = np.linalg.inv(A / factor**2 + np.diag(1 / sigma**2))
        dx = P @ b / factor**2
        decided = 1 - np.diag(P) / sigma**2
        last = np.array([*scales.values(), factor])
        for group, own in members.items():
            if own.any():
                scales[group] = _scale(dx[own], decided[own], START_SCALES[group])
        if not noise.stated:
            factor = float(np.sqrt(max(c - 2 * b @ dx + dx @ A @ dx, 1e-12 * c) / max(n - decided.sum(), 1.0)))
        if np.max(np.abs(np.array([*scales.values(), factor]) / last - 1)) < _REST / 10:
            break
    return scales, noise.times(factor).spot_sigma


def _scale(dx: Vector, decided: Matrix, start: float) -> float:
    return float(np.sqrt((np.sum(dx**2) + _NU * start**2) / (decided.sum() + _NU)))
