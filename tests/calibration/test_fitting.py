"""`fit`, from a robot and spots to a calibration."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import urdfcal
from tests.support.helpers import assert_poses_close
from urdfcal.api import fit
from urdfcal.base.errors import FitRejected, RobotError, ShapeMismatch, UsageError
from urdfcal.calibration.error_table import rms_of
from urdfcal.calibration.reach import ScreenArea, draw_poses
from urdfcal.calibration.start.nominal import evaluate
from urdfcal.calibration.tested import with_test
from urdfcal.model.error_model import ErrorModel
from urdfcal.model.gauge import build_error_model
from urdfcal.model.options import ModelOptions, ParameterPrior
from urdfcal.model.parameters import FLAT, PriorScale
from urdfcal.robot.robot import Robot
from urdfcal.sensors.measurements import Measurements, spots_measured
from urdfcal.simulation.paper import paper_poses
from urdfcal.simulation.readings import SimulatedNoise, simulate, true_spots
from urdfcal.simulation.truth import random_truth

FLAT_PRIORS = {"joint": PriorScale(FLAT, FLAT), "mount": PriorScale(FLAT, FLAT)}


def papers_case(robot: Robot, rng: np.random.Generator, noise: SimulatedNoise | None = None) -> tuple[ErrorModel, np.ndarray, Measurements]:
    """60 poses of the paper, with its errors on joints and module alike."""
    errors = build_error_model(robot.chain, robot.rig, ModelOptions(error_model="dh"))
    truth = np.array([0.010 if unit == "m" else np.radians(1) for unit in errors.units])
    return errors, truth, simulate(robot, errors, truth, paper_poses(robot, errors, truth, rng), rng, noise)


@pytest.mark.parametrize("schedule", ["iterated", "paper"])
def test_exact_data_give_back_the_exact_errors(robots: dict[str, Robot], rng: np.random.Generator, schedule: str) -> None:
    """Noise-free, the 33 parameters of the paper's arm come back to 1e-6 mm and 1e-8 rad."""
    errors, truth, data = papers_case(robots["arm7"], rng)
    found = fit(
        robots["arm7"], data, error_model="dh", schedule=schedule, priors=FLAT_PRIORS, tolerance=1e-13 if schedule == "paper" else None
    )
    assert found.converged
    off = np.abs(found.x - truth)
    metres = np.array(errors.units) == "m"
    assert off[metres].max() < 1e-9
    assert off[~metres].max() < 1e-8


