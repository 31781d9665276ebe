"""Array aliases, poses and twists.

`T_a_b` takes coordinates in b to coordinates in a. A twist is `[v, w]`, linear part first, as in Pinocchio. A *screw* is a
constant twist along which one error parameter moves a placement; a parameterised perturbation is the product of
exponentials exp(screw_1 x_1) ... exp(screw_k x_k).
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
import pinocchio as pin

Vector = npt.NDArray[np.float64]
Matrix = npt.NDArray[np.float64]
Array3 = npt.NDArray[np.float64]
Array4 = npt.NDArray[np.float64]
SE3 = Any  # pinocchio ships no type hints

X, Y, Z = np.eye(3)
MM = 1e-3
DEG = np.pi / 180

Labels = npt.NDArray[np.str_]
Mask = npt.NDArray[np.bool_]


def cross(a: Vector, b: Vector) -> Vector:
    """A x b of two 3-vectors; NumPy's own takes twenty times as long for so little."""
    return np.asarray(pin.skew(a) @ b)


def translation_screw(direction: Vector) -> Vector:
    """Screw of a translation along a unit direction, (6,)."""
    return np.concatenate([direction, np.zeros(3)])


def rotation_screw(direction: Vector, point: Vector) -> Vector:
    """Screw of a rotation about the line through `point` along a unit direction, (6,): equation (5)."""
    return np.concatenate([cross(point, direction), direction])


def six_screws() -> Matrix:
    """The six screws of a frame's own axes as columns: trans_x, trans_y, trans_z, rot_x, rot_y, rot_z."""
    return np.eye(6)


def exponentials(screws: Matrix, x: Vector) -> list[SE3]:
    """exp(screw_k x_k) for every column of `screws` (6, k)."""
    return [pin.exp6(screw * step) for screw, step in zip(screws.T, x, strict=True)]


def product(transforms: list[SE3]) -> SE3:
    """The product of placements, left to right."""
    result = pin.SE3.Identity()
    for transform in transforms:
        result = result * transform
    return result


def pose(xyz: Vector, rpy: Vector) -> SE3:
    """A URDF origin as a placement: xyz in metres, roll-pitch-yaw in radians."""
    return pin.SE3(pin.rpy.rpyToMatrix(*(float(angle) for angle in rpy)), np.asarray(xyz, dtype=float))


def xyz_rpy(transform: SE3) -> tuple[Vector, Vector]:
    """A placement as the numbers of a URDF origin, exact to rounding also at pitch 90 deg."""
    return np.array(transform.translation), np.asarray(pin.rpy.matrixToRpy(transform.rotation), dtype=float)


def distance_mm_mrad(a: SE3, b: SE3) -> tuple[float, float]:
    """How far two placements are apart, in millimetres and milliradians."""
    difference = a.actInv(b)
    angle = np.linalg.norm(pin.log3(difference.rotation))
    return float(np.linalg.norm(difference.translation) / MM), float(angle * 1e3)
