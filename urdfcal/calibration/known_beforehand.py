"""What is known beforehand, as further rows of a linearisation: distances between places, sums that are held, earlier calibrations."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from urdfcal.base.geometry import Array3, Matrix, Vector
from urdfcal.estimation.residual import Linearisation
from urdfcal.model.error_model import ErrorModel
from urdfcal.sensors.readings import KnownLength

Known = tuple[float, Vector, float]  # residual, gradient and standard deviation
_SMALL = 1e-6  # standard deviation of a whitened row, so that it is nothing among residuals in metres
_HELD = 1e-8  # [m] standard deviation of a sum that is held


def known_rows(errors: ErrorModel, lengths: Sequence[KnownLength], x: Vector) -> list[Known]:
    """What is known beforehand: distances between places, a sum of parameters that is held, and what an earlier calibration decided.

    Residual, gradient and standard deviation of each.
    """
    known = [_length_row(errors, length, x) for length in lengths] + ([_sum_row(errors, x)] if errors.held_sum else [])
    return known + [(-_SMALL * float(row @ x), _SMALL * row, _SMALL) for row in errors.known_rows]


def products(known: Sequence[Known]) -> Matrix:
    """[J r]'[J r] of what is known beforehand, whitened, (p + 1, p + 1)."""
    rows = np.array([np.append(gradient, left) / deviation for left, gradient, deviation in known])
    return np.asarray(rows.T @ rows)


def stacked(known: Sequence[Known], m: int, p: int) -> Array3:
    """Gradients of what is known beforehand, each in the first number of its row, (rows, m, p)."""
    rows = np.zeros((len(known), m, p))
    rows[:, 0] = [gradient for _, gradient, _ in known]
    return rows


def with_known(linearisation: Linearisation, known: Sequence[Known], jacobian: Callable[[], Array3]) -> Linearisation:
    """The same with what is known beforehand as further rows; they are in the Jacobian, which is worked out when it is asked for."""
    rows, m = len(known), linearisation.residual.shape[1]
    residual, sigma = np.zeros((rows, m)), np.full((rows, m), np.nan)
    for row, (left, _, deviation) in enumerate(known):
        residual[row, 0], sigma[row, 0] = left, deviation
    return replace(
        linearisation,
        jacobian=jacobian,
        known=rows,
        residual=np.vstack([linearisation.residual, residual]),
        joint_jacobian=np.concatenate([linearisation.joint_jacobian, np.zeros((rows, m, linearisation.joint_jacobian.shape[2]))]),
        measured=np.vstack([linearisation.measured, ~np.isnan(sigma)]),
        stated_sigma=np.vstack([linearisation.stated_sigma, sigma]),
        lost=None
        if linearisation.lost is None
        else np.vstack([linearisation.lost, np.zeros((rows, len(linearisation.blocks)), dtype=bool)]),
        poses=None
        if linearisation.poses is None
        else np.concatenate([linearisation.poses, linearisation.poses.max() + 1 + np.arange(rows)]),
    )


def _length_row(errors: ErrorModel, known: KnownLength, x: Vector) -> tuple[float, Vector, float]:
    """Residual, gradient and standard deviation of a known distance; its places are free, or held."""
    ends = [[f"{place}.{axis}" for axis in "xyz"] for place in (known.one, known.other)]
    one, other = ([errors.value(name, x) for name in end] for end in ends)
    apart = np.subtract(one, other)
    length = max(float(np.linalg.norm(apart)), 1e-9)
    gradient = np.zeros(len(x))
    for sign, end in zip((1.0, -1.0), ends, strict=True):
        for name, share in zip(end, apart / length, strict=True):
            if name in errors.column:
                gradient[errors.column[name]] = sign * share
    return known.length - length, gradient, known.sigma


def _sum_row(errors: ErrorModel, x: Vector) -> tuple[float, Vector, float]:
    gradient = np.array([errors.held_sum.get(name, 0.0) for name in errors.names])
    return -float(gradient @ x), gradient, _HELD
