"""The scene and its page, without a browser."""

from __future__ import annotations

import base64
import gzip
import json
import re
import signal
import socket
import subprocess
import sys
import urllib.error
import urllib.request
import uuid
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import numpy as np
import pinocchio as pin
import pytest

import urdfcal
from tests.support.helpers import ROBOTS, assert_poses_close, without_meshes
from tests.support.paths import ROBOTS_DIR, ROOT
from tests.support.small_robot import URDF, robot_of
from urdfcal.base.errors import ShapeMismatch, UsageError
from urdfcal.base.geometry import Matrix, Vector
from urdfcal.calibration.analysis.compensation import Compensation
from urdfcal.calibration.reach import ScreenArea, draw_poses
from urdfcal.model.error_model import ErrorModel
from urdfcal.output.stored import corrected_robot
from urdfcal.output.view.key_frames import MOST_POSES, key_frames
from urdfcal.output.view.motion import mirror, turns_from_z
from urdfcal.output.view.placed import placed_robot, screen_placements
from urdfcal.output.view.recorder import umsgpack
from urdfcal.output.view.scene import Scene
from urdfcal.output.view.shapes import robot_shapes
from urdfcal.output.view.viewer import View, view_of
from urdfcal.robot.configurations import joint_limits, whole_configurations
from urdfcal.robot.robot import Robot, robot_from
from urdfcal.robot.urdf_writer import with_origins
from urdfcal.sensors.measurements import Measurements, spots_measured
from urdfcal.simulation.readings import simulate
from urdfcal.simulation.truth import random_truth

Run = Callable[..., "object"]
ARM7 = ROBOTS_DIR / "arm7"


def measured(robot: Robot, count: int = 6, seed: int = 3) -> tuple[Measurements, Robot]:
    """Simulated measurements without noise, and the robot that made them."""
    rng = np.random.default_rng(seed)
    errors, truth = random_truth(robot, rng, 5e-3, np.radians(0.5))
    data = simulate(robot, errors, truth, draw_poses(robot, errors, truth, count, rng, area=ScreenArea(1.5)), rng)
    text = with_origins(robot.description, errors.corrected_origins(truth))
    return data, robot_from(replace(robot.description, text=text))


def commands_of(page: str) -> list[dict[str, Any]]:
    """meshcat's commands in a page, but the animation's."""
    scene = re.search(r'id="urdfcal-scene">([^<]*)<', page)
    assert scene
    content, at, found = gzip.decompress(base64.b64decode(scene[1])), 0, []
    while at < len(content):
        length = int.from_bytes(content[at : at + 4], "little")
        command = content[at + 4 : at + 4 + length]
        found += [] if command.startswith(b"{") else [umsgpack.unpackb(command)]
        at += 4 + length
    return found


@pytest.fixture(scope="module")
def small_view() -> View:
    """The robot of three joints with measurements, before and after."""
    robot = robot_of(URDF)
    data, corrected = measured(robot)
    return view_of(robot, data, corrected)


@pytest.mark.parametrize("name", ROBOTS)
def test_beams_are_those_of_the_whole_robot(robots: dict[str, Robot], name: str, rng: np.random.Generator) -> None:
    """The laser frames of Pinocchio's model of the whole robot, seen from its screen frame, are the beams of the scene."""
    robot = robots[name]
    lower, upper = joint_limits(robot)
    q = rng.uniform(lower, upper, (5, len(lower)))
    data = spots_measured(robot, q, np.full((5, len(robot.rig.lasers), 2), np.nan))
    beams, whole = placed_robot(robot, data).beams(q), whole_configurations(robot, q)
    frames = robot.model.createData()
    for pose, (placed, configuration) in enumerate(zip(screen_placements(robot, whole), whole, strict=True)):
        pin.framesForwardKinematics(robot.model, frames, configuration)
        for laser, link in enumerate(robot.rig.lasers):
            T_screen_laser = placed.actInv(frames.oMf[robot.model.getFrameId(link, pin.FrameType.BODY)])
            np.testing.assert_allclose(beams.source[pose, laser], T_screen_laser.translation, atol=1e-12)
            np.testing.assert_allclose(beams.direction[pose, laser], T_screen_laser.rotation[:, 2], atol=1e-12)


