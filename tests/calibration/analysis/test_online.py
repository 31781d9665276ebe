"""One pose at a time: the batch answer, the accuracy that is promised, and what happens to bad poses."""

from __future__ import annotations

import re

import numpy as np
import pytest

import urdfcal
from tests.calibration.analysis.test_prediction import tool_errors
from tests.support.helpers import tool_sigma
from tests.support.small_robot import URDF, robot_of
from urdfcal.api import OnlineCalibrator, fit
from urdfcal.base.errors import FitRejected, RobotError, ShapeMismatch, UsageError
from urdfcal.calibration.analysis import arrivals
from urdfcal.calibration.analysis.online_state import OnlineState
from urdfcal.calibration.analysis.prediction import spot_sigma
from urdfcal.calibration.reach import draw_poses
from urdfcal.estimation.chi_squared import chi_squared_gate
from urdfcal.model.gauge import build_error_model
from urdfcal.model.options import ModelOptions
from urdfcal.robot.configurations import joint_limits
from urdfcal.robot.robot import Robot
from urdfcal.sensors.measurements import Measurements, spots_measured
from urdfcal.sensors.spots import beams_at
from urdfcal.simulation.readings import SimulatedNoise, simulate
from urdfcal.simulation.truth import random_truth

NOISE = 0.5e-3


def some_poses(robot: Robot, rng: np.random.Generator, poses: int, joint: float = 0.0) -> Measurements:
    """Measurements of a wrong robot with NOISE on the spots."""
    errors, truth = random_truth(robot, rng, 2e-3, np.radians(0.2))
    return simulate(robot, errors, truth, draw_poses(robot, errors, truth, poses, rng), rng, SimulatedNoise(NOISE, joint))


def take(calibrator: OnlineCalibrator, data: Measurements) -> list[OnlineState]:
    """Feed every pose."""
    return [calibrator.update(q, spots, sigma) for q, spots, sigma in zip(data.q, data.spots, data.sigma, strict=True)]


