"""The screen as it is drawn: a sheet of its plane with a grid, axes and millimetres along its edges, and the beams that end on it.

Everything is in the axes of the screen; a little before the sheet means on the side of the lasers.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from urdfcal.base.geometry import MM, Array3, Mask, Matrix, Vector
from urdfcal.output.view.meshes import FLAT, arrows, flat, on_screen, segments, tube
from urdfcal.output.view.recorder import Plane, mg
from urdfcal.sensors.spots import Beams

BEAMS = (0xE3242B, 0xB5179E, 0x8D4B00, 0x3D5AFE)
FAINT_WIDTH, FAINT_OPACITY = 0.4, 0.5  # of uncalibrated beams, over a beam's
MISSING, GRID, FINE_GRID, SHEET = 0x7C858F, 0xB9C1C9, 0xDDE2E7, 0xFCFCFA
LAYERS = {"grid": 0.4, "shift": 0.8, "nominal": 1.2, "measured": 1.6, "calibrated": 2.0, "error": 2.4}  # [mm] before the sheet
FINE = 5  # fine grid squares along one square of the grid
_FAR = 1.1  # half sizes of the measured spots' box: predicted spots farther off are not on the sheet
_LEAST_SHEET = 0.6  # [m]
_MARGIN = 0.02  # of the sheet's size, around the spots
_LETTERS = 0.085  # canvas of a number over the sheet's size
_BEAM = 0.0024  # radius of a drawn beam over the size of the scene


@dataclass(frozen=True)
class Sheet:
    """The piece of the screen's plane that is drawn: opposite corners (y, z), [m], and the pitch of its grid, [m]."""

    low: Vector
    high: Vector
    pitch: float

    @property
    def size(self) -> float:
        """Its longer side, [m]."""
        return float(np.max(self.high - self.low))

    def holds(self, spots: Array3) -> Mask:
        """Which spots lie on it."""
        with np.errstate(invalid="ignore"):
            return np.asarray(((spots >= self.low) & (spots <= self.high)).all(axis=-1))


def sheet_of(measured: Matrix, predicted: Sequence[Matrix]) -> Sheet:
    """A sheet that holds measured spots (n, 2), [m], and of predicted ones those that are not too far off."""
    base = measured if len(measured) else np.concatenate([*predicted, np.zeros((1, 2))])
    low, high = base.min(axis=0), base.max(axis=0)
    centre, half = (low + high) / 2, np.maximum((high - low) / 2, _LEAST_SHEET / 2)
    near = [spots[(np.abs(spots - centre) < _FAR * half.max()).all(axis=1)] for spots in predicted]
    held = np.concatenate([base, *near, [centre - half, centre + half]])
    low, high = held.min(axis=0), held.max(axis=0)
    size = float(np.max(high - low))
    pitch, margin = _pitch(size / 10), _MARGIN * size
    fine = pitch / FINE
    return Sheet(fine * np.floor((low - margin) / fine), fine * np.ceil((high + margin) / fine), pitch)


def _pitch(wanted: float) -> float:
    """1, 2 or 5 times a power of ten, at least `wanted`."""
    decade = 10.0 ** np.floor(np.log10(wanted))
    return float(next(step * decade for step in (1, 2, 5, 10) if step * decade >= wanted * (1 - 1e-9)))


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
            found.append(on_screen(line, lift))
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
        node[f"axis_{name}"].set_object(arrows(FLAT, on_screen(origin[None], lift), on_screen(tip[None], lift), width), flat(colour))
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


def draw_all_beams(node: Any, beams: Beams, lands: Mask) -> None:
    """The beams of one robot in all poses, as far as they land, as thin lines."""
    for laser in np.flatnonzero(lands.any(axis=0)).tolist():
        own = lands[:, laser]
        ends = on_screen(beams.spots[own, laser])
        node[f"beam_{laser + 1}"].set_object(segments(beams.source[own, laser], ends, beam_colour(laser), 0.45))


def draw_pose_beams(node: Any, name: str, lasers: int, size: float, colour: int | None = None) -> None:
    """The beams of the pose shown and those that miss, of unit length; uncalibrated ones have one colour, and are faint."""
    radius = (1.0 if colour is None else FAINT_WIDTH) * _BEAM * size
    for laser in range(lasers):
        own = beam_colour(laser) if colour is None else colour
        _draw_beam(node[f"{name}_{laser + 1}"], tube(radius), own, colour is not None)
        _draw_beam(node[f"{name}_missing_{laser + 1}"], tube(radius, dashed=True), MISSING, colour is not None)


def _draw_beam(node: Any, beam: Any, colour: int, faint: bool) -> None:
    """A beam; faint ones leave no depth behind, and the page draws them first, so that a beam beside them keeps its colour."""
    opacity = FAINT_OPACITY if faint else 1.0
    node.set_object(beam, mg.MeshBasicMaterial(color=colour, opacity=opacity, transparent=True, depthWrite=not faint))


def beam_colour(laser: int) -> int:
    """The colour of a laser's beam."""
    return BEAMS[laser % len(BEAMS)]
