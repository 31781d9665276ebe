"""Simulated pictures for the tests of the camera: a screen with markers or a board, seen through a lens, with noise.

The picture is made backwards from what the calibration does: every part of every pixel is followed along its ray to the
screen, and the light there is averaged over the pixel.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pinocchio as pin
from scipy.interpolate import RectBivariateSpline

from urdfcal.base.geometry import Matrix, Vector
from urdfcal.sensors.camera import Camera, Side
from urdfcal.vision.camera.boards import Chessboard
from urdfcal.vision.camera.markers import ScreenMarkers

_COARSE = 16  # [px]
WHITE, BLACK, GREY = 225.0, 25.0, 150.0
Light = Callable[[Vector, Vector], Vector]
FRONT_VIEW = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])  # screen axes in a camera that looks along +x
BACK_VIEW = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [-1.0, 0.0, 0.0]])


def random_camera(
    rng: np.random.Generator, side: Side = "front", *, oblique_deg: float = 45.0, size: tuple[int, int] = (1280, 960)
) -> Camera:
    """A camera that sees about 2 m of the screen, up to so oblique, rolled a little, with barrel distortion."""
    focal = rng.uniform(0.9, 1.3) * size[0]
    matrix = np.array(
        [[focal, 0, size[0] / 2 + rng.normal(0, 8)], [0, focal * rng.uniform(0.995, 1.005), size[1] / 2 + rng.normal(0, 8)], [0, 0, 1.0]]
    )
    distortion = np.array([rng.uniform(-0.25, 0.0), rng.uniform(0, 0.08), *rng.normal(0, 5e-4, 2), 0.0])
    tilt, axis, roll = np.radians(rng.uniform(0, oblique_deg)), rng.uniform(0, 2 * np.pi), np.radians(rng.uniform(-15, 15))
    turn = pin.exp3(np.array([0, 0, roll])) @ pin.exp3(tilt * np.array([np.cos(axis), np.sin(axis), 0.0]))
    rotation = turn @ (FRONT_VIEW if side == "front" else BACK_VIEW)
    distance = 2.1 * focal / size[0]
    T_camera_screen = pin.SE3(rotation, np.array([*rng.normal(0, 0.05, 2), distance]))
    return Camera(size, matrix, distortion, "plain", T_camera_screen, side)


def picture(camera: Camera, light: Light, rng: np.random.Generator, *, noise: float = 2.0, rays: int = 3) -> np.ndarray:
    """What the camera sees of a screen with that light (a function of y and z), (h, w) in 8 bits; `rays` of them a pixel each way."""
    width, height = camera.size
    across, down = np.arange(-_COARSE, width + 2 * _COARSE, _COARSE), np.arange(-_COARSE, height + 2 * _COARSE, _COARSE)
    coarse = camera.spots_of_pixels(np.stack(np.meshgrid(across, down), axis=-1).reshape(-1, 2)).reshape(len(down), len(across), 2)
    spots = [RectBivariateSpline(down, across, coarse[..., axis]) for axis in (0, 1)]  # the way of the rays is smooth
    steps, total = (np.arange(rays) + 0.5) / rays - 0.5, np.zeros((height, width))
    for right in steps:
        for below in steps:
            y, z = (spline(np.arange(height) + below, np.arange(width) + right).ravel() for spline in spots)
            total += light(y, z).reshape(height, width)
    noisy = total / rays**2 + rng.normal(0, noise, total.shape)
    return np.clip(np.rint(noisy), 0, 255).astype(np.uint8)


def marker_light(markers: ScreenMarkers, moved: dict[int, Vector] | None = None, hidden: tuple[int, ...] = ()) -> Light:
    """A grey screen with white-rimmed markers; some moved by (y, z) [m], some not there."""

    def light(y: Vector, z: Vector) -> Vector:
        level = np.full(len(y), GREY)
        for marker in markers.centres:
            if marker in hidden:
                continue
            cells = markers.cells_of(marker)
            centre = np.array(markers.centres[marker]) + (moved or {}).get(marker, 0.0)
            near = np.flatnonzero((np.abs(y - centre[0]) < markers.size) & (np.abs(z - centre[1]) < markers.size))
            count = len(cells)
            column = (centre[0] - y[near]) / markers.size * count + count / 2  # to the right, seen from the front
            row = (centre[1] - z[near]) / markers.size * count + count / 2
            rim = (np.abs(column - count / 2) < count / 2 + 1) & (np.abs(row - count / 2) < count / 2 + 1)
            level[near[rim]] = WHITE
            inside = (column >= 0) & (column < count) & (row >= 0) & (row < count)
            level[near[inside]] = np.where(cells[row[inside].astype(int), column[inside].astype(int)], WHITE, BLACK)
        return level

    return light


def board_light(board: Chessboard, origin: Vector, rim: float = 1.0) -> Light:
    """A chessboard whose first inner corner (top left, seen from the front) lies at (y, z); `rim`: width of the outermost squares."""

    def light(y: Vector, z: Vector) -> Vector:
        across, down = (origin[0] - y) / board.square, (origin[1] - z) / board.square
        column, row = np.floor(across) + 1, np.floor(down) + 1
        beyond = np.maximum.reduce([-across, -down, across - board.columns + 1, down - board.rows + 1])
        inside, margin = beyond <= rim, beyond <= rim + 1
        return np.where(inside & ((column + row) % 2 == 0), BLACK, np.where(margin, WHITE, GREY))

    return light


def board_pictures(camera: Camera, board: Chessboard, count: int, rng: np.random.Generator, noise: float = 2.0) -> list[np.ndarray]:
    """The board held into different parts of the picture, tilted up to 35 deg."""
    made = []
    extent = board.square * np.array([board.columns - 1, board.rows - 1])
    focal, size = camera.matrix[0, 0], np.array(camera.size)
    for _ in range(count):
        tilt = pin.exp3(np.radians(35) * rng.uniform(-1, 1, 3) * [1, 1, 0.5])
        distance = focal * extent[0] / (size[0] * rng.uniform(0.35, 0.6))
        free = (size - 1.5 * extent * focal / distance).clip(0) / 2
        middle = np.array([*(rng.uniform(-1, 1, 2) * free / focal * distance), distance])
        rotation = tilt @ FRONT_VIEW
        origin = rotation @ np.array([0, -extent[0] / 2, -extent[1] / 2])  # from the first corner to the board's middle
        posed = replace(camera, T_camera_screen=pin.SE3(rotation, middle - origin))
        made.append(picture(posed, board_light(board, np.zeros(2)), rng, noise=noise))
    return made


def corners_in_picture(camera: Camera, markers: ScreenMarkers, marker: int) -> Matrix:
    """True pixels (4, 2) of a marker's corners."""
    return camera.pixels_of_spots(markers.corners_of(marker)[:, 1:])
