"""Pictures of flat boards before a camera: each pixel's light is the mean of what its rays meet on the board."""

from __future__ import annotations

from functools import cache

import cv2
import numpy as np
import pinocchio as pin

from urdfcal.sensors.camera import Camera
from urdfcal.vision.camera.boards import CharucoBoard, Chessboard
from urdfcal.vision.camera.circles import CircleGrid
from urdfcal.vision.camera.markers import aruco_dictionary
from urdfcal.vision.camera.sought import Sought, TagGrid

TEXEL = 0.125e-3  # of which every board here has whole numbers in its squares and in its markers' cells
BLACK, WHITE, GREY = 25.0, 225.0, 120.0


def board_camera(size: tuple[int, int] = (640, 480), focal: float = 620.0) -> Camera:
    """A camera with a lens that bends."""
    matrix = np.array([[focal, 0, size[0] / 2 + 4], [0, focal + 1, size[1] / 2 - 3], [0, 0, 1]])
    return Camera(size, matrix, np.array([-0.12, 0.03, 5e-4, -4e-4, 0.0]))


def facing(sought: Sought, distance: float, tilt: float, about: float, roll: float = 0.0, beside: tuple[float, float] = (0, 0)) -> pin.SE3:
    """T_camera_board of a board whose middle lies ahead, tilted by so many degrees about an axis in the picture."""
    points = np.array([sought.grid.at(corner) for corner in range(sought.grid.corners)])
    axis = np.array([np.cos(np.radians(about)), np.sin(np.radians(about)), 0.0])
    R = pin.exp3(np.radians(tilt) * axis) @ pin.exp3(np.radians([0, 0, roll]))
    return pin.SE3(R, np.array([*beside, distance]) - R @ points.mean(axis=0))


def rendered(
    camera: Camera, shown: list[tuple[Sought, pin.SE3]], rng: np.random.Generator, *, noise: float = 2.0, blur: float = 0.0, rays: int = 4
) -> np.ndarray:
    """8-bit picture of boards at T_camera_board, blurred by a Gaussian [px]."""
    width, height = camera.size
    total = np.zeros(width * height)
    offsets = (np.arange(rays) + 0.5) / rays - 0.5
    middle, by_u, by_v = _rays(camera)
    for du in offsets:
        for dv in offsets:
            level = np.full(width * height, GREY)
            for sought, T in shown:
                direction, origin = (middle + du * by_u + dv * by_v) @ T.rotation, -T.rotation.T @ T.translation
                far = -origin[2] / direction[:, 2]
                texture, corner = _texture(sought)
                column, row = (np.floor((origin[axis] + far * direction[:, axis] - corner) / TEXEL).astype(int) for axis in (0, 1))
                there = np.flatnonzero((far > 0) & (column >= 0) & (row >= 0) & (column < texture.shape[1]) & (row < texture.shape[0]))
                seen = texture[row[there], column[there]]
                level[there] = np.where(np.isnan(seen), level[there], seen)
            total += level
    total = total.reshape(height, width)
    light = total / rays**2
    light = cv2.GaussianBlur(light, (0, 0), blur) if blur else light
    return np.clip(np.rint(light + rng.normal(0, noise, light.shape)), 0, 255).astype(np.uint8)


