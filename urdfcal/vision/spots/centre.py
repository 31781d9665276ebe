"""The centre of a spot, to a fraction of a pixel: an elliptical Gaussian with a halo, fitted to the pixels that are not clipped.

    light_c(u) = core_c g(u; m, S) + halo_c g(u; m, s^2 S) + offset_c + slope_c . u,     g(u; m, S) = exp(-(u - m)' S^-1 (u - m) / 2)

in several channels c at once with a common centre m, shape S and halo scale s. The linear numbers of each channel are eliminated
(variable projection, Golub and Pereyra 1973), six remain. A clipped core is left out: the flanks hold the centre. Where the
neighbourhood is not smooth (markers), the fit takes the laser's colour minus the mean of the others, in which neutral structure cancels.

The covariance is the heteroscedasticity-consistent one (White 1980, HC1): the bright pixels of a spot are noisier than its
surroundings, and how much is read off the residuals, not assumed. It is never taken below the classical one.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from urdfcal.base.geometry import Array3, Matrix, Vector

_HALO = (1.7, 4.0)  # the halo is at least so many times as wide as the core, and up to so much more
_LEAST_WIDTH = 0.25  # [px]
_LEAST_PIXELS = 24
_NEAR = 0.1  # of the fitted spot's largest visible light
_GRAIN = 1.5  # squares of residuals that are grain
Mask = npt.NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class FittedSpot:
    """A fitted spot.

    Attributes:
        centre: (u, v), [px].
        covariance: Of the centre, (2, 2), [px^2].
        shape: S, (2, 2), [px^2].
        core: Height of the core in each fitted channel.
        explained: Share of the first channel's variation about its plane, its grain apart, that the spot explains.
        misfit: RMS residual of the first channel where the spot gives at least a tenth of its largest visible light.
    """

    centre: Vector
    covariance: Matrix
    shape: Matrix
    core: Vector
    explained: float
    misfit: float

    @property
    def widths(self) -> Vector:
        """Standard width along the longer and the shorter axis, [px]."""
        return np.asarray(np.sqrt(np.linalg.eigvalsh(self.shape)[::-1]))


def fit_spot(channels: Array3, usable: Mask, centre: Vector, radius: float, grain: float) -> FittedSpot | None:
    """Fit one spot.

    Args:
        channels: (k, h, w); the first holds most of the laser's light.
        usable: (k, h, w); False where a pixel is clipped.
        centre: Where to start, (u, v) in the window, [px].
        radius: Where the spot is at half of its height, about, [px].
        grain: Noise of the first channel from pixel to pixel; what it leaves unexplained counts for nothing.

    Returns:
        None where there are too few pixels or the fit comes to no end inside the window.
    """
    from scipy.optimize import least_squares

    problem = _Problem(channels, usable)
    if any(len(values) < _LEAST_PIXELS for values in problem.values):
        return None
    width = np.log(max(radius / 1.18, 0.5))
    start = np.array([*centre, width, 0.0, width, 0.0])
    lower = np.array([0, 0, np.log(_LEAST_WIDTH), -50, np.log(_LEAST_WIDTH), -8.0])
    upper = np.array([channels.shape[2] - 1, channels.shape[1] - 1, 4.6, 50, 4.6, 8.0])
    found = least_squares(
        problem.residual,
        np.clip(start, lower + 1e-6, upper - 1e-6),
        bounds=(lower, upper),
        x_scale="jac",
        xtol=1e-7,
        ftol=1e-9,
        max_nfev=60,
    )
    if not found.success or not np.isfinite(found.jac).all():
        return None
    return problem.result(found.x, found.fun, found.jac, grain)


class _Problem:
    """The residual of a window as a function of centre, shape and halo scale."""

    def __init__(self, channels: Array3, usable: Mask) -> None:
        rows, columns = np.mgrid[: channels.shape[1], : channels.shape[2]]
        self.places = [np.stack([columns[mask], rows[mask]], axis=1).astype(float) for mask in usable]
        self.values = [channel[mask] for channel, mask in zip(channels, usable, strict=True)]
        self.planes = [np.column_stack([np.ones(len(place)), place - place.mean(axis=0)]) for place in self.places]
        self.scales = [max(_spread(values), 0.5) for values in self.values]

    def residual(self, p: Vector) -> Vector:
        """Residuals of all channels at their best linear numbers, each over its channel's scale."""
        return np.concatenate([part / scale for (part, _), scale in zip(self.solved(p), self.scales, strict=True)])

    def solved(self, p: Vector) -> list[tuple[Vector, Vector]]:
        """Residual and linear numbers (core, halo, offset, slopes) of every channel."""
        return [self._channel(p, index) for index in range(len(self.values))]

    def _channel(self, p: Vector, index: int) -> tuple[Vector, Vector]:
        basis = np.column_stack([*_profiles(self.places[index], p), self.planes[index]])
        normal = basis.T @ basis
        normal[np.diag_indices_from(normal)] += 1e-9 * (1 + np.diag(normal))
        numbers: Vector = np.linalg.solve(normal, basis.T @ self.values[index])
        return self.values[index] - basis @ numbers, numbers

    def result(self, p: Vector, residual: Vector, jacobian: Matrix, grain: float) -> FittedSpot | None:
        parts = self.solved(p)
        core, halo = _profiles(self.places[0], p)
        spot = core * parts[0][1][0] + halo * parts[0][1][1]
        near = spot > _NEAR * spot.max()
        covariance = _covariance(residual, jacobian, len(p) + 5 * len(parts))
        first, values, plane = parts[0][0], self.values[0], self.planes[0]
        flat = values - plane @ np.linalg.lstsq(plane, values, rcond=None)[0]
        if covariance is None or not spot.max() > 0 or not (flat @ flat) > 0:
            return None
        return FittedSpot(
            p[:2].copy(),
            covariance,
            _shape(p),
            np.array([numbers[0] + numbers[1] for _, numbers in parts]),
            1.0 - max(float(first @ first) - _GRAIN * len(first) * grain**2, 0.0) / float(flat @ flat),
            float(np.sqrt(np.mean(first[near] ** 2))),
        )


