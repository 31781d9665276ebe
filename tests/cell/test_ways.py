"""Straight ways that are free, and those that are not: nothing is passed by, and speeds are no lower than they are."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from tests.support.small_robot import URDF, robot_of
from urdfcal.base.geometry import MM, Matrix
from urdfcal.cell.collisions import Cell, cell_of
from urdfcal.cell.ways import STEP, Ways
from urdfcal.robot.configurations import joint_limits, random_positions, whole_configurations
from urdfcal.robot.robot import Robot


@pytest.fixture(scope="module")
def cell(robots: dict[str, Robot]) -> Cell:
    """A UR5's, whose hulls touch in many poses."""
    return cell_of(robots["ur5"])


@pytest.fixture(scope="module")
def free(cell: Cell) -> Matrix:
    """Free positions of it."""
    q = random_positions(cell.robot, 20, np.random.default_rng(1))
    return q[cell.free(q)]


def test_ways_end_where_something_touches(cell: Cell, free: Matrix) -> None:
    """Up to the share that is told all of 150 positions are free; there, or within a few steps behind it, one is not."""
    ways, found = Ways(cell), []
    for a, b in itertools.pairwise(free[:7]):
        share = ways.free_until(a, b)
        along = np.linspace(0, 1, 150)
        good = cell.free(a + along[:, None] * (b - a))
        assert good[along <= share].all()
        assert share == 1 or not cell.free(a + (share + np.linspace(0, 0.01, 40))[:, None] * (b - a)).all()
        found.append(share)
    assert 0 < sum(share == 1 for share in found) < len(found)
    blocked = random_positions(cell.robot, 60, np.random.default_rng(2))
    blocked = blocked[~cell.free(blocked)]
    assert ways.free_until(blocked[0], free[0]) < 0


def test_no_pair_comes_nearer_faster_than_is_taken_for_possible(cell: Cell, free: Matrix, rng: np.random.Generator) -> None:
    """Between poses a bit apart no distance changes by more than the joints' moves times the reaches."""
    ways, model, hulls = Ways(cell), cell.robot.model, cell.model.createData()
    steps = rng.normal(size=free.shape) * 2e-3
    one, other = (whole_configurations(cell.robot, q) for q in (free, free + steps))
    for a, b in zip(one, other, strict=True):
        apart = []
        for configuration in (a, b):
            pin.computeDistances(model, ways._data, cell.model, hulls, configuration)
            apart.append([result.min_distance for result in hulls.distanceResults])
        moved = ways.reaches @ np.abs(pin.difference(model, a, b))
        assert (np.abs(np.array(apart[0]) - apart[1]) <= moved + 1e-5).all()


def test_a_thin_wall_is_not_passed_by(tmp_path: Path) -> None:
    """A wall of half a millimetre, which positions 20 mrad apart lie on both sides of, stops the way that crosses it."""
    box = '<collision><geometry><box size="0.001 0.001 0.001"/></geometry></collision>'
    robot = robot_of(URDF.replace('<link name="tool"/>', f'<link name="tool">{box}</link>'), str(tmp_path / "small.urdf"))
    lower, upper = joint_limits(robot)
    a, b = np.zeros(3), np.zeros(3)
    a[0], b[0] = max(lower[0], -1.0), min(upper[0], 1.0)
    data = robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, whole_configurations(robot, np.zeros((1, 3)))[0])
    at = data.oMf[robot.model.getFrameId("tool")].translation / MM
    across = "[900, 0.5, 900]" if abs(at[0]) > abs(at[1]) else "[0.5, 900, 900]"
    (tmp_path / "scene.yaml").write_text(f"boxes: {{wall: {{size_mm: {across}, xyz_mm: {at.tolist()}}}}}\n")
    free = Ways(cell_of(robot, clearance=0.0)).free_until(a, b)
    assert free == 1
    wall = cell_of(robot, scene=tmp_path / "scene.yaml", clearance=0.0)
    assert wall.free(np.stack([a, b])).all()
    assert 0.4 < Ways(wall).free_until(a, b) < 0.5
    assert STEP <= 1 * MM
