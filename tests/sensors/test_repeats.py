"""Which rows are readings of one pose."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from urdfcal.robot.robot import Robot
from urdfcal.sensors.measurements import Measurements, spots_measured
from urdfcal.sensors.repeats import COARSEST, RESOLUTION, last_moves, resolution, same_poses

NO_KEYS = np.zeros(10_000, dtype=np.intp)


def found(q: np.ndarray, keys: np.ndarray = NO_KEYS, approach: np.ndarray | None = None) -> list[int]:
    return same_poses(q, keys[: len(q)], approach).tolist()


@pytest.mark.parametrize("jitter", [0.0, 1e-6, 3e-5])
def test_readings_of_a_pose_are_found_wherever_they_stand(jitter: float, rng: np.random.Generator) -> None:
    """Whatever the order of the rows, those of one pose have one index, in the order of their first rows."""
    which = rng.permutation(np.repeat(np.arange(200), 5))
    q = rng.uniform(-3, 3, (200, 7))[which] + rng.normal(0, jitter, (1000, 7))
    _, first, expected = np.unique(which, return_index=True, return_inverse=True)
    assert found(q) == np.argsort(np.argsort(first))[expected].tolist()


def test_random_poses_are_poses(rng: np.random.Generator) -> None:
    """Ten thousand random configurations are as many poses."""
    assert found(rng.uniform(-3, 3, (10_000, 6))) == list(range(10_000))


def test_a_slow_sweep_is_no_pose(rng: np.random.Generator) -> None:
    """Rows of a slow motion, each close to the next, are cut into poses no larger than some resolutions."""
    q = np.cumsum(np.full((2000, 6), RESOLUTION / 2), axis=0)
    poses = np.array(found(q))
    extent = max(np.ptp(q[poses == pose], axis=0).max() for pose in range(poses.max() + 1))
    assert poses.max() > 50
    assert extent < 10 * RESOLUTION


def test_a_coarse_encoder_may_be_a_step_off(rng: np.random.Generator) -> None:
    """Positions in steps of 4096 a turn are one pose where they differ by a step."""
    step = 2 * np.pi / 4096
    poses = rng.integers(-1000, 1000, (50, 5))
    q = (np.repeat(poses, 4, axis=0) + rng.integers(0, 2, (200, 5))) * step
    assert found(q) == np.repeat(np.arange(50), 4).tolist()


def test_a_loose_arm_is_known_by_the_gap(rng: np.random.Generator) -> None:
    """Where consecutive rows are within a millirad or far away, the near ones are one pose."""
    q = np.repeat(rng.uniform(-2, 2, (40, 6)), 3, axis=0) + rng.uniform(-4e-4, 4e-4, (120, 6))
    assert resolution(q).max() > 2 * RESOLUTION
    assert found(q) == np.repeat(np.arange(40), 3).tolist()


def test_poses_on_a_grid_stay_poses() -> None:
    """Steps of a degree are moves and no resolution."""
    grid = np.radians(np.arange(-20.0, 20.0))
    q = np.column_stack([grid, grid[::-1]])
    assert (resolution(q) < COARSEST).all()
    assert found(q) == list(range(40))


def test_session_and_opposite_approach_tell_poses_apart(rng: np.random.Generator) -> None:
    """Rows of other sessions, or reached from opposite sides, are other poses; what did not move has no side."""
    q = np.repeat(rng.uniform(-1, 1, (1, 3)), 4, axis=0)
    assert found(q, np.array([0, 1, 0, 1])) == [0, 1, 0, 1]
    assert found(q, approach=np.array([[1, 0, 1], [-1, 0, 1], [1, 1, 0], [-1, 1, 0.0]])) == [0, 1, 0, 1]


def test_while_it_stands_still_an_arm_keeps_its_approach(rng: np.random.Generator) -> None:
    """Further readings of a pose were reached as its first one was; the first row of all from nowhere."""
    q = np.repeat(np.array([[0.0, 1.0], [0.5, 0.2], [0.1, 0.2]]), 3, axis=0) + rng.normal(0, 1e-6, (9, 2))
    assert last_moves(q).tolist() == [[0, 0]] * 3 + [[1, -1]] * 3 + [[-1, -1]] * 3


def test_copies_are_left_out(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Rows that are equal to the last bit, what was not seen included, are one; those of another session or reading are not."""
    robot = robots["panda"]
    spots = rng.normal(0, 0.1, (6, len(robot.rig.lasers), 2))
    spots[2] = np.nan
    one = spots_measured(robot, rng.uniform(-1, 1, (6, len(robot.chain.inputs))), spots)
    rows = [0, 1, 2, 2, 1, 3, 4, 5, 0]
    assert one.subset(rows).without_copies().poses.tolist() == ["1", "2", "3", "4", "5", "6"]
    assert one.without_copies() is one
    other = replace(one.subset([0, 0]), sessions=np.array(["a", "b"]))
    assert len(other.without_copies()) == 2


def test_numbers_count_poses(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """What was read again is no further number, and in words poses and readings are told apart."""
    robot = robots["panda"]
    spots = rng.normal(0, 0.1, (5, len(robot.rig.lasers), 2))
    one = spots_measured(robot, rng.uniform(-1, 1, (5, len(robot.chain.inputs))), spots)
    again: Measurements = one.subset(np.repeat(np.arange(5), 3))
    assert again.numbers == one.numbers
    assert (one.counted, again.counted) == ("5 poses", "5 poses (read 15 times)")
