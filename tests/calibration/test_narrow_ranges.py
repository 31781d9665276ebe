"""Joints that hardly move leave flat valleys, along which a filter creeps."""

from __future__ import annotations

import numpy as np
import pytest

import urdfcal
from urdfcal.base.geometry import DEG, MM
from urdfcal.calibration.problem import problem_of
from urdfcal.robot.configurations import joint_limits
from urdfcal.robot.robot import Robot
from urdfcal.simulation import readings
from urdfcal.simulation.readings import ReadingNoise, simulate_readings
from urdfcal.simulation.setup import parse_sensors, seen_with, simulated_setup
from urdfcal.simulation.truth import random_truth


@pytest.mark.parametrize(("name", "sensor"), [("ur5", "distance:tool0"), ("panda", "distance:panda_link8"), ("ur5", "inclination:tool0")])
@pytest.mark.parametrize("seed", range(3))
def test_joints_that_hardly_move_are_fitted(
    name: str, sensor: str, seed: int, robots: dict[str, Robot], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Within 1 to 8 deg a joint, behind coarse noise, the fit comes to rest, and at rest nothing pulls at it any more."""
    rng = np.random.default_rng(seed)
    sensors, _ = parse_sensors([sensor], robots[name], 1)
    robot = seen_with(robots[name], sensors)
    lower, upper = joint_limits(robot)
    width = rng.uniform(1 * DEG, 8 * DEG, len(lower))
    q = rng.uniform(lower, upper - width) + rng.uniform(0, 1, (127, len(lower))) * width
    monkeypatch.setattr(readings, "random_positions", lambda *_: q)
    setup = simulated_setup(robot, *random_truth(robot, rng, 2 * MM, 0.2 * DEG), sensors, rng)
    data = simulate_readings(setup, len(q), rng, ReadingNoise(length=20 * MM, angle=3 * DEG))
    found = urdfcal.fit(setup.robot, data, sane=False, evidence=False, gated=False)
    assert found.converged
    noise = found.estimate.noise
    here = problem_of(found.errors, found.data, noise).linearise(found.x)
    weights = noise.weights(here)
    gradient = weights.residual(here) @ weights.jacobian(here) - (found.x - found.errors.mean) / found.errors.sigma**2
    assert np.sqrt(gradient @ found.covariance @ gradient) < 1e-3
    assert len(found.estimate.history) < 40
