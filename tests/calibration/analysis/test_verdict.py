"""May a calibration be used? Sets that must not be, sets that can be, and each concern by itself."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from tests.support import two_ends
from tests.support.paths import ROBOTS_DIR
from tests.support.sensor_cases import CASES, NOISE, setup_of
from urdfcal.api import Calibration, FitRejected, fit
from urdfcal.calibration.analysis.clusters import worst_clusters
from urdfcal.calibration.analysis.validation import kfold
from urdfcal.calibration.analysis.verdict import verdict_of
from urdfcal.calibration.error_table import SpotErrors
from urdfcal.calibration.result import FitResult
from urdfcal.model.options import ModelOptions
from urdfcal.robot.robot import Robot, with_text
from urdfcal.sensors.measurements import Measurements
from urdfcal.sensors.measurements_csv import read_measurements
from urdfcal.simulation.readings import simulate_readings
from urdfcal.simulation.setup import SimulatedSetup


def example(robots: dict[str, Robot]) -> Measurements:
    """The spots that come with the seven-joint arm."""
    return read_measurements(ROBOTS_DIR / "arm7" / "measurements.csv", robots["arm7"])


@pytest.fixture(scope="module")
def arm7(robots: dict[str, Robot]) -> Calibration:
    """Their fit."""
    return fit(robots["arm7"], example(robots))


def points(robots: dict[str, Robot], poses: int, case: str = "point", seed: int = 1) -> tuple[Robot, Measurements]:
    """What a tracker reads of a robot with simulated errors."""
    rng = np.random.default_rng(seed)
    setup = setup_of(CASES[case], robots, rng)
    return setup.robot, simulate_readings(setup, poses, rng, NOISE)


def stated(data: Measurements, sigma: float) -> Measurements:
    """The same with a sigma for every reading, [m]."""
    return replace(data, readings=tuple(replace(own, sigma=np.full(len(data), sigma)) for own in data.readings))


def test_the_example_can_be_used(arm7: Calibration) -> None:
    """The best set that we have is usable without a word beside it, and its link is what the module is."""
    verdict = arm7.verdict
    assert (verdict.use, verdict.reasons, verdict.advice, verdict.words) == ("yes", (), (), "can be used")
    assert verdict.tool is not None
    assert (verdict.tool.link, verdict.tool.base) == ("slm", "screen")
    assert verdict.tool.in_base.better > 0.999
    verdict.require_usable()


@pytest.mark.parametrize("case", ["pose", "head camera", "reference carried", "several targets", "lasers and points", "sessions"])
def test_good_sets_of_every_arrangement_can_be_used(robots: dict[str, Robot], case: str) -> None:
    """60 poses of what is wrong by millimetres, read to tenths of one, make a calibration that can be used."""
    robot, data = points(robots, 60, case)
    assert fit(robot, data).verdict.use in ("yes", "reservations")


def test_five_points_for_thirty_unknowns_are_refused(robots: dict[str, Robot]) -> None:
    """Residuals of micrometres are no accuracy where fewer numbers were read than there are unknowns."""
    robot, data = points(robots, 5)
    found = fit(robot, data)
    assert found.after["tool0"].mean < 0.01
    assert found.verdict.use == "no"
    assert re.search(r"15 numbers were read at 5 poses, fewer than the \d\d unknowns", found.verdict.words)


def test_three_poses_of_lasers_are_refused(robots: dict[str, Robot]) -> None:
    """Twelve numbers leave a hundred millimetres open on the screen."""
    data = example(robots).split()[0]
    assert fit(robots["arm7"], data.subset(np.arange(3))).verdict.use == "no"


@pytest.mark.parametrize("copies", [1, 30])
def test_one_pose_again_and_again_is_one_pose(robots: dict[str, Robot], copies: int) -> None:
    """Thirty readings of one pose are refused like one."""
    robot, data = points(robots, 1, "pose")
    rng = np.random.default_rng(0)
    again = data.subset(np.zeros(copies, dtype=int))
    values = again.readings[0].values + rng.normal(0, 1e-4, (copies, 3))
    again = replace(again, readings=(replace(again.readings[0], values=values), *again.readings[1:]))
    verdict = fit(robot, again, sane=False).verdict
    assert verdict.use == "no"
    assert "6 numbers were read at 1 pose" in verdict.words or "numbers" not in verdict.words


def test_a_sigma_in_another_unit_is_refused(robots: dict[str, Robot]) -> None:
    """Tenths of a millimetre stated as tenths of a metre make chi-square a millionth; twice the noise is a reservation, the noise none."""
    robot, data = points(robots, 60)
    verdicts = [fit(robot, stated(data, sigma)).verdict for sigma in (0.1, 0.18e-3, 0.1e-3)]
    assert [verdict.use for verdict in verdicts] == ["no", "reservations", "yes"]
    assert "is the noise stated in another unit?" in verdicts[0].words
    assert "chi-square" in verdicts[1].words


def test_a_robot_that_is_right_already_is_not_made_better(robots: dict[str, Robot]) -> None:
    """Fitted once more to its own calibrated URDF's readings nothing is clearly better, and that is said with both errors."""
    rng = np.random.default_rng(4)
    setup = setup_of(CASES["point"], robots, rng)
    right = replace(setup, x=np.zeros_like(setup.x))
    found = fit(setup.robot, simulate_readings(right, 25, rng, replace(NOISE, length=1e-3)))
    assert found.verdict.use == "no"
    assert re.search(r"predicted .* off, which is not clearly below the nominal robot's|made nothing better", found.verdict.words)


