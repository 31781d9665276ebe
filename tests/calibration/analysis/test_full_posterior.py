"""What the data leave of every error of the robot, against batch algebra and the fit's own robot."""

from __future__ import annotations

import numpy as np
import pytest

from tests.support.sensor_cases import CASES, NOISE, setup_of
from urdfcal.api import Calibration, fit
from urdfcal.calibration.analysis.full_posterior import full_posterior
from urdfcal.calibration.analysis.more_poses import covariance
from urdfcal.calibration.problem import problem_of
from urdfcal.calibration.reach import draw_poses
from urdfcal.model.parameters import PriorScale
from urdfcal.robot.robot import Robot
from urdfcal.simulation.readings import SimulatedNoise, simulate, simulate_readings
from urdfcal.simulation.truth import random_truth


def of_lasers(robot: Robot, poses: int = 40, **options: object) -> Calibration:
    """A fit of simulated spots."""
    rng = np.random.default_rng(3)
    model, truth = random_truth(robot, rng, 2e-3, np.radians(0.2))
    data = simulate(robot, model, truth, draw_poses(robot, model, truth, poses, rng), rng, SimulatedNoise(0.5e-3))
    return fit(robot, data, **options)  # type: ignore[arg-type]


def of_readings(name: str, robots: dict[str, Robot], poses: int = 40) -> Calibration:
    """A fit of what simulated sensors read."""
    rng = np.random.default_rng(3)
    setup = setup_of(CASES[name], robots, rng)
    return fit(setup.robot, simulate_readings(setup, poses, rng, NOISE))


@pytest.mark.parametrize("name", ["lasers", "dh", "offset", "pose", "reference carried", "head camera", "socket", "sessions"])
def test_it_stands_where_the_fit_does(robots: dict[str, Robot], name: str) -> None:
    """In six errors a joint the calibrated robot has the same origins and leaves the same residuals as in the fit's own parameters."""
    models = {"lasers": "auto", "dh": "dh", "offset": "offset"}
    found = of_lasers(robots["panda"], error_model=models[name]) if name in models else of_readings(name, robots)
    full, noise = full_posterior(found), found.estimate.noise
    own, wide = found.errors.corrected_origins(found.x), full.errors.corrected_origins(full.x)
    assert set(own) <= set(wide)
    for joint, origin in own.items():
        np.testing.assert_allclose(wide[joint].homogeneous, origin.homogeneous, atol=1e-12)
    residuals = [
        problem_of(errors, found.data, noise).linearise(x).residual for errors, x in ((found.errors, found.x), (full.errors, full.x))
    ]
    rows = len(found.data)
    np.testing.assert_allclose(residuals[1][:rows], residuals[0][:rows], atol=1e-10)
    assert sum(parameter.kind == "joint" for parameter in full.errors.parameters) == 6 * len(found.robot.chain.moving)


def test_mean_and_covariance_are_those_of_batch_algebra(robots: dict[str, Robot]) -> None:
    """P = (H'H + D^-2)^-1, mean = P H' y, by plain inversion."""
    full = full_posterior(of_lasers(robots["ur5"]))
    H, D = full.whitened, np.diag(full.errors.sigma**-2.0)
    np.testing.assert_allclose(full.P, np.linalg.inv(H.T @ H + D), rtol=1e-4, atol=1e-12)
    assert np.abs((full.mean - full.x) / np.sqrt(np.diag(full.P))).max() < 3


def test_priors_that_are_stated_stay(robots: dict[str, Robot]) -> None:
    """What the user says of the joints' errors is what all six of them are taken to be."""
    full = full_posterior(of_lasers(robots["ur5"], priors={"joint": PriorScale(3e-3, 4e-3)}))
    joints = [(parameter.unit, parameter.sigma) for parameter in full.errors.parameters if parameter.kind == "joint"]
    assert set(joints) == {("m", 3e-3), ("rad", 4e-3)}


def test_joints_of_which_something_is_fixed_stay_as_they_are(robots: dict[str, Robot]) -> None:
    """What the user says is known is not taken to be wrong in directions that the error model has no name for."""
    found = of_lasers(robots["ur5"], fix=["elbow_joint.*", "wrist_1_joint.d_a"])
    names = [parameter.name for parameter in full_posterior(found).errors.parameters]
    assert not any(name.startswith("elbow_joint.") for name in names)
    assert {name for name in names if name.startswith("wrist_1")} == {name for name in found.errors.names if name.startswith("wrist_1")}
    assert sum(name.startswith("wrist_2_joint.") for name in names) == 6


@pytest.mark.parametrize("poses", [12, 40])
def test_priors_that_are_not_stated_follow_the_data(robots: dict[str, Robot], poses: int) -> None:
    """From the priors of any robot, 10 mm and 1 deg, the scales come within a factor of two of the 2 mm and 0.2 deg that were drawn."""
    full = full_posterior(of_lasers(robots["ur5"], poses))
    scale = max(parameter.sigma for parameter in full.errors.parameters if parameter.kind == "joint" and parameter.unit == "m")
    assert 1e-3 < scale < 4e-3


def test_priors_of_any_width_have_a_covariance(rng: np.random.Generator) -> None:
    """Information of rank two under priors from nanometres to kilometres gives a covariance that is positive and no wider than they."""
    H, sigma = rng.normal(size=(2, 6)) * 1e6, 10.0 ** np.linspace(-9, 3, 6)
    P = covariance(H.T @ H, sigma)
    assert np.isfinite(P).all()
    assert np.linalg.eigvalsh(P / np.outer(sigma, sigma)).min() >= -1e-12
    assert np.all(np.diag(P) <= sigma**2 * (1 + 1e-9))
