"""Kinematics files of makers' own descriptions, written and read: xArm, Franka, Flexiv; and the calibration of a tesseract environment.

Each holds absolute origins, as a URDF's <origin> has them, so they are exact. Where that stands, publicly:

    xarm        xarm_description/config/kinematics/gen_kinematics_params.py of xArm-Developer/xarm_ros2, which writes the file that
                `kinematics_suffix` names from the controller's own numbers: kinematics: jointN: x y z roll pitch yaw
    franka      robots/fer/kinematics.yaml of frankaemika/franka_description: jointN: kinematic: x ... yaw; joint8 leads to the flange.
                Its macro franka-kinematics, in robots/common/utils.xacro, makes an <origin> of them
    flexiv      config/Rizon4/default_kinematics.yaml and urdf/common/rizon_arm.xacro of flexivrobotics/flexiv_description:
                kinematics: jointN: x ... yaw, and link7_to_flange
    tesseract   CalibrationInfo of tesseract_common: calibration: joints: NAME: position, orientation; each becomes a
                ChangeJointOriginCommand, so it is absolute and goes by the URDF's own names
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from urdfcal.base.errors import InputError, RobotError, no_such
from urdfcal.base.files import YamlFile
from urdfcal.base.geometry import DEG, SE3, distance_mm_mrad, pose
from urdfcal.output.driver_yaml import origin_entry, yaml_text
from urdfcal.robot.robot import Robot
from urdfcal.robot.urdf_tree import UrdfJoint
from urdfcal.robot.urdf_xml import FARTHEST

_NUMBERED = re.compile(r"(.*?)joint(\d+)")
_NAMES = ("x", "y", "z", "roll", "pitch", "yaw")
_QUATERNION = ("x", "y", "z", "w")
_MODEL_MM, _MODEL_MRAD = 10.0, 3 * DEG * 1e3  # as for UR's: beyond that it is another model of robot


@dataclass(frozen=True)
class Maker:
    """How a maker's file is laid out.

    Attributes:
        counts: How many moving joints its arms have, named joint1 and so on behind any prefix.
        top: The entry that holds all; empty where there is none.
        inner: The entry in each joint's that holds the numbers; empty where there is none.
        fixed: Fixed joints that the file has, too.
    """

    counts: tuple[int, ...]
    top: str
    inner: str
    fixed: tuple[str, ...] = ()

    def joints(self, robot: Robot, calibrated: Iterable[str], what: str) -> dict[str, UrdfJoint]:
        """The joints by section of the file; of several arms the one that was calibrated.

        Raises:
            RobotError: there is no such arm, or several.
        """
        joints, arms = robot.tree.joints, _numbered(robot)
        whole = {prefix: own for prefix, own in arms.items() if set(own) == {*range(1, len(own) + 1)} and len(own) in self.counts}
        counts = " or ".join(map(str, self.counts))
        if not whole:
            raise RobotError(f"the {what} format needs joints named joint1, joint2 ... of {counts} that move", robot.description.label)
        names = set(calibrated)
        found = [prefix for prefix, own in whole.items() if names & set(own.values())] or list(whole)
        if len(found) > 1:
            arms_named = ", ".join(f"'{prefix}'" for prefix in found)
            raise RobotError(f"the {what} format is for one arm, found those with the prefixes {arms_named}", robot.description.label)
        sections = {f"joint{number}": joints[name] for number, name in sorted(whole[found[0]].items())}
        fixed = {name: joints[found[0] + name] for name in self.fixed if found[0] + name in joints}
        return sections | {name: joint for name, joint in fixed.items() if joint.rigid}


MAKERS = {
    "xarm": Maker((5, 6, 7), "kinematics", ""),
    "franka": Maker((7,), "", "kinematic", ("joint8",)),
    "flexiv": Maker((7,), "kinematics", "", ("link7_to_flange",)),
}


def _numbered(robot: Robot) -> dict[str, dict[int, str]]:
    """Names of moving joints by prefix and number."""
    found: dict[str, dict[int, str]] = {}
    for name, joint in robot.tree.joints.items():
        if joint.moves and (match := _NUMBERED.fullmatch(name)):
            found.setdefault(match[1], {})[int(match[2])] = name
    return found


def maker_yaml(what: str, robot: Robot, origins: Mapping[str, SE3]) -> bytes:
    """A maker's kinematics file.

    Args:
        what: Key of `MAKERS`.
        robot: The description that the origins belong to.
        origins: Corrected placement by joint name.

    Raises:
        RobotError: the robot is no such arm.
    """
    maker = MAKERS[what]
    joints = maker.joints(robot, origins, what)
    entries = {section: origin_entry(origins.get(joint.name, joint.origin)) for section, joint in joints.items()}
    content: dict[str, Any] = {section: {maker.inner: entry} if maker.inner else entry for section, entry in entries.items()}
    comment = f"Kinematics of this very robot, corrected by urdfcal, as the {what} description reads them: m and rad."
    return yaml_text([comment, *maker_warnings(what, robot, origins)], {maker.top: content} if maker.top else content)


def maker_warnings(what: str, robot: Robot, origins: Mapping[str, SE3]) -> tuple[str, ...]:
    """What the file cannot carry."""
    carried = {joint.name for joint in MAKERS[what].joints(robot, origins, what).values()}
    lost = [name for name in origins if name not in carried]
    return (f"the {what} file has no place for {', '.join(lost)}; the rest is in it",) if lost else ()


def tesseract_yaml(origins: Mapping[str, SE3]) -> bytes:
    """The calibration of a tesseract environment, which its SRDF names as <calibration_config filename=.../>."""
    entries = {name: _isometry(origin) for name, origin in origins.items()}
    comment = "Joint origins corrected by urdfcal, for a tesseract environment: m, quaternions."
    return yaml_text([comment], {"calibration": {"joints": entries}})


def _isometry(origin: SE3) -> dict[str, Any]:
    position = dict(zip("xyz", np.array(origin.translation).tolist(), strict=True))
    quaternion = pin.Quaternion(origin.rotation).normalized().coeffs().tolist()
    return {"position": position, "orientation": dict(zip(_QUATERNION, quaternion, strict=True))}


def read_maker_origins(file: YamlFile, robot: Robot) -> dict[str, SE3] | None:
    """Origins by joint name out of one of these files; None where it is none of them.

    Raises:
        InputError: it lacks numbers, or is of another model of robot.
        RobotError: the robot has no such arm.
    """
    content = file.content if isinstance(file.content, dict) else {}
    calibration = content.get("calibration")
    if isinstance(calibration, dict) and isinstance(calibration.get("joints"), dict):
        return _tesseract_origins(file, calibration["joints"], robot)
    what = _maker_of(content)
    if what is None:
        return None
    maker = MAKERS[what]
    sections, joints = content[maker.top] if maker.top else content, maker.joints(robot, (), what)
    found = {joint.name: _origin(file, maker, sections, section) for section, joint in joints.items() if joint.moves or section in sections}
    for name, origin in found.items():
        mm, mrad = distance_mm_mrad(origin, robot.tree.joints[name].origin)
        if mm > _MODEL_MM or mrad > _MODEL_MRAD:
            raise InputError(
                f"its {name} is {mm:.0f} mm and {mrad:.0f} mrad from that of {robot.description.label}, as in another model of robot; "
                "expected the kinematics file of this very robot",
                file.path,
            )
    return found


def _maker_of(content: Mapping[str, Any]) -> str | None:
    """Whose layout a file has; Flexiv's and xArm's are the same but for the flange."""
    inner = content.get("kinematics")
    if isinstance(inner, dict) and "joint1" in inner:
        return "flexiv" if "link7_to_flange" in inner else "xarm"
    first = content.get("joint1")
    return "franka" if isinstance(first, dict) and "kinematic" in first else None


def _origin(file: YamlFile, maker: Maker, sections: Mapping[str, Any], section: str) -> SE3:
    entry = sections.get(section)
    entry = entry.get(maker.inner) if maker.inner and isinstance(entry, dict) else entry
    values = [entry.get(word) for word in _NAMES] if isinstance(entry, dict) else []
    if not _all_numbers(values):
        raise InputError(f"{section}: expected numbers for {', '.join(_NAMES)}", file.path)
    return pose(np.array(values[:3], dtype=float), np.array(values[3:], dtype=float))


def _tesseract_origins(file: YamlFile, entries: Mapping[str, Any], robot: Robot) -> dict[str, SE3]:
    found: dict[str, SE3] = {}
    for name, entry in entries.items():
        where = file.line(("calibration", "joints", name))
        if name not in robot.tree.joints:
            raise InputError(f"calibration: joints: {no_such('joint', str(name), robot.tree.joints)}", file.path, where)
        position, turned = (entry.get(word) if isinstance(entry, dict) else None for word in ("position", "orientation"))
        xyz = [position.get(word) for word in "xyz"] if isinstance(position, dict) else []
        rotation = _orientation(turned)
        if not _all_numbers(xyz) or rotation is None:
            raise InputError(
                f"calibration: joints: {name}: expected position x y z, and orientation x y z w or r p y, in numbers", file.path, where
            )
        found[str(name)] = pin.SE3(rotation, np.array(xyz, dtype=float))
    return found


def _orientation(entry: Any) -> Any:
    """A quaternion, or roll, pitch and yaw under r, p and y; None for anything else."""
    if not isinstance(entry, dict):
        return None
    if all(word in entry for word in _QUATERNION):
        values = [entry[word] for word in _QUATERNION]
        good = _all_numbers(values) and np.linalg.norm(values) > 1e-6
        return pin.Quaternion(np.array(values, dtype=float) / np.linalg.norm(values)).matrix() if good else None
    values = [entry.get(word) for word in "rpy"]
    return pin.rpy.rpyToMatrix(*map(float, values)) if _all_numbers(values) else None


def _all_numbers(values: list[Any]) -> bool:
    return bool(values) and all(
        isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= FARTHEST for value in values
    )
