"""What hides a target: told as by rays against every triangle, and neither flange nor housing is in the way of its own."""

from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import coal
import numpy as np
import pinocchio as pin
import pytest

from tests.cell.test_collisions import boxed
from urdfcal.base.geometry import Matrix, Vector
from urdfcal.cell.collisions import Cell, cell_of
from urdfcal.cell.hiding import hidden
from urdfcal.robot.configurations import random_positions, whole_configurations
from urdfcal.robot.robot import Robot

LEFT_OUT = 0.02


def crossed(triangles: np.ndarray, begin: Vector, end: Vector) -> bool:
    """Whether a segment meets one of some triangles (t, 3, 3), after Moeller and Trumbore (1997)."""
    way, one, other = end - begin, triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    across = np.cross(way, other)
    size = np.sum(one * across, axis=1)
    size[np.abs(size) < 1e-15] = np.inf
    off = begin - triangles[:, 0]
    u, around = np.sum(off * across, axis=1) / size, np.cross(off, one)
    v, share = around @ way / size, np.sum(other * around, axis=1) / size
    return bool(((u >= 0) & (v >= 0) & (u + v <= 1) & (share >= 0) & (share <= 1)).any())


@pytest.fixture(scope="module")
def cell(robots: dict[str, Robot]) -> Cell:
    """A UR5 alone."""
    return cell_of(robots["ur5"])


def test_lines_are_crossed_as_by_rays_against_every_triangle(cell: Cell, rng: np.random.Generator) -> None:
    """From a tracker 2 m away to points near the arm: what a ray meets is hidden, and what none meets is not, but for grazing ones."""
    robot, n = cell.robot, 250
    q, base = random_positions(robot, n, rng), robot.model.getFrameId(robot.rig.base)
    begin, end = rng.uniform([1.2, -0.4, 0.0], [1.6, 0.4, 0.6], (n, 3)), rng.normal([-0.4, 0, 0.2], 0.15, (n, 3))
    own = {robot.rig.base, *robot.rig.lasers}
    drawn = [each for each in cell.exact.geometryObjects if robot.model.frames[each.parentFrame].name not in own]
    surfaces = [triangles(each.geometry) for each in drawn]
    assert sum(isinstance(each.geometry, coal.BVHModelBase) for each in drawn) > 5
    data, met = robot.model.createData(), np.zeros(n, dtype=bool)
    in_base = np.empty((2, n, 3))
    for row, whole in enumerate(whole_configurations(robot, q)):
        pin.framesForwardKinematics(robot.model, data, whole)
        back = data.oMf[base].inverse()
        in_base[:, row] = back.act(begin[row]), back.act(end[row])
        along = (end[row] - begin[row]) / np.linalg.norm(end[row] - begin[row]) * LEFT_OUT
        for shape, surface in zip(drawn, surfaces, strict=True):
            at = data.oMi[shape.parentJoint] * shape.placement
            met[row] |= crossed(surface @ at.rotation.T + at.translation, begin[row] + along, end[row] - along)
    found = hidden(cell, q, *in_base)
    inside = _inside_something(cell, q, in_base[1])
    assert met.sum() > 30
    assert not (met & ~found & ~inside).any()
    assert (found & ~met).sum() <= 0.03 * n


def triangles(form: Any) -> np.ndarray:
    """Of a mesh or a box, (t, 3, 3)."""
    if isinstance(form, coal.BVHModelBase):
        corners = (form.tri_indices(index) for index in range(form.num_tris))
        return form.vertices()[np.array([[each[0], each[1], each[2]] for each in corners])]
    corners = np.array(list(itertools.product((-1, 1), repeat=3))) * form.halfSide
    quads = [(0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6), (0, 2, 6, 4), (1, 3, 7, 5)]
    return corners[[three for a, b, c, d in quads for three in ((a, b, c), (a, c, d))]]


def _inside_something(cell: Cell, q: Matrix, end: Matrix) -> np.ndarray:
    """Ends that a ball of 5 mm around touches some hull of: their own housing, as far as is known."""
    robot, data, found = cell.robot, cell.robot.model.createData(), np.zeros(len(q), dtype=bool)
    base = robot.model.getFrameId(robot.rig.base)
    for row, whole in enumerate(whole_configurations(robot, q)):
        pin.framesForwardKinematics(robot.model, data, whole)
        ball = coal.Transform3s(np.eye(3), data.oMf[base].act(end[row]))
        for shape in cell.model.geometryObjects:
            at = data.oMi[shape.parentJoint] * shape.placement
            placed, told = coal.Transform3s(at.rotation, at.translation), coal.CollisionResult()
            found[row] |= coal.collide(shape.geometry, placed, coal.Sphere(0.005), ball, coal.CollisionRequest(), told) > 0
    return found


def test_scenery_hides_and_what_a_target_sits_on_does_only_from_behind(tmp_path: Path) -> None:
    """A target on the front face of a cube is seen from ahead, through a gap, not through a wall nor through the cube; one inside it is."""
    robot = boxed(tmp_path, "tool")
    data, q = robot.model.createData(), np.zeros((1, 3))
    pin.framesForwardKinematics(robot.model, data, whole_configurations(robot, q)[0])
    base, tool = (data.oMf[robot.model.getFrameId(name)] for name in (robot.rig.base, "tool"))
    face, ahead, behind = (np.array(base.actInv(tool.act(np.array([x, 0.0, 0.0])))) for x in (0.05, 0.6, -0.6))
    middle = np.array(base.actInv(tool.translation))
    alone = cell_of(robot)

    def is_hidden(cell: Cell, begin: Vector, end: Vector) -> bool:
        return bool(hidden(cell, q, begin[None], end[None])[0])

    assert not is_hidden(alone, ahead, face)
    assert is_hidden(alone, behind, face)
    assert not is_hidden(alone, behind, middle)
    wall = tool.act(np.array([0.3, 0.0, 0.0])) * 1e3
    (tmp_path / "scene.yaml").write_text(
        f"boxes: {{wall: {{size_mm: [10, 10, 10], xyz_mm: [{', '.join(f'{each:.3f}' for each in wall)}]}}}}"
    )
    walled = cell_of(robot, scene=tmp_path / "scene.yaml", clearance=0.0)
    assert is_hidden(walled, ahead, face)
    beside = np.array(base.actInv(tool.act(np.array([0.6, 0.3, 0.0]))))
    assert not is_hidden(walled, beside, face)
    assert not is_hidden(walled, np.full(3, np.nan), face)
