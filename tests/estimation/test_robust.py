"""Outliers: weights, the gate, and beams that were read for each other."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from urdfcal.api import fit
from urdfcal.calibration.error_table import rms_of
from urdfcal.calibration.reach import draw_poses
from urdfcal.estimation.ekf import Belief, iterated_schedule
from urdfcal.estimation.noise import Noise
from urdfcal.estimation.residual import Block, Linearisation
from urdfcal.estimation.robust import Observations, _limits, degrees, inliers, mahalanobis_squared, robust_scale
from urdfcal.model.gauge import build_error_model
from urdfcal.robot.robot import Robot
from urdfcal.sensors.measurements import Measurements
from urdfcal.simulation.readings import SimulatedNoise, simulate
from urdfcal.simulation.truth import random_truth


@pytest.fixture
def clean(robots: dict[str, Robot], rng: np.random.Generator) -> Measurements:
    """80 noisy poses of a Panda with errors in six directions."""
    robot = robots["panda"]
    model, truth = random_truth(robot, rng, 3e-3, np.radians(0.3))
    return simulate(robot, model, truth, draw_poses(robot, model, truth, 80, rng), rng, SimulatedNoise(1e-3))


PAIRS = (Block("one", slice(0, 2)), Block("other", slice(2, 4)))


@pytest.mark.parametrize("numbers", [1, 2, 3])
def test_chance_and_scale_are_right_for_any_number_of_numbers(numbers: int, rng: np.random.Generator) -> None:
    """The robust scale of Gaussian residuals is 1, and the limit of a clean set is passed about as seldom as it says."""
    n = 200_000
    blocks = (Block("target", slice(0, numbers)),)
    residual, blank = rng.normal(size=(n, numbers)), np.full((n, numbers), np.nan)
    here = Linearisation(residual, np.zeros((n, numbers, 1)), np.empty((n, numbers, 0)), blank != 0, blank, blocks=blocks)
    d2 = mahalanobis_squared(here, Noise(1.0, np.zeros(0)))
    assert robust_scale(d2, degrees(here)) == pytest.approx(1.0, rel=0.01)
    few = replace(here, residual=residual[:100], measured=here.measured[:100], stated_sigma=blank[:100])
    share = float(np.mean(d2 > _limits(few)[0, 0]))  # a hundredth of the sets of a hundred lose one
    assert 0.5e-4 < share < 2e-4


def test_what_is_known_beforehand_is_no_reading(rng: np.random.Generator) -> None:
    """A known row is never taken out, however far off, and does not count where it is asked whether too many readings are."""
    n, known = 40, 40
    blocks, rows = (Block("target", slice(0, 1)),), n + known
    residual, blank = rng.normal(size=(rows, 1)), np.full((rows, 1), np.nan)
    residual[-1] = 1e4
    J = np.zeros((rows, 1, 1))
    here = Linearisation(residual, J, np.empty((rows, 1, 0)), blank != 0, blank, blocks=blocks, known=known)
    prior, noise = Belief.independent(np.zeros(1), np.ones(1)), Noise(1.0, np.zeros(0))
    observed = Observations.of(lambda _: here, prior.x)
    found = iterated_schedule(lambda _: here, prior, noise)
    assert inliers(observed, prior, found).all()
    assert observed.too_few(np.arange(rows)[:, None] >= n // 2)
    assert not observed.too_few(np.arange(rows)[:, None] < n)
    assert _limits(here)[0, 0] == _limits(here.of_poses(n))[0, 0]


def test_squared_distances_are_chi_squared_of_two(rng: np.random.Generator) -> None:
    """For Gaussian residuals with joint noise the squared distances have mean 2 and the robust scale 1."""
    n = 4000
    J_q = rng.normal(size=(n, 4, 2))
    noise = Noise(0.5, np.array([0.3, 0.2]))
    residual = 0.5 * rng.normal(size=(n, 4)) + (J_q @ (rng.normal(size=(n, 2)) * noise.joint_sigma)[..., None])[..., 0]
    here = Linearisation(residual, np.zeros((n, 4, 1)), J_q, np.ones((n, 4), dtype=bool), np.full((n, 4), np.nan), blocks=PAIRS)
    d2 = mahalanobis_squared(here, noise)
    assert d2.mean() == pytest.approx(2.0, rel=0.05)
    assert robust_scale(d2) == pytest.approx(1.0, rel=0.03)


def test_clean_data_lose_nothing(robots: dict[str, Robot], clean: Measurements) -> None:
    """Without outliers the gate leaves the fit exactly as it is."""
    gated, plain = (fit(robots["panda"], clean, gated=gated) for gated in (True, False))
    assert gated.outliers == ()
    np.testing.assert_array_equal(gated.x, plain.x)


@pytest.mark.parametrize("stated", [None, 1e-3], ids=["noise estimated", "noise stated"])
def test_gross_outliers_are_named_and_left_out(
    robots: dict[str, Robot], clean: Measurements, rng: np.random.Generator, stated: float | None
) -> None:
    """A fifth of the spots thrown off by centimetres is found, every one of them, and the estimate stays at the clean one."""
    hit = rng.random(clean.seen.shape) < 0.2
    spots = clean.spots + hit[..., None] * rng.choice([-0.1, 0.1], (*hit.shape, 2))
    found, expected = fit(robots["panda"], clean.with_spots(spots), spot_sigma=stated), fit(robots["panda"], clean, spot_sigma=stated)
    named = {(outlier.pose, outlier.laser) for outlier in found.outliers}
    thrown = {(f"pose {clean.poses[pose]}", clean.lasers[laser]) for pose, laser in np.argwhere(hit)}
    assert thrown <= named
    assert len(named - thrown) <= 2
    assert np.abs((found.x - expected.x) / found.sigma).max() < 3
    assert rms_of(found.after) < 2
    assert found.rejection == ""
    assert all("mm from where the other spots put it" in outlier.reason for outlier in found.outliers)


def test_the_robust_estimator_needs_no_gate(robots: dict[str, Robot], clean: Measurements, rng: np.random.Generator) -> None:
    """Student's t holds the estimate near the clean one under a fifth of outliers, and near the filter's without any."""
    hit = rng.random(clean.seen.shape) < 0.2
    spoilt = clean.with_spots(clean.spots + hit[..., None] * 0.08)
    expected = fit(robots["panda"], clean)
    for data in (clean, spoilt):
        found = fit(robots["panda"], data, estimator="robust")
        assert found.converged
        assert np.abs((found.x - expected.x) / expected.sigma).max() < 3.5


def test_swapped_beams_are_exchanged_and_said(robots: dict[str, Robot], clean: Measurements) -> None:
    """Poses at which one beam was read as the other are recognised, exchanged and named; the fit is the clean one."""
    spots = clean.spots.copy()
    spots[[3, 17, 40]] = spots[[3, 17, 40]][:, ::-1]
    found = fit(robots["panda"], clean.with_spots(spots))
    assert [outlier.pose for outlier in found.outliers] == ["pose 4", "pose 18", "pose 41"]
    assert all("read for each other" in outlier.reason for outlier in found.outliers)
    np.testing.assert_allclose(found.x, fit(robots["panda"], clean).x, atol=1e-9)


def test_evolution_ends_where_the_filter_does(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Differential evolution, polished, finds the same estimate as the filter: of the joints' zeros and the mount."""
    robot = robots["arm4"]
    model, truth = random_truth(robot, rng, 2e-3, np.radians(0.2))
    data = simulate(robot, model, truth, draw_poses(robot, model, truth, 40, rng), rng, SimulatedNoise(1e-3))
    found = fit(robot, data, estimator="evolution", spot_sigma=1e-3, error_model="offset", gated=False)
    expected = fit(robot, data, spot_sigma=1e-3, error_model="offset", gated=False)
    assert np.abs((found.x - expected.x) / expected.sigma).max() < 1e-6


@pytest.mark.parametrize("stated", [None, 1e-3])
@pytest.mark.parametrize("poses", [2, 4, 8, 12, 40])
def test_sigmas_of_the_robust_estimator_hold_the_truth(
    robots: dict[str, Robot], rng: np.random.Generator, poses: int, stated: float | None
) -> None:
    """Weights that vary from spot to spot cost some of what the data tell, and its sigmas say so; also of few poses."""
    robot = robots["panda"]
    model = build_error_model(robot.chain, robot.rig)
    off, usual = [], np.where(np.array(model.units) == "m", 2e-3, np.radians(0.2))
    for _ in range(8):
        truth = rng.normal(size=len(model.names)) * usual
        data = simulate(robot, model, truth, draw_poses(robot, model, truth, poses, rng), rng, SimulatedNoise(1e-3))
        found = fit(robot, data, estimator="robust", spot_sigma=stated)
        off.append(np.sqrt((found.x - truth) @ np.linalg.solve(found.covariance, found.x - truth) / len(truth)))
    assert np.sqrt(np.mean(np.square(off))) < 1.3
