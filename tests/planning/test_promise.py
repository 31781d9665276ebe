"""What a plan promises of the tool is what fits of its poses come to. Everything is simulated."""

from __future__ import annotations

import numpy as np
import pytest

import urdfcal
from tests.calibration.analysis.test_prediction import tool_errors
from urdfcal.model.gauge import build_error_model
from urdfcal.robot.configurations import joint_limits
from urdfcal.robot.robot import Robot
from urdfcal.simulation.readings import SimulatedNoise, simulate


@pytest.mark.slow
def test_fits_of_planned_poses_are_as_far_off_as_promised(robots: dict[str, Robot]) -> None:
    """Twenty robots drawn from the prior, 24 planned poses of lasers each: the tool's RMS error over the workspace is that predicted."""
    robot = robots["ur5"]
    errors, noise, off, promised = build_error_model(robot.chain, robot.rig), 1e-3, [], []
    for seed in range(20):
        rng = np.random.default_rng(seed)
        truth = errors.mean + 0.3 * errors.sigma * rng.normal(size=len(errors.names))
        plan = urdfcal.plan_poses(robot, candidates=400, n=24, seed=seed, spot_sigma=noise)
        data = simulate(robot, errors, truth, plan.q, rng, SimulatedNoise(noise))
        found = urdfcal.fit(robot, data, spot_sigma=noise, gated=False, evidence=False, asking=False, sane=False)
        workspace = rng.uniform(*joint_limits(robot), (60, len(robot.chain.inputs)))
        off.append(float(tool_errors(robot, errors, truth, found.x[None], "slm", workspace)[0].mean()))
        promised.append(plan.tool_sigma_mm[-1] ** 2)
    assert 1e3 * np.sqrt(np.mean(off)) == pytest.approx(np.sqrt(np.mean(promised)), rel=0.2)
