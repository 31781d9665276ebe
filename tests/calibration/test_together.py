"""Whether outliers lie together: told where they do, and hardly ever said where they are scattered."""

from __future__ import annotations

import numpy as np
import pytest

from urdfcal.base.geometry import DEG, Mask, Matrix
from urdfcal.calibration.together import FALSE_ALARMS, lie_together
from urdfcal.robot.robot import Robot
from urdfcal.sensors.measurements import Measurements, spots_measured


def poses(robot: Robot, q: Matrix, sessions: list[str] | None = None) -> Measurements:
    """Poses of a Panda with spots that mean nothing."""
    return spots_measured(robot, q, np.zeros((len(q), 2, 2)), sessions=sessions)


def drawn(count: int, rng: np.random.Generator) -> Matrix:
    """Joint positions, (count, 7)."""
    return np.asarray(rng.uniform(-1, 1, (count, 7)))


@pytest.fixture
def panda(robots: dict[str, Robot]) -> Robot:
    """A Panda."""
    return robots["panda"]


def test_scattered_outliers_raise_few_alarms(panda: Robot, rng: np.random.Generator) -> None:
    """Outliers at random, in sets measured in any order, are said to lie together no more often than promised."""
    alarms = 0
    for number in range(60):
        count = int(rng.choice([30, 60, 150]))
        q = drawn(count, rng) if number % 2 else np.cumsum(drawn(count, rng), axis=0) / 10  # an order that is a path
        out = np.zeros(count, dtype=bool)
        out[rng.choice(count, max(3, count // int(rng.choice([5, 10, 20]))), replace=False)] = True
        alarms += bool(lie_together(panda.chain, poses(panda, q, ["a"] * (count // 2) + ["b"] * (count - count // 2)), out))
    assert alarms <= 60 * FALSE_ALARMS + 3 * np.sqrt(60 * FALSE_ALARMS)


def told(panda: Robot, q: Matrix, out: Mask, sessions: list[str] | None = None) -> str:
    """Where outliers lie together, in one line."""
    return "; ".join(lie_together(panda.chain, poses(panda, q, sessions), out))


def test_neighbours_in_joint_space_are_told(panda: Robot, rng: np.random.Generator) -> None:
    """Outliers that are all near one configuration are said to lie together in joint space."""
    q = drawn(100, rng)
    q[::10] = 0.5 + rng.normal(0, 0.05, (10, 7))
    assert "in joint space" in told(panda, q, np.arange(100) % 10 == 0)


def test_one_joints_motion_is_told_with_its_range(panda: Robot, rng: np.random.Generator) -> None:
    """Outliers wherever one joint is at one end are said to be there, with a stretch that holds most of them."""
    q = drawn(100, rng)
    words = told(panda, q, q[:, 3] > 0.8)
    low, high = (float(word) for word in words.partition("panda_joint4 (")[2].partition(" deg")[0].split(" to "))
    assert 0.8 / DEG - 1 <= low < high <= 1 / DEG + 1
    assert "panda_joint2" not in words


def test_a_rig_that_was_knocked_is_told_by_the_order(panda: Robot, rng: np.random.Generator) -> None:
    """Outliers that were measured one after the other are said to lie together in the order of measuring, or in a session."""
    q, late = drawn(100, rng), np.arange(100) >= 90
    assert "in the order of measuring" in told(panda, q, late)
    mixed = rng.permutation(100)
    assert "in session 'afternoon'" in told(panda, q, late[mixed], ["afternoon" if one else "morning" for one in late[mixed]])


def test_readings_of_one_pose_are_one(panda: Robot, rng: np.random.Generator) -> None:
    """Bad poses that were read five times each are as many outliers as there are poses."""
    q = np.repeat(drawn(30, rng), 5, axis=0)
    assert told(panda, q, np.isin(np.arange(150) // 5, [3, 17])) == ""


def test_too_few_or_too_many_are_not_judged(panda: Robot, rng: np.random.Generator) -> None:
    """Two outliers are no cluster, and where most readings are outliers none is."""
    q = np.sort(drawn(50, rng), axis=0)
    assert told(panda, q, np.arange(50) < 2) == ""
    assert told(panda, q, np.arange(50) < 40) == ""


def test_a_session_is_named_also_where_another_saw_the_same_poses(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Two sessions visit the same poses, and all outliers are of the second one."""
    robot = robots["ur5"]
    q = np.tile(rng.uniform(-1, 1, (60, 6)), (2, 1))
    data = spots_measured(robot, q, rng.normal(size=(120, 2, 2)), sessions=["morning"] * 60 + ["afternoon"] * 60)
    out = np.zeros(120, dtype=bool)
    out[60 + rng.permutation(60)[:20]] = True
    assert "in session 'afternoon'" in lie_together(robot.chain, data, out)