@pytest.mark.parametrize("name", ["arm7", "panda"])
def test_the_true_robot_is_drawn_with_its_rings_around_the_discs(robots: dict[str, Robot], name: str) -> None:
    """With the robot that made the measurements the predicted spots are the measured ones, and the nominal ones are not."""
    data, corrected = measured(robots[name])
    scene = Scene(robots[name], corrected, data)
    for row in scene.compared:
        assert np.nanmax(row.phases[1]) < 1e-6
        assert np.nanmin(row.phases[0]) > 1.0
    assert scene.sheet.holds(data.spots).all()


@pytest.mark.parametrize("name", ["panda", "ur5"])
def test_shapes_stand_where_the_calibrated_urdf_has_them(robots: dict[str, Robot], name: str) -> None:
    """The nominal robot's shapes put on the corrected robot are the ones read from the corrected URDF."""
    _, corrected = measured(robots[name])
    ours, fresh = robot_shapes(robots[name]).on(corrected), robot_shapes(corrected).model
    assert [shape.name for shape in ours.geometryObjects] == [shape.name for shape in fresh.geometryObjects]
    for mine, theirs in zip(ours.geometryObjects, fresh.geometryObjects, strict=True):
        assert mine.parentJoint == theirs.parentJoint
        assert_poses_close(mine.placement, theirs.placement)


def test_a_robot_without_shapes_gets_simple_ones() -> None:
    """Each moving joint has a cylinder about its axis, each long link a capsule to its next joint, and the module a box."""
    robot = robot_of(URDF)
    shapes = robot_shapes(robot)
    names = {shape.name for shape in shapes.model.geometryObjects}
    assert {"upper_joint", "lower_joint", "tool_joint", "base_to_upper", "upper_to_lower", "slm_box", "laser_1_barrel"} <= names
    index = shapes.model.getGeometryId("tool_joint")
    shape = shapes.model.geometryObjects[index]
    np.testing.assert_allclose(shapes.T_link_shape[index].rotation[:, 2], [0.6, 0, 0.8], atol=1e-12)
    capsule = shapes.model.geometryObjects[shapes.model.getGeometryId("upper_to_lower")].geometry
    assert 2 * capsule.halfLength == pytest.approx(0.3)
    assert robot.model.names[shape.parentJoint] == "slide"
    assert shapes.warnings == ()


def test_a_mesh_that_is_missing_is_replaced_and_said() -> None:
    """The link of the missing mesh is drawn by simple shapes; the warning names the mesh and the way out."""
    box = '<visual><geometry><box size="0.1 0.1 0.1"/></geometry></visual>'
    mesh = '<visual><geometry><mesh filename="package://nowhere/upper.stl"/></geometry></visual>'
    text = URDF.replace('<link name="upper"/>', f'<link name="upper">{mesh}</link>').replace(
        '<link name="base"/>', f'<link name="base">{box}</link>'
    )
    shapes = robot_shapes(robot_of(text))
    assert shapes.simple == ("upper",)
    assert {shape.name for shape in shapes.model.geometryObjects} >= {"base_0", "upper_joint", "upper_to_lower"}
    assert "package 'nowhere' was not found" in shapes.warnings[0]
    assert "--package-dir" in shapes.warnings[0]


def test_a_mesh_beside_the_description_is_found_and_a_broken_one_survived(tmp_path: Path) -> None:
    """A relative file name counts from the URDF's folder; a file that is no mesh turns into simple shapes and a warning."""
    mesh = '<visual><geometry><mesh filename="upper.stl" scale="1 -1 1"/></geometry></visual>'
    text = URDF.replace('<link name="upper"/>', f'<link name="upper">{mesh}</link>')
    solid = "solid s\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\nendsolid s\n"
    for content, found in ((solid, True), ("no mesh", False)):
        (tmp_path / "upper.stl").write_text(content)
        shapes = robot_shapes(robot_of(text, str(tmp_path / "small.urdf")))
        assert ("upper_0" in {shape.name for shape in shapes.model.geometryObjects}) is found
        assert (shapes.warnings == ()) is found


