"""What the view makes of points, orientations, wires, planes and sockets, without a browser."""

from __future__ import annotations

import base64
import gzip
import json
import re
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from tests.support.helpers import ROBOTS, without_meshes
from tests.support.paths import SHARED_DATA
from tests.support.sensor_cases import CASES, SINGLE, setup_of
from tests.support.small_robot import robot_of
from urdfcal.api import fit
from urdfcal.base.geometry import MM, Matrix
from urdfcal.calibration.problem import Problem
from urdfcal.calibration.reach import draw_poses
from urdfcal.calibration.start.nominal import evaluate
from urdfcal.model.gauge import build_error_model
from urdfcal.model.options import ModelOptions, ParameterPrior
from urdfcal.output.view.key_frames import MOST_POSES, key_frames
from urdfcal.output.view.meshes import FLAT, ROUND, arrows, balls, crosses, disc, ring
from urdfcal.output.view.placed import Mark, frame_placements
from urdfcal.output.view.scene import MarkGroup, Scene
from urdfcal.output.view.viewer import view_of
from urdfcal.robot.configurations import whole_configurations
from urdfcal.robot.rig import Grid
from urdfcal.robot.robot import Robot, load_robot, robot_from
from urdfcal.robot.urdf_writer import with_origins
from urdfcal.sensors.camera import Camera
from urdfcal.sensors.measurements import Measurements, as_measured, spots_measured
from urdfcal.sensors.measurements_csv import write_measurements
from urdfcal.sensors.readings import Readings, blank_readings
from urdfcal.simulation.readings import ReadingNoise, simulate_readings
from urdfcal.simulation.truth import random_truth

Seen = Callable[[str], tuple[Robot, Measurements, Robot]]
DRAWN = [*SINGLE, "reference carried", "hand sees hand", "several targets", "lasers and points", "every kind"]


def seen(name: str, robots: dict[str, Robot], rng: np.random.Generator, poses: int = 40) -> tuple[Robot, Measurements, Robot]:
    """Nominal robot, measurements without noise, and the robot that made them."""
    setup = setup_of(CASES[name], robots, rng)
    data = simulate_readings(setup, poses, rng)
    text = with_origins(setup.robot.description, setup.errors.corrected_origins(setup.x))
    true = robot_from(replace(setup.robot.description, text=text), screen=setup.robot.screen, lasers=setup.robot.lasers)
    return setup.robot, data, true


@pytest.fixture(scope="module")
def plain(robots: dict[str, Robot]) -> dict[str, Robot]:
    """The robots without meshes, for views of which only the scene is looked at."""
    return {name: without_meshes(robots[name]) for name in ROBOTS}


@pytest.fixture(scope="module")
def measured(robots: dict[str, Robot]) -> Seen:
    """What is `seen` of a case in 40 poses, made once for all tests."""
    return cache(lambda name: seen(name, robots, np.random.default_rng(20261122)))


def drawn(robot: Robot, data: Measurements, true: Robot | None = None) -> Scene:
    """The scene alone; what robots look like is not needed, and takes its time."""
    return Scene(robot, None if true is None else as_measured(true, data), data)


def vision_camera() -> Camera:
    """A camera three metres before the screen, without distortion."""
    axes = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
    matrix = np.array([[900.0, 0.0, 640.0], [0.0, 900.0, 480.0], [0.0, 0.0, 1.0]])
    return Camera((1280, 960), matrix, np.zeros(5), "plain", pin.SE3(axes, np.array([0.1, -0.1, 3.0])))


def targets(scene: Scene) -> MarkGroup:
    """The marks in the measuring frame."""
    return scene.groups["frame"]


def there(mark: Mark, places: Matrix) -> Matrix:
    """Of places (n, 3) those of poses at which something was read."""
    return np.asarray(places[~np.isnan(mark.read[:, 0])])


