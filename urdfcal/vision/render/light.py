"""What a camera has in front of it, as linear light on its pixels: screen, markers, spots, lamps. Everything here is simulated.

Light is linear, 1 is the sensor's full scale, colours are red, green, blue. Edges and spots are sampled several times a pixel along
each side, through the lens, and averaged: a pixel integrates what falls on it.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np
import numpy.typing as npt

from urdfcal.base.geometry import Array3, Matrix, Vector
from urdfcal.robot.sheet import ScreenArea
from urdfcal.sensors.camera import Camera
from urdfcal.vision.camera.markers import ScreenMarkers
from urdfcal.vision.render.image_sensor import strips

TINTS = {"red": (1.0, 0.10, 0.07), "green": (0.16, 1.0, 0.22), "blue": (0.06, 0.18, 1.0)}
Light = npt.NDArray[np.float32]
_WALL, _INK = 0.3, 0.06  # light of what is beside the screen and of black ink, of the screen's
_GLOW = 12  # radii of the glow that are drawn
_FINE = 5  # samples along a side of a pixel
_BLURRED = 6  # standard widths of the blur beyond which OpenCV carries nothing


@dataclass(frozen=True)
class Lighting:
    """Room light on the screen.

    Attributes:
        level: Of the screen's middle, of full scale.
        gradient: By how much it changes from the middle to the edge, of the level, along `angle`.
        angle: Direction of the gradient in the screen, from +y toward +z, [rad].
        vignetting: Loss in the picture's corners, of the light.
        screen: The part of its plane that is there.
    """

    level: float = 0.25
    gradient: float = 0.3
    angle: float = 0.6
    vignetting: float = 0.2
    screen: ScreenArea = field(default_factory=ScreenArea)


@dataclass(frozen=True)
class Beam:
    """How a laser beam looks.

    Attributes:
        colour: red, green or blue.
        width: Standard width of its cross-section, [m]; a quarter of the diameter at 1 / e^2.
        brightness: Peak on the screen where the beam meets it squarely, before lens and pixel blur it, of full scale.
        halo: Height of the glow around it, of the brightness.
        halo_px: Radius of the glow, [px].
        blur_px: Standard width of the lens's own blur, [px].
    """

    colour: str = "red"
    width: float = 1e-3
    brightness: float = 0.8
    halo: float = 0.0
    halo_px: float = 4.0
    blur_px: float = 0.7


def backdrop(camera: Camera, lighting: Lighting, markers: ScreenMarkers | None = None) -> Light:
    """The screen without lasers, (h, w, 3)."""
    width, height = camera.size
    light = np.empty((height, width), np.float32)
    for strip in strips(height):
        light[strip] = _unprinted(camera, lighting, strip)
    if markers is not None:
        for marker in markers.centres:
            _print_marker(light, camera, markers, marker)
    return np.repeat(light[..., None], 3, axis=2)


def _unprinted(camera: Camera, lighting: Lighting, strip: slice) -> Matrix:
    """Some rows of the screen without markers."""
    width, height = camera.size
    columns, rows = np.meshgrid(np.arange(width, dtype=float), np.arange(strip.start, strip.stop, dtype=float))
    spots = camera.spots_of_grid(columns[0], rows[:, 0])
    half = float(np.max(lighting.screen.size)) / 2
    along = (spots - lighting.screen.centre) @ np.array([np.cos(lighting.angle), np.sin(lighting.angle)]) / half
    light = lighting.level * np.clip(1 + lighting.gradient * np.nan_to_num(along), 0.1, None)
    on_sheet = lighting.screen.holds(np.nan_to_num(spots, nan=np.inf))
    light = np.where(on_sheet, light, _WALL * lighting.level)
    corner = np.hypot(columns - width / 2, rows - height / 2) / np.hypot(width / 2, height / 2)
    return np.asarray(light * (1 - lighting.vignetting * corner**2))


def _print_marker(light: Light, camera: Camera, markers: ScreenMarkers, marker: int) -> None:
    corners = camera.pixels_of_spots(markers.corners_of(marker)[:, 1:])
    if not np.isfinite(corners).all():
        return
    box = _box(corners.min(axis=0) - 2, corners.max(axis=0) + 2, camera.size)
    if box is None:
        return
    rows, columns = box
    spots = _fine_spots(camera, rows, columns)
    cells = markers.cells_of(marker)
    steps = len(cells) / markers.size
    y, z = markers.centres[marker]
    column = np.floor((y + markers.size / 2 - spots[..., 0]) * steps).astype(int)
    row = np.floor((z + markers.size / 2 - spots[..., 1]) * steps).astype(int)
    inside = (column >= 0) & (column < len(cells)) & (row >= 0) & (row < len(cells))
    ink = inside & ~cells[np.clip(row, 0, len(cells) - 1), np.clip(column, 0, len(cells) - 1)]
    light[rows, columns] *= _averaged(np.where(ink, _INK, 1.0))


def spot_light(camera: Camera, spot: Vector, direction: Vector, beam: Beam) -> tuple[Array3, slice, slice] | None:
    """The light of one laser spot and the part of the picture that it falls on.

    Args:
        camera: The camera.
        spot: (y, z) where the beam meets the screen, [m].
        direction: Unit vector of the beam in screen axes, (3,).
        beam: How the beam looks.

    Returns:
        Light (h, w, 3), rows and columns; None where no part of it is in the picture.
    """
    centre = camera.pixels_of_spots(spot[None])[0]
    if not np.isfinite(centre).all():
        return None
    metres = float(np.sqrt(abs(np.linalg.det(camera.spot_jacobian(centre[None])[0]))))
    core = 5.5 * beam.width / metres / max(abs(direction[0]), 0.2) + 5 * beam.blur_px + 2
    box = _box(centre - core - beam.halo_px * _GLOW, centre + core + beam.halo_px * _GLOW, camera.size)
    if box is None:
        return None
    rows, columns = box
    u, v = np.meshgrid(np.arange(columns.start, columns.stop), np.arange(rows.start, rows.stop))
    shown = beam.halo * (1 + ((u - centre[0]) ** 2 + (v - centre[1]) ** 2) / beam.halo_px**2) ** -1.5
    _add_core(shown, camera, spot, direction, beam, (rows, columns), _box(centre - core, centre + core, camera.size))
    return beam.brightness * shown[..., None] * np.array(TINTS[beam.colour]), rows, columns


def _add_core(
    shown: Matrix, camera: Camera, spot: Vector, direction: Vector, beam: Beam, box: tuple[slice, slice], core: tuple[slice, slice] | None
) -> None:
    """Add the beam's Gaussian, cut by the screen, seen through the lens and blurred by it, to the glow in a box."""
    if core is None:
        return
    rows, columns = core
    margin = int(np.ceil(_BLURRED * beam.blur_px))  # how far the blur carries light
    left = columns.start - box[1].start
    for strip in strips(rows.stop - rows.start):
        own = slice(rows.start + strip.start, rows.start + strip.stop)
        seen = slice(max(own.start - margin, rows.start), min(own.stop + margin, rows.stop))
        light = _core(camera, spot, direction, beam, (seen, columns))[own.start - seen.start :][: own.stop - own.start]
        shown[own.start - box[0].start : own.stop - box[0].start, left : left + light.shape[1]] += light


