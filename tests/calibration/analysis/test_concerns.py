"""What speaks against a calibration: clusters worse than nominal, motion and readings that were lost; nothing where all is well."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.benchmarks.outliers import with_outliers
from urdfcal.api import Calibration, fit
from urdfcal.base.geometry import MM, Mask
from urdfcal.calibration.analysis.clusters import left_out, pose_distances, worst_clusters
from urdfcal.calibration.analysis.concerns import (
    lost_motion,
    many_outliers,
    objections,
    outliers_together,
    reservations,
    worst_poses,
)
from urdfcal.calibration.analysis.validation import kfold
from urdfcal.calibration.reach import draw_poses
from urdfcal.calibration.tested import with_test
from urdfcal.robot.robot import Robot
from urdfcal.sensors.measurements import Measurements
from urdfcal.simulation.readings import SimulatedNoise, simulate
from urdfcal.simulation.truth import random_truth

FITTED = 80


@pytest.fixture(scope="module")
def measured(robots: dict[str, Robot]) -> Measurements:
    """140 poses of a Panda with errors of 0.5 mm and 0.5 mrad, read with 0.5 mm of noise."""
    robot, rng = robots["panda"], np.random.default_rng(3)
    errors, truth = random_truth(robot, rng, 0.5 * MM, 0.5e-3)
    return simulate(robot, errors, truth, draw_poses(robot, errors, truth, 140, rng), rng, SimulatedNoise(0.5 * MM))


@pytest.fixture(scope="module")
def healthy(robots: dict[str, Robot], measured: Measurements) -> Calibration:
    """The calibration of 80 of them, tested on the others."""
    return fit(robots["panda"], measured.subset(np.arange(140) < FITTED), test=measured.subset(np.arange(140) >= FITTED))


def near(data: Measurements, count: int) -> Mask:
    """The poses nearest to the first one in joint space."""
    far = np.linalg.norm((data.q - data.q[0]) / data.q.std(axis=0), axis=1)
    return np.argsort(np.argsort(far)) < count


def as_nominal_has_it(found: Calibration, data: Measurements, rows: Mask) -> Measurements:
    """The measurements with some poses where the nominal robot has them."""
    spots = data.spots + np.where(rows[:, None, None], -found.nominal.residuals(data).residual.reshape(data.spots.shape), 0.0)
    return data.with_spots(spots)


def test_a_healthy_calibration_raises_no_concern(healthy: Calibration) -> None:
    """Nothing is said against a calibration without outliers that is better than the nominal robot everywhere."""
    assert objections(healthy) == reservations(healthy) == ()
    after, before = pose_distances(healthy)
    assert after.max() < before.max()
    assert not left_out(healthy)[0].any()


def test_a_cluster_where_the_nominal_robot_is_right_is_found(healthy: Calibration, measured: Measurements) -> None:
    """Neighbouring test poses that are as the nominal robot has them are named, with the distance that the calibrated one has to them."""
    test = measured.subset(np.arange(140) >= FITTED)
    rows = near(test, 8)
    spoilt = as_nominal_has_it(healthy, test, rows)
    cluster = worst_clusters(with_test(healthy, spoilt))[0]
    named = {test.where(int(row)) for row in np.flatnonzero(rows)}
    assert len(named & set(cluster.poses)) >= 4
    off = np.linalg.norm((healthy.nominal.residuals(test).residual[:, :2])[rows], axis=1)
    assert cluster.nominal < cluster.calibrated < off.max() / MM * 2
    assert "the nominal one" in cluster.words()


def test_bad_readings_make_no_cluster(robots: dict[str, Robot], measured: Measurements, rng: np.random.Generator) -> None:
    """With a fifth of all readings thrown off at random nobody objects, and what was left out is said."""
    bad = with_outliers(measured, 0.2, rng)
    found = fit(robots["panda"], bad.subset(np.arange(140) < FITTED), test=bad.subset(np.arange(140) >= FITTED))
    assert objections(found) == ()
    assert outliers_together(found) == ()
    assert len(many_outliers(found)) == 1
    out, read = left_out(found)
    assert out.sum() / read.sum() == pytest.approx(0.2, abs=0.07)


def test_poses_that_were_left_out_in_turn_are_looked_at(robots: dict[str, Robot], measured: Measurements, rng: np.random.Generator) -> None:
    """Without test poses the farthest is that of cross-validation, each pose predicted by a fit that did not see it."""
    data = measured.subset(np.arange(140) < 40)
    folds = kfold(robots["panda"], data, 4, rng)
    found = replace(fit(robots["panda"], data), folds=folds)
    after, before = pose_distances(found)
    assert after.max() == pytest.approx(max(row.max for row in folds.after.values()))
    assert before.max() == pytest.approx(max(row.max for row in folds.before.values()))


def test_motion_that_was_left_out_is_named(healthy: Calibration) -> None:
    """A joint that moves in outliers alone is named, and one that moves elsewhere too is not."""
    q = healthy.data.q.copy()
    q[10:, 2] = 0.3
    whole = replace(healthy.data, q=q)
    out = np.repeat((np.arange(FITTED) < 10)[:, None], 2, axis=1)
    (words,) = lost_motion(replace(healthy, measured=whole, data=whole.without(out)))
    assert words.endswith("the motion of panda_joint3")
    assert lost_motion(replace(healthy, measured=whole, data=whole)) == ()


def test_a_farthest_pose_that_is_no_nearer_is_said(healthy: Calibration) -> None:
    """Where the farthest of the test readings is farther than the nominal robot's farthest, both figures are said."""
    assert healthy.test_data is not None
    spots = healthy.test_data.spots.copy()
    spots[5, 0] += -0.05 * np.sign(healthy.nominal.residuals(healthy.test_data).residual[5, :2])
    found = with_test(healthy, healthy.test_data.with_spots(spots))
    after, before = pose_distances(found)
    assert (worst_poses(found) != ()) == (after.max() > before.max() + 1e-3)
    assert found.test_outliers
    assert any("gross outlier" in words for words in reservations(found))
