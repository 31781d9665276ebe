"""Legal but odd sets of measurements: kinds with few readings, sessions that say little, places that only test poses touch."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from tests.support.sensor_cases import NOISE, SensorCase, setup_of
from urdfcal.api import fit
from urdfcal.base.errors import FitRejected, UsageError
from urdfcal.base.geometry import DEG, MM
from urdfcal.calibration.analysis.validation import kfold
from urdfcal.calibration.problem import Problem
from urdfcal.calibration.start.nominal import evaluate
from urdfcal.model.options import ModelOptions, ParameterPrior
from urdfcal.model.parameters import PriorScale
from urdfcal.robot.robot import Robot
from urdfcal.sensors.measurements import Measurements
from urdfcal.sensors.readings import Readings
from urdfcal.simulation.readings import simulate_readings

Change = Callable[[Readings], Readings]
POINTS = SensorCase("ur5", ("point:tool0",))
POSES = SensorCase("ur5", ("pose:tool0",))
TOUCHES = SensorCase("ur5", ("point:tool0", "plane:tool0:probe", "socket:tool0:ball"))


def data_of(case: SensorCase, robots: dict[str, Robot], rng: np.random.Generator, poses: int = 60) -> tuple[Robot, Measurements]:
    setup = setup_of(case, robots, rng)
    return setup.robot, simulate_readings(setup, poses, rng, NOISE)


def changed(data: Measurements, kind: str, change: Change) -> Measurements:
    return replace(data, readings=tuple(change(each) if each.sensor == kind else each for each in data.readings))


def test_a_session_without_points_shares_the_targets(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """A session in which only sockets were touched has the same target offset as the others, and fits to its noise."""
    robot, data = data_of(SensorCase("ur5", ("point:tool0", "socket:tool0:ball")), robots, rng)
    data = replace(data, sessions=np.repeat(["a", "b"], 30))
    found = fit(robot, changed(data, "point", lambda each: each.without(data.sessions == "b")), gated=False)
    assert found.converged
    assert found.after["tool0:ball socket"].mean < 3 * NOISE.length / MM


def test_a_plane_keeps_its_axes_for_test_poses(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Test poses that touch a new socket, and a known plane but once, are judged by the plane as it was fitted."""
    robot, data = data_of(TOUCHES, robots, rng, 90)
    last = np.arange(90) >= 80
    renamed = changed(data, "socket", lambda each: replace(each, labels=np.where(last & (each.labels != ""), "new", each.labels)))
    found = fit(robot, renamed.subset(~last), test=renamed.subset(last), gated=False)
    assert found.test is not None
    assert found.test[1]["tool0:probe plane"].max < 8 * NOISE.length / MM


