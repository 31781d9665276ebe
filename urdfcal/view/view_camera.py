"""From where to look, so that robot, beams and screen are seen at first sight and the robot hides few of the spots."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from urdfcal.geometry import DEG, Matrix, Vector
from urdfcal.measurements import Mask

_AZIMUTHS = tuple(angle * DEG for angle in (-60, -50, -40, -30, 30, 40, 50, 60))  # from the screen's normal
_ELEVATIONS = tuple(angle * DEG for angle in (14, 22, 32))
_THICK = 0.09  # [m] from the robot's middle within which it hides what is behind
_DISTANCE = 3.0  # times the size of the scene: the camera's distance while we choose
_PREFERRED = 42 * DEG  # neither along the screen, where spots are slim, nor along the beams, which are not seen then


def choose_direction(normal: Vector, spots: Matrix, skeleton: Matrix, points: Matrix) -> Vector:
    """Look from the lasers' side of the screen and a little from above.

    Args:
        normal: Of the screen, towards the lasers, in the root's axes.
        spots: (s, 3), [m]: what should not be hidden.
        skeleton: Line through the robot, (k, 3), [m].
        points: What is to be in the picture, (n, 3), [m].

    Returns:
        Unit vector from the scene to the camera.
    """
    up = np.array([0.0, 0.0, 1.0])
    front = normal - up * (normal @ up)
    front = front / np.linalg.norm(front) if np.linalg.norm(front) > 0.1 else np.array([1.0, 0.0, 0.0])
    across = np.cross(up, front)
    size = float(np.ptp(points, axis=0).max())
    best, found = -np.inf, front
    for azimuth in _AZIMUTHS:
        for elevation in _ELEVATIONS:
            flat = np.cos(azimuth) * front + np.sin(azimuth) * across
            direction = np.cos(elevation) * flat + np.sin(elevation) * up
            eye = points.mean(axis=0) + _DISTANCE * size * direction
            open_share = 1.0 - float(np.mean(_hidden(eye, spots, skeleton))) if len(spots) else 1.0
            score = open_share - 1.0 * (abs(azimuth) - _PREFERRED) ** 2 - 0.2 * (elevation - _ELEVATIONS[1]) ** 2
            if score > best + 1e-9:
                best, found = score, direction
    return found


def _hidden(eye: Vector, spots: Matrix, skeleton: Matrix) -> Mask:
    """Which spots lie behind the robot, (s,)."""
    line = np.concatenate([np.linspace(a, b, 12) for a, b in pairwise(skeleton)] or [skeleton])
    rays = spots - eye
    along = np.einsum("sj,kj->sk", rays, line - eye) / np.sum(rays**2, axis=1)[:, None]
    off = np.linalg.norm((line - eye)[None] - along[..., None] * rays[:, None], axis=-1)
    return np.asarray(((off < _THICK) & (along < 1)).any(axis=1))