def test_a_mesh_without_its_texture_is_drawn_without_colours(tmp_path: Path, example_robots: Path) -> None:
    """Pinocchio's display would leave the link out; here its triangles are in the scene, in the size that the URDF's scale gives."""
    collada = (example_robots / "panda_description" / "meshes" / "visual" / "finger.dae").read_text()
    image = '<library_images><image id="i" name="i"><init_from>nowhere.png</init_from></image></library_images>'
    collada = re.sub(r"<library_images\s*/>|<library_images>.*?</library_images>", "", collada, flags=re.DOTALL)
    (tmp_path / "finger.dae").write_text(collada.replace("<library_geometries>", image + "<library_geometries>", 1))
    mesh = '<visual><geometry><mesh filename="finger.dae" scale="2 2 2"/></geometry></visual>'
    text = URDF.replace('<link name="upper"/>', f'<link name="upper">{mesh}</link>')
    view = view_of(robot_of(text, str(tmp_path / "small.urdf")))
    assert view.warnings == ()
    found = [command for command in commands_of(view.html) if command.get("path") == "/meshcat/solid/visuals/upper_0"]
    drawn = next(command["object"]["geometries"][0]["data"] for command in found if command["type"] == "set_object")
    vertices = np.frombuffer(drawn["attributes"]["position"]["array"].data, np.float32).reshape(-1, 3)
    placed = next(np.array(command["matrix"]).reshape(4, 4).T for command in found if command["type"] == "set_transform")
    shape = view.shapes.model.geometryObjects[view.shapes.model.getGeometryId("upper_0")].geometry
    size = np.ptp(vertices, axis=0) * np.linalg.norm(placed[:3, :3], axis=0)
    shape.computeLocalAABB()
    np.testing.assert_allclose(size, shape.aabb_local.max_ - shape.aabb_local.min_, atol=1e-6)


def test_the_robots_own_sheet_is_left_out(robots: dict[str, Robot]) -> None:
    """The viewer draws the screen itself."""
    assert not [link for link in robot_shapes(robots["arm7"]).links if link == "screen"]


@pytest.mark.parametrize("signs", [(1, 1, 1), (-1, 1, 1), (1, -1, 1), (1, 1, -1), (-1, -1, 1), (-1, -1, -1)])
def test_mirrored_meshes_turn_with_their_links(signs: tuple[int, ...], rng: np.random.Generator) -> None:
    """The rotation of the animation and the scale that three.js takes out of the first matrix give the matrix back."""
    rotation, scale = pin.SE3.Random().rotation, np.array(signs) * (0.5, 1.0, 2.0)
    matrix = rotation * scale
    lengths = np.linalg.norm(matrix, axis=0)  # Matrix4.decompose: lengths of the columns, x flipped if the determinant is negative
    lengths[0] *= np.sign(np.linalg.det(matrix))
    np.testing.assert_allclose(rotation * mirror(scale) * lengths, matrix, atol=1e-12)


def test_marks_turn_to_where_they_point(rng: np.random.Generator) -> None:
    """Whatever is drawn along z is turned to its direction by the shortest way; opposite ones about x, so that what is flat stays flat."""
    directions = np.concatenate([rng.normal(0, 1, (20, 3)), 2 * np.eye(3), -np.eye(3), [[0, 1e-7, -1]], np.zeros((1, 3))])
    turns = [pin.Quaternion(*np.roll(turn, 1)).toRotationMatrix() for turn in turns_from_z(directions)]
    for direction, turn in zip(directions[:-1], turns, strict=False):
        np.testing.assert_allclose(turn[:, 2], direction / np.linalg.norm(direction), atol=1e-7)
        assert direction[0] or abs(turn[0, 0]) == pytest.approx(1)
    np.testing.assert_allclose(turns[-1], np.eye(3))