def _core(camera: Camera, spot: Vector, direction: Vector, beam: Beam, box: tuple[slice, slice]) -> Matrix:
    """The beam's Gaussian on the pixels of a box, blurred."""
    away = np.nan_to_num(_fine_spots(camera, *box) - spot, nan=1e3)
    squared = (away**2).sum(axis=-1) - (away @ direction[1:]) ** 2  # squared distance from the beam's axis
    fine = abs(direction[0]) * np.exp(-squared / (2 * beam.width**2))
    return _averaged(cv2.GaussianBlur(fine, (0, 0), beam.blur_px * _FINE, borderType=cv2.BORDER_REPLICATE))


def glare(size: tuple[int, int], count: int, rng: np.random.Generator) -> Light:
    """Lamps, glints, streaks and weak coloured reflections inside the lens, (h, w, 3)."""
    light = np.zeros((size[1], size[0], 3), np.float32)
    kinds = {"lamp": (_lamp, 300), "glint": (_glint, 40), "streak": (_streak, 300), "ghost": (_ghost, 70)}
    for _ in range(count):
        profile_of, reach = kinds[str(rng.choice(list(kinds)))]
        centre, angle = rng.uniform(0, size), rng.uniform(0, np.pi)
        box = _box(centre - reach, centre + reach, size)
        if box is not None:
            u, v = np.meshgrid(np.arange(box[1].start, box[1].stop) - centre[0], np.arange(box[0].start, box[0].stop) - centre[1])
            profile, tint = profile_of(u * np.cos(angle) + v * np.sin(angle), v * np.cos(angle) - u * np.sin(angle), rng)
            light[box] += profile[..., None] * tint
    return light


