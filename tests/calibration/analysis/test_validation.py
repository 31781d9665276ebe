"""Held-out poses, cross-validation, and the warning that the calibration poses do not cover what was tested."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from urdfcal.api import Calibration, fit
from urdfcal.base.errors import UsageError
from urdfcal.calibration.analysis.validation import _left_out_residuals, _much_worse, coverage_warnings, holdout, kfold
from urdfcal.calibration.error_table import rms_of
from urdfcal.calibration.problem import Problem
from urdfcal.calibration.reach import draw_poses
from urdfcal.calibration.start.nominal import evaluate
from urdfcal.calibration.tested import with_test
from urdfcal.estimation.noise import Noise
from urdfcal.model.gauge import build_error_model
from urdfcal.model.options import ModelOptions
from urdfcal.robot.robot import Robot
from urdfcal.sensors.measurements import Measurements
from urdfcal.simulation.paper import cases, paper_poses, paper_truth
from urdfcal.simulation.readings import SimulatedNoise, simulate
from urdfcal.simulation.truth import random_truth

NOISE = 0.5e-3


def panda_data(robot: Robot, rng: np.random.Generator, poses: int, sessions: tuple[str, ...] = ("",)) -> Measurements:
    """Measurements of a wrong robot with NOISE on the spots, dealt to sessions in turn."""
    errors, truth = random_truth(robot, rng, 1e-3, np.radians(0.1))
    data = simulate(robot, errors, truth, draw_poses(robot, errors, truth, poses, rng), rng, SimulatedNoise(NOISE))
    return replace(data, sessions=np.array([sessions[pose % len(sessions)] for pose in range(poses)], dtype=str))


def papers_data(robot: Robot, rng: np.random.Generator, noise: SimulatedNoise) -> Measurements:
    """The paper's 60 poses and errors."""
    errors = build_error_model(robot.chain, robot.rig, ModelOptions(error_model="dh"))
    truth = paper_truth(errors)
    return simulate(robot, errors, truth, paper_poses(robot, errors, truth, rng), rng, noise)


def checked_on(robot: Robot, data: Measurements, kept: np.ndarray, out: np.ndarray, **arguments: object) -> Calibration:
    """A fit of some poses with others as test set."""
    return with_test(fit(robot, data.subset(kept), **arguments), data.subset(out))  # type: ignore[arg-type]


