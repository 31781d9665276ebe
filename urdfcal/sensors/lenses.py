"""Three lenses, from points in camera axes to pixels, with the derivatives; and the way back.

Camera axes are OpenCV's: x right, y down, z ahead; pixel (0, 0) is the centre of the first pixel. With x = X / Z, y = Y / Z,
s = x^2 + y^2 (OpenCV, `calib3d`):

    plain      distorted = (x, y) (1 + k1 s + k2 s^2 + k3 s^3)                                   + tangential terms of p1, p2
    rational   distorted = (x, y) (1 + k1 s + k2 s^2 + k3 s^3) / (1 + k4 s + k5 s^2 + k6 s^3)    + tangential terms of p1, p2
    fisheye    distorted = (x, y) / r * theta (1 + k1 theta^2 + ... + k4 theta^8),  r = sqrt(s), theta = atan(r)

The polynomials turn back somewhere outside the picture, and what is far off the axis would be put into the picture's middle:
beyond the first place where the distorted radius stops growing nothing is seen (nan).
"""

from __future__ import annotations

from functools import lru_cache
from typing import Literal

import cv2
import numpy as np
from numpy.polynomial import Polynomial

from urdfcal.base.geometry import Array3, Mask, Matrix, Vector

Lens = Literal["plain", "rational", "fisheye"]
DISTORTION_NAMES: dict[Lens, tuple[str, ...]] = {
    "plain": ("k1", "k2", "p1", "p2", "k3"),
    "rational": ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"),
    "fisheye": ("k1", "k2", "k3", "k4"),
}
_WIDEST = np.radians(85.0)  # off the axis; a flat picture of more is beyond any lens model here
_NEWTON_STEPS = 12
_CLOSE_PX = 1e-7
_STEP_PX = 16.0  # between the pixels of a grid whose rays are sought one by one
_BETWEEN_PX = 1e-4  # how far off a ray may be that is interpolated


def intrinsic_names(lens: Lens) -> tuple[str, ...]:
    """Names of the numbers that a lens is made of, in the order of every vector and covariance."""
    return ("fx", "fy", "cx", "cy", *DISTORTION_NAMES[lens])


def projected(points: Matrix, matrix: Matrix, distortion: Vector, lens: Lens) -> tuple[Matrix, Array3, Array3]:
    """Pixels of points, and their derivatives by the points and by the lens.

    Args:
        points: (n, 3) in camera axes, [m].
        matrix: (3, 3), [px].
        distortion: In the order of `DISTORTION_NAMES`.
        lens: Which of the models.

    Returns:
        (n, 2) [px], (n, 2, 3) [px/m] and (n, 2, 4 + k) in the order of `intrinsic_names`; nan behind the camera and where the
        lens model has turned back.
    """
    points = np.asarray(points, dtype=float).reshape(-1, 3)
    seen = in_view(points, distortion, lens)
    pixels, by_point = np.full((len(points), 2), np.nan), np.full((len(points), 2, 3), np.nan)
    by_lens = np.full((len(points), 2, 4 + len(distortion)), np.nan)
    if seen.any():
        still, shown = np.zeros(3), points[seen, None]
        if lens == "fisheye":
            found, jacobian = cv2.fisheye.projectPoints(shown, still, still, matrix, distortion)
            point_columns, lens_columns = slice(11, 14), slice(0, 8)
        else:
            found, jacobian = cv2.projectPoints(shown, still, still, matrix, distortion)
            point_columns, lens_columns = slice(3, 6), slice(6, 10 + len(distortion))
        jacobian = jacobian.reshape(len(shown), 2, -1)
        pixels[seen] = found[:, 0]
        by_point[seen], by_lens[seen] = jacobian[:, :, point_columns], jacobian[:, :, lens_columns]
    return pixels, by_point, by_lens


