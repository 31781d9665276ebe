"""The marks on and before the screen as meshcat objects: grid, spots, rings, arrows, beams.

Flat marks are drawn in the screen's (y, z), each kind on a layer of its own a little before the sheet, on the side of the lasers.
A kind's marks of all poses are one object; those of the pose shown are objects of unit size that the animation moves.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from urdfcal.base.geometry import MM, Array3, Matrix, Vector
from urdfcal.output.view.key_frames import Rows
from urdfcal.output.view.meshcat_parts import Plane, mg
from urdfcal.output.view.scene import FINE, Scene, Sheet

MEASURED, NOMINAL, CALIBRATED, ERROR = 0x3A8EE6, 0xE06C00, 0x008A60, 0x1B2026
BEAMS = (0xE3242B, 0xB5179E, 0x8D4B00, 0x3D5AFE)
FAINT_WIDTH, FAINT_OPACITY = 0.4, 0.5  # of uncalibrated beams, over a beam's
MISSING, GRID, FINE_GRID, SHEET = 0x7C858F, 0xB9C1C9, 0xDDE2E7, 0xFCFCFA
LAYERS = {"grid": 0.4, "shift": 0.8, "nominal": 1.2, "measured": 1.6, "calibrated": 2.0, "error": 2.4}  # [mm] before the sheet
POSE_LAYER = 2.5  # [mm] more for the marks of the pose shown
POSE_SIZE = 1.7  # how much larger those are
RING = (1.45, 1.95)  # inner and outer radius of a ring over a disc's
_LETTERS = 0.085  # canvas of a number over the sheet's size
_DASHES = 9
_SEGMENTS, _COARSE, _MANY = 28, 12, 600


def flat(colour: int, opacity: float = 1.0) -> Any:
    """A material that has this colour whatever the light."""
    return mg.MeshBasicMaterial(color=colour, opacity=opacity, transparent=opacity < 1)


def seen_through(colour: int) -> Any:
    """The same, drawn over whatever stands before it."""
    return mg.MeshBasicMaterial(color=colour, transparent=True, depthTest=False, depthWrite=False)


def disc(radius: float, centres: Matrix, lift: float) -> Any:
    """Discs in the screen's plane, about (n, 2) centres, [m]."""
    angles = _angles(len(centres))
    rim = radius * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    outline = np.concatenate([np.zeros((1, 2)), rim])
    k = np.arange(len(rim))
    faces = np.stack([np.zeros_like(k), 1 + k, 1 + (k + 1) % len(k)], axis=-1)
    return _stamped(outline, faces, centres, lift)


def ring(radius: float, centres: Matrix, lift: float) -> Any:
    """Rings about discs of that radius."""
    angles = _angles(len(centres))
    rim = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    k, n = np.arange(len(rim)), len(rim)
    after = (k + 1) % n
    faces = np.concatenate([np.stack([k, after, n + k], -1), np.stack([after, n + after, n + k], -1)])
    return _stamped(radius * np.concatenate([RING[0] * rim, RING[1] * rim]), faces, centres, lift)


def arrows(tails: Matrix, tips: Matrix, width: float, lift: float) -> Any:
    """Flat arrows from (n, 2) to (n, 2), [m]; one shorter than its head is all head."""
    along = tips - tails
    length = np.linalg.norm(along, axis=1)[:, None]
    unit = along / np.maximum(length, 1e-12)
    side = unit[:, ::-1] * (-1, 1)
    head = np.minimum(4.5 * width, length)
    neck, half = tips - unit * head, 0.5 * width * side
    barb = side * head * 0.42
    points = np.stack([tails + half, tails - half, neck - half, neck + half, neck - barb, tips, neck + barb], axis=1)
    faces = np.array([[0, 1, 2], [0, 2, 3], [4, 5, 6]])
    vertices = np.concatenate([np.full((*points.shape[:2], 1), lift), points], axis=-1).reshape(-1, 3)
    return mg.TriangularMeshGeometry(vertices, (faces + 7 * np.arange(len(points))[:, None, None]).reshape(-1, 3))


def unit_arrow(width: float, lift: float) -> Any:
    """An arrow of length 1 m along y, to be scaled along its length; its head is a third of it."""
    half, barb = width / 2, 1.6 * width
    points = np.array([[0, half], [0, -half], [0.7, -half], [0.7, half], [0.66, -barb], [1, 0], [0.66, barb]])
    return mg.TriangularMeshGeometry(lifted(points, lift), np.array([[0, 1, 2], [0, 2, 3], [4, 5, 6]]))