def test_the_animation_holds_every_pose_and_moves_straight_in_joint_space(small_view: View) -> None:
    """At time k stands pose k; times rise; half way between two poses the joints are half way."""
    keys, data = key_frames(small_view.scene), small_view.scene.data
    assert (np.diff(keys.times) > 0).all()
    for pose in range(len(data)):
        np.testing.assert_allclose([np.interp(pose + 1, keys.times, column) for column in keys.q.T], data.q[pose], atol=1e-12)
        between = [np.interp(pose + 1.5, keys.times, column) for column in keys.q.T] if pose + 1 < len(data) else data.q[pose]
        np.testing.assert_allclose(between, (data.q[pose] + data.q[min(pose + 1, len(data) - 1)]) / 2, atol=1e-12)


def test_of_very_many_poses_the_worst_are_animated() -> None:
    """Not more than a few hundred poses move, the one with the largest error among them; all their spots are drawn."""
    robot = robot_of(URDF)
    data, corrected = measured(robot, 700)
    spots = data.spots.copy()
    spots[123, 0] += 0.05
    scene = Scene(robot, corrected, data.with_spots(spots))
    keys = key_frames(scene)
    assert len(keys.rows) == MOST_POSES
    assert 123 in keys.rows
    assert len(keys.times) < 800


def test_arrows_are_not_longer_than_the_screen(robots: dict[str, Robot]) -> None:
    """By default errors of a fit are drawn 20 times longer, large ones less; what is asked for is done."""
    data, corrected = measured(robots["arm7"], 20)
    assert Scene(robots["arm7"], corrected, data).groups["screen"].magnification == 20
    large = Scene(robots["arm7"], None, data)
    magnification = large.groups["screen"].magnification
    assert magnification < 20
    assert np.nanquantile([row.phases[0] for row in large.compared], 0.9) * magnification < 250 * large.sheet.size + 1e-9
    assert Scene(robots["arm7"], None, data, 7).groups["screen"].magnification == 7


def test_arrows_longer_than_the_scene_are_said(robots: dict[str, Robot]) -> None:
    """What is asked for is drawn, with the length that comes of it and a magnification that fits; what fits is not spoken of."""
    data, _ = measured(robots["arm7"], 20)
    warned = view_of(robots["arm7"], data, magnify=5000.0)
    found = re.fullmatch(
        r"arrows 5000 times longer than the errors are up to ([\d.]+) times as long as the scene; up to (\d+) times they fit",
        *warned.warnings,
    )
    assert found
    longest = np.nanmax([row.phases[0] for row in warned.scene.compared]) / 1e3
    assert float(found[1]) == pytest.approx(5000 * longest / warned.scene.sheet.size, abs=0.06)
    assert longest * float(found[2]) <= warned.scene.sheet.size < longest * 2 * float(found[2])
    assert view_of(robots["arm7"], data, magnify=float(found[2])).warnings == ()


def test_the_page_is_whole_and_the_same_every_time(small_view: View) -> None:
    """Nothing is loaded from elsewhere, nothing of this machine is in it, and the same scene gives the same bytes."""
    page = small_view.html
    assert not re.search(r'(?:src|href)\s*=\s*"(?!data:)', page)
    assert view_of(small_view.scene.robot, small_view.scene.data, small_view.scene.calibrated).html == page
    scene = re.search(r'id="urdfcal-scene">([^<]*)<', page)
    assert scene
    commands = gzip.decompress(base64.b64decode(scene[1]))
    for secret in (str(ROOT), str(Path.home()), f"{uuid.getnode():012x}"):
        assert secret.encode() not in commands
        assert secret not in page


