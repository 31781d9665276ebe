"""Twists of the module by turns of the joints on the way, from Pinocchio's forward kinematics of the whole robot.

`frame_jacobian.py` has the same for the error model, from a model of the way alone; the tests compare the two. This one costs little
for a single pose, as control code wants it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pinocchio as pin

from urdfcal.geometry import Array3, Matrix, Vector
from urdfcal.robot import Robot
from urdfcal.whole_robot import WholeRobot


class ArmScrews:
    """The joints on the way, and further axes in their frames; holds data of its own and leaves the model as it is."""

    def __init__(self, robot: Robot, joints: Sequence[int], axes: Sequence[Vector]) -> None:
        """Prepare.

        Args:
            robot: The robot.
            joints: Index of the moving joint on the way that carries each further axis.
            axes: Unit vectors of the further axes, in the joints' own frames.
        """
        model, steps = robot.model, robot.chain.moving
        self.model, self.data, self.whole = model, model.createData(), WholeRobot(robot, robot.chain.input_names)
        module = model.frames[model.getFrameId(robot.rig.module, pin.BODY)]
        self.carrier, self.module = module.parentJoint, np.append(module.placement.translation, 1.0)
        self.ids = [model.getJointId(step.joint.name) for step in steps]
        self.owners = np.array([*range(len(steps)), *joints])
        self.axes = np.array([step.joint.axis for step in steps] + [list(axis) for axis in axes])[..., None]
        self.slides = np.array([step.joint.prismatic for step in steps] + [False] * len(joints))
        signs = [1.0 if step.forward else -1.0 for step in steps]
        turns = np.array([signs[joint] for joint in joints])  # the module's motion as the screen sees it
        self.signs = np.append(np.ones(len(steps)), turns)[:, None]  # chain positions have their sign already

    def twists(self, q: Matrix) -> Array3:
        """Twists [v, w] of the module against the screen at the module's origin, in world axes, (n, 6, moving + further axes).

        Per unit of the chain's positions, and per turn of the joint itself about each further axis.

        Args:
            q: Positions of the measured joints, (n, inputs), [rad] or [m].
        """
        placed = np.empty((len(q), len(self.ids) + 1, 4, 4))
        model, data = self.model, self.data
        for pose, configuration in enumerate(self.whole.configurations(q)):
            pin.forwardKinematics(model, data, configuration)
            placed[pose] = [data.oMi[joint].homogeneous for joint in (*self.ids, self.carrier)]
        tool, owners = (placed[:, -1] @ self.module)[:, None, :3], placed[:, self.owners]
        axes = (owners[:, :, :3, :3] @ self.axes)[..., 0] * self.signs
        lever = tool - owners[:, :, :3, 3]
        v = axes[..., _NEXT] * lever[..., _LAST] - axes[..., _LAST] * lever[..., _NEXT]
        twists = np.concatenate([v, axes], axis=2)
        if self.slides.any():
            twists[:, self.slides, :3], twists[:, self.slides, 3:] = axes[:, self.slides], 0.0
        return twists.transpose(0, 2, 1)


_NEXT, _LAST = [1, 2, 0], [2, 0, 1]
