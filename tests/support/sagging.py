"""Arms that sag, measured in working poses and in a few near upright: geometry alone fits the many, and is off at the few."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

import urdfcal
from urdfcal.base.geometry import DEG, MM, Mask, Matrix, Vector
from urdfcal.calibration.problem import Problem
from urdfcal.calibration.reach import draw_poses
from urdfcal.model.error_model import ErrorModel
from urdfcal.model.gravity import Gravity, WeighedRobot
from urdfcal.robot.configurations import joint_limits
from urdfcal.sensors.readings import Readings
from urdfcal.sensors.registry import SENSORS
from urdfcal.simulation.readings import ReadingNoise, simulate_readings
from urdfcal.simulation.setup import SimulatedSetup, parse_sensors, seen_with, simulated_setup
from urdfcal.simulation.truth import SagScales, random_truth, soft_truth

MRAD = 1e-3
NOISE = ReadingNoise(spot=0.1 * MM, length=0.1 * MM, angle=0.02 * DEG)
_DRAWN, _IN_VIEW = 4000, 1500
_LOADED = 0.3  # of the largest moment about any joint's axis, above which gravity loads a joint
_FREE, _WORKING, _UPRIGHT = 2.0, 0.3, 0.2  # [rad] how far joints go from their midst: unloaded ones, and loaded ones in both sorts of poses


@dataclass(frozen=True)
class SaggingArm:
    """A simulated arm whose joints give way, measured.

    Attributes:
        robot: Nominal.
        errors: Error model of the truth.
        x: The truth.
        fit, test: Measurements, a share of both near upright.
        upright, test_upright: Which of the poses these are.
    """

    robot: urdfcal.Robot
    errors: ErrorModel
    x: Vector
    fit: urdfcal.Measurements
    test: urdfcal.Measurements
    upright: Mask
    test_upright: Mask


def sagging_arm(
    robot: urdfcal.Robot,
    sensor: str,
    seed: int,
    *,
    poses: int = 150,
    tested: int = 60,
    share: float = 0.1,
    error: tuple[float, float] = (0.3 * MM, 0.3 * MRAD),
    sag: tuple[float, float] = (1 * MRAD, 2 * MRAD),
) -> SaggingArm:
    """One arm with errors and sag.

    Args:
        robot: Nominal.
        sensor: `point:LINK`, `pose:LINK` or `laser`.
        seed: Of everything that is drawn.
        poses: How many are fitted.
        tested: How many are tested.
        share: Of both that are near upright.
        error: Standard deviation of the geometric errors, [m] and [rad].
        sag: Least and largest deflection of a joint about its own axis at its largest gravity moment, [rad]; across it 0.5 mrad.
    """
    rng = np.random.default_rng(seed)
    sensors, lasers = parse_sensors([sensor], robot, 1)
    robot = seen_with(robot, sensors, "", lasers)
    errors, x = random_truth(robot, rng, *error)
    errors, x = soft_truth(robot, errors, x, SagScales(own=1 * MRAD, across=0.5 * MRAD), rng)
    assert errors.soft is not None
    own = [errors.names.index(term.name) for term in errors.soft.terms if term.axis is None]
    x[own] = rng.uniform(*sag, len(own))
    setup = simulated_setup(robot, errors, x, sensors, rng)
    in_view = draw_poses(robot, errors, x, _IN_VIEW, rng) if lasers else None
    sets = [_drawn(robot, number, round(share * number), rng, in_view) for number in (poses, tested)]
    fitted, other = (_read(setup, q, rng) for q, _ in sets)
    return SaggingArm(robot, setup.errors, setup.x, fitted, other, sets[0][1], sets[1][1])


def _drawn(robot: urdfcal.Robot, count: int, upright: int, rng: np.random.Generator, in_view: Matrix | None) -> tuple[Matrix, Mask]:
    """Poses whose gravity moments are large, among them some in which they are small, and which these are."""
    lower, upper = joint_limits(robot)
    seen = np.random.default_rng(0).uniform(lower, upper, (_DRAWN, len(lower))) if in_view is None else in_view
    moments = WeighedRobot(robot, Gravity()).moments(seen)
    load = np.linalg.norm(moments, axis=(1, 2))
    order = rng.permutation(count)
    if in_view is not None:
        ranked = np.argsort(load)
        light, heavy = ranked[: len(ranked) // 10], ranked[len(ranked) // 2 :]
        q = np.vstack([seen[rng.choice(heavy, count - upright, replace=False)], seen[rng.choice(light, upright, replace=False)]])
        return q[order], order >= count - upright
    axes = np.array([step.joint.axis for step in robot.chain.moving])
    about = np.abs(np.einsum("njk,jk->nj", moments, axes)).max(axis=0)
    loaded = about > _LOADED * about.max()
    q = [
        centre + rng.uniform(-1, 1, (number, len(lower))) * np.where(loaded, width, _FREE)
        for centre, number, width in ((seen[load.argmax()], count - upright, _WORKING), (seen[load.argmin()], upright, _UPRIGHT))
    ]
    return np.clip(np.vstack(q), lower, upper)[order], order >= count - upright


def _read(setup: SimulatedSetup, q: Matrix, rng: np.random.Generator) -> urdfcal.Measurements:
    """What the instruments read at some poses."""
    data = replace(simulate_readings(setup, len(q), rng), q=q)
    values = Problem(setup.errors, data).read(setup.x)
    return replace(data, readings=tuple(_noisy(one, own, rng) for one, own in zip(data.readings, values, strict=True)))


def _noisy(reading: Readings, values: Matrix, rng: np.random.Generator) -> Readings:
    how = SENSORS[reading.sensor]
    scale = NOISE.angle if how.words.unit == "deg" else NOISE.spot
    return replace(reading, values=how.disturbed(values, lambda shape: NOISE.draw(rng, scale, shape)))
