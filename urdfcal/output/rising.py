"""A calibrated URDF whose joints' zeros stand in <calibration rising> and not in their origins, for drivers that add it to the reading.

That is how robot_calibration writes what it finds (mikeferguson/robot_calibration, src/optimization/offsets.cpp, updateURDF: offsets are
added to `rising`, frames are composed with their <origin>), and how robots such as Fetch take it. Nothing is lost: with nominal * delta
the corrected origin and o the part of delta along the joint's own motion M,

    nominal delta M(reading) = [nominal delta M(-o)] M(reading + o).
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pinocchio as pin

from urdfcal.base.geometry import SE3
from urdfcal.deploy.onto.text import Document, Edit, Element, edited, read_document
from urdfcal.output.joint_offsets import joint_offsets, joint_screw
from urdfcal.robot.robot import Robot
from urdfcal.robot.urdf_writer import with_origins


def rising_urdf(robot: Robot, origins: Mapping[str, SE3]) -> bytes:
    """The description with corrected origins less the joints' zeros, and these added to `rising`; all else byte for byte.

    Args:
        robot: The description that the origins belong to.
        origins: Corrected placement by joint name.

    Raises:
        RobotError: no moving joint was corrected, or a `rising` is no number.
    """
    joints, offsets = robot.tree.joints, joint_offsets(robot, origins)
    back = {name: pin.exp6(-joint_screw(joints[name]) * offset) for name, offset in offsets.items()}
    text = with_origins(robot.description, {name: origin * back[name] if name in back else origin for name, origin in origins.items()})
    document = read_document(robot.description.path, text)
    edits = [edit for joint in document.root.all("joint") if joint.name in offsets for edit in _risen(document, joint, offsets[joint.name])]
    return edited(text, edits)


def _risen(document: Document, joint: Element, offset: float) -> list[Edit]:
    stated = joint.find("calibration")
    if stated is None:
        return document.with_new(joint, f'<calibration rising="{offset!r}"/>')
    before = float(stated.numbers(stated.attributes.get("rising", "0"), (1,), "rising")[0])
    return document.with_attributes(stated, {"rising": np.array([before + offset])})
