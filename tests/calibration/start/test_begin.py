"""`fit` on a rig that stands far from where the URDF has it, and on measurements with a mistake in them."""

from __future__ import annotations

import numpy as np
import pytest

from urdfcal.api import fit
from urdfcal.base.errors import FitRejected
from urdfcal.calibration.reach import ScreenArea, draw_poses
from urdfcal.model.gauge import build_error_model
from urdfcal.robot.robot import Robot
from urdfcal.simulation.readings import SimulatedNoise, simulate
from urdfcal.simulation.truth import random_truth


def test_a_rig_that_stands_far_off_is_found(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """With screen and module 300 mm and 20 deg off the fit ends at the noise and at the rig."""
    robot = robots["ur5"]
    errors = build_error_model(robot.chain, robot.rig)
    truth = rng.normal(0, 1, len(errors.names)) * np.where(np.array(errors.units) == "m", 2e-3, 3e-3)
    for name, value in {"screen.trans_y": 0.3, "screen.rot_z": 0.35, "slm.trans_x": 0.3, "slm.rot_y": 0.35}.items():
        truth[errors.names.index(name)] = value
    q = draw_poses(robot, errors, truth, 60, rng, area=ScreenArea(6.0))
    found = fit(robot, simulate(robot, errors, truth, q, rng, SimulatedNoise(1e-3)))
    assert found.converged
    assert found.estimate.noise.spot_sigma == pytest.approx(1e-3, rel=0.3)
    off = dict(zip(found.errors.names, (found.x - truth) / found.sigma, strict=True))
    assert abs(off["screen.rot_z"]) < 4
    assert abs(off["slm.rot_y"]) < 4


def test_a_mistake_in_the_data_is_named(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Swapped lasers stop the fit with one line that names them; without the check the data are fitted as they are."""
    robot = robots["panda"]
    model, truth = random_truth(robot, rng, 2e-3, np.radians(0.2))
    data = simulate(robot, model, truth, draw_poses(robot, model, truth, 60, rng), rng, SimulatedNoise(1e-3))
    swapped = data.with_spots(data.spots[:, ::-1])
    with pytest.raises(FitRejected, match="times better with laser_1 and laser_2 swapped"):
        fit(robot, swapped)
    as_they_are = fit(robot, swapped, sane=False)  # a module turned by 180 deg explains them as well
    assert "slm.rot_z" in as_they_are.errors.names


def test_healthy_data_pay_nothing(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Where the fit from the prior explains the spots, the start and the checks leave no trace."""
    robot = robots["panda"]
    model, truth = random_truth(robot, rng, 5e-3, np.radians(0.5))
    data = simulate(robot, model, truth, draw_poses(robot, model, truth, 60, rng), rng, SimulatedNoise(1e-3))
    plain, unchecked = fit(robot, data), fit(robot, data, sane=False)
    np.testing.assert_array_equal(plain.x, unchecked.x)
    assert plain.warnings == ()