@pytest.mark.parametrize("root", ["nominal", "solid"])
def test_both_robots_stand_before_the_one_screen_that_is_drawn(root: str) -> None:
    """Seen from the drawn screen, each robot's module is where its own forward kinematics has it in the first pose."""
    fixed = '<parent link="screen"/>\n    <child link="base"/>\n    <origin xyz="-1.4 0 -0.1" rpy="0 0 0"/>'
    assert fixed in URDF
    hung = URDF.replace(fixed, '<parent link="base"/>\n    <child link="screen"/>\n    <origin xyz="1.4 0 0.1" rpy="0 0 0"/>')
    robot = robot_of(hung)
    data, corrected = measured(robot)
    view = view_of(robot, data, corrected)
    placed = {command["path"]: command["matrix"] for command in commands_of(view.html) if command["type"] == "set_transform"}

    def drawn(path: str) -> pin.SE3:
        matrix = placed.get(f"/meshcat/{path}")
        return pin.SE3.Identity() if matrix is None else pin.SE3(np.array(matrix).reshape(4, 4).T)

    own = robot if root == "nominal" else corrected
    frames = own.model.createData()
    pin.framesForwardKinematics(own.model, frames, whole_configurations(own, data.q[:1])[0])
    screen, module = (frames.oMf[own.model.getFrameId(link, pin.FrameType.BODY)] for link in ("screen", "slm"))
    T_slm_box = view.shapes.T_link_shape[view.shapes.model.getGeometryId("slm_box")]
    assert_poses_close(drawn("screen").actInv(drawn(root) * drawn(f"{root}/visuals/slm_box")), screen.actInv(module * T_slm_box))


def test_names_from_files_do_not_become_html() -> None:
    """A robot, pose or laser that is named like a tag stays text."""
    evil = "</script><b>x"
    robot = robot_of(URDF.replace('name="small"', 'name="&lt;/script&gt;&lt;b&gt;x"'))
    data, corrected = measured(robot, 2)
    page = view_of(robot, replace(data, poses=np.array([evil, "b"])), corrected).html
    assert evil not in page
    assert "&lt;/script&gt;&lt;b&gt;x" in page


def test_in_a_notebook_the_view_is_an_inline_frame(small_view: View) -> None:
    """The last line of a cell shows the page, which cannot reach the notebook; its quotes are escaped."""
    frame = small_view._repr_html_()
    assert frame.startswith("<iframe ")
    assert ' sandbox="allow-scripts" ' in frame
    assert frame.count('"') == 8


def test_a_view_is_a_line_where_it_is_printed(small_view: View) -> None:
    """What it is of, and how to look at it, in place of meshes and arrays."""
    assert repr(small_view) == "<View of small, before and after: 6 poses; .serve() or .write_html(FILE) to look at it>"
    alone = view_of(small_view.scene.robot)
    assert repr(alone) == "<View of small, as its URDF has it: 1 pose; .serve() or .write_html(FILE) to look at it>"


def test_a_calibration_shows_itself(robots: dict[str, Robot], tmp_path: Path) -> None:
    """Before and after in one scene, with the distances of the fit's own table; loaded from its file it asks for robot and data."""
    robot = robots["arm7"]
    data = urdfcal.read_measurements(ARM7 / "measurements.csv", robot)
    calibration = urdfcal.fit(robot, data)
    calibration.write(tmp_path / "c.yaml")
    stored = urdfcal.load_calibration(tmp_path / "c.yaml")
    assert repr(stored) == f"<StoredCalibration {tmp_path / 'c.yaml'}: {', '.join(stored.corrections)}>"
    for scene in (calibration.show().scene, stored.show(robot, calibration.data).scene):
        for row in scene.compared:
            means = (calibration.before[row.name].mean, calibration.after[row.name].mean)
            np.testing.assert_allclose(row.means, means, atol=1e-6)
    assert len(stored.show(robot).scene.data) == 1


def test_without_measurements_a_pose_with_all_beams_on_the_screen_is_shown(robots: dict[str, Robot]) -> None:
    """Every robot that comes with urdfcal can be looked at by itself."""
    for name in ROBOTS:
        scene = view_of(robots[name]).scene
        assert len(scene.data) == 1
        assert scene.lands(scene.before).all(), name


def test_one_session_is_shown_and_the_others_are_named(robots: dict[str, Robot]) -> None:
    """A calibrated URDF holds the screen of one session; the option that shows another one is said."""
    data, corrected = measured(robots["arm7"], 6)
    data = replace(data, sessions=np.array(["a", "a", "b", "a", "b", "a"]))
    view = view_of(robots["arm7"], data, corrected)
    assert len(view.scene.data) == 4
    assert view.warnings == ("of the sessions 'a' is shown; --session shows another one: 'b'",)
    with pytest.raises(UsageError, match="session 'c': the measurements have 'a', 'b'"):
        view_of(robots["arm7"], data, corrected, session="c")