def test_cross_validation_places_what_no_fit_saw(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """A socket that is touched in one fold alone is put where that fold has it, not at the origin."""
    robot, data = data_of(SensorCase("ur5", ("point:tool0", "socket:tool0:ball")), robots, rng)
    names = [f"one {number}" for number in range(60)]
    lone = changed(data, "socket", lambda each: replace(each, labels=np.where(each.labels == "1", names, each.labels)))
    folds = kfold(robot, lone, 4, rng, gated=False)
    assert folds.fold_rms.max() < 6 * NOISE.length / MM


def test_degrees_of_freedom_are_never_more_than_the_numbers(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """With joints that hardly moved the scales' uncertainty does not add measurements that nobody made."""
    setup = setup_of(POINTS, robots, rng)
    joints = np.tile(rng.uniform(-1, 1, 6), (25, 1))
    joints[:, 3:] = rng.uniform(-2, 2, (25, 3))
    errors, x = setup.errors, setup.x
    blank = replace(simulate_readings(setup, 25, rng), q=joints)
    points = changed(blank, "point", lambda each: replace(each, values=np.zeros((25, 3))))
    read = -Problem(errors, points).linearise(x).residual + rng.normal(0, NOISE.length, (25, 3))
    found = fit(setup.robot, changed(points, "point", lambda each: replace(each, values=read)), gated=False)
    assert 25 < found.freedom < found.data.numbers


def test_stated_noise_says_nothing_of_the_rest(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Half the points state half their noise: that of the others is found all the same."""
    robot, data = data_of(POINTS, robots, rng, 80)
    half = changed(data, "point", lambda each: replace(each, sigma=np.where(np.arange(80) < 40, NOISE.length / 2, np.nan)))
    found = fit(robot, half, gated=False)
    assert found.converged
    assert found.estimate.noise.sigma[0] == pytest.approx(NOISE.length, rel=0.25)


def test_a_kind_with_one_reading_keeps_its_usual_noise(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """One orientation among sixty points does not talk its noise to nothing, and is said to be assumed."""
    robot, data = data_of(POSES, robots, rng)
    found = fit(robot, changed(data, "orientation", lambda each: each.without(np.arange(60) > 0)), gated=False)
    assert found.estimate.noise.sigma[1] > 1e-4
    assert "orientation noise 0.05 deg (assumed)" in found.report()


def test_only_narrows_the_robot_and_not_its_instruments(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """With `only` the measuring frame and the target are found from nothing all the same."""
    robot, data = data_of(POINTS, robots, rng)
    found = fit(robot, data, only=("elbow_joint.*",), gated=False)
    assert found.after["tool0"].mean < found.before["tool0"].mean < 50


@pytest.mark.parametrize("kind", ["plane", "socket"])
def test_a_column_that_is_empty_everywhere_is_no_obstacle(kind: str, robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Touches that nobody made leave the rest of the file as good as it is."""
    robot, data = data_of(TOUCHES, robots, rng)
    empty = changed(data, kind, lambda each: each.without(np.ones(60, dtype=bool)))
    assert fit(robot, empty, gated=False).after["tool0"].mean < 4 * NOISE.length / MM
    assert evaluate(robot, empty)["tool0"].n == 60


def test_test_poses_of_other_instruments_are_refused(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """A target that the fit knows nothing of is named in one line."""
    robot, data = data_of(POINTS, robots, rng)
    _, other = data_of(SensorCase("ur5", ("point:forearm_link",)), robots, rng)
    with pytest.raises(UsageError, match="other instruments than the fitted ones: forearm_link"):
        fit(robot, data, test=other)


def test_flat_priors_of_instruments_change_nothing(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Frames and targets are found in closed form also where no prior at all is asked for."""
    robot, data = data_of(POSES, robots, rng)
    flat = PriorScale(1e3, 1e3)
    usual, found = (fit(robot, data, options=ModelOptions(priors=priors)) for priors in ({}, {"reference": flat, "target": flat}))
    assert found.converged
    assert found.after["tool0"].mean == pytest.approx(usual.after["tool0"].mean, rel=1e-3)


def test_a_mirrored_measuring_frame_is_rejected(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Points with one axis the wrong way round are named; a fit of them as they are turns joints as no robot is made, or fails."""
    robot, data = data_of(POINTS, robots, rng)
    mirrored = changed(data, "point", lambda each: replace(each, values=each.values * [-1.0, 1.0, 1.0]))
    with pytest.raises(FitRejected, match="one axis of the points mirrored"):
        fit(robot, mirrored)
    assert fit(robot, mirrored, sane=False).rejection


def test_a_calibration_says_what_it_is_in_a_line(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Its repr holds neither URDF nor poses."""
    robot, data = data_of(POINTS, robots, rng)
    assert len(repr(fit(robot, data))) < 150


def test_a_robot_of_another_size_is_rejected(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Joints a decimetre from where they are is no calibration, however well it fits."""
    robot, data = data_of(POINTS, robots, rng, poses=80)
    shrunk = changed(data, "point", lambda each: replace(each, values=each.values / 2.54))
    found = fit(robot, shrunk, sane=False)
    assert "and no robot is made so" in found.rejection


def test_much_noise_is_said(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Points that scatter ten times as much as is usual are fitted, with a warning."""
    robot, data = data_of(POINTS, robots, rng)
    noisy = changed(data, "point", lambda each: replace(each, values=each.values + rng.normal(scale=8e-3, size=each.values.shape)))
    assert any("the points scatter by" in warning and "far more than is usual" in warning for warning in fit(robot, noisy).warnings)


def test_noise_that_too_few_poses_tell_of_is_the_usual_one(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Joints far worse than the priors do not leave their errors behind as noise once the priors were widened to them."""
    case = SensorCase("panda", ("distance:panda_link8",))
    setup = setup_of(case, robots, rng, model="auto", translation=3 * MM, rotation=1.5 * DEG)
    found = fit(setup.robot, simulate_readings(setup, 40, rng, NOISE))
    assert found.estimate.noise.sigma[0] <= 0.5 * MM
    assert found.after["panda_link8 distance"].mean < 0.3


def test_joint_noise_that_is_too_large_is_said(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Where stated noise of the joints explains more than is seen, what is left for the sensor cannot be right."""
    robot, data = data_of(POINTS, robots, rng)
    found = fit(robot, data, joint_sigma=np.radians(0.2))
    assert any("as much as the stated noise of the joints explains" in warning for warning in found.warnings)


def test_a_prior_that_was_stated_is_believed(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """A joint that may be far off, since its own prior says so, is no reason to reject the fit."""
    setup = setup_of(SensorCase("panda", ("pose:panda_link8",)), robots, rng, model="auto")
    name = "panda_joint4.d_theta"
    x = setup.x.copy()
    x[setup.errors.names.index(name)] = np.radians(65)
    data = simulate_readings(replace(setup, x=x), 60, rng, NOISE)
    single = {name: ParameterPrior(sigma=np.radians(40))}
    assert fit(setup.robot, data, options=ModelOptions(single=single), sane=False).rejection == ""


def test_evaluate_takes_rig_files_of_more_than_was_measured(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """What a rig.yaml says of beams and of other sessions does not matter to points of one."""
    robot, data = data_of(POINTS, robots, rng)
    single = {"laser_1.rot_x": ParameterPrior(sigma=0.01), "tool0:b.trans_x": ParameterPrior(sigma=0.01)}
    assert evaluate(robot, data, ModelOptions(single=single)) == evaluate(robot, data)


WRONG_PRIORS = {
    "no group named 'joints' among 11 groups; did you mean 'joint'": {"joints": PriorScale(1e-3, 1e-3)},
    "expected a PriorScale": {"joint": "1mm,1deg"},
}


@pytest.mark.parametrize("said", WRONG_PRIORS)
def test_priors_that_mean_nothing_are_refused(said: str, robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """A typo in a group, or text in place of numbers, is said at once; and so are a model or a path in place of robot and data."""
    robot, data = data_of(POINTS, robots, rng)
    with pytest.raises(UsageError, match=said):
        fit(robot, data, priors=WRONG_PRIORS[said])  # type: ignore[arg-type]
    with pytest.raises(UsageError, match="expected a Robot"):
        fit(robot.model, data)
    with pytest.raises(UsageError, match="expected Measurements"):
        fit(robot, "measurements.csv")  # type: ignore[arg-type]
    with pytest.raises(UsageError, match="must be above zero"):
        PriorScale(0.0, 0.1)


def test_perfect_data_of_a_perfect_robot(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Nothing to find and no noise to find it by: the fit ends, with sigmas that are numbers."""
    setup = setup_of(POINTS, robots, rng, model="auto", translation=0.0, rotation=0.0)
    found = fit(setup.robot, simulate_readings(setup, 60, rng))
    assert found.converged
    assert np.isfinite(found.sigma).all()
