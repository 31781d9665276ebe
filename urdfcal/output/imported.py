"""A robot's geometry as somebody else found it, brought in: corrections of the joints of a description.

The file may be a kinematics file of Universal Robots' driver or of another maker's description, origins as `--format origins-yaml`
writes them, another URDF of the robot, or D-H errors as a table. Errors of a D-H table go with the axes that `urdfcal dh` prints, in one
of three conventions:

    paper      T_i = Trans(x, a) Trans(z, d) Rot(x, alpha) Rot(z, theta), equation (2): d lies along the axis before the joint
    modified   T_i = Rot(x, alpha) Trans(x, a) Rot(z, theta) Trans(z, d), Craig's: d lies along the joint's own axis
    standard   T_i = Rot(z, theta) Trans(z, d) Trans(x, a) Rot(x, alpha): a and alpha lie behind the joint, on the next one's row
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pinocchio as pin

from urdfcal.base.errors import InputError, RobotError, no_such
from urdfcal.base.files import YamlFile, read_yaml
from urdfcal.base.geometry import SE3, Vector, pose, translation_screw
from urdfcal.base.tables import ANGLES, LENGTHS, Table, read_table
from urdfcal.model.dh import DhRow, dh_table
from urdfcal.model.earlier import EarlierJoints
from urdfcal.model.parameters import FLAT, PriorScale
from urdfcal.output.driver_yaml import other_frames, ur_joints
from urdfcal.output.makers_yaml import read_maker_origins
from urdfcal.output.ur_file import read_ur_file
from urdfcal.robot.corrections import OriginCorrection, same_origin
from urdfcal.robot.rig import SIX, Instruments, Target
from urdfcal.robot.robot import Robot
from urdfcal.robot.urdf_xml import FARTHEST

Convention = Literal["paper", "modified", "standard"]

_ORDER = ("d_a", "d_d", "d_alpha", "d_beta", "d_theta")
_BEHIND = ("d_a", "d_alpha")  # what the standard convention has behind the joint
_ORIGIN = ("x", "y", "z", "roll", "pitch", "yaw")


def read_origins(path: Path, robot: Robot) -> dict[str, SE3]:
    """Origins by joint name out of a YAML file of another's.

    Args:
        path: A kinematics file of Universal Robots' driver, of xArm, Franka or Flexiv, a tesseract calibration, or origins by joint as
            urdfcal writes them.
        robot: Whose they are to be.

    Raises:
        InputError: the file is neither, or of another model of robot.
        RobotError: it names a joint that the robot does not have, or its frames are others than the robot's.
    """
    file = read_yaml(path, InputError)
    content = file.content if isinstance(file.content, dict) else {}
    if (found := read_maker_origins(file, robot)) is not None:
        return found
    if "kinematics" in content:
        return _ur_origins(path, robot)
    if "urdfcal" in content:
        raise InputError("is a calibration of urdfcal's own already; apply, compare and fit --after take it as it is", path)
    if isinstance(content.get("joints"), dict):
        return {str(name): _origin(file, str(name), robot) for name in content["joints"]}
    raise InputError(
        "is no kinematics file of UR, xArm, Franka or Flexiv, no tesseract calibration, and has no 'joints' with x y z roll pitch yaw", path
    )


def _ur_origins(path: Path, robot: Robot) -> dict[str, SE3]:
    found, joints = read_ur_file(path, hashed=False), ur_joints(robot, ())
    if not found.origins:
        raise InputError("does not have all numbers of the six joints; expected x y z roll pitch yaw under each", path)
    if others := other_frames(joints.values()):
        raise RobotError(
            f"{', '.join(others)} turn about other axes than z, so that the frames of {path} are others; "
            "take the URDF that the driver's own xacro makes",
            robot.description.label,
        )
    found.require_model_of(robot, ())
    return {joint.name: found.origins[section] for section, joint in joints.items()}


def _origin(file: YamlFile, name: str, robot: Robot) -> SE3:
    joints = robot.tree.joints
    if name not in joints:
        raise InputError(f"joints: {no_such('joint', name, joints)}", file.path, file.line(("joints", name)))
    entry = file.content["joints"][name]
    values = [entry.get(word) for word in _ORIGIN] if isinstance(entry, dict) else []
    if not values or not all(isinstance(value, int | float) and abs(value) <= FARTHEST for value in values):
        raise InputError(f"joints: {name}: expected numbers for {', '.join(_ORIGIN)}", file.path, file.line(("joints", name)))
    return pose(np.array(values[:3], dtype=float), np.array(values[3:], dtype=float))


def origins_of(other: Robot, robot: Robot) -> dict[str, SE3]:
    """Origins by joint name where another description of the robot has them elsewhere.

    Raises:
        RobotError: the other lacks a moving joint of the robot.
    """
    theirs = other.tree.joints
    for name, joint in robot.tree.joints.items():
        if joint.moves and name not in theirs:
            raise RobotError(f"has no joint '{name}', which {robot.description.label} has", other.description.label)
    shared = (name for name in robot.tree.joints if name in theirs)
    return {name: theirs[name].origin for name in shared if not same_origin(theirs[name].origin, robot.tree.joints[name].origin)}


def dh_origins(path: Path, robot: Robot, tip: str, convention: Convention) -> dict[str, SE3]:
    """Origins by joint name out of a table of D-H errors, a row a joint.

    Args:
        path: Table with the column `joint` and some of `d_a`, `d_d` [m], `d_alpha`, `d_beta`, `d_theta` [rad]; other units by its header.
        robot: Whose errors they are.
        tip: The link to which the table leads.
        convention: Of the table.

    Raises:
        MeasurementError: naming line and column.
        RobotError: an error belongs to a joint that the way to the tip does not have.
    """
    label = f"{tip}:tip" if tip in robot.tree.joints else tip
    chain = robot.seen_by(Instruments((Target(label, tip, SIX),), "", True), ()).chain
    last, joints = chain.steps[-1].joint, robot.tree.joints
    rows = [row for row in dh_table(chain) if row.direction is None and (row.name in joints or last.rigid)]
    errors = _errors(read_table(path, "joint", "D-H errors of joints"), rows, convention)
    carriers = {row.name: row.name if row.name in joints else last.name for row in rows}
    return {
        carriers[row.name]: joints[carriers[row.name]].origin * _moved(row, errors[row.name], _axis(joints, row.name), convention)
        for row in rows
        if errors[row.name]
    }


def _axis(joints: Mapping[str, Any], name: str) -> Vector:
    return np.array(joints[name].axis) if name in joints else np.array([0.0, 0.0, 1.0])


def _moved(row: DhRow, errors: Mapping[str, float], axis: Vector, convention: Convention) -> SE3:
    """What stands behind the nominal origin: the product of exponentials in the convention's order."""
    screws = row.screws if convention == "paper" else row.screws | {"d_d": translation_screw(axis)}
    order = _ORDER if convention == "paper" else ("d_a", "d_alpha", "d_beta", "d_d", "d_theta")
    placement = pin.SE3.Identity()
    for name in order:
        placement = placement * pin.exp6(pin.Motion(screws[name] * errors.get(name, 0.0)))
    return placement


