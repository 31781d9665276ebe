"""Which poses a robot can take: nothing that touches is missed, and what was left out is said."""

from __future__ import annotations

from pathlib import Path

import coal
import numpy as np
import pinocchio as pin
import pytest

from tests.support.small_robot import URDF, robot_of
from urdfcal.base.errors import RigError, RobotError, UsageError
from urdfcal.cell.collisions import cell_of
from urdfcal.robot.configurations import random_positions, whole_configurations
from urdfcal.robot.robot import Robot

BOX = '<collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision>'


def boxed(folder: Path, *links: str) -> Robot:
    """The small robot with a cube of 0.1 m about the origins of some links."""
    text = URDF
    for link in links:
        text = text.replace(f'<link name="{link}"/>', f'<link name="{link}">{BOX}</link>')
    return robot_of(text, str(folder / "small.urdf"))


def test_what_touches_by_the_meshes_themselves_is_never_free(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """At no pose that is called free do two meshes of the UR5, as they are and placed one by one, touch; and most others are free."""
    robot = robots["ur5"]
    cell, q = cell_of(robot, clearance=0.0), random_positions(robot, 300, rng)
    drawn = pin.buildGeomFromUrdf(robot.model, str(_described(robot)), pin.GeometryType.COLLISION, package_dirs=_folders(robot))
    shapes = drawn.geometryObjects
    pairs = [(a, b) for b in range(len(shapes)) for a in range(b) if shapes[b].parentJoint > shapes[a].parentJoint + 1]
    data, touch = robot.model.createData(), np.zeros(len(q), dtype=bool)
    for row, whole in enumerate(whole_configurations(robot, q)):
        pin.forwardKinematics(robot.model, data, whole)
        at = [data.oMi[shape.parentJoint] * shape.placement for shape in shapes]
        moved = [coal.Transform3s(place.rotation, place.translation) for place in at]
        touch[row] = any(
            coal.collide(shapes[a].geometry, moved[a], shapes[b].geometry, moved[b], coal.CollisionRequest(), coal.CollisionResult())
            for a, b in pairs
        )
    free = cell.free(q)
    assert touch.sum() > 30
    assert not (free & touch).any()
    assert free.sum() > 0.5 * (~touch).sum()


def _described(robot: Robot) -> Path:
    return _package() / "robots" / "ur_description" / "urdf" / "ur5_robot.urdf"


def _folders(robot: Robot) -> list[str]:
    return [str(_package().parent), str(_package() / "robots")]


def _package() -> Path:
    from urdfcal.robot.packages import find_package

    return find_package("example-robot-data")


def test_a_scene_is_kept_clear_of_by_the_distance_that_is_stated(tmp_path: Path) -> None:
    """A cube 0.35 m before the turning one is free of a wall, a post, a box and a mesh just beyond the clearance, not just within it."""
    robot = boxed(tmp_path, "tool")
    q = np.array([[0.0, 0.0, 0.0]])
    data = robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, whole_configurations(robot, q)[0])
    corners = np.array([[x, y, z] for x in (-0.05, 0.05) for y in (-0.05, 0.05) for z in (-0.05, 0.05)])
    tool = data.oMf[robot.model.getFrameId("tool")]
    edge = 1e3 * float((corners @ tool.rotation.T + tool.translation)[:, 0].max())  # [mm] along x of the root
    side = "v 0 -1 -1\nv 0 1 -1\nv 0 0 1\nv 1 0 0\nf 1 2 3\nf 1 2 4\nf 2 3 4\nf 1 3 4\n"
    (tmp_path / "side.obj").write_text(side)
    for far, expected in ((10.5, True), (9.5, False)):
        for entry in (
            f"planes: {{wall: {{normal: [-1, 0, 0], xyz_mm: [{edge + far}, 0, 0]}}}}",
            f"boxes: {{crate: {{size_mm: [200, 4000, 4000], xyz_mm: [{edge + far + 100}, 0, 0]}}}}",
            f"meshes: {{side: {{file: side.obj, xyz_mm: [{edge + far}, 0, 0]}}}}",
        ):
            (tmp_path / "scene.yaml").write_text(entry)
            assert cell_of(robot, scene=tmp_path / "scene.yaml", clearance=0.01).free(q).tolist() == [expected], (far, entry)


def test_the_inside_of_a_mesh_is_solid(tmp_path: Path) -> None:
    """A cube wholly inside a closed mesh of the scene touches no face of it, and is never free."""
    corners = [f"v {x} {y} {z}" for x in (-2, 2) for y in (-2, 2) for z in (-2, 2)]
    quads = [(1, 2, 4, 3), (5, 7, 8, 6), (1, 5, 6, 2), (3, 4, 8, 7), (1, 3, 7, 5), (2, 6, 8, 4)]
    faces = [f"f {a} {b} {c}\nf {a} {c} {d}" for a, b, c, d in quads]
    (tmp_path / "hall.obj").write_text("\n".join([*corners, *faces]) + "\n")
    (tmp_path / "scene.yaml").write_text("meshes: {hall: {file: hall.obj}}\n")
    robot = boxed(tmp_path, "tool")
    assert not cell_of(robot, scene=tmp_path / "scene.yaml").free(random_positions(robot, 20, np.random.default_rng(0))).any()


