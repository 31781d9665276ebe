"""What sensors read of a robot with known errors, with noise. Everything that comes from here is simulated.

The noise of a touch is how far off its place the target is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from urdfcal.base.errors import UsageError
from urdfcal.base.geometry import DEG, MM, Array3, Matrix, Vector
from urdfcal.calibration.reach import drawn_in_view
from urdfcal.model.error_model import ErrorModel
from urdfcal.model.jacobian import CHUNK
from urdfcal.robot.configurations import random_positions
from urdfcal.robot.robot import Robot
from urdfcal.robot.sheet import ScreenArea
from urdfcal.sensors.measurements import Measurements, spot_readings, spots_measured
from urdfcal.sensors.readings import Readings
from urdfcal.sensors.registry import SENSORS
from urdfcal.sensors.sensor import View
from urdfcal.sensors.spots import Beams, beams_at, beams_in
from urdfcal.simulation.pictures import Subject
from urdfcal.simulation.setup import SENSOR_KINDS, SimulatedSensor, SimulatedSetup
from urdfcal.simulation.sights import poses_in_sight
from urdfcal.simulation.touching import Touch, touching, turns_of

Distribution = Literal["gaussian", "uniform"]


@dataclass(frozen=True)
class SimulatedNoise:
    """Noise of a simulation.

    Attributes:
        spot: [m]; standard deviation, or half the width of a uniform distribution.
        joint: [rad]; the same, on turning joints' readings.
        distribution: `gaussian` or `uniform`.
        readings: How many readings (joints and spots) of a pose are averaged.
    """

    spot: float = 0.0
    joint: float = 0.0
    distribution: Distribution = "gaussian"
    readings: int = 1

    def draw(self, rng: np.random.Generator, scale: float, shape: tuple[int, ...]) -> Array3:
        """The mean of `readings` draws of noise."""
        total = np.zeros(shape)
        for _ in range(self.readings):
            total += rng.normal(0.0, scale, shape) if self.distribution == "gaussian" else rng.uniform(-scale, scale, shape)
        return total / self.readings

    def positions(self, robot: Robot, q: Matrix, rng: np.random.Generator) -> Matrix:
        """What encoders read of true positions q, (n, inputs); slides are read as they are."""
        turning = np.array([0.0 if joint.prismatic else 1.0 for joint in robot.chain.inputs])
        return np.asarray(q + self.draw(rng, self.joint, q.shape) * turning)


def simulate(
    robot: Robot, errors: ErrorModel, x: Vector, q: Matrix, rng: np.random.Generator, noise: SimulatedNoise | None = None
) -> Measurements:
    """Measurements of the robot with errors x, standing at q, read with noise.

    Args:
        robot: Nominal robot.
        errors: Error model of the truth.
        x: The truth, (p,), [m] and [rad].
        q: True joint positions, (n, inputs); the readings differ by the joint noise.
        rng: Source of randomness.
        noise: Of spots and joints; none by default.
    """
    noise = noise or SimulatedNoise()
    spots = true_spots(robot, errors, x, q)
    readings = noise.positions(robot, q, rng)
    return spots_measured(robot, readings, spots + noise.draw(rng, noise.spot, spots.shape))


def true_spots(robot: Robot, errors: ErrorModel, x: Vector, q: Matrix) -> Array3:
    """The spots of the robot with errors x at q, (n, lasers, 2), [m]."""
    return beams_at(replace(errors, sessions=("",)), x, q).spots


def noise_from(spot_mm: float, joint_deg: float, distribution: str, readings: int = 1) -> SimulatedNoise:
    """Noise in the units of the command line.

    Raises:
        UsageError: it is negative, or the distribution is unknown.
    """
    if distribution not in ("gaussian", "uniform"):
        raise UsageError(f"no noise distribution '{distribution}'; there are: gaussian, uniform")
    if not (0 <= spot_mm < np.inf and 0 <= joint_deg < np.inf) or readings < 1:
        raise UsageError("noise must be finite and not negative, and at least one reading is taken")
    return SimulatedNoise(spot_mm * MM, joint_deg * DEG, "uniform" if distribution == "uniform" else "gaussian", readings)


@dataclass(frozen=True)
class ReadingNoise(SimulatedNoise):
    """Noise of a simulation with instruments beside lasers, or instead of them.

    Attributes:
        length: Of a point's coordinates, of a distance, and how far a touch is off in each direction, [m].
        angle: Of an orientation about each axis, [rad].
        pixel: Of a corner or a target in a picture, [px].
    """

    length: float = 0.0
    angle: float = 0.0
    pixel: float = 0.0

    def __post_init__(self) -> None:
        if not all(0 <= size < np.inf for size in (self.length, self.angle, self.pixel)):
            raise UsageError("noise must be finite and not negative")

    def of(self, unit: str) -> float:
        """What readings that are told in a unit, mm, deg or px, are drawn with."""
        return {"mm": self.length, "deg": self.angle, "px": self.pixel}[unit]


@dataclass(frozen=True)
class Simulated:
    """Measurements at random poses.

    Attributes:
        data: The measurements.
        looked: How many random poses had to be drawn for them; 0 where any pose would do, or touches are made.
    """

    data: Measurements
    looked: int


def simulate_readings(setup: SimulatedSetup, poses: int, rng: np.random.Generator, noise: ReadingNoise | None = None) -> Measurements:
    """The measurements of `simulated_readings` alone."""
    return simulated_readings(setup, poses, rng, noise).data


def simulated_readings(setup: SimulatedSetup, poses: int, rng: np.random.Generator, noise: ReadingNoise | None = None) -> Simulated:
    """Measurements of the robot at random poses: every target is seen in each of them, or the camera sees one, touches take turns.

    Args:
        setup: Robot, truth and instruments.
        poses: How many, shared by the sessions alike.
        rng: Source of randomness.
        noise: None by default.

    Raises:
        UsageError: poses that touch the places, put the beams on the screen or the board into the picture, are too rare.
    """
    noise, sessions = noise or ReadingNoise(), setup.errors.sessions
    turns = turns_of(setup.sensors)
    own = [len(part) for part in np.array_split(np.arange(poses), len(sessions))]
    parts = [_one_session(setup, session, count, turns, rng, noise) for session, count in zip(sessions, own, strict=True)]
    q, spots = np.concatenate([part[0] for part in parts]), np.concatenate([part[1] for part in parts])
    readings = [_joined([part[2][index] for part in parts]) for index in range(len(parts[0][2]))]
    readings = [each for each in readings if each.seen.any() or not each.kind.by_camera]  # corners that no picture shows get no column
    named = {sensor.instrument for sensor in setup.sensors}
    data = Measurements(
        joints=setup.robot.chain.input_names,
        q=noise.positions(setup.robot, q, rng),
        readings=(*spot_readings(setup.robot.rig.lasers, spots), *readings),
        poses=np.array([str(number) for number in range(1, poses + 1)]),
        sets=np.full(poses, "fit", dtype="<U4"),
        sessions=np.repeat(sessions, own),
        reference=setup.robot.instruments.reference,
        camera=setup.camera,
        boards=setup.boards,
        stations={name: link for name, link in setup.stations.links.items() if name in named},
        cameras={name: camera for name, camera in setup.stations.cameras.items() if name in named},
    )
    return Simulated(data, sum(part[3] for part in parts))


def _one_session(
    setup: SimulatedSetup, session: str, poses: int, turns: list[Touch], rng: np.random.Generator, noise: ReadingNoise
) -> tuple[Matrix, Array3, list[Readings], int]:
    """True joint positions, spots and readings of one session, and how many random poses were drawn for them."""
    touches, looked = [turns[pose % len(turns)] for pose in range(poses)] if turns else [], 0
    if turns:
        q = touching(setup, session, touches, noise.draw(rng, noise.length, (poses, 3)), rng)
    elif setup.robot.rig.lasers and not setup.choosy:
        drawn = drawn_in_view(setup.robot, replace(setup.errors, sessions=("",)), setup.x, poses, rng, area=setup.area)
        q, looked = drawn.q, drawn.looked
    elif setup.choosy:
        drawn = poses_in_sight(setup, session, poses, rng)
        q, looked = drawn.q, drawn.looked
    else:
        q = random_positions(setup.robot, poses, rng)
    parts = [setup.motion(q[start : start + CHUNK], session) for start in range(0, max(poses, 1), CHUNK)]
    spots = np.concatenate([_spots(beams_in(setup.robot.chain, motion), setup.area) for motion, _ in parts])
    readings = []
    for sensor in setup.sensors:
        p, R = (np.concatenate([seen[sensor.pair][part] for _, seen in parts]) for part in (0, 1))
        readings += [_read(setup, sensor, kind, p, R, touches, rng, noise) for kind in SENSOR_KINDS[sensor.kind]]
    return q, spots + noise.draw(rng, noise.spot, spots.shape), readings, looked


def _spots(beams: Beams, area: ScreenArea) -> Array3:
    """Where the beams meet the screen; nan where they do not."""
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where((area.holds(beams.spots) & beams.makes_spot())[..., None], beams.spots, np.nan)


def _read(
    setup: SimulatedSetup,
    sensor: SimulatedSensor,
    kind: str,
    p: Matrix,
    R: Array3,
    touches: Sequence[Touch],
    rng: np.random.Generator,
    noise: ReadingNoise,
) -> Readings:
    """What one sensor reads of its target, seen at p with axes R."""
    camera = setup.camera_of(sensor.instrument)
    n, how = len(p), SENSORS[kind].with_camera(camera)
    labels = [touch.label if (touch.kind, touch.pair) == (kind, sensor.pair) else "" for touch in touches]
    places = () if how.touches else how.places(sensor.target, ())
    numbers = np.concatenate([np.empty(0), *(setup.place(place.name) for place in places)])
    axes = next((setup.errors.planes[place.name] for place in places if place.name in setup.errors.planes), np.eye(3))
    view = View(p, R, np.tile(numbers, (n, 1)), np.broadcast_to(axes, (n, 3, 3)))
    scale = noise.spot if how.aimed else noise.of(how.words.unit)
    values = how.disturbed(how.read(view), lambda shape: noise.draw(rng, scale, shape))
    if how.aimed:
        values = np.where(setup.area_of(sensor.instrument).holds(values)[:, None], values, np.nan)
    if how.by_camera:
        seen = Subject(p, R, np.zeros((1, 3)), sensor.link in setup.boards).read(camera)
        values = np.where(seen, values, np.nan)
    touched = np.array(labels, dtype=str) if how.touches else np.full(n, "")
    return Readings(kind, sensor.target, sensor.link, values, touched, np.full(n, np.nan), sensor.instrument)


def _joined(parts: Sequence[Readings]) -> Readings:
    values, labels = np.concatenate([part.values for part in parts]), np.concatenate([part.labels for part in parts])
    return replace(parts[0], values=values, labels=labels, sigma=np.full(len(labels), np.nan))


def reading_noise(
    spot_mm: float, joint_deg: float, distribution: str, target_mm: float, orientation_deg: float, pixel_px: float = 0.0
) -> ReadingNoise:
    """Noise in the units of the command line.

    Raises:
        UsageError: it is negative, or the distribution is unknown.
    """
    spots = noise_from(spot_mm, joint_deg, distribution)
    return ReadingNoise(spots.spot, spots.joint, spots.distribution, length=target_mm * MM, angle=orientation_deg * DEG, pixel=pixel_px)
