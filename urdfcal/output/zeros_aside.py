"""A calibrated URDF whose joints' zeros stand aside, where a driver adds them to the reading, and not in their origins.

    rising         <calibration rising="..."> of the joint. So robot_calibration writes what it finds (mikeferguson/robot_calibration,
                   src/optimization/offsets.cpp, updateURDF: offsets are added to `rising`, frames composed with their <origin>)
    ros2-control   <offset> of the joint in a SimpleTransmission of <ros2_control> (component_parser.cpp of ros2_control reads it,
                   simple_transmission.hpp: joint position = actuator position / reduction + offset)

Nothing is lost: with nominal * delta the corrected origin and o the part of delta along the joint's own motion M,

    nominal delta M(reading) = [nominal delta M(-o)] M(reading + o).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping

import numpy as np
import pinocchio as pin

from urdfcal.base.errors import RobotError
from urdfcal.base.geometry import SE3
from urdfcal.deploy.onto.text import Document, Edit, edited, read_document
from urdfcal.output.joint_offsets import joint_offsets, joint_screw
from urdfcal.robot.robot import Robot
from urdfcal.robot.urdf_writer import with_origins

_SIMPLE = "transmission_interface/SimpleTransmission"


def zeros_aside_urdf(what: str, robot: Robot, origins: Mapping[str, SE3]) -> bytes:
    """The description with corrected origins less the joints' zeros, and these where a driver adds them; all else byte for byte.

    Args:
        what: Key of `ASIDE`.
        robot: The description that the origins belong to.
        origins: Corrected placement by joint name.

    Raises:
        RobotError: no moving joint was corrected, there is no place for a zero, or a number there is none.
    """
    joints, offsets = robot.tree.joints, joint_offsets(robot, origins)
    back = {name: pin.exp6(-joint_screw(joints[name]) * offset) for name, offset in offsets.items()}
    text = with_origins(robot.description, {name: origin * back[name] if name in back else origin for name, origin in origins.items()})
    document = read_document(robot.description.path, text)
    return edited(text, [edit for name, offset in offsets.items() for edit in ASIDE[what](document, name, offset)])


def require_places_aside(what: str, robot: Robot, calibrated: Iterable[str]) -> None:
    """Refuse a robot that has no place for the zeros, before any work is done.

    Raises:
        RobotError: names the joint.
    """
    joints, document = robot.tree.joints, read_document(robot.description.path, robot.description.text)
    for name in calibrated:
        if name in joints and joints[name].moves:
            ASIDE[what](document, name, 0.0)


def _risen(document: Document, name: str, offset: float) -> list[Edit]:
    joint = next(own for own in document.root.all("joint") if own.name == name)
    stated = joint.find("calibration")
    if stated is None:
        return document.with_new(joint, f'<calibration rising="{offset!r}"/>')
    before = float(stated.numbers(stated.attributes.get("rising", "0"), (1,), "rising")[0])
    return document.with_attributes(stated, {"rising": np.array([before + offset])})


def _transmitted(document: Document, name: str, offset: float) -> list[Edit]:
    simple = [
        joint
        for system in document.root.all("ros2_control")
        for transmission in system.all("transmission")
        if (plugin := transmission.find("plugin")) is not None and plugin.text.strip() == _SIMPLE
        for joint in transmission.all("joint")
        if joint.name == name
    ]
    if len(simple) != 1:
        raise RobotError(
            f"has {len(simple)} transmissions of joint '{name}' with the plugin {_SIMPLE} in <ros2_control>, expected one, whose <offset> "
            "takes the joint's zero",
            document.path,
        )
    stated = simple[0].find("offset")
    if stated is None:
        return document.with_child(simple[0], "offset", np.array([offset]))
    return document.with_text(stated, np.array([float(stated.numbers(stated.text, (1,), "offset")[0]) + offset]))


ASIDE: dict[str, Callable[[Document, str, float], list[Edit]]] = {"rising": _risen, "ros2-control": _transmitted}
