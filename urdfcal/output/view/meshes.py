"""Meshes that marks are made of: discs and rings on the screen, balls and crosses in space, arrows, tubes and thin lines.

The same shape at many places is one mesh. Shapes of unit size are scaled, turned and moved by the animation.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from urdfcal.base.geometry import Array3, Matrix, Vector
from urdfcal.output.view.recorder import mg

Faces = npt.NDArray[np.intp]

RING = (1.45, 1.95)  # inner and outer radius of a ring over a disc's
ARM, THICK = 2.4, 0.42  # half length of a cross's arms and their thickness, over the radius of a ball
_DASHES = 9
_SEGMENTS, _COARSE, _MANY = 28, 12, 600  # of discs and rings, of many the coarse ones
_MANY_BALLS, _VERY_MANY_BALLS = 150, 2000  # of more they are coarser
_TILT = np.array([[1, -1, 0], [1, 1, -2], [1, 1, 1]]) / np.sqrt([[2], [6], [3]])  # turns one cross against the other
_OCTAHEDRON = np.concatenate([np.eye(3), -np.eye(3)])
_OCTANTS = np.array([[0, 1, 2], [1, 3, 2], [3, 4, 2], [4, 0, 2], [1, 0, 5], [3, 1, 5], [4, 3, 5], [0, 4, 5]])
_BOX = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
_SIDES = np.array(
    [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]]
)


def flat(colour: int, opacity: float = 1.0) -> Any:
    """A material that has this colour whatever the light."""
    return mg.MeshBasicMaterial(color=colour, opacity=opacity, transparent=opacity < 1)


def seen_through(colour: int) -> Any:
    """The same, drawn over whatever stands before it."""
    return mg.MeshBasicMaterial(color=colour, transparent=True, depthTest=False, depthWrite=False)


def on_screen(spots: Matrix, lift: float = 0.0) -> Matrix:
    """Points (n, 3) of the screen's axes over spots (n, 2)."""
    return np.column_stack([np.full(len(spots), lift), spots])


def disc(radius: float, centres: Matrix) -> Any:
    """Discs across the screen's x, about (n, 3) centres, [m]."""
    outline = radius * np.concatenate([np.zeros((1, 3)), on_screen(_rim(_segments(len(centres))))])
    k = np.arange(len(outline) - 1)
    return _stamped(outline, np.stack([np.zeros_like(k), 1 + k, 1 + (k + 1) % len(k)], axis=-1), centres)


def ring(radius: float, centres: Matrix) -> Any:
    """Rings about discs of that radius."""
    rim = radius * on_screen(_rim(_segments(len(centres))))
    return _stamped(np.concatenate([RING[0] * rim, RING[1] * rim]), _wall(len(rim)), centres)


def balls(radius: float, centres: Matrix) -> Any:
    """Balls about (n, 3) centres, [m]; coarser where there are many."""
    points, faces = _OCTAHEDRON, _OCTANTS
    for _ in range(int(np.searchsorted((-_VERY_MANY_BALLS, -_MANY_BALLS), -len(centres), side="right"))):
        points, faces = _finer(points, faces)
    return _stamped(radius * points, faces, centres)


def crosses(radius: float, centres: Matrix, tilted: bool) -> Any:
    """Crosses of three arms that reach out of balls of that radius."""
    sizes = radius * (THICK / 2 + (ARM - THICK / 2) * np.eye(3))
    points, faces = np.concatenate([_BOX * size for size in sizes]), np.concatenate([_SIDES + 8 * arm for arm in range(3)])
    return _stamped(points @ _TILT if tilted else points, faces, centres)


@dataclass(frozen=True)
class ArrowShape:
    """What arrows are made of: the shaft's rim at the tail and at the neck, the head's rim, and the tip.

    Attributes:
        rim: Points of a rim of radius 1, (k, 2), across the arrow.
        faces: Of the arrow's 3 k + 1 points.
        barb: Radius of the head over the width of the shaft.
        least_barb: The same over the length, of short arrows.
        unit_barb: As `barb`, of an arrow that is to be scaled.
    """

    rim: Matrix
    faces: Faces
    barb: float
    least_barb: float
    unit_barb: float

    def points(self, length: float, neck: float, shaft: float, barb: float) -> Matrix:
        """Corners of an arrow along z, (3 k + 1, 3)."""
        rims = [
            np.column_stack([radius * self.rim, np.full(len(self.rim), z)]) for radius, z in ((shaft, 0.0), (shaft, neck), (barb, neck))
        ]
        return np.concatenate([*rims, [[0.0, 0.0, length]]])


def _rim(count: int) -> Matrix:
    """Points of a circle of radius 1, (count, 2)."""
    angles = np.linspace(0, 2 * np.pi, count, endpoint=False)
    return np.stack([np.cos(angles), np.sin(angles)], axis=-1)


