"""Links and joints of a URDF, checked with their lines before Pinocchio sees them."""

from __future__ import annotations

import math
import re

import pytest

from tests.support.small_robot import LASERS, URDF, joint, robot_of, robot_text
from urdfcal.base.errors import RobotError
from urdfcal.robot.urdf_tree import Mimic

GOOD = robot_text(joint("j1", "screen", "c", '<axis xyz="0 0 1"/>'), LASERS)
MOUNT = '<joint name="m1" type="fixed">'


def replaced(old: str, new: str, text: str = GOOD) -> str:
    assert text.count(old) >= 1, f"{old} is not in the text"
    return text.replace(old, new, 1)


def test_every_number_of_a_joint_is_read() -> None:
    """Origin, axis, limits and line of each joint come back as the URDF has them; axes get unit length."""
    tree = robot_of(URDF).tree
    slide = tree.joints["slide"]
    assert (slide.parent, slide.child, slide.xyz, slide.rpy, slide.lower, slide.upper) == ("lower", "tool", (0.2, 0, 0), (0, 0, 0), 0, 0.3)
    assert slide.axis == pytest.approx((0.6, 0, 0.8), rel=1e-15)
    assert slide.line == 1 + URDF[: URDF.index('<joint name="slide"')].count("\n")
    assert (tree.joints["lift"].lower, tree.joints["lift"].upper) == (-math.inf, math.inf)
    assert [name for name, joint in tree.joints.items() if joint.moves] == ["turn", "lift", "slide"]
    assert (tree.root, tree.moving_link("laser_2"), tree.moving_link("base")) == ("screen", "tool", "screen")
    assert [joint.name for joint in tree.path_from_root("tool")] == ["base_mount", "turn", "lift", "slide"]


def test_what_a_urdf_may_leave_out_has_the_format_s_defaults() -> None:
    """No origin is the identity, no axis is x, a mimic's multiplier is 1 and its offset 0."""
    tree = robot_of(
        robot_text(
            joint("j1", "screen", "a"), joint("j2", "a", "b", '<mimic joint="j1"/>'), joint("j3", "b", "c", '<origin rpy="0 0 1"/><axis/>')
        )
    ).tree
    assert (tree.joints["j1"].xyz, tree.joints["j1"].rpy, tree.joints["j1"].axis) == ((0, 0, 0), (0, 0, 0), (1, 0, 0))
    assert tree.joints["j2"].mimic == Mimic("j1", 1.0, 0.0)
    assert (tree.joints["j3"].xyz, tree.joints["j3"].rpy, tree.joints["j3"].axis) == ((0, 0, 0), (0, 0, 1), (1, 0, 0))


def test_joints_outside_the_tree_are_not_taken_for_joints() -> None:
    """A <joint> in <transmission>, <ros2_control> or <gazebo> declares nothing."""
    others = '<transmission name="t"><joint name="j1"><origin xyz="9 9 9"/></joint></transmission>'
    others += '<ros2_control><joint name="j9"/></ros2_control><gazebo><joint/></gazebo>'
    tree = robot_of(replaced("</robot>", others + "</robot>")).tree
    assert sorted(tree.joints) == ["j1", "m1", "m2"]
    assert tree.joints["j1"].xyz == (0, 0, 0)


def test_numbers_may_be_written_as_xml_allows() -> None:
    """Blanks, line ends, character references and exponents in a number change nothing."""
    text = replaced('<axis xyz="0 0 1"/>', "<axis xyz='0 0 1'/><origin\n  xyz = '\t&#49;.5e-1\n+.5  -2.'\n  rpy='0 0 0'/>")
    assert robot_of(text).tree.joints["j1"].xyz == (0.15, 0.5, -2.0)


