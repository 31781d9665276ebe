"""Nodes of the scene that move: where each is at first, and its clip."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin

from urdfcal.geometry import SE3, Matrix, Vector
from urdfcal.view.key_frames import Clips

HIDDEN = 1e-6  # scale of what is not to be seen; zero would have no inverse


def place(viewer: Any, clips: Clips, path: str, times: Vector, placements: list[SE3], scale: Vector | None = None) -> None:
    """A node at its first placement, and its clip."""
    signs = mirror(scale) if scale is not None else np.ones(3)
    first = placements[0].homogeneous.copy()
    first[:3, :3] *= scale if scale is not None else 1.0
    viewer[path].set_transform(first)
    turned = [pin.Quaternion(placement.rotation * signs).coeffs() for placement in placements]
    clips.add(path, times, position=np.array([placement.translation for placement in placements]), quaternion=np.array(turned))


def put(viewer: Any, clips: Clips, path: str, times: Vector, position: Matrix, quaternion: Matrix, scale: Matrix) -> None:
    """A node of unit size that is moved, turned (x, y, z, w) and scaled, each (k, ...), and its clip."""
    first = np.eye(4)
    first[:3, :3] = pin.Quaternion(quaternion[0]).toRotationMatrix() * scale[0]
    first[:3, 3] = position[0]
    viewer[path].set_transform(first)
    clips.add(path, times, position=position, quaternion=quaternion, scale=scale)


def turns(axis: Vector, directions: Matrix) -> Matrix:
    """Quaternions (x, y, z, w) that turn an axis to directions (k, 3)."""
    return np.array([pin.Quaternion.FromTwoVectors(axis, direction).coeffs() for direction in directions])


def mirror(scale: Vector) -> Vector:
    """Signs that the viewer puts into the rotation when it takes a mirrored mesh's transform apart: it flips x alone."""
    signs = np.sign(scale)
    return signs * (-1, 1, 1) if np.prod(signs) < 0 else signs