def _profiles(places: Matrix, p: Vector) -> tuple[Vector, Vector]:
    """Core and halo at some places, (n,) each."""
    away = places - p[:2]
    first = away[:, 0] * np.exp(-p[2])
    second = (away[:, 1] - p[3] * first) * np.exp(-p[4])
    squared = (first**2 + second**2) / 2
    scale = _HALO[0] + _HALO[1] / (1 + np.exp(-p[5]))
    return np.exp(-squared), np.exp(-squared / scale**2)


def _shape(p: Vector) -> Matrix:
    """S = L L' from the Cholesky factor that the parameters hold."""
    factor = np.array([[np.exp(p[2]), 0.0], [p[3], np.exp(p[4])]])
    return np.asarray(factor @ factor.T)


def _covariance(residual: Vector, jacobian: Matrix, numbers: int) -> Matrix | None:
    """Covariance of the centre, (2, 2): the larger of White's and the classical one, axis by axis of their difference."""
    free = len(residual) - numbers
    normal = jacobian.T @ jacobian
    if free < 1 or not np.isfinite(normal).all():
        return None
    inverse: Any = np.linalg.pinv(normal)
    classical = inverse[:2, :2] * float(residual @ residual) / free
    middle = (jacobian * residual[:, None] ** 2).T @ jacobian
    white = (inverse @ middle @ inverse)[:2, :2] * len(residual) / free
    return np.asarray(classical if np.trace(classical) > np.trace(white) else white)


def _spread(values: Vector) -> float:
    return 1.4826 * float(np.median(np.abs(values - np.median(values))))
