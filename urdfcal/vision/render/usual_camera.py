"""A camera to try things with where there is none: it looks at the screen from one side, and sees the spots and the markers."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from urdfcal.base.errors import UsageError
from urdfcal.base.geometry import DEG, SE3, Matrix
from urdfcal.sensors.camera import Camera

_SIZE = (1600, 1200)  # [px]
_FOCAL = 1500.0  # [px]
_BARREL = np.array([-0.12, 0.02, 0.0, 0.0, 0.0])  # k1 k2 p1 p2 k3
_OBLIQUE = 25 * DEG  # beside the beams' way
_ROUND = 1.15  # times as far away as would just do
_NEAREST = 0.5  # [m]
_FAR_OFF = 5.0  # times farther from the middle than half of the spots are: too far for a camera that is to see the rest well
_TOWARDS = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])  # screen axes in a camera that looks along the screen's +x


def usual_lens() -> Camera:
    """The same camera, wherever it stands."""
    return Camera(_SIZE, _matrix(), _BARREL, "plain")


def usual_camera(spots: Matrix, marks: Matrix | None = None) -> Camera:
    """A plain camera in front of the screen that sees some spots, but for single ones far off.

    Args:
        spots: (n, 2) = (y, z) on the screen, [m]; nan where there is none.
        marks: What it must see beside them, (k, 2).

    Raises:
        UsageError: there is no spot to look at.
    """
    seen = spots[np.isfinite(spots).all(axis=1)]
    if not len(seen):
        raise UsageError("no beam meets the screen in these poses, so there is nothing that a camera could look at")
    seen = np.vstack([_without_far_off(seen), np.empty((0, 2)) if marks is None else marks])
    middle = np.append(0.0, (seen.min(axis=0) + seen.max(axis=0)) / 2)
    distance = _NEAREST
    while not _sees(_camera(middle, distance), seen):
        distance *= 1.1
    return _camera(middle, _ROUND * distance)


def _without_far_off(spots: Matrix) -> Matrix:
    away = np.linalg.norm(spots - np.median(spots, axis=0), axis=1)
    return np.asarray(spots[away <= max(_FAR_OFF * float(np.median(away)), _NEAREST)])


def _camera(middle: Matrix, distance: float) -> Camera:
    R = _TOWARDS @ pin.exp3(np.array([0.0, 0.0, _OBLIQUE]))
    T_camera_screen: SE3 = pin.SE3(R, np.array([0.0, 0.0, distance]) - R @ middle)
    return Camera(_SIZE, _matrix(), _BARREL, "plain", T_camera_screen, "front")


def _matrix() -> Matrix:
    width, height = _SIZE
    return np.array([[_FOCAL, 0.0, (width - 1) / 2], [0.0, _FOCAL, (height - 1) / 2], [0.0, 0.0, 1.0]])


def _sees(camera: Camera, spots: Matrix) -> bool:
    pixels = camera.pixels_of_spots(spots)
    return bool((np.isfinite(pixels) & (pixels > 0) & (pixels < np.array(_SIZE) - 1)).all())
