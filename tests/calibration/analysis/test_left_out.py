"""Cross-validation by subtraction against fits of the poses that are left."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.support.sensor_cases import CASES, NOISE, setup_of
from urdfcal.api import fit
from urdfcal.calibration.analysis.left_out import LeftOut
from urdfcal.calibration.problem import Problem, problem_of
from urdfcal.estimation.ekf import Belief, iterated_schedule
from urdfcal.robot.robot import Robot
from urdfcal.sensors.joined import joined
from urdfcal.simulation.readings import simulate_readings


@pytest.mark.parametrize(("name", "joint", "again"), [("point", 0.0, True), ("lasers and points", 0.0, False), ("pose", 2e-4, False)])
def test_poses_are_left_out_as_by_another_fit(
    name: str, joint: float, again: bool, robots: dict[str, Robot], rng: np.random.Generator
) -> None:
    """What is left out lies where a fit of all others from the start has it, to a hundredth of the noise, in one step or several."""
    setup = setup_of(CASES[name], robots, rng)
    data = simulate_readings(setup, 30, rng, replace(NOISE, joint=joint))
    data = joined([data, data.subset(np.arange(6))]) if again else data
    found = fit(setup.robot, data, joint_sigma=joint, gated=False, asking=False)
    model, noise = problem_of(found.errors, data, found.estimate.noise), found.estimate.noise.hold()
    left, prior = LeftOut(model, found.estimate), Belief.independent(found.errors.mean, found.errors.sigma)
    for held in (np.arange(5), np.arange(6, 30)):
        rows = np.flatnonzero(np.isin(data.configuration_of, data.configuration_of[held]))
        kept = problem_of(found.errors, data.subset(np.setdiff1d(np.arange(len(data)), rows)), noise)
        x = iterated_schedule(kept.linearise, prior, noise, start=found.x).belief.x
        expected, own = Problem(found.errors, data.subset(rows)).linearise(x), left.of(rows)
        off = (own.residual - expected.residual) / noise.of_numbers(expected)
        assert np.abs(off).max() < 1e-2, held
