"""Each pose from both sides, for backlash: how far a joint goes back before it comes to the pose again."""

from __future__ import annotations

import numpy as np

from urdfcal.base.geometry import DEG, MM, Matrix, Vector
from urdfcal.robot.robot import Robot

_TURN, _SLIDE = 2 * DEG, 5 * MM  # more than the backlash of any drive, and too little to go far


def back_off(robot: Robot) -> Vector:
    """How far every measured joint goes beside a pose, (inputs,), [rad] or [m]."""
    return np.array([_SLIDE if joint.prismatic else _TURN for joint in robot.chain.inputs])


def from_both_sides(q: Vector, robot: Robot) -> Matrix:
    """Where to go about a pose (inputs,): before it, to it, where it is read, beyond it, and back, where it is read again, (4, inputs)."""
    back = back_off(robot)
    return np.array([q - back, q, q + back, q])
