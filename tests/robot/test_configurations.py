"""Configurations of the whole robot from positions of some joints."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from tests.support.small_robot import joint, robot_of, robot_text
from urdfcal.base.errors import UsageError
from urdfcal.robot.configurations import WholeRobot, joint_limits, require_room, whole_configurations, without_room
from urdfcal.robot.rig import Instruments, Target
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


HELD = robot_text(
    joint("one", "a", "b", '<axis xyz="0 0 1"/>').replace("-9", "0.5").replace('"9"', '"0.5"'),
    joint("two", "b", "c", '<axis xyz="0 1 0"/>').replace("-9", "-1").replace('"9"', '"2"'),
    joint("three", "c", "d", kind="continuous"),
    joint("slide", "d", "e", kind="prismatic").replace("-9", "0").replace('"9"', '"0"'),
    links="a b c d e",
)


def seen(text: str) -> Robot:
    return robot_of(text).seen_by(Instruments((Target("e", "e"),), placed=True), ())


def test_a_measured_range_stands_for_limits_that_leave_no_room(rng: np.random.Generator) -> None:
    """Only joints whose limits are the same get the range that was measured; without measurements all keep their limits."""
    robot, q = seen(HELD), rng.uniform(-3, 3, (20, 4))
    np.testing.assert_array_equal(joint_limits(robot).T, [[0.5, 0.5], [-1, 2], [-np.pi, np.pi], [0, 0]])
    measured = [[q[:, 0].min(), q[:, 0].max()], [-1, 2], [-np.pi, np.pi], [q[:, 3].min(), q[:, 3].max()]]
    np.testing.assert_array_equal(joint_limits(robot, q).T, measured)
    np.testing.assert_array_equal(joint_limits(robot, q[:0]), joint_limits(robot))


def test_limits_farther_than_any_joint_goes_are_none() -> None:
    """Joints that a simulator lets go to 1e16 are drawn as ones without limits; some turns of a winch are limits."""
    endless = HELD.replace('lower="-1" upper="2"', 'lower="-1e16" upper="1e16"').replace('lower="0" upper="0"', 'lower="0" upper="1e9"')
    np.testing.assert_array_equal(joint_limits(seen(endless)).T[[1, 3]], [[-np.pi, np.pi], [-1, 1]])
    winch = HELD.replace('lower="-1" upper="2"', 'lower="-40" upper="400"')
    np.testing.assert_array_equal(joint_limits(seen(winch)).T[1], [-40, 400])


def test_no_room_at_all_is_refused() -> None:
    """A robot in which something moves is drawn; one in which nothing does is refused with the joints' names and the way out."""
    require_room(seen(HELD))
    assert without_room(seen(HELD)) == "lower and upper limit of one, slide are the same"
    still = HELD.replace('lower="-1" upper="2"', 'lower="0" upper="0"').replace('type="continuous"', 'type="fixed"')
    with pytest.raises(UsageError, match=r"small\.urdf: lower and upper limit of one, two, slide are the same, which leaves no workspace"):
        require_room(seen(still))
