"""What points, poses, draw wires, planes and sockets read of a robot with known errors. Everything that comes from here is simulated.

The noise of a touch is how far off its place the target is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from urdfcal.errors import UsageError
from urdfcal.frame_jacobian import CHUNK, LaserMotion
from urdfcal.geometry import Array3, Matrix
from urdfcal.measurements import Measurements
from urdfcal.readings import ReadingKind, Readings
from urdfcal.sensors import makes_spot, spots_on_screen
from urdfcal.simulated_setup import SENSOR_KINDS, SimulatedSensor, SimulatedSetup
from urdfcal.simulation import ScreenArea, draw_poses, random_positions
from urdfcal.touching import Touch, touching, turns_of


@dataclass(frozen=True)
class ReadingNoise:
    """Standard deviations of a simulation's noise.

    Attributes:
        length: Of a point's coordinates, a distance, and how far a touch is off, [m].
        angle: Of an orientation about each axis, [rad].
        spot: Of a spot's coordinates, [m].
        joint: Of a turning joint's reading, [rad].
    """

    length: float = 0.0
    angle: float = 0.0
    spot: float = 0.0
    joint: float = 0.0

    def __post_init__(self) -> None:
        if not all(0 <= size < np.inf for size in (self.length, self.angle, self.spot, self.joint)):
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
    turns = _turns(setup.sensors)
    own = [len(part) for part in np.array_split(np.arange(poses), len(sessions))]
    parts = [_one_session(setup, session, count, turns, rng, noise) for session, count in zip(sessions, own, strict=True)]
    q, spots = np.concatenate([part[0] for part in parts]), np.concatenate([part[1] for part in parts])
    readings = [_joined([part[2][index] for part in parts]) for index in range(len(parts[0][2]))]
    turning = np.array([0.0 if joint.prismatic else 1.0 for joint in setup.robot.chain.inputs])
    return Measurements(
        joints=setup.robot.chain.input_names,
        lasers=setup.robot.rig.lasers,
        q=q + rng.normal(0, 1, q.shape) * turning * noise.joint,
        spots=spots,
        sigma=np.full(spots.shape[:2], np.nan),
        poses=np.array([str(number) for number in range(1, poses + 1)]),
        sets=np.full(poses, "fit", dtype="<U4"),
        sessions=np.repeat(sessions, own),
        readings=tuple(readings),
        reference=setup.robot.instruments.reference,
    )


def _one_session(
    setup: SimulatedSetup, session: str, poses: int, turns: list[tuple[str, str, str]], rng: np.random.Generator, noise: ReadingNoise
) -> tuple[Matrix, Array3, list[Readings]]:
    """True joint positions, spots and readings of one session."""
    if turns:
        touched = [turns[pose % len(turns)] for pose in range(poses)]
        q = _touching(setup, session, touched, rng, noise)
    else:
        touched = [("", "", "")] * poses
        lasers = setup.robot.rig.lasers
        q = draw_poses(setup.robot, setup.errors, setup.x, poses, rng, area=setup.area) if lasers else _random(setup, poses, rng)
    parts = [setup.motion(q[start : start + CHUNK], session) for start in range(0, poses, CHUNK)]
    spots = np.concatenate([_spots(motion, setup.area) for motion, _ in parts]) if parts else np.empty((0, len(setup.robot.rig.lasers), 2))
    readings = []
    for sensor in setup.sensors:
        p, R = (np.concatenate([seen[sensor.target][part] for _, seen in parts]) for part in (0, 1))
        readings += [_read(setup, sensor, kind, p, R, touched, rng, noise) for kind in _kinds(sensor)]
    return q, spots + rng.normal(0, 1, spots.shape) * noise.spot, readings


def _spots(motion: LaserMotion, area: ScreenArea) -> Array3:
    """Where the beams meet the screen; nan where they do not."""
    with np.errstate(invalid="ignore", divide="ignore"):
        spots, length = spots_on_screen(motion.source, motion.direction)
        inside = (np.abs(spots - np.array(area.centre)) <= area.size / 2).all(axis=-1) & makes_spot(length, motion.direction)
    return np.where(inside[..., None], spots, np.nan)


def _read(
    setup: SimulatedSetup,
    sensor: SimulatedSensor,
    kind: ReadingKind,
    p: Matrix,
    R: Array3,
    touched: Sequence[tuple[str, str, str]],
    rng: np.random.Generator,
    noise: ReadingNoise,
) -> Readings:
    n, none = len(p), np.full(len(p), "")
    if kind == "orientation":
        values = quaternions(np.array([pin.exp3(turn) for turn in rng.normal(0, 1, (n, 3)) * noise.angle]).reshape(n, 3, 3) @ R)
    elif kind == "point":
        values = p + rng.normal(0, 1, p.shape) * noise.length
    elif kind == "distance":
        end = setup.place(f"{sensor.target}:wire")
        values = np.linalg.norm(p - end, axis=1)[:, None] + rng.normal(0, 1, (n, 1)) * noise.length
    else:
        values, none = np.empty((n, 0)), np.array([label if (sensor.kind, sensor.target) == (k, t) else "" for k, t, label in touched])
    return Readings(kind, sensor.target, sensor.link, values, none, np.full(n, np.nan))


def _joined(parts: Sequence[Readings]) -> Readings:
    values, labels = np.concatenate([part.values for part in parts]), np.concatenate([part.labels for part in parts])
    return replace(parts[0], values=values, labels=labels, sigma=np.full(len(labels), np.nan))


