"""Starts far from the truth: aims, where the fit begins, and whose priors are widened."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.support.helpers import central_differences
from urdfcal.base.geometry import DEG, MM, Vector
from urdfcal.calibration.problem import Problem
from urdfcal.calibration.reach import draw_poses
from urdfcal.calibration.start.aim import misses
from urdfcal.calibration.start.rig_search import find_start, rig_columns
from urdfcal.estimation.ekf import Belief, Estimate, iterated_schedule
from urdfcal.estimation.noise import Noise
from urdfcal.model.error_model import ErrorModel
from urdfcal.model.gauge import build_error_model
from urdfcal.model.options import ModelOptions
from urdfcal.robot.robot import Robot
from urdfcal.sensors.measurements import Measurements, spots_measured
from urdfcal.simulation.readings import SimulatedNoise, simulate

CASES = [("panda", ()), ("ur5", ()), ("arm7", ("screen",)), ("arm7", ())]


def model_of(robot: Robot, *estimate: str, model: str = "auto") -> ErrorModel:
    """An error model, with additions."""
    return build_error_model(robot.chain, robot.rig, ModelOptions(error_model=model, estimate=estimate))


def far_truth(errors: ErrorModel, rng: np.random.Generator, mm: float = 300, deg: float = 20) -> Vector:
    """Joints 20 mm and 3 deg, screen and module `mm` and `deg` off in random directions."""
    lengths = np.array(errors.units) == "m"
    x = rng.normal(0, np.where(lengths, 20 * MM, 3 * DEG))
    for columns in rig_columns(errors):
        for part, size in ((columns[lengths[columns]], mm * MM), (columns[~lengths[columns]], deg * DEG)):
            x[part] *= size / np.linalg.norm(x[part])
    return x


def measured(robot: Robot, errors: ErrorModel, x: Vector, rng: np.random.Generator, poses: int = 60, outliers: float = 0.0) -> Measurements:
    """Spots with 1 mm of noise, some of them up to 200 mm off."""
    data = simulate(robot, errors, x, draw_poses(robot, errors, x, poses, rng), rng, SimulatedNoise(1 * MM))
    bad = rng.random(data.seen.shape) < outliers
    return data.with_spots(data.spots + bad[..., None] * rng.uniform(-200 * MM, 200 * MM, data.spots.shape))


def noise_of(robot: Robot) -> Noise:
    """What `fit` assumes where nothing is stated."""
    return Noise(1 * MM, np.zeros(len(robot.chain.inputs)), stated=False)


def fitted(model: Problem, errors: ErrorModel, noise: Noise, x: Vector) -> Estimate:
    """The iterated fit from a given state."""
    return iterated_schedule(model.linearise, Belief.independent(errors.mean, errors.sigma), noise, start=x)


@pytest.mark.parametrize("where", ["on the screen", "turned away from it"])
def test_the_miss_has_its_jacobian(robots: dict[str, Robot], rng: np.random.Generator, where: str) -> None:
    """Derivatives of the misses equal central differences, with sessions, beams and unseen spots, and behind the screen as before it."""
    robot = robots["panda"]
    errors = build_error_model(robot.chain, robot.rig, ModelOptions(estimate=("beams4",)), sessions=("a", "b"))
    q, spots = rng.uniform(-2, 2, (6, len(robot.chain.inputs))), rng.uniform(-1, 1, (6, 2, 2))
    spots[2, 1] = np.nan
    model = Problem(errors, spots_measured(robot, q, spots, sessions=["a", "b"] * 3))
    x = rng.normal(0, 0.05, len(errors.names))
    x[errors.names.index("slm.rot_y")] = 0.0 if where == "on the screen" else 3.0
    expected = central_differences(lambda at: misses(model, at).e, x)
    np.testing.assert_allclose(misses(model, x).jacobian, expected, atol=1e-8)
    assert not misses(model, x).e[2, 1].any()


@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize(("name", "estimate"), CASES)
def test_a_fit_from_afar_reaches_the_answer(robots: dict[str, Robot], name: str, estimate: tuple[str, ...], seed: int) -> None:
    """With the rig 300 mm and 20 deg off and bad joints, the fit from the start ends where the one from the truth ends."""
    robot, rng = robots[name], np.random.default_rng(seed)
    errors = model_of(robot, *estimate)
    x, noise = far_truth(errors, rng), noise_of(robot)
    model = Problem(errors, measured(robot, errors, x, rng))
    begun = find_start(model, noise)
    found, answer = (fitted(model, begun.errors, noise, at) for at in (begun.x, x))
    assert begun.plausible
    assert found.converged
    assert answer.converged
    np.testing.assert_array_less(np.abs(found.belief.x - answer.belief.x) / np.sqrt(np.diag(answer.belief.P)), 1e-3)


def test_a_fit_from_afar_survives_outliers(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """With every fifth spot up to 200 mm off, the start still explains the others to their noise."""
    robot = robots["ur5"]
    errors = model_of(robot)
    model = Problem(errors, measured(robot, errors, far_truth(errors, rng), rng, outliers=0.2))
    begun = find_start(model, noise_of(robot))
    assert begun.plausible
    assert begun.scale < 1.5 * MM


@pytest.mark.parametrize("name", ["panda", "ur5", "arm7", "arm4"])
def test_a_good_robot_starts_at_its_prior(robots: dict[str, Robot], rng: np.random.Generator, name: str) -> None:
    """Errors of a factory robot need no start: the prior mean and the very same error model come back."""
    robot = robots[name]
    errors = model_of(robot)
    x = rng.normal(0, np.where(np.array(errors.units) == "m", 0.3 * MM, 0.05 * DEG))
    begun = find_start(Problem(errors, measured(robot, errors, x, rng)), noise_of(robot))
    assert begun.errors is errors
    assert begun.message == ""
    np.testing.assert_array_equal(begun.x, errors.mean)


def test_only_the_far_prior_is_widened(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """A module 300 mm off has its translations widened to that, and is named; all other priors, and what was known better, stay."""
    robot = robots["panda"]
    errors = model_of(robot)
    known = errors.names.index("slm.trans_x")
    errors = replace(errors, parameters=tuple(replace(p, sigma=1 * MM) if p.name == "slm.trans_x" else p for p in errors.parameters))
    x = np.zeros(len(errors.names))
    moved = [errors.names.index("slm.trans_y"), errors.names.index("slm.trans_z")]
    x[moved] = 180 * MM, 240 * MM
    begun = find_start(Problem(errors, measured(robot, errors, x, rng)), noise_of(robot))
    others = np.delete(np.arange(len(x)), moved)
    np.testing.assert_array_equal(begun.errors.sigma[others], errors.sigma[others])
    np.testing.assert_allclose(begun.errors.sigma[moved], 300 * MM, atol=10 * MM)
    assert begun.errors.sigma[known] == 1 * MM
    assert begun.message.startswith("'slm' was found 30")
    assert "its prior was widened to" in begun.message


def test_joints_stand_for_a_screen_without_placement(robots: dict[str, Robot]) -> None:
    """On the paper's arm the first joint and one length of the second carry all of the screen but its yaw; auto has that, too."""
    errors = model_of(robots["arm7"], model="hayati")
    stand_ins = [errors.names[column] for column in rig_columns(errors)[0]]
    assert stand_ins == ["joint1.d_a", "joint1.d_d", "joint1.d_alpha", "joint1.d_theta", "joint2.d_d"]
    complete = model_of(robots["arm7"])
    assert {complete.names[column] for column in rig_columns(complete)[0]} == {*stand_ins, "joint1.d_beta"}
    assert len(rig_columns(model_of(robots["arm7"], "screen"))) == 2