def in_view(points: Matrix, distortion: Vector, lens: Lens) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Mask (n,) of the points ahead of the camera and inside the range in which the lens model holds."""
    ahead = points[:, 2] > 0
    tangent = np.hypot(points[:, 0], points[:, 1]) / np.where(ahead, points[:, 2], 1.0)
    seen: np.ndarray[tuple[int], np.dtype[np.bool_]] = ahead & (tangent < widest_tangent(tuple(distortion), lens))
    return seen


@lru_cache(maxsize=64)
def widest_tangent(distortion: tuple[float, ...], lens: Lens) -> float:
    """Tangent of the angle off the axis up to which the distorted radius grows."""
    top, bottom, angular = _radial(distortion, lens)
    squared = Polynomial([0.0, 1.0])
    turning = (top + 2 * squared * top.deriv()) * bottom - 2 * squared * top * bottom.deriv()
    roots = np.concatenate([turning.roots(), bottom.roots()])
    positive = [root.real for root in roots if root.real > 0 and abs(root.imag) < 1e-9 * abs(root.real)]
    reach = np.sqrt(min(positive, default=np.inf))
    return float(np.tan(min(reach, _WIDEST)) if angular else min(reach, np.tan(_WIDEST)))


def unprojected(pixels: Matrix, matrix: Matrix, distortion: Vector, lens: Lens) -> Matrix:
    """Rays of pixels, (n, 3) with z = 1; nan where no ray within the model's range meets the pixel.

    The radial part is turned around by a table, the rest by Newton's method: OpenCV's own fixed-point iteration leaves 0.1 px
    and more near the corners of a wide lens.
    """
    pixels = np.asarray(pixels, dtype=float).reshape(-1, 2)
    distorted = (pixels - matrix[:2, 2]) / [matrix[0, 0], matrix[1, 1]]
    radius = np.linalg.norm(distorted, axis=1)
    tangents, radii = _radial_table(tuple(distortion), lens)
    start = distorted * (np.interp(radius, radii, tangents) / np.where(radius > 0, radius, 1.0))[:, None]
    rays = np.column_stack([start, np.ones(len(start))])
    limit = 0.999999 * widest_tangent(tuple(distortion), lens)
    for _ in range(_NEWTON_STEPS):
        off, by_point, _ = projected(rays, matrix, distortion, lens)
        off -= pixels
        if not (np.nan_to_num(np.abs(off)) > _CLOSE_PX).any():
            break
        usable = np.flatnonzero(np.isfinite(off).all(axis=1))
        usable = usable[np.abs(np.linalg.det(by_point[usable, :, :2])) > 0]
        rays[usable, :2] -= np.linalg.solve(by_point[usable, :, :2], off[usable, :, None])[:, :, 0]
        length = np.linalg.norm(rays[:, :2], axis=1)
        rays[:, :2] *= np.minimum(1.0, limit / np.where(length > 0, length, 1.0))[:, None]
    off = projected(rays, matrix, distortion, lens)[0] - pixels
    rays[~(np.abs(off).max(axis=1, initial=0) < 1e-3)] = np.nan
    return rays


def unprojected_grid(u: Vector, v: Vector, matrix: Matrix, distortion: Vector, lens: Lens) -> Array3:
    """Rays of all pixels of a grid, as `unprojected`, to 1e-4 px: cubics through the rays of every 16th pixel.

    In the middle between those, where a cubic is farthest off, it is held against the lens; where that is not close, as at the rim
    of what the lens model can see, every pixel's ray is sought.

    Args:
        u: Columns of the pixels, (w,), growing, [px].
        v: Their rows, (h,), growing, [px].
        matrix: (3, 3), [px].
        distortion: In the order of `DISTORTION_NAMES`.
        lens: Which of the models.

    Returns:
        (h, w, 3) with z = 1; nan where no ray within the model's range meets the pixel.
    """
    across, down = _nodes(u), _nodes(v)
    rays = np.ones((len(v), len(u), 3))
    sought: Mask = np.ones(rays.shape[:2], dtype=bool)
    if 4 * len(across) * len(down) < sought.size:
        nodes = unprojected(_grid(across, down), matrix, distortion, lens).reshape(len(down), len(across), 3)[..., :2]
        in_u, in_v = (u - across[0]) / _STEP_PX, (v - down[0]) / _STEP_PX
        rays[..., :2] = _cubic(nodes, in_u, in_v)
        sought = _far_off(nodes, across, down, matrix, distortion, lens)[np.ix_(in_v.astype(int) - 1, in_u.astype(int) - 1)]
    rays[sought] = unprojected(_grid(u, v).reshape(len(v), len(u), 2)[sought], matrix, distortion, lens)
    return rays


def _nodes(along: Vector) -> Vector:
    """Every 16th pixel from the first to the last, and two more to either side."""
    count = int((along[-1] - along[0]) // _STEP_PX) + 2
    return np.asarray(along[0] + _STEP_PX * np.arange(-1, count + 1))


def _grid(u: Vector, v: Vector) -> Matrix:
    """Pixels (h w, 2), row by row."""
    return np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)


def _far_off(nodes: Array3, across: Vector, down: Vector, matrix: Matrix, distortion: Vector, lens: Lens) -> Mask:
    """Between which nodes the cubics are not close to the lens, or there is no ray; (rows - 3, columns - 3)."""
    shape = (len(down) - 3, len(across) - 3)
    middle = np.ones((*shape, 3))
    middle[..., :2] = _cubic(nodes, 1.5 + np.arange(shape[1], dtype=float), 1.5 + np.arange(shape[0], dtype=float))
    pixels = _grid(across[1:-2] + _STEP_PX / 2, down[1:-2] + _STEP_PX / 2)
    off = projected(np.nan_to_num(middle.reshape(-1, 3), nan=-1.0), matrix, distortion, lens)[0] - pixels
    return np.asarray(~(np.abs(off).max(axis=1) < _BETWEEN_PX)).reshape(shape)


def _cubic(nodes: Array3, u: Vector, v: Vector) -> Array3:
    """Lagrange's cubic through the four nearest nodes, along rows and then along columns; u and v count nodes, (h, w, 2)."""
    return _along(np.swapaxes(_along(np.swapaxes(nodes, 0, 1), u), 0, 1), v)


