"""Small simulated cameras and pictures for the tests of spots and rendering."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from urdfcal.base.geometry import Vector
from urdfcal.sensors.camera import Camera
from urdfcal.vision.render.image_sensor import ImageSensor, Pixels
from urdfcal.vision.render.light import Beam, Lighting, backdrop, spot_light


def camera(
    size: tuple[int, int] = (400, 300), oblique_deg: float = 30.0, azimuth_deg: float = 200.0, mm_per_px: float = 1.5, k1: float = -0.15
) -> Camera:
    """A camera 2 m in front of the screen's origin, looking at it at a slant."""
    tilt, azimuth = np.radians([oblique_deg, azimuth_deg])
    back = np.array([-np.cos(tilt), np.sin(tilt) * np.cos(azimuth), np.sin(tilt) * np.sin(azimuth)])
    across = np.cross(-back, [0.0, 0.0, 1.0])
    across /= np.linalg.norm(across)
    rotation = np.stack([across, np.cross(-back, across), -back])
    focal = 2.0 / (mm_per_px * 1e-3)
    matrix = np.array([[focal, 0.0, size[0] / 2 + 3.3], [0.0, focal, size[1] / 2 - 2.2], [0.0, 0.0, 1.0]])
    return Camera(size, matrix, np.array([k1, 0.02, 1e-4, -2e-4, 0.0]), "plain", pin.SE3(rotation, -rotation @ (2.0 * back)))


def shot(
    view: Camera,
    spots: list[tuple[float, float]],
    beams: list[Beam],
    rng: np.random.Generator,
    incidence_deg: float = 20.0,
    level: float = 0.2,
) -> tuple[Pixels, list[Vector]]:
    """A picture of some spots, given in pixels, and where their centres truly are."""
    light = backdrop(view, Lighting(level))
    direction = np.array([np.cos(np.radians(incidence_deg)), np.sin(np.radians(incidence_deg)), 0.0])
    truth = []
    for at, beam in zip(spots, beams, strict=True):
        spot = view.spots_of_pixels(np.array([at]))[0]
        found = spot_light(view, spot, direction, beam)
        assert found is not None
        own, rows, columns = found
        light[rows, columns] += own
        truth.append(view.pixels_of_spots(spot[None])[0])
    return ImageSensor().expose(light, rng), truth
