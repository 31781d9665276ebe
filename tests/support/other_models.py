"""MJCF and SDF of the small robot, written by hand in awkward ways, and MuJoCo's own conversion of any URDF."""

from __future__ import annotations

import re
from pathlib import Path

MJCF = """\
<?xml version='1.0'?>
<!-- a cell: <body pos="9 9 9"/> -->
<mujoco model="small">
  <compiler angle="degree" eulerseq="zyx" />
  <default><geom size="0.01"/><default class="arm"><joint axis="0 1 0" damping="1"/></default></default>
  <worldbody>
    <geom type="plane" size="1 1 1"/>
    <frame pos="0 0 0.5" euler="90 0 0">
      <body name="base" pos="1 2 3">
        <body name='upper' pos="0 0  0.2" euler='30 0 0' >
          <geom mass="1"/><joint axis="0 0 2" ref="30" name="turn"/>
          <body name="lower" axisangle="1 0 0 5.729577951308232" pos="0.3 0 0" childclass="arm">
            <joint name="lift"/><inertial mass="1" pos="0 0 0.1" diaginertia="1 1 1"/>
            <body name="carriage" pos="0.2 0 0"><!-- kept --><geom/>
              <joint class="main" name="slide" type="slide" axis="0.6 0 0.8"/>
              <site name="slm" xyaxes="0 0 -1 0 1 0" pos=".05 .04 .02"/>
            </body>
          </body>
        </body>
      </body>
    </frame>
  </worldbody>
</mujoco>
"""
SDF = """\
<?xml version="1.0"?>
<sdf version="1.9"><world name="w">
<model name="small">
  <pose>5 6 7 0 0 1</pose>
  <link name="base"><pose degrees="true">1 2 3 0 0 90</pose></link>
  <link name="upper"><pose relative_to='turn'/><visual name="v"><pose>0 0 1 0 0 0</pose><geometry/></visual></link>
  <joint name="turn" type="revolute"><pose relative_to="base">  0 0 0.2 0 0 0
     </pose><parent>base</parent><child>upper</child><axis><xyz>0 0 1</xyz></axis></joint>
  <link name="lower"><pose relative_to="upper" rotation_format="quat_xyzw">0.3 0 0  0.04997916927067833 0 0 0.9987502603949663</pose></link>
  <joint name="lift" type="continuous"><parent>upper</parent><child>lower</child><axis><xyz expressed_in="lower">0 1 0</xyz></axis></joint>
  <link name="carriage"><pose relative_to="lower">0.2 0 0 0 0 0</pose>
    <collision name="c"><pose relative_to="upper">0 0 1 0 0 0</pose></collision></link>
  <joint name="slide" type="prismatic"><parent>lower</parent><child>carriage</child>
    <axis><xyz expressed_in="lower">0.6 0 0.8</xyz></axis></joint>
  <frame name="slm" attached_to="carriage"><pose>0.05 0.04 0.02 0 1.5707963267948966 0</pose></frame>
</model></world></sdf>
"""


def converted(urdf: Path, place: Path) -> Path:
    """What MuJoCo itself makes of a URDF, without its shapes; to six digits."""
    import mujoco

    text = re.sub(r"<(visual|collision)\b.*?</\1>", "", urdf.read_text("utf-8"), flags=re.DOTALL)
    light = '<mujoco><compiler balanceinertia="true" boundmass="0.1" boundinertia="0.1"/></mujoco>'
    model = mujoco.MjModel.from_xml_string(re.sub(r"<robot\b[^>]*>", lambda tag: tag[0] + light, text, count=1))
    mujoco.mj_saveLastXML(str(place), model)
    return place