def test_flat_meshes_are_taken_as_they_are(tmp_path: Path) -> None:
    """A mesh of one triangle has no hull; it is looked at all the same."""
    (tmp_path / "leaf.obj").write_text("v -0.2 0 0\nv 0.2 0 0\nv 0 0.2 0\nf 1 2 3\n")
    leaf = '<collision><geometry><mesh filename="leaf.obj"/></geometry></collision>'
    text = URDF.replace('<link name="tool"/>', f'<link name="tool">{leaf}</link>')
    (tmp_path / "scene.yaml").write_text("boxes: {hall: {size_mm: [9000, 9000, 9000]}}\n")
    robot = robot_of(text, str(tmp_path / "small.urdf"))
    assert not cell_of(robot, scene=tmp_path / "scene.yaml").free(np.zeros((1, 3))).any()
    assert cell_of(robot).free(np.zeros((1, 3))).all()


def test_neighbours_and_what_an_srdf_names_are_not_looked_at(tmp_path: Path) -> None:
    """Neighbours may touch, over links without a shape too; others may not, unless an SRDF beside the robot says so."""
    robot = boxed(tmp_path, "upper", "tool", "base")
    pairs = {tuple(sorted(cell_of(robot)._pair(index))) for index in range(len(cell_of(robot).model.collisionPairs))}
    assert pairs == {("base", "tool")}
    (tmp_path / "small.srdf").write_text('<robot name="small"><disable_collisions link1="tool" link2="base" reason="Never"/></robot>')
    assert len(cell_of(robot).model.collisionPairs) == 0


def test_what_always_touches_is_left_out_and_said(tmp_path: Path) -> None:
    """Links whose shapes touch in every pose are named, and the rest is looked at as ever."""
    text = URDF.replace('<link name="base"/>', f'<link name="base">{BOX.replace("0.1 0.1 0.1", "9 9 9")}</link>')
    text = text.replace('<link name="tool"/>', f'<link name="tool">{BOX}</link>').replace(
        '<link name="upper"/>', f'<link name="upper">{BOX}</link>'
    )
    cell = cell_of(robot_of(text, str(tmp_path / "small.urdf")))
    assert "not looked at are base and tool" in " ".join(cell.warnings)
    assert cell.free(np.zeros((1, 3))).all()


@pytest.mark.parametrize(("middle", "left_out"), [(4.75, True), (-4.25, False)], ids=["at zero, too", "not at zero"])
def test_what_overlaps_at_zero_and_at_most_positions_is_drawn_so(middle: float, left_out: bool, tmp_path: Path) -> None:
    """A pair that touches at more than half of all positions is left out where it does at zero, too, and looked at where it does not."""
    block = BOX.replace("0.1 0.1 0.1", "9 9 9").replace("<geometry>", f'<origin xyz="{middle} 0 0"/><geometry>')
    text = URDF.replace('<link name="base"/>', f'<link name="base">{block}</link>').replace('"0.3" effort', '"0.1" effort')
    text = text.replace('<link name="tool"/>', f'<link name="tool">{BOX}</link>').replace(
        '<link name="upper"/>', f'<link name="upper">{BOX}</link>'
    )
    robot = robot_of(text, str(tmp_path / "small.urdf"))
    q = random_positions(robot, 300, np.random.default_rng(1))
    cell = cell_of(robot, clearance=0.0)
    assert ("not looked at are base and tool" in " ".join(cell.warnings)) == left_out
    assert cell.free(q).all() == left_out
    assert left_out or 0.05 < cell.free(q).mean() < 0.5


def test_links_without_their_mesh_are_simple_shapes_and_said(tmp_path: Path) -> None:
    """A missing mesh, one outside the robot's folders, and one with endless corners are not read; simple shapes stand for their links."""
    (tmp_path / "bad.obj").write_text("v nan 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    for name, why in (("none.stl", "was not found"), ("/etc/hostname", "lies outside"), ("bad.obj", "corners")):
        shape = f'<collision><geometry><mesh filename="{name}"/></geometry></collision>'
        text = URDF.replace('<link name="upper"/>', f'<link name="upper">{shape}</link>').replace(
            '<link name="tool"/>', f'<link name="tool">{BOX}</link>'
        )
        cell = cell_of(robot_of(text, str(tmp_path / "small.urdf")))
        assert why in cell.warnings[0]
        assert "link 'upper'" in cell.warnings[0]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("boxs: {}", "entry 'boxs' is unknown; did you mean 'boxes'?"),
        ("boxes: {table: {size_mm: [1, 2, 0]}}", "scene.yaml:1: entry 'boxes.table.size_mm.2': Input should be greater than 0"),
        ("meshes: {part: {file: /etc/hostname}}", "entry 'meshes.part': /etc/hostname lies outside"),
        ("planes: {floor: {normal: [0, 0, 0]}}", "entry 'planes.floor': normal is 0, 0, 0"),
        ("[1]", "expected entries such as"),
    ],
)
def test_a_scene_that_is_none_is_refused(tmp_path: Path, text: str, said: str) -> None:
    """In one line that names file, entry and what was expected."""
    (tmp_path / "scene.yaml").write_text(text)
    with pytest.raises(RigError) as told:
        cell_of(boxed(tmp_path, "tool"), scene=tmp_path / "scene.yaml")
    assert said in str(told.value)


def test_other_mistakes_are_refused(tmp_path: Path) -> None:
    """An SRDF that is no XML, and a clearance that is none."""
    robot = boxed(tmp_path, "tool")
    (tmp_path / "broken.srdf").write_text("<robot>")
    with pytest.raises(RobotError, match="is no SRDF"):
        cell_of(robot, srdf=tmp_path / "broken.srdf")
    with pytest.raises(UsageError, match="expected a number from 0 to 1000 mm"):
        cell_of(robot, clearance=-0.001)
