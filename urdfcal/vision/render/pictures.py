"""The pictures that a camera would have taken of a robot's laser spots, pose by pose. Everything here is simulated.

Light is in `light`, the sensor in `image_sensor`; the detector shares no code with them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np

from urdfcal.base.errors import UsageError
from urdfcal.base.geometry import Array3, Mask, Matrix, Vector
from urdfcal.base.tables import csv_text
from urdfcal.model.gauge import build_error_model
from urdfcal.robot.robot import Robot
from urdfcal.robot.sheet import ScreenArea
from urdfcal.sensors.camera import Camera
from urdfcal.sensors.spots import beams_at
from urdfcal.vision.camera.markers import ScreenMarkers
from urdfcal.vision.render.image_sensor import ImageSensor, Light, Pixels
from urdfcal.vision.render.light import Beam, Lighting, backdrop, glare, spot_light


@dataclass(frozen=True, eq=False)
class LitSpots:
    """Where beams light the screen.

    Attributes:
        spots: (n, lasers, 2), [m]; nan for a beam that makes no spot.
        direction: (n, lasers, 3), unit vectors in screen axes.
    """

    spots: Array3
    direction: Array3

    def within(self, area: ScreenArea) -> LitSpots:
        """Those that meet the screen where it is; the others make no spot."""
        return LitSpots(np.where(area.holds(self.spots)[..., None], self.spots, np.nan), self.direction)

    @property
    def count(self) -> int:
        """How many spots there are."""
        return int(np.isfinite(self.spots[..., 0]).sum())


@dataclass(frozen=True, eq=False)
class Studio:
    """Camera, light, lasers and sensor.

    Attributes:
        camera: The camera, with a screen.
        beams: How each laser looks.
        lighting: Room light.
        sensor: The sensor.
        markers: Markers on the screen.
        glare: Lamps, glints, streaks and reflections a picture.
        missing: Share of the spots that are left out.
        frames: Pictures of each pose.
    """

    camera: Camera
    beams: Sequence[Beam]
    lighting: Lighting = field(default_factory=Lighting)
    sensor: ImageSensor = field(default_factory=ImageSensor)
    markers: ScreenMarkers | None = None
    glare: int = 0
    missing: float = 0.0
    frames: int = 1


@dataclass(frozen=True, eq=False)
class Shot:
    """One picture.

    Attributes:
        pose: Index of its pose; -1 for a picture with the lasers off.
        frame: Number of the picture among those of its pose.
        pixels: (h, w, 3), 8 bits, in OpenCV's order of colours.
        shown: Which lasers' spots are in it, (lasers,).
    """

    pose: int
    frame: int
    pixels: Pixels
    shown: Mask


def nominal_spots(robot: Robot, q: Matrix) -> LitSpots:
    """Where the beams of a robot as its description has it meet the screen.

    Args:
        robot: The robot.
        q: (n, joints), [rad] or [m].
    """
    errors = build_error_model(robot.chain, robot.rig)
    beams = beams_at(errors, np.zeros(len(errors.names)), q)
    return LitSpots(np.where(beams.makes_spot()[..., None], beams.spots, np.nan), beams.direction)


def pictures(studio: Studio, beams: LitSpots, rng: np.random.Generator, dark: bool = False) -> Iterator[Shot]:
    """The pictures of all poses, one after the other.

    Args:
        studio: Camera, light, lasers and sensor.
        beams: The beams of each pose.
        rng: Source of noise, glare and missing spots.
        dark: Whether a picture with the lasers off comes first.

    Raises:
        UsageError: there is not one look for each laser.
    """
    n, lasers = beams.spots.shape[:2]
    if len(studio.beams) != lasers:
        raise UsageError(f"{len(studio.beams)} colours for {lasers} lasers")
    behind = backdrop(studio.camera, studio.lighting, studio.markers)
    pattern = studio.sensor.pattern(studio.camera.size, rng)
    if dark:
        yield Shot(-1, 1, studio.sensor.expose(behind, rng, pattern), np.zeros(lasers, dtype=bool))
    for pose in range(n):
        light = glare(studio.camera.size, studio.glare, rng) if studio.glare else np.zeros_like(behind)
        light += behind
        shown: Mask = np.asarray(rng.random(lasers) >= studio.missing)
        for index in range(lasers):
            shown[index] = shown[index] and _shine(light, studio, beams, pose, index)
        for frame in range(1, studio.frames + 1):
            yield Shot(pose, frame, studio.sensor.expose(light, rng, pattern), shown)


def _shine(light: Light, studio: Studio, beams: LitSpots, pose: int, index: int) -> bool:
    """Add a spot to the light; False where its centre is not in the picture."""
    spot = beams.spots[pose, index]
    if not np.isfinite(spot).all():
        return False
    found = spot_light(studio.camera, spot, beams.direction[pose, index], studio.beams[index])
    if found is None:
        return False
    own, rows, columns = found
    light[rows, columns] += own
    return bool(in_picture(studio.camera, spot[None])[0])


def in_picture(camera: Camera, spots: Matrix) -> Mask:
    """Which spots (n, 2), [m], have their centre in a camera's picture, (n,)."""
    pixels = camera.pixels_of_spots(spots)
    return np.asarray(((pixels >= 0) & (pixels <= np.array(camera.size) - 1)).all(axis=1))


def widths_px(camera: Camera, spots: Matrix, diameter: float) -> Vector:
    """How wide beams of some diameter [m] are in the picture where they make spots (n, 2), (n,), [px]."""
    return np.asarray(diameter / np.sqrt(np.abs(np.linalg.det(camera.spot_jacobian(camera.pixels_of_spots(spots))))))


def png(pixels: Pixels) -> bytes:
    """A picture as the content of a file."""
    return bytes(cv2.imencode(".png", pixels, [cv2.IMWRITE_PNG_COMPRESSION, 2])[1])


def truth_csv(names: Sequence[str], lasers: Sequence[str], camera: Camera, beams: LitSpots, shown: Sequence[Mask]) -> bytes:
    """What the pictures show, as CSV: true spots on the screen [m] and in the picture [px]; empty where none is shown.

    Args:
        names: The picture of each pose.
        lasers: Names of the lasers.
        camera: The camera.
        beams: The beams of each pose.
        shown: Which spots are in the picture, for each pose.
    """
    columns = ["image", *(f"{laser}.{ending}" for laser in lasers for ending in ("y", "z", "u", "v"))]
    rows: list[list[str | float]] = []
    for pose, name in enumerate(names):
        cells: list[str] = []
        for index in range(len(lasers)):
            spot = beams.spots[pose, index]
            there = bool(shown[pose][index])
            cells += [f"{x:.9g}" for x in (*spot, *camera.pixels_of_spots(spot[None])[0])] if there else [""] * 4
        rows.append([name, *cells])
    return csv_text(columns, rows, ["SIMULATED pictures by urdfcal render: where the spots truly are; y, z in m on the screen, u, v in px"])
