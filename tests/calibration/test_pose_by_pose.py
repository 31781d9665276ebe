"""One pose at a time against all of them at once."""

from __future__ import annotations

import copy
import pickle

import numpy as np
import pytest

from tests.support.sensor_cases import CASES, session_errors, setup_of
from urdfcal.calibration.pose_by_pose import PoseByPose
from urdfcal.calibration.problem import Problem
from urdfcal.model.options import ModelOptions
from urdfcal.robot.robot import Robot
from urdfcal.simulation.readings import simulate_readings

SOME = ("every kind", "sessions", "hand sees hand", "inclination", "points on the base")


@pytest.mark.parametrize("name", SOME)
def test_a_pose_is_linearised_as_among_all(name: str, robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Residual and derivatives by parameters and joints are those that a sweep over all poses has, also of what is read in part."""
    case, setup = CASES[name], setup_of(CASES[name], robots, rng)
    data = simulate_readings(setup, 3, rng)
    data = data.without(np.arange(3)[:, None] == 2 + np.arange(len(data.readings)))  # the first reading of the last pose
    errors, x = session_errors(setup, ModelOptions(reference_known=case.known), data)
    x = x + rng.normal(0, 5e-3, len(x))
    every = Problem(errors, data, joints=True).linearise(x)
    for row in range(len(data)):
        pose, values = data.subset([row]), [reading.values[row] for reading in data.readings]
        one = PoseByPose(Problem(errors, pose, joints=True), x)
        own, measured = one.at(pose.q[0], values), one.measured(values)
        rows = slice(None) if measured is None else measured
        assert len(own.residual[rows]) == np.count_nonzero(every.measured[row])
        for found, expected in ((own.residual, every.residual), (own.H, every.jacobian), (own.by_joints, every.joint_jacobian)):
            read = expected[row][every.measured[row]]
            np.testing.assert_allclose(found[rows], read, rtol=1e-9, atol=1e-12 * np.abs(expected).max())
        assert own.lost is None or not own.lost[rows].any()


def test_copies_go_their_own_ways(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """A copy, a deep one and one out of a pickle say of a pose what the first says, also after it has taken up another."""
    setup = setup_of(CASES["hand sees hand"], robots, rng)
    pose = simulate_readings(setup, 1, rng)
    errors, x = session_errors(setup, ModelOptions(), pose)
    one, values = PoseByPose(Problem(errors, pose), x), [reading.values[0] for reading in pose.readings]
    expected = one.at(pose.q[0], values)
    for twin in (copy.copy(one), copy.deepcopy(one), pickle.loads(pickle.dumps(one))):
        one.at(pose.q[0] + 0.3, values)
        np.testing.assert_array_equal(twin.at(pose.q[0], values).H, expected.H)
