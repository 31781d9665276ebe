"""Orientations as controllers write them: numbers to rotations and back, near to the numbers that stood there.

The same rotation has several triples of angles, two rotation vectors and two quaternions. What is written back is, of all of them, the
one nearest to what was read, so that a program goes on reading as it did.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from urdfcal.base.geometry import Array3, Matrix, Vector
from urdfcal.base.rotations import matrices, quaternions_of, quaternions_of_vectors, rotation_vectors
from urdfcal.sensors.conventions import angles_of

_TURN = 2 * np.pi
_LENGTH = 1e-3  # by which a quaternion's length may be off one for having been written in few digits


@dataclass(frozen=True)
class Orientation:
    """A way to write orientations.

    Attributes:
        name: For people.
        count: How many numbers.
        quaternions: Unit quaternions x, y, z, w of numbers, (n, count) -> (n, 4); nan where they are no orientation. Angles in [rad].
        candidates: All numbers that mean a rotation, of its quaternion (4,): (m, count).
        turns: Whether each number is an angle by itself, to which whole turns may be added.
    """

    name: str
    count: int
    quaternions: Callable[[Matrix], Matrix]
    candidates: Callable[[Vector], Matrix]
    turns: bool = True

    def rotations(self, numbers: Matrix) -> Array3:
        """Rotation matrices of numbers, (n, count) -> (n, 3, 3)."""
        return matrices(self.quaternions(numbers))

    def frame(self, values: Sequence[float] | Vector) -> Matrix:
        """The frame (4, 4) of x, y, z and an orientation, (3 + count,), [m]."""
        T = np.eye(4)
        T[:3, 3], T[:3, :3] = values[:3], self.rotations(np.array(values[3:])[None])[0]
        return T

    def numbers(self, R: Matrix, near: Vector) -> Vector:
        """The numbers that mean a rotation (3, 3), nearest to those that stood there, (count,)."""
        found = self.candidates(np.asarray(pin.Quaternion(R).coeffs()))
        if self.turns:
            found = found + _TURN * np.round((near - found) / _TURN)
        return np.asarray(found[int(np.argmin(np.linalg.norm(found - near, axis=1)))])


def _unit(quaternions: Matrix) -> Matrix:
    length = np.linalg.norm(quaternions, axis=1, keepdims=True)
    return np.asarray(np.where(np.abs(length - 1) < _LENGTH, quaternions / np.where(length > 0, length, 1.0), np.nan))


def _angles(quaternion: Vector) -> Matrix:
    """Both triples about fixed axes, roll, pitch, yaw."""
    near = angles_of(quaternion[None])[0]
    return np.array([near, [near[0] + np.pi, np.pi - near[1], near[2] + np.pi]])


def _vectors(quaternion: Vector) -> Matrix:
    """The rotation vectors within one and a half turns."""
    vector = rotation_vectors(matrices(quaternion[None]))[0]
    angle = float(np.linalg.norm(vector))
    if angle < 1e-12:
        return np.array([vector])
    return np.array([vector * (angle + turns * _TURN) / angle for turns in (-1, 0, 1)])


QUATERNION = Orientation("quaternion x, y, z, w", 4, _unit, lambda q: np.array([q, -q]), turns=False)
QUATERNION_W_FIRST = Orientation(
    "quaternion w, x, y, z", 4, lambda n: _unit(n[:, [1, 2, 3, 0]]), lambda q: np.array([q[[3, 0, 1, 2]], -q[[3, 0, 1, 2]]]), turns=False
)
FIXED_ANGLES = Orientation("roll, pitch, yaw about fixed axes", 3, quaternions_of, _angles)
KUKA_ANGLES = Orientation("A, B, C about z, y', x''", 3, lambda n: quaternions_of(n[:, ::-1]), lambda q: _angles(q)[:, ::-1])
ROTATION_VECTOR = Orientation("rotation vector", 3, quaternions_of_vectors, _vectors, turns=False)
