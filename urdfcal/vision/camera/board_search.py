"""Boards in a picture: their corners by number, each with its sigma, held against the one pose that a flat board has before the camera.

OpenCV's detectors find the corners; those of chessboards and ChArUco boards are found once more, to a fraction of a pixel, in a window that
neither the next corner nor a marker reaches into. A corner's sigma comes from its neighbourhood (`corner_noise.py`), times what the board's
own corners say of it,

    s^2 = (sum_i |r_i|^2 / sigma_i^2 + PRIOR) / f      f = 2 n - 6 + PRIOR

with r the residual of its pose, times 1 + (1.96^2 + 1) / 4 f: Student's t with f degrees of freedom has its 95 % interval there. A corner
whose |r_i|^2 / (s sigma_i)^2 is beyond chance among n is none, the worst first, s by the median of the others: an id that was misread, an
edge of a hand. Where it goes on beyond a quarter of them, the board is not the one stated. Edges of tags and circles know their own sigmas.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from urdfcal.base.geometry import Array3, Matrix, Vector
from urdfcal.estimation.chi_squared import median, quantile
from urdfcal.sensors.camera import Camera
from urdfcal.vision.camera.boards import (
    LEAST_CHARUCO,
    LEAST_WINDOW_PX,
    MOST_WINDOW_PX,
    CharucoBoard,
    Chessboard,
    Numbers,
    settled_corners,
    shades,
    slopes_of,
)
from urdfcal.vision.camera.circles import LEAST_CIRCLES, CircleGrid, shift_of
from urdfcal.vision.camera.corner_noise import MOST_SIGMA_PX, corner_sigmas, picture_noise
from urdfcal.vision.camera.marker_search import find_markers
from urdfcal.vision.camera.markers import ScreenMarkers, aruco_dictionary
from urdfcal.vision.camera.plane_pose import T_SCREEN_SHEET, PlaneFit, PlanePoints, fit_plane
from urdfcal.vision.camera.sought import Sought, TagGrid
from urdfcal.vision.pictures import Grey

PRIOR, PRIOR_FITTED = 8.0, 24.0  # so many numbers' worth of trust in what neighbourhoods, and edges of tags, say
LEAST_CORNERS = {Chessboard: 9, CharucoBoard: LEAST_CHARUCO, TagGrid: 4, CircleGrid: LEAST_CIRCLES}
_ROUNDS = 2  # from poses to circles' centres
_WITHIN = 1.96  # sigmas that hold 95 %
_CHANCE = 1e-3  # that a corner of a good view is left out
_MOST_WRONG = 0.25
_WORST_RMS_PX = 2.0  # of corners that were found rightly, by a lens that is the camera's
_FITTED_PX = 0.005  # what edges of tags and centres of circles are off without any noise
_REACH = 0.3  # of the way to the next corner
_INSIDE = 0.9  # of the white or black that a corner has around it


@dataclass(frozen=True, eq=False)
class BoardSeen:
    """A board in a picture.

    Attributes:
        corners: Their numbers on the board, (n,).
        pixels: Where they are, (n, 2).
        sigmas: Standard deviation of a coordinate of each, (n,), [px].
        rms: RMS distance from the board's pose, [px].
        wrong: Numbers of corners that were left out.
    """

    corners: Numbers
    pixels: Matrix
    sigmas: Vector
    rms: float
    wrong: tuple[int, ...] = ()


def find_boards(picture: Grey, camera: Camera, boards: Sequence[Sought]) -> list[BoardSeen | str]:
    """Each board as it is seen in a picture, or why it is not."""
    noise = picture_noise(picture)
    return [_find(picture, camera, sought, noise) for sought in boards]


def _find(picture: Grey, camera: Camera, sought: Sought, noise: float) -> BoardSeen | str:
    seen = _seen(picture, camera, sought, noise)
    other = _turned(sought)
    if isinstance(seen, str) and other is not None and isinstance(_seen(picture, camera, other, noise), BoardSeen):
        columns, rows = other.board.columns, other.board.rows
        return f"shows {columns} x {rows} squares where {rows} x {columns} are stated: its sides are swapped in --board"
    return seen


def _turned(sought: Sought) -> Sought | None:
    """The same ChArUco board with its sides swapped; None of others, which look as they are stated."""
    board = sought.board
    if not isinstance(board, CharucoBoard) or board.columns == board.rows:
        return None
    return replace(sought, board=replace(board, columns=board.rows, rows=board.columns))


def _seen(picture: Grey, camera: Camera, sought: Sought, noise: float) -> BoardSeen | str:
    found = _corners(picture, camera, sought)
    if isinstance(found, str):
        return found
    points = np.array([sought.grid.at(int(corner)) for corner in found.corners])
    least, count = LEAST_CORNERS[type(sought.board)], len(found.corners)
    if count < least or np.linalg.matrix_rank(points[:, :2] - points[0, :2], tol=sought.grid.square / 2) < 2:
        return f"no {sought.board} found" if not count else f"only {count} corners of the {sought.board} found, {least} needed"
    found = _with_sigmas(picture, sought, points, found, noise)
    if found.areas is not None:
        found = replace(found, pixels=_middles(camera, points, found.pixels, found.areas))
    return _held(camera, sought, (found.corners, points, found.pixels, found.sigmas))


@dataclass(frozen=True, eq=False)
class _Found:
    """What a detector says of a board: numbers (n,) and pixels (n, 2) of its corners, and what more it knows.

    Attributes:
        sigmas: (n,), [px], by one grey level of noise; nan where the detector does not know.
        areas: Of circles, (n,), [px^2].
    """

    corners: Numbers
    pixels: Matrix
    sigmas: Vector
    areas: Vector | None = None


def _corners(picture: Grey, camera: Camera, sought: Sought) -> _Found | str:
    board = sought.board
    if isinstance(board, TagGrid):
        return _tag_corners(picture, camera, sought, board)
    if isinstance(board, CircleGrid):
        seen = board.seen(picture)
        return seen if isinstance(seen, str) else _Found(seen.numbers, seen.pixels, seen.sigmas, seen.areas)
    if isinstance(board, CharucoBoard):
        corners, pixels = board.numbered(picture, sought.first)
    else:
        view = board.find(picture, "")
        if isinstance(view, str):
            return view
        corners, pixels = np.arange(len(view.pixels)), first_corner_first(picture, board, view.pixels)
    return _Found(corners, pixels, np.full(len(corners), np.nan))


def _tag_corners(picture: Grey, camera: Camera, sought: Sought, board: TagGrid) -> _Found:
    seen = find_markers(picture, ScreenMarkers(board.dictionary, board.side, {}), camera)
    ids = [marker.id for marker in seen]
    own = [marker for marker in seen if marker.id in sought.ids and ids.count(marker.id) == 1]
    numbers = [corner for marker in own for corner in board.corners_of(marker.id - sought.first)]
    pixels = np.concatenate([np.empty((0, 2)), *(marker.pixels for marker in own)])
    return _Found(np.array(numbers, dtype=np.intp), pixels, np.concatenate([np.empty(0), *(marker.sigmas for marker in own)]))


def _with_sigmas(picture: Grey, sought: Sought, points: Matrix, found: _Found, noise: float) -> _Found:
    """The same with the sigmas that a picture's noise leads to; those that the detector does not know from each corner's neighbourhood."""
    sigmas = np.clip(np.hypot(noise * found.sigmas, _FITTED_PX), _FITTED_PX, MOST_SIGMA_PX)
    unknown = np.isnan(sigmas)
    if not unknown.any():
        return replace(found, sigmas=sigmas)
    windows, pixels = _windows(sought, points, found.pixels)[unknown], found.pixels.copy()
    if not isinstance(sought.board, TagGrid):
        pixels[unknown] = settled_corners(picture, pixels[unknown], windows)
    sigmas[unknown] = corner_sigmas(picture, pixels[unknown], windows, noise)
    return replace(found, pixels=pixels, sigmas=sigmas)


def _middles(camera: Camera, points: Matrix, seen: Matrix, areas: Vector) -> Matrix:
    """Where the centres of circles are seen, (n, 2), from the centres of what is seen of them."""
    pixels = seen
    for _ in range(_ROUNDS):
        fit = _plane(camera, points, pixels)
        if fit is None:
            break
        pixels = seen - shift_of(camera, fit.T_camera_plane * T_SCREEN_SHEET, points, areas)
    return pixels


def _plane(camera: Camera, points: Matrix, pixels: Matrix) -> PlaneFit | None:
    """The pose of a board, whose x runs along its columns and y down its rows."""
    sheet = points @ T_SCREEN_SHEET.rotation.T
    return fit_plane(camera, PlanePoints(sheet, pixels, np.zeros(len(sheet), dtype=np.intp)))


def first_corner_first(picture: Grey, board: Chessboard, pixels: Matrix) -> Matrix:
    """A chessboard's corners (n, 2) row by row from the one whose outermost square is dark, columns to the right of the rows.

    A board whose numbers of inner corners are both even or both odd looks the same turned round; it is taken as it stands upright.
    """
    grid = pixels.reshape(board.rows, board.columns, 2)
    across, down = (grid[:, -1] - grid[:, 0]).mean(axis=0), (grid[-1] - grid[0]).mean(axis=0)
    if across[0] * down[1] - across[1] * down[0] < 0:
        grid = grid[:, ::-1]
    ways = [np.rot90(grid, quarter) for quarter in ((0, 1, 2, 3) if board.columns == board.rows else (0, 2))]
    best = max(ways, key=lambda way: (_first_is_dark(picture, way), _uprightness(way)))
    return np.asarray(best.reshape(-1, 2))


def _first_is_dark(picture: Grey, grid: Array3) -> bool:
    """Whether the square inside of the first corner is darker than its neighbours: it has the colour of the outermost one."""
    cells = (grid[:-1, :-1] + grid[1:, :-1] + grid[:-1, 1:] + grid[1:, 1:]) / 4
    levels, even = shades(picture, cells)
    return bool(np.median(levels[even]) < np.median(levels[~even]))


def _uprightness(grid: Array3) -> float:
    """How far its rows go to the right and its columns down, [px]."""
    return float((grid[:, -1] - grid[:, 0]).mean(axis=0)[0] + (grid[-1] - grid[0]).mean(axis=0)[1])


def looks_the_same_turned(board: object) -> bool:
    """Whether nothing tells a board from itself, turned round by half a turn or a quarter."""
    if isinstance(board, CircleGrid):
        return board.rows % 2 == 0
    return isinstance(board, Chessboard) and (board.columns + board.rows) % 2 == 0


def _windows(sought: Sought, points: Matrix, pixels: Matrix) -> Vector:
    """Half the side of each corner's window, (n,), [px]: as far as nothing but its own edges reaches, seen as obliquely as it is."""
    slopes = slopes_of(points, pixels)
    if slopes is None:
        return np.full(len(points), LEAST_WINDOW_PX)
    scale = np.linalg.svd(slopes, compute_uv=False)[:, 1]
    return np.asarray(np.clip(np.nan_to_num(_free(sought) * scale), LEAST_WINDOW_PX, MOST_WINDOW_PX).astype(int))


