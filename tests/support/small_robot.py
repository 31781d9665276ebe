"""A robot of three joints in front of a screen, small enough to be broken a thousand times."""

from __future__ import annotations

from pathlib import Path

from urdfcal.robot.description import Description
from urdfcal.robot.robot import Robot, robot_from

URDF = """\
<?xml version="1.0"?>
<robot name="small">
  <link name="screen"/>
  <link name="base"/>
  <link name="upper"/>
  <link name="lower"/>
  <link name="tool"/>
  <link name="slm"/>
  <link name="laser_1"/>
  <link name="laser_2"/>
  <joint name="base_mount" type="fixed">
    <parent link="screen"/>
    <child link="base"/>
    <origin xyz="-1.4 0 -0.1" rpy="0 0 0"/>
  </joint>
  <joint name="turn" type="revolute">
    <parent link="base"/>
    <child link="upper"/>
    <origin xyz="0 0 0.2" rpy="0 0 0"/>
    <axis xyz="0 0 1"/>
    <limit lower="-0.6" upper="0.6" effort="1" velocity="1"/>
  </joint>
  <joint name="lift" type="continuous">
    <parent link="upper"/>
    <child link="lower"/>
    <origin xyz="0.3 0 0" rpy="0.1 0 0"/>
    <axis xyz="0 1 0"/>
  </joint>
  <joint name="slide" type="prismatic">
    <parent link="lower"/>
    <child link="tool"/>
    <origin xyz="0.2 0 0"/>
    <axis xyz="0.6 0 0.8"/>
    <limit lower="0" upper="0.3" effort="1" velocity="1"/>
  </joint>
  <joint name="slm_mount" type="fixed">
    <parent link="tool"/>
    <child link="slm"/>
    <origin xyz="0.05 0.04 0.02" rpy="0 1.5707963267948966 0"/>
  </joint>
  <joint name="laser_1_mount" type="fixed">
    <parent link="slm"/>
    <child link="laser_1"/>
    <origin rpy="-0.2 0 0"/>
  </joint>
  <joint name="laser_2_mount" type="fixed">
    <parent link="slm"/>
    <child link="laser_2"/>
    <origin rpy="0.2 0 0"/>
  </joint>
</robot>
"""

XACRO = URDF.replace(
    '<robot name="small">',
    '<robot name="small" xmlns:xacro="http://www.ros.org/wiki/xacro">\n'
    '  <xacro:arg name="height" default="0.2"/>\n'
    '  <xacro:property name="angle" value="${radians(10)}"/>\n'
    '  <xacro:macro name="frame" params="name"><link name="${name}"/></xacro:macro>\n'
    '  <xacro:frame name="spare"/>\n'
    '  <joint name="spare_mount" type="fixed"><parent link="base"/><child link="spare"/></joint>',
).replace('xyz="0 0 0.2"', 'xyz="0 0 $(arg height)"')

CSV = "turn,lift,slide,laser_1.y,laser_1.z,laser_2.y,laser_2.z\n0.1,-0.2,0.1,0.01,0.02,0.03,0.04\n0.2,0.1,0.2,0.05,0.06,0.07,0.08\n"


def robot_of(text: str | bytes, name: str = "small.urdf") -> Robot:
    """A robot from the text of a URDF, without a file."""
    return robot_from(Description(Path(name), text if isinstance(text, bytes) else text.encode(), expanded=False))


def joint(name: str, parent: str, child: str, *rest: str, kind: str = "revolute") -> str:
    """The text of one joint; a turning or sliding one gets wide limits."""
    limit = '<limit lower="-9" upper="9" effort="1" velocity="1"/>' if kind in ("revolute", "prismatic") else ""
    return f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>{"".join(rest)}{limit}</joint>\n'


def robot_text(*joints: str, links: str = "screen a b c d laser_1 laser_2") -> str:
    """A URDF of the named links and some joints; links that no joint carries but the first are left out."""
    text = "".join(joints)
    used = [name for name in links.split() if f'link="{name}"' in text]
    return '<robot name="r">\n' + "".join(f'<link name="{name}"/>\n' for name in used) + text + "</robot>\n"


LASERS = joint("m1", "c", "laser_1", kind="fixed") + joint("m2", "c", "laser_2", kind="fixed")