def segments(starts: Matrix, ends: Matrix, colour: int, opacity: float = 1.0) -> Any:
    """Thin lines between (n, 3) and (n, 3), [m]."""
    points = np.stack([starts, ends], axis=1).reshape(-1, 3)
    material = mg.LineBasicMaterial(color=colour, opacity=opacity, transparent=opacity < 1)
    return mg.LineSegments(mg.PointsGeometry(points.T.astype(np.float32)), material)


def unit_beam(radius: float, dashed: bool = False) -> Any:
    """A beam of length 1 m along z, to be scaled along its length."""
    parts = _DASHES if dashed else 1
    filled = 0.55 if dashed else 1.0
    angles = np.linspace(0, 2 * np.pi, 10, endpoint=False)
    rim = radius * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    k, n = np.arange(10), 10
    after = (k + 1) % n
    wall = np.concatenate([np.stack([k, after, n + k], -1), np.stack([after, n + after, n + k], -1)])
    vertices, faces = [], []
    for part in range(parts):
        ends = (part / parts, (part + filled) / parts)
        vertices += [np.column_stack([rim, np.full(n, end)]) for end in ends]
        faces.append(wall + 2 * n * part)
    return mg.TriangularMeshGeometry(np.concatenate(vertices), np.concatenate(faces))


def draw_beam(node: Any, beam: Any, colour: int, faint: bool) -> None:
    """A beam; faint ones leave no depth behind, and the page draws them first, so that a beam beside them keeps its colour."""
    opacity = FAINT_OPACITY if faint else 1.0
    node.set_object(beam, mg.MeshBasicMaterial(color=colour, opacity=opacity, transparent=True, depthWrite=not faint))


def lifted(spots: Matrix, lift: float) -> Matrix:
    """Points (n, 3) of the screen's axes over spots (n, 2)."""
    return np.column_stack([np.full(len(spots), lift), spots])


def draw_sheet(node: Any, sheet: Sheet, side: float) -> None:
    """The sheet with its grid, its axes y and z, and millimetres along its edges."""
    size, centre = sheet.high - sheet.low, (sheet.low + sheet.high) / 2
    placed = np.eye(4)
    placed[:3, 3] = (-side * 1.5 * MM, *centre)
    node["plane"].set_object(mg.Box([2 * MM, *size]), flat(SHEET))
    node["plane"].set_transform(placed)
    for name, pitch, colour, lift in (("fine", sheet.pitch / FINE, FINE_GRID, 0.2), ("grid", sheet.pitch, GRID, LAYERS["grid"])):
        node[name].set_object(segments(*_grid(sheet, pitch, side * lift * MM), colour))
    _draw_axes(node, sheet, side)
    _draw_numbers(node, sheet, side)


def _grid(sheet: Sheet, pitch: float, lift: float) -> tuple[Matrix, Matrix]:
    starts: list[Matrix] = []
    ends: list[Matrix] = []
    for axis in (0, 1):
        places = _multiples(sheet, axis, pitch)
        for end, found in ((sheet.low, starts), (sheet.high, ends)):
            line = np.tile(end, (len(places), 1))
            line[:, axis] = places
            found.append(lifted(line, lift))
    return np.concatenate(starts), np.concatenate(ends)


def _multiples(sheet: Sheet, axis: int, pitch: float) -> Vector:
    """The multiples of a pitch on the sheet."""
    first, last = np.ceil(sheet.low[axis] / pitch - 1e-6), np.floor(sheet.high[axis] / pitch + 1e-6)
    return np.asarray(np.arange(first, last + 1) * pitch)


def _draw_axes(node: Any, sheet: Sheet, side: float) -> None:
    """Y in green and z in blue from the screen's origin, as far as that lies near the sheet, with their names."""
    origin = np.zeros(2)
    if (np.abs(origin - np.clip(origin, sheet.low, sheet.high)) > sheet.size).any():
        return
    reach, width, lift = 0.13 * sheet.size, 0.005 * sheet.size, side * 0.7 * MM
    for axis, (name, colour) in enumerate((("y", 0x2E9E3F), ("z", 0x2F5FD0))):
        tip = origin + reach * np.eye(2)[axis]
        node[f"axis_{name}"].set_object(arrows(origin[None], tip[None], width, lift), flat(colour))
        _write(node[f"name_{name}"], name, tip + 0.03 * sheet.size * np.eye(2)[axis], 0.07 * sheet.size, side)