def test_another_session_has_its_screen_where_the_calibrated_robot_has_it(robots: dict[str, Robot]) -> None:
    """With the screen moved between sessions, the true robot's predictions lie on the spots of either one."""
    robot = without_meshes(robots["panda"])
    data, corrected = measured(robot, 24)
    fixed = corrected.chain.screen_joint
    assert fixed is not None
    shift = pin.SE3(pin.exp3(np.array([0.01, -0.02, 0.015])), np.array([0.02, 0.03, -0.01]))
    other = corrected_robot(corrected, {fixed.joint.name: fixed.joint.origin * shift})
    spots = placed_robot(other, data).beams(data.q[12:]).spots
    values = [np.concatenate([each.values[:12], spots[:, index]]) for index, each in enumerate(data.readings)]
    readings = tuple(replace(each, values=own) for each, own in zip(data.readings, values, strict=True))
    both = replace(data, readings=readings, sessions=np.repeat(["a", "b"], 12))
    view = view_of(robot, both, corrected, session="b")
    assert "stands where it suits the calibrated robot best" in " ".join(view.warnings)
    assert len(view.scene.data) == 12
    assert np.nanmax([row.phases[1] for row in view.scene.compared]) < 0.05
    assert np.nanmean([row.phases[0] for row in view.scene.compared]) > 1.0


def test_a_compensation_bends_the_calibrated_robot_alone(robots: dict[str, Robot]) -> None:
    """Predictions, beams and pose are those of the corrected joint positions, in the order of the measurements; the nominal robot stays."""
    robot = robots["arm7"]
    data, corrected = measured(robot, 5)
    names = tuple(reversed(data.joints))

    class Sagging:
        """What the view needs of a compensation: a tenth of a degree a joint, and more with the joint's place."""

        joints, robot = names, corrected

        def corrected_configuration(self, q: Matrix, payload: Vector | None, approach: Matrix | None) -> Matrix:
            assert payload is None
            assert approach is None
            return q + np.radians(0.1) * np.arange(1, len(names) + 1)

    view = view_of(robot, data, compensation=cast(Compensation, Sagging()))
    bent = data.q + np.radians(0.1) * np.arange(len(names), 0, -1)
    np.testing.assert_allclose(view.scene.bent_data.q, bent)
    keys = key_frames(view.scene)
    np.testing.assert_allclose(keys.solid - keys.q, np.tile(bent[0] - data.q[0], (len(keys.q), 1)), atol=1e-12)
    assert view.scene.after is not None
    np.testing.assert_allclose(view.scene.after.spots, placed_robot(corrected, data).beams(bent).spots, equal_nan=True)
    np.testing.assert_allclose(view.scene.before.spots, placed_robot(robot, data).beams(data.q).spots, equal_nan=True)
    assert "robot, calibrated, with its compensation" in view.html


def test_what_does_not_fit_is_refused(robots: dict[str, Robot]) -> None:
    """Another robot's measurements, another robot as the calibrated one, and a magnification of zero."""
    data, _ = measured(robots["arm7"])
    with pytest.raises(ShapeMismatch, match="the measurements are of joint1"):
        view_of(robots["ur5"], data)
    with pytest.raises(ShapeMismatch, match="the robot it is compared with has joint1"):
        view_of(robots["arm7"], data, robots["ur5"])
    with pytest.raises(UsageError, match="above zero, found 0"):
        view_of(robots["arm7"], data, magnify=0.0)


def test_a_beam_that_was_seen_and_misses_is_said() -> None:
    """The warning names the pose and the laser."""
    robot = robot_of(URDF)
    errors = ErrorModel(robot.chain, (), ())
    q = np.array([[0.0, 0.0, 0.1], [0.0, np.pi, 0.1]])
    data = spots_measured(robot, q, np.zeros((2, 2, 2)), poses=["home", "away"])
    assert errors.names == ()
    assert "pose away: laser_1 was seen" in view_of(robot, data).warnings[0]