def tables(found: FitResult, times: float) -> FitResult:
    """The same with test readings so many times as far off as the fitted ones."""
    unit = {name: replace(row, mean=row.mean * times, std=row.std * times) for name, row in found.after.items()}
    return replace(found, test=(found.before, unit))


@pytest.mark.parametrize(("times", "use"), [(1.1, "yes"), (2.5, "reservations"), (5.0, "no"), (1e3, "no")])
def test_test_readings_count(arm7: Calibration, times: float, use: str) -> None:
    """Half as much again as can be expected is a reservation; three times, or more than the nominal robot's, is not to be used."""
    verdict = verdict_of(tables(arm7, times))
    assert verdict.use == use
    assert ("test readings are" in verdict.words) == (use != "yes")
    assert ("with the nominal robot" in verdict.words) == (times == 1e3)


def test_folds_are_test_readings(robots: dict[str, Robot]) -> None:
    """Poses left out in turn are judged like test poses; of healthy data they are no reservation."""
    robot, data = points(robots, 40)
    found = fit(robot, data)
    folds = kfold(robot, data, 4, np.random.default_rng(0))
    assert verdict_of(replace(found, folds=folds)).use == "yes"
    far = {name: SpotErrors(row.mean * 50, row.std * 50, row.max * 50, row.n) for name, row in folds.after.items()}
    judged = verdict_of(replace(found, folds=replace(folds, after=far)))
    assert judged.use == "no"
    assert "readings left out in turn (4 fits)" in judged.words


def test_a_fit_that_went_wrong_is_refused_without_more_ado(robots: dict[str, Robot]) -> None:
    """After one sweep nothing is predicted; the reason is the fit's own, and `require_trustworthy` raises with it."""
    found = fit(robots["arm7"], example(robots), max_sweeps=1)
    assert (found.verdict.use, found.verdict.reasons, found.verdict.tool) == ("no", (found.rejection,), None)
    with pytest.raises(FitRejected, match="did not converge"):
        found.require_trustworthy()


def test_the_verdict_is_about_the_link_that_is_asked_for(arm7: Calibration) -> None:
    """With `tool` the prediction is that link's, nearer to the base and less far off."""
    other = verdict_of(replace(arm7, tool="link3"))
    assert other.tool is not None
    assert arm7.verdict.tool is not None
    assert other.tool.link == "link3"
    assert other.tool.in_base.before.rms < arm7.verdict.tool.in_base.before.rms


def test_few_poses_are_told_how_many_would_do(robots: dict[str, Robot]) -> None:
    """A set that leaves much open names a number of poses of its kind, and that many make the prediction good."""
    robot, data = points(robots, 4)
    verdict = fit(robot, data, sane=False).verdict
    assert verdict.use == "no"
    assert verdict.tool is not None
    assert verdict.tool.up_to_constant.left > 0.5
    assert re.fullmatch(r"more poses: about \d+ of the same kind would bring tool0 under 33% of the nominal robot's error", *verdict.advice)


def spoilt(data: Measurements, rows: list[int], rng: np.random.Generator) -> Measurements:
    """The same with some points thrown 50 mm off in directions of their own."""
    off = np.zeros((len(data), 3))
    off[rows] = rng.normal(size=(len(rows), 3))
    off[rows] *= 50e-3 / np.linalg.norm(off[rows], axis=1, keepdims=True)
    return replace(data, readings=tuple(replace(own, values=own.values + off) for own in data.readings))


