"""Outliers judged with everything in the model that the data ask for: sagging arms, joints that hang back, and arms that do neither."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.benchmarks.outliers import with_outliers
from tests.support.sagging import SaggingArm, sagging_arm
from urdfcal.api import fit
from urdfcal.base.geometry import MM, Mask
from urdfcal.calibration.analysis.sag import fit_sag
from urdfcal.calibration.error_table import rms_of
from urdfcal.calibration.outliers import fit_without_outliers
from urdfcal.calibration.problem import Problem
from urdfcal.calibration.reach import draw_poses
from urdfcal.estimation.ekf import Belief
from urdfcal.estimation.estimators import Method
from urdfcal.estimation.noise import Noise
from urdfcal.model.error_model import with_softness
from urdfcal.model.gauge import build_error_model
from urdfcal.model.gravity import Gravity, WeighedRobot
from urdfcal.model.softness import extra_terms
from urdfcal.robot.robot import Robot
from urdfcal.sensors.measurements import Measurements
from urdfcal.simulation.readings import SimulatedNoise, simulate
from urdfcal.simulation.truth import random_truth


@pytest.fixture(scope="module")
def sagging(robots: dict[str, Robot]) -> SaggingArm:
    """An arm with lasers that sags, a tenth of its poses near upright."""
    return sagging_arm(robots["arm7"], "laser", 4)


def left_out(data: Measurements) -> Mask:
    """Which readings a fit left out, (n, readings)."""
    return np.column_stack([~reading.measured.any(axis=1) for reading in data.readings])


def kept_with_geometry_alone(robot: Robot, data: Measurements) -> Mask:
    """Which readings a gate keeps that knows nothing else, (n, readings)."""
    errors, noise, method = build_error_model(robot.chain, robot.rig), Noise(1 * MM, np.zeros(data.q.shape[1]), stated=False), Method()
    prior, model = Belief.independent(errors.mean, errors.sigma), Problem(errors, data)
    clean = fit_without_outliers(method, model, prior, noise, method.run(model.linearise, prior, noise))
    return ~left_out(clean.model.data)


@pytest.mark.parametrize("estimator", ["ekf", "lse", "robust"])
def test_readings_that_sag_explains_are_kept(sagging: SaggingArm, estimator: str) -> None:
    """Geometry alone takes good readings of an arm that sags for outliers, near upright above all; with sag every one is kept."""
    kept = kept_with_geometry_alone(sagging.robot, sagging.fit)
    assert np.count_nonzero(~kept) >= 10
    assert (~kept[sagging.upright]).mean() > (~kept[~sagging.upright]).mean()
    found = fit(sagging.robot, sagging.fit, estimator=estimator)
    assert found.converged
    assert found.outliers == ()
    assert found.beyond == ("sag",)
    assert found.regained == np.count_nonzero(~kept) or estimator == "robust"


def test_bad_readings_of_an_arm_that_sags_are_told(sagging: SaggingArm, rng: np.random.Generator) -> None:
    """Of an arm that sags exactly the spots that were thrown off are left out, and with sag its test poses are as if that had been told."""
    thrown = with_outliers(sagging.fit, 0.05, rng)
    hit = (thrown.spots != sagging.fit.spots).any(axis=-1)
    found = fit(sagging.robot, thrown)
    np.testing.assert_array_equal(left_out(found.data), hit)
    sag, told = fit_sag(found, folds=0), fit_sag(fit(sagging.robot, thrown.without(hit), gated=False), folds=0)
    assert sag is not None
    assert told is not None
    np.testing.assert_allclose(sag.estimate.belief.x, told.estimate.belief.x, atol=1e-4)


@pytest.mark.parametrize("share", [0.05, 0.2])
def test_scattered_outliers_of_a_rigid_arm_ask_for_nothing(robots: dict[str, Robot], rng: np.random.Generator, share: float) -> None:
    """Outliers of a rigid arm are judged by geometry alone, and are the same as without any other judge."""
    robot = robots["panda"]
    errors, truth = random_truth(robot, rng, 1 * MM, 1e-3)
    data = with_outliers(simulate(robot, errors, truth, draw_poses(robot, errors, truth, 60, rng), rng, SimulatedNoise(1 * MM)), share, rng)
    found = fit(robot, data)
    assert found.beyond == found.together == ()
    np.testing.assert_array_equal(~left_out(found.data), kept_with_geometry_alone(robot, data))


def test_joints_that_hang_back_are_no_outliers(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Poses that were reached from the other side than most are kept where the data say from which side."""
    robot = robots["panda"]
    rigid, x = random_truth(robot, rng, 0.5 * MM, 0.5e-3)
    terms = extra_terms(robot.chain, ["approach"])
    errors = with_softness(rigid, terms, WeighedRobot(robot, Gravity()), robot.rig.tip)
    truth = np.concatenate([x, np.full(len(terms), 0.4e-3)])
    q = draw_poses(robot, rigid, x, 120, rng)
    approach = np.where(np.arange(120)[:, None] % 12 == 0, -1.0, 1.0) * np.ones_like(q)
    blank = replace(simulate(robot, rigid, x, q, rng), approach=approach)
    spots = np.stack(Problem(errors, blank).read(truth), axis=1)
    data = blank.with_spots(spots + rng.normal(0, 0.05 * MM, spots.shape))
    assert not kept_with_geometry_alone(robot, data).all()
    found = fit(robot, data)
    assert found.outliers == ()
    assert found.beyond[-1] == "approach"
    assert fit(robot, replace(data, approach=None)).outliers != ()


def test_upright_poses_gain_by_what_is_kept(robots: dict[str, Robot]) -> None:
    """At upright poses that were not fitted a robot is better calibrated with its upright readings kept than as geometry's gate has it."""
    arm = sagging_arm(robots["ur5"], "pose:tool0", 1)
    poor = arm.fit.without(np.repeat(arm.upright[:, None], 2, axis=1))
    upright = arm.test.subset(arm.test_upright)
    found, other = fit(arm.robot, arm.fit, test=upright), fit(arm.robot, poor, test=upright)
    assert found.test is not None
    assert other.test is not None
    assert rms_of(found.test[1]) < rms_of(other.test[1])
    assert rms_of(found.test[1]) < rms_of(found.test[0])
