"""Marks as meshcat objects: what was read, where robots have it, and arrows from the one to the other.

On the screen marks are flat: discs, rings and flat arrows, each kind on a layer of its own a little before the sheet, on the side of the
lasers. In the measuring frame they are balls, crosses and round arrows. A kind's marks of all poses are one object; those of the pose
shown are objects of unit size that the animation moves.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from typing import Any, ClassVar

import numpy as np

from urdfcal.base.geometry import MM, Matrix, Vector
from urdfcal.output.view.meshes import (
    FLAT,
    ROUND,
    ArrowShape,
    arrows,
    balls,
    crosses,
    disc,
    flat,
    ring,
    seen_through,
    segments,
    tube,
    unit_arrow,
)
from urdfcal.output.view.placed import Mark, TouchedPlane
from urdfcal.output.view.recorder import mg
from urdfcal.output.view.scene import MarkGroup
from urdfcal.output.view.screen import LAYERS, MISSING

MEASURED, NOMINAL, CALIBRATED, ERROR = 0x3A8EE6, 0xE06C00, 0x008A60, 0x1B2026
PREDICTED = {"nominal": NOMINAL, "calibrated": CALIBRATED}  # in the order of a group's phases
AXES = (0xD0342C, 0x2E9E3F, 0x2F5FD0)  # x, y, z
PLANE = 0x8FB8DE
_POSE_LAYER = 2.5  # [mm] more before the sheet for the marks of the pose shown
_TRIAD = 4.0  # length of a measured pose's axes over the radius of a ball
_FRAME = 0.08  # length of the measuring frame's axes over the size of the group
_LINE = 0.0011  # radius of a line of sight over that size


class Style(ABC):
    """How the marks of a group look.

    Attributes:
        arrow: The shape of its arrows.
        widths: Of the arrows of all poses, and of the pose shown, over a mark's radius.
        pose_size: How much larger the marks of the pose shown are.
    """

    arrow: ClassVar[ArrowShape]
    widths: ClassVar[tuple[float, float]]
    pose_size: ClassVar[float]

    @abstractmethod
    def material(self, colour: int) -> Any:
        """Of the marks of the pose shown."""

    @abstractmethod
    def mark(self, name: str, radius: float, centres: Matrix) -> Any:
        """Marks that were `measured`, or that a robot predicts, about (n, 3) centres, [m]."""

    @abstractmethod
    def layer(self, name: str, of_pose: bool = False) -> Vector:
        """How far marks of a kind are drawn beside their places, (3,), [m]."""

    @abstractmethod
    def scales(self, lengths: Vector, widths: Vector) -> Matrix:
        """Scales of unit arrows that are to have some lengths and widths, (n, 3)."""


class FlatStyle(Style):
    """Of marks on the screen."""

    arrow, widths, pose_size = FLAT, (0.45, 0.5), 1.7

    def __init__(self, side: float) -> None:
        """Of a screen whose lasers stand on one side, -1 or 1 along its x."""
        self.side = side

    def material(self, colour: int) -> Any:
        """See the base class."""
        return flat(colour)

    def mark(self, name: str, radius: float, centres: Matrix) -> Any:
        """See the base class."""
        return disc(radius, centres) if name == "measured" else ring(radius, centres)

    def layer(self, name: str, of_pose: bool = False) -> Vector:
        """See the base class."""
        return np.array([self.side * (LAYERS[name] + (_POSE_LAYER if of_pose else 0.0)) * MM, 0.0, 0.0])

    def scales(self, lengths: Vector, widths: Vector) -> Matrix:
        """See the base class; the distance from the sheet stays."""
        return np.stack([np.ones_like(lengths), widths, lengths], axis=-1)


class RoundStyle(Style):
    """Of marks in space."""

    arrow, widths, pose_size = ROUND, (0.6, 0.5), 2.3

    def material(self, colour: int) -> Any:
        """See the base class."""
        return seen_through(colour)

    def mark(self, name: str, radius: float, centres: Matrix) -> Any:
        """See the base class."""
        return balls(radius, centres) if name == "measured" else crosses(radius, centres, tilted=name == "calibrated")

    def layer(self, name: str, of_pose: bool = False) -> Vector:
        """See the base class; there is none."""
        return np.zeros(3)

    def scales(self, lengths: Vector, widths: Vector) -> Matrix:
        """See the base class."""
        return np.stack([widths, widths, lengths], axis=-1)


def draw_marks(node: Any, group: MarkGroup, style: Style) -> None:
    """The marks of all poses."""
    read, phases = group.read, [group.predicted(phase) for phase in range(len(group.phases))]
    _draw_places(node, "measured", MEASURED, _apart(read), group, style)
    for (name, colour), places in zip(PREDICTED.items(), phases, strict=False):
        _draw_places(node, name, colour, places, group, style)
    if len(phases) > 1:
        tails, tips = _both(read, phases[0])
        if len(tails):
            lift = style.layer("shift")
            node["shift"].set_object(segments(tails + lift, tips + lift, NOMINAL, 0.7))
    tails, tips = _both(read, phases[-1])
    if len(tails):
        tails = tails + style.layer("error")
        tips = tips + style.layer("error")
        ends = tails + group.magnification * (tips - tails)
        node["error"].set_object(arrows(style.arrow, tails, ends, style.widths[0] * group.radius), flat(ERROR))


def _draw_places(node: Any, name: str, colour: int, places: Matrix, group: MarkGroup, style: Style) -> None:
    there = places[~np.isnan(places[:, 0])]
    if len(there):
        node[name].set_object(style.mark(name, group.radius, there + style.layer(name)), flat(colour))


def draw_pose_marks(node: Any, group: MarkGroup, style: Style) -> None:
    """The marks of the pose shown."""
    radius = style.pose_size * group.radius
    for index in group.moving:
        number, mark = index + 1, group.marks[index]
        if mark.start is not None:
            node[f"line_{number}"].set_object(tube(_LINE * group.size), flat(MISSING))
        if mark.axes is not None:
            draw_triad([node[f"axes_{number}"][axis] for axis in "xyz"], _TRIAD * radius, 0.3 * radius, seen_through)
        if not mark.is_point:
            continue
        for name, colour in {"measured": MEASURED, **dict(list(PREDICTED.items())[: len(group.phases)])}.items():
            node[f"{name}_{number}"].set_object(style.mark(name, radius, style.layer(name, of_pose=True)[None]), style.material(colour))
        arrow = unit_arrow(style.arrow, style.widths[1] * radius, style.layer("error", of_pose=True))
        node[f"error_{number}"].set_object(arrow, style.material(ERROR))


def frame_axes(group: MarkGroup) -> Matrix:
    """The ends of the measuring frame's axes, (3, 3), [m]."""
    return _FRAME * group.size * np.eye(3)


