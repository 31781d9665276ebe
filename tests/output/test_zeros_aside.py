"""Zeros beside the geometry: with them added to the reading, the robot is the calibrated one."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Callable

import numpy as np
import pinocchio as pin
import pytest

from tests.support.small_robot import URDF, robot_of
from urdfcal.base.errors import RobotError
from urdfcal.output.formats import Deployed, deployment
from urdfcal.output.stored import corrected_robot
from urdfcal.robot.robot import Robot

LIFT = '<axis xyz="0 1 0"/>'


def placement(robot: Robot, turn: float, lift: float, slide: float) -> np.ndarray:
    """The module in the root, by Pinocchio."""
    model, data = robot.model, robot.model.createData()
    pin.framesForwardKinematics(model, data, np.array([turn, np.cos(lift), np.sin(lift), slide]))
    return np.array(data.oMf[model.getFrameId("slm")].homogeneous)


def rising(root: ET.Element) -> dict[str, float]:
    stated = {joint.get("name", ""): joint.find("calibration") for joint in root.findall("joint")}
    return {name: float(own.get("rising", "0")) for name, own in stated.items() if own is not None}


def offsets(root: ET.Element) -> dict[str, float]:
    return {own.get("name", ""): float(own.findtext("offset") or "0") for own in root.iterfind("ros2_control/transmission/joint")}


RISING = URDF.replace(LIFT, f'{LIFT}\n    <calibration falling="1" rising = "0.25" />')
SYSTEM = "".join(
    f"<transmission name='t{name}'><plugin>transmission_interface/SimpleTransmission</plugin><joint name='{name}' role='j'>{more}"
    "<mechanical_reduction>50</mechanical_reduction></joint></transmission>"
    for name, more in (("turn", ""), ("lift", "<offset> 0.25\n</offset>"), ("slide", "<offset/>"))
)
TRANSMITTED = URDF.replace("</robot>", f"<ros2_control name='s' type='system'>{SYSTEM}</ros2_control></robot>")


@pytest.mark.parametrize(
    ("what", "text", "read", "before"),
    [("rising", URDF, rising, 0.0), ("rising", RISING, rising, 0.25), ("ros2-control", TRANSMITTED, offsets, 0.25)],
)
def test_reading_and_zeros_make_the_calibrated_robot(
    what: str, text: str, read: Callable[[ET.Element], dict[str, float]], before: float
) -> None:
    """At any reading, origins of the new URDF at reading + what was added are the calibrated robot's, and other bytes stay."""
    text = text.replace("<offset/>", "")
    robot, rng = robot_of(text), np.random.default_rng(0)
    names = ("turn", "lift", "slide", "slm_mount")
    origins = {name: robot.tree.joints[name].origin * pin.exp6(pin.Motion(5e-3 * rng.normal(size=6))) for name in names}
    written = Deployed(robot, origins).content(what)
    zeros = read(ET.fromstring(written))
    assert set(zeros) == {"turn", "lift", "slide"}
    added = np.array([zeros["turn"], zeros["lift"] - before, zeros["slide"]])
    assert np.abs(added).min() > 1e-5
    calibrated, new = corrected_robot(robot, origins), robot_of(written)
    for reading in rng.uniform(0, 0.3, (3, 3)):
        assert np.abs(placement(new, *(reading + added)) - placement(calibrated, *reading)).max() < 1e-12
    assert b'falling="1"' in written or text is not RISING


def test_a_joint_without_a_simple_transmission_is_refused_before_any_work() -> None:
    """What has no place for its zero is named."""
    plan = deployment(["ros2-control"], None, "a")
    plan.require_fit_for(robot_of(TRANSMITTED), ["turn", "lift", "slm_mount"])
    with pytest.raises(RobotError, match="has 0 transmissions of joint 'turn'"):
        plan.require_fit_for(robot_of(URDF), ["turn"])


def test_a_rising_that_is_no_number_is_refused() -> None:
    """By joint's line and word."""
    robot = robot_of(URDF.replace(LIFT, f'{LIFT}<calibration rising="much"/>'))
    with pytest.raises(RobotError, match="rising: 'much' is not a finite number"):
        Deployed(robot, {"lift": robot.tree.joints["lift"].origin * pin.exp6(pin.Motion(np.full(6, 1e-3)))}).content("rising")
