"""What measures, put on a robot that does not have it: where it sits, in the macros of robots/slm.urdf.xacro, and the URDF with it.

Frames are right-handed with z as in the macros: a beam leaves a module along its +z, a board is seen from its -z side, a screen has the
robot on its -x side. *Outward* is the axis of the tip's frame that leads away from the arm.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from urdfcal.base.errors import RigError, UsageError
from urdfcal.base.geometry import SE3, Matrix, Vector, pose, xyz_rpy
from urdfcal.robot.description import Description
from urdfcal.robot.rig import Grid
from urdfcal.robot.robot import Robot
from urdfcal.robot.urdf_tree import UrdfTree
from urdfcal.robot.urdf_writer import numbers, with_elements
from urdfcal.robot.xacro_text import expanded_calls

_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*")
_APART = 0.01  # [m]; a joint nearer to the tip than this does not tell which way the arm leads
_STEEP = math.radians(60)  # a screen that is seen from the shoulder more steeply lies flat, on the floor or under the ceiling
_MODULE = np.array([0.05, 0.0, 0.02])  # off the last joint's axis, where all of its mount can be told
_TARGET = np.array([0.08, 0.0, 0.02])  # off it, too: a target on the axis does not see the joint turn
_BOARD = np.array([0.0, 0.0, 0.02])  # the middle of the board
_TURNED = pin.SE3(np.diag([1.0, -1.0, -1.0]), np.zeros(3))


@dataclass(frozen=True)
class Piece:
    """One thing that is put on a link.

    Attributes:
        macro: Which of the macros draws it.
        links: The links that it brings, its own first.
        parent: The link that it is on.
        placement: Of its own link on that link.
        values: Of the macro's other parameters.
        words: How it sits, in words.
    """

    macro: str
    links: tuple[str, ...]
    parent: str
    placement: SE3
    values: tuple[tuple[str, str], ...]
    words: str

    @property
    def joints(self) -> tuple[str, ...]:
        """The joints that it brings, one a link."""
        return tuple(f"{link}_mount" for link in self.links)

    def call(self, parent: str, prefix: str) -> str:
        """The call of its macro, on a link that is named otherwise meanwhile."""
        xyz, rpy = (numbers(values) for values in xyz_rpy(self.placement))
        given = {"parent": parent, "prefix": prefix, "xyz": xyz, "rpy": rpy, **dict(self.values)}
        attributes = " ".join(f'{name}="{value}"' for name, value in given.items())
        return f"<xacro:{self.macro} {attributes}/>"


@dataclass(frozen=True)
class Stand:
    """Where on a link something is put, as far as it is stated.

    Attributes:
        link: The link.
        xyz: In the link's frame, [m]; None for the usual place.
        rpy: Roll, pitch and yaw in it, [rad]; None for outward.
    """

    link: str
    xyz: Vector | None = None
    rpy: Vector | None = None

    def placement(self, tree: UrdfTree, usual: Vector) -> tuple[SE3, str]:
        """The placement, by default so far along the axes of one that looks outward, and the axis of the link that its z is near."""
        axis = outward(tree, self.link)
        rotation = _along(axis) if self.rpy is None else pose(np.zeros(3), self.rpy).rotation
        xyz = _along(axis) @ usual if self.xyz is None else self.xyz
        return pin.SE3(rotation, xyz), _axis_name(rotation[:, 2])


def module_on(tree: UrdfTree, stand: Stand, prefix: str = "") -> Piece:
    """A module with two lasers whose beams leave to either side of outward."""
    placement, axis = stand.placement(tree, _MODULE)
    links = tuple(f"{prefix}{name}" for name in ("slm", "laser_1", "laser_2"))
    return Piece("slm", links, stand.link, placement, (), f"its beams leave 30 deg to either side of {axis}")


def target_on(tree: UrdfTree, stand: Stand, prefix: str = "") -> Piece:
    """A reflector or marker."""
    placement, _ = stand.placement(tree, _TARGET)
    return Piece("target", (f"{prefix}target",), stand.link, placement, (), "a reflector or marker, its middle is the link's origin")


def board_on(tree: UrdfTree, stand: Stand, grid: Grid, prefix: str = "") -> Piece:
    """A board that looks outward, its middle where it is stated to be."""
    placement, axis = stand.placement(tree, _BOARD)
    placement = placement * _TURNED * pin.SE3(np.eye(3), -grid.points().mean(axis=0))
    steps = (2 * grid.columns if grid.staggered else grid.columns, grid.rows)
    values = (("columns", str(steps[0])), ("rows", str(steps[1])), ("square", repr(grid.square)))
    size = " x ".join(f"{(count + 1) * grid.square * 1e3:g}" for count in steps)
    first = "circle 0" if grid.staggered else "corner 0"
    words = f"{first} of {grid.columns} x {grid.rows}; its front, {size} mm, looks along {axis}"
    return Piece("board", (f"{prefix}board",), stand.link, placement, values, words)


def screen_on(tree: UrdfTree, stand: Stand, tip: str, size: tuple[float, float], prefix: str = "") -> Piece:
    """A screen with its middle at a point of a link, by default facing the shoulder: the first moving joint on the way to the tip.

    Raises:
        RigError: nothing moves between them.
    """
    assert stand.xyz is not None
    rotation = facing(stand.xyz - _shoulder(tree, stand.link, tip)) if stand.rpy is None else pose(np.zeros(3), stand.rpy).rotation
    values = (("width", repr(size[0])), ("height", repr(size[1])))
    words = f"{size[0]:g} x {size[1]:g} m, {'facing the robot' if stand.rpy is None else 'turned as stated'}"
    return Piece("screen", (f"{prefix}screen",), stand.link, pin.SE3(rotation, stand.xyz), values, words)


def facing(away: Vector) -> Matrix:
    """Axes of a screen that lies in a direction (3,): x leads away, level or, where the direction is steep, straight up or down."""
    level = float(np.hypot(away[0], away[1]))
    if math.atan2(abs(away[2]), level) <= _STEEP and level:
        x = np.array([away[0], away[1], 0.0]) / level
        return np.column_stack([x, np.cross([0.0, 0.0, 1.0], x), [0.0, 0.0, 1.0]])
    x = np.array([0.0, 0.0, math.copysign(1.0, away[2])])
    return np.column_stack([x, [0.0, 1.0, 0.0], np.cross(x, [0.0, 1.0, 0.0])])


def outward(tree: UrdfTree, tip: str) -> Vector:
    """The axis of a link's frame that leads away from the arm that carries it, (3,); z for a link that no joint moves."""
    T_joint_tip, moved = pin.SE3.Identity(), False
    for joint in reversed(tree.path_from_root(tip)):
        moved = moved or joint.moves
        away = T_joint_tip.rotation.T @ T_joint_tip.translation  # from the joint to the tip, in the tip's axes
        if moved and np.linalg.norm(away) > _APART:
            axis = np.zeros(3)
            axis[int(np.argmax(np.abs(away) + np.array([0.0, 0.0, _APART / 10])))] = 1.0  # as near to z as to another: z
            return np.asarray(axis * np.sign(away @ axis))
        T_joint_tip = joint.origin * T_joint_tip
    return np.array([0.0, 0.0, 1.0])