def draw_frame(node: Any, group: MarkGroup, planes: Sequence[TouchedPlane]) -> None:
    """The measuring frame, the planes that were touched, and the measured axes of all poses, as thin lines."""
    draw_triad([node[f"frame_{axis}"] for axis in "xyz"], _FRAME * group.size, 0.07 * _FRAME * group.size, flat)
    for number, plane in enumerate(planes, start=1):
        _draw_plane(node["planes"][str(number)], plane)
    for number, mark in enumerate(group.marks, start=1):
        _draw_axes(node["axes"], number, mark, _TRIAD * group.radius)


def draw_triad(nodes: Sequence[Any], length: float, width: float, material: Callable[[int], Any]) -> None:
    """Axes x, y and z as arrows, a node each."""
    for node, direction, colour in zip(nodes, np.eye(3), AXES, strict=True):
        node.set_object(arrows(ROUND, np.zeros((1, 3)), length * direction[None], width), material(colour))


def _draw_axes(node: Any, number: int, mark: Mark, length: float) -> None:
    if mark.axes is None or not mark.was_read.any():
        return
    starts, axes = mark.read[mark.was_read], mark.axes[mark.was_read]
    for axis, colour in enumerate(AXES):
        node[f"{'xyz'[axis]}_{number}"].set_object(segments(starts, starts + length * axes[:, :, axis], colour))


def _draw_plane(node: Any, plane: TouchedPlane) -> None:
    """A touched plane as a sheet that holds its touches."""
    along = np.linalg.svd(plane.normal[None])[2][1:]
    places = (plane.feet - plane.feet[0]) @ along.T
    low, high = places.min(axis=0), places.max(axis=0)
    margin = 0.15 * float(np.max(high - low)) + 0.01
    corners = [(y, z) for y in (low[0] - margin, high[0] + margin) for z in (low[1] - margin, high[1] + margin)]
    sheet = mg.TriangularMeshGeometry(plane.feet[0] + np.array(corners) @ along, np.array([[0, 1, 3], [0, 3, 2]]))
    node.set_object(sheet, mg.MeshBasicMaterial(color=PLANE, opacity=0.35, transparent=True, side=2, depthWrite=False))


def _both(read: Matrix, predicted: Matrix) -> tuple[Matrix, Matrix]:
    """Where both are known."""
    there = ~np.isnan(read[:, 0] + predicted[:, 0])
    return read[there], predicted[there]


def _apart(places: Matrix) -> Matrix:
    """Each place once: many touches share a socket."""
    return np.unique(np.round(places, 6), axis=0)