def test_holdout_takes_the_share_of_every_session(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Each session gives its share of poses that were seen, at random, and keeps the others."""
    data = panda_data(robots["panda"], rng, 60, ("a", "b", "b"))
    blind = data.spots.copy()
    blind[:6] = np.nan
    marked = holdout(data.with_spots(blind), 0.25, rng)
    assert [np.count_nonzero(marked.sets[data.sessions == session] == "test") for session in "ab"] == [round(0.25 * 18), round(0.25 * 36)]
    assert (marked.sets[:6] == "fit").all()
    assert (holdout(data, 0.25, np.random.default_rng(1)).sets == holdout(data, 0.25, np.random.default_rng(1)).sets).all()
    assert (holdout(data, 0.25, np.random.default_rng(1)).sets != holdout(data, 0.25, np.random.default_rng(2)).sets).any()


def test_every_session_keeps_a_pose_to_fit(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Even of a large share, no session is left without a pose."""
    data = panda_data(robots["panda"], rng, 9, ("a", "b", "c"))
    sets = holdout(data, 0.99, rng).sets
    assert [np.count_nonzero(sets[data.sessions == session] == "fit") for session in "abc"] == [1, 1, 1]


@pytest.mark.parametrize("share", [0.0, 1.0, -0.3, 30, np.nan])
def test_a_share_that_is_none_is_refused(robots: dict[str, Robot], rng: np.random.Generator, share: float) -> None:
    """A share outside 0 to 1, as of someone who means percent, is refused with the value."""
    with pytest.raises(UsageError, match=f"between 0 and 1, found {share:g}"):
        holdout(panda_data(robots["panda"], rng, 4), share, rng)


def test_holdout_needs_unmarked_poses_and_enough_of_them(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Poses that are marked already stay as they are, and a share of no pose at all is refused."""
    data = panda_data(robots["panda"], rng, 4)
    with pytest.raises(UsageError, match="mark test poses in their 'set' column already"):
        holdout(replace(data, sets=np.array(["fit", "test", "fit", "fit"])), 0.5, rng)
    with pytest.raises(UsageError, match=r"0\.1 of 4 poses is no pose"):
        holdout(data, 0.1, rng)


def test_kfold_predicts_every_pose_without_it(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Each spot counts once; before is the nominal robot's table; the folds' RMS pool to the whole; noise and little more is left."""
    robot = robots["panda"]
    data = panda_data(robot, rng, 63, ("a", "b"))
    found = kfold(robot, data, 5, rng, spot_sigma=NOISE, gated=False)
    assert found.before == evaluate(robot, data)
    assert [row.n for row in found.after.values()] == [63, 63]
    assert (found.folds, found.rejected) == (5, ())
    sizes = np.array([13, 13, 13, 12, 12])
    assert np.sqrt(np.sum(sizes * found.fold_rms**2) / 63) == pytest.approx(rms_of(found.after))
    fitted = rms_of(fit(robot, data, spot_sigma=NOISE, gated=False).after)
    assert fitted < np.sqrt(2) * NOISE * 1e3 < rms_of(found.after) < 2 * fitted


def test_left_out_residuals_are_those_of_fits_without_the_pose(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """The formula for a left-out pose agrees with leaving poses out one by one and fitting anew."""
    robot = robots["ur5"]
    errors, truth = random_truth(robot, rng, 1e-4, 1e-4)
    data = simulate(robot, errors, truth, draw_poses(robot, errors, truth, 16, rng), rng, SimulatedNoise(1e-4))
    whole = fit(robot, data, spot_sigma=1e-4, gated=False)
    noise = Noise(1e-4, np.zeros(6))
    left_out = _left_out_residuals(Problem(whole.errors, data).linearise(whole.x), noise, whole.covariance) * noise.spot_sigma
    for pose in range(16):
        without = fit(robot, data.subset(np.arange(16) != pose), spot_sigma=1e-4, gated=False)
        residual = Problem(without.errors, data.subset([pose])).linearise(without.x).residual[0]
        np.testing.assert_allclose(left_out[pose], residual, rtol=0.02, atol=2e-6)


def test_kfold_refuses_what_cannot_be_dealt(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Too few or too many folds, a session of one pose, and a test set of one's own are refused."""
    robot = robots["panda"]
    data = panda_data(robot, rng, 5)
    for folds in (0, 1, 6):
        with pytest.raises(UsageError, match=f"between 2 and the number of poses, 5; found {folds}"):
            kfold(robot, data, folds, rng)
    with pytest.raises(UsageError, match="session 'b' has a single pose"):
        kfold(robot, replace(data, sessions=np.array(["a", "a", "a", "a", "b"])), 2, rng)
    with pytest.raises(UsageError, match="test poses of its own"):
        kfold(robot, data, 2, rng, test=data)


def test_rejected_folds_are_told(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """A fold whose fit must not be trusted is named with its reason, and its poses count all the same."""
    robot = robots["panda"]
    found = kfold(robot, panda_data(robot, rng, 40), 2, rng, max_sweeps=1, gated=False)
    assert [reason.split(":")[0] for reason in found.rejected] == ["fold 1", "fold 2"]
    assert found.after["laser_1"].n == 40


@pytest.mark.parametrize("stated", [True, False])
def test_the_papers_case_1_is_warned_of_and_its_others_are_not(robots: dict[str, Robot], rng: np.random.Generator, stated: bool) -> None:
    """Calibrated near home and tested all over, joints are named; with half of either, or a random third, nothing is said."""
    robot, joint_noise = robots["arm7"], np.radians(0.06)
    known = {"error_model": "dh"} | ({"spot_sigma": 1e-3, "joint_sigma": joint_noise} if stated else {})
    sets = {(case, name): rows for case, name, rows in cases()}
    for _ in range(3):
        data = papers_data(robot, rng, SimulatedNoise(1e-3, joint_noise))
        (line,) = coverage_warnings(robot, checked_on(robot, data, sets[1, "fit"], sets[1, "test"], **known))
        assert "times worse than the calibration poses" in line
        assert "as the fit's own uncertainty predicts" in line
        assert re.search(r"the calibration poses cover joint\d -?\d+ to -?\d+ deg, the test poses -?\d+ to -?\d+ deg; ", line)
        assert "\n" not in line
        assert coverage_warnings(robot, checked_on(robot, data, sets[2, "fit"], sets[2, "test"], **known)) == ()
        out = np.isin(np.arange(60), rng.permutation(60)[:20])
        assert coverage_warnings(robot, checked_on(robot, data, ~out, out, **known)) == ()


def test_a_rig_that_moved_is_not_blamed_on_the_ranges(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Test poses over the same ranges, but after the screen was moved by 10 mm, are worse for a reason that is not the ranges."""
    robot = robots["panda"]
    data = panda_data(robot, rng, 90)
    moved = data.with_spots(data.spots + np.where(np.arange(90) < 60, 0.0, 10e-3)[:, None, None])
    (line,) = coverage_warnings(robot, checked_on(robot, moved, np.arange(90) < 60, np.arange(90) >= 60))
    assert "more than the fit's own uncertainty predicts" in line
    assert "the joints' ranges do not explain it" in line


def test_a_single_wild_pose_is_named(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """A test pose that is off by itself is in the test table, not in the trimmed one, and named with its lasers as the one to blame."""
    robot = robots["panda"]
    data = panda_data(robot, rng, 80)
    spots = data.spots.copy()
    spots[70] += 20e-3
    found = checked_on(robot, data.with_spots(spots), np.arange(80) < 60, np.arange(80) >= 60)
    assert {(outlier.pose, outlier.laser) for outlier in found.test_outliers} == {("pose 71", "laser_1"), ("pose 71", "laser_2")}
    assert found.test is not None
    assert found.test_trimmed is not None
    assert [row.n for row in found.test[1].values()] == [20, 20]
    assert [row.n for row in found.test_trimmed[1].values()] == [19, 19]
    (line,) = coverage_warnings(robot, found)
    assert "pose 71 alone is to blame" in line


def test_a_slide_is_told_in_millimetres(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """A joint that hardly moved in the calibration poses is named alone, a slide with its range in mm."""
    robot = robots["tiago"]
    names = robot.chain.input_names
    slide = next(index for index, joint in enumerate(robot.chain.inputs) if joint.prismatic)
    errors, truth = random_truth(robot, rng, 5e-3, np.radians(0.5))
    q = draw_poses(robot, errors, truth, 120, rng)
    low = q[:, slide] < 0.1
    data = simulate(robot, errors, truth, q, rng, SimulatedNoise(1e-4))
    spots = np.where(low[:, None, None], data.spots, data.spots + 5e-3)  # whatever it is that goes wrong farther up
    (line,) = coverage_warnings(robot, checked_on(robot, data.with_spots(spots), low, ~low, spot_sigma=1e-4))
    assert f"the calibration poses cover {names[slide]} " in line
    assert "mm, the test poses 1" in line
    assert line.count("the test poses") == 2


def test_few_test_poses_do_not_raise_the_alarm_by_chance(rng: np.random.Generator) -> None:
    """Samples of one scatter, or 1.4 times as wide, are hardly ever taken for much worse, however few; samples four times as wide are."""
    squares = rng.chisquare(4, (2000, 60)) / 4
    for few in (1, 2, 3, 10):
        assert sum(_much_worse(row[:few], row[few:]) for row in squares) <= 2
    assert not any(_much_worse(2 * row[:30], row[30:]) for row in squares[:200])
    assert all(_much_worse(16 * row[:10], row[10:]) for row in squares[:200])


def test_no_test_poses_no_warning(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Without test poses, or with noise-free ones, there is nothing to say."""
    robot = robots["panda"]
    assert coverage_warnings(robot, fit(robot, panda_data(robot, rng, 40))) == ()
    errors = build_error_model(robot.chain, robot.rig)
    truth = rng.normal(0, 1e-3, len(errors.names))
    data = simulate(robot, errors, truth, draw_poses(robot, errors, truth, 60, rng), rng)
    assert coverage_warnings(robot, checked_on(robot, data, np.arange(60) < 40, np.arange(60) >= 40)) == ()
