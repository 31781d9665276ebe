"""Corrected origins as YAML files that other descriptions are built from: any robot's, and Universal Robots' own."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
import yaml

from urdfcal.base.errors import RobotError, did_you_mean
from urdfcal.base.geometry import SE3, Z, xyz_rpy
from urdfcal.robot.robot import Robot
from urdfcal.robot.urdf_tree import UrdfJoint

UR_JOINTS = {  # section of the UR driver's kinematics file -> joint whose origin it is, behind any prefix
    "shoulder": "shoulder_pan_joint",
    "upper_arm": "shoulder_lift_joint",
    "forearm": "elbow_joint",
    "wrist_1": "wrist_1_joint",
    "wrist_2": "wrist_2_joint",
    "wrist_3": "wrist_3_joint",
}
_DUST = 1e-16  # what rounding leaves of a zero
_NAMES = ("x", "y", "z", "roll", "pitch", "yaw")


def origins_yaml(robot: Robot, origins: Mapping[str, SE3]) -> bytes:
    """The absolute origin of every joint that moves, and of the fixed ones that were calibrated, in the order of the description.

    xacro reads it with `xacro.load_yaml(file)['joints'][joint]['x']` and so on.

    Args:
        robot: The description that the origins belong to.
        origins: Corrected placement by joint name; other joints keep theirs.
    """
    joints = robot.tree.joints
    entries = {name: origin_entry(origins.get(name, joint.origin)) for name, joint in joints.items() if joint.moves or name in origins}
    comment = "Origins of joints in their parent links, corrected by urdfcal: x y z in m, roll pitch yaw in rad, as in URDF's <origin>."
    return yaml_text([comment], {"robot": robot.name, "joints": entries})


def ur_yaml(robot: Robot, origins: Mapping[str, SE3], kinematics_hash: str | None = None) -> bytes:
    """The kinematics file of Universal Robots' ROS driver (`kinematics_params_file`): the six joints' origins.

    Its `hash` names the factory calibration in the robot's controller, which the driver compares with the robot that it meets. It
    cannot be computed from these numbers, so there is none unless it is given.

    Args:
        robot: The description that the origins belong to.
        origins: Corrected placement by joint name.
        kinematics_hash: From the kinematics file of the very robot, as `ur_calibration` extracts it.

    Raises:
        RobotError: the robot does not have the six joints.
    """
    joints = ur_joints(robot, origins)
    content: dict[str, Any] = {section: origin_entry(origins.get(joint.name, joint.origin)) for section, joint in joints.items()}
    comments = ["Kinematics of a UR robot, corrected by urdfcal: x y z in m, roll pitch yaw in rad."]
    if kinematics_hash is None:
        comments.append("ur_description also asks for kinematics: hash, from the file that ur_calibration extracts from this very robot.")
    else:
        content["hash"] = kinematics_hash
    return yaml_text([*comments, *ur_warnings(robot, origins)], {"kinematics": content})


def ur_warnings(robot: Robot, origins: Mapping[str, SE3]) -> tuple[str, ...]:
    """What keeps the driver's description from using the file: joints that do not turn about their z as all of ur_description's do.

    Raises:
        RobotError: the robot does not have the six joints.
    """
    others = other_frames(ur_joints(robot, origins).values())
    if not others:
        return ()
    return (
        f"{', '.join(others)} turn about other axes than z, as in older UR descriptions: today's ur_description would build another "
        "robot from these numbers; for the driver, calibrate the URDF that its own xacro makes",
    )


def other_frames(joints: Iterable[UrdfJoint]) -> list[str]:
    """Names of joints that do not turn about their z, so that their frames are not those of ur_description."""
    return [joint.name for joint in joints if not np.allclose(joint.axis, Z, atol=1e-9)]


def ur_joints(robot: Robot, calibrated: Iterable[str]) -> dict[str, UrdfJoint]:
    """The six joints of a UR arm by section of its kinematics file; of several arms the one that was calibrated.

    Raises:
        RobotError: names what is missing.
    """
    joints, where = robot.tree.joints, robot.description.label
    endings = tuple(UR_JOINTS.values())
    prefixes = {name.removesuffix(ending) for name in joints for ending in endings if name.endswith(ending)}
    missing = {prefix: [prefix + ending for ending in endings if prefix + ending not in joints] for prefix in sorted(prefixes)}
    whole = [prefix for prefix, names in missing.items() if not names]
    if not whole:
        best = min(missing.values(), key=len, default=list(endings))
        raise RobotError(
            f"the UR format needs the six joints of a UR arm; missing: {', '.join(best)}{did_you_mean(best[0], joints)}", where
        )
    names = set(calibrated)
    touched = [prefix for prefix in whole if names & {prefix + ending for ending in endings}] or whole
    if len(touched) > 1:
        found = ", ".join(f"'{prefix}'" for prefix in touched)
        raise RobotError(f"the UR format is for one arm, found those with the prefixes {found}", where)
    return {section: joints[touched[0] + ending] for section, ending in UR_JOINTS.items()}


def yaml_text(comments: Iterable[str], content: Mapping[str, Any]) -> bytes:
    """YAML under some lines of comment; numbers with as many digits as bring the double back."""
    text = yaml.safe_dump(dict(content), sort_keys=False, default_flow_style=False, width=160, allow_unicode=True)
    return ("".join(f"# {comment}\n" for comment in comments) + text).encode()


def origin_entry(origin: SE3) -> dict[str, float]:
    """An origin by the names that such files have."""
    values = np.concatenate(xyz_rpy(origin))
    return dict(zip(_NAMES, np.where(np.abs(values) < _DUST, 0.0, values).tolist(), strict=True))
