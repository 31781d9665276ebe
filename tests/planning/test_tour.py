"""An order of poses that is short, and legs that are free or named."""

from __future__ import annotations

import itertools
from collections.abc import Callable

import numpy as np
import pytest

from tests.support.small_robot import URDF
from urdfcal.base.geometry import Mask, Matrix, Vector
from urdfcal.planning.roads import Reach, times_between
from urdfcal.planning.tour import legs, shortest, speeds_of, toured
from urdfcal.robot.robot import Robot, load_robot


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    """Of three joints."""
    path = tmp_path_factory.mktemp("robot") / "small.urdf"
    path.write_text(URDF)
    return load_robot(path)


def looked(free: Callable[[Matrix], Mask]) -> Reach:
    """How far straight lines are free, looked at in a thousand places."""

    def reach(a: Vector, b: Vector) -> float:
        good = free(a + np.linspace(0, 1, 1000)[:, None] * (b - a))
        return 1.0 if bool(good.all()) else float(int(np.argmin(good)) - 1) / 999

    return reach


def length(q: Matrix, order: np.ndarray, speeds: np.ndarray, start: np.ndarray) -> float:
    """Seconds from the start through all poses."""
    there = np.vstack([start, q[order]])
    return sum(times_between(a[None], b[None], speeds)[0, 0] for a, b in itertools.pairwise(there))


def test_tours_are_nearly_the_shortest() -> None:
    """Of seven poses no order of all 5040 is 15 % shorter, and on average none 4 %; every pose is visited once."""
    speeds, ratios = np.array([1.0, 2.0, 0.5]), []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        q, start = rng.uniform(-1, 1, (7, 3)), rng.uniform(-1, 1, 3)
        order = shortest(q, speeds, start)
        assert sorted(order) == list(range(7))
        every = np.array(list(itertools.permutations(range(7))))
        times = times_between(q, q, speeds)
        best = (times_between(start[None], q, speeds)[0, every[:, 0]] + times[every[:, :-1], every[:, 1:]].sum(axis=1)).min()
        ratios.append(length(q, order, speeds, start) / best)
    assert max(ratios) < 1.25
    assert np.mean(ratios) < 1.08


def test_turning_parts_round_only_shortens() -> None:
    """A tour of many poses is shorter than by always going to the nearest."""
    rng = np.random.default_rng(1)
    q, speeds, start = rng.uniform(-1, 1, (60, 3)), np.ones(3), np.zeros(3)
    left, nearest, here = set(range(60)), [], start
    while left:
        rest = sorted(left)
        nearest.append(rest[int(np.argmin(times_between(here[None], q[rest], speeds)[0]))])
        here = q[nearest[-1]]
        left.remove(nearest[-1])
    assert length(q, shortest(q, speeds, start), speeds, start) < 0.95 * length(q, np.array(nearest), speeds, start)


def test_legs_go_around_what_is_in_the_way(robot: Robot) -> None:
    """Behind a wall with a gap a leg goes through the gap; without a gap it is named."""

    def walled(q: Matrix) -> Mask:
        return np.asarray(~((np.abs(q[:, 0]) < 0.1) & (q[:, 1] < 0.8)))

    def closed(q: Matrix) -> Mask:
        return np.asarray(np.abs(q[:, 0]) >= 0.1)

    q = np.array([[-0.5, 0, 0.05], [0.5, 0, 0.05], [-0.6, 0.1, 0.05]])
    through = np.array([[0.0, 0.2, 0.05], [0.0, 1.0, 0.05], [0.3, 1.2, 0.05]])
    tour = toured(q, robot, np.array([-1.0, 0, 0]), looked(walled), through)
    assert tour.blocked == ()
    (leg,) = tour.vias
    assert np.allclose(tour.vias[leg], through[1:2])
    assert all(looked(walled)(a, b) == 1 for stations in legs(q, tour) for a, b in itertools.pairwise(stations))
    assert len(toured(q, robot, np.array([-1.0, 0, 0]), looked(closed), through).blocked) == 1
    assert toured(q, robot, np.array([-1.0, 0, 0]), None, through).vias == {}


def test_trees_find_a_way_through_bends(robot: Robot) -> None:
    """Past two walls with gaps at opposite sides no single detour leads; every leg of the way that is found is free."""

    def bends(q: Matrix) -> Mask:
        first = (np.abs(q[:, 0] + 0.4) < 0.1) & (q[:, 1] < 0.8)
        second = (np.abs(q[:, 0] - 0.4) < 0.1) & (q[:, 1] > -0.8)
        return np.asarray(~(first | second))

    rng = np.random.default_rng(3)
    q, through = np.array([[-1.0, -0.5, 0.05], [1.0, 0.5, 0.05]]), rng.uniform([-1.5, -1.5, 0.0], [1.5, 1.5, 0.1], (300, 3))
    tour = toured(q, robot, q[0], looked(bends), through[bends(through)])
    assert tour.blocked == ()
    (way,) = legs(q, tour)
    assert len(way) >= 4
    assert all(looked(bends)(a, b) == 1 for a, b in itertools.pairwise(way))
    assert tour.seconds[0] == pytest.approx(
        sum(times_between(a[None], b[None], speeds_of(robot))[0, 0] for a, b in itertools.pairwise(way))
    )


def test_poses_that_can_be_reached_from_each_other_come_together(robot: Robot) -> None:
    """Of poses on both sides of a wall without a gap, however they are mixed, one leg alone is blocked."""

    def closed(q: Matrix) -> Mask:
        return np.asarray(np.abs(q[:, 1]) >= 0.01)

    q = np.array([[0.1 * step, 0.02 * (-1) ** step, 0.05] for step in range(8)])
    tour = toured(q, robot, q[0], looked(closed), q[:0])
    assert len(tour.blocked) == 1
    assert sorted(tour.order) == list(range(8))
    assert all(looked(closed)(a, b) == 1 for leg, (a, b) in enumerate(itertools.pairwise(q[tour.order])) if leg not in tour.blocked)


def test_speeds_are_those_of_the_description(robots: dict[str, Robot]) -> None:
    """A UR5's joints, as its URDF states them."""
    assert np.allclose(speeds_of(robots["ur5"]), robots["ur5"].model.velocityLimit[: len(speeds_of(robots["ur5"]))])
