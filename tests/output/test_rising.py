"""Zeros in <calibration rising>: with it added to the reading, the robot is the calibrated one."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import numpy as np
import pinocchio as pin
import pytest

from tests.support.small_robot import URDF, robot_of
from urdfcal.base.errors import RobotError
from urdfcal.output.formats import Deployed
from urdfcal.output.stored import corrected_robot
from urdfcal.robot.robot import Robot

LIFT = '<axis xyz="0 1 0"/>'


def placement(robot: Robot, turn: float, lift: float, slide: float) -> np.ndarray:
    """The module in the root, by Pinocchio."""
    model, data = robot.model, robot.model.createData()
    pin.framesForwardKinematics(model, data, np.array([turn, np.cos(lift), np.sin(lift), slide]))
    return np.array(data.oMf[model.getFrameId("slm")].homogeneous)


@pytest.mark.parametrize("before", ["", '\n    <calibration falling="1" rising = "0.25" />'])
def test_reading_and_rising_make_the_calibrated_robot(before: str) -> None:
    """At any reading, origins of the new URDF at reading + what was added to rising are the calibrated robot's, and the rest stays."""
    text = URDF.replace(LIFT, LIFT + before)
    robot, rng = robot_of(text), np.random.default_rng(0)
    names = ("turn", "lift", "slide", "slm_mount")
    origins = {name: robot.tree.joints[name].origin * pin.exp6(pin.Motion(5e-3 * rng.normal(size=6))) for name in names}
    written = Deployed(robot, origins).content("rising")
    root = ET.fromstring(written)
    rising = {}
    for joint in root.findall("joint"):
        calibration = joint.find("calibration")
        rising[joint.get("name")] = 0.0 if calibration is None else float(calibration.get("rising", "0"))
    added = np.array([rising["turn"], rising["lift"] - (0.25 if before else 0.0), rising["slide"]])
    assert np.abs(added).min() > 1e-5
    calibrated, new = corrected_robot(robot, origins), robot_of(written)
    for reading in rng.uniform(0, 0.3, (3, 3)):
        assert np.abs(placement(new, *(reading + added)) - placement(calibrated, *reading)).max() < 1e-12
    assert b'falling="1"' in written or not before
    assert rising["slm_mount"] == 0


def test_a_rising_that_is_no_number_is_refused() -> None:
    """By joint's line and word."""
    robot = robot_of(URDF.replace(LIFT, f'{LIFT}<calibration rising="much"/>'))
    with pytest.raises(RobotError, match="rising: 'much' is not a finite number"):
        Deployed(robot, {"lift": robot.tree.joints["lift"].origin * pin.exp6(pin.Motion(np.full(6, 1e-3)))}).content("rising")
