"""Many rotations at once: matrices, quaternions, logarithms, and the inverse right Jacobian of SO(3)."""

from __future__ import annotations

import numpy as np

from urdfcal.base.geometry import Array3, Mask, Matrix, Vector

NOT_RIGID = "is no placement; expected a rotation matrix in the upper left, the translation beside it, and the last row 0, 0, 0, 1"
_RIGID = 0.01  # of R'R from the identity: three digits are enough, another matrix is not


def rigid(T: Array3) -> Mask:
    """Which matrices are placements, (n, 4, 4) -> (n,): a rotation, a translation, and the row 0, 0, 0, 1; nan is none."""
    R = T[:, :3, :3]
    apart = np.abs(np.swapaxes(R, 1, 2) @ R - np.eye(3)).max(axis=(1, 2), initial=0.0)
    below = np.abs(T[:, 3] - [0.0, 0.0, 0.0, 1.0]).max(axis=1, initial=0.0)
    with np.errstate(invalid="ignore"):
        found: Mask = (apart < _RIGID) & (below < _RIGID) & (np.linalg.det(R) > 0) & np.isfinite(T).all(axis=(1, 2))
    return found


def quaternions_of(angles: Matrix) -> Matrix:
    """Unit quaternions x, y, z, w of roll, pitch and yaw about fixed axes, (n, 4); nan where there are none."""
    (sr, sp, sy), (cr, cp, cy) = np.sin(angles.T / 2), np.cos(angles.T / 2)
    return np.column_stack(
        [sr * cp * cy - cr * sp * sy, cr * sp * cy + sr * cp * sy, cr * cp * sy - sr * sp * cy, cr * cp * cy + sr * sp * sy]
    )


def quaternions_of_vectors(vectors: Matrix) -> Matrix:
    """Unit quaternions x, y, z, w of rotation vectors, (n, 3) -> (n, 4)."""
    half = np.linalg.norm(vectors, axis=1, keepdims=True) / 2
    return np.hstack([vectors / 2 * np.sinc(half / np.pi), np.cos(half)])


def product_of_quaternions(one: Matrix, other: Matrix) -> Matrix:
    """Quaternions x, y, z, w of the rotations R_one R_other, (n, 4)."""
    u, v, a, b = one[:, :3], other[:, :3], one[:, 3:], other[:, 3:]
    return np.hstack([a * v + b * u + np.cross(u, v), a * b - np.sum(u * v, axis=1, keepdims=True)])


def skew(vectors: Matrix) -> Array3:
    """The matrices of v x ., (n, 3, 3)."""
    K = np.zeros((len(vectors), 3, 3))
    for axis, (row, column) in enumerate(((1, 2), (2, 0), (0, 1))):
        K[:, row, column], K[:, column, row] = -vectors[:, axis], vectors[:, axis]
    return K


def matrices(quaternions: Matrix) -> Array3:
    """Rotation matrices of unit quaternions x, y, z, w, (n, 3, 3)."""
    u, w = quaternions[:, :3], quaternions[:, 3, None, None]
    K = skew(u)
    return np.eye(3) + 2 * w * K + 2 * K @ K


def rotation_vectors(R: Array3) -> Matrix:
    """Logarithms of rotation matrices, (n, 3), [rad]; exact near zero, and within rounding of half a turn."""
    axis = np.stack([R[:, 2, 1] - R[:, 1, 2], R[:, 0, 2] - R[:, 2, 0], R[:, 1, 0] - R[:, 0, 1]], axis=1) / 2
    sine, cosine = np.linalg.norm(axis, axis=1), (np.trace(R, axis1=1, axis2=2) - 1) / 2
    angle = np.arctan2(sine, cosine)
    with np.errstate(invalid="ignore", divide="ignore"):
        vectors = axis * np.where(sine > 1e-8, angle / sine, 1.0)[:, None]
    half = cosine < -1 + 1e-6
    for pose in np.flatnonzero(half):
        vectors[pose] = _near_half_turn(R[pose])
    return np.asarray(vectors)


def _near_half_turn(R: Matrix) -> Vector:
    import pinocchio as pin

    return np.asarray(pin.log3(R))


def inverse_right_jacobian(e: Matrix) -> Array3:
    """Of SO(3) at rotation vectors e, (n, 3, 3)."""
    t = np.linalg.norm(e, axis=1)
    small = t < 1e-4
    safe = np.where(small, 1.0, t)
    factor = np.where(small, 1 / 12 + t**2 / 720, 1 / safe**2 - (1 + np.cos(safe)) / (2 * safe * np.sin(safe)))
    K = skew(e)
    return np.asarray(np.eye(3) + K / 2 + factor[:, None, None] * (K @ K))
