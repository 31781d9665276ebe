"""A chain as a Pinocchio model, joint by joint: the second witness of the stacked kinematics."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from urdfcal.base.geometry import SE3, Matrix, Vector
from urdfcal.model.walk import Placements
from urdfcal.robot.chain import Bend, Chain


class PinocchioArm:
    """Forward kinematics and frame Jacobians of a chain with its constants put in, and with bends, by Pinocchio, pose by pose.

    Attributes:
        columns: Moving joint, and bend or -1, of every joint of the model in its order.
    """

    def __init__(self, chain: Chain, placed: Placements, bends: Sequence[Bend] = ()) -> None:
        self.model, self.layout = chain.new_model(bends)
        for joint, placement in zip(self.layout.first, placed.joints, strict=True):
            self.model.jointPlacements[joint] = pin.SE3(placement)
        self.last = [0, *self.layout.last]
        for index, frame in enumerate(chain.frames):
            self.model.addFrame(pin.Frame(f"frame {index}", self.last[frame.depth], pin.SE3(placed.frames[index]), pin.FrameType.OP_FRAME))
        self.data = self.model.createData()
        own = {joint: (index, -1) for index, joint in enumerate(self.layout.motion)}
        own |= {joint: (bends[number].joint, number) for number, joint in enumerate(self.layout.bends)}
        self.columns = [own[joint] for joint in range(1, self.model.njoints)]

    def frame(self, q: Vector, index: int) -> SE3:
        """Placement of one of the chain's frames at positions of all joints, bends included."""
        pin.framesForwardKinematics(self.model, self.data, q)
        return self.data.oMf[self.model.getFrameId(f"frame {index}")].copy()

    def jacobian(self, q: Vector, index: int) -> Matrix:
        """Twists [v, w] of one of the frames by every joint, in the base's axes at the base's origin, (6, joints)."""
        in_frame = pin.computeFrameJacobian(self.model, self.data, q, self.model.getFrameId(f"frame {index}"), pin.LOCAL)
        return np.asarray(self.frame(q, index).action @ in_frame)

    def body(self, q: Vector, depth: int) -> Matrix:
        """Action of the placement of the body behind a moving joint, Ad(T), (6, 6)."""
        pin.forwardKinematics(self.model, self.data, q)
        return np.asarray(self.data.oMi[self.last[depth]].action)
