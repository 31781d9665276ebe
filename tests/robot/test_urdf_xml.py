"""Descriptions that other readers of URDF read, and what Pinocchio is given of them."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from lxml import etree

from tests.support.small_robot import URDF, robot_of
from urdfcal.base.errors import RobotError
from urdfcal.output.view.shapes import robot_shapes
from urdfcal.robot.description import Description
from urdfcal.robot.pinocchio_model import pinocchio_model
from urdfcal.robot.robot import Robot
from urdfcal.robot.urdf_writer import with_origins
from urdfcal.robot.urdf_xml import read_xml

LIMIT = 'lower="-0.6" upper="0.6" effort="1" velocity="1"'
UNDECLARED = '<gazebo reference="tool"><sensor:camera name="c" x:y="1"><rate>1</rate></sensor:camera></gazebo></robot>'


@pytest.mark.parametrize("value", [None, "-1", "", "inf", "nan", "none", "1e400", "100 Nm"])
@pytest.mark.parametrize("name", ["effort", "velocity"])
def test_an_effort_or_a_velocity_that_is_none_is_no_limit(name: str, value: str | None) -> None:
    """Whatever stands there, the robot is read, the other joints keep theirs, and origins are written around the same bytes."""
    stated = "" if value is None else f'{name}="{value}"'
    text = URDF.replace(LIMIT, LIMIT.replace(f'{name}="1"', stated))
    robot = robot_of(text)
    limits = robot.model.effortLimit if name == "effort" else robot.model.velocityLimit
    np.testing.assert_array_equal(limits[[0, 2]] > 1e300, [True, False])
    assert (robot.tree.joints["turn"].lower, robot.tree.joints["turn"].upper) == (-0.6, 0.6)
    assert with_origins(robot.description, {"turn": robot.tree.joints["turn"].origin}) == text.encode()


@pytest.mark.parametrize("joint", ["lift", "slm_mount"])
def test_what_matters_to_nothing_on_a_joint_does_not_keep_a_robot_out(joint: str) -> None:
    """Limits of joints that have none, empty dynamics and half a safety controller change no placement and no limit."""
    odd = '<limit lower="x" effort="-1"/><dynamics friction="-1"/><safety_controller/><calibration rising=""/>'
    robot = robot_of(URDF)
    changed = robot_of(re.sub(rf'(<joint name="{joint}".*?)(</joint>)', rf"\1{odd}\2", URDF, count=1, flags=re.DOTALL))
    assert changed.model.njoints == robot.model.njoints
    for one, other in zip(changed.model.jointPlacements, robot.model.jointPlacements, strict=True):
        assert one == other


def test_a_robot_in_order_is_given_to_pinocchio_as_it_stands(robots: dict[str, Robot]) -> None:
    """On every robot that comes with urdfcal the model is the one that Pinocchio reads from the whole text."""
    for robot in robots.values():
        assert robot.model == pin.buildModelFromXML(robot.description.text.decode().split("?>", 1)[1])


def test_an_undeclared_prefix_is_part_of_a_name() -> None:
    """What stands under <gazebo> concerns nobody: the robot is the same one, it is drawn, and its bytes stay."""
    text = URDF.replace("</robot>", UNDECLARED)
    robot, plain = robot_of(text), robot_of(URDF)
    assert robot.model == plain.model
    assert robot.tree.joints == plain.tree.joints
    assert robot_shapes(robot).links == robot_shapes(plain).links
    assert with_origins(robot.description, {"turn": robot.tree.joints["turn"].origin}) == text.encode()
    assert robot_of(URDF.replace("</robot>", '<x:joint name="turn"/></robot>')).tree.joints == plain.tree.joints


def test_other_faults_of_xml_are_not_read_over() -> None:
    """An undeclared prefix beside an unclosed tag does not hide it."""
    with pytest.raises(etree.XMLSyntaxError):
        read_xml(b"<robot><a:b/><link></robot>")


def test_what_pinocchio_refuses_is_one_line_and_nothing_is_printed(capfd: pytest.CaptureFixture[str]) -> None:
    """The C++ reader's complaints become our message, without the place in its own source, and do not reach stderr."""
    description = robot_of(URDF).description
    with pytest.raises(RobotError) as error:
        pinocchio_model(Description(description.path, b"<robot/>", expanded=False))
    assert str(error.value) == "small.urdf: Pinocchio's URDF reader refuses it: No name given for the robot."
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    "visual",
    [
        "<geometry/>",
        "<geometry><mesh/></geometry>",
        '<geometry><cone radius="1"/></geometry>',
        '<geometry><box size="a"/></geometry>',
        '<geometry><mesh filename="bad.stl"/></geometry>',
    ],
)
def test_shapes_that_cannot_be_read_are_no_harm(visual: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """The robot is drawn by simple shapes; nothing is printed, and no warning names the reader's own source files."""
    (tmp_path / "bad.stl").write_text("no mesh")
    text = URDF.replace('<link name="tool"/>', f'<link name="tool"><visual>{visual}</visual></link>')
    shapes = robot_shapes(robot_of(text, str(tmp_path / "r.urdf")))
    assert "tool" in shapes.simple
    assert not re.search(r"project|\.cpp|at line", " ".join(shapes.warnings))
    assert capfd.readouterr() == ("", "")


NO_NUMBERS = ("nan", "-inf", "1e400", "1e7", "0x10", "one")
BESIDE = {
    "inertial": '<inertial><origin xyz="0 0 0"/><mass value="BAD"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>',
    "inertia": '<inertial><mass value="1"/><inertia ixx="BAD" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>',
    "visual": '<visual><geometry><box size="1 BAD 1"/></geometry></visual>',
    "scale": '<visual><geometry><mesh filename="a.stl" scale="BAD 1 1"/></geometry></visual>',
    "collision": '<collision><origin xyz="BAD 0 0"/><geometry><sphere radius="1"/></geometry></collision>',
}


@pytest.mark.parametrize("bad", NO_NUMBERS)
@pytest.mark.parametrize("where", BESIDE)
def test_what_hangs_on_no_number_is_left_out_and_said(where: str, bad: str) -> None:
    """A mass or a shape whose numbers are none leaves the robot as it is without it, and one line names link, line and number."""
    text = URDF.replace('<link name="upper"/>', f'<link name="upper">{BESIDE[where].replace("BAD", bad)}</link>')
    robot, bare = robot_of(text), robot_of(URDF)
    assert robot.model == bare.model
    (line,) = robot.tree.warnings
    assert re.fullmatch(
        rf"link 'upper': the <\w+> on line 5 is left out: \w+: '{re.escape(bad)}' is (not a finite number|beyond 1e\+06)", line
    )
    good = robot_of(text.replace(bad, "0.5"))
    assert good.tree.warnings == ()


def test_the_same_fault_of_many_links_is_one_line() -> None:
    """How many there are, where the first one is, and the first three links; another fault has a line of its own."""
    bad = BESIDE["collision"].replace("BAD", "Yes")
    links = "".join(
        f'<link name="l{k}">{bad}</link><joint name="j{k}" type="fixed"><parent link="tool"/><child link="l{k}"/></joint>' for k in range(5)
    )
    other = f'<link name="upper">{BESIDE["collision"].replace("BAD", "No")}</link>'
    robot = robot_of(URDF.replace('<link name="upper"/>', other).replace("</robot>", f"{links}</robot>"))
    one, many = robot.tree.warnings
    assert one.startswith("link 'upper': the <collision> on line 5 is left out: xyz: 'No'")
    assert re.fullmatch(
        r"5 <collision>, the first on line \d+, of links 'l0', 'l1', 'l2' and 2 more are left out: xyz: 'Yes' is not a finite number", many
    )


@pytest.mark.parametrize("bad", NO_NUMBERS)
@pytest.mark.parametrize(
    "part", ['xyz="0 0 0.2"', 'xyz="0.05 0.04 0.02"', 'rpy="0.1 0 0"', 'xyz="0 1 0"', 'lower="0"', '<axis xyz="0 0 1"/>\n']
)
def test_a_joint_is_made_of_numbers(part: str, bad: str) -> None:
    """A number of any joint that is none is refused in one line that names the joint; only a limit may be as far as one likes."""
    broken = URDF.replace(part, re.sub(r"[\d.]+", bad, part, count=1), 1)
    assert broken != URDF
    if "lower" in part and bad == "1e7":
        broken = broken.replace('lower="1e7"', 'lower="-1e7"')
        assert robot_of(broken).tree.joints["slide"].lower == -1e6
        return
    with pytest.raises(RobotError, match=rf"small\.urdf:\d+: joint '\w+'.*'{re.escape(bad)}' is (not a finite number|beyond 1e\+06)"):
        robot_of(broken)