def _draw_numbers(node: Any, sheet: Sheet, side: float) -> None:
    """Millimetres along the lower edge and the edge of small y."""
    size, beside = _LETTERS * sheet.size, 0.36 * _LETTERS * sheet.size
    for axis, name in enumerate("yz"):
        places = _multiples(sheet, axis, sheet.pitch)
        for place in places[:: max(1, int(np.ceil(len(places) / 9)))]:
            at = np.array(sheet.low, dtype=float)
            at[axis], at[1 - axis] = place, sheet.low[1 - axis] - (beside if axis == 0 else 1.25 * beside)
            _write(node[f"number_{name}_{place / MM:.0f}"], f"{round(place / MM, 6) + 0.0:g}", at, size, side)
    middle = (sheet.low[0] + sheet.high[0]) / 2
    _write(node["title_y"], "y in mm", np.array([middle, sheet.low[1] - 2.7 * beside]), 1.5 * size, side)
    _write(node["title_z"], "z in mm", np.array([sheet.low[0] - 1.25 * beside, sheet.high[1] + 2.2 * beside]), 1.5 * size, side)


def _write(node: Any, text: str, at: Vector, size: float, side: float) -> None:
    """A word in the screen's plane, to be read from the lasers' side with z up."""
    properties = {"type": "_text", "text": text, "font_size": 88, "font_face": "sans-serif"}
    material = mg.MeshBasicMaterial(map=mg.GenericTexture(properties), transparent=True, depthWrite=False)
    node.set_object(Plane(size, size), material)
    placed = np.eye(4)
    placed[:3, :3] = np.array([[0, side, 0], [0, 0, 1], [side, 0, 0]]).T
    placed[:3, 3] = (side * MM, *(at - (0, 0.09 * size)))  # the letters stand on the middle of their canvas
    node.set_transform(placed)


def draw_spots(node: Any, scene: Scene) -> None:
    """The spots of all poses: measured discs, predicted rings, and arrows from the one to the other."""
    seen, mark, lift = scene.data.seen, scene.mark, scene.side * MM
    measured = scene.data.spots[seen]
    if len(measured):
        node["measured"].set_object(disc(mark, measured, LAYERS["measured"] * lift), flat(MEASURED))
    for name, beams, colour in (("nominal", scene.before, NOMINAL), ("calibrated", scene.after, CALIBRATED)):
        if beams is None or not scene.lands(beams).any():
            continue
        rings = ring(mark, beams.spots[scene.lands(beams)], LAYERS[name] * lift)
        node[name].set_object(rings, flat(colour))
    if scene.after is not None:
        _draw_shifts(node, scene)
    both = seen & scene.lands(scene.shown)
    if both.any():
        tails = scene.data.spots[both]
        tips = tails + scene.magnification * (scene.shown.spots[both] - tails)
        node["error"].set_object(arrows(tails, tips, 0.45 * mark, LAYERS["error"] * lift), flat(ERROR))


def _draw_shifts(node: Any, scene: Scene) -> None:
    """Thin lines at true length from the measured spots to where the nominal robot had them."""
    both = scene.data.seen & scene.lands(scene.before)
    if both.any():
        lift = scene.side * LAYERS["shift"] * MM
        ends = (lifted(scene.data.spots[both], lift), lifted(scene.before.spots[both], lift))
        node["shift"].set_object(segments(*ends, NOMINAL, 0.7))


def draw_all_beams(node: Any, scene: Scene) -> None:
    """The beams of the drawn robot in all poses, as thin lines."""
    beams = scene.shown
    for laser, colour in zip(range(beams.length.shape[1]), _cycled(BEAMS), strict=False):
        lands = scene.lands(beams)[:, laser]
        if lands.any():
            ends = lifted(beams.spots[lands, laser], 0.0)
            node[f"beam_{laser + 1}"].set_object(segments(beams.source[lands, laser], ends, colour, 0.45))


def beam_colour(laser: int) -> int:
    """The colour of a laser's beam."""
    return BEAMS[laser % len(BEAMS)]


def _cycled(colours: tuple[int, ...]) -> tuple[int, ...]:
    return colours * 8


def _angles(count: int) -> Vector:
    return np.linspace(0, 2 * np.pi, _SEGMENTS if count < _MANY else _COARSE, endpoint=False)


def _stamped(outline: Matrix, faces: Rows, centres: Matrix, lift: float) -> Any:
    """The same flat outline (k, 2) at every centre (n, 2), as one mesh."""
    points: Array3 = centres[:, None, :] + outline
    vertices = np.concatenate([np.full((*points.shape[:2], 1), lift), points], axis=-1).reshape(-1, 3)
    shifted = faces + len(outline) * np.arange(len(centres))[:, None, None]
    return mg.TriangularMeshGeometry(vertices, shifted.reshape(-1, 3))