BAD = {
    "no link": ('<robot name="r"/>', "there is no <link> under <robot>"),
    "other document": ("<sdf><model/></sdf>", ":1: the document is a <sdf>, expected a URDF with <robot>"),
    "default namespace": (
        replaced("<robot", '<robot xmlns="http://x.org"'),
        ":1: <robot> is in the default namespace 'http://x.org', expected none; remove xmlns",
    ),
    "namespace below": (replaced("<axis", '<axis xmlns="u"'), ": <axis> is in the default namespace 'u'"),
    "link twice": (replaced('<link name="c"/>', '<link name="c"/>\n<link name="c"/>'), ":4: link 'c' is declared twice, first on line 3$"),
    "screen twice": (
        replaced('<link name="c"/>', '<link name="c"/>\n<link name="screen"/>'),
        ":4: link 'screen' is declared twice, first on line 2; the macros of robots/slm.urdf.xacro take other names",
    ),
    "joint twice": (GOOD.replace("</robot>", joint("j1", "c", "d") + "</robot>"), ":9: joint 'j1' is declared twice, first on line 6"),
    "link without name": (replaced('<link name="c"/>', "<link/>"), ":3: <link> has no name"),
    "joint without name": (replaced(MOUNT, '<joint type="fixed">'), ":7: <joint> has no name"),
    "joint without type": (replaced(MOUNT, '<joint name="m1">'), ":7: joint 'm1' has no type"),
    "unknown type": (replaced('type="revolute"', 'type="revolut"'), ":6: joint 'j1': type 'revolut' is not one of revolute, continuous"),
    "no parent": (replaced('<parent link="screen"/>', ""), ":6: joint 'j1' has no <parent link=...>"),
    "no child": (replaced('<child link="laser_1"/>', ""), ":7: joint 'm1' has no <child link=...>"),
    "parent without link": (replaced('<parent link="screen"/>', "<parent/>"), ":6: joint 'j1': <parent> has no link"),
    "unknown link": (
        replaced('<child link="laser_1"/>', '<child link="laser1"/>'),
        ":7: joint 'm1': no link named 'laser1' among 4 links; did you mean 'laser_",
    ),
    "two numbers": (replaced('xyz="0 0 1"', 'xyz="0 1"'), """:6: joint 'j1': xyz="0 1" has 2 numbers, expected 3"""),
    "comma": (replaced('xyz="0 0 1"', 'xyz="0,0,1"'), """xyz="0,0,1" has 1 numbers, expected 3"""),
    "no number": (replaced('xyz="0 0 1"', 'xyz="0 0 one"'), """:6: joint 'j1': xyz="0 0 one": 'one' is not a finite number"""),
    "nan": (replaced('xyz="0 0 1"', 'xyz="0 0 nan"'), "'nan' is not a finite number"),
    "overflow": (replaced('xyz="0 0 1"', 'xyz="0 0 1e999"'), "'1e999' is not a finite number"),
    "arabic digits": (replaced('xyz="0 0 1"', 'xyz="0 0 \u0661"'), "is not a finite number"),
    "no axis": (replaced('xyz="0 0 1"', 'xyz="0 0 0"'), ":6: joint 'j1': the axis has no length, expected a direction such as 0 0 1"),
    "two axes": (replaced("<axis", '<axis xyz="1 0 0"/><axis'), ":6: joint 'j1' has 2 <axis>, expected one"),
    "two origins": (replaced("<axis", "<origin/><origin/><axis"), ":6: joint 'j1' has 2 <origin>, expected one"),
    "no limit": (
        re.sub("<limit.*?/>", "", GOOD),
        ":6: joint 'j1' is revolute and has no <limit>; add lower, upper, effort and velocity, or make it continuous",
    ),
    "no limit of a slide": (
        re.sub("<limit.*?/>", "", GOOD).replace("revolute", "prismatic"),
        ":6: joint 'j1' is prismatic and has no <limit>; add lower, upper, effort and velocity$",
    ),
    "no name": (replaced('<robot name="r">', "<robot>"), ':1: <robot> has no name; expected <robot name="...">'),
    "limit no number": (replaced('lower="-9"', 'lower="-90deg"'), ":6: joint 'j1': <limit> lower: '-90deg' is not a finite number"),
    "limits crossed": (replaced('lower="-9"', 'lower="10"'), ":6: joint 'j1': its lower limit 10 is above its upper limit 9"),
    "two parents": (
        replaced("</robot>", joint("j2", "screen", "c") + "</robot>"),
        ":9: link 'c' is the child of two joints, 'j1' and 'j2'",
    ),
    "two roots": (
        replaced('<link name="c"/>', '<link name="c"/><link name="lost"/>'),
        "2 links have no parent joint (screen, lost), expected one root",
    ),
    "loop": (GOOD.replace('link="screen"', 'link="c"'), "joint 'j1' closes a loop; expected a tree"),
    "loop of all": (robot_text(joint("j1", "a", "b"), joint("j2", "b", "a")), "closes a loop; expected a tree"),
    "mimic unknown": (replaced("<axis", '<mimic joint="j2"/><axis'), ":6: joint 'j1' mimics: no joint named 'j2'"),
    "mimic itself": (replaced("<axis", '<mimic joint="j1"/><axis'), ":6: joint 'j1' mimics itself"),
    "mimic fixed": (replaced("<axis", '<mimic joint="m1"/><axis'), ":6: joint 'j1' mimics 'm1', which is fixed and has no position"),
    "mimic nothing": (replaced("<axis", "<mimic/><axis"), ":6: joint 'j1': <mimic> has no joint"),
    "mimic number": (
        replaced("<axis", '<mimic joint="j1" multiplier="x"/><axis'),
        ":6: joint 'j1': <mimic> multiplier: 'x' is not a finite number",
    ),
    "mimic loop": (
        robot_text(
            joint("j1", "screen", "a", '<mimic joint="j2"/>'),
            joint("j2", "a", "b", '<mimic joint="j3"/>'),
            joint("j3", "b", "c", '<mimic joint="j1"/>'),
        ),
        "joint 'j1' mimics itself",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_what_is_no_robot_is_refused(case: str) -> None:
    """A URDF that cannot be a robot is refused with file, line, joint or link, and what was expected."""
    text, message = BAD[case]
    with pytest.raises(RobotError) as error:
        robot_of(text, "r.urdf")
    assert str(error.value).startswith("r.urdf:")
    assert message in f"{error.value}$"


def test_the_nearest_link_is_named() -> None:
    """A link that is not there is refused with the nearest that is."""
    tree = robot_of(URDF).tree
    assert tree.require_link("tool") == "tool"
    with pytest.raises(RobotError, match="no link named 'tool0' among 8 links; did you mean 'tool'"):
        tree.require_link("tool0")
