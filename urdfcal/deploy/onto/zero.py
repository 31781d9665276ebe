"""A robot's links and axes at its zero position, as they were and as they were found to be.

With all joints at zero, link L stands at N_L in the base before, and at C_L after. Whatever is rigidly joined to it, in whichever
description and with whichever frame, has to move by U_L = C_L N_L^-1. That is all that another description needs: its frames need not be
the URDF's, as long as its axes are.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pinocchio as pin

from urdfcal.base.geometry import SE3, Vector
from urdfcal.robot.robot import Robot
from urdfcal.robot.urdf_tree import UrdfJoint


@dataclass(frozen=True)
class Axis:
    """A joint's axis in some base, all joints at zero.

    Attributes:
        point: On it, (3,), [m].
        direction: Unit vector, (3,).
        slides: Whether the joint moves along it and not about it.
    """

    point: Vector
    direction: Vector
    slides: bool

    def moved(self, motion: SE3) -> Axis:
        """The axis as a motion carries it along."""
        return Axis(motion.act(self.point), motion.rotation @ self.direction, self.slides)

    def motion(self, position: float) -> SE3:
        """Of what hangs behind the joint, from zero to a position, [rad] or [m]."""
        if self.slides:
            return pin.SE3(np.eye(3), self.direction * position)
        rotation = pin.exp3(self.direction * position)
        return pin.SE3(rotation, self.point - rotation @ self.point)


@dataclass(frozen=True)
class AtZero:
    """Where a URDF has its links, and where a calibration puts them, in its root link's frame.

    Attributes:
        robot: As its URDF has it.
        origins: Corrected placement by joint name.
    """

    robot: Robot
    origins: Mapping[str, SE3]

    @cached_property
    def nominal(self) -> dict[str, SE3]:
        """Placement by link name, before."""
        return self._placed({})

    @cached_property
    def corrected(self) -> dict[str, SE3]:
        """Placement by link name, after."""
        return self._placed(self.origins)

    @cached_property
    def motions(self) -> dict[str, SE3]:
        """U by link name."""
        return {name: self.corrected[name] * before.inverse() for name, before in self.nominal.items()}

    @cached_property
    def axes(self) -> dict[str, Axis]:
        """By joint that moves, before."""
        moving = (joint for joint in self.robot.tree.joints.values() if joint.moves)
        return {
            joint.name: Axis(np.array(self.nominal[joint.child].translation), self._direction(joint), joint.prismatic) for joint in moving
        }

    def _direction(self, joint: UrdfJoint) -> Vector:
        axis = np.array(joint.axis)
        return np.asarray(self.nominal[joint.child].rotation @ (axis / np.linalg.norm(axis)))

    def _placed(self, origins: Mapping[str, SE3]) -> dict[str, SE3]:
        tree = self.robot.tree
        placed: dict[str, SE3] = {}
        for link in tree.links:
            placement = pin.SE3.Identity()
            for joint in tree.path_from_root(link):
                placement = placement * origins.get(joint.name, joint.origin)
            placed[link] = placement
        return placed
