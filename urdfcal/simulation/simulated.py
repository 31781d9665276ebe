"""A robot with stated or random errors, and what sensors read of it, in one call. Everything that comes from here is simulated."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from urdfcal.base.errors import UsageError
from urdfcal.base.foreign_text import shown
from urdfcal.base.geometry import DEG, MM, Vector
from urdfcal.base.notebook import card
from urdfcal.calibration.reach import drawn_in_view
from urdfcal.model.error_model import ErrorModel
from urdfcal.model.gauge import build_error_model
from urdfcal.model.options import ModelOptions
from urdfcal.robot.configurations import require_room
from urdfcal.robot.rig import Grid
from urdfcal.robot.robot import Robot, require_robot, with_text
from urdfcal.robot.sheet import ScreenArea
from urdfcal.robot.urdf_writer import with_origins
from urdfcal.sensors.columns import NONE, Stations
from urdfcal.sensors.measurements import Measurements
from urdfcal.simulation.readings import Distribution, ReadingNoise, Simulated, simulated_readings
from urdfcal.simulation.readings import simulate as simulate_spots
from urdfcal.simulation.setup import SimulatedSensor, SimulatedSetup, parse_sensors, seen_with, simulated_setup
from urdfcal.simulation.truth import random_truth, stated_truth

ERRORS = 2 * MM, 0.2 * DEG


@dataclass(frozen=True, repr=False)
class Simulation:
    """Simulated measurements, and the truth that they are of.

    Attributes:
        measurements: What sensors read, with noise.
        nominal: The robot that a fit starts from, as the sensors see it.
        errors: Error model of the truth, with measuring frames and targets where they are.
        x: The truth, (p,), [m] and [rad].
    """

    measurements: Measurements
    nominal: Robot
    errors: ErrorModel
    x: Vector

    @property
    def truth(self) -> Mapping[str, float]:
        """The true errors by name, [m] and [rad]; in all six directions of each joint where they were drawn."""
        return dict(zip(self.errors.names, self.x.tolist(), strict=True))

    @property
    def robot(self) -> Robot:
        """The true robot: the nominal one with its errors, which a calibration is to find."""
        return with_text(self.nominal, with_origins(self.nominal.description, self.errors.corrected_origins(self.x)))

    def __repr__(self) -> str:
        """In a line."""
        data = self.measurements
        return f"<{type(self).__name__} of {shown(self.nominal.name)}: {data.counted} with {data.summary}>"

    def _repr_html_(self) -> str:
        data = self.measurements
        return card(f"SIMULATED: {data.counted} of {self.nominal.name}", (data.summary, ".measurements, .truth and .robot, the true one"))


def simulate(
    robot: Robot,
    poses: int = 60,
    *,
    sensors: Sequence[str] = ("laser",),
    errors: tuple[float, float] | Mapping[str, float] = ERRORS,
    error_model: str = "placement",
    test_poses: int = 0,
    spot_noise: float = 1 * MM,
    joint_noise: float = 0.0,
    length_noise: float = 0.1 * MM,
    angle_noise: float = 0.02 * DEG,
    pixel_noise: float = 0.2,
    distribution: Distribution = "gaussian",
    places: int = 4,
    reference: str | None = None,
    reference_known: bool = False,
    target_known: bool = False,
    screen_size: float = 3.0,
    camera: Any = None,
    boards: Mapping[str, Grid] | None = None,
    stations: Stations = NONE,
    seed: int = 0,
    rng: np.random.Generator | None = None,
) -> Simulation:
    """Simulate measurements of a robot with stated or random errors.

    Args:
        robot: Nominal robot.
        poses: How many.
        sensors: What reads: `laser` for the robot's lasers, or `point:LINK`, `pose:LINK`, `distance:LINK`, `plane:LINK`, `socket:LINK`,
            `inclination:LINK`, `pixels:LINK`; several on one link as `LINK:LABEL`, by one of several instruments as `LINK@INSTRUMENT`.
        errors: Sigmas of random errors in six directions of every joint, mount and screen, ([m], [rad]); or errors by name, [m] and
            [rad], of `error_model`.
        error_model: What stated errors are named after.
        test_poses: Further poses, marked `test`.
        spot_noise: Of a spot coordinate, [m].
        joint_noise: Of a turning joint's reading, [rad].
        length_noise: Of a point's coordinate and of a distance, and how far a touch is off, [m].
        angle_noise: Of an orientation about each axis, and of an inclination, [rad].
        pixel_noise: Of a corner or a target in a picture, [px].
        distribution: `gaussian`, whose noise is a standard deviation, or `uniform`, half of a width.
        places: How many planes, and sockets, a target touches in turn.
        reference: Link that the measuring frame stands on; by default `tracker`, or the root.
        reference_known: Measure from the reference link itself, not from a frame that stands anywhere.
        target_known: Measure the targets' links themselves, not something that sits anywhere on them.
        screen_size: Side of the screen, [m].
        camera: What pixels are read with, a `Camera`; it stands where it sees its targets at many poses.
        boards: Links that are boards, with the grids of their corners, which `pixels:LINK` reads.
        stations: Instruments by name: links, and cameras of their own.
        seed: Of the randomness.
        rng: Source of randomness in place of a seed.

    Raises:
        UsageError: no such sensor, link or error; noise below zero; or poses that sensors can read are too rare.
        RigError: a link is not there, or not where it can be.
    """
    require_robot(robot, "simulate")
    if poses < 1 or test_poses < 0:
        raise UsageError(f"simulate: expected one pose or more, found {poses} and {test_poses} to test")
    rng = np.random.default_rng(seed) if rng is None else rng
    noise = ReadingNoise(spot_noise, joint_noise, distribution, length=length_noise, angle=angle_noise, pixel=pixel_noise)
    named, lasers = parse_sensors(sensors, robot, places, boards, stations)
    seen = seen_with(robot, named, reference or "", lasers, boards, stations) if named else robot
    require_room(seen)
    model, x = _truth(seen, errors, error_model, rng)
    setup, found = simulated_by(
        seen,
        model,
        x,
        named,
        (poses, test_poses),
        rng,
        noise,
        area=ScreenArea(screen_size),
        reference_known=reference_known,
        target_known=target_known,
        camera=camera,
        boards=boards,
        stations=stations,
    )
    return Simulation(found.data, seen, setup.errors, setup.x)


def simulated_by(
    robot: Robot,
    errors: ErrorModel,
    x: Vector,
    sensors: Sequence[SimulatedSensor],
    poses: tuple[int, int],
    rng: np.random.Generator,
    noise: ReadingNoise,
    *,
    area: ScreenArea,
    reference_known: bool = False,
    target_known: bool = False,
    camera: Any = None,
    boards: Mapping[str, Grid] | None = None,
    stations: Stations = NONE,
) -> tuple[SimulatedSetup, Simulated]:
    """What sensors read of a robot with known errors, and where everything stands that measures it.

    Args:
        robot: Nominal robot, as the sensors see it.
        errors: Error model of the truth, built for it.
        x: The truth, (p,), [m] and [rad].
        sensors: What reads; none for the robot's lasers alone.
        poses: How many to fit, and how many to test.
        rng: Source of randomness.
        noise: Of what is read.
        area: The screen.
        reference_known: As for `simulated_setup`.
        target_known: The same.
        camera: The same.
        boards: The same.
        stations: The same.

    Raises:
        UsageError: poses that sensors can read are too rare, or pixels are to be read without a camera.
    """
    if sensors:
        setup = simulated_setup(
            robot,
            errors,
            x,
            sensors,
            rng,
            reference_known=reference_known,
            target_known=target_known,
            area=area,
            camera=camera,
            boards=boards,
            stations=stations,
        )
        found = simulated_readings(setup, sum(poses), rng, noise)
    else:
        setup, drawn = SimulatedSetup(robot, errors, x, (), area), drawn_in_view(robot, errors, x, sum(poses), rng, area=area)
        found = Simulated(simulate_spots(robot, errors, x, drawn.q, rng, noise), drawn.looked)
    return setup, replace(found, data=replace(found.data, sets=np.repeat(["fit", "test"], poses)))


def _truth(
    robot: Robot, errors: tuple[float, float] | Mapping[str, float], error_model: str, rng: np.random.Generator
) -> tuple[ErrorModel, Vector]:
    if isinstance(errors, Mapping):
        model = build_error_model(robot.chain, robot.rig, ModelOptions(error_model=error_model))
        return model, stated_truth(model, errors)
    return random_truth(robot, rng, *errors)
