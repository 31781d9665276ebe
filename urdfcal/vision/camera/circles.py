"""Grids of circles: dark, on white, every second row shifted (OpenCV's asymmetric grid), found to a small fraction of a pixel.

    circles:4x11:20mm[:14mm]    4 circles in a row, 11 rows that are 20 mm apart; in a row they are 40 mm apart, and every second row
                                begins 20 mm farther in. Their diameter by default 0.7 of the step between rows

OpenCV finds the grid; a circle's place is then the centre of its darkness,

    c = sum_i d_i p_i / A      A = sum_i d_i      d_i = (white - level_i) / (white - black)

over the pixels p_i of a window, a circle on the board, that nothing else reaches into, white the plane through the window's rim. Neither
blur nor the pixels' size shifts it. It is the centre of what is seen of the circle, which is not where the circle's centre is seen: the
nearer half of a tilted circle looks larger. By how much follows from pose, lens and diameter (`shift_of`), the diameter from the area A of
the very picture. Its sigma is what noise of the pixels makes of this sum, white's part included.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from urdfcal.base.errors import UsageError
from urdfcal.base.geometry import SE3, Array3, Matrix, Vector
from urdfcal.robot.rig import Grid
from urdfcal.sensors.camera import Camera
from urdfcal.vision.camera.boards import LENGTH, BoardView, Numbers, length_of, require_counts, slopes_of
from urdfcal.vision.pictures import Grey

_WORD = re.compile(rf"(\d+)x(\d+):{LENGTH}(?::{LENGTH})?")
_USUAL_DIAMETER, _WIDEST = 0.7, 0.9  # of the step between rows; circles touch at 1.41
_LEAST_AREA_PX, _MOST_AREA = 12.0, 0.02  # of a circle; of the picture
_LEAST_CONTRAST = 10.0  # of 255
LEAST_CIRCLES = 6
_HALF_WAY = np.sqrt(0.5)  # to the next circle, of the step
_RIM, _CORE, _BLUR_PX = 0.85, 0.25, 3.0  # of the window's radius; how far from a circle's edge white is white
_SIZES, _TRIES = 3.0, 4  # largest circle over the smallest in one picture; sizes that are tried
_MOST_SPOTS = 2  # for each circle
_DOT_PX, _SHIFT = 2.6, 4
_LEAST_PIXELS = 6  # of a window's rim
_ROUNDS, _STILL_PX = 5, 0.002
_TRIAL = 0.01  # of the way to the next circle
_TURNS = np.linspace(0.0, 2.0 * np.pi, 48, endpoint=False)


@dataclass(frozen=True)
class CircleGrid:
    """Circles in rows of which every second is shifted.

    Attributes:
        columns: Circles in a row.
        rows: Rows of them.
        step: From row to row, and half of that from circle to circle in a row, [m].
        diameter: Of a circle, [m]; for drawing, pictures tell their own.
    """

    columns: int
    rows: int
    step: float
    diameter: float

    def __str__(self) -> str:
        return f"asymmetric grid of {self.columns} x {self.rows} circles"

    @property
    def grid(self) -> Grid:
        """The middles of its circles."""
        return Grid(self.columns, self.rows, self.step, staggered=True)

    def find(self, picture: Grey, name: str) -> BoardView | str:
        """The centres of its circles as they are seen, row by row, or why they were not found."""
        found = self.seen(picture)
        return found if isinstance(found, str) else BoardView(name, self.grid.points()[found.numbers], found.pixels, found.areas)

    def seen(self, picture: Grey) -> CirclesSeen | str:
        """Its circles, row by row, or why they were not found; those that the picture's edge touches are left out."""
        rough = self._rough(picture)
        if rough is None:
            return f"no {self} found; the whole of it must be seen"
        slopes = slopes_of(self.grid.points(), rough)
        return "the circles lie on no plane" if slopes is None else _centred(picture, rough, _HALF_WAY * self.step * slopes)

    def _rough(self, picture: Grey) -> Matrix | None:
        """Rough middles (n, 2), from the first circle on."""
        spots = cv2.SimpleBlobDetector.create(_blobs(picture)).detect(picture)
        dots = cv2.SimpleBlobDetector.create(_blobs(np.full((100, 100), 255, dtype=np.uint8)))
        for alike in _alike(spots, self.columns * self.rows):
            clean = _dotted(picture, alike)
            for clustering in (0, cv2.CALIB_CB_CLUSTERING):
                flags = cv2.CALIB_CB_ASYMMETRIC_GRID | clustering
                found, middles = cv2.findCirclesGrid(clean, (self.columns, self.rows), flags=flags, blobDetector=dots)
                if found:
                    return self._in_order(np.asarray(middles, dtype=float).reshape(-1, 2))
        return None

    def _in_order(self, middles: Matrix) -> Matrix | None:
        """The same from the grid's first circle on, not from its last; upright where rows are even in number and nothing tells."""
        points = self.grid.points()[:, :2]
        ways = [(way, *_flat(points, way)) for way in (middles, middles[::-1])]
        good = [(way, off) for way, off, kept in ways if kept]
        if not good:
            return None
        least = min(off for _, off in good)
        return max((way for way, off in good if off <= 2 * least), key=lambda way: float((way[-1] - way[0]).sum()))