def _wall(count: int) -> Faces:
    """Faces between a rim of so many points and the next one."""
    k, after = np.arange(count), (np.arange(count) + 1) % count
    return np.concatenate([np.stack([k, after, count + k], -1), np.stack([after, count + after, count + k], -1)])


def _round_arrow(count: int) -> ArrowShape:
    k = np.arange(count)
    head = np.stack([2 * count + k, 2 * count + (k + 1) % count, np.full(count, 3 * count)], -1)
    return ArrowShape(_rim(count)[:, ::-1], np.concatenate([_wall(count), count + _wall(count), head]), 1.4, 0.4, 1.4)


ROUND = _round_arrow(6)
FLAT = ArrowShape(np.array([[0.0, 1.0], [0.0, -1.0]]), np.array([[0, 1, 3], [0, 3, 2], [4, 5, 6]]), 1.89, 0.42, 1.6)


def arrows(shape: ArrowShape, tails: Matrix, tips: Matrix, width: float) -> Any:
    """Arrows from (n, 3) to (n, 3), [m], flat ones in planes across x; one shorter than its head is all head."""
    length = np.linalg.norm(tips - tails, axis=1)
    along = (tips - tails) / np.maximum(length, 1e-12)[:, None]
    across = np.cross(along, np.eye(3)[np.abs(along).argmin(axis=1)])  # of flat ones the x axis
    across /= np.maximum(np.linalg.norm(across, axis=1), 1e-12)[:, None]
    turns = np.stack([np.cross(across, along), across, along], axis=1)  # rows: the arrow's axes
    neck = length - np.minimum(4.5 * width, length)
    shaft, barb = np.minimum(width / 2, 0.2 * length), np.minimum(shape.barb * width, shape.least_barb * length)
    points = np.stack([shape.points(*sizes) for sizes in zip(length, neck, shaft, barb, strict=True)])
    placed = tails[:, None] + points @ turns
    return mg.TriangularMeshGeometry(placed.reshape(-1, 3), _repeated(shape.faces, points.shape[1], len(points)))


def unit_arrow(shape: ArrowShape, width: float, tail: Vector) -> Any:
    """An arrow of length 1 m along z, a flat one in y and z, to be scaled along its length; its head is a third of it."""
    return mg.TriangularMeshGeometry(tail + shape.points(1.0, 0.66, width / 2, shape.unit_barb * width), shape.faces)


def segments(starts: Matrix, ends: Matrix, colour: int, opacity: float = 1.0) -> Any:
    """Thin lines between (n, 3) and (n, 3), [m]."""
    points = np.stack([starts, ends], axis=1).reshape(-1, 3)
    material = mg.LineBasicMaterial(color=colour, opacity=opacity, transparent=opacity < 1)
    return mg.LineSegments(mg.PointsGeometry(points.T.astype(np.float32)), material)


def tube(radius: float, dashed: bool = False) -> Any:
    """A tube of length 1 m along z, to be scaled along its length."""
    parts, filled = (_DASHES, 0.55) if dashed else (1, 1.0)
    rim = radius * _rim(10)
    vertices = [np.column_stack([rim, np.full(10, (part + end) / parts)]) for part in range(parts) for end in (0.0, filled)]
    return mg.TriangularMeshGeometry(np.concatenate(vertices), _repeated(_wall(10), 20, parts))


def _segments(count: int) -> int:
    return _SEGMENTS if count < _MANY else _COARSE


def _finer(points: Matrix, faces: Faces) -> tuple[Matrix, Faces]:
    """Each triangle of a ball cut into four."""
    corners = points[faces]
    between = [corners[:, a] + corners[:, b] for a, b in ((0, 1), (1, 2), (2, 0))]
    every = np.concatenate([corners, np.stack(between, axis=1)], axis=1)
    every /= np.linalg.norm(every, axis=2, keepdims=True)
    cut = np.array([[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]])
    unique, index = np.unique(np.round(every.reshape(-1, 3), 9), axis=0, return_inverse=True)
    return unique, index.reshape(-1)[(cut + 6 * np.arange(len(faces))[:, None, None]).reshape(-1, 3)]


def _stamped(points: Matrix, faces: Faces, centres: Matrix) -> Any:
    """The same shape (k, 3) at every centre (n, 3), as one mesh."""
    placed: Array3 = centres[:, None, :] + points
    return mg.TriangularMeshGeometry(placed.reshape(-1, 3), _repeated(faces, len(points), len(centres)))


def _repeated(faces: Faces, points: int, count: int) -> Faces:
    return (faces + points * np.arange(count)[:, None, None]).reshape(-1, 3)
