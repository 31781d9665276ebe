"""Module, screen, board and target put on any robot: where they are, and that nothing else changes."""

from __future__ import annotations

import io
import logging
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from tests.support.helpers import assert_poses_close
from tests.support.small_robot import URDF, joint, robot_of
from urdfcal.base.errors import RigError, UsageError
from urdfcal.base.geometry import pose
from urdfcal.robot.added_rig import (
    Piece,
    Stand,
    board_on,
    facing,
    module_on,
    outward,
    require_free,
    require_moving,
    screen_on,
    target_on,
    with_pieces,
)
from urdfcal.robot.rig import Grid
from urdfcal.robot.robot import Robot, load_robot, robot_from
from urdfcal.robot.sheet import stated_sheet

ROBOTS = {  # file below example-robot-data's, tip, and the axis of the tip that leads away from the arm
    "panda": ("panda_description/urdf/panda.urdf", "panda_hand", (0, 0, 1)),
    "ur5": ("ur_description/urdf/ur5_robot.urdf", "ee_link", (1, 0, 0)),
    "tiago": ("tiago_description/robots/tiago_no_hand.urdf", "wrist_ft_tool_link", (1, 0, 0)),
}
GRID = Grid(9, 6, 0.025)
BARE = (
    '<robot name="bare">'
    '<link name="base"/><link name="a"/><link name="tool"/>'
    + joint("j1", "base", "a", '<origin xyz="0 0 0.3"/><axis xyz="0 0 1"/>')
    + joint("j2", "a", "tool", '<origin xyz="0.4 0 0"/><axis xyz="0 1 0"/>')
    + "</robot>"
)


def rigged(robot: Robot, tip: str, prefix: str = "") -> tuple[Robot, list[Piece]]:
    """Everything that there is, put on a robot."""
    tree, base = robot.tree, Stand(robot.tree.root, np.array([0.9, 0.9, 0.6]))
    here = Stand(tip)
    pieces = [module_on(tree, here, prefix), screen_on(tree, base, tip, (2.0, 1.5), prefix), board_on(tree, here, GRID, prefix)]
    pieces.append(target_on(tree, replace(here, xyz=np.array([0.01, 0.02, 0.03]), rpy=np.array([0.1, 0.2, 0.3])), prefix))
    return robot_from(with_pieces(robot, pieces, prefix, "added")), pieces


def in_parent(robot: Robot, piece: Piece) -> pin.SE3:
    """Where Pinocchio has a piece on its link, with all joints somewhere."""
    data, model = robot.model.createData(), robot.model
    pin.framesForwardKinematics(model, data, pin.integrate(model, pin.neutral(model), np.full(model.nv, 0.3)))
    parent, child = (data.oMf[model.getFrameId(name, pin.FrameType.BODY)] for name in (piece.parent, piece.links[0]))
    return parent.actInv(child)


@pytest.mark.parametrize("name", ["arm7", *ROBOTS])
def test_pinocchio_and_yourdfpy_read_it_where_it_was_put(name: str, robots: dict[str, Robot], example_robots: Path) -> None:
    """On any robot each piece is where it was said to be, by two readers of URDF, and the text is the old one with something added."""
    import yourdfpy

    robot = robots["arm7"] if name == "arm7" else load_robot(example_robots / ROBOTS[name][0])
    cell, pieces = rigged(robot, "link7" if name == "arm7" else ROBOTS[name][1], "new_")
    before, after = robot.description.text, cell.description.text
    start = next(index for index, (one, other) in enumerate(zip(before, after, strict=False)) if one != other)
    assert before.startswith(after[:start])
    assert after.endswith(before[start:])
    logging.disable(logging.WARNING)  # of meshes that are not loaded
    other = yourdfpy.URDF.load(io.BytesIO(after), load_meshes=False, build_scene_graph=True)
    logging.disable(logging.NOTSET)
    for piece in pieces:
        assert_poses_close(in_parent(cell, piece), piece.placement)
        assert_poses_close(pin.SE3(other.get_transform(piece.links[0], piece.parent)), piece.placement, mm=1e-6)
    seen = replace(cell, screen="new_screen", lasers=("new_laser_1", "new_laser_2"))
    assert (seen.rig.base, seen.rig.tip) == ("new_screen", "new_slm")
    assert stated_sheet(seen).size == (2.0, 1.5)  # type: ignore[union-attr]


@pytest.mark.parametrize("name", ROBOTS)
def test_things_look_away_from_the_arm(name: str, example_robots: Path) -> None:
    """Beams leave along the tip's axis that leads away from the arm, half a right angle apart and more; a board turns its front there."""
    path, tip, axis = ROBOTS[name]
    robot = load_robot(example_robots / path)
    np.testing.assert_array_equal(outward(robot.tree, tip), axis)
    module, board = module_on(robot.tree, Stand(tip)), board_on(robot.tree, Stand(tip), GRID)
    np.testing.assert_allclose(module.placement.rotation[:, 2], axis, atol=1e-15)
    np.testing.assert_allclose(-board.placement.rotation[:, 2], axis, atol=1e-15)
    middle = board.placement.act(GRID.points().mean(axis=0))
    np.testing.assert_allclose(middle, 0.02 * np.array(axis), atol=1e-12)
    assert np.linalg.norm(np.cross(module.placement.translation, axis)) == pytest.approx(0.05)


