"""The marks of targets as meshcat objects: balls where they were read, crosses where robots have them, arrows, axes, planes.

They are drawn in the axes of the measuring frame. A kind's marks of all poses are one object; those of the pose shown are objects of
unit size that the animation moves.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from urdfcal.base.geometry import Array3, Matrix, Vector
from urdfcal.output.view.key_frames import Rows
from urdfcal.output.view.marks import CALIBRATED, ERROR, MEASURED, MISSING, NOMINAL, flat, seen_through, segments, unit_beam
from urdfcal.output.view.meshcat_parts import mg
from urdfcal.output.view.scene import Mark, Plane, Scene

AXES = (0xD0342C, 0x2E9E3F, 0x2F5FD0)  # x, y, z
PLANE = 0x8FB8DE
TRIAD = 4.0  # length of a measured pose's axes over the radius of a ball
ARM, THICK = 2.4, 0.42  # half length of a cross's arms and their thickness, over the radius of a ball
TARGET_POSE_SIZE = 2.3  # how much larger the marks of the pose shown are
_FRAME = 0.11  # length of the measuring frame's axes over the width of the marks
_LINE = 0.0011  # radius of a line of sight over that width
_RIM = 6
_MANY, _VERY_MANY = 150, 2000  # balls, of more they are coarser
_TILT = np.array([[1, -1, 0], [1, 1, -2], [1, 1, 1]]) / np.sqrt([[2], [6], [3]])  # turns one cross against the other
_OCTAHEDRON = np.concatenate([np.eye(3), -np.eye(3)])
_OCTANTS = np.array([[0, 1, 2], [1, 3, 2], [3, 4, 2], [4, 0, 2], [1, 0, 5], [3, 1, 5], [4, 3, 5], [0, 4, 5]])
_BOX = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
_SIDES = np.array(
    [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]]
)


def balls(radius: float, centres: Matrix) -> Any:
    """Balls about (n, 3) centres, [m]; coarser where there are many."""
    points, faces = _OCTAHEDRON, _OCTANTS
    for _ in range(int(np.searchsorted((-_VERY_MANY, -_MANY), -len(centres), side="right"))):
        points, faces = _finer(points, faces)
    return _stamped(radius * points, faces, centres)


def crosses(radius: float, centres: Matrix, tilted: bool) -> Any:
    """Crosses of three arms that reach out of balls of that radius."""
    sizes = radius * (THICK / 2 + (ARM - THICK / 2) * np.eye(3))
    points, faces = np.concatenate([_BOX * size for size in sizes]), np.concatenate([_SIDES + 8 * arm for arm in range(3)])
    return _stamped(points @ _TILT if tilted else points, faces, centres)


def arrows(tails: Matrix, tips: Matrix, width: float) -> Any:
    """Round arrows from (n, 3) to (n, 3), [m]; one shorter than its head is all head."""
    length = np.linalg.norm(tips - tails, axis=1)
    along = (tips - tails) / np.maximum(length, 1e-12)[:, None]
    across = np.cross(along, np.eye(3)[np.abs(along).argmin(axis=1)])
    across /= np.maximum(np.linalg.norm(across, axis=1), 1e-12)[:, None]
    turns = np.stack([across, np.cross(along, across), along], axis=1)  # rows: the arrow's axes
    neck = length - np.minimum(4.5 * width, length)
    shaft = np.minimum(width / 2, 0.2 * length)
    points = np.stack([_arrow(*sizes) for sizes in zip(length, neck, shaft, np.minimum(1.4 * width, 0.4 * length), strict=True)])
    placed = tails[:, None] + points @ turns
    return mg.TriangularMeshGeometry(placed.reshape(-1, 3), _repeated(_ARROW_FACES, points.shape[1], len(points)))


def unit_arrow(width: float) -> Any:
    """An arrow of length 1 m along z, to be scaled along its length; its head is a third of it."""
    return mg.TriangularMeshGeometry(_arrow(1.0, 0.66, width / 2, 1.4 * width), _ARROW_FACES)


def _arrow(length: float, neck: float, shaft: float, barb: float) -> Matrix:
    angles = np.linspace(0, 2 * np.pi, _RIM, endpoint=False)
    rim = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(_RIM)])
    rings = [radius * rim + (0, 0, height) for radius, height in ((shaft, 0.0), (shaft, neck), (barb, neck))]
    return np.concatenate([*rings, [[0.0, 0.0, length]]])


def _arrow_faces() -> Rows:
    k = np.arange(_RIM)
    after, tip = (k + 1) % _RIM, np.full(_RIM, 3 * _RIM)
    walls = [np.stack([ring + k, ring + after, ring + _RIM + k], -1) for ring in (0, _RIM)]
    walls += [np.stack([ring + after, ring + _RIM + after, ring + _RIM + k], -1) for ring in (0, _RIM)]
    return np.concatenate([*walls, np.stack([2 * _RIM + k, 2 * _RIM + after, tip], -1)])


_ARROW_FACES = _arrow_faces()


def draw_targets(node: Any, scene: Scene) -> None:
    """The marks of all poses, the touched planes, and the measuring frame."""
    points = [index for index, mark in enumerate(scene.marks) if mark.is_point]
    read = np.concatenate([_read(scene.marks[index]) for index in points] or [np.empty((0, 3))])
    if len(read):
        node["measured"].set_object(balls(scene.ball, _apart(read)), flat(MEASURED))
        phases = [np.concatenate([_seen(scene, phase, index) for index in points]) for phase in range(len(scene.targets))]
        for name, colour, places in zip(("nominal", "calibrated"), (NOMINAL, CALIBRATED), phases, strict=False):
            node[name].set_object(crosses(scene.ball, places, tilted=name == "calibrated"), flat(colour))
        if len(phases) > 1:
            node["shift"].set_object(segments(read, phases[0], NOMINAL, 0.7))
        node["error"].set_object(arrows(read, read + scene.target_magnification * (phases[-1] - read), 0.6 * scene.ball), flat(ERROR))
    _draw_axes(node["axes"], scene)
    _draw_planes(node["planes"], scene.targets[-1].planes, scene.marks)
    for axis, colour in enumerate(AXES):
        tip = _FRAME * scene.width * np.eye(3)[axis : axis + 1]
        node[f"frame_{'xyz'[axis]}"].set_object(arrows(np.zeros((1, 3)), tip, 0.07 * _FRAME * scene.width), flat(colour))


def draw_pose_targets(node: Any, scene: Scene) -> None:
    """The marks of the pose shown."""
    radius, middle = TARGET_POSE_SIZE * scene.ball, np.zeros((1, 3))
    for index in scene.moving:
        number, mark = index + 1, scene.marks[index]
        node[f"line_{number}"].set_object(unit_beam(_LINE * scene.width), flat(MISSING))
        if not mark.is_point:
            for axis, colour in enumerate(AXES):
                bar = arrows(middle, TRIAD * radius * np.eye(3)[axis : axis + 1], 0.3 * radius)
                node[f"axes_{number}"]["xyz"[axis]].set_object(bar, seen_through(colour))
            continue
        node[f"measured_{number}"].set_object(balls(radius, middle), seen_through(MEASURED))
        node[f"nominal_{number}"].set_object(crosses(radius, middle, tilted=False), seen_through(NOMINAL))
        node[f"error_{number}"].set_object(unit_arrow(0.5 * radius), seen_through(ERROR))
        if scene.calibrated is not None:
            node[f"calibrated_{number}"].set_object(crosses(radius, middle, tilted=True), seen_through(CALIBRATED))


def _draw_axes(node: Any, scene: Scene) -> None:
    """The measured axes of all poses, as thin lines."""
    for number, mark in enumerate(scene.marks, start=1):
        seen = ~np.isnan(mark.read[:, 0])
        for axis, colour in enumerate(AXES if mark.axes is not None and seen.any() else ()):
            assert mark.axes is not None
            tips = mark.read[seen] + TRIAD * scene.ball * mark.axes[seen, :, axis]
            node[f"{'xyz'[axis]}_{number}"].set_object(segments(mark.read[seen], tips, colour))


def _draw_planes(node: Any, planes: Sequence[Plane], marks: Sequence[Mark]) -> None:
    """Each touched plane as a sheet that holds its touches."""
    feet = np.concatenate([_read(mark) for mark in marks if mark.kind == "plane"] or [np.empty((0, 3))])
    for number, plane in enumerate(planes, start=1):
        normal = np.cross(*plane.along)
        on = feet[np.abs((feet - plane.point) @ normal) < 1e-6]
        flat_places = (on - plane.point) @ plane.along.T
        low, high = flat_places.min(axis=0), flat_places.max(axis=0)
        margin = 0.15 * float(np.max(high - low)) + 0.01
        corners = [(y, z) for y in (low[0] - margin, high[0] + margin) for z in (low[1] - margin, high[1] + margin)]
        sheet = mg.TriangularMeshGeometry(plane.point + np.array(corners) @ plane.along, np.array([[0, 1, 3], [0, 3, 2]]))
        material = mg.MeshBasicMaterial(color=PLANE, opacity=0.35, transparent=True, side=2, depthWrite=False)
        node[str(number)].set_object(sheet, material)


def _read(mark: Mark) -> Matrix:
    return mark.read[~np.isnan(mark.read[:, 0])]


def _seen(scene: Scene, phase: int, index: int) -> Matrix:
    """Where a robot has a target in the poses in which it was read."""
    return scene.shifted(phase, index)[~np.isnan(scene.marks[index].read[:, 0])]


def _apart(places: Matrix) -> Matrix:
    """Each place once: many touches share a socket."""
    return np.unique(np.round(places, 6), axis=0)


def _finer(points: Matrix, faces: Rows) -> tuple[Matrix, Rows]:
    """Each triangle of a ball cut into four."""
    corners = points[faces]
    between = [corners[:, a] + corners[:, b] for a, b in ((0, 1), (1, 2), (2, 0))]
    every = np.concatenate([corners, np.stack(between, axis=1)], axis=1)
    every /= np.linalg.norm(every, axis=2, keepdims=True)
    cut = np.array([[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]])
    unique, index = np.unique(np.round(every.reshape(-1, 3), 9), axis=0, return_inverse=True)
    return unique, index.reshape(-1)[(cut + 6 * np.arange(len(faces))[:, None, None]).reshape(-1, 3)]


def _stamped(points: Matrix, faces: Rows, centres: Matrix) -> Any:
    """The same shape (k, 3) at every centre (n, 3), as one mesh."""
    placed: Array3 = centres[:, None, :] + points
    return mg.TriangularMeshGeometry(placed.reshape(-1, 3), _repeated(faces, len(points), len(centres)))


def _repeated(faces: Rows, points: int, count: int) -> Rows:
    return (faces + points * np.arange(count)[:, None, None]).reshape(-1, 3)


def sight_of(mark: Mark, placed: bool) -> Vector | None:
    """Where the line to a target begins: at the measuring frame's origin, or a wire's fixed end; None where nothing sees it."""
    if mark.kind == "distance":
        return mark.fixed
    return np.zeros(3) if placed and mark.kind in ("point", "pixel") else None