def test_estimators_agree(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """EKF and Levenberg-Marquardt with the same priors and noise give the same estimate and covariance."""
    _, _, data = papers_case(robots["arm7"], rng, SimulatedNoise(1e-3, 1e-3))
    ekf, lse = (fit(robots["arm7"], data, error_model="dh", estimator=name, spot_sigma=1e-3) for name in ("ekf", "lse"))
    assert np.abs((ekf.x - lse.x) / ekf.sigma).max() < 1e-6
    np.testing.assert_allclose(ekf.covariance / np.outer(lse.sigma, lse.sigma), lse.covariance / np.outer(lse.sigma, lse.sigma), atol=1e-5)


@pytest.mark.parametrize("name", ["panda", "ur5", "tiago", "arm4"])
def test_six_direction_errors_are_found(robots: dict[str, Robot], name: str, rng: np.random.Generator) -> None:
    """With errors in six directions of every joint, unseen poses are predicted far better than before, whatever the robot."""
    robot = robots[name]
    model, truth = random_truth(robot, rng, 2e-3, np.radians(0.2))
    q = draw_poses(robot, model, truth, 160, rng)
    data = simulate(robot, model, truth, q[:100], rng, SimulatedNoise(0.5e-3))
    unseen = spots_measured(robot, q[100:], true_spots(robot, model, truth, q[100:]))
    found = fit(robot, data, test=unseen)
    assert found.test is not None
    before, after = (rms_of(table) for table in found.test)
    expected = 0.5 * np.sqrt(2 * len(found.x) / (4 * 100))  # what noise alone leaves in the parameters
    assert before > 3
    assert after < 3 * expected


def test_a_carried_screen_is_the_same_problem(robots: dict[str, Robot], rng: np.random.Generator, tmp_path: object) -> None:
    """With the module on the base and the screen on the hand, the errors are found as well."""
    text = robots["ur5"].description.text.decode()
    text = (
        text.replace('link name="slm"', 'link name="held"')
        .replace('"slm"', '"held"')
        .replace('link name="screen"', 'link name="slm"')
        .replace('"screen"', '"slm"')
    )
    swapped = text.replace('"held"', '"screen"')
    path = tmp_path / "swapped.urdf"  # type: ignore[operator]
    swapped = swapped.replace('<parent link="screen"/>\n    <child link="laser_', '<parent link="slm"/>\n    <child link="laser_')
    path.write_text(swapped)
    robot = urdfcal.load_robot(path)
    assert not any(step.forward for step in robot.chain.moving)
    model, truth = random_truth(robot, rng, 1e-3, np.radians(0.1))
    q = draw_poses(robot, model, truth, 120, rng, area=ScreenArea(6.0))
    found = fit(robot, simulate(robot, model, truth, q[:80], rng, SimulatedNoise(0.2e-3)))
    unseen = spots_measured(robot, q[80:], true_spots(robot, model, truth, q[80:]))
    assert found.converged
    calibrated = with_test(found, unseen).test
    assert calibrated is not None
    assert rms_of(calibrated[1]) < 1.0 < rms_of(calibrated[0])


def test_missing_spots_do_not_count(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """A beam that was not seen leaves the other beam of its pose in the fit, and adds nothing itself."""
    _, _, data = papers_case(robots["arm7"], rng, SimulatedNoise(1e-3))
    gaps = data.spots.copy()
    gaps[::3, 0] = np.nan
    kept = fit(robots["arm7"], data.with_spots(gaps), spot_sigma=1e-3)
    stretched = data.sigma.copy()
    stretched[::3, 0] = 1e3  # seen, but worth nothing
    ignored = fit(robots["arm7"], data.with_spots(data.spots, stretched), spot_sigma=1e-3)
    np.testing.assert_allclose(kept.x, ignored.x, atol=1e-9)
    assert kept.before["laser_1"].n == 40


def test_joint_noise_weighs_poses(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """With joint noise stated the estimate is nearer to the truth than without, over several draws."""
    errors = np.zeros(2)
    for _ in range(6):
        _, truth, data = papers_case(robots["arm7"], rng, SimulatedNoise(0.2e-3, np.radians(0.06)))
        plain = fit(robots["arm7"], data, error_model="dh")
        weighed = fit(robots["arm7"], data, error_model="dh", spot_sigma=0.2e-3, joint_sigma=np.radians(0.06))
        errors += [np.sum((found.x - truth) ** 2 / weighed.sigma**2) for found in (plain, weighed)]
    assert errors[1] < errors[0]


def test_sessions_have_screens_of_their_own(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """A screen moved between two sessions does not become a joint error."""
    robot = robots["panda"]
    screens = ErrorModel(robot.chain, build_error_model(robot.chain, robot.rig).slots, build_error_model(robot.chain, robot.rig).parameters)
    moved = np.zeros(len(screens.names))
    moved[[screens.names.index(f"screen.{name}") for name in ("trans_y", "rot_z")]] = 0.05, np.radians(2)
    q = draw_poses(robot, screens, moved, 80, rng)
    halves = [true_spots(robot, screens, x, part) for x, part in ((0 * moved, q[:40]), (moved, q[40:]))]
    data = spots_measured(robot, q, np.concatenate(halves), sessions=["a"] * 40 + ["b"] * 40)
    found = fit(robot, data, spot_sigma=1e-4)
    value = dict(zip(found.errors.names, found.x, strict=True))
    assert value["screen:b.trans_y"] == pytest.approx(0.05, abs=1e-4)
    assert value["screen:b.rot_z"] == pytest.approx(np.radians(2), abs=1e-4)
    joints = [value[name] for name, parameter in zip(found.errors.names, found.errors.parameters, strict=True) if parameter.kind == "joint"]
    assert np.abs(joints).max() < 1e-4


def test_a_screen_that_is_off_leaves_the_joints_alone(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """A perfect Panda before a screen 50 mm and 2 deg off gets its joint origins back unmoved."""
    robot = robots["panda"]
    errors = build_error_model(robot.chain, robot.rig)
    truth = np.zeros(len(errors.names))
    for name, value in {"trans_x": 0.05, "trans_z": -0.05, "rot_y": 2, "rot_z": -2}.items():
        truth[errors.names.index(f"screen.{name}")] = value if abs(value) < 1 else np.radians(value)
    q = draw_poses(robot, errors, truth, 60, rng)
    found = fit(robot, simulate(robot, errors, truth, q, rng))
    for correction in found.corrections.values():
        if correction.moving:
            assert_poses_close(correction.corrected, correction.nominal, mm=1e-2, mrad=1e-2)
    assert "screen_mount" in found.corrections


def test_beams_are_estimated_on_request(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """--estimate beams finds the angles of each beam, where mount and beams are not the same."""
    robot = robots["arm7"]
    options = ModelOptions(error_model="dh", estimate=("beams",))
    errors = build_error_model(robot.chain, robot.rig, options)
    truth = np.zeros(len(errors.names))
    truth[errors.names.index("laser_1.rot_x")], truth[errors.names.index("laser_2.rot_y")] = 0.01, -0.008
    data = simulate(robot, errors, truth, draw_poses(robot, errors, truth, 60, rng), rng)
    found = fit(robot, data, options=options, spot_sigma=1e-4)
    assert rms_of(found.after) < 0.01
    between = [found.x[errors.names.index(name)] for name in ("laser_1.rot_x", "laser_2.rot_x")]
    assert between[0] - between[1] == pytest.approx(0.01, abs=1e-4)


def test_a_corrected_model_is_the_calibrated_urdf(robots: dict[str, Robot], rng: np.random.Generator, tmp_path: object) -> None:
    """apply_to gives a pin.Model whose frames are those of the written URDF, and leaves the caller's model alone."""
    robot = robots["panda"]
    model, truth = random_truth(robot, rng, 2e-3, np.radians(0.2))
    found = fit(robot, simulate(robot, model, truth, draw_poses(robot, model, truth, 60, rng), rng, SimulatedNoise(1e-3)))
    kept = [placement.copy() for placement in robot.model.jointPlacements]
    corrected = found.apply_to(robot.model)
    path = tmp_path / "panda_calibrated.urdf"  # type: ignore[operator]
    found.write_urdf(path)
    for write in (found.write_urdf, found.write):
        with pytest.raises(UsageError, match="is the robot that was calibrated; name another file"):
            write(robot.description.path)
    written = pin.buildModelFromUrdf(str(path))
    q = pin.randomConfiguration(written)
    frames = []
    for either in (corrected, written):
        data = either.createData()
        pin.framesForwardKinematics(either, data, q)
        frames.append(data.oMf)
    for index in range(written.nframes):
        assert_poses_close(frames[0][index], frames[1][index])
    for before, after in zip(kept, robot.model.jointPlacements, strict=True):
        np.testing.assert_array_equal(before.homogeneous, after.homogeneous)
    table = evaluate(urdfcal.load_robot(path), found.data)
    for laser, row in table.items():
        assert row.mean == pytest.approx(found.after[laser].mean, abs=1e-6)


def test_a_model_without_the_joint_is_refused(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """A calibration does not fit another robot's model, and says which joint is missing."""
    _, _, data = papers_case(robots["arm7"], rng, SimulatedNoise(1e-3))
    found = fit(robots["arm7"], data, error_model="dh")
    with pytest.raises(RobotError, match="no joint 'joint1'"):
        found.apply_to(robots["panda"].model)


@pytest.mark.parametrize("stated", [1e-4, None])
def test_noise_that_was_stated_too_small_is_rejected(robots: dict[str, Robot], rng: np.random.Generator, stated: float | None) -> None:
    """Chi-square above five times what was stated is no result; noise that is estimated cannot disagree."""
    _, _, data = papers_case(robots["arm7"], rng, SimulatedNoise(1e-3))
    found = fit(robots["arm7"], data, error_model="dh", spot_sigma=stated)
    assert bool(found.rejection) == (stated is not None)
    if stated:
        with pytest.raises(FitRejected, match="chi-square is"):
            found.require_trustworthy()


def test_sweeps_that_run_out_are_rejected(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """A fit that did not come to rest is no result."""
    _, _, data = papers_case(robots["arm7"], rng, SimulatedNoise(1e-3))
    assert "did not converge" in fit(robots["arm7"], data, max_sweeps=1).rejection


def test_a_beam_that_misses_in_the_nominal_robot_is_named(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Measured spots that the nominal robot cannot make are taken out and named; without the gate they stop the fit."""
    _, _, data = papers_case(robots["arm7"], rng)
    q = data.q.copy()
    q[4, 0] += np.pi
    with pytest.raises(FitRejected, match=r"pose 5: laser_1 was seen, but in the model its beam does not meet the screen"):
        fit(robots["arm7"], replace(data, q=q), gated=False)
    outliers = fit(robots["arm7"], replace(data, q=q)).outliers
    assert {(outlier.pose, outlier.laser) for outlier in outliers} == {("pose 5", "laser_1"), ("pose 5", "laser_2")}


def test_the_dh_mount_on_the_last_axis_is_warned_of(robots: dict[str, Robot], tmp_path: object) -> None:
    """Under dh a module within 10 mm of the last axis is warned of; the module that stands off is not."""
    robot = robots["arm7"]
    path = tmp_path / "near.urdf"  # type: ignore[operator]
    path.write_bytes(robot.description.text.replace(b'xyz="0.05 0 0"', b'xyz="0.005 0 0"'))
    near, rng = urdfcal.load_robot(path), np.random.default_rng(1)
    _, _, data = papers_case(near, rng, SimulatedNoise(1e-3))
    assert any("5.0 mm from the axis of 'joint7'" in line for line in fit(near, data, error_model="dh").warnings)
    assert not any("mm from the axis" in line for line in fit(near, data).warnings)
    assert fit(robot, papers_case(robot, rng, SimulatedNoise(1e-3))[2], error_model="dh").warnings == ()


def test_what_a_model_cannot_follow_is_warned_of(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """dh cannot tilt parallel axes. A complete model is silent, also where the screen has no joint of its own."""
    _, _, data = papers_case(robots["arm7"], rng, SimulatedNoise(1e-3))
    assert fit(robots["arm7"], data).warnings == ()
    ur5 = robots["ur5"]
    model, truth = random_truth(ur5, rng, 1e-3, 1e-3)
    data = simulate(ur5, model, truth, draw_poses(ur5, model, truth, 60, rng), rng, SimulatedNoise(1e-3))
    assert fit(ur5, data).warnings == ()
    assert any("elbow_joint, wrist_1_joint is nearly parallel" in line for line in fit(ur5, data, error_model="dh").warnings)


def test_weakly_seen_models_come_to_rest(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """With gauge and hardly seen directions in the state the steps shrink to the tolerance and do not hover at rounding."""
    ur5 = robots["ur5"]
    for _ in range(3):
        model, truth = random_truth(ur5, rng, 5e-3, np.radians(0.5))
        data = simulate(ur5, model, truth, draw_poses(ur5, model, truth, 100, rng), rng, SimulatedNoise(0.5e-3))
        found = fit(ur5, data, error_model="dh", spot_sigma=0.5e-3)
        assert found.converged
        assert len(found.estimate.history) < 40


def test_held_values_do_not_flatter_the_nominal_robot(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """The table's `before` is the robot as its URDF has it, also when a rig.yaml states values."""
    _, _, data = papers_case(robots["arm7"], rng, SimulatedNoise(1e-3))
    stated = ModelOptions(error_model="dh", single={"joint1.d_a": ParameterPrior(mean=0.01, fixed=True)})
    assert fit(robots["arm7"], data, options=stated).before == fit(robots["arm7"], data, error_model="dh").before


def test_odd_options_are_refused(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Unknown estimators, noise below zero and measurements of another robot are refused with what was found."""
    _, _, data = papers_case(robots["arm7"], rng)
    for wrong, message in (
        ({"estimator": "ukf"}, "no estimator 'ukf'"),
        ({"schedule": "daily"}, "no schedule 'daily'"),
        ({"spot_sigma": 0.0}, "must be above zero"),
        ({"joint_sigma": -1.0}, "not negative"),
        ({"r": 0.0}, "R between 1e-20 and"),
    ):
        with pytest.raises(UsageError, match=message):
            fit(robots["arm7"], data, **wrong)
    with pytest.raises(ShapeMismatch, match="the measurements are of joints joint1"):
        fit(robots["panda"], data)
    with pytest.raises(UsageError, match="no pose is left to fit"):
        fit(robots["arm7"], replace(data, sets=np.array(["test"] * len(data))))


def test_a_laser_that_hangs_on_another_moves_with_its_beam(robots: dict[str, Robot], rng: np.random.Generator, tmp_path: Path) -> None:
    """Where laser_2 hangs on laser_1, estimating beams still ends at the truth: its spots follow laser_1's angles, too."""
    text = robots["arm7"].description.text.decode()
    path = tmp_path / "nested.urdf"
    path.write_text(re.sub(r'<parent link="slm"/>(\s*)<child link="laser_2"/>', r'<parent link="laser_1"/>\1<child link="laser_2"/>', text))
    robot = urdfcal.load_robot(path)
    assert len(robot.chain.laser_joints[1]) == 2
    options = ModelOptions(only=("laser_*",), estimate=("beams",))
    errors = build_error_model(robot.chain, robot.rig, options)
    truth = np.array([0.01, -0.008, 0.006, 0.004])
    data = simulate(robot, errors, truth, draw_poses(robot, errors, truth, 30, rng, area=ScreenArea(6.0)), rng)
    np.testing.assert_allclose(fit(robot, data, options=options, spot_sigma=1e-4).x, truth, atol=1e-6)


def test_a_robust_fit_is_not_rejected_for_its_outliers(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """With the right noise stated, spots that the robust estimator weighs down are no misfit."""
    _, _, data = papers_case(robots["arm7"], rng, SimulatedNoise(1e-3))
    spots = data.spots.copy()
    spots[::10] += 0.1
    assert fit(robots["arm7"], data.with_spots(spots), error_model="dh", estimator="robust", spot_sigma=1e-3).rejection == ""


def test_too_few_spots_are_said(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """A handful of poses says nothing of the noise: the start value stays, and that is warned of."""
    robot = robots["panda"]
    model, truth = random_truth(robot, rng, 1e-3, 1e-3)
    data = simulate(robot, model, truth, draw_poses(robot, model, truth, 9, rng), rng, SimulatedNoise(0.5e-3))
    found = fit(robot, data)
    assert found.estimate.noise.spot_sigma == 1e-3
    assert any("too few spots to estimate their noise" in line for line in found.warnings)


def test_stated_noise_that_is_wrong_by_two_is_said(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Noise stated at half or twice what it is brings a warning every time, the right one none."""
    for _ in range(5):
        _, _, data = papers_case(robots["arm7"], rng, SimulatedNoise(1e-3))
        for stated, wrong in ((0.5e-3, True), (1e-3, False), (2e-3, True)):
            found = fit(robots["arm7"], data, error_model="dh", spot_sigma=stated)
            assert any("than the stated noise" in line or "the stated noise explains" in line for line in found.warnings) == wrong