@cache
def _rays(camera: Camera) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rays through the middles of all pixels, (n, 3), and their derivatives by u and v; within a pixel they are straight to 1e-7."""
    width, height = camera.size
    u, v = np.meshgrid(np.arange(width), np.arange(height))
    rays = camera.rays(np.column_stack([u.ravel(), v.ravel()])).reshape(height, width, 3)
    rays = rays / rays[..., 2:]
    by_v, by_u = np.gradient(rays, axis=(0, 1))
    return rays.reshape(-1, 3), by_u.reshape(-1, 3), by_v.reshape(-1, 3)


@cache
def _texture(sought: Sought) -> tuple[np.ndarray, float]:
    """Light of a board, nan where it has ended, and where its first texel begins along both axes, [m]."""
    grid, rim = sought.grid, 2 * sought.grid.square
    x, y = (np.arange(-rim, grid.at(grid.corners - 1)[axis] + rim, TEXEL) + TEXEL / 2 for axis in (0, 1))
    across, down = np.meshgrid(x, y)
    points = np.column_stack([across.ravel(), down.ravel()])
    return on_board(sought, points, np.full(len(points), np.nan)).reshape(across.shape).astype(np.float32), -rim


def on_board(sought: Sought, points: np.ndarray, beyond: np.ndarray) -> np.ndarray:
    """Light of points (n, 3) on a board's plane, in its axes; `beyond` where the board has ended."""
    board, x, y = sought.board, points[:, 0], points[:, 1]
    if isinstance(board, CircleGrid):
        return _circles(board, x, y, beyond)
    if isinstance(board, TagGrid):
        return _tags(sought, board, x, y, beyond)
    squares = (board.columns + 1, board.rows + 1) if isinstance(board, Chessboard) else (board.columns, board.rows)
    across, down = x / board.square + 1, y / board.square + 1
    column, row = np.floor(across).astype(int), np.floor(down).astype(int)
    inside = (column >= 0) & (row >= 0) & (column < squares[0]) & (row < squares[1])
    rim = (across > -0.7) & (down > -0.7) & (across < squares[0] + 0.7) & (down < squares[1] + 0.7)
    dark = (column + row) % 2 == 0
    level = np.where(inside & dark, BLACK, np.where(rim, WHITE, beyond))
    if isinstance(board, CharucoBoard):
        half = board.marker / board.square / 2
        white = np.flatnonzero(inside & ~dark)
        numbers = {place: i for i, place in enumerate((r, c) for r in range(board.rows) for c in range(board.columns) if (r + c) % 2)}
        ids = np.array([numbers[r, c] for r, c in zip(row[white], column[white], strict=True)], dtype=int) + sought.first
        own = np.column_stack([across - column - 0.5 + half, down - row - 0.5 + half])[white] / (2 * half)
        level[white] = _marker(board.dictionary, ids, own, level[white])
    return level


def _circles(board: CircleGrid, x: np.ndarray, y: np.ndarray, beyond: np.ndarray) -> np.ndarray:
    step, width, height = board.step, 2 * board.columns - 1, board.rows - 1
    row = np.rint(y / step).astype(int)
    column = np.rint((x / step - row % 2) / 2).astype(int)
    there = (row >= 0) & (row < board.rows) & (column >= 0) & (column < board.columns)
    dark = there & (np.hypot(x - (2 * column + row % 2) * step, y - row * step) < board.diameter / 2)
    inside = (x > -step) & (y > -step) & (x < (width + 1) * step) & (y < (height + 1) * step)
    return np.where(dark, BLACK, np.where(inside, WHITE, beyond))


def _tags(sought: Sought, board: TagGrid, x: np.ndarray, y: np.ndarray, beyond: np.ndarray) -> np.ndarray:
    pitch = board.side + board.gap
    column, row = np.floor(x / pitch).astype(int), np.floor(y / pitch).astype(int)
    far = np.maximum.reduce([-x, -y, x - board.columns * pitch + board.gap, y - board.rows * pitch + board.gap])
    level = np.where(far < max(board.gap, board.side / 5), WHITE, beyond)
    there = np.flatnonzero((column >= 0) & (row >= 0) & (column < board.columns) & (row < board.rows))
    own = np.column_stack([x - column * pitch, y - row * pitch])[there] / board.side
    level[there] = _marker(board.dictionary, sought.first + row[there] * board.columns + column[there], own, level[there])
    return level


def _marker(dictionary: str, ids: np.ndarray, places: np.ndarray, beyond: np.ndarray) -> np.ndarray:
    """Light at places (n, 2), 0 to 1 over the marker of each, (n,)."""
    of = aruco_dictionary(dictionary)
    cells, level = of.markerSize + 2, beyond.copy()
    inside = ((places >= 0) & (places < 1)).all(axis=1)
    for number in np.unique(ids[inside]):
        mine = np.flatnonzero(inside & (ids == number))
        image = cv2.aruco.generateImageMarker(of, int(number), cells)
        column, row = (places[mine] * cells).astype(int).T
        level[mine] = np.where(image[row, column] > 127, WHITE, BLACK)
    return level


def true_pixels(camera: Camera, sought: Sought, T: pin.SE3) -> np.ndarray:
    """Where all of a board's corners are in the picture, (corners, 2)."""
    points = np.array([sought.grid.at(corner) for corner in range(sought.grid.corners)])
    return camera.project(points @ T.rotation.T + T.translation)
