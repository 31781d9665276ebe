"""Spots that were read as pixels: where a fit of them begins, and the camera that it leaves."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from urdfcal.ekf import Belief
from urdfcal.error_model import ErrorModel
from urdfcal.errors import UsageError
from urdfcal.fit_start import begin, explains
from urdfcal.geometry import Vector
from urdfcal.measurements import Measurements
from urdfcal.method import Method
from urdfcal.noise import Noise
from urdfcal.pixel_spots import screen_before
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


def corrected_camera(data: Measurements, errors: ErrorModel, belief: Belief) -> Any:
    """The camera that read spots as pixels, with the screen where a fit found it, and the covariance that the fit has for that.

    Args:
        data: What was fitted; its camera stays as it is.
        errors: The error model of the fit; where it holds all of the screen's place, the covariance is the camera's own.
        belief: What came out.

    Raises:
        UsageError: no spots were read as pixels.
    """
    if not in_pixels(data):
        raise UsageError("no laser spots were read as pixels, so the fit corrects no camera")
    camera: Any = data.camera
    T_camera_screen, columns, twists = screen_before(camera.T_camera_screen, errors, belief.x)
    in_screen = T_camera_screen.toActionMatrixInverse() @ twists
    covariance = in_screen @ belief.P[np.ix_(columns, columns)] @ in_screen.T if columns else camera.screen_covariance
    return replace(camera, T_camera_screen=T_camera_screen, screen_rms=None, screen_covariance=covariance)
