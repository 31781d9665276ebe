"""Positions of every joint of a robot from those that were measured: mimic joints follow, the rest stays at neutral."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from urdfcal.geometry import Matrix
from urdfcal.robot import Robot


def whole_configurations(robot: Robot, q: Matrix) -> Matrix:
    """Configurations of the whole Pinocchio model.

    Args:
        robot: The robot.
        q: Positions of the measured joints, (n, inputs), [rad] or [m].

    Returns:
        (n, nq); a continuous joint has its cosine and sine.
    """
    model, chain = robot.model, robot.chain
    whole = np.tile(pin.neutral(model), (len(q), 1))
    column = {joint.name: index for index, joint in enumerate(chain.inputs)}
    for joint in robot.tree.joints.values():
        leader, factor, shift = joint.name, 1.0, 0.0
        while robot.tree.joints[leader].mimic is not None:
            mimic = robot.tree.joints[leader].mimic
            assert mimic is not None
            leader, factor, shift = mimic.joint, factor * mimic.multiplier, shift + factor * mimic.offset
        if joint.moves and model.existJointName(joint.name):
            own = q[:, column[leader]] if leader in column else np.zeros(len(q))
            _set(model, whole, joint.name, factor * own + shift)
    return whole


def _set(model: pin.Model, whole: Matrix, name: str, position: Matrix) -> None:
    index = model.getJointId(name)
    start, width = model.idx_qs[index], model.nqs[index]
    whole[:, start] = position if width == 1 else np.cos(position)
    if width == 2:
        whole[:, start + 1] = np.sin(position)
