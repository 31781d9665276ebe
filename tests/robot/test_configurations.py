"""Configurations of the whole robot from positions of some joints."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from tests.support.small_robot import joint, robot_of, robot_text
from urdfcal.robot.configurations import WholeRobot, whole_configurations
from urdfcal.robot.robot import Robot

CHAINED = robot_text(
    joint("one", "screen", "a", '<axis xyz="0 0 1"/>'),
    joint("two", "a", "b", '<axis xyz="0 1 0"/><mimic joint="three" multiplier="-2" offset="0.3"/>'),
    joint("three", "b", "c", '<axis xyz="1 0 0"/><mimic joint="one" multiplier="0.5" offset="-0.1"/>'),
    joint("turning", "c", "d", '<axis xyz="0 0.6 0.8"/>', kind="continuous"),
    joint("slide", "d", "laser_1", '<axis xyz="1 0 0"/>', kind="prismatic"),
    joint("aside", "a", "laser_2", '<axis xyz="1 0 0"/>'),
)


@pytest.mark.parametrize("name", ["panda", "ur5", "tiago", "arm7"])
def test_configurations_are_steps_from_neutral(name: str, robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Positions of the measured joints are Pinocchio's tangent steps from neutral, whatever joints are continuous."""
    robot = robots[name]
    q, model = rng.uniform(-4, 4, (5, len(robot.chain.inputs))), robot.model
    steps = np.zeros((5, model.nv))
    for column, own in enumerate(robot.chain.inputs):
        steps[:, model.joints[model.getJointId(own.name)].idx_v] = q[:, column]
    expected = [pin.integrate(model, pin.neutral(model), step) for step in steps]
    np.testing.assert_allclose(whole_configurations(robot, q), expected, atol=1e-12)


def test_followers_of_followers_stand_where_their_leaders_put_them(rng: np.random.Generator) -> None:
    """two = -2 three + 0.3 and three = one / 2 - 0.1; what was not given stays at neutral; a continuous joint has cosine and sine."""
    robot, q = robot_of(CHAINED), rng.uniform(-2, 2, (4, 3))
    model = robot.model
    whole = WholeRobot(robot, ["slide", "one", "turning"]).configurations(q)
    column = {name: whole[:, model.idx_qs[model.getJointId(name)]] for name in model.names[1:]}
    np.testing.assert_allclose(column["one"], q[:, 1])
    np.testing.assert_allclose(column["three"], q[:, 1] / 2 - 0.1)
    np.testing.assert_allclose(column["two"], 0.3 - 2 * column["three"])
    np.testing.assert_allclose(column["turning"], np.cos(q[:, 2]))
    np.testing.assert_allclose(whole[:, model.idx_qs[model.getJointId("turning")] + 1], np.sin(q[:, 2]))
    np.testing.assert_array_equal(column["slide"], q[:, 0])
    assert not column["aside"].any()


def test_positions_of_a_follower_say_nothing(rng: np.random.Generator) -> None:
    """A mimic joint goes by its leader, even where positions of its own are given."""
    robot = robot_of(CHAINED)
    q = rng.uniform(-2, 2, (3, 1))
    both = WholeRobot(robot, ["one", "two"]).configurations(np.column_stack([q, np.full(3, 9.0)]))
    np.testing.assert_array_equal(both, WholeRobot(robot, ["one"]).configurations(q))