def _errors(table: Table, rows: Iterable[DhRow], convention: Convention) -> dict[str, dict[str, float]]:
    """Errors by row of the robot's own table, those of the standard convention on the row that they move."""
    names = [row.name for row in rows]
    table.require("joint", "the joints' names")
    given = [name for name in _ORDER if name in table.names]
    if not given:
        raise table.fail(None, "d_a", f"is missing, and so are the others; expected some of {', '.join(_ORDER)}")
    numbers = {name: table.numbers(name, LENGTHS if name in ("d_a", "d_d") else ANGLES) for name in given}
    errors: dict[str, dict[str, float]] = {name: {} for name in names}
    for index, joint in enumerate(table.columns["joint"]):
        if joint not in names:
            raise table.fail(index, "joint", f"{no_such('joint', joint, names)}")
        for name in given:
            value, carrier = float(numbers[name][index]), names.index(joint) + (convention == "standard" and name in _BEHIND)
            if value and carrier >= len(names):
                raise table.fail(index, name, "lies behind the last joint, where no fixed joint is to carry it; name a tip further out")
            if value:
                errors[names[carrier]][name] = errors[names[carrier]].get(name, 0.0) + value
    return errors


def corrections_to(robot: Robot, origins: Mapping[str, SE3]) -> dict[str, OriginCorrection]:
    """The corrections that lead from a robot's own origins to these."""
    joints = robot.tree.joints
    return {name: OriginCorrection(joints[name].origin, origin, joints[name].moves) for name, origin in origins.items()}


def assumed_joints(robot: Robot, origins: Mapping[str, SE3], sure: PriorScale) -> EarlierJoints:
    """What a later fit is to believe of joints whose finder does not say how sure he is: all six numbers of each, independent.

    Args:
        robot: The description.
        origins: By joint name; fixed joints are passed over.
        sure: Standard deviations of a translation and of a rotation.
    """
    joints = [name for name in origins if robot.tree.joints[name].moves]
    sigma = np.tile([sure.sigma(unit) for unit in ("m",) * 3 + ("rad",) * 3], len(joints))
    names = tuple(f"{joint}.{name}" for joint in joints for name in SIX)
    screws = np.tile(np.eye(6), len(joints))
    return EarlierJoints(names, np.full(len(names), FLAT), screws, np.diag(sigma**2), {joint: origins[joint] for joint in joints})
