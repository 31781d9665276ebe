"""Simulated robots and their measurements."""

from __future__ import annotations

import numpy as np
import pytest

from urdfcal.base.errors import UsageError
from urdfcal.calibration.reach import ScreenArea, draw_poses
from urdfcal.model.gauge import build_error_model
from urdfcal.model.options import ModelOptions
from urdfcal.robot.configurations import joint_limits
from urdfcal.robot.robot import Robot
from urdfcal.simulation.readings import SimulatedNoise, noise_from, simulate, true_spots
from urdfcal.simulation.truth import random_truth, stated_truth


def test_noise_has_the_stated_size(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Gaussian noise has the stated standard deviation, uniform noise the stated half-width, on spots and turning joints."""
    robot = robots["tiago"]
    model, truth = random_truth(robot, rng, 1e-3, 1e-3)
    q = draw_poses(robot, model, truth, 3000, rng)
    exact = true_spots(robot, model, truth, q)
    for kind, size in (("gaussian", 1.0), ("uniform", 1 / np.sqrt(3))):
        data = simulate(robot, model, truth, q, rng, SimulatedNoise(2e-3, 1e-3, kind))  # type: ignore[arg-type]
        assert np.std(data.spots - exact) == pytest.approx(2e-3 * size, rel=0.05)
        assert np.std((data.q - q)[:, 1:]) == pytest.approx(1e-3 * size, rel=0.05)
        np.testing.assert_array_equal(data.q[:, 0], q[:, 0])  # the torso slides


def test_readings_are_averaged(rng: np.random.Generator) -> None:
    """The mean of 100 readings has a tenth of the noise."""
    assert np.std(SimulatedNoise(readings=100).draw(rng, 1.0, (4000,))) == pytest.approx(0.1, rel=0.05)


def test_drawn_poses_are_on_the_screen_and_within_limits(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Every beam of every drawn pose falls on the stated part of the screen."""
    robot = robots["panda"]
    model, truth = random_truth(robot, rng, 5e-3, 5e-3)
    q = draw_poses(robot, model, truth, 200, rng, area=ScreenArea(1.0, (0.2, 0.1)))
    assert np.abs(true_spots(robot, model, truth, q) - [0.2, 0.1]).max() <= 0.5
    lower, upper = joint_limits(robot)
    assert ((q >= lower) & (q <= upper)).all()


def test_a_screen_that_is_never_hit_is_said(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Where random poses cannot be had the message says how many were found, and what to do."""
    model, truth = random_truth(robots["panda"], rng, 0.0, 0.0)
    with pytest.raises(UsageError, match=r"only 0 of .* random poses put every beam on the screen"):
        draw_poses(robots["panda"], model, truth, 5, rng, area=ScreenArea(0.01, (50.0, 0.0)))


def test_the_same_seed_gives_the_same_measurements(robots: dict[str, Robot]) -> None:
    """Randomness comes from the generator that is passed, and from nowhere else."""
    robot = robots["ur5"]

    def run() -> np.ndarray:
        rng = np.random.default_rng(7)
        model, truth = random_truth(robot, rng, 1e-3, 1e-3)
        return simulate(robot, model, truth, draw_poses(robot, model, truth, 20, rng), rng, SimulatedNoise(1e-3)).spots

    np.testing.assert_array_equal(run(), run())


def test_stated_errors_are_taken_by_name(robots: dict[str, Robot]) -> None:
    """Errors are named as parameters; a name that is none is refused with the nearest."""
    errors = build_error_model(robots["arm7"].chain, robots["arm7"].rig, ModelOptions(error_model="dh"))
    x = stated_truth(errors, {"joint3.d_alpha": 0.02})
    assert np.flatnonzero(x).tolist() == [errors.names.index("joint3.d_alpha")]
    with pytest.raises(UsageError, match=r"did you mean 'joint3.d_alpha'"):
        stated_truth(errors, {"joint3.dalpha": 0.02})


def test_noise_that_makes_no_sense_is_refused() -> None:
    """Negative noise and unknown distributions are refused."""
    for arguments in ((-1.0, 0.0, "gaussian"), (1.0, 0.0, "poisson"), (1.0, 0.0, "gaussian", 0)):
        with pytest.raises(UsageError):
            noise_from(*arguments)