def _along(nodes: Array3, place: Vector) -> Array3:
    """The same along the first axis."""
    first = place.astype(int) - 1
    t = (place - first - 1)[:, None, None]
    weights = (-t * (t - 1) * (t - 2) / 6, (t + 1) * (t - 1) * (t - 2) / 2, -(t + 1) * t * (t - 2) / 2, (t + 1) * t * (t - 1) / 6)
    return np.asarray(sum(weight * nodes[first + step] for step, weight in enumerate(weights)))


@lru_cache(maxsize=64)
def _radial_table(distortion: tuple[float, ...], lens: Lens) -> tuple[Vector, Vector]:
    """Tangents off the axis and their distorted radii, without the tangential terms."""
    top, bottom, angular = _radial(distortion, lens)
    angles = np.linspace(0.0, np.arctan(widest_tangent(distortion, lens)), 2000)
    radii = angles if angular else np.tan(angles)
    return np.tan(angles), radii * top(radii**2) / bottom(radii**2)


def _radial(distortion: tuple[float, ...], lens: Lens) -> tuple[Polynomial, Polynomial, bool]:
    """Numerator and denominator of the radial factor in the squared radius; and whether that radius is an angle."""
    k = dict(zip(DISTORTION_NAMES[lens], distortion, strict=True))
    if lens == "fisheye":
        return Polynomial([1.0, *distortion]), Polynomial([1.0]), True
    top = Polynomial([1.0, k["k1"], k["k2"], k["k3"]])
    return top, Polynomial([1.0, *(k[name] for name in ("k4", "k5", "k6") if name in k)]), False
