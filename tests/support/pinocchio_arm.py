"""A chain as a Pinocchio model, joint by joint: the second witness of the stacked kinematics."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from urdfcal.base.geometry import SE3, Array3, Matrix, Vector, X, Y, Z
from urdfcal.model.walk import Placements
from urdfcal.robot.chain import Bend, Chain
from urdfcal.robot.urdf_tree import UrdfJoint


class PinocchioArm:
    """Forward kinematics and frame Jacobians of a chain with its constants put in, and with bends, by Pinocchio, pose by pose."""

    def __init__(self, chain: Chain, placed: Placements, bends: Sequence[Bend] = ()) -> None:
        self.model, self.last, self.names = pin.Model(), [0], list[tuple[int, int]]()
        for joint, step in enumerate(chain.moving):
            own = [number for number, bend in enumerate(bends) if bend.joint == joint]
            placement = pin.SE3(placed.joints[joint])
            for number in [-1, *own] if step.forward else [*own[::-1], -1]:
                kind = joint_model(step.joint) if number < 0 else pin.JointModelRevoluteUnaligned(np.array(bends[number].axis))
                self.model.addJoint(self.model.njoints - 1, kind, placement, f"{joint}:{number}")
                self.names.append((joint, number))
                placement = pin.SE3.Identity()
            self.last.append(self.model.njoints - 1)
        for index, frame in enumerate(chain.frames):
            self.model.addFrame(pin.Frame(f"frame {index}", self.last[frame.depth], pin.SE3(placed.frames[index]), pin.FrameType.OP_FRAME))
        self.data = self.model.createData()

    def frame(self, q: Vector, index: int) -> SE3:
        """Placement of one of the chain's frames at positions of all joints, bends included."""
        pin.framesForwardKinematics(self.model, self.data, q)
        return self.data.oMf[self.model.getFrameId(f"frame {index}")].copy()

    def jacobian(self, q: Vector, index: int) -> Matrix:
        """Twists [v, w] of one of the frames by every joint, in the base's axes at the base's origin, (6, joints)."""
        at_origin = pin.computeFrameJacobian(self.model, self.data, q, self.model.getFrameId(f"frame {index}"), pin.LOCAL)
        return np.asarray(self.frame(q, index).action @ at_origin)

    def body(self, q: Vector, depth: int) -> Array3:
        """Action of the placement of the body behind a moving joint, Ad(T), (6, 6)."""
        pin.forwardKinematics(self.model, self.data, q)
        return np.asarray(self.data.oMi[self.last[depth]].action)


def joint_model(joint: UrdfJoint) -> object:
    """A joint of the URDF as Pinocchio's."""
    axis, kind = np.array(joint.axis), "P" if joint.prismatic else "R"
    for letter, direction in zip("XYZ", (X, Y, Z), strict=True):
        if np.array_equal(axis, direction):
            return getattr(pin, f"JointModel{kind}{letter}")()
    return pin.JointModelPrismaticUnaligned(axis) if joint.prismatic else pin.JointModelRevoluteUnaligned(axis)