@dataclass(frozen=True, eq=False)
class CirclesSeen:
    """Circles in a picture.

    Attributes:
        numbers: Which of the grid they are, (n,).
        pixels: Centres of their darkness, (n, 2).
        areas: How much of it there is, (n,), [px^2].
        sigmas: Of a coordinate of each, by one grey level of noise a pixel, (n,), [px].
    """

    numbers: Numbers
    pixels: Matrix
    areas: Vector
    sigmas: Vector


def shift_of(camera: Camera, T_camera_board: SE3, points: Matrix, areas: Vector) -> Matrix:
    """From where the circles' centres are seen to the centres of what is seen of the circles, (n, 2), [px].

    Args:
        camera: The lens.
        T_camera_board: Pose of the board.
        points: The circles' centres on it, (n, 3), [m].
        areas: What is seen of the circles, which are all of one size, (n,), [px^2].
    """
    small = _TRIAL * _apart(points)  # areas grow with a radius's square, and shifts, too
    middles = camera.project(points @ T_camera_board.rotation.T + T_camera_board.translation)
    radius = small * np.sqrt(np.median(areas / _centroids(camera, T_camera_board, points, small, middles)[1]))
    return _centroids(camera, T_camera_board, points, radius, middles)[0]


def _apart(points: Matrix) -> float:
    """How far a grid's first two points are apart, [m]."""
    return float(np.linalg.norm(points[1] - points[0]))


def _centroids(camera: Camera, T_camera_board: SE3, points: Matrix, radius: float, middles: Matrix) -> tuple[Matrix, Vector]:
    """Centroids (n, 2), seen from the middles, and areas (n,) of what is seen of circles."""
    rim = radius * np.column_stack([np.cos(_TURNS), np.sin(_TURNS), np.zeros(len(_TURNS))])
    around = (points[:, None] + rim).reshape(-1, 3) @ T_camera_board.rotation.T + T_camera_board.translation
    one = camera.project(around).reshape(len(points), -1, 2) - middles[:, None]
    other = np.roll(one, -1, axis=1)
    cross = one[..., 0] * other[..., 1] - other[..., 0] * one[..., 1]
    area = cross.sum(axis=1) / 2
    return ((one + other) * cross[..., None]).sum(axis=1) / (6 * area[:, None]), np.abs(area)


def _blobs(picture: Grey) -> cv2.SimpleBlobDetector.Params:
    """Dark round spots of any size that a board's circles can have."""
    wanted = cv2.SimpleBlobDetector.Params()
    wanted.minArea, wanted.maxArea = _LEAST_AREA_PX, _MOST_AREA * picture.size
    wanted.minDistBetweenBlobs, wanted.minConvexity = 3.0, 0.85
    wanted.filterByCircularity, wanted.minCircularity = True, 0.5
    return wanted


def _alike(spots: Sequence[cv2.KeyPoint], count: int) -> list[list[cv2.KeyPoint]]:
    """Spots whose sizes a grid of so many circles can have in one picture, the largest first: letters are not among circles.

    Sets of many more spots than circles are left out: no grid is told from a texture, and OpenCV takes minutes for some hundreds.
    """
    spots = sorted(spots, key=lambda spot: -spot.size)
    sizes = np.array([spot.size for spot in spots])
    ends = np.searchsorted(-sizes, -sizes / _SIZES, side="right")
    first = [
        start
        for start in range(len(spots))
        if count <= ends[start] - start <= _MOST_SPOTS * count and (start == 0 or ends[start] > ends[start - 1])
    ]
    return [spots[start : ends[start]] for start in first[:_TRIES]]


def _dotted(picture: Grey, spots: Sequence[cv2.KeyPoint]) -> Grey:
    """A clean picture with a dot at every spot."""
    clean = np.full(picture.shape, 255, dtype=np.uint8)
    for spot in spots:
        middle = tuple(round(2**_SHIFT * place) for place in spot.pt)
        cv2.circle(clean, (middle[0], middle[1]), round(2**_SHIFT * _DOT_PX), 0, cv2.FILLED, cv2.LINE_AA, _SHIFT)
    return clean


