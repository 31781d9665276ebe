"""Joints that are counted together: which are tried, and what undoes them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from tests.support.small_robot import joint, robot_of, robot_text
from urdfcal.calibration.start.couplings import mistakes_of_couplings
from urdfcal.robot.robot import Robot
from urdfcal.sensors.measurements import Measurements, spots_measured

LASER = joint("m1", "d", "laser_1", '<origin xyz="0.5 0 0.2" rpy="0 1.3 0"/>', kind="fixed")
SCARA = robot_text(
    joint("j1", "screen", "a", '<origin xyz="-1 0 0.3"/><axis xyz="0 0 1"/>'),
    joint("j2", "a", "b", '<origin xyz="0.3 0 0" rpy="3.141592653589793 0 0"/><axis xyz="0 0 1"/>'),
    joint("j3", "b", "c", '<origin xyz="0.2 0 0"/><axis xyz="0 0 1"/>', kind="prismatic"),
    joint("j4", "c", "d", "<axis xyz='0 0 1'/>"),
    LASER,
    links="screen a b c d laser_1",
)


def undone(robot: Robot, q: np.ndarray) -> dict[str, np.ndarray]:
    """What every mistake makes of joints."""
    data = spots_measured(robot, q, np.zeros((len(q), len(robot.rig.lasers), 2)))
    return {mistake.undone: mistake.change(data).q for mistake in mistakes_of_couplings(robot.chain)}


def test_a_hand_that_is_counted_from_the_base_is_tried(rng: np.random.Generator) -> None:
    """A SCARA's last joint with each of the two before it and with both, signs as their axes point; slides take no part."""
    robot, q = robot_of(SCARA), rng.uniform(-1, 1, (5, 4))
    found = undone(robot, q)
    names = ["j1 added to j2", "j1 subtracted from j2"]
    names += [f"{name} {word} j4" for name in ("j1", "j2") for word in ("added to", "subtracted from")]
    names += ["j1 added to j4 and j2 subtracted from j4", "j2 added to j4 and j1 subtracted from j4"]
    assert set(found) == set(names)
    both = found["j2 added to j4 and j1 subtracted from j4"]
    np.testing.assert_allclose(both[:, 3], q[:, 3] + q[:, 1] - q[:, 0])
    np.testing.assert_array_equal(both[:, :3], q[:, :3])


def test_successive_joints_are_tried_whatever_their_axes(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """On a Panda, without parallel neighbours, every joint with the one before it, either way; no two do the same, and data stay."""
    robot = robots["panda"]
    q = rng.uniform(-1, 1, (5, 7))
    before, found = q.copy(), undone(robot, q)
    assert len(found) == 12
    assert len({np.round(own, 9).tobytes() for own in found.values()}) == 12
    np.testing.assert_array_equal(q, before)


def test_a_parallel_run_is_tried_beyond_neighbours(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """UR's second to fourth axes are parallel: the fourth is tried with the second, the third and both."""
    found = undone(robots["ur5"], rng.uniform(-1, 1, (5, 6)))
    assert {"shoulder_lift_joint added to wrist_1_joint", "shoulder_lift_joint and elbow_joint added to wrist_1_joint"} <= set(found)
    assert "shoulder_pan_joint added to elbow_joint" not in found


def test_what_is_undone_is_what_was_done(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """J3 read as J3 - J2 comes back by adding J2."""
    robot = robots["ur5"]
    q = rng.uniform(-1, 1, (5, 6))
    read = q - q[:, [1]] * (np.arange(6) == 2)
    data: Measurements = replace(spots_measured(robot, read, np.zeros((5, len(robot.rig.lasers), 2))))
    mistake = next(own for own in mistakes_of_couplings(robot.chain) if own.undone == "shoulder_lift_joint added to elbow_joint")
    np.testing.assert_allclose(mistake.change(data).q, q, atol=1e-12)
