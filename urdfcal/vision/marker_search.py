"""ArUco markers in a picture, their corners to a fraction of a pixel.

OpenCV finds the markers; a corner is then where the two straight edges meet that run through it. An edge is fitted to the mean
place of the rise from black to white along it, which neither blur nor the pixels' size shifts; a corner itself any blur rounds off.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from urdfcal.geometry import Matrix, Vector
from urdfcal.vision.pictures import Grey
from urdfcal.vision.screen_markers import ScreenMarkers, aruco_dictionary

_MARGIN = 0.12  # of an edge, left out at either end
_REACH = 0.4  # of a cell, to either side of an edge
_LEAST_EDGE_PX = 12.0
_LEAST_CONTRAST = 10.0  # of 255


@dataclass(frozen=True, eq=False)
class SeenMarker:
    """A marker in a picture.

    Attributes:
        id: Its number in the dictionary.
        pixels: Corners (4, 2): top left, top right, bottom right, bottom left, seen from the front.
    """

    id: int
    pixels: Matrix


def find_markers(picture: Grey, markers: ScreenMarkers) -> list[SeenMarker]:
    """The markers of a dictionary in a picture; from the back it is turned around before, and the pixels are turned back."""
    back = markers.side == "back"
    shown = np.asarray(cv2.flip(picture, 1) if back else picture, dtype=np.uint8)
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    dictionary = aruco_dictionary(markers.dictionary)
    corners, ids, _ = cv2.aruco.ArucoDetector(dictionary, parameters).detectMarkers(shown)
    numbers: Sequence[int] = [] if ids is None else [int(number) for number in np.ravel(ids)]
    cells = dictionary.markerSize + 2
    found = [
        SeenMarker(number, _by_edges(shown, quad.reshape(4, 2).astype(float), cells)) for number, quad in zip(numbers, corners, strict=True)
    ]
    width = picture.shape[1]
    return [SeenMarker(marker.id, marker.pixels * [-1, 1] + [width - 1, 0]) for marker in found] if back else found


def _by_edges(picture: Grey, quad: Matrix, cells: int) -> Matrix:
    """Corners (4, 2) as the crossings of the edges; as they were where the marker is too small or an edge is not straight."""
    for _ in range(2):
        lines = [_edge(picture, quad[corner], quad[(corner + 1) % 4], cells) for corner in range(4)]
        if any(line is None for line in lines):
            return quad
        crossings = np.cross([line for line in np.roll(np.array(lines), 1, axis=0)], np.array(lines))
        moved = crossings[:, :2] / crossings[:, 2:]
        if not np.isfinite(moved).all() or np.linalg.norm(moved - quad, axis=1).max() > 2.0:
            return quad
        quad = moved
    return quad


def _edge(picture: Grey, start: Vector, end: Vector, cells: int) -> Vector | None:
    """The line (a, b, c), a u + b v + c = 0, of the rise from black to white between two corners; None where there is none."""
    length = float(np.linalg.norm(end - start))
    if length < _LEAST_EDGE_PX:
        return None
    along = (end - start) / length
    outward = np.array([along[1], -along[0]])  # corners run clockwise in a picture whose v points down
    reach = float(np.clip(_REACH * length / cells, 1.5, 6.0))
    places = start + np.linspace(_MARGIN, 1 - _MARGIN, max(8, int(length)))[:, None] * (end - start)
    offsets = np.arange(-reach, reach + 1e-9, 0.25)
    samples = (places[:, None] + offsets[:, None] * outward).astype(np.float32)
    levels = cv2.remap(picture.astype(np.float32), samples[..., 0], samples[..., 1], cv2.INTER_LINEAR)
    steps = np.diff(np.asarray(levels, dtype=float), axis=1)  # black inside, light outside
    total = steps.sum(axis=1)
    usual = float(np.median(total))
    good = (total > 0.5 * usual) & (total < 1.5 * usual)
    if usual < _LEAST_CONTRAST or good.sum() < 6:
        return None
    across = (steps @ (offsets[1:] + offsets[:-1]))[good] / 2 / total[good]
    position = ((places - start) @ along)[good]
    keep = np.ones(len(across), dtype=bool)
    for _ in range(3):
        slope, offset = np.polyfit(position[keep], across[keep], 1)
        off = across - slope * position - offset
        spread = max(0.05, 1.4826 * float(np.median(np.abs(off[keep]))))
        keep = np.abs(off) < 3 * spread
        if keep.sum() < 6:
            return None
    first, last = (start + at * along + (slope * at + offset) * outward for at in (0.0, length))
    return np.asarray(np.cross([*first, 1.0], [*last, 1.0]))
