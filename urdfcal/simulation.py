"""A robot with known errors and its noisy measurements. Everything that comes from here is simulated."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from urdfcal.error_model import ErrorModel
from urdfcal.errors import UsageError, no_such
from urdfcal.frame_jacobian import ArmKinematics, motion_at
from urdfcal.gauge import ModelOptions, build_error_model
from urdfcal.geometry import DEG, MM, Array3, Matrix, Vector
from urdfcal.measurements import Mask, Measurements, measurements_from
from urdfcal.robot import Robot
from urdfcal.sensors import makes_spot, spots_on_screen
from urdfcal.spot_model import SpotModel

Distribution = Literal["gaussian", "uniform"]
_BATCH, _MOST_DRAWS, _LEAST_SHARE = 4096, 500_000, 0.005
_FREE_TURN = np.pi  # how far a continuous joint is turned either way
_LEAST_LENGTH = 0.1  # [m]; nearer to the screen the nominal robot's module may already stand behind it


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


@dataclass(frozen=True)
class ScreenArea:
    """The part of the screen plane that is there.

    Attributes:
        size: Side of the square, [m].
        centre: (y, z) of its middle, [m].
    """

    size: float = 3.0
    centre: tuple[float, float] = (0.0, 0.0)


def random_truth(robot: Robot, rng: np.random.Generator, translation: float, rotation: float) -> tuple[ErrorModel, Vector]:
    """Gaussian errors in all six directions of every joint, the mount and the screen, whatever can be seen of them.

    Args:
        robot: Nominal robot.
        rng: Source of randomness.
        translation: Standard deviation of each translation, [m].
        rotation: Standard deviation of each rotation, [rad].
    """
    errors = build_error_model(robot.chain, robot.rig, ModelOptions(error_model="placement"))
    scale = np.where(np.array(errors.units) == "m", translation, rotation)
    return errors, rng.normal(0.0, 1.0, len(scale)) * scale


def stated_truth(errors: ErrorModel, values: Mapping[str, float]) -> Vector:
    """The state with the named errors, [m] and [rad], and zero elsewhere.

    Raises:
        UsageError: a name is no parameter.
    """
    x = np.zeros(len(errors.names))
    for name, value in values.items():
        if name not in errors.names:
            raise UsageError(no_such("parameter", name, errors.names))
        x[errors.names.index(name)] = value
    return x


def draw_poses(
    robot: Robot,
    errors: ErrorModel,
    x: Vector,
    poses: int,
    rng: np.random.Generator,
    *,
    area: ScreenArea | None = None,
    limits: Matrix | None = None,
) -> Matrix:
    """Random joint positions at which every beam of the robot with errors x makes a spot on the screen.

    Args:
        robot: Nominal robot.
        errors: Error model of the truth.
        x: The truth, (p,).
        poses: How many.
        rng: Source of randomness.
        area: The screen.
        limits: Lower and upper limit of each measured joint, (2, inputs); by default the URDF's, and half a turn either way
            for a continuous joint.

    Returns:
        (poses, inputs), [rad] or [m].

    Raises:
        UsageError: such positions are too rare.
    """
    arm = ArmKinematics(robot.chain, errors.soft.bends if errors.soft is not None else ())
    placed, where = errors.placements(x).still(), area or ScreenArea()
    lower, upper = joint_limits(robot) if limits is None else limits
    found, drawn = np.empty((0, len(lower))), 0
    most = max(_MOST_DRAWS, int(poses / _LEAST_SHARE))
    while len(found) < poses and drawn < most:
        q = rng.uniform(lower, upper, (_BATCH, len(lower)))
        motion = motion_at(arm, placed, arm.chain_positions(q), yielding=errors.yielding_at(x, q))
        found, drawn = np.vstack([found, q[_on_screen(motion.source, motion.direction, where)]]), drawn + _BATCH
    if len(found) < poses:
        raise UsageError(
            f"only {len(found)} of {drawn} random poses put every beam on the screen, {poses} were asked for; "
            "move the screen or the module, or make the screen larger"
        )
    return found[:poses]


def joint_limits(robot: Robot) -> Matrix:
    """Lower and upper limits of the measured joints, (2, inputs); a continuous joint gets half a turn either way."""
    pairs = [(-_FREE_TURN, _FREE_TURN) if joint.type == "continuous" else (joint.lower, joint.upper) for joint in robot.chain.inputs]
    return np.array(pairs).T


def _on_screen(source: Array3, direction: Array3, area: ScreenArea) -> Mask:
    spots, length = spots_on_screen(source, direction)
    inside = (np.abs(spots - np.array(area.centre)) <= area.size / 2).all(axis=-1)
    return np.asarray((inside & makes_spot(length, direction, nearest=_LEAST_LENGTH)).all(axis=1))


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
    return measurements_from(robot, readings, spots + noise.draw(rng, noise.spot, spots.shape))


def true_spots(robot: Robot, errors: ErrorModel, x: Vector, q: Matrix) -> Array3:
    """The spots of the robot with errors x at q, (n, lasers, 2), [m]."""
    blank = measurements_from(robot, q, np.zeros((len(q), len(robot.rig.lasers), 2)))
    return SpotModel(replace(errors, sessions=("",)), blank).predict(x)[0]


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