def test_coarse_joints_come_back_to_their_poses(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """A pose that joints in steps of a milliradian come back to, one step off, is a further reading of it, as in the batch fit."""
    step, data = 1e-3, some_poses(robots["panda"], rng, 12)
    q = np.round(data.q / step) * step
    calibrator = OnlineCalibrator(robots["panda"], spot_sigma=5e-3)
    for joints, spots in zip(np.vstack([q, q[3] + step]), np.concatenate([data.spots, data.spots[3:4]]), strict=True):
        again = calibrator.update(joints, spots)
    assert again.relinearised
    assert calibrator.measurements().pose_count == len(q)


@pytest.mark.parametrize(("name", "joint"), [("panda", 0.0), ("panda", 5e-4), ("tiago", 0.0)])
def test_the_belief_is_that_of_the_batch_fit(robots: dict[str, Robot], rng: np.random.Generator, name: str, joint: float) -> None:
    """At any number of poses mean and sigma are those of `fit` of the same poses to a hundredth of a sigma."""
    robot = robots[name]
    data = some_poses(robot, rng, 70, joint)
    states = take(OnlineCalibrator(robot, spot_sigma=NOISE, joint_sigma=joint), data)
    for count in (1, 2, 20, 45, 70):
        batch = fit(robot, data.subset(np.arange(count)), spot_sigma=NOISE, joint_sigma=joint, gated=False, evidence=False)
        state = states[count - 1]
        assert state.poses == count
        assert np.max(np.abs(state.x - batch.x) / batch.sigma) < 0.01
        np.testing.assert_allclose(state.sigma, batch.sigma, rtol=0.01)
    assert sum(state.relinearised for state in states[35:]) < 10


def test_noise_that_is_not_stated_is_found(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """The spot noise is estimated as in the batch fit, once there is enough to estimate it from."""
    robot = robots["panda"]
    data = some_poses(robot, rng, 60)
    states = take(OnlineCalibrator(robot, target_mm=1e3), data)
    batch = fit(robot, data, gated=False, evidence=False)
    assert states[0].noise.spot_sigma == 1e-3
    assert not states[0].enough  # the target is met, but the noise that says so is a guess
    assert states[-1].enough
    assert states[-1].noise.spot_sigma == pytest.approx(batch.estimate.noise.spot_sigma, rel=0.1)
    assert np.max(np.abs(states[-1].x - batch.x) / batch.sigma) < 0.02


def test_the_order_of_the_poses_does_not_matter(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Poses taken backward end in the same belief, to a hundredth of a sigma."""
    robot = robots["ur5"]
    data = some_poses(robot, rng, 40)
    forward, backward = (take(OnlineCalibrator(robot, spot_sigma=NOISE), data.subset(np.arange(40)[::step]))[-1] for step in (1, -1))
    assert np.max(np.abs(forward.x - backward.x) / forward.sigma) < 0.01


def test_nis_is_chi_squared(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """With the right noise the NIS averages to the numbers measured, and hardly ever passes the gate."""
    robot = robots["panda"]
    data = some_poses(robot, rng, 120)
    states = take(OnlineCalibrator(robot, spot_sigma=NOISE), data)
    nis = np.array([state.nis for state in states])
    assert nis.mean() == pytest.approx(4.0, abs=4 * np.sqrt(8 / 120))
    assert sum(not state.within_gate for state in states) <= 2


@pytest.mark.parametrize(("numbers", "quantile"), [(2, 13.815510558), (4, 18.466826953), (6, 22.457744486), (0, 0.0)])
def test_the_gate_is_the_published_quantile(numbers: int, quantile: float) -> None:
    """99.9 % quantiles of chi-squared as in any table."""
    assert chi_squared_gate(numbers) == pytest.approx(quantile, abs=1e-8)


def test_the_promised_accuracy_is_kept(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Over robots drawn from the prior, the tool's true mean squared error is what was predicted when the target was met."""
    robot = robots["panda"]
    errors = build_error_model(robot.chain, robot.rig)
    q = rng.uniform(*joint_limits(robot), (30, 7))
    ratios = []
    for _ in range(12):
        truth = errors.mean + 0.3 * errors.sigma * rng.normal(size=len(errors.names))
        data = simulate(robot, errors, truth, draw_poses(robot, errors, truth, 60, rng), rng, SimulatedNoise(NOISE))
        calibrator = OnlineCalibrator(robot, spot_sigma=NOISE, target_mm=1.0, workspace=q)
        state = next(state for pose in range(60) if (state := calibrator.update(data.q[pose], data.spots[pose])).enough)
        assert state.tool_sigma_mm < 1.0
        distance, angle = tool_errors(robot, errors, truth, state.x[None], "slm", q)
        ratios.append((distance.mean() / (state.tool_sigma_mm * 1e-3) ** 2, angle.mean() / (state.tool_sigma_mrad * 1e-3) ** 2))
    assert (np.abs(np.mean(ratios, axis=0) - 1) < 0.5).all()  # about 4 deciding directions a robot: sigma of the mean 0.2


def test_the_state_predicts_what_prediction_says(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Before any pose, and after some, the state's figures are the RMS and maximum of tool_sigma, and fall with every pose."""
    robot = robots["panda"]
    q = rng.uniform(*joint_limits(robot), (20, 7))
    calibrator = OnlineCalibrator(robot, spot_sigma=NOISE, tool="panda_hand", workspace=q)
    states = [calibrator.state, *take(calibrator, some_poses(robot, rng, 25))]
    for state in (states[0], states[-1]):
        sigma = tool_sigma(robot, calibrator.errors, state.belief.P, state.x, "panda_hand", q)
        rms = np.sqrt(np.mean(sigma**2, axis=0)) * 1e3
        np.testing.assert_allclose(
            [state.tool_sigma_mm, state.tool_sigma_mrad, state.tool_sigma_max_mm], [*rms, sigma[:, 0].max() * 1e3], rtol=1e-2
        )
    assert (np.diff([state.tool_sigma_mm for state in states]) < 1e-2).all()
    seen = draw_poses(robot, calibrator.errors, states[-1].x, 200, rng)
    spots = np.sqrt(np.nanmean(spot_sigma(calibrator.errors, states[-1].belief.P, states[-1].x, seen) ** 2)) * 1e3
    assert states[-1].spot_sigma_mm == pytest.approx(spots, rel=0.25)  # other poses, the same workspace


def test_wild_poses_are_reported_and_on_request_left_out(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """A spot that is 100 mm off is beyond the gate; with `gate` the belief stays as it was, and the pose is named."""
    robot = robots["panda"]
    data = some_poses(robot, rng, 41)
    wild = data.spots[40] + np.array([[0.1, 0.0], [0.0, 0.0]])
    for gate in (False, True):
        calibrator = OnlineCalibrator(robot, spot_sigma=NOISE, gate=gate)
        before = take(calibrator, data.subset(np.arange(40)))[-1]
        after = calibrator.update(data.q[40], wild)
        assert not after.within_gate
        assert (after.belief is before.belief) == gate
        assert after.skipped.startswith("pose 41: its spots are") == gate
        assert calibrator.update(data.q[40], data.spots[40]).skipped == ""
        assert list(calibrator.measurements().poses[39:]) == (["40", "42"] if gate else ["40", "41", "42"])


def test_a_beam_that_cannot_be_is_refused(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """A spot seen where the model's beam flies away from the screen is refused, or skipped, and the belief stays."""
    robot = robots["panda"]
    data = some_poses(robot, rng, 3)
    errors = build_error_model(robot.chain, robot.rig)
    away = next(
        row
        for row in rng.uniform(*joint_limits(robot), (50, 7))
        if np.isnan(spot_sigma(errors, np.eye(len(errors.names)), errors.mean, row[None])).any()
    )
    strict, lenient = OnlineCalibrator(robot, spot_sigma=NOISE), OnlineCalibrator(robot, spot_sigma=NOISE, gate=True)
    for calibrator in (strict, lenient):
        take(calibrator, data)
    before = strict.state
    with pytest.raises(FitRejected, match="pose 4: a beam was seen that in the present model does not meet the screen"):
        strict.update(away, data.spots[0])
    assert strict.state is before
    after = lenient.update(away, data.spots[0])
    assert after.skipped.startswith("pose 4: a beam was seen")
    assert not after.within_gate
    assert len(lenient.measurements()) == 3


def test_poses_without_spots_change_nothing(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """A pose at which no beam was seen leaves the belief alone; one beam alone counts for two numbers."""
    robot = robots["panda"]
    data = some_poses(robot, rng, 4)
    calibrator = OnlineCalibrator(robot, spot_sigma=NOISE)
    with pytest.raises(UsageError, match="no pose with a reading"):
        calibrator.calibration()
    before = take(calibrator, data)[-1]
    blind = calibrator.update(data.q[0], np.full((2, 2), np.nan))
    assert blind.belief is before.belief
    assert (blind.nis, blind.gate) == (0.0, 0.0)
    one = calibrator.update(data.q[0], [data.spots[0, 0], [np.nan, np.nan]])
    assert one.gate == chi_squared_gate(2)


def test_the_calibration_is_a_batch_fit(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """At any time there is a whole calibration of the poses so far, with its corrected URDF."""
    robot = robots["panda"]
    data, options = some_poses(robot, rng, 40), ModelOptions(error_model="hayati")
    calibrator = OnlineCalibrator(robot, options, spot_sigma=NOISE)
    state = take(calibrator, data)[-1]
    calibration = calibrator.calibration()
    assert calibration.errors.names == calibrator.errors.names
    assert b"panda_joint1" in calibration.urdf()
    assert np.max(np.abs(calibration.x - state.x) / calibration.sigma) < 0.01
    assert isinstance(calibration, urdfcal.Calibration)


def test_a_long_history_is_kept_whole(robots: dict[str, Robot], rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch) -> None:
    """Poses beyond the room first made for them are kept as they were given."""
    monkeypatch.setattr(arrivals, "CHUNK", 2)
    robot = robots["panda"]
    data = some_poses(robot, rng, 9)
    stated = spots_measured(robot, data.q, data.spots, sigma=rng.uniform(1e-4, 1e-3, (9, 2)))
    calibrator = OnlineCalibrator(robot, spot_sigma=NOISE)
    take(calibrator, stated)
    for name in ("q", "spots", "sigma", "poses"):
        np.testing.assert_array_equal(getattr(calibrator.measurements(), name), getattr(stated, name))


def test_what_cannot_be_is_refused_at_once(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Options and arrays that mean nothing are refused in one line."""
    robot = robots["panda"]
    for arguments, message in (({"spot_sigma": 0.0}, "spot noise"), ({"target_mm": -1.0}, "target"), ({"gate": True}, "state spot_sigma")):
        with pytest.raises(UsageError, match=message):
            OnlineCalibrator(robot, **arguments)  # type: ignore[arg-type]
    with pytest.raises(RobotError, match="none of the calibrated joints"):
        OnlineCalibrator(robot, tool="panda_link0")
    calibrator = OnlineCalibrator(robot)
    with pytest.raises(ShapeMismatch, match=r"spots of one pose have shape \(lasers, 2\) = \(2, 2\), found \(2,\)"):
        calibrator.update(np.zeros(7), [0.0, 0.0])
    with pytest.raises(ShapeMismatch, match="q has shape"):
        calibrator.update(np.zeros(6), np.zeros((2, 2)))
    assert calibrator.state.poses == 0


def test_understated_spots_do_not_promise_too_much(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Where spots scatter ten times as much as they state, the accuracy that is predicted is that of what they do."""
    robot = robots["panda"]
    model, truth = random_truth(robot, rng, 2e-3, np.radians(0.2))
    data = simulate(robot, model, truth, draw_poses(robot, model, truth, 60, rng), rng, SimulatedNoise(1e-3))
    usual, stating = OnlineCalibrator(robot, target_mm=0.1), OnlineCalibrator(robot, target_mm=0.1)
    for q, spots in zip(data.q, data.spots, strict=True):
        usual.update(q, spots)
        stating.update(q, spots, np.full(2, 1e-4))
    assert stating.state.extra_noise["spot"] == pytest.approx(1e-3, rel=0.2)
    assert stating.state.tool_sigma_mm == pytest.approx(usual.state.tool_sigma_mm, rel=0.2)
    assert not stating.state.enough
    batch = stating.calibration()
    assert batch.rejection == ""
    np.testing.assert_allclose(batch.sigma, stating.state.sigma, rtol=0.1)


def test_a_gate_does_not_lock_itself_out(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Poses that are beyond the gate one after the other show that the belief is wrong, and are taken."""
    robot = robots["panda"]
    model, truth = random_truth(robot, rng, 2e-3, np.radians(0.2))
    data = simulate(robot, model, truth, draw_poses(robot, model, truth, 60, rng), rng, SimulatedNoise(1e-3))
    online = OnlineCalibrator(robot, gate=True, spot_sigma=1e-3)
    for q, spots in zip(data.q, data.spots, strict=True):
        online.update(q, spots, np.full(2, 1e-4))
    assert online.state.poses > 30
    assert online.state.extra_noise["spot"] == pytest.approx(1e-3, rel=0.3)


def test_limits_without_room_want_a_workspace() -> None:
    """Where all limits are the same nothing can be predicted over them; a workspace that is given is taken."""
    text = re.sub(r'lower="[^"]*" upper="[^"]*"', 'lower="0" upper="0"', URDF).replace('type="continuous"', 'type="fixed"')
    robot, poses = robot_of(text), np.array([[0.1, 0.05], [-0.3, 0.2], [0.4, 0.0], [0.0, 0.1]])
    with pytest.raises(UsageError, match="lower and upper limit of turn, slide are the same, which leaves no workspace"):
        OnlineCalibrator(robot, spot_sigma=NOISE)
    calibrator = OnlineCalibrator(robot, spot_sigma=NOISE, workspace=poses)
    spots = beams_at(calibrator.errors, calibrator.errors.mean, poses).spots
    states = take(calibrator, spots_measured(robot, poses, spots))
    assert states[-1].tool_sigma_mm > 0
