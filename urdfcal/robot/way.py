"""The way from one link of a robot to another behind it, at many configurations at once: placements and Jacobians.

    T_base_tool(q) = A_1 M_1(q) A_2 M_2(q) ... A_tool

with A_i the placement of the i-th moving joint behind the one before it and M_i its motion. In the tool's own axes joint i moves the tool
by the twist Ad(T_i^-1_tool) s_i, s_i its unit screw: [a x t, a] turned into the tool's axes, t the tool as joint i sees it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import zip_longest
from typing import NamedTuple

import numpy as np

from urdfcal.base.errors import RobotError
from urdfcal.base.geometry import SE3, Array3, Matrix, Vector, product
from urdfcal.base.rotations import skew
from urdfcal.robot.chain import leader_of
from urdfcal.robot.robot import Robot
from urdfcal.robot.urdf_tree import UrdfJoint


@dataclass(frozen=True, eq=False)
class Way:
    """The joints between two links.

    Attributes:
        robot: The robot.
        base: The link from which the tool is seen; it carries the tool, or is fixed to a link that does, as a UR's `base` is.
        tool: The link that is moved.
    """

    robot: Robot
    base: str
    tool: str

    @classmethod
    def between(cls, robot: Robot, tool: str, base: str | None = None) -> Way:
        """The way to a link, by default from the root.

        Raises:
            RobotError: no such link, the base does not carry the tool, or no joint moves the one in the other.
        """
        tree = robot.tree
        tree.require_link(tool)
        way = cls(robot, tree.require_link(base or tree.root), tool)
        if way.begin not in way._links:
            raise RobotError(f"the link '{way.base}' does not carry '{tool}'", robot.description.label)
        if not way.inputs:
            raise RobotError(f"no joint moves '{tool}' in '{way.base}'", robot.description.label)
        return way

    @cached_property
    def _links(self) -> list[str]:
        """All links from the root to the tool."""
        return [self.robot.tree.root, *(joint.child for joint in self.robot.tree.path_from_root(self.tool))]

    @cached_property
    def begin(self) -> str:
        """The link that the path begins at: the base, or the one that it is fixed to where it stands aside."""
        return self.base if self.base in self._links else self.robot.tree.moving_link(self.base)

    @cached_property
    def path(self) -> tuple[UrdfJoint, ...]:
        """All joints from where it begins, in order."""
        return tuple(self.robot.tree.path_from_root(self.tool)[self._links.index(self.begin) :])

    @property
    def _aside(self) -> list[UrdfJoint]:
        """The fixed joints from where it begins to a base that stands aside."""
        tree = self.robot.tree
        return [] if self.begin == self.base else tree.path_from_root(self.base)[len(tree.path_from_root(self.begin)) :]

    @cached_property
    def inputs(self) -> tuple[UrdfJoint, ...]:
        """The joints that are set, each once; others follow them."""
        leaders = (leader_of(self.robot.tree, joint)[0] for joint in self.path if joint.moves)
        return tuple(dict.fromkeys(leaders))

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the joints that are set."""
        return tuple(joint.name for joint in self.inputs)

    @cached_property
    def limits(self) -> Matrix:
        """Lower and upper limits of the joints that are set, (2, k); infinite where a joint turns on and on."""
        return np.array([(joint.lower, joint.upper) for joint in self.inputs]).T

    @cached_property
    def segments(self) -> tuple[tuple[UrdfJoint | None, SE3], ...]:
        """Each moving joint with its placement behind the one before it; last, without a joint, the tool's behind the last of them."""
        found: list[tuple[UrdfJoint | None, SE3]] = []
        pending = [joint.origin.inverse() for joint in reversed(self._aside)]
        for joint in self.path:
            pending.append(joint.origin)
            if joint.moves:
                found.append((joint, product(pending)))
                pending = []
        return (*found, (None, product(pending)))

    def placements(self, q: Matrix) -> Array3:
        """Placement of the tool in the base, (n, 4, 4), at positions (n, k), [rad] or [m]."""
        *_, (tool, _) = self.walk(q)
        return tool

    def jacobians(self, q: Matrix) -> tuple[Array3, Array3]:
        """The same, and the twist of the tool in its own axes per unit of each position, (n, 6, k)."""
        *frames, (tool, _) = self.walk(q)
        J = np.zeros((len(q), 6, len(self.inputs)))
        for (joint, column, factor, _), (_, frame) in zip(self._motions, frames, strict=True):
            axis = np.array(joint.axis)
            to_tool = np.einsum("nji,njk->nik", frame[:, :3, :3], tool[:, :3, :3]).transpose(0, 2, 1)
            lever = np.einsum("nji,nj->ni", frame[:, :3, :3], tool[:, :3, 3] - frame[:, :3, 3])
            linear, angular = (np.broadcast_to(axis, lever.shape), 0.0 * lever) if joint.prismatic else (np.cross(axis, lever), axis)
            J[:, :3, column] += factor * np.einsum("nij,nj->ni", to_tool, linear)
            J[:, 3:, column] += factor * np.einsum("nij,nj->ni", to_tool, np.broadcast_to(angular, lever.shape))
        return tool, J

    def walk(self, q: Matrix) -> Iterator[tuple[Array3, Array3]]:
        """Every moving joint's frame before its motion and behind it, last the tool, which does not move; in the base, (n, 4, 4) each."""
        placed = np.repeat(np.eye(4)[None], len(q), axis=0)
        for (_, placement), motion in zip_longest(self.segments, self._motions):
            before = placed @ placement.homogeneous
            placed = before if motion is None else before @ _moved(motion, q)
            yield before, placed

    @cached_property
    def _motions(self) -> list[_Motion]:
        found = []
        for joint in (joint for joint in self.path if joint.moves):
            leader, factor, shift = leader_of(self.robot.tree, joint)
            found.append(_Motion(joint, self.inputs.index(leader), factor, shift))
        return found


class _Motion(NamedTuple):
    """A moving joint, the column of the position that moves it, how many times, and from where on."""

    joint: UrdfJoint
    column: int
    factor: float
    shift: float


def _moved(motion: _Motion, q: Matrix) -> Array3:
    position, axis = motion.factor * q[:, motion.column] + motion.shift, np.array(motion.joint.axis)
    return slid(axis, position) if motion.joint.prismatic else turned(axis, position)


def turned(axis: Vector, angle: Vector) -> Array3:
    """Turns about one axis, (n, 4, 4)."""
    K, placed = skew(axis[None])[0], np.repeat(np.eye(4)[None], len(angle), axis=0)
    s, c = np.sin(angle)[:, None, None], np.cos(angle)[:, None, None]
    placed[:, :3, :3] += s * K + (1 - c) * (K @ K)
    return placed


def slid(axis: Vector, by: Vector) -> Array3:
    """Slides along one axis, (n, 4, 4)."""
    placed = np.repeat(np.eye(4)[None], len(by), axis=0)
    placed[:, :3, 3] = by[:, None] * axis
    return placed
