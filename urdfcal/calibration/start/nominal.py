"""The robot as its URDF has it, measured from frames and with targets that suit it best: what a calibration is compared with, and what
`evaluate` shows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from urdfcal.base.geometry import Vector
from urdfcal.calibration.error_table import SpotTable, error_table
from urdfcal.calibration.problem import Problem, problem_of
from urdfcal.calibration.start.frames import instruments_alone, place_instruments, with_places
from urdfcal.estimation.ekf import Belief, iterated_schedule
from urdfcal.estimation.noise import Noise
from urdfcal.estimation.residual import Linearisation
from urdfcal.model.error_model import ErrorModel
from urdfcal.model.gauge import build_error_model, of_these_poses
from urdfcal.model.options import ModelOptions, ParameterPrior
from urdfcal.model.parameters import DEFAULT_PRIORS, Parameter
from urdfcal.robot.rig import Place
from urdfcal.robot.robot import Robot
from urdfcal.sensors.measurements import Measurements, as_measured, unreached_words
from urdfcal.sensors.stated_noise import noise_for, noise_of


@dataclass(frozen=True)
class NominalFit:
    """The uncalibrated robot with its instruments placed.

    Attributes:
        errors: The error model, with measuring frames and targets put where they were found.
        alone: The same with nothing free but instruments.
        instruments: Their state, (of `alone`).
        x: The state of `errors` at which joints, mount and screen are at their prior mean, (p,).
        noise: Of the measurements, or where its estimation started.
        kinds: What it is the noise of, in its order.
    """

    errors: ErrorModel
    alone: ErrorModel
    instruments: Vector
    x: Vector
    noise: Noise
    kinds: tuple[str, ...]

    def with_new_places(self, data: Measurements) -> tuple[ErrorModel, Vector]:
        """The uncalibrated robot and its state for other measurements: see `with_new_places`."""
        return with_new_places(self.alone, self.instruments, data, noise_for(self.noise, self.kinds, data))

    def residuals(self, data: Measurements) -> Linearisation:
        """Residuals of the uncalibrated robot."""
        with np.errstate(invalid="ignore"):
            errors, x = self.with_new_places(data)
            return Problem(errors, data).residuals(x)

    def table(self, data: Measurements) -> SpotTable:
        """Distances of the uncalibrated robot."""
        return error_table(self.residuals(data), len(data))


def nominal_fit(errors: ErrorModel, data: Measurements, noise: Noise, max_sweeps: int | None = None) -> NominalFit:
    """Place measuring frames, targets and shared places for the robot as it is, in closed form and then by least squares.

    Args:
        errors: Error model of the robot as it was measured.
        data: The measurements; where there are lasers alone nothing has to be placed.
        noise: Of the measurements, or where its estimation starts.
        max_sweeps: How many sweeps of least squares are allowed; the filter's own default if None.
    """
    errors = place_instruments(errors, data)
    alone, x = instruments_alone(errors), errors.mean.copy()
    if alone.names:
        prior = Belief.independent(alone.mean, alone.sigma)
        found = iterated_schedule(problem_of(alone, data, noise).linearise, prior, noise, max_sweeps=max_sweeps).belief.x
        x[[errors.column[name] for name in alone.names]] = found
        return NominalFit(errors, alone, found, x, noise, data.kinds)
    return NominalFit(errors, alone, np.empty(0), x, noise, data.kinds)


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
    found = iterated_schedule(problem_of(there, data, noise).linearise, prior, noise.hold())
    return there, found.belief.x


def evaluate(robot: Robot, data: Measurements, options: ModelOptions | None = None) -> SpotTable:
    """Distances of a robot as its URDF has it; where targets were measured, from measuring frames and offsets that suit it best.

    Args:
        robot: The robot.
        data: The measurements.
        options: Of which only what concerns the instruments matters.
    """
    robot = as_measured(robot, data)
    errors = _with_instruments(robot, data, options or ModelOptions()) if data.instruments.needed else _bare(robot, data)
    return nominal_fit(errors, data, noise_of(data, {}, np.zeros(len(robot.chain.inputs)))).table(data)


def _with_instruments(robot: Robot, data: Measurements, options: ModelOptions) -> ErrorModel:
    sessions = data.session_names or ("",)
    return build_error_model(robot.chain, robot.rig, of_these_poses(robot.chain, robot.rig, options, sessions), sessions)


def _bare(robot: Robot, data: Measurements) -> ErrorModel:
    return ErrorModel(robot.chain, (), (), sessions=data.session_names or ("",))


def beams_that_miss(robot: Robot, data: Measurements) -> tuple[str, ...]:
    """A warning where a beam was seen that does not meet the screen in the robot as its URDF has it."""
    data = replace(data, readings=tuple(reading for reading in data.readings if reading.kind.beam), lengths=())
    lost = Problem(_bare(robot, data), data).residuals(np.empty(0)).lost
    words = unreached_words(data, lost, [reading.target for reading in data.readings], "this robot") if lost is not None else ""
    return (f"{words}; such distances mean nothing",) if words else ()


def held_instruments(errors: ErrorModel, places: Sequence[Place]) -> ModelOptions:
    """Options by which measuring frame, targets and places are held as a fit held them.

    Args:
        errors: The error model of the fit.
        places: What several poses shared.
    """
    slots = [slot for slot in errors.slots if slot.frame is not None]
    names = [f"{slot.label}.{name}" for slot in slots for name in slot.names if name not in slot.spare]
    names += [f"{place.name}.{name}" for place in places for name in place.names]
    held = [name for name in names if name not in errors.names and name not in errors.carried]
    single = {name: ParameterPrior(errors.held.get(name), fixed=True) for name in held}
    kinds = {slot.kind for slot in slots}
    return ModelOptions(single=single, reference_known="reference" not in kinds, target_known="target" not in kinds)
