"""The ways in which MJCF writes an orientation: quat, euler, axisangle, xyaxes, zaxis; read, and written the same way again."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from urdfcal.base.geometry import DEG, Matrix, Vector, X, Y, Z
from urdfcal.deploy.onto.text import Element

WAYS = {"quat": 4, "euler": 3, "axisangle": 4, "xyaxes": 6, "zaxis": 3}
_SAME = 1e-12


@dataclass(frozen=True)
class Angles:
    """What the compiler says of angles.

    Attributes:
        unit: One of its units, [rad].
        eulerseq: Three of xyz, turning with the frame, or XYZ, about the axes before.
    """

    unit: float = DEG
    eulerseq: str = "xyz"

    def euler(self, angles: Vector) -> Matrix:
        """Three angles, [rad], as a rotation."""
        rotation = np.eye(3)
        for letter, angle in zip(self.eulerseq, angles, strict=True):
            own = pin.exp3(dict(x=X, y=Y, z=Z)[letter.lower()] * angle)
            rotation = rotation @ own if letter.islower() else own @ rotation
        return rotation

    def to_euler(self, rotation: Matrix) -> Vector:
        """Angles of a rotation, [rad]; of a sequence without case mixed."""
        from scipy.spatial.transform import Rotation

        sequence = self.eulerseq.upper() if self.eulerseq.islower() else self.eulerseq.lower()
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", "Gimbal lock", UserWarning)  # any of the angles that say it will do
            return np.asarray(Rotation.from_matrix(rotation).as_euler(sequence))


def read_rotation(element: Element, attributes: Mapping[str, str], angles: Angles) -> Matrix:
    """The orientation that attributes state; none is none.

    Raises:
        RobotError: it is stated twice, or is no orientation.
    """
    stated = [way for way in WAYS if way in attributes]
    if not stated:
        return np.eye(3)
    if len(stated) > 1:
        raise element.fail(f"<{element.tag} {element.name}>: has both {' and '.join(stated)}, expected one of them")
    way = stated[0]
    values = element.numbers(attributes[way], (WAYS[way],), way)
    axis = values[:3] if way != "quat" else values
    if way != "euler" and np.linalg.norm(axis) < 1e-10:
        raise element.fail(f"<{element.tag} {element.name}>: {way}: has no length")
    return _rotation(way, values, angles)


def _rotation(way: str, values: Vector, angles: Angles) -> Matrix:
    if way == "quat":
        return np.asarray(pin.Quaternion(*(values / np.linalg.norm(values)).tolist()).matrix())
    if way == "euler":
        return angles.euler(values * angles.unit)
    if way == "axisangle":
        return np.asarray(pin.exp3(values[:3] / np.linalg.norm(values[:3]) * values[3] * angles.unit))
    if way == "xyaxes":
        x = values[:3] / np.linalg.norm(values[:3])
        y = values[3:] - x * (x @ values[3:])
        y = y / max(float(np.linalg.norm(y)), 1e-300)
        return np.column_stack([x, y, np.cross(x, y)])
    return np.asarray(pin.Quaternion.FromTwoVectors(Z, values / np.linalg.norm(values)).matrix())


def written(way: str, rotation: Matrix, angles: Angles) -> tuple[str, Vector]:
    """A rotation in the same way, or as a quaternion where that way cannot say it to the last digits."""
    values = _values(way, rotation, angles)
    if values is not None and np.abs(_rotation(way, values, angles) - rotation).max() < _SAME:
        return way, values
    x, y, z, w = pin.Quaternion(rotation).normalized().coeffs()
    return "quat", np.array([w, x, y, z]) * (1.0 if w >= 0 else -1.0)


def _values(way: str, rotation: Matrix, angles: Angles) -> Vector | None:
    if way == "euler":
        return angles.to_euler(rotation) / angles.unit
    if way == "axisangle":
        turn = pin.log3(rotation)
        angle = float(np.linalg.norm(turn))
        return np.array([*(turn / angle if angle else Z), angle / angles.unit])
    if way == "xyaxes":
        return np.concatenate([rotation[:, 0], rotation[:, 1]])
    return np.array(rotation[:, 2]) if way == "zaxis" else None