def test_a_few_bad_readings_make_no_bad_calibration(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Three of 80 readings are bad: left out in turn they are no reason against it, and one among the test poses is a reservation."""
    robot, data = points(robots, 80)
    bad = spoilt(data, [7, 31, 52], rng)
    found = fit(robot, bad)
    assert len(found.outliers) == 3
    assert verdict_of(found).use == "yes"
    assert verdict_of(replace(found, folds=kfold(robot, bad, 4, rng))).use == "yes"
    tested = verdict_of(fit(robot, bad.subset(np.arange(80) != 52), test=bad.subset(np.arange(50, 60))))
    assert (tested.use, "1 test reading is a gross outlier" in tested.words) == ("reservations", True)


def test_many_bad_test_readings_are_a_reason_against_it(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Where a third of the test readings is far off, the calibration is not what they say it is."""
    robot, data = points(robots, 80)
    test = spoilt(data.subset(np.arange(60, 80)), [1, 4, 7, 10, 13, 16, 19], rng)
    assert verdict_of(fit(robot, data.subset(np.arange(60)), test=test)).use == "no"


def test_what_only_leaves_aside_is_not_known(robots: dict[str, Robot]) -> None:
    """Zeros alone are judged the same, whether they were asked for as a model or as parameters; what is fixed is taken at its word."""
    robot, data = points(robots, 60, "pose")
    narrowed, offset = fit(robot, data, only=["*.d_theta"]), fit(robot, data, error_model="offset")
    predicted = [found.verdict.tool.up_to_constant.after.rms for found in (narrowed, offset)]  # type: ignore[union-attr]
    assert predicted[0] == pytest.approx(predicted[1], rel=0.2)
    assert narrowed.verdict.use == offset.verdict.use


def test_joints_far_off_the_urdf_are_a_reservation(rng: np.random.Generator) -> None:
    """A hand measured as known that sits 80 mm from where the URDF has it, along the last axis, ends in its joint, and that is said."""
    robot = two_ends.robot_of(two_ends.arm("a", "base", "0.05 0.03 0.1"), [("hand", "a6_link")])
    seen, errors = two_ends.seen(robot, "hand_link", "base", known=True)
    data = two_ends.measured(seen, errors, rng.normal(0, 1e-3, len(errors.names)), "hand_link", rng, known=True)[1]
    ends = ModelOptions(reference_known=True, target_known=True)
    assert "far off" not in fit(seen, data, options=ends).verdict.words
    elsewhere = with_text(seen, robot.description.text.replace(b"0.05 0.02 0.04", b"-0.03 0.02 0.04"))
    assert re.search(r"joints were found far off the URDF \(a6\.\S+ -?\d+ mm", fit(elsewhere, data, options=ends).verdict.words)


def test_knowledge_of_another_branch_is_no_spot(robots: dict[str, Robot]) -> None:
    """Spots fitted after an earlier calibration of the same arm are judged, and its rows are no readings."""
    robot, data = robots["arm7"], example(robots)
    first = fit(robot, data.subset(np.arange(0, 40)))
    again = with_text(robot, first.urdf())
    second = fit(again, data.subset(np.arange(40, 60)), after=first)
    assert second.verdict.spots is not None
    assert second.verdict.spots.after.rms < first.verdict.spots.after.rms  # type: ignore[union-attr]


def test_readings_of_one_pose_are_no_cluster(robots: dict[str, Robot]) -> None:
    """A healthy set whose poses were read ten times, with noise in common, has no poses where the nominal robot is surely better."""
    robot, data = points(robots, 30)
    rows = np.repeat(np.arange(30), 10)
    own = np.random.default_rng(0).normal(0, 2e-5, (300, 3))
    again = data.subset(rows)
    again = replace(again, readings=tuple(replace(reading, values=reading.values + own) for reading in again.readings))
    assert worst_clusters(fit(robot, again)) == []


def test_test_poses_may_be_read_by_one_sensor_alone(robots: dict[str, Robot]) -> None:
    """Orientations alone, of a robot that was fitted to whole poses, are judged and are no fault of it."""
    robot, data = points(robots, 60, "pose")
    turned = data.subset(np.arange(40, 60))
    turned = replace(turned, readings=tuple(own for own in turned.readings if own.sensor == "orientation"))
    assert fit(robot, data.subset(np.arange(40)), test=turned).verdict.use == "yes"


@pytest.fixture(scope="module")
def hand_eye(robots: dict[str, Robot]) -> tuple[SimulatedSetup, Measurements]:
    """What a camera reads of a marker on the tool of a robot that is as its URDF says."""
    rng = np.random.default_rng(5)
    setup = setup_of(CASES["pose"], robots, rng, translation=0.0, rotation=0.0)
    return setup, simulate_readings(setup, 25, rng, NOISE)


def test_frames_alone_can_be_asked_for(hand_eye: tuple[SimulatedSetup, Measurements]) -> None:
    """Where every joint is held there is nothing to gain but where instrument and target are: both are true, and it is said."""
    setup, data = hand_eye
    apart = replace(data, sets=np.where(np.arange(len(data)) % 5 == 4, "test", "fit"))
    calibration = fit(setup.robot, apart, fix=["*_joint.*"])
    assert calibration.frames_alone
    assert not calibration.rejection
    assert calibration.verdict.use == "reservations"
    assert [re.match("nothing of the robot was estimated", reason) is not None for reason in calibration.verdict.reasons] == [True]
    assert calibration.verdict.tool is None
    truth = {slot.kind: slot.found[""] for slot in setup.errors.slots if slot.found}
    for frame, kind in zip(calibration.frames, ("reference", "target"), strict=True):
        off = pin.log6(frame.on_link.actInv(truth[kind])).vector
        assert off @ np.linalg.solve(frame.covariance, off) < 22.5  # 0.999 of chi-square with six degrees of freedom


def test_joints_that_gain_nothing_stay_refused(hand_eye: tuple[SimulatedSetup, Measurements]) -> None:
    """One joint's number in the state is enough for the robot to have to become better: here it was right."""
    setup, data = hand_eye
    calibration = fit(setup.robot, data, only=["elbow_joint.d_theta"])
    assert not calibration.frames_alone
    assert calibration.verdict.use == "no"
