"""Where every link of a robot is whose joints give way: forward kinematics along the URDF with the deflections where they happen.

Each joint on the way turns (or slides) by its position and what its own terms add, and then turns about its axes across, one after
the other, as the fit has it (`robot.chain.new_model`):

    T_parent_child = T_origin  M(q + own)  R_1(across_1)  R_2(across_2)

Nothing is a matter of twists here, so it is exact at singular configurations and for large deflections. Joints that were not measured,
and give way to nothing, stay at neutral.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from urdfcal.base.errors import UsageError, no_such
from urdfcal.base.geometry import Array3, Matrix, Vector
from urdfcal.base.rotations import skew
from urdfcal.model.softness import Softness
from urdfcal.robot.chain import leader_of
from urdfcal.robot.robot import Robot
from urdfcal.robot.urdf_tree import UrdfJoint


@dataclass(frozen=True, eq=False)
class BentArm:
    """The joints of a robot and how they give way.

    Attributes:
        robot: The calibrated robot of the joint fit.
        softness: How its joints give way.
    """

    robot: Robot
    softness: Softness

    def placements(self, link: str, q: Matrix, deflections: Matrix) -> Array3:
        """Placement of a link in the robot's root link, T_root_link, (n, 4, 4), [m].

        Args:
            link: Any link of the robot.
            q: Positions of the measured joints, (n, inputs), [rad] or [m].
            deflections: What each term turns or slides its joint by, (n, terms), [rad] or [m].

        Raises:
            UsageError: there is no such link.
        """
        tree = self.robot.tree
        if link not in tree.links:
            raise UsageError(no_such("link", link, tree.links))
        placed = np.repeat(np.eye(4)[None], len(q), axis=0)
        for joint in tree.path_from_root(link):
            placed = placed @ joint.origin.homogeneous
            for motion in self._motions(joint, q, deflections):
                placed = placed @ motion
        return np.asarray(placed)

    def _motions(self, joint: UrdfJoint, q: Matrix, deflections: Matrix) -> Iterator[Array3]:
        """What a joint moves by, and what it gives way by across, (n, 4, 4)."""
        terms = self._terms_of.get(joint.name, ([], []))
        position = self._position(joint, q)
        if position is not None:
            own = position + deflections[:, terms[0]].sum(axis=1)
            axis = np.array(joint.axis)
            yield _slid(axis, own) if joint.prismatic else _turned(axis, own)
        for term in terms[1]:
            yield _turned(np.array(self.softness.terms[term].axis), deflections[:, term])

    def _position(self, joint: UrdfJoint, q: Matrix) -> Vector | None:
        """Of a joint, (n,), whatever moves it; None where it does not move, or has no single axis."""
        if not joint.moves or joint.type in ("floating", "planar"):
            return None
        leader, factor, shift = leader_of(self.robot.tree, joint)
        names = self.softness.chain.input_names
        return factor * q[:, names.index(leader.name)] + shift if leader.name in names else np.zeros(len(q))

    @cached_property
    def _terms_of(self) -> dict[str, tuple[list[int], list[int]]]:
        """Terms about each joint's own axis, and about axes across, by the joint's name."""
        found: dict[str, tuple[list[int], list[int]]] = {}
        for number, term in enumerate(self.softness.terms):
            about, across = found.setdefault(self.softness.chain.moving[term.joint].joint.name, ([], []))
            (about if term.axis is None else across).append(number)
        return found


def _turned(axis: Vector, angle: Vector) -> Array3:
    """Turns about one axis, (n, 4, 4)."""
    K, placed = skew(axis[None])[0], np.repeat(np.eye(4)[None], len(angle), axis=0)
    s, c = np.sin(angle)[:, None, None], np.cos(angle)[:, None, None]
    placed[:, :3, :3] += s * K + (1 - c) * (K @ K)
    return placed


def _slid(axis: Vector, by: Vector) -> Array3:
    """Slides along one axis, (n, 4, 4)."""
    placed = np.repeat(np.eye(4)[None], len(by), axis=0)
    placed[:, :3, 3] = by[:, None] * axis
    return placed