def _white(rng: np.random.Generator) -> Vector:
    """From the warm light of a filament to that of the sky."""
    warmth = rng.uniform(-0.3, 1.0)
    return np.array([1.0, 1 - 0.35 * max(warmth, 0.0), 1 - 0.65 * max(warmth, 0.0)]) * (1.0, 1 + 0.1 * min(warmth, 0), 1.0)


def _lamp(along: Matrix, across: Matrix, rng: np.random.Generator) -> tuple[Matrix, Vector]:
    radius, flat = rng.uniform(6, 60), rng.uniform(0.4, 1.0)
    far = np.hypot(along, across / flat)
    disc = _disc(far - radius, 0.7)
    return rng.uniform(1.5, 8) * (disc + 0.04 * (1 + (far / radius) ** 2) ** -1.5), _white(rng)


def _glint(along: Matrix, across: Matrix, rng: np.random.Generator) -> tuple[Matrix, Vector]:
    width, flat = rng.uniform(0.8, 3.0), rng.uniform(0.5, 1.0)
    squared = (along / width) ** 2 + (across / (flat * width)) ** 2
    return rng.uniform(0.3, 6) * (np.exp(-squared / 2) + 0.03 * (1 + squared / 12) ** -1.5), _white(rng)


def _streak(along: Matrix, across: Matrix, rng: np.random.Generator) -> tuple[Matrix, Vector]:
    return rng.uniform(0.2, 2) * np.exp(-((along / rng.uniform(20, 120)) ** 2 + (across / rng.uniform(1, 4)) ** 2) / 2), _white(rng)


def _ghost(along: Matrix, across: Matrix, rng: np.random.Generator) -> tuple[Matrix, Vector]:
    disc = _disc(np.hypot(along, across) - rng.uniform(12, 45), rng.uniform(1, 4))
    return rng.uniform(0.02, 0.1) * disc, np.array(TINTS[str(rng.choice(["red", "green", "blue"]))]) * 0.7 + 0.3


def _disc(outside: Matrix, softness: float) -> Matrix:
    """One inside, zero outside, with a soft rim."""
    return np.asarray(1 / (1 + np.exp(np.clip(outside / softness, -50, 50))))


def _box(low: Vector, high: Vector, size: tuple[int, int]) -> tuple[slice, slice] | None:
    left, top = np.maximum(np.floor(low), 0).astype(int)
    right, bottom = np.minimum(np.ceil(high) + 1, size).astype(int)
    return (slice(top, bottom), slice(left, right)) if right > left and bottom > top else None


def _fine_spots(camera: Camera, rows: slice, columns: slice) -> Array3:
    """(y, z) on the screen of the samples of some pixels, (h * fine, w * fine, 2), [m]."""
    inside = (np.arange(_FINE) + 0.5) / _FINE - 0.5
    u = (np.arange(columns.start, columns.stop)[:, None] + inside).ravel()
    v = (np.arange(rows.start, rows.stop)[:, None] + inside).ravel()
    return camera.spots_of_grid(u, v)


def _averaged(fine: Matrix) -> Matrix:
    """Samples averaged over their pixels."""
    height, width = fine.shape
    return np.asarray(fine.reshape(height // _FINE, _FINE, width // _FINE, _FINE).mean(axis=(1, 3)))
