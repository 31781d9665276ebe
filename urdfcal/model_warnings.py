"""What a chosen error model cannot follow on a robot, said before anyone relies on it."""

from __future__ import annotations

import numpy as np

from urdfcal.dh import dh_table
from urdfcal.error_model import ErrorModel
from urdfcal.gauge import ModelOptions, missing_screen_parameters
from urdfcal.geometry import MM, cross
from urdfcal.robot import Robot

_NEAR_AXIS = 10 * MM


def model_warnings(robot: Robot, errors: ErrorModel, options: ModelOptions) -> tuple[str, ...]:
    """What the chosen error model cannot follow on this robot."""
    if options.error_model == "dh":
        return (*_mount_warning(robot), *_parallel_warning(robot))
    first = robot.chain.steps[0]
    if first.joint.moves and not first.forward:
        return (
            f"the screen '{robot.rig.screen}' is the very link that '{first.joint.name}' moves, so its placement cannot be estimated; "
            "hang it on a fixed joint",
        )
    missing = missing_screen_parameters(robot.chain, robot.rig, errors) if options.error_model == "auto" else ()
    if not missing:
        return ()
    return (
        f"the screen '{robot.rig.screen}' has no fixed joint of its own, so its placement is not estimated; "
        f"--estimate screen adds {', '.join(missing)}, which no other parameter can stand for",
    )


def _mount_warning(robot: Robot) -> tuple[str, ...]:
    """The paper's mount has no translation along y; on the last axis that one is visible, and another not."""
    last = robot.chain.moving[-1]
    off = float(np.linalg.norm(cross(np.array(last.joint.axis), robot.chain.T_last_module.translation)))
    if last.joint.prismatic or not last.forward or off >= _NEAR_AXIS:
        return ()
    return (
        f"the module '{robot.rig.module}' lies {off / MM:.1f} mm from the axis of '{last.joint.name}': the five mount parameters of "
        "the dh model leave out trans_y, which such a mount shows; use --error-model auto or hayati",
    )


def _parallel_warning(robot: Robot) -> tuple[str, ...]:
    """Denavit and Hartenberg's parameters cannot tilt an axis that is parallel to the one before it in both directions."""
    joints = [row.name for row in dh_table(robot.chain) if row.parallel and row.name in robot.tree.joints]
    if not joints:
        return ()
    return (
        f"the axis of {', '.join(joints)} is nearly parallel to the one before it: the dh model cannot tilt it both ways; "
        "use --error-model auto or hayati unless the paper's parameters are the point",
    )