@pytest.mark.parametrize("away", [(1, 0, 0), (-0.5, 2, 0.3), (0, -1, 1), (0.1, 0, 3), (0, 0, -1)], ids=str)
def test_a_screen_faces_what_it_is_away_from(away: tuple[float, ...]) -> None:
    """The robot is on its -x side; it stands upright, or lies flat where it is seen from above or below."""
    axes = facing(np.array(away, dtype=float))
    assert np.linalg.det(axes) == pytest.approx(1.0)
    np.testing.assert_allclose(axes.T @ axes, np.eye(3), atol=1e-12)
    assert axes[:, 0] @ away > 0.5 * np.linalg.norm(away)
    assert max(abs(axes[2, 2]), abs(axes[2, 0])) == pytest.approx(1.0)


def test_the_screen_faces_the_shoulder_and_not_the_root() -> None:
    """Of a robot that stands beside the root's origin the screen faces the first moving joint, from whatever link it is told."""
    text = BARE.replace('<origin xyz="0 0 0.3"/>', '<origin xyz="2 0 0.3"/>').replace(
        '<link name="base"/>',
        '<link name="base"/><link name="bench"/>' + joint("m", "base", "bench", '<origin rpy="0 0 1.57"/>', kind="fixed"),
    )
    tree = robot_of(text).tree
    on_base = screen_on(tree, Stand("base", np.array([1.0, 0.0, 0.3])), "tool", (1.5, 1.5))
    np.testing.assert_allclose(on_base.placement.rotation[:, 0], [-1, 0, 0], atol=1e-12)
    T_base_bench = pose(np.zeros(3), np.array([0, 0, 1.57]))
    on_bench = screen_on(tree, Stand("bench", T_base_bench.actInv(np.array([1.0, 0.0, 0.3]))), "tool", (1.5, 1.5))
    assert_poses_close(T_base_bench * on_bench.placement, on_base.placement)
    turned = screen_on(tree, Stand("base", np.array([1.0, 0.0, 0.3]), np.array([0.0, 0.0, 0.5])), "tool", (1.5, 1.5))
    np.testing.assert_allclose(turned.placement.rotation, pose(np.zeros(3), np.array([0, 0, 0.5])).rotation)


TEXTS = {
    "one line": BARE.encode(),
    "CRLF and tabs": BARE.replace("\n", "")
    .replace("<link", "\r\n\t<link")
    .replace("</robot>", "\r\n</robot>\r\n<!-- end -->\r\n")
    .encode(),
    "four blanks": BARE.replace("<joint", "    <joint").replace("</robot>", "  </robot>").encode(),
    "byte-order mark": b"\xef\xbb\xbf" + ('<?xml version="1.0" encoding="utf-8"?>\n' + BARE.replace('"tool"', '"w\u00fc&lt;1"')).encode(),
    "latin-1": ("<?xml version='1.0' encoding='iso-8859-1'?>\n" + BARE.replace('"tool"', '"w\u00fc&lt;1"')).encode("latin-1"),
    "a number for a name": BARE.replace('"tool"', '"007"').encode(),
}


@pytest.mark.parametrize("text", TEXTS.values(), ids=TEXTS)
def test_bytes_stay_whatever_they_are(text: bytes) -> None:
    """The text is the old one with lines before its end, in its own encoding, indentation and line ends; any name of a link is kept."""
    robot = robot_of(text)
    tip = robot.tree.last_link
    cell, pieces = rigged(robot, tip)
    after = cell.description.text
    added = len(after) - len(text)
    start = after.index(b"<!-- added")
    start = len(after[:start].rstrip(b" \t"))
    start -= 0 if after[:start] == text[:start] else 1  # a line end of ours before it
    assert after[:start] + after[start + added :] == text
    assert cell.tree.by_child["slm"].parent == tip
    if b"\r\n" in text:
        assert after.count(b"\r\n") == after.count(b"\n")
        assert b"\r\n\t<joint" in after
    assert_poses_close(in_parent(cell, pieces[0]), pieces[0].placement)


def test_names_that_are_there_are_refused_with_a_prefix_that_is_free() -> None:
    """Links and joints alike; the prefix that is offered clashes with nothing."""
    robot = robot_of(URDF.replace('"base_mount"', '"rig_mount"'))
    for prefix in ("", "laser_1_mount_"):
        pieces = [module_on(robot.tree, Stand("tool"), prefix)]
        if not prefix:
            with pytest.raises(
                RigError, match=r"small\.urdf: has a link 'slm' already; --prefix rig2_ names what is new rig2_slm and so on"
            ):
                require_free(robot.tree, pieces, prefix)
        else:
            require_free(robot.tree, pieces, prefix)
    bare = robot_of(BARE.replace('"j2"', '"target_mount"'))
    with pytest.raises(RigError, match="has a joint 'target_mount' already; --prefix rig_ names what is new rig_target"):
        require_free(bare.tree, [target_on(bare.tree, Stand("tool"))], "")
    for prefix in ("1_", "a b", 'a"', "a--"):
        with pytest.raises(UsageError, match=r"--prefix .*: expected letters, digits and _"):
            require_free(bare.tree, [], prefix)


def test_two_ends_that_do_not_move_are_refused() -> None:
    """A tip that stands with the base is no tip; the message names one that moves."""
    tree = robot_of(BARE).tree
    with pytest.raises(RigError, match=r"no moving joint between --tip 'base' and 'base'; .* such as 'tool'"):
        require_moving(tree, "base", "base")
    require_moving(tree, "base", "tool")  # a camera on the arm, a board that stands
    np.testing.assert_array_equal(outward(tree, "base"), [0, 0, 1])