@pytest.mark.parametrize("name", DRAWN)
def test_the_true_robot_has_its_crosses_on_the_balls(name: str, measured: Seen) -> None:
    """With the robot that made the measurements every prediction is the reading; the nominal one's are millimetres off."""
    robot, data, true = measured(name)
    scene = drawn(robot, data, true)
    assert [(mark.sensor.name, mark.target) for mark in scene.placed[1].marks] == [(own.sensor, own.target) for own in data.readings]
    for group in scene.groups.values():
        for index, mark in enumerate(group.marks):
            np.testing.assert_allclose(there(mark, mark.predicted), there(mark, mark.read), atol=2e-6)
            before = np.linalg.norm(there(mark, group.shifted(0, index) - mark.read), axis=1)
            assert mark.on_screen or before.max() < 0.1
            assert not mark.is_point or np.nanmean(before) > 1e-4
    assert all(np.nanmean(row.phases[1]) < 0.05 * np.nanmean(row.phases[0]) for row in scene.compared)


@pytest.mark.parametrize("name", DRAWN)
def test_the_table_is_the_one_of_evaluate(name: str, measured: Seen) -> None:
    """The mean errors beside the picture are those that `urdfcal evaluate` prints."""
    robot, data, _ = measured(name)
    scene = drawn(robot, data)
    table = evaluate(robot, data)
    assert [row.name for row in scene.compared] == list(table)
    for row in scene.compared:
        assert row.means[0] == pytest.approx(table[row.name].mean, rel=1e-6)


def test_what_is_said_of_the_instruments_holds_in_the_view(plain: dict[str, Robot], rng: np.random.Generator) -> None:
    """A known reference and a held offset: the scene has the figures of `evaluate` and of the fit, which others would beat."""
    robot, data, _ = seen("reference known", plain, rng)
    options = ModelOptions(reference_known=True, fix=("*panda_link8*",), single={"camera.*": ParameterPrior(fixed=True)})
    table = evaluate(robot, data, replace(options, single={}))
    calibration = fit(robot, data, options=replace(options, single={}), sane=False)
    scene, shown = view_of(robot, data, options=options).scene, calibration.show().scene
    free = view_of(robot, data).scene.compared
    for row, again, loose in zip(scene.compared, shown.compared, free, strict=True):
        assert row.means[0] == pytest.approx(table[row.name].mean, rel=1e-6)
        assert again.means == pytest.approx((calibration.before[row.name].mean, calibration.after[row.name].mean), rel=1e-4)
        assert loose.means[0] < 0.9 * row.means[0]


@pytest.mark.parametrize("name", DRAWN)
def test_targets_ride_on_their_links(name: str, measured: Seen) -> None:
    """Put into the root by the drawn measuring frame, a predicted target is one and the same point of its link, by Pinocchio's frames."""
    robot, data, _ = measured(name)
    scene = drawn(robot, data)
    whole = whole_configurations(scene.robot, data.q)
    frames = robot.model.createData()
    placed = frame_placements(scene.placed[0], whole, data.q)
    marks = [mark for mark in scene.placed[0].marks if not mark.on_screen]
    for mark, readings in zip(marks, [each for each in data.readings if not each.kind.beam], strict=True):
        on_link = []
        for q, T_root_frame, p in zip(whole, placed, mark.predicted, strict=True):
            pin.framesForwardKinematics(robot.model, frames, q)
            T_root_link = frames.oMf[robot.model.getFrameId(readings.link, pin.FrameType.BODY)]
            on_link.append(T_root_link.actInv(T_root_frame.act(p)))
        np.testing.assert_allclose(on_link, np.tile(on_link[0], (len(on_link), 1)), atol=1e-9)


