"""Beams that a wrong joint reading turns away from the screen, and gross outliers in poses that were not fitted."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from urdfcal.calibration.outliers import CleanFit, fit_without_outliers, without_gross_outliers
from urdfcal.calibration.problem import Problem
from urdfcal.calibration.reach import draw_poses
from urdfcal.estimation.ekf import Belief
from urdfcal.estimation.estimators import Method
from urdfcal.estimation.noise import Noise
from urdfcal.estimation.robust import Observations, gross_outliers
from urdfcal.model.error_model import ErrorModel
from urdfcal.model.gauge import build_error_model
from urdfcal.robot.robot import Robot
from urdfcal.sensors.measurements import Measurements
from urdfcal.simulation.readings import SimulatedNoise, simulate

POSE = 7


def measured(robot: Robot, rng: np.random.Generator) -> tuple[ErrorModel, np.ndarray, Measurements]:
    """60 noisy poses of a robot with random errors, and these."""
    errors = build_error_model(robot.chain, robot.rig)
    truth = rng.normal(0, np.where(np.array(errors.units) == "m", 3e-3, np.radians(0.3)))
    data = simulate(robot, errors, truth, draw_poses(robot, errors, truth, 60, rng), rng, SimulatedNoise(1e-3))
    return errors, truth, data


def clean_fit(errors: ErrorModel, data: Measurements, estimator: str = "ekf", start: np.ndarray | None = None) -> CleanFit:
    """The fit of some measurements, outliers taken out."""
    method, model, noise = Method(estimator, start=start), Problem(errors, data), Noise(1e-3, np.zeros(data.q.shape[1]), stated=False)
    prior = Belief.independent(errors.mean, errors.sigma)
    return fit_without_outliers(method, model, prior, noise, method.run(model.linearise, prior, noise))


@pytest.mark.parametrize("estimator", ["ekf", "robust"])
@pytest.mark.parametrize("name", ["arm7", "panda", "ur5"])
def test_a_pose_with_a_wrong_reading_is_left_out(robots: dict[str, Robot], rng: np.random.Generator, name: str, estimator: str) -> None:
    """Whichever joint is read 90 deg wrong in one pose, its spots are named, and the fit is that of the other poses."""
    errors, _, data = measured(robots[name], rng)
    expected = clean_fit(errors, data.subset(np.arange(60) != POSE), estimator)
    sigma, turned_away = np.sqrt(np.diag(expected.estimate.belief.P)), 0
    for joint in range(data.q.shape[1]):
        q = data.q.copy()
        q[POSE, joint] += np.pi / 2
        found = clean_fit(errors, replace(data, q=q), estimator)
        named = {(outlier.pose, outlier.laser) for outlier in found.outliers}
        assert {(f"pose {POSE + 1}", laser) for laser in data.lasers} <= named
        assert len(named) <= 3
        assert found.estimate.converged
        assert np.abs((found.estimate.belief.x - expected.estimate.belief.x) / sigma).max() < 0.7
        turned_away += any(outlier.distance_mm is None and "does not meet the screen" in outlier.reason for outlier in found.outliers)
    assert turned_away


def test_good_spots_are_let_back_in(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Where the fit starts at a module that looks away with some of its beams, all of them count in the end."""
    errors, _, data = measured(robots["panda"], rng)
    start = errors.mean.copy()
    start[errors.names.index("slm.rot_y")] = np.radians(35)
    missed = Problem(errors, data).linearise(start).lost
    assert 0 < missed.mean() < 0.4
    found, expected = clean_fit(errors, data, start=start), clean_fit(errors, data)
    assert found.outliers == ()
    assert found.estimate.converged
    np.testing.assert_allclose(found.estimate.belief.x, expected.estimate.belief.x, atol=1e-7)


def test_a_rig_that_looks_the_other_way_is_no_matter_of_outliers(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Where most beams miss the screen the fit says so and names none of them."""
    errors, _, data = measured(robots["panda"], rng)
    start = errors.mean.copy()
    start[errors.names.index("slm.rot_y")] = np.pi
    for estimator in ("ekf", "robust"):
        found = clean_fit(errors, data, estimator, start)
        assert found.estimate.stop == "left_screen"
        assert found.outliers == ()


def test_a_set_without_some_spots_is_the_model_of_the_others(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Residuals and Jacobian without some spots are those of measurements in which they were not seen."""
    errors, truth, data = measured(robots["ur5"], rng)
    kept = rng.random(data.seen.shape) < 0.7
    found = Observations.of(Problem(errors, data).linearise, truth).at(truth, kept)
    expected = Problem(errors, data.with_spots(np.where(kept[..., None], data.spots, np.nan))).linearise(truth)
    np.testing.assert_array_equal(found.measured, expected.measured)
    np.testing.assert_array_equal(found.residual, expected.residual)
    np.testing.assert_array_equal(found.jacobian, expected.jacobian)


def held_out(robot: Robot, rng: np.random.Generator, gross: float, worse: float) -> tuple[np.ndarray, np.ndarray]:
    """Which spots of 20 poses were thrown off by `gross` [m], all of them worse than the fit knows; and which are called outliers."""
    errors, _, data = measured(robot, rng)
    found = clean_fit(errors, data.subset(np.arange(60) < 40)).estimate
    unseen = data.subset(np.arange(60) >= 40)
    hit = rng.random(unseen.seen.shape) < 0.2
    angle = rng.uniform(0, 2 * np.pi, hit.shape)
    off = worse * rng.normal(size=unseen.spots.shape) + hit[..., None] * gross * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    model = Problem(errors, unseen.with_spots(unseen.spots + off))
    return hit, gross_outliers(Observations.of(model.linearise, found.belief.x), found)


@pytest.mark.parametrize("name", ["arm7", "panda", "ur5"])
def test_gross_outliers_of_unseen_poses_are_told(robots: dict[str, Robot], rng: np.random.Generator, name: str) -> None:
    """Of poses that were not fitted exactly the spots thrown off by centimetres are called outliers."""
    hit, found = held_out(robots[name], rng, gross=0.05, worse=0.0)
    np.testing.assert_array_equal(found, hit)


def test_a_calibration_that_fails_has_no_outliers(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Where all unseen spots are centimetres off, that is the calibration's fault, and none is taken for an outlier."""
    hit, found = held_out(robots["panda"], rng, gross=0.0, worse=0.02)
    assert hit.any()
    assert not found.any()


def test_an_unseen_pose_whose_beams_miss_is_an_outlier(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """A wrong reading in a pose that was not fitted is told by its beams, and no other pose is."""
    errors, _, data = measured(robots["panda"], rng)
    found = clean_fit(errors, data).estimate
    q = data.q.copy()
    q[POSE, 5] += np.pi / 2
    spots = Observations.of(Problem(errors, replace(data, q=q)).linearise, found.belief.x)
    assert spots.linearise(found.belief.x).lost[POSE].any()
    assert np.flatnonzero(gross_outliers(spots, found).any(axis=1)).tolist() == [POSE]
    left, outliers = without_gross_outliers(Problem(errors, replace(data, q=q)), found)
    assert {outlier.pose for outlier in outliers} == {f"pose {POSE + 1}"}
    np.testing.assert_array_equal(left.data.seen, ~gross_outliers(spots, found))
    assert without_gross_outliers(Problem(errors, data), found)[1] == ()
