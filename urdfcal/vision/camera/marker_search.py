"""ArUco markers in a picture, their corners to a fraction of a pixel.

OpenCV finds the markers; a corner is then where the two edges meet that run through it. An edge is fitted to the mean place of the rise
from black to white along it, which neither blur nor the pixels' size shifts; a corner itself any blur rounds off. Edges are straight where
the lens bends nothing, so that they are followed and fitted as a pinhole with the camera's matrix would see them: of a marker that is 300
px wide in a barrel lens the corners would lie 1 px too far out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from urdfcal.base.geometry import Matrix, Vector
from urdfcal.sensors.camera import Camera
from urdfcal.vision.camera.markers import ScreenMarkers, aruco_dictionary
from urdfcal.vision.pictures import Grey

_MARGIN = 0.12  # of an edge, left out at either end
_REACH = 0.4  # of a cell, to either side of an edge
_LEAST_EDGE_PX = 12.0
_LEAST_CONTRAST = 10.0  # of 255
_APART = (0.125, 0.02)  # of a marker's perimeter: nearer to each other, OpenCV takes two squares for one; see _quads
_OF_ENDS = 1.155  # sqrt(4 / 3): a rise's mean place is moved by the noise of both its ends, which interpolation has smoothed
_AT_END = float(
    np.sqrt(1 + 3 / (1 - 2 * _MARGIN) ** 2)
)  # of a line's sigma in its middle: at an end, which lies beyond what it is fitted to
_LEAST_CELL_PX = 6.0  # in narrower ones a blurred edge runs into the next cell's, which is worse than noise
_FARTHEST_PX = 2.0  # from where OpenCV has a corner
_STRAIGHT_PX = 0.005  # of a bow that is none


@dataclass(frozen=True, eq=False)
class SeenMarker:
    """A marker in a picture.

    Attributes:
        id: Its number in the dictionary.
        pixels: Corners (4, 2): top left, top right, bottom right, bottom left, seen from the front.
        sigmas: Standard deviation of a coordinate of each by one grey level of noise a pixel, (4,), [px]; nan where no edges
            were fitted, or the next cells are too near to know.
    """

    id: int
    pixels: Matrix
    sigmas: Vector


def find_markers(picture: Grey, markers: ScreenMarkers, camera: Camera) -> list[SeenMarker]:
    """The markers of a dictionary in a picture; from the back it is turned around before, and the pixels are turned back."""
    back, width = markers.side == "back", picture.shape[1]
    shown = np.asarray(cv2.flip(picture, 1) if back else picture, dtype=np.uint8)
    dictionary = aruco_dictionary(markers.dictionary)
    edges = _Edges(shown, dictionary.markerSize + 2, _Bending(camera, width if back else None))
    found = [SeenMarker(number, *edges.corners(quad)) for number, quad in _quads(shown, dictionary)]
    return [replace(marker, pixels=_mirrored(marker.pixels, width)) for marker in found] if back else found


def _quads(picture: Grey, dictionary: cv2.aruco.Dictionary) -> list[tuple[int, Matrix]]:
    """Numbers and corners (4, 2), as OpenCV has them; in a second look those that the edge of their own paper hid from it."""
    seen: list[tuple[int, Matrix]] = []
    for apart in _APART:
        parameters = cv2.aruco.DetectorParameters()
        parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
        parameters.minMarkerDistanceRate = apart
        corners, ids, _ = cv2.aruco.ArucoDetector(dictionary, parameters).detectMarkers(picture)
        numbers: Sequence[int] = [] if ids is None else [int(number) for number in np.ravel(ids)]
        known = {number for number, _ in seen}
        seen += [(number, quad.reshape(4, 2).astype(float)) for number, quad in zip(numbers, corners, strict=True) if number not in known]
    return seen


def _mirrored(pixels: Matrix, width: int) -> Matrix:
    return pixels * [-1, 1] + [width - 1, 0]


@dataclass(frozen=True, eq=False)
class _Bending:
    """What a lens does to straight lines.

    Attributes:
        camera: The lens; None where it does nothing that matters.
        mirrored: Width of the picture if it was turned around, [px].
    """

    camera: Camera | None
    mirrored: int | None = None

    def straight(self, pixels: Matrix) -> Matrix:
        """Where a pinhole with the same matrix has what is seen at pixels (n, 2); nan where the lens has no ray before it."""
        if self.camera is None:
            return pixels
        rays = self.camera.rays(self._turned(pixels))
        before = np.where(rays[:, 2:] > 0, rays[:, 2:], np.nan)
        return self._turned((rays / before @ self.camera.matrix.T)[:, :2])

    def bent(self, points: Matrix) -> Matrix:
        """The inverse."""
        if self.camera is None:
            return points
        rays = np.column_stack([self._turned(points), np.ones(len(points))]) @ np.linalg.inv(self.camera.matrix).T
        return self._turned(self.camera.project(rays))

    def _turned(self, pixels: Matrix) -> Matrix:
        return pixels if self.mirrored is None else _mirrored(pixels, self.mirrored)

    def along(self, quad: Matrix) -> _Bending:
        """The same, or nothing at all where the edges between four pixels are bowed by nothing that matters."""
        ends = self.straight(quad)
        off = self.bent((ends + np.roll(ends, -1, axis=0)) / 2) - (quad + np.roll(quad, -1, axis=0)) / 2
        return _Bending(None) if np.linalg.norm(off, axis=1).max() < _STRAIGHT_PX else self


@dataclass(frozen=True, eq=False)
class _Edges:
    """Edges of markers in a picture.

    Attributes:
        picture: Brightness, (height, width).
        cells: Of a marker, from edge to edge.
        lens: What bends them.
    """

    picture: Grey
    cells: int
    lens: _Bending

    def corners(self, quad: Matrix) -> tuple[Matrix, Vector]:
        """Corners (4, 2) as the crossings of the edges, and their sigmas (4,); as they were, and nan, where an edge is short or bent."""
        lens, rough = self.lens.along(quad), (quad, np.full(4, np.nan))
        for _ in range(2):
            ends = lens.straight(quad)
            edges = [self._edge(lens, ends[corner], ends[(corner + 1) % 4]) for corner in range(4)]
            if any(edge is None for edge in edges):
                return rough
            lines, sigmas = (np.array(both) for both in zip(*(edge for edge in edges if edge is not None), strict=True))
            crossings = np.cross(np.roll(lines, 1, axis=0), lines)
            moved = lens.bent(crossings[:, :2] / crossings[:, 2:])
            if not np.isfinite(moved).all() or np.linalg.norm(moved - quad, axis=1).max() > _FARTHEST_PX:
                return rough
            quad = moved
            rough = (quad, np.where(self._cell(ends) < _LEAST_CELL_PX, np.nan, _crossing_sigmas(lines, sigmas)))
        return rough

    def _cell(self, ends: Matrix) -> float:
        """How wide a cell of a marker between four corners is seen across its narrowest side, [px]."""
        along = np.roll(ends, -1, axis=0) - ends
        lengths = np.linalg.norm(along, axis=1)
        across = np.abs(along[:, 0] * np.roll(along, -1, axis=0)[:, 1] - along[:, 1] * np.roll(along, -1, axis=0)[:, 0])
        return float((across / lengths).min() / self.cells)

    def _edge(self, lens: _Bending, start: Vector, end: Vector) -> tuple[Vector, float] | None:
        """The line (a, b, c), a u + b v + c = 0, of the rise from black to white between two corners, and its sigma at either of them.

        Ends and line are as a pinhole has them. None where there is no such rise.
        """
        length = float(np.linalg.norm(end - start))
        if not length >= _LEAST_EDGE_PX:
            return None
        along = (end - start) / length
        outward = np.array([along[1], -along[0]])  # corners run clockwise in a picture whose v points down
        rise = self._rise(lens.bent(start + np.linspace(_MARGIN, 1 - _MARGIN, max(8, int(length)))[:, None] * (end - start)), length)
        if rise is None:
            return None
        found = lens.straight(rise[0]) - start
        fitted = _fitted(found @ along, found @ outward)
        if fitted is None:
            return None
        slope, offset = fitted
        first, last = (start + at * along + (slope * at + offset) * outward for at in (0.0, length))
        line = np.cross([*first, 1.0], [*last, 1.0])
        return np.asarray(line / np.linalg.norm(line[:2])), rise[1] * _AT_END / float(np.sqrt((1 - 2 * _MARGIN) * length))

    def _rise(self, places: Matrix, length: float) -> tuple[Matrix, float] | None:
        """Mean places of the rise from black to white across a curve of places, in the picture, and their sigma by a pixel of edge.

        None where there is too little of it.
        """
        tangents = np.gradient(places, axis=0)
        outward = np.column_stack([tangents[:, 1], -tangents[:, 0]]) / np.linalg.norm(tangents, axis=1, keepdims=True)
        reach = float(np.clip(_REACH * length / self.cells, 1.5, 6.0))
        offsets = np.arange(-reach, reach + 1e-9, 0.25)
        samples = (places[:, None] + offsets[:, None] * outward[:, None]).astype(np.float32)
        levels = cv2.remap(self.picture.astype(np.float32), samples[..., 0], samples[..., 1], cv2.INTER_LINEAR)
        steps = np.diff(np.asarray(levels, dtype=float), axis=1)  # black inside, light outside
        total = steps.sum(axis=1)
        usual = float(np.median(total))
        good = (total > 0.5 * usual) & (total < 1.5 * usual)
        if usual < _LEAST_CONTRAST or good.sum() < 6:
            return None
        across = (steps @ (offsets[1:] + offsets[:-1]))[good] / 2 / total[good]
        return np.asarray(places[good] + across[:, None] * outward[good]), _OF_ENDS * reach / usual


def _crossing_sigmas(lines: Matrix, sigmas: Vector) -> Vector:
    """Sigma of a coordinate of each corner, (4,), where the line (a, b, c) before it and its own cross, a^2 + b^2 = 1."""
    normals = np.stack([np.roll(lines[:, :2], 1, axis=0), lines[:, :2]], axis=1)
    spread = np.linalg.inv(normals) * np.stack([np.roll(sigmas, 1), sigmas], axis=1)[:, None]
    return np.asarray(np.sqrt((spread**2).sum(axis=(1, 2)) / 2))


def _fitted(position: Vector, across: Vector) -> tuple[float, float] | None:
    """Slope and offset of a line that lets go of what is far from it; None where too little is left."""
    keep = np.ones(len(across), dtype=bool)
    for _ in range(3):
        slope, offset = np.polyfit(position[keep], across[keep], 1)
        off = across - slope * position - offset
        spread = max(0.05, 1.4826 * float(np.median(np.abs(off[keep]))))
        keep = np.abs(off) < 3 * spread
        if keep.sum() < 6:
            return None
    return float(slope), float(offset)
