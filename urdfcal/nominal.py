"""The robot as its URDF has it, measured from frames and with targets that suit it best: what a calibration is compared with."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from urdfcal.ekf import Belief, iterated_schedule
from urdfcal.error_model import DEFAULT_PRIORS, ErrorModel, Parameter
from urdfcal.error_table import SpotTable, error_table
from urdfcal.frame_start import instruments_alone, place_instruments, with_places
from urdfcal.geometry import Vector
from urdfcal.measurements import Measurements
from urdfcal.noise import Linearisation, Noise
from urdfcal.spot_model import SpotModel, model_for


@dataclass(frozen=True)
class NominalFit:
    """The uncalibrated robot with its instruments placed.

    Attributes:
        errors: The error model, with measuring frames and targets put where they were found.
        alone: The same with nothing free but instruments.
        instruments: Their state, (of `alone`).
        x: The state of `errors` at which joints, mount and screen are at their prior mean, (p,).
        noise: Of the measurements, or where its estimation started.
    """

    errors: ErrorModel
    alone: ErrorModel
    instruments: Vector
    x: Vector
    noise: Noise

    def linearise(self, data: Measurements) -> Linearisation:
        """Residuals of the uncalibrated robot."""
        with np.errstate(invalid="ignore"):
            errors, x = with_new_places(self.alone, self.instruments, data, self.noise)
            return SpotModel(errors, data).linearise(x)

    def table(self, data: Measurements) -> SpotTable:
        """Distances of the uncalibrated robot."""
        return error_table(self.linearise(data), len(data))


def nominal_fit(errors: ErrorModel, data: Measurements, noise: Noise, max_sweeps: int | None = None) -> NominalFit:
    """Place measuring frames, targets and shared places for the robot as it is, in closed form and then by least squares.

    Args:
        errors: Error model of the robot as it was measured.
        data: The measurements; where there are lasers alone nothing has to be placed.
        noise: Of the measurements, or where its estimation starts.
        max_sweeps: How many sweeps of least squares are allowed; the filter's own default if None.
    """
    if data.readings:
        errors = place_instruments(errors, data)
    alone, x = instruments_alone(errors), errors.mean.copy()
    if alone.names:
        prior = Belief.independent(alone.mean, alone.sigma)
        found = iterated_schedule(model_for(alone, data, noise).linearise, prior, noise, max_sweeps=max_sweeps).belief.x
        x[[errors.names.index(name) for name in alone.names]] = found
        return NominalFit(errors, alone, found, x, noise)
    return NominalFit(errors, alone, np.empty(0), x, noise)


def with_new_places(errors: ErrorModel, x: Vector, data: Measurements, noise: Noise) -> tuple[ErrorModel, Vector]:
    """An error model and a state for further measurements: places that were not known yet are put where those have them best.

    Everything else is held at x, so that what is left over tells how well the robot is known.
    """
    known = {name.rpartition(".")[0] for name in (*errors.names, *errors.held)}
    new = [place for place in data.instruments.places if place.name not in known]
    if not new:
        return errors, x
    sigma = DEFAULT_PRIORS["place"]
    parameters = tuple(
        Parameter(f"{place.name}.{name}", unit, "place", 0.0, sigma.sigma(unit))
        for place in new
        for name, unit in zip(place.names, place.units, strict=True)
    )
    held = {**errors.held, **dict(zip(errors.names, x.tolist(), strict=True))}
    there = with_places(replace(errors, parameters=parameters, held=held), data)
    prior = Belief.independent(there.mean, there.sigma)
    found = iterated_schedule(model_for(there, data, noise).linearise, prior, replace(noise, stated=True))
    return there, found.belief.x
