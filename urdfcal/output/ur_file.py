"""A kinematics file of Universal Robots' driver, as `ur_calibration` extracts it: its hash, and whose it can be.

ur_description builds a robot from the six origins in such a file, so a URDF that was made with it has the same. A URDF of the nominal
robot is off by the factory's calibration, of fifteen arms with published files by up to 2.4 mm and 17 mrad a joint; one of another
model by more: those nearest to each other, UR3 and UR3e, by 19 mm.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from urdfcal.base.errors import InputError
from urdfcal.base.files import read_yaml
from urdfcal.base.geometry import DEG, SE3, distance_mm_mrad, pose
from urdfcal.output.driver_yaml import UR_JOINTS, other_frames, ur_joints
from urdfcal.robot.robot import Robot
from urdfcal.robot.urdf_xml import FARTHEST

_NAMES = ("x", "y", "z", "roll", "pitch", "yaw")
_SAME_MM, _SAME_MRAD = 1e-3, 1e-3  # what writing the numbers out in decimals leaves
_MODEL_MM, _MODEL_MRAD = 10.0, 3 * DEG * 1e3  # between what a factory calibration changes and what lies between two models


@dataclass(frozen=True)
class UrFile:
    """What a kinematics file says.

    Attributes:
        path: The file.
        hash: Of the factory calibration in the robot's controller; empty where the file has none and need not.
        origins: Of the six joints by section; none where the file does not have all their numbers.
    """

    path: Path
    hash: str
    origins: Mapping[str, SE3]

    def require_model_of(self, robot: Robot, calibrated: Iterable[str]) -> None:
        """Refuse the file of another model of UR arm.

        Raises:
            InputError: names the joint that is farthest away.
            RobotError: the robot does not have the six joints.
        """
        off = self._off(robot, calibrated)
        name = max(off, key=lambda section: max(off[section][0] / _MODEL_MM, off[section][1] / _MODEL_MRAD), default="")
        if name and (off[name][0] > _MODEL_MM or off[name][1] > _MODEL_MRAD):
            raise InputError(
                f"its {name} is {off[name][0]:.0f} mm and {off[name][1]:.0f} mrad from that of {robot.description.label}, as in another "
                "model of robot; expected the kinematics file of this very robot",
                self.path,
            )

    def warnings(self, robot: Robot, calibrated: Iterable[str]) -> tuple[str, ...]:
        """What to say where the robot's description was not made with this file; of other frames than its own, nothing can be."""
        if not self.origins:
            return (f"{self.path}: has no numbers of the six joints, so nothing tells whether its hash is this robot's",)
        off = self._off(robot, calibrated).values()
        mm, mrad = (max((each[part] for each in off), default=0.0) for part in (0, 1))
        if mm <= _SAME_MM and mrad <= _SAME_MRAD:
            return ()
        return (
            f"{self.path}: its numbers are up to {mm:.2f} mm and {mrad:.2f} mrad from those of {robot.description.label}, which was not "
            "made with this file; its hash is right only if both are of the very robot that was measured",
        )

    def _off(self, robot: Robot, calibrated: Iterable[str]) -> dict[str, tuple[float, float]]:
        """How far each section is from the robot's description, [mm] and [mrad]; empty where the two have other frames."""
        joints = ur_joints(robot, calibrated)
        if not self.origins or other_frames(joints.values()):
            return {}
        return {section: distance_mm_mrad(self.origins[section], joint.origin) for section, joint in joints.items()}


def read_ur_file(path: Path, *, hashed: bool = True) -> UrFile:
    """Read a kinematics file of the UR driver.

    Args:
        path: The file.
        hashed: Whether it must have the hash that `ur_calibration` writes.

    Raises:
        InputError: there is no hash in it where there must be one, or nothing under kinematics.
    """
    file = read_yaml(path, InputError)
    section = file.content.get("kinematics") if isinstance(file.content, dict) else None
    found = section.get("hash") if isinstance(section, dict) else None
    if not isinstance(section, dict) or (hashed and not (isinstance(found, str) and found)):
        raise InputError("has no entry kinematics: hash, expected a file that ur_calibration extracted from the robot", path)
    origins = {name: _origin(section.get(name)) for name in UR_JOINTS}
    whole = {name: origin for name, origin in origins.items() if origin is not None}
    return UrFile(path, found if isinstance(found, str) else "", whole if len(whole) == len(origins) else {})


def _origin(entry: Any) -> SE3 | None:
    """A section as a placement; None where one of its numbers is missing or none."""
    values = [entry.get(name) for name in _NAMES] if isinstance(entry, dict) else []
    if not values or not all(isinstance(value, int | float) and abs(value) <= FARTHEST for value in values):
        return None
    return pose(np.array(values[:3], dtype=float), np.array(values[3:], dtype=float))
