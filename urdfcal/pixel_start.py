"""Where to begin with spots that were read as pixels."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from urdfcal.ekf import Belief
from urdfcal.error_model import ErrorModel
from urdfcal.errors import UsageError
from urdfcal.fit_start import begin, explains
from urdfcal.geometry import Vector
from urdfcal.measurements import Measurements
from urdfcal.method import Method
from urdfcal.noise import Noise
from urdfcal.reading_kinds import start_sigma_of
from urdfcal.spot_model import model_for


def in_pixels(data: Measurements) -> bool:
    """Whether spots were read as pixels."""
    return any(data.of_laser(each) for each in data.readings)


def require_screen_of_camera(data: Measurements) -> None:
    """Refuse spots in pixels of a camera that does not know where the screen is.

    Raises:
        UsageError: says how to add it.
    """
    if in_pixels(data) and getattr(data.camera, "T_camera_screen", None) is None:
        raise UsageError("the camera knows no screen; add it with `urdfcal camera --lens CAMERA.yaml --screen IMAGE --markers screen.yaml`")


def start_of_pixels(data: Measurements, errors: ErrorModel, noise: Noise, sane: bool) -> Vector:
    """Where to begin with spots in pixels: at the fit of the spots that the camera makes of them on the screen as it is calibrated."""
    spots = as_spots(data)
    rest = replace(errors, parameters=tuple(parameter for parameter in errors.parameters if parameter.kind != "camera"))
    alone = Noise(start_sigma_of("spot"), noise.joint_sigma, False)
    model = model_for(rest, spots, noise)
    found = Method().run(model, Belief.independent(rest.mean, rest.sigma), alone)
    x = found.belief.x if explains(model, found, alone) else begin(model, alone, sane).x
    known = dict(zip(rest.names, x, strict=True))
    return np.array([known.get(parameter.name, parameter.mean) for parameter in errors.parameters])


def as_spots(data: Measurements) -> Measurements:
    """Measurements with spots in pixels turned into spots on the screen, where the camera's calibration has it; nothing else is kept."""
    spots, sigma = data.spots.copy(), data.sigma.copy()
    for each in (each for each in data.readings if data.of_laser(each)):
        laser = data.lasers.index(each.link)
        rows = np.flatnonzero(each.seen)
        spots[rows, laser] = data.camera.spots_of_pixels(each.values[rows])
        sigma[rows, laser] = np.nan
    return replace(data, spots=spots, sigma=sigma, readings=(), lengths=())