def test_each_kind_is_drawn_where_its_reading_has_the_target(measured: Seen) -> None:
    """A ball is at the read point, at the read distance from the wire's end, on the plane, or in the one socket that was touched."""
    robot, data, _ = measured("every kind")
    scene = drawn(robot, data)
    for mark, readings in zip(targets(scene).marks, [each for each in data.readings if not each.kind.beam], strict=True):
        read = there(mark, mark.read)
        if mark.sensor.name == "point" and readings.target.startswith("tool0"):
            np.testing.assert_allclose(read, readings.values[readings.seen])
        elif mark.sensor.name == "distance":
            np.testing.assert_allclose(np.linalg.norm(read - there(mark, mark.start), axis=1), readings.values[readings.seen, 0])
        elif mark.sensor.name == "plane":
            labels = readings.labels[readings.seen]
            for plane in scene.placed[-1].planes:
                off = (read[labels == plane.label] - plane.feet[0]) @ plane.normal
                np.testing.assert_allclose(off, 0.0, atol=1e-12)
        elif mark.sensor.name == "socket":
            assert len(np.unique(np.round(read, 9), axis=0)) == len(readings.touched)


def test_pixels_are_drawn_as_spots_and_on_rays(plain: dict[str, Robot], rng: np.random.Generator) -> None:
    """Of a laser the camera's spot on the screen; of a board all corners on their rays, one row in the table, and a few marks that move."""
    camera = vision_camera()
    robot, grid, n = plain["panda"], Grid(4, 3, 0.05), 12
    errors, zero = random_truth(robot, rng, 0.0, 0.0)
    bare = spots_measured(robot, draw_poses(robot, errors, zero, n, rng), np.full((n, 2, 2), np.nan))
    blank, none = np.full(n, ""), np.full(n, np.nan)
    spots = tuple(Readings("spot_pixel", laser, laser, rng.uniform(400, 700, (n, 2)), blank, none) for laser in robot.rig.lasers)
    scene = view_of(robot, replace(bare, readings=spots, camera=camera)).scene
    np.testing.assert_allclose(scene.data.spots[:, 1], camera.spots_of_pixels(spots[1].values))
    assert list(scene.groups) == ["screen"]
    unread = tuple(blank_readings("pixel", f"slm:{k}", "slm", n) for k in range(grid.corners))
    board = replace(bare, readings=unread, camera=camera, boards={"slm": grid}, reference="panda_link0")
    held = as_measured(robot, board)
    model = build_error_model(held.chain, held.rig)
    pixels = [each + rng.normal(0, 3, (n, 2)) for each in Problem(model, board).read(np.zeros(len(model.names)))]
    board = replace(board, readings=tuple(replace(own, values=read) for own, read in zip(unread, pixels, strict=True)))
    scene = drawn(held, board)
    assert [row.name for row in scene.compared] == ["slm pixels"]
    assert (len(targets(scene).marks), len(targets(scene).moving)) == (12, 4)
    for mark, own in zip(targets(scene).marks, pixels, strict=True):
        ahead = mark.read[:, 2] > 0
        assert ahead.any()
        np.testing.assert_allclose(camera.project(mark.read[ahead]), own[ahead], atol=1e-6)


def test_missing_readings_are_not_drawn(plain: dict[str, Robot], rng: np.random.Generator) -> None:
    """A pose without a reading has no ball, no number in the table, and nothing that is not finite in the page."""
    robot, data, true = seen("pose", plain, rng, 8)
    holes = np.arange(8) == 2
    view = view_of(robot, replace(data, readings=tuple(each.without(holes) for each in data.readings)), true)
    assert [int(np.isnan(mark.read[:, 0]).sum()) for mark in targets(view.scene).marks] == [1, 1]
    scene, config = (re.search(f'id="urdfcal-{name}">([^<]*)<', view.html) for name in ("scene", "config"))
    assert scene
    assert config
    content = gzip.decompress(base64.b64decode(scene[1]))
    animation = json.loads(content[content.index(b'{"type":"set_animation"') :], parse_constant=pytest.fail)
    assert any("axes_2" in entry["path"] for entry in animation["animations"])
    assert json.loads(config[1])["poses"][2]["errors"] == [["–", "–"], ["–", "–"]]