def _flat(points: Matrix, pixels: Matrix) -> tuple[float, bool]:
    """How far pixels are from a plane's picture of points, RMS [px], and whether the plane is seen from its front."""
    homography, _ = cv2.findHomography(points, pixels)
    if homography is None:
        return np.inf, False
    off = cv2.perspectiveTransform(points.reshape(-1, 1, 2), homography)[:, 0] - pixels
    weight = points @ homography[2, :2] + homography[2, 2]
    return float(np.sqrt((off**2).sum(axis=1).mean())), bool(np.linalg.det(homography) * np.median(weight) > 0)


def _centred(picture: Grey, rough: Matrix, windows: Array3) -> CirclesSeen | str:
    """Each circle's own centre, area and sigma; windows (n, 2, 2) are where the axes of a window on the board lie in the picture."""
    found = {number: _one_centred(picture, *both) for number, both in enumerate(zip(rough, windows, strict=True))}
    numbers = [number for number, one in found.items() if one is not None]
    if len(numbers) < LEAST_CIRCLES:
        return f"only {len(numbers)} circles could be measured, {LEAST_CIRCLES} needed; are they too faint or too small?"
    centres, areas, sigmas = zip(*(one for one in found.values() if one is not None), strict=True)
    return CirclesSeen(np.array(numbers), np.array(centres), np.array(areas), np.array(sigmas))


def _one_centred(picture: Grey, at: Vector, window: Matrix) -> tuple[Vector, float, float] | None:
    """Centre (2,), area and sigma of one dark circle; None where there is none."""
    reach, inverse, rim = np.linalg.norm(window, axis=1), np.linalg.inv(window), _RIM
    for _ in range(_ROUNDS):
        first, last = np.ceil(at - reach).astype(int), np.floor(at + reach).astype(int)
        if (first < 0).any() or (last >= picture.shape[::-1]).any():
            return None
        places = np.stack(np.meshgrid(*map(np.arange, first, last + 1)), axis=-1).reshape(-1, 2)
        away = np.linalg.norm((places - at) @ inverse.T, axis=1)
        places, away = places[away <= 1], away[away <= 1]
        found = _darkness(picture[places[:, 1], places[:, 0]].astype(float), places - at, away, rim)
        if found is None:
            return None
        shift, area, sigma = found
        at = at + shift
        radius = float(np.sqrt(area / np.pi / abs(np.linalg.det(window))))  # of the window's
        rim = min(_RIM, radius + _BLUR_PX / float(np.linalg.svd(window, compute_uv=False)[1]))
        if np.linalg.norm(shift) < _STILL_PX:
            break
    return at, area, sigma


def _darkness(levels: Vector, places: Matrix, away: Vector, rim: float) -> tuple[Vector, float, float] | None:
    """Where the centre of a window's darkness is from the window's, (2,), how much there is of it, and sigma by one grey level of noise.

    White is the plane through what is farther from the middle than the rim, whose noise is in the sigma.
    """
    around, core = away > rim, away < _CORE
    if around.sum() < _LEAST_PIXELS or not core.any():
        return None
    design = np.column_stack([np.ones(len(places)), places])
    to_plane = np.linalg.pinv(design[around])  # (3, pixels of the rim)
    below = design @ (to_plane @ levels[around]) - levels
    contrast, total = float(np.median(below[core])), float(below.sum())
    if contrast < _LEAST_CONTRAST or total <= 0:
        return None
    weights = -places.T.astype(float)
    weights[:, around] += (places.T @ design) @ to_plane
    return below @ places / total, total / contrast, float(np.sqrt((weights**2).sum() / 2) / total)


def parse_circles(text: str, option: str) -> CircleGrid:
    """`4x11:20mm` or `4x11:20mm:14mm`.

    Raises:
        UsageError: the text is no board.
    """
    match = _WORD.fullmatch(text.strip())
    if not match:
        raise UsageError(f"{option}{text}: expected COLUMNSxROWS:STEP[:DIAMETER] such as circles:4x11:20mm:14mm")
    columns, rows, step, unit, diameter, diameter_unit = match.groups()
    require_counts(option, text, int(columns), int(rows), 2)
    length = length_of(option, text, step, unit)
    across = _USUAL_DIAMETER * length if diameter is None else length_of(option, text, diameter, diameter_unit)
    if across > _WIDEST * length:
        raise UsageError(f"{option}{text}: circles of {across * 1e3:g} mm nearly touch; expected at most {_WIDEST * length * 1e3:g} mm")
    return CircleGrid(int(columns), int(rows), length, across)