@pytest.mark.parametrize("only", ["*.d_theta", "slm.*", "panda_joint2.d_alpha"])
def test_what_is_held_stays(robots: dict[str, Robot], rng: np.random.Generator, only: str) -> None:
    """With most parameters held, a far rig cannot be followed, and the start says so in place of failing."""
    robot = robots["panda"]
    whole = model_of(robot)
    few = build_error_model(robot.chain, robot.rig, ModelOptions(only=(only,)))
    begun = find_start(Problem(few, measured(robot, whole, far_truth(whole, rng), rng)), noise_of(robot))
    assert begun.x.shape == (len(few.names),)
    assert not begun.plausible


def test_a_screen_that_joints_cannot_follow_is_followed_in_part(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Under hayati the paper's arm has no yaw of its screen: that is left over, the rest is found, and the start is not called good."""
    robot = robots["arm7"]
    whole = model_of(robot, "screen")
    x = np.zeros(len(whole.names))
    x[[whole.names.index("screen.trans_x"), whole.names.index("screen.rot_z")]] = 300 * MM, 10 * DEG
    begun = find_start(Problem(model_of(robot, model="hayati"), measured(robot, whole, x, rng)), noise_of(robot))
    assert not begun.plausible
    assert begun.message.startswith("'screen' was found")
    assert "as far as joint1.d_a, joint1.d_d, joint1.d_alpha, joint1.d_theta, joint2.d_d can stand for its placement" in begun.message


def test_data_that_nothing_explains_are_not_plausible(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Spots at random leave a start that says so, and widen no prior."""
    robot = robots["ur5"]
    errors = model_of(robot)
    data = measured(robot, errors, errors.mean, rng)
    begun = find_start(Problem(errors, data.with_spots(rng.uniform(-1, 1, data.spots.shape))), noise_of(robot))
    assert not begun.plausible
    assert begun.message == ""
    assert begun.errors is errors
