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
from urdfcal.calibration.reach import ScreenArea, draw_poses
from urdfcal.model.error_model import ErrorModel
from urdfcal.model.jacobian import CHUNK
from urdfcal.robot.robot import Robot
from urdfcal.sensors.measurements import Measurements, spot_readings, spots_measured
from urdfcal.sensors.readings import Readings
from urdfcal.sensors.registry import SENSORS
from urdfcal.sensors.sensor import View
from urdfcal.sensors.spots import Beams, beams_at, beams_in
from urdfcal.simulation.setup import SENSOR_KINDS, SimulatedSensor, SimulatedSetup, random_positions
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
    turning = np.array([0.0 if joint.prismatic else 1.0 for joint in robot.chain.inputs])
    readings = q + noise.draw(rng, noise.joint, q.shape) * turning
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
    """

    length: float = 0.0
    angle: float = 0.0

    def __post_init__(self) -> None:
        if not (0 <= self.length < np.inf and 0 <= self.angle < np.inf):
            raise UsageError("noise must be finite and not negative")


def simulate_readings(setup: SimulatedSetup, poses: int, rng: np.random.Generator, noise: ReadingNoise | None = None) -> Measurements:
    """Measurements of the robot at random poses: every target is seen in each of them, touches take turns.

    Args:
        setup: Robot, truth and instruments.
        poses: How many, shared by the sessions alike.
        rng: Source of randomness.
        noise: None by default.

    Raises:
        UsageError: poses that touch the places, or put the beams on the screen, are too rare.
    """
    noise, sessions = noise or ReadingNoise(), setup.errors.sessions
    turns = turns_of(setup.sensors)
    own = [len(part) for part in np.array_split(np.arange(poses), len(sessions))]
    parts = [_one_session(setup, session, count, turns, rng, noise) for session, count in zip(sessions, own, strict=True)]
    q, spots = np.concatenate([part[0] for part in parts]), np.concatenate([part[1] for part in parts])
    readings = [_joined([part[2][index] for part in parts]) for index in range(len(parts[0][2]))]
    turning = np.array([0.0 if joint.prismatic else 1.0 for joint in setup.robot.chain.inputs])
    return Measurements(
        joints=setup.robot.chain.input_names,
        q=q + noise.draw(rng, noise.joint, q.shape) * turning,
        readings=(*spot_readings(setup.robot.rig.lasers, spots), *readings),
        poses=np.array([str(number) for number in range(1, poses + 1)]),
        sets=np.full(poses, "fit", dtype="<U4"),
        sessions=np.repeat(sessions, own),
        reference=setup.robot.instruments.reference,
    )


def _one_session(
    setup: SimulatedSetup, session: str, poses: int, turns: list[Touch], rng: np.random.Generator, noise: ReadingNoise
) -> tuple[Matrix, Array3, list[Readings]]:
    """True joint positions, spots and readings of one session."""
    if turns:
        touches = [turns[pose % len(turns)] for pose in range(poses)]
        q = touching(setup, session, touches, noise.draw(rng, noise.length, (poses, 3)), rng)
    elif setup.robot.rig.lasers:
        touches, q = [], draw_poses(setup.robot, replace(setup.errors, sessions=("",)), setup.x, poses, rng, area=setup.area)
    else:
        touches, q = [], random_positions(setup, poses, rng)
    parts = [setup.motion(q[start : start + CHUNK], session) for start in range(0, max(poses, 1), CHUNK)]
    spots = np.concatenate([_spots(beams_in(setup.robot.chain, motion), setup.area) for motion, _ in parts])
    readings = []
    for sensor in setup.sensors:
        p, R = (np.concatenate([seen[sensor.target][part] for _, seen in parts]) for part in (0, 1))
        readings += [_read(setup, sensor, kind, p, R, touches, rng, noise) for kind in SENSOR_KINDS[sensor.kind]]
    return q, spots + noise.draw(rng, noise.spot, spots.shape), readings


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
    n, how = len(p), SENSORS[kind]
    labels = [touch.label if (touch.kind, touch.target) == (kind, sensor.target) else "" for touch in touches]
    places = () if how.touches else how.places(sensor.target, ())
    numbers = np.concatenate([np.empty(0), *(setup.place(place.name) for place in places)])
    axes = next((setup.errors.planes[place.name] for place in places if place.name in setup.errors.planes), np.eye(3))
    view = View(p, R, np.tile(numbers, (n, 1)), np.broadcast_to(axes, (n, 3, 3)))
    scale = noise.angle if how.words.of_angles else noise.length
    values = how.disturbed(how.read(view), lambda shape: noise.draw(rng, scale, shape))
    touched = np.array(labels, dtype=str) if how.touches else np.full(n, "")
    return Readings(kind, sensor.target, sensor.link, values, touched, np.full(n, np.nan))


def _joined(parts: Sequence[Readings]) -> Readings:
    values, labels = np.concatenate([part.values for part in parts]), np.concatenate([part.labels for part in parts])
    return replace(parts[0], values=values, labels=labels, sigma=np.full(len(labels), np.nan))


def reading_noise(spot_mm: float, joint_deg: float, distribution: str, target_mm: float, orientation_deg: float) -> ReadingNoise:
    """Noise in the units of the command line.

    Raises:
        UsageError: it is negative, or the distribution is unknown.
    """
    spots = noise_from(spot_mm, joint_deg, distribution)
    return ReadingNoise(spots.spot, spots.joint, spots.distribution, length=target_mm * MM, angle=orientation_deg * DEG)
