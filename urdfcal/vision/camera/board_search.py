"""Boards in a picture: their corners by number, each with its sigma, held against the one pose that a flat board has before the camera.

OpenCV's detectors find the corners; those of chessboards and ChArUco boards are found once more, to a fraction of a pixel, in a window that
neither the next corner nor a marker reaches into. A corner's sigma comes from its neighbourhood (`corner_noise.py`), times what the board's
own corners say of it,

    s^2 = (sum_i |r_i|^2 / sigma_i^2 + PRIOR) / (2 n - 6 + PRIOR)

with r the residual of its pose. A corner whose |r_i|^2 / (s sigma_i)^2 is beyond chance among n is none, the worst first, s by the median
of the others: an id that was misread, an edge of a hand. Where it goes on beyond a quarter of them, the board is not the one stated.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
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
)
from urdfcal.vision.camera.corner_noise import corner_sigmas, picture_noise
from urdfcal.vision.camera.marker_search import find_markers
from urdfcal.vision.camera.markers import ScreenMarkers, aruco_dictionary
from urdfcal.vision.camera.plane_pose import T_SCREEN_SHEET, PlanePoints, fit_plane
from urdfcal.vision.camera.sought import Sought, TagGrid
from urdfcal.vision.pictures import Grey

PRIOR = 8.0  # so many numbers' worth of trust in what the neighbourhoods say
LEAST_CORNERS = {Chessboard: 9, CharucoBoard: LEAST_CHARUCO, TagGrid: 4}
_CHANCE = 1e-3  # that a corner of a good view is left out
_MOST_WRONG = 0.25
_WORST_RMS_PX = 2.0  # of corners that were found rightly, by a lens that is the camera's
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
    corners, pixels = found
    points = np.array([sought.grid.at(int(corner)) for corner in corners])
    least = LEAST_CORNERS[type(sought.board)]
    if len(corners) < least or np.linalg.matrix_rank(points[:, :2] - points[0, :2], tol=sought.grid.square / 2) < 2:
        return (
            f"no {sought.board} found" if not len(corners) else f"only {len(corners)} corners of the {sought.board} found, {least} needed"
        )
    windows = _windows(sought, points, pixels)
    if not isinstance(sought.board, TagGrid):
        pixels = settled_corners(picture, pixels, windows)
    sigmas = corner_sigmas(picture, pixels, windows, noise)
    return _held(camera, sought, (corners, points, pixels, sigmas))


def _corners(picture: Grey, camera: Camera, sought: Sought) -> tuple[Numbers, Matrix] | str:
    """Numbers and pixels of a board's corners."""
    board = sought.board
    if isinstance(board, Chessboard):
        view = board.find(picture, "")
        if isinstance(view, str):
            return view
        return np.arange(len(view.pixels)), first_corner_first(picture, board, view.pixels)
    if isinstance(board, CharucoBoard):
        return board.numbered(picture, sought.first)
    return _tag_corners(picture, camera, sought, board)


def _tag_corners(picture: Grey, camera: Camera, sought: Sought, board: TagGrid) -> tuple[Numbers, Matrix]:
    seen = find_markers(picture, ScreenMarkers(board.dictionary, board.side, {}), camera)
    ids = [marker.id for marker in seen]
    own = [marker for marker in seen if marker.id in sought.ids and ids.count(marker.id) == 1]
    numbers = [corner for marker in own for corner in board.corners_of(marker.id - sought.first)]
    pixels = np.concatenate([marker.pixels for marker in own]) if own else np.empty((0, 2))
    return np.array(numbers, dtype=np.intp), pixels


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
    return isinstance(board, Chessboard) and (board.columns + board.rows) % 2 == 0


def _windows(sought: Sought, points: Matrix, pixels: Matrix) -> Vector:
    """Half the side of each corner's window, (n,), [px]: as far as nothing but its own edges reaches, seen as obliquely as it is."""
    homography, _ = cv2.findHomography(points[:, :2], pixels, cv2.RANSAC, 10.0)
    if homography is None:
        return np.full(len(points), LEAST_WINDOW_PX)
    weight = points[:, :2] @ homography[2, :2] + homography[2, 2]
    slopes = (homography[None, :2, :2] - pixels[:, :, None] * homography[None, 2:, :2]) / weight[:, None, None]
    scale = np.linalg.svd(slopes, compute_uv=False)[:, 1]
    return np.asarray(np.clip(np.nan_to_num(_free(sought) * scale), LEAST_WINDOW_PX, MOST_WINDOW_PX).astype(int))


def _free(sought: Sought) -> float:
    """How far from a corner nothing but its own edges is, [m]."""
    board = sought.board
    if isinstance(board, TagGrid):
        return _INSIDE * min(board.side / (int(aruco_dictionary(board.dictionary).markerSize) + 2), board.gap)
    beside = (board.square - board.marker) / 2 if isinstance(board, CharucoBoard) else board.square
    return min(_REACH * board.square, _INSIDE * beside)


def _held(camera: Camera, sought: Sought, seen: tuple[Numbers, Matrix, Matrix, Vector]) -> BoardSeen | str:
    """The corners that one pose explains, with sigmas that its residual agrees with."""
    corners, points, pixels, sigmas = seen
    least, kept = LEAST_CORNERS[type(sought.board)], np.ones(len(corners), dtype=bool)
    gate = quantile(1 - _CHANCE / len(corners), 2)
    while True:
        sheet = points[kept] @ T_SCREEN_SHEET.rotation.T
        fit = fit_plane(camera, PlanePoints(sheet, pixels[kept], np.zeros(len(sheet), dtype=np.intp)))
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
    factor = np.sqrt((squared.sum() + PRIOR) / (2 * len(squared) - 6 + PRIOR))
    wrong = tuple(int(corner) for corner in corners[~kept])
    return BoardSeen(corners[kept], pixels[kept], factor * sigmas[kept], fit.rms, wrong)
