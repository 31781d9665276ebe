"""A tour that was planned and not measured, to be looked at."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin

from tests.support.small_robot import URDF, robot_of
from urdfcal.output.view.planned import planned_poses
from urdfcal.output.view.viewer import view_of
from urdfcal.robot.configurations import whole_configurations
from urdfcal.robot.robot import Robot
from urdfcal.sensors.measurements import as_measured
from urdfcal.sensors.spots import beams_at


def test_lasers_show_where_their_beams_would_fall(robots: dict[str, Robot], tmp_path: Path) -> None:
    """Spots of poses that have none are those of the nominal robot; a file with spots is left to others."""
    robot = robots["arm7"]
    (tmp_path / "p.csv").write_text(f"pose,set,{','.join(robot.chain.input_names)}\np01,fit{',0' * 7}\np02,test{',0.1' * 7}\n")
    data = planned_poses(tmp_path / "p.csv", robot)
    assert data is not None
    errors = view_of(robot, data).scene.placed[0].errors
    assert np.allclose(data.spots, beams_at(errors, errors.mean, data.q).spots)
    assert data.poses.tolist() == ["p01", "p02"]
    assert "nothing was read" in data.warnings[-1]
    (tmp_path / "m.csv").write_text(f"{','.join(robot.chain.input_names)},laser_1.y,laser_1.z\n{'0,' * 7}0,0\n")
    assert planned_poses(tmp_path / "m.csv", robot) is None


def test_without_lasers_the_link_that_is_moved_is_shown(tmp_path: Path) -> None:
    """Of a bare robot the way of the first link that all joints of the file move, where Pinocchio has it, in degrees or not."""
    robot = robot_of(URDF.replace("laser_", "lamp_").replace("screen", "wall"), str(tmp_path / "small.urdf"))
    (tmp_path / "p.csv").write_text("pose,turn [deg],lift\na,30,0.2\nb,-10,0.1\n")
    data = planned_poses(tmp_path / "p.csv", robot)
    assert data is not None
    (read,) = data.readings
    seen = as_measured(robot, data)
    model = seen.model.createData()
    for q, point in zip(whole_configurations(seen, np.array([[np.radians(30), 0.2], [np.radians(-10), 0.1]])), read.values, strict=True):
        pin.framesForwardKinematics(seen.model, model, q)
        assert np.allclose(model.oMf[seen.model.getFrameId(read.link)].translation, point)


def test_every_branch_of_a_tree_shows_its_own_link(tmp_path: Path) -> None:
    """Joints of two arms on one torso, and the side that each came from, show both hands."""
    arms = "".join(
        f'<link name="{side}"/><link name="{side}_hand"/>'
        f'<joint name="{side}_turn" type="revolute"><parent link="torso"/><child link="{side}"/><origin xyz="0 {y} 0.2"/>'
        f'<axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>'
        f'<joint name="{side}_mount" type="fixed"><parent link="{side}"/><child link="{side}_hand"/><origin xyz="0.5 0 0"/></joint>'
        for side, y in (("left", 0.3), ("right", -0.3))
    )
    torso = '<joint name="lift" type="prismatic"><parent link="base"/><child link="torso"/><axis xyz="0 0 1"/>'
    torso += '<limit lower="0" upper="1" effort="1" velocity="1"/></joint>'
    robot = robot_of(f'<robot name="two"><link name="base"/><link name="torso"/>{torso}{arms}</robot>', str(tmp_path / "two.urdf"))
    (tmp_path / "p.csv").write_text("pose,lift,left_turn,right_turn,lift.approach\na,0.1,0.5,-0.2,1\nb,0.2,0,0,-1\n")
    data = planned_poses(tmp_path / "p.csv", robot)
    assert data is not None
    assert [own.link for own in data.readings] == ["left", "right"]
    for own, y in zip(data.readings, (0.3, -0.3), strict=True):
        assert np.allclose(own.values, [[0, y, 0.3], [0, y, 0.4]])
    assert view_of(robot, data).html
    (tmp_path / "one.csv").write_text("lift,left_turn\n0.1,0.5\n")
    (one,) = planned_poses(tmp_path / "one.csv", robot).readings
    assert one.link == "left"