def test_of_very_many_poses_the_worst_target_is_animated(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """As with lasers."""
    robot, data, true = seen("point", robots, rng, MOST_POSES + 50)
    values = data.readings[0].values.copy()
    values[37] += 0.05
    scene = drawn(robot, replace(data, readings=(replace(data.readings[0], values=values),)), true)
    assert 37 in key_frames(scene).rows


def test_one_session_is_shown(plain: dict[str, Robot], rng: np.random.Generator) -> None:
    """Each session has a measuring frame of its own; the first one's is drawn, and that is said."""
    robot, data, true = seen("sessions", plain, rng)
    view = view_of(robot, data, true)
    assert set(view.scene.data.sessions) == {"monday"}
    assert view.warnings[0] == "of the sessions 'monday' is shown; --session shows another one: 'friday'"
    assert np.nanmax(view.scene.compared[0].phases[1]) < 1e-2
    other = view_of(robot, data, true, session="friday")
    assert set(other.scene.data.sessions) == {"friday"}
    assert np.nanmax(other.scene.compared[0].phases[1]) < 1e-2


def test_the_robots_base_is_drawn(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """The reference link is no screen: its shape stays."""
    robot, data, _ = seen("point", robots, rng, 5)
    assert robot.rig.base in robot.tree.links
    assert any(link == "base_link" for link in view_of(robot, data).shapes.links)
    panda, points, _ = seen("reference carried", robots, rng, 5)
    assert "panda_link0" in view_of(panda, points).shapes.links


def test_a_screen_that_is_not_used_is_not_drawn(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """A robot that carries a screen, measured without lasers: its sheet would hide the targets."""
    robot, data, _ = seen("point", robots, rng, 5)
    assert "screen" in robot.tree.links
    assert "screen" not in view_of(robot, data).shapes.links


def test_marks_and_arrows_have_the_size_that_is_asked_for(rng: np.random.Generator) -> None:
    """Balls lie on their spheres, crosses reach out of them, arrows end at their tips; what is flat has one x."""
    centres = rng.normal(0, 1, (5, 3))
    vertices = balls(0.02, centres).vertices.reshape(5, -1, 3)
    np.testing.assert_allclose(np.linalg.norm(vertices - centres[:, None], axis=2), 0.02, rtol=1e-4)
    for tilted in (False, True):
        arms = crosses(0.02, centres, tilted).vertices.reshape(5, -1, 3) - centres[:, None]
        assert np.linalg.norm(arms, axis=2).max() > 0.04
    tips = centres + rng.normal(0, 0.1, (5, 3))
    for shape, flat in ((ROUND, (1, 1, 1)), (FLAT, (0, 1, 1))):
        points = arrows(shape, centres * flat, tips * flat, 0.005).vertices.reshape(5, -1, 3)
        np.testing.assert_allclose(points[:, -1], tips * flat, atol=1e-6)
        np.testing.assert_allclose(points[:, : len(shape.rim)].mean(axis=1), centres * flat, atol=1e-6)
        assert flat[0] or not points[..., 0].any()
    for mesh, radii in ((disc(0.02, centres), (0.0, 0.02)), (ring(0.02, centres), (0.029, 0.039))):
        off = mesh.vertices.reshape(5, -1, 3) - centres[:, None]
        np.testing.assert_allclose(np.linalg.norm(off, axis=2)[:, [0, -1]], np.tile(radii, (5, 1)), atol=1e-6)
        np.testing.assert_allclose(off[..., 0], 0.0, atol=1e-6)


def test_errors_of_calibrated_robots_are_longer_drawn(measured: Seen) -> None:
    """Millimetres are drawn a few times longer, hundredths many times; what is asked for is done."""
    robot, data, true = measured("point")
    before, after = drawn(robot, data), drawn(robot, data, true)
    assert targets(before).magnification <= 20 < targets(after).magnification
    assert targets(replace(after, magnify=3)).magnification == 3
    longest = max(np.nanmax(np.linalg.norm(mark.predicted - mark.read, axis=1)) for mark in targets(before).marks)
    assert before.most_magnification == pytest.approx(targets(before).size / longest)


def test_the_command_shows_targets(run_cli, robots: dict[str, Robot], rng: np.random.Generator, tmp_path: Path) -> None:  # type: ignore[no-untyped-def]
    """`urdfcal view` takes the options of `fit`: a reference link, and the calibration's YAML."""
    setup = setup_of(CASES["every kind"], robots, rng)
    data = simulate_readings(setup, 40, rng, ReadingNoise(spot=0.1 * MM, length=0.05 * MM, angle=1e-4))
    write_measurements(tmp_path / "m.csv", data)
    (tmp_path / "ur5.urdf").write_bytes(setup.robot.description.text)
    done = run_cli("view", "ur5.urdf", "m.csv", "--html", "v.html", "--reference", "base_link", "--json")
    assert (done.code, done.err) == (0, "")
    page = (tmp_path / "v.html").read_text()
    assert "measuring frame, fixed to base_link" in page
    for words in ("laser_1", "tool0", "slm:bar distance", "wire", "planes that were touched", "socket, where its touches meet"):
        assert words in page
    refused = run_cli("view", "ur5.urdf", "m.csv", "--html", "w.html", "--reference", "nowhere")
    assert (refused.code, len(refused.err.splitlines())) == (2, 1)
    assert not (tmp_path / "w.html").exists()


def test_the_command_heeds_rig_yaml(run_cli, robots: dict[str, Robot], rng: np.random.Generator, tmp_path: Path) -> None:  # type: ignore[no-untyped-def]
    """With `reference_known` the page's mean errors are those of `evaluate` with the same file."""
    setup = setup_of(CASES["point"], robots, rng)
    write_measurements(tmp_path / "m.csv", simulate_readings(setup, 40, rng))
    (tmp_path / "ur5.urdf").write_bytes(setup.robot.description.text)
    (tmp_path / "rig.yaml").write_text("reference: base_link\nreference_known: true\n")
    done = run_cli("evaluate", "ur5.urdf", "m.csv", "--rig", "rig.yaml", "--json")
    expected = [row["mean_mm"] for row in json.loads(done.out)["before"].values()]
    assert run_cli("view", "ur5.urdf", "m.csv", "--rig", "rig.yaml", "--html", "v.html").code == 0
    found = [float(mean) for mean in re.findall(r"<td>([\d.]+)</td>", (tmp_path / "v.html").read_text())]
    assert found == pytest.approx(expected, rel=5e-3)
    assert max(found) > 50  # the frame that was simulated stands elsewhere


def test_a_robot_that_nothing_measures_is_shown_alone(example_robots: Path) -> None:
    """A URDF without lasers and without measurements: one pose within the limits, and the robot."""
    robot = load_robot(example_robots / "panda_description" / "urdf" / "panda.urdf")
    view = view_of(robot)
    assert (len(view.scene.data), view.scene.compared, view.scene.groups) == (1, (), {})
    assert "panda_link0" in view.shapes.links
    assert "1 pose, nothing measured" in view.html
    assert "screen" not in re.findall(r'data-paths="([^"]*)"', view.html)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("folder", "description"),
    [
        ("ur10_leica", "ur_description/urdf/ur10_robot.urdf"),
        ("fr3_camera_board", "panda_description/urdf/panda.urdf"),
        ("talos_left_arm", "talos_data/robots/talos_reduced.urdf"),
        ("panda_sockets", "panda_description/urdf/panda.urdf"),
    ],
)
def test_real_measurements_are_shown_by_one_command(run_cli, folder: str, description: str, example_robots: Path, tmp_path: Path) -> None:  # type: ignore[no-untyped-def]
    """Without a calibration the measuring frame is placed where it suits the URDF best; the page stays within a few megabytes."""
    data = SHARED_DATA / folder / "measurements.csv"
    if not data.exists():
        pytest.skip(f"no ../shared/data/{folder}: real measurements are not part of this project, see robots/README.md")
    done = run_cli("view", example_robots / description, data, "--html", "v.html", "-q")
    assert (done.code, done.err) == (0, "")
    assert (tmp_path / "v.html").stat().st_size < 8e6
    means = [float(mean) for mean in re.findall(r"<td>([\d.]+)</td>", (tmp_path / "v.html").read_text())]
    assert all(0 < mean < 6 for mean in means)


def test_the_camera_and_the_ends_of_the_arm_are_in_the_picture(plain: dict[str, Robot], rng: np.random.Generator) -> None:
    """A camera that knows the screen stands before it, one that is the measuring frame in it; frames ride on their links."""
    camera, robot = vision_camera(), plain["panda"]
    q = np.zeros((3, len(robot.chain.inputs)))
    bare, blank, none = spots_measured(robot, q, np.full((3, 2, 2), np.nan)), np.full(3, ""), np.full(3, np.nan)
    spots = tuple(Readings("spot_pixel", laser, laser, rng.uniform(400, 700, (3, 2)), blank, none) for laser in robot.rig.lasers)
    scene = view_of(robot, replace(bare, readings=spots, camera=camera)).scene
    assert scene.camera is not None
    centre = camera.T_camera_screen * scene.camera.T_frame_camera if camera.T_camera_screen is not None else None
    assert centre is not None
    np.testing.assert_allclose(centre.homogeneous, np.eye(4), atol=1e-12)
    assert scene.frames == ("panda_link0", "slm")
    target = Readings("pixel", "slm", "slm", rng.uniform(400, 700, (3, 2)), blank, none)
    held = replace(bare, readings=(target,), camera=camera, reference="panda_link0")
    view = view_of(robot, held)
    assert view.scene.camera is not None
    assert view.scene.camera.frame == "frame"
    page = view.html
    sent = gzip.decompress(base64.b64decode(re.search(r'id="urdfcal-scene">([^<]*)<', page)[1]))  # type: ignore[index]
    assert all(f"/meshcat/{path}".encode() in sent for path in ("frame/camera", "frames/0", "frames/1"))
    assert "camera, and how far it sees" in page
    assert "predicted in px" in page


def railed(shape: str = "") -> Robot:
    """A turning arm on a rail from -0.8 to 1.2 m, that nothing measures; its carriage may have a shape."""
    limits = '<limit lower="-0.8" upper="1.2" effort="1" velocity="1"/>'
    joints = (("rail", "prismatic", "world", "car", "0 0 0.2", "0 1 0"), ("turn", "revolute", "car", "arm", "0 0 0.3", "0 0 1"))
    moving = "".join(
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/><origin xyz="{xyz}"/><axis xyz="{axis}"/>'
        f"{limits}</joint>"
        for name, kind, parent, child, xyz, axis in joints
    )
    return robot_of(f'<robot name="railed"><link name="world"/><link name="car">{shape}</link><link name="arm"/>{moving}</robot>')


def test_a_bare_robot_has_no_words_about_marks() -> None:
    """Of a robot that nothing measures the page says how to turn it and nothing of marks, spots or poses to choose."""
    page = view_of(railed()).html
    assert "Drag to turn" in page
    assert not re.search(r"[Mm]arks|spot|Pose<", page.split('<script type="application/json"')[0].split("<body>")[1])


@pytest.mark.parametrize("shape", ["", '<visual><geometry><box size="0.1 0.1 0.1"/></geometry></visual>'], ids=["simple", "shape"])
def test_a_rail_is_drawn_where_the_arm_stands_on_it(shape: str) -> None:
    """Between the limits of a joint that slides, also below zero, on a link that has no shape, whether or not others have."""
    model = view_of(railed(shape)).shapes.model
    rail = model.geometryObjects[model.getGeometryId("world_rail_car")]
    np.testing.assert_allclose(rail.placement.translation, (0, 0.2, 0.2), atol=1e-12)
    np.testing.assert_allclose(np.abs(rail.placement.rotation[:, 2]), (0, 1, 0), atol=1e-12)
    assert rail.geometry.halfLength == pytest.approx(1.0)