def _free(sought: Sought) -> float:
    """How far from a corner nothing but its own edges is, [m]."""
    board = sought.board
    if isinstance(board, TagGrid):
        return _INSIDE * min(board.side / (int(aruco_dictionary(board.dictionary).markerSize) + 2), board.gap)
    if isinstance(board, CircleGrid):
        return _REACH * board.step
    beside = (board.square - board.marker) / 2 if isinstance(board, CharucoBoard) else board.square
    return min(_REACH * board.square, _INSIDE * beside)


def _held(camera: Camera, sought: Sought, seen: tuple[Numbers, Matrix, Matrix, Vector]) -> BoardSeen | str:
    """The corners that one pose explains, with sigmas that its residual agrees with."""
    corners, points, pixels, sigmas = seen
    least, kept = LEAST_CORNERS[type(sought.board)], np.ones(len(corners), dtype=bool)
    gate = quantile(1 - _CHANCE / len(corners), 2)
    while True:
        fit = _plane(camera, points[kept], pixels[kept])
        if fit is None:
            return f"the corners of the {sought.board} fit no pose before this camera; is the lens the right one?"
        squared = (fit.residual**2).sum(axis=1) / sigmas[kept] ** 2
        usual = max(1.0, float(np.median(squared)) / median(2))
        worst = int(squared.argmax())
        if squared[worst] <= gate * usual or kept.sum() <= least:
            break
        kept[np.flatnonzero(kept)[worst]] = False
    if fit.rms > _WORST_RMS_PX or (~kept).sum() > _MOST_WRONG * len(kept):
        left_out = int((~kept).sum())
        return f"the corners of the {sought.board} are {fit.rms:.1f} px off a flat board, {left_out} left out; are sizes and lens right?"
    prior = PRIOR_FITTED if isinstance(sought.board, TagGrid) else PRIOR
    freedom = 2 * len(squared) - 6 + prior
    factor = np.sqrt((squared.sum() + prior) / freedom) * (1 + (_WITHIN**2 + 1) / (4 * freedom))
    wrong = tuple(int(corner) for corner in corners[~kept])
    return BoardSeen(corners[kept], pixels[kept], factor * sigmas[kept], fit.rms, wrong)
