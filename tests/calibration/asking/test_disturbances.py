"""What a rig may do, against differences and against exact simulations."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import urdfcal
from tests.support.disturbed import disturbed_arm
from tests.support.paths import ROBOTS_DIR
from urdfcal.calibration.asking.disturbances import courses_of, progress
from urdfcal.calibration.asking.folds import clustered
from urdfcal.calibration.asking.rig import RigColumns
from urdfcal.calibration.problem import Problem
from urdfcal.model.error_model import with_rig

SENSORS = {"panda": "laser", "ur5": "distance:tool0", "tiago": "pose:arm_tool_link"}
LEFT_OUT = ("drift", "wander", "temperature", "screen_bow")  # of whose effect on other derivatives hundredths are left out


@pytest.fixture(params=SENSORS)
def disturbed(request: pytest.FixtureRequest, rng: np.random.Generator) -> tuple[Problem, np.ndarray]:
    """Everything that a rig may do at once, at some state."""
    name = request.param
    robot = urdfcal.load_robot(ROBOTS_DIR / name / f"{name}.urdf.xacro")
    arm = disturbed_arm(robot, SENSORS[name], "none", 3, poses=8, unseen=1)
    data = replace(arm.fit, temperature=rng.uniform(20, 30, len(arm.fit)))
    terms = RigColumns(Problem(arm.errors, data), arm.x).terms
    errors = with_rig(arm.errors, terms, courses_of(data))
    return Problem(errors, data), np.concatenate([arm.x, [rng.normal(0, term.sigma) for term in terms]])


def test_a_rig_s_columns_are_derivatives(disturbed: tuple[Problem, np.ndarray]) -> None:
    """Of the residual by every number of the rig, by central differences."""
    problem, x = disturbed
    J, step = problem.linearise(x).jacobian, 1e-6
    for column, name in enumerate(problem.errors.names):
        if name.partition(".")[0] not in {term.what for term in problem.errors.rig.terms}:
            continue
        aside = step * np.eye(len(x))[column]
        numeric = (problem.linearise(x - aside).residual - problem.linearise(x + aside).residual) / (2 * step)
        np.testing.assert_allclose(J[:, :, column], numeric, atol=1e-6, err_msg=name)


def test_what_instruments_do_is_in_the_other_derivatives(disturbed: tuple[Problem, np.ndarray]) -> None:
    """Of the robot's own parameters, where an instrument bends what it reads."""
    problem, x = disturbed
    still = np.array([name.startswith(LEFT_OUT) for name in problem.errors.names])
    x = np.where(still, 0.0, x)
    J, step = problem.linearise(x).jacobian, 1e-6
    for column, parameter in enumerate(problem.errors.parameters):
        if parameter.kind != "joint":
            continue
        aside = step * np.eye(len(x))[column]
        numeric = (problem.linearise(x - aside).residual - problem.linearise(x + aside).residual) / (2 * step)
        scale = max(1.0, float(np.abs(numeric).max()))
        np.testing.assert_allclose(J[:, :, column] / scale, numeric / scale, atol=2e-4, err_msg=parameter.name)


def test_time_counts_where_it_is_said_and_the_order_elsewhere(rng: np.random.Generator) -> None:
    """From -1/2 to 1/2 over the fitted poses; poses of another series, whose order says nothing, are in the midst."""
    robot = urdfcal.load_robot(ROBOTS_DIR / "ur5" / "ur5.urdf.xacro")
    data = disturbed_arm(robot, "point:tool0", "none", 3, poses=5, unseen=1).fit
    courses = courses_of(data)
    np.testing.assert_allclose(progress(data, courses)["time"], [-0.5, -0.25, 0, 0.25, 0.5])
    np.testing.assert_allclose(progress(data.subset(np.array([3, 1])), courses)["time"], [0.25, -0.25])
    np.testing.assert_allclose(progress(replace(data, series="another"), courses)["time"], 0.0)
    timed = replace(data, time=np.array([0.0, 1, 2, 3, 100]))
    np.testing.assert_allclose(progress(replace(timed, series="another"), courses_of(timed))["time"], [-0.5, -0.49, -0.48, -0.47, 0.5])


def test_the_order_of_poses_is_no_time_in_seconds() -> None:
    """Poses that do not say when they were measured are in the midst of a course that goes by seconds."""
    robot = urdfcal.load_robot(ROBOTS_DIR / "ur5" / "ur5.urdf.xacro")
    data = disturbed_arm(robot, "point:tool0", "none", 3, poses=5, unseen=1).fit
    timed = replace(data, time=np.array([0.0, 1, 2, 3, 100]))
    np.testing.assert_allclose(progress(replace(data, source="other.csv"), courses_of(timed))["time"], 0.0)


def test_clusters_are_neighbours_of_about_one_size(rng: np.random.Generator) -> None:
    """Every row is in one of them, readings of one configuration together, and two poses of one are nearer than two of any."""
    q = np.repeat(rng.uniform(-1, 1, (40, 3)), 2, axis=0)
    configuration = np.repeat(np.arange(40), 2)
    folds = clustered(q, configuration)
    assert sorted(np.concatenate(folds).tolist()) == list(range(80))
    assert {len(fold) for fold in folds} == {10}
    assert all(len(set(configuration[fold])) == 5 for fold in folds)
    inside = np.mean([np.linalg.norm(q[fold] - q[fold].mean(axis=0), axis=1).mean() for fold in folds])
    assert inside < 0.8 * np.linalg.norm(q - q.mean(axis=0), axis=1).mean()
