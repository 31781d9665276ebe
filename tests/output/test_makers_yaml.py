"""Makers' kinematics files: what is written is what their descriptions read, and comes back as it was."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
import yaml

from tests.support.small_robot import robot_of
from urdfcal.base.errors import InputError, RobotError
from urdfcal.output.formats import Deployed, deployment
from urdfcal.output.imported import read_origins
from urdfcal.output.makers_yaml import MAKERS
from urdfcal.robot.robot import Robot

CASES = {"xarm": ("joint", 6, ""), "franka": ("fr3_joint", 7, "fr3_joint8"), "flexiv": ("left_joint", 7, "left_link7_to_flange")}


def arm(name: str, count: int, flange: str) -> Robot:
    """An arm with so many joints in a row and, if it has a name, a fixed one behind them."""
    links = "".join(f'<link name="l{at}"/>' for at in range(count + 2))
    limit = '<limit lower="-3" upper="3" effort="1" velocity="1"/>'
    joints = "".join(
        f'<joint name="{name}{at}" type="revolute"><parent link="l{at - 1}"/><child link="l{at}"/>'
        f'<origin xyz="0.1 0 {0.1 * at:.1f}" rpy="{0.4 * at:.1f} 0.2 0"/><axis xyz="0 0 1"/>{limit}</joint>'
        for at in range(1, count + 1)
    )
    behind = f'<parent link="l{count}"/><child link="l{count + 1}"/><origin xyz="0 0 0.1"/>'
    end = f'<joint name="{flange or "end"}" type="fixed">{behind}</joint>'
    return robot_of(f'<robot name="a">{links}{joints}{end}</robot>')


def moved(robot: Robot, names: list[str]) -> dict[str, Any]:
    rng = np.random.default_rng(0)
    return {name: robot.tree.joints[name].origin * pin.exp6(pin.Motion(1e-3 * rng.normal(size=6))) for name in names}


@pytest.mark.parametrize("what", [*CASES, "tesseract"])
def test_what_is_written_comes_back(what: str, tmp_path: Path) -> None:
    """Written, and read by `import`, the origins are the same to 1e-12."""
    name, count, flange = CASES.get(what, CASES["franka"])
    robot = arm(name, count, flange)
    origins = moved(robot, [f"{name}{at}" for at in range(1, count + 1)] + ([flange] if flange else []))
    place = tmp_path / "k.yaml"
    place.write_bytes(Deployed(robot, origins).content(what))
    again = read_origins(place, robot)
    assert set(again) == set(origins)
    assert max(np.abs((again[each].inverse() * origin).homogeneous - np.eye(4)).max() for each, origin in origins.items()) < 1e-12


@pytest.mark.parametrize("what", CASES)
def test_a_description_reads_the_numbers_of_each_origin(what: str) -> None:
    """At its place in the maker's layout, each joint has xyz, and rpy about fixed axes, of its corrected origin."""
    name, count, flange = CASES[what]
    robot = arm(name, count, flange)
    origins = moved(robot, [f"{name}2"])
    content = yaml.safe_load(Deployed(robot, origins).content(what))
    second = {"xarm": ("kinematics", "joint2"), "flexiv": ("kinematics", "joint2"), "franka": ("joint2", "kinematic")}[what]
    entry = content[second[0]][second[1]]
    cr, sr, cp, sp, cy, sy = (own(entry[angle]) for angle in ("roll", "pitch", "yaw") for own in (math.cos, math.sin))
    x, y, z = (
        np.array([[1, 0, 0], [0, cr, -sr], [0, sr, cr]]),
        np.array([[cp, 0, sp], [0, 1, 0], [-sp, 0, cp]]),
        np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]]),
    )
    assert z @ y @ x == pytest.approx(origins[f"{name}2"].rotation, abs=1e-12)
    assert [entry[axis] for axis in "xyz"] == pytest.approx(origins[f"{name}2"].translation, abs=1e-15)
    assert len(content.get("kinematics", content)) == count + bool(flange)


def test_tesseract_reads_roll_pitch_yaw_too(tmp_path: Path) -> None:
    """An orientation under r, p, y is turned about fixed axes."""
    robot, place = arm("joint", 6, ""), tmp_path / "c.yaml"
    place.write_text("calibration: {joints: {joint1: {position: {x: 1, y: 2, z: 3}, orientation: {r: 0.1, p: 0.2, y: 0.3}}}}")
    assert pin.rpy.matrixToRpy(read_origins(place, robot)["joint1"].rotation) == pytest.approx([0.1, 0.2, 0.3])


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("kinematics: {joint1: {x: 0, y: 0, z: 0.1, roll: 0.4, pitch: 0.2}}", "joint1: expected numbers for x, y, z, roll, pitch, yaw"),
        ("kinematics: {joint1: {x: 0, y: 0, z: 1, roll: 0.4, pitch: 0.2, yaw: 0}}", "joint2: expected numbers"),
        ("calibration: {joints: {joint9: {}}}", "no joint named 'joint9'"),
        ("calibration: {joints: {joint1: {position: {x: 1, y: 2, z: 3}, orientation: {x: 0, y: 0, z: 0, w: 0}}}}", "orientation x y z w"),
        ("calibration: {joints: {joint1: [1]}}", "joint1: expected position x y z"),
    ],
)
def test_files_without_the_numbers_are_refused(text: str, said: str, tmp_path: Path) -> None:
    """What is missing is named."""
    place = tmp_path / "k.yaml"
    place.write_text(text)
    with pytest.raises(InputError, match=said):
        read_origins(place, arm("joint", 6, ""))


def test_the_file_of_another_model_is_refused(tmp_path: Path) -> None:
    """Numbers farther off than a factory's calibration are another robot's."""
    robot, place = arm("joint", 6, ""), tmp_path / "k.yaml"
    content = yaml.safe_load(Deployed(robot, {}).content("xarm"))
    content["kinematics"]["joint3"]["z"] += 0.02
    place.write_text(yaml.safe_dump(content))
    with pytest.raises(InputError, match="its joint3 is 20 mm and 0 mrad from"):
        read_origins(place, robot)


@pytest.mark.parametrize("what", MAKERS)
def test_robots_of_other_names_are_refused_before_any_work(what: str) -> None:
    """A format that is not for a robot says which joints it needs; of two arms the calibrated one is meant."""
    plan = deployment([what], None, "a")
    with pytest.raises(RobotError, match="needs joints named joint1"):
        plan.require_fit_for(arm("axis", 7, ""), ["axis1"])
    with pytest.raises(RobotError, match=f"the {what} format needs"):
        plan.require_fit_for(arm("joint", 4, ""), ["joint1"])


def test_what_a_makers_file_has_no_place_for_is_said() -> None:
    """A calibrated fixed joint that the layout does not have is named."""
    robot = arm("joint", 6, "")
    deployed = Deployed(robot, moved(robot, ["joint1", "end"]))
    assert deployed.warnings(deployment(["xarm"], None, "a")) == ("the xarm file has no place for end; the rest is in it",)