def _shoulder(tree: UrdfTree, base: str, tip: str) -> Vector:
    """Where the first moving joint between a link and the tip is, (3,) in that link's frame, [m]; the others stand at zero."""
    up, down = tree.path_from_root(base), tree.path_from_root(tip)
    shared = sum(one is other for one, other in zip(up, down, strict=False))
    T_base_here = pin.SE3.Identity()
    for joint in reversed(up[shared:]):
        if joint.moves:
            return np.array(T_base_here.translation)
        T_base_here = T_base_here * joint.origin.inverse()
    for joint in down[shared:]:
        T_base_here = T_base_here * joint.origin
        if joint.moves:
            return np.array(T_base_here.translation)
    raise RigError(f"no moving joint between '{base}' and '{tip}'; name the link that the screen stands on with --base LINK", tree.label)


def require_moving(tree: UrdfTree, tip: str, base: str) -> None:
    """Refuse two ends that do not move against each other.

    Raises:
        RigError: names a link that does.
    """
    if tree.moving_link(tip) == tree.moving_link(base):
        raise RigError(
            f"no moving joint between --tip '{tip}' and '{base}'; --tip names the link that carries it, such as '{tree.last_link}'",
            tree.label,
        )


def require_free(tree: UrdfTree, pieces: Iterable[Piece], prefix: str) -> None:
    """Refuse names that the robot has already, and a prefix that makes none.

    Raises:
        UsageError: the prefix is none.
        RigError: names what is there, and a prefix that is free.
    """
    if prefix and not _NAME.fullmatch(prefix):
        raise UsageError(f"--prefix {prefix}: expected letters, digits and _ such as left_, a letter first")
    taken, new = {*tree.links, *tree.joints}, [name for piece in pieces for name in (*piece.links, *piece.joints)]
    there = [name for name in new if name in taken]
    if there:
        free = next(word for word in _prefixes() if not any(name.startswith(word) for name in taken))
        kind = "link" if there[0] in tree.links else "joint"
        raise RigError(
            f"has a {kind} '{there[0]}' already; --prefix {free} names what is new {free}{new[0].removeprefix(prefix)} and so on",
            tree.label,
        )


def _prefixes() -> Iterable[str]:
    yield "rig_"
    number = 2
    while True:
        yield f"rig{number}_"
        number += 1


def with_pieces(robot: Robot, pieces: Sequence[Piece], prefix: str, note: str) -> Description:
    """The robot's description with the pieces at its end; all other bytes stay.

    Args:
        robot: The robot.
        pieces: What is put on it.
        prefix: What their names begin with.
        note: A comment that stands before them.
    """
    parents = {piece.parent: f"urdfcal_parent_{index}" for index, piece in enumerate(pieces)}
    calls = "".join(piece.call(parents[piece.parent], prefix) for piece in pieces)
    elements = expanded_calls(calls)
    return replace(robot.description, text=with_elements(robot.description, elements, note, {own: name for name, own in parents.items()}))


def _along(axis: Vector) -> Matrix:
    """Axes whose z is a signed axis (3,), the others those behind it in turn."""
    number = int(np.argmax(np.abs(axis)))
    turn = np.eye(3)[:, [(number + 1) % 3, (number + 2) % 3, number]]
    return np.asarray(turn if axis[number] > 0 else turn @ np.diag([1.0, -1.0, -1.0]))


def _axis_name(direction: Vector) -> str:
    """`+z`, or the numbers of a direction that is no axis."""
    number = int(np.argmax(np.abs(direction)))
    if abs(direction[number]) > 1 - 1e-9:
        return f"{'+' if direction[number] > 0 else '-'}{'xyz'[number]}"
    return f"({', '.join(f'{value:.2f}' for value in direction)})"
