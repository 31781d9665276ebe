"""Three numbers that were taken for roll, pitch and yaw, and are another convention's: makers of robots write orientations in many ways.

An orientation is kept as a unit quaternion, so the three numbers a, b, c that stood in the file are read back from it, b within a right
angle of zero or, where a convention's own numbers are elsewhere, as (a + 180, 180 - b, c + 180), which is the same rotation about fixed
axes. Written as products of turns, the rotation that was meant is

    fixed axes       Rz(c) Ry(b) Rx(a)    roll, pitch, yaw; W P R
    turning axes     Rx(a) Ry(b) Rz(c)
    rotation vector  exp([a b c]x)
    A, B, C          Rz(a) Ry(b) Rx(c)
    O, A, T          Rz(a) Ry(b) Rz(c)
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from urdfcal.base.geometry import DEG, Matrix
from urdfcal.base.rotations import matrices, product_of_quaternions, quaternions_of, quaternions_of_vectors
from urdfcal.sensors.sensor import Change

CONJUGATE = np.array([-1.0, -1.0, -1.0, 1.0])  # of a quaternion x, y, z, w
_READ = "roll, pitch and yaw read as"


def orientation_mistakes() -> Mapping[str, Change]:
    """What orientations may have been taken for, each as what undoes it: a change of quaternions, (n, 4)."""
    return {
        "the quaternions read as w, x, y, z": lambda values: values[:, [1, 2, 3, 0]],
        "the orientations inverted": lambda values: values * CONJUGATE,
        "roll, pitch and yaw taken about axes that turn along": lambda values: quaternions_of(-angles_of(values)) * CONJUGATE,
        f"{_READ} radians in place of degrees": lambda values: quaternions_of(angles_of(values) / DEG),
        f"{_READ} degrees": lambda values: quaternions_of(angles_of(values) * DEG),
        f"{_READ} a rotation vector (Rx, Ry, Rz, as Universal Robots has it)": lambda values: quaternions_of_vectors(_shorter(values)),
        f"{_READ} A, B, C about z, y', x'' (as KUKA has them)": lambda values: quaternions_of(angles_of(values)[:, ::-1]),
        f"{_READ} O, A, T about z, y', z'' (as Kawasaki has them)": lambda values: _about_z_y_z(angles_of(values)),
        f"{_READ} O, A, T about z, y', z'' (as Kawasaki has them), A beyond 90 deg": lambda values: _about_z_y_z(_beyond(values)),
    }


def angles_of(quaternions: Matrix) -> Matrix:
    """Roll, pitch and yaw about fixed axes, (n, 3), [rad], the pitch within a right angle of zero; nan where there are none."""
    R = matrices(quaternions)
    roll, yaw = np.arctan2(R[:, 2, 1], R[:, 2, 2]), np.arctan2(R[:, 1, 0], R[:, 0, 0])
    return np.column_stack([roll, np.arctan2(-R[:, 2, 0], np.hypot(R[:, 0, 0], R[:, 1, 0])), yaw])


def _beyond(quaternions: Matrix) -> Matrix:
    """The same with the pitch beyond a right angle, all within half a turn."""
    angles = angles_of(quaternions) * [1, -1, 1]
    return np.asarray(angles - np.pi * np.where(angles > 0, 1, -1))


def _shorter(quaternions: Matrix) -> Matrix:
    """Of the two triples of angles the shorter one, (n, 3): a rotation vector is no longer than half a turn."""
    near, far = angles_of(quaternions), _beyond(quaternions)
    return np.where(np.linalg.norm(near, axis=1, keepdims=True) <= np.linalg.norm(far, axis=1, keepdims=True), near, far)


def _about_z_y_z(angles: Matrix) -> Matrix:
    """Quaternions of turns about z, the y axis that turned along, and the z axis that turned along again."""
    last = np.zeros_like(angles)
    last[:, 2] = angles[:, 2]
    first = angles * [0, 1, 0]
    first[:, 2] = angles[:, 0]
    return product_of_quaternions(quaternions_of(first), quaternions_of(last))
