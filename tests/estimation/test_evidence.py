"""Prior scales chosen by the data."""

from __future__ import annotations

import numpy as np
import pytest

from urdfcal.api import fit
from urdfcal.calibration.reach import draw_poses
from urdfcal.estimation.ekf import Belief, iterated_schedule
from urdfcal.estimation.evidence import START_SCALES, by_evidence
from urdfcal.estimation.noise import Noise
from urdfcal.estimation.residual import Linearisation
from urdfcal.model.error_model import ErrorModel
from urdfcal.model.gauge import build_error_model
from urdfcal.model.options import ModelOptions, ParameterPrior
from urdfcal.model.parameters import Parameter, PriorScale
from urdfcal.robot.robot import Robot
from urdfcal.simulation.readings import SimulatedNoise, simulate


def linear(rng: np.random.Generator, names: list[str], truth: np.ndarray, noise: float, n: int = 300) -> tuple[ErrorModel, object]:
    """A linear problem whose parameters are named as a robot's."""
    J = rng.normal(size=(n, len(names)))
    y = J @ truth + rng.normal(0, noise, n)
    ones = np.ones((n, 1), dtype=bool)

    def linearise(x: np.ndarray) -> Linearisation:
        return Linearisation((y - J @ x)[:, None], J[:, None], np.empty((n, 1, 0)), ones, np.full((n, 1), np.nan))

    parameters = tuple(Parameter(name, "m" if name.endswith(("d_a", "d_d")) else "rad", "joint", 0.0, 0.01) for name in names)
    return ErrorModel(None, (), parameters), linearise  # type: ignore[arg-type]


def test_scales_and_noise_are_those_of_the_truth(rng: np.random.Generator) -> None:
    """With many parameters of each kind the chosen scales are the spread of the truth, and the noise is the noise."""
    names = [f"j{joint}.{last}" for joint in range(40) for last in ("d_a", "d_d", "d_alpha", "d_theta")]
    spread = np.array([{"d_a": 1e-3, "d_d": 1e-3, "d_alpha": 4e-3, "d_theta": 2e-2}[name.split(".")[1]] for name in names])
    errors, linearise = linear(rng, names, rng.normal(0, 1, len(names)) * spread, 2e-3, 1000)
    noise = Noise(1e-3, np.zeros(0), stated=False)
    first = iterated_schedule(linearise, Belief.independent(errors.mean, errors.sigma), noise)
    _, found, chosen = by_evidence(linearise, errors.prior(), noise, first)
    assert chosen.scales["translation"] == pytest.approx(1e-3, rel=0.25)
    assert chosen.scales["rotation"] == pytest.approx(4e-3, rel=0.35)
    assert chosen.scales["zero"] == pytest.approx(2e-2, rel=0.35)
    assert found.noise.spot_sigma == pytest.approx(2e-3, rel=0.1)


def test_groups_are_of_joints_alone() -> None:
    """Mount, screen and beams keep their stated priors."""
    kinds = {"joint1.d_a": "joint", "joint1.d_beta": "joint", "joint1.d_theta": "joint", "slm.rot_x": "mount", "screen.trans_x": "screen"}
    groups = [
        Parameter(name, "m" if name[-1] in "a" and "beta" not in name and "theta" not in name else "rad", kind, 0, 1).scale_group
        for name, kind in kinds.items()
    ]  # type: ignore[arg-type]
    assert groups == ["translation", "rotation", "zero", "", ""]


def test_a_perfect_robot_is_left_nearly_alone(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Where the joints have no errors the chosen scales shrink, and the estimate is nearer to zero than with the defaults."""
    robot = robots["ur5"]
    errors = build_error_model(robot.chain, robot.rig)
    zero = np.zeros(len(errors.names))
    data = simulate(robot, errors, zero, draw_poses(robot, errors, zero, 40, rng), rng, SimulatedNoise(1e-3))
    plain, chosen = fit(robot, data, evidence=False), fit(robot, data)
    assert chosen.evidence is not None
    assert chosen.evidence.scales["zero"] < START_SCALES["zero"]
    joints = np.array([parameter.kind == "joint" for parameter in errors.parameters])
    assert np.linalg.norm((chosen.x / errors.sigma)[joints]) < 0.75 * np.linalg.norm((plain.x / errors.sigma)[joints])


def test_stated_priors_stay(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """A prior that is stated for a parameter is kept; with one for all joints, or few poses, nothing is chosen."""
    robot = robots["ur5"]
    errors = build_error_model(robot.chain, robot.rig)
    zero = np.zeros(len(errors.names))
    data = simulate(robot, errors, zero, draw_poses(robot, errors, zero, 40, rng), rng, SimulatedNoise(1e-3))
    own = ModelOptions(single={"elbow_joint.d_a": ParameterPrior(sigma=5e-3)})
    found = fit(robot, data, options=own)
    assert dict(zip(found.errors.names, found.errors.sigma, strict=True))["elbow_joint.d_a"] == 5e-3
    assert fit(robot, data, priors={"joint": PriorScale(1e-3, 1e-3)}).evidence is None
    assert fit(robot, data.subset(np.arange(15))).evidence is None
    assert fit(robot, data, estimator="robust").evidence is None


def test_lse_chooses_what_the_filter_chooses(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Under scales chosen by evidence Levenberg-Marquardt and the filter agree, too, and both tell what they did."""
    robot = robots["panda"]
    errors = build_error_model(robot.chain, robot.rig)
    truth = rng.normal(0, 1e-3, len(errors.names))
    data = simulate(robot, errors, truth, draw_poses(robot, errors, truth, 40, rng), rng, SimulatedNoise(1e-3))
    ekf, lse = fit(robot, data), fit(robot, data, estimator="lse")
    assert ekf.evidence is not None
    assert lse.evidence is not None
    assert lse.evidence.scales == pytest.approx(ekf.evidence.scales, rel=1e-3)
    np.testing.assert_allclose(lse.x / ekf.sigma, ekf.x / ekf.sigma, atol=5e-3)


def test_what_is_determined_is_judged_against_stated_priors(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """A robot without errors gets tight scales by evidence; that the data say much of its parameters is said all the same."""
    robot = robots["ur5"]
    errors = build_error_model(robot.chain, robot.rig)
    zero = np.zeros(len(errors.names))
    data = simulate(robot, errors, zero, draw_poses(robot, errors, zero, 60, rng), rng, SimulatedNoise(0.2e-3))
    plain, chosen = fit(robot, data, evidence=False), fit(robot, data)
    assert chosen.identifiability.determined == plain.identifiability.determined
    assert chosen.identifiability.rank == plain.identifiability.rank
    assert (chosen.sigma < plain.sigma).sum() > len(errors.names) / 2
