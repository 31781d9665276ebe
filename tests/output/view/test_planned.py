"""A tour that was planned and not measured, to be looked at."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin

from tests.support.small_robot import URDF, robot_of
from urdfcal.model.options import ModelOptions
from urdfcal.output.drives import drive_of
from urdfcal.output.text.poses import plan_csv
from urdfcal.output.view.key_frames import key_frames
from urdfcal.output.view.legend import panel_of
from urdfcal.output.view.planned import planned_poses, ways_between
from urdfcal.output.view.viewer import view_of
from urdfcal.planning.plan import plan_poses
from urdfcal.planning.tour import Tour
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
    (tmp_path / "arms.csv").write_text("left_turn,right_turn\n0.5,-0.2\n0,0\n")
    for reference, base, far in ((None, "torso", 0.2), ("torso", "torso", 0.2), ("left_hand", "left_hand", None)):
        data = planned_poses(tmp_path / "arms.csv", robot, reference=reference)
        assert data is not None
        assert data.reference == base
        if far is not None:
            assert [own.link for own in data.readings] == ["left", "right"]
            for own, y in zip(data.readings, (0.3, -0.3), strict=True):
                assert np.allclose(own.values, [[0, y, far]] * 2)
        assert ("nobody said where the instrument stands" in str(data.warnings)) == (reference is None)
        assert view_of(robot, data, options=ModelOptions(reference_known=True, target_known=True), planned={}).html


def test_the_tour_goes_the_way_that_the_trajectory_goes(tmp_path: Path) -> None:
    """The view's key frames go by every station of the drive, in its order, from both sides or not, also where columns were moved."""
    robot = robot_of(URDF.replace("laser_", "lamp_").replace("screen", "wall"), str(tmp_path / "small.urdf"))
    plan = plan_poses(robot, candidates=20, n=4, sensors=["point:tool"])
    by = plan.q[:2] * 0.5
    tour = Tour(np.array([2, 0, 3, 1]), np.ones(3), {0: by, 2: by[:1]}, ())
    for both in (False, True):
        (tmp_path / "p.csv").write_bytes(plan_csv(plan, tour, 5, "0" * 64, both))
        if not both:
            reversed_columns(tmp_path / "p.csv")
        data = planned_poses(tmp_path / "p.csv", robot)
        assert data is not None
        ways, said = ways_between(tmp_path / "p.csv", data)
        assert said == ()
        scene = view_of(robot, data, options=ModelOptions(reference_known=True, target_known=True), planned=ways).scene
        drive, keys, at = drive_of(plan, tour, both_sides=both, speed=1, pause=0, made_of=""), key_frames(scene).q, 0
        for station in drive.q[1 if both else 0 :]:
            at += int(np.argmax(np.abs(keys[at:] - station).max(axis=1) < 2e-6))
            assert np.abs(keys[at] - station).max() < 2e-6


def reversed_columns(path: Path) -> None:
    """Turn the order of a table's columns round."""
    lines = path.read_text().splitlines()
    path.write_text("\n".join(line if line.startswith("#") else ",".join(line.split(",")[::-1]) for line in lines))


def test_legs_without_a_way_are_said_and_other_comments_are_not_ways(tmp_path: Path) -> None:
    """A leg that is blocked is named; what is no number, no position of these joints or no pose of the file changes nothing."""
    robot = robot_of(URDF.replace("laser_", "lamp_").replace("screen", "wall"), str(tmp_path / "small.urdf"))
    rows = "pose,turn,lift,slide\np01,0,0,0.1\np02,0.2,0.1,0.1\np03,0.1,0.1,0.1\n"
    head = "# ways around, by positions of turn, lift, slide in rad (m where they slide):\n"
    for comments, found in (
        ("#   p01 to p02: 0.1 0.1 0.2\n# no free way from p02 to p03\n", [0]),
        ("#   p01 to p02: 0.1 0.1\n#   p02 to p03: 1e-e 0.1 0.2\n#   p02 to p09: 0.1 0.1 0.2\n#   p01 to p03: 0.1 0.1 0.2\n", []),
        ("#   p01 to p02: 0.1 0.1 1e999\n#   p02 to p03: ;;\n", []),
    ):
        (tmp_path / "p.csv").write_text(rows + head + comments)
        ways, said = ways_between(tmp_path / "p.csv", planned_poses(tmp_path / "p.csv", robot))
        assert list(ways) == found
        assert said == (("no free way was found from p02 to p03: there the view goes straight",) if found else ())


def test_what_is_planned_is_not_called_measured(robots: dict[str, Robot], tmp_path: Path) -> None:
    """The panel of planned poses says so, has no table of errors and no predicted marks; beside a calibrated robot it has both."""
    robot = robots["arm7"]
    (tmp_path / "p.csv").write_text(f"pose,set,{','.join(robot.chain.input_names)}\np01,fit{',0' * 7}\np02,test{',0.1' * 7}\n")
    data = planned_poses(tmp_path / "p.csv", robot)
    alone, both = (panel_of(view_of(robot, data, other, planned={}).scene, 2) for other in (None, robot))
    assert alone.errors is None
    assert both.errors is not None
    assert "planned to predicted" in both.errors.title
    for panel, predicted in ((alone, False), (both, True)):
        words = [layer.words for layer in panel.layers]
        assert "spot, planned" in words
        assert not [said for said in words if "measured" in said]
        assert any("predicted" in said for said in words) == predicted
        assert panel.about == "2 planned poses, nothing measured yet"