def test_the_server_listens_on_loopback_alone_and_takes_the_next_free_port(small_view: View) -> None:
    """127.0.0.2 is loopback, too, but not ours: a server on every interface would answer there."""
    with small_view.serve(0) as first:
        assert first.url == f"http://127.0.0.1:{first.port}/"
        assert urllib.request.urlopen(first.url, timeout=10).read() == small_view.html.encode()
        with pytest.raises(urllib.error.HTTPError, match="404"):
            urllib.request.urlopen(first.url + "etc/passwd", timeout=10)
        with pytest.raises(ConnectionRefusedError):
            socket.create_connection(("127.0.0.2", first.port), timeout=10)
        with small_view.serve(first.port) as second:
            assert second.port > first.port
    with pytest.raises(ConnectionRefusedError):
        socket.create_connection(("127.0.0.1", first.port), timeout=10)


def test_ports_and_addresses_that_cannot_be_are_refused(small_view: View) -> None:
    """One line says what was asked for."""
    with pytest.raises(UsageError, match="--port 70000"):
        small_view.serve(70000)
    with pytest.raises(UsageError, match=r"cannot listen on 192\.0\.2\.1"):
        small_view.serve(0, "192.0.2.1")


def test_ctrl_c_stops_the_command(tmp_path: Path) -> None:
    """The address is the first thing said; after Ctrl-C the exit code is 0 and nothing is left but one word."""
    words = [sys.executable, "-m", "urdfcal.cli", "view", ARM7 / "arm7.urdf.xacro", "--port", "0", "--no-open"]
    process = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=tmp_path)
    assert process.stdout is not None
    try:
        said = process.stdout.readline()
        assert re.match(r"http://127\.0\.0\.1:\d+/ shows the robot", said)
        assert b"urdfcal-scene" in urllib.request.urlopen(said.split()[0], timeout=10).read()
        process.send_signal(signal.SIGINT)
        _, complaints = process.communicate(timeout=20)
    finally:
        process.kill()  # nothing is left behind where it does not stop
        process.communicate()
    assert (process.returncode, complaints) == (0, "stopped\n")


def test_the_command_writes_the_page(run_cli: Run, tmp_path: Path) -> None:
    """--html writes one file with the calibration's YAML or URDF alike, and says so."""
    run_cli("fit", ARM7 / "arm7.urdf.xacro", ARM7 / "measurements.csv", "-q")
    for index, calibrated in enumerate(("arm7_calibration.yaml", "arm7_calibrated.urdf")):
        done = run_cli(
            "view", ARM7 / "arm7.urdf.xacro", ARM7 / "measurements.csv", "--calibrated", calibrated, "--html", f"{index}.html", "--json"
        )
        assert (done.code, done.err) == (0, "")
        assert json.loads(done.out) == {"html": f"{index}.html", "bytes": (tmp_path / f"{index}.html").stat().st_size}
    tables = [re.findall(r"<td>([\d.]+)</td>", (tmp_path / f"{index}.html").read_text()) for index in (0, 1)]
    assert tables[0] == tables[1]
    assert len(tables[0]) == 4


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--html", ARM7 / "measurements.csv"], "is an input"),
        (["--html", "nowhere/v.html"], "does not exist"),
        (["--magnify", "-1", "--html", "v.html"], "above zero"),
        (["--calibrated", "none.yaml", "--html", "v.html"], "none.yaml: cannot be read"),
        (["--calibrated", "none.urdf", "--html", "v.html"], "none.urdf: cannot be read"),
        (["--port", "99999"], "--port 99999"),
        (["--host", ""], "--host: expected an address, found nothing"),
        (["--port", "8000", "--html", "v.html"], "--port and --host are about serving"),
        (["--host", "127.0.0.1", "--html", "v.html"], "--port and --host are about serving"),
    ],
)
def test_what_cannot_be_done_is_one_line_and_nothing_written(run_cli: Run, tmp_path: Path, words: list[str], said: str) -> None:
    """Exit code 2, no file."""
    done = run_cli("view", ARM7 / "arm7.urdf.xacro", ARM7 / "measurements.csv", *words)
    assert done.code == 2
    assert said in done.err
    assert len(done.err.splitlines()) == 1
    assert list(tmp_path.iterdir()) == []
