"""The view as a person sees it: pages opened in a headless Chromium, pictures taken, colours found where the spots must be.

Where the marks must be is computed here from the measurements and Pinocchio's own frames; of the page only the camera is taken.
"""

from __future__ import annotations

import json
import re
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt
import pinocchio as pin
import pytest

from tests.support.browser import Browser, Picture, find_browser
from tests.support.helpers import ROBOTS, without_meshes
from tests.support.meshes import showing
from tests.support.sensor_cases import SensorCase, setup_of
from tests.support.small_robot import URDF, robot_of
from urdfcal.base.geometry import Matrix, Vector
from urdfcal.calibration.reach import ScreenArea, draw_poses
from urdfcal.output.view.placed import frame_placements
from urdfcal.output.view.server import PageServer
from urdfcal.output.view.viewer import View, view_of
from urdfcal.robot.configurations import whole_configurations
from urdfcal.robot.robot import Robot, robot_from
from urdfcal.robot.urdf_writer import with_origins
from urdfcal.sensors.measurements import Measurements, spots_measured
from urdfcal.simulation.readings import SimulatedNoise, simulate, simulate_readings
from urdfcal.simulation.truth import random_truth

pytestmark = pytest.mark.skipif(
    find_browser() is None, reason="no chromium here; install Debian's package 'chromium' or name one in $URDFCAL_BROWSER"
)

MEASURED, NOMINAL, CALIBRATED = (0x3A, 0x8E, 0xE6), (0xE0, 0x6C, 0x00), (0x00, 0x8A, 0x60)
BEAMS, MISSING = ((0xE3, 0x24, 0x2B), (0xB5, 0x17, 0x9E)), (0x7C, 0x85, 0x8F)
WIDTH, HEIGHT = 1200, 800
LEGEND_WIDTH = 330
LEGEND = {  # words of the legend, and the box that belongs to them
    "sheet": "screen/sheet",
    "robot": "solid",
    "frames": "frames/0",
    "ghost": "nominal",
    "nominal beams": "screen/pose/nominal_beam_1",
    "beams": "screen/pose/beam_1",
    "measured": "screen/marks/measured",
    "nominal": "screen/marks/nominal",
    "calibrated": "screen/marks/calibrated",
    "shift": "screen/marks/shift",
    "error": "screen/marks/error",
}
Mask = npt.NDArray[np.bool_]


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    """One browser for all tests of this file."""
    with Browser(WIDTH, HEIGHT) as opened:
        yield opened


def measured(robot: Robot, count: int, share: float = 1.0) -> tuple[Measurements, Robot]:
    """Simulated measurements, 0.3 mm of noise, and the robot that made them; errors are a share of 6 mm and 0.6 deg."""
    rng = np.random.default_rng(5)
    errors, truth = random_truth(robot, rng, share * 6e-3, share * np.radians(0.6))
    q = draw_poses(robot, errors, truth, count, rng, area=ScreenArea(1.5))
    data = simulate(robot, errors, truth, q, rng, SimulatedNoise(3e-4))
    return data, robot_from(replace(robot.description, text=with_origins(robot.description, errors.corrected_origins(truth))))


@pytest.fixture(scope="module")
def arm7_view(robots: dict[str, Robot]) -> View:
    """The paper's arm before and after."""
    return view_of(robots["arm7"], *measured(robots["arm7"], 12))


@pytest.fixture(scope="module")
def arm7_page(arm7_view: View, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Its page."""
    path = tmp_path_factory.mktemp("pages") / "arm7.html"
    arm7_view.write_html(path)
    return path


def open_fresh(browser: Browser, page: Path) -> None:
    """The page as it comes up; one that is open already is put back, which is quicker."""
    if browser.run("location.href") != page.resolve().as_uri():
        browser.open(page)
        return
    browser.run("for (const box of document.querySelectorAll('#panel input')) if (box.checked !== box.defaultChecked) box.click()")
    show_pose_marks(browser, True)
    browser.run("goTo(0); touched = false; lookAtAll()")


def complaints(browser: Browser) -> list[str]:
    """What the console says; the software renderer's remarks on the speed of taking pictures are about us, not the page."""
    return [line for line in browser.console if "GPU stall due to ReadPixels" not in line]


def show_only(browser: Browser, *wanted: str) -> None:
    """Tick these boxes of the legend and no other of the robot and the marks."""
    ticked = json.dumps({path: name in wanted for name, path in LEGEND.items()})
    browser.run(
        "(() => { const boxes = [...document.querySelectorAll('#panel input')];"
        f"for (const [path, on] of Object.entries({ticked})) {{"
        "  const box = boxes.find(box => box.dataset.paths.split(' ').includes(path));"
        "  if (box && box.checked !== on) box.click(); } })()"
    )


def show_pose_marks(browser: Browser, on: bool) -> None:
    """Show or hide all that belongs to the pose shown."""
    browser.run(f"show('screen/pose', {str(on).lower()})")


def pixels(browser: Browser, points: Matrix) -> Matrix:
    """Where points (n, 3) of the root's axes are in the picture, (n, 2), by the page's camera."""
    projection, inverse = (
        np.array(browser.run(f"(viewer.camera.updateMatrixWorld(), [...viewer.camera.{name}.elements])")).reshape(4, 4).T
        for name in ("projectionMatrix", "matrixWorldInverse")
    )
    three = np.column_stack([points[:, 0], points[:, 2], -points[:, 1], np.ones(len(points))])
    clip = three @ inverse.T @ projection.T
    return np.column_stack([(clip[:, 0] / clip[:, 3] + 1) * WIDTH / 2, (1 - clip[:, 1] / clip[:, 3]) * HEIGHT / 2])


def in_root(robot: Robot, points: Matrix, q: Vector | None = None) -> Matrix:
    """Points (n, 3) of the screen's axes in the root's, by Pinocchio's frames of the whole robot."""
    data = robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, pin.neutral(robot.model) if q is None else q)
    placed = data.oMf[robot.model.getFrameId(robot.rig.base, pin.FrameType.BODY)]
    return points @ placed.rotation.T + placed.translation


def on_screen(spots: Matrix) -> Matrix:
    """Spots (n, 2) as points of the screen's axes."""
    return np.column_stack([np.zeros(len(spots)), spots])


def coloured(picture: Picture, colour: tuple[int, int, int], tolerance: int = 40) -> Mask:
    """Which pixels of the scene have this colour, a little off at edges."""
    found = np.abs(picture.astype(int) - colour).max(axis=-1) <= tolerance
    found[:, :LEGEND_WIDTH] = False
    found[:24, -260:] = False  # meshcat's own controls, folded
    return np.asarray(found)


def distances_to_marks(mask: Mask, places: Matrix) -> Vector:
    """From each place (n, 2) to the middle of the nearest mark of the mask, in pixels; thin rings are closed first."""
    closed = cv2.dilate(mask.astype(np.uint8), np.ones((5, 5)))
    outlines, _ = cv2.findContours(closed, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    assert outlines, "no pixel of this colour in the picture"
    boxes = np.array([cv2.boundingRect(outline) for outline in outlines], dtype=float)
    middles = boxes[:, :2] + boxes[:, 2:] / 2
    return np.asarray(np.linalg.norm(places[:, None] - middles[None], axis=-1).min(axis=1))


def alone(places: Matrix, others: float) -> Mask:
    """Which places have no other within a distance, so that their marks do not run into one another."""
    apart = np.linalg.norm(places[:, None] - places[None], axis=-1)
    np.fill_diagonal(apart, np.inf)
    return np.asarray(apart.min(axis=1) > others)


def spots_off(browser: Browser, robot: Robot, spots: Matrix, colour: tuple[int, int, int]) -> tuple[Vector, Vector]:
    """How far the marks of one colour are from where these spots belong: in pixels, and in millimetres there; lone spots only."""
    places = pixels(browser, in_root(robot, on_screen(spots)))
    picture = browser.picture()
    kept = alone(places, 24)
    near = pixels(browser, in_root(robot, on_screen(spots + np.array([1e-3, 0]))))
    down = pixels(browser, in_root(robot, on_screen(spots + np.array([0, 1e-3]))))
    per_mm = np.maximum(np.linalg.norm(near - places, axis=1), np.linalg.norm(down - places, axis=1))
    off = distances_to_marks(coloured(picture, colour, 100), places[kept])
    assert kept.sum() >= 10
    return off, off / per_mm[kept]


def test_measured_spots_are_discs_in_the_right_place(browser: Browser, arm7_page: Path, arm7_view: View) -> None:
    """Each measured spot is a blue disc at its (y, z) on the screen, to a pixel and a half."""
    open_fresh(browser, arm7_page)
    show_only(browser, "measured")
    show_pose_marks(browser, False)
    off, _ = spots_off(browser, arm7_view.scene.solid, arm7_view.scene.data.spots.reshape(-1, 2), MEASURED)
    assert off.max() < 1.5


@pytest.mark.parametrize(("layer", "colour"), [("nominal", NOMINAL), ("calibrated", CALIBRATED)])
def test_predicted_spots_are_rings_in_the_right_place(
    browser: Browser, arm7_page: Path, arm7_view: View, layer: str, colour: tuple[int, int, int]
) -> None:
    """Each ring's middle is where the laser frame of that robot, by Pinocchio, points at the screen."""
    robot = arm7_view.scene.robot if layer == "nominal" else arm7_view.scene.calibrated
    assert robot is not None
    data, spots = robot.model.createData(), []
    for q in whole_configurations(robot, arm7_view.scene.data.q):
        pin.framesForwardKinematics(robot.model, data, q)
        placed = data.oMf[robot.model.getFrameId("screen", pin.FrameType.BODY)]
        for laser in robot.rig.lasers:
            beam = placed.actInv(data.oMf[robot.model.getFrameId(laser, pin.FrameType.BODY)])
            reach = -beam.translation[0] / beam.rotation[0, 2]
            spots.append((beam.translation + reach * beam.rotation[:, 2])[1:])
    open_fresh(browser, arm7_page)
    show_only(browser, layer)
    show_pose_marks(browser, False)
    held = arm7_view.scene.sheet.holds(np.array(spots))
    off, _ = spots_off(browser, arm7_view.scene.solid, np.array(spots)[held], colour)
    assert off.max() < 1.5


def test_a_spot_that_is_moved_by_20_mm_is_found(browser: Browser, arm7_view: View, tmp_path: Path) -> None:
    """The check above is no formality: with one spot drawn 20 mm beside its place it fails, for that spot alone, by 20 mm."""
    scene = arm7_view.scene
    spots = scene.data.spots.copy()
    places = spots.reshape(-1, 2)
    lonely = int(np.argmax(np.sort(np.linalg.norm(places[:, None] - places[None], axis=-1), axis=1)[:, 1]))
    moved = places.copy()
    moved[lonely] += (0.0, 0.02)
    view_of(scene.robot, scene.data.with_spots(moved.reshape(spots.shape)), scene.calibrated).write_html(tmp_path / "moved.html")
    browser.open(tmp_path / "moved.html")
    show_only(browser, "measured")
    show_pose_marks(browser, False)
    off, off_mm = spots_off(browser, scene.solid, places, MEASURED)
    assert np.count_nonzero(off >= 1.5) == 1
    assert off.max() > 4
    assert off_mm.max() == pytest.approx(20, abs=5)


def test_at_first_sight_everything_is_there(browser: Browser, arm7_page: Path, arm7_view: View) -> None:
    """Untouched, the page shows discs, both kinds of rings, arrows and two beams that end on the spots of the first pose."""
    open_fresh(browser, arm7_page)
    picture, scene = browser.picture(), arm7_view.scene
    for colour in (MEASURED, NOMINAL, CALIBRATED, *BEAMS):
        assert coloured(picture, colour).sum() > 40, f"colour {colour} is missing"
    source, spots = scene.shown.source[0], scene.shown.spots[0]
    for laser, colour in enumerate(BEAMS):
        shares = np.linspace(0.25, 0.9, 30)[:, None]
        line = in_root(scene.solid, source[laser] + shares * (np.array([0.0, *spots[laser]]) - source[laser]))
        at = np.round(pixels(browser, line)).astype(int)
        near = cv2.dilate(coloured(picture, colour, 60).astype(np.uint8), np.ones((5, 5)))
        assert near[at[:, 1], at[:, 0]].mean() > 0.8, f"beam {laser + 1} is not where it should be"


def test_beams_end_on_the_screen(browser: Browser, arm7_page: Path, arm7_view: View) -> None:
    """With the beams alone, the farthest coloured pixel along each is at the predicted spot."""
    open_fresh(browser, arm7_page)
    show_only(browser, "beams")
    picture, scene = browser.picture(), arm7_view.scene
    source, spots = scene.shown.source[0], scene.shown.spots[0]
    for laser, colour in enumerate(BEAMS):
        ends = pixels(browser, in_root(scene.solid, np.array([source[laser], [0.0, *spots[laser]]])))
        rows, columns = np.nonzero(coloured(picture, colour, 60))
        unit = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
        along = (np.column_stack([columns, rows]) + 0.5 - ends[0]) @ unit
        assert along.max() == pytest.approx(np.linalg.norm(ends[1] - ends[0]), abs=4)


def test_the_robot_is_where_its_links_are(browser: Browser, arm7_page: Path, arm7_view: View) -> None:
    """Without its box in the legend the robot is gone, and nothing changes outside the place where it stood."""
    open_fresh(browser, arm7_page)
    show_only(browser, "robot")
    show_pose_marks(browser, False)
    with_robot = browser.picture()
    show_only(browser)
    changed = np.abs(with_robot.astype(int) - browser.picture()).max(axis=-1) > 20
    q = whole_configurations(arm7_view.scene.solid, arm7_view.scene.data.q[:1])[0]
    corners = pixels(browser, arm7_view.shapes.corners(arm7_view.scene.solid, q))
    changed[:, :LEGEND_WIDTH] = False
    rows, columns = np.nonzero(changed)
    assert len(rows) > 400
    assert columns.min() >= corners[:, 0].min() - 3
    assert columns.max() <= corners[:, 0].max() + 3
    assert rows.min() >= corners[:, 1].min() - 3
    assert rows.max() <= corners[:, 1].max() + 3


def test_the_animation_goes_from_pose_to_pose(browser: Browser, arm7_page: Path, arm7_view: View) -> None:
    """meshcat's play moves the robot; its slider stops at a pose whose beams end on that pose's spots; the label says which."""
    open_fresh(browser, arm7_page)
    scene = arm7_view.scene
    show_only(browser, "robot", "beams")
    before = browser.picture()
    browser.run("viewer.gui.__folders.Animations.__folders.default.__controllers.find(c => c.property === 'play').fire(); 0")
    browser.wait_for("animator.time > 1.6")
    browser.run("viewer.gui.__folders.Animations.__folders.default.__controllers.find(c => c.property === 'pause').fire(); 0")
    assert np.count_nonzero(np.abs(browser.picture().astype(int) - before).max(axis=-1) > 40) > 300
    for pose in (4, 9):
        browser.run(f"animator.time_scrubber.setValue({pose + 1}); 0")
        picture = browser.picture()
        spots = pixels(browser, in_root(scene.solid, on_screen(scene.shown.spots[pose])))
        for laser, colour in enumerate(BEAMS):
            rows, columns = np.nonzero(coloured(picture, colour, 60))
            assert np.linalg.norm(np.column_stack([columns, rows]) - spots[laser], axis=1).min() < 5
        assert browser.run("document.getElementById('pose').selectedOptions[0].textContent") == scene.data.poses[pose]
        said = browser.run("[0, 1].map(laser => document.getElementById(`error-${laser}-0`).textContent)")
        np.testing.assert_allclose([float(word) for word in said], [row.phases[0][pose] for row in scene.compared], atol=0.06)


def test_a_pose_can_be_chosen_by_its_label(browser: Browser, robots: dict[str, Robot], tmp_path: Path) -> None:
    """In the panel and in the address; it plays from there, and meshcat's own controls stay folded beside it."""
    data, corrected = measured(robots["arm4"], 5)
    labels = ["home", "left & low", "right", "far", "near"]
    view_of(robots["arm4"], replace(data, poses=np.array(labels)), corrected).write_html(tmp_path / "arm4.html")
    browser.open((tmp_path / "arm4.html").as_uri() + "#pose=right")
    chosen = "document.getElementById('pose').value"
    assert browser.run(chosen) == "right"
    browser.run("document.getElementById('next').click()")
    assert browser.run(chosen) == "far"
    browser.run("document.getElementById('play').click()")
    assert browser.run("document.getElementById('play').textContent") == "Pause"
    browser.wait_for(f"{chosen} === 'near'")
    browser.run("document.getElementById('play').click()")
    assert browser.run("document.getElementById('play').textContent") == "Play"
    assert browser.run("[viewer.gui.closed, document.querySelectorAll('#panel select').length]") == [True, 1]
    assert "far" not in browser.run("viewer.gui.domElement.textContent")
    assert complaints(browser) == []


EVIL = [
    "<img src=x onerror=document.title='PWN'>",
    "a &amp; b",
    "</script><script>document.title='PWN'</script>",
    "'\"><svg onload=alert(1)>",
]


@pytest.mark.parametrize("sensor", ["spots", "point"])
def test_labels_of_poses_are_text(browser: Browser, robots: dict[str, Robot], sensor: str, tmp_path: Path) -> None:
    """Of lasers and trackers: one that is written like an element of HTML is shown as it is."""
    view = named_by(robots, sensor, EVIL)
    view.write_html(tmp_path / "labels.html")
    browser.open(tmp_path / "labels.html")
    chooser = "document.getElementById('pose')"
    assert browser.run(f"[...{chooser}.options].map(option => option.textContent)") == EVIL
    assert browser.run(f"{chooser}.querySelectorAll('img, svg, script').length") == 0
    browser.run("viewer.gui.open(); 0")
    for label in EVIL[1:] + EVIL[:1]:
        browser.run("document.getElementById('next').click()")
        assert browser.run(f"{chooser}.selectedOptions[0].textContent") == label
    assert browser.run("document.title") == f"{view.scene.robot.name} - urdfcal view"
    assert complaints(browser) == []


def named_by(robots: dict[str, Robot], sensor: str, labels: list[str]) -> View:
    """A few poses of spots, or of a tracker's points, with these labels."""
    if sensor == "spots":
        data, corrected = measured(robot_of(URDF), len(labels))
        return view_of(robot_of(URDF), replace(data, poses=np.array(labels)), corrected)
    rng = np.random.default_rng(1)
    setup = setup_of(SensorCase("ur5", ("point:tool0",)), {"ur5": without_meshes(robots["ur5"])}, rng)
    data = simulate_readings(setup, len(labels), rng)
    return view_of(setup.robot, replace(data, poses=np.array(labels)))


@pytest.mark.parametrize(
    "smuggled",
    [
        "<script>document.title = 'PWN'</script>",
        "<img src=x onerror=\"document.title = 'PWN'\">",
        "<svg onload=\"document.title = 'PWN'\"></svg>",
        '<iframe srcdoc="<script>parent.document.title = 1</script>"></iframe>',
        '<script src="data:text/javascript,document.title=1"></script>',
    ],
)
def test_what_is_smuggled_into_the_page_does_not_run(browser: Browser, arm7_page: Path, smuggled: str, tmp_path: Path) -> None:
    """The page's policy is a second wall: its own scripts draw the scene all the same."""
    page = arm7_page.read_text("utf-8").replace('<div id="trouble">', smuggled + '<div id="trouble">', 1)
    (tmp_path / "smuggled.html").write_text(page, "utf-8")
    browser.open(tmp_path / "smuggled.html")
    assert browser.run("document.title") == "arm7 - urdfcal view"
    assert any("Content Security Policy" in line for line in browser.console)
    assert coloured(browser.picture(), MEASURED).sum() > 50


def test_the_page_reaches_no_network(browser: Browser, arm7_page: Path) -> None:
    """Not even its own scripts do: neither requests, nor sockets, pictures, styles, workers or forms."""
    with PageServer(b"x", port=0) as other:
        open_fresh(browser, arm7_page)
        for attempt in (
            f"fetch('{other.url}').then(() => done('out'), () => done('kept'))",
            f"const p = new Image(); p.onload = () => done('out'); p.onerror = () => done('kept'); p.src = '{other.url}p.png'",
            f"const s = new WebSocket('{other.url}'.replace('http', 'ws')); s.onopen = () => done('out'); s.onerror = () => done('kept')",
            "const w = new Worker(URL.createObjectURL(new Blob(['postMessage(1)'])));"
            " w.onmessage = () => done('out'); w.onerror = () => done('kept')",
        ):
            browser.run("window.refused = 0; document.addEventListener('securitypolicyviolation', () => { window.refused++; })")
            guarded = f"new Promise(done => {{ try {{ {attempt} }} catch (error) {{ done('kept'); }} }})"
            assert browser.run(guarded) == "kept"
            assert browser.wait_for("window.refused")


def test_the_page_is_drawn_in_a_notebooks_frame(browser: Browser, arm7_view: View, tmp_path: Path) -> None:
    """The frame keeps it from the notebook around it, and it is drawn all the same."""
    (tmp_path / "cell.html").write_text(f"<!DOCTYPE html><body>{arm7_view._repr_html_()}</body>", "utf-8")
    browser.open(tmp_path / "cell.html", ready="Number(document.readyState === 'complete')")
    end = time.monotonic() + browser.patience
    while coloured(browser.picture(), MEASURED).sum() < 50:
        assert time.monotonic() < end, browser.console


@pytest.mark.parametrize(("element", "content"), [("urdfcal-config", '{"poses": NaN}'), ("urdfcal-scene", "AAAA"), ("urdfcal-config", "")])
def test_a_page_that_cannot_be_drawn_says_so(browser: Browser, arm7_page: Path, element: str, content: str, tmp_path: Path) -> None:
    """What is wrong with its numbers or its scene stands in the middle, instead of nothing."""
    page = re.sub(rf'(id="{element}">)[^<]*<', rf"\g<1>{content}<", arm7_page.read_text("utf-8"), count=1)
    (tmp_path / "broken.html").write_text(page, "utf-8")
    browser.open(tmp_path / "broken.html", ready="Number(document.getElementById('trouble')?.style.display === 'block')")
    assert browser.run("document.getElementById('trouble').textContent").startswith("This scene cannot be shown: ")


def test_textures_are_drawn(browser: Browser, tmp_path: Path) -> None:
    """A Collada file with its picture has the picture's colours, under the policy that lets no other in."""
    text = collada_square()
    cv2.imwrite(str(tmp_path / "t.png"), np.full((8, 8, 3), (40, 200, 20), np.uint8))
    (tmp_path / "a.dae").write_text(text)
    view_of(showing("a.dae", tmp_path)).write_html(tmp_path / "texture.html")
    browser.open(tmp_path / "texture.html")
    browser.run("new Promise(done => setTimeout(done, 300))")
    browser.run("viewer.set_dirty()")
    picture = browser.picture().astype(int)
    green = (picture[..., 1] > 90) & (picture[..., 1] > 2 * picture[..., 0]) & (picture[..., 1] > 2 * picture[..., 2])
    assert green.sum() > 500
    assert complaints(browser) == []


def collada_square() -> str:
    """A square of half a metre, seen from both sides, with a picture on it."""
    points = "-0.5 -0.5 0 0.5 -0.5 0 0.5 0.5 0 -0.5 0.5 0"
    source = (
        '<source id="{0}"><float_array id="{0}a" count="{1}">{2}</float_array><technique_common><accessor source="#{0}a" count="4" '
        'stride="{3}">{4}</accessor></technique_common></source>'
    )
    floats = ["".join(f'<param name="{name}" type="float"/>' for name in names) for names in ("XYZ", "ST")]
    sources = source.format("p", 12, points, 3, floats[0]) + source.format("t", 8, "0 0 1 0 1 1 0 1", 2, floats[1])
    corners = " ".join(f"{k} {k}" for k in (0, 1, 2, 0, 2, 3, 2, 1, 0, 3, 2, 0))
    return (
        '<?xml version="1.0"?><COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1"><asset/>'
        '<library_images><image id="i"><init_from>t.png</init_from></image></library_images>'
        '<library_effects><effect id="e"><profile_COMMON><newparam sid="s"><surface type="2D"><init_from>i</init_from></surface></newparam>'
        '<newparam sid="n"><sampler2D><source>s</source></sampler2D></newparam><technique sid="c"><lambert><diffuse>'
        '<texture texture="n" texcoord="U"/></diffuse></lambert></technique></profile_COMMON></effect></library_effects>'
        '<library_materials><material id="m"><instance_effect url="#e"/></material></library_materials>'
        f'<library_geometries><geometry id="g"><mesh>{sources}<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>'
        '<triangles count="4" material="k"><input semantic="VERTEX" source="#v" offset="0"/>'
        f'<input semantic="TEXCOORD" source="#t" offset="1" set="0"/><p>{corners}</p></triangles></mesh></geometry></library_geometries>'
        '<library_visual_scenes><visual_scene id="w"><node><instance_geometry url="#g"><bind_material><technique_common>'
        '<instance_material symbol="k" target="#m"><bind_vertex_input semantic="U" input_semantic="TEXCOORD" input_set="0"/>'
        "</instance_material></technique_common></bind_material></instance_geometry></node></visual_scene></library_visual_scenes>"
        '<scene><instance_visual_scene url="#w"/></scene></COLLADA>'
    )


def test_a_beam_that_misses_is_dashed(browser: Browser, tmp_path: Path) -> None:
    """A robot that points away from the screen has grey dashes in place of its beams; one that points at it has none."""
    robot = robot_of(URDF)
    q = np.array([[0.0, 0.0, 0.1], [0.0, 2.6, 0.1]])
    data = spots_measured(robot, q, np.full((2, 2, 2), np.nan), poses=["at it", "away"])
    view_of(robot, data).write_html(tmp_path / "miss.html")
    browser.open(tmp_path / "miss.html")
    show_only(browser, "beams")
    counts = []
    for pose in (1, 2):
        browser.run(f"goTo({pose - 1})")
        picture = browser.picture()
        counts.append([int(coloured(picture, colour, 30).sum()) for colour in (*BEAMS, MISSING)])
    assert counts[0][0] > 60
    assert counts[0][1] > 60
    assert counts[0][2] < 10
    assert counts[1][0] + counts[1][1] == 0
    assert counts[1][2] > 60


def test_targets_are_where_they_were_read(browser: Browser, robots: dict[str, Robot], tmp_path: Path) -> None:
    """Balls at the measured points and crosses at the predicted ones, by Pinocchio's frames; the pose's errors are the scene's."""
    rng = np.random.default_rng(8)
    setup = setup_of(SensorCase("ur5", ("pose:tool0",)), {"ur5": without_meshes(robots["ur5"])}, rng)
    data = simulate_readings(setup, 12, rng)
    text = with_origins(setup.robot.description, setup.errors.corrected_origins(setup.x))
    view = view_of(setup.robot, data, robot_from(replace(setup.robot.description, text=text)))
    view.write_html(tmp_path / "targets.html")
    browser.open(tmp_path / "targets.html")
    assert complaints(browser) == []
    scene, frames = view.scene, view.scene.solid.model.createData()
    for row in scene.compared:
        assert np.nanmax(row.phases[1]) < 1e-2
    pin.framesForwardKinematics(scene.solid.model, frames, whole_configurations(scene.solid, data.q[:1])[0])
    link = frames.oMf[scene.solid.model.getFrameId("tool0", pin.FrameType.BODY)]
    q = whole_configurations(scene.solid, data.q)
    on_link = link.actInv(frame_placements(scene.placed[1], q, data.q)[0].act(scene.groups["frame"].marks[0].predicted[0]))
    placed = []
    for configuration in q:
        pin.framesForwardKinematics(scene.solid.model, frames, configuration)
        placed.append(frames.oMf[scene.solid.model.getFrameId("tool0", pin.FrameType.BODY)].act(on_link))
    places = pixels(browser, np.array(placed))
    browser.run("show('frame/pose', false); show('solid', false); show('nominal', false)")
    for shown, colour in (("measured", MEASURED), ("calibrated", CALIBRATED)):
        browser.run(f"for (const n of ['measured', 'nominal', 'calibrated', 'error']) show('frame/marks/' + n, n === '{shown}')")
        off = distances_to_marks(coloured(browser.picture(), colour, 60), places)
        assert np.median(off) < 2  # some lie behind one another, and are one mark then
        assert np.sort(off)[-3] < 8
    for pose in (0, 5):
        browser.run(f"goTo({pose})")
        said = [float(browser.run(f"document.getElementById('error-{row}-0').textContent")) for row in (0, 1)]
        np.testing.assert_allclose(said, [row.phases[0][pose] for row in scene.compared], atol=0.01)


@pytest.mark.parametrize("name", [*ROBOTS, "small"])
def test_robot_beams_and_screen_are_in_view(browser: Browser, robots: dict[str, Robot], name: str, tmp_path: Path) -> None:
    """At first sight every robot, its lasers and the sheet are in the picture, right of the legend, and the console is empty.

    The Panda comes with its meshes; the others, for speed, as joints and the bars between them.
    """
    robot = robot_of(URDF) if name == "small" else robots[name] if name == "panda" else without_meshes(robots[name])
    view = view_of(robot)
    view.write_html(tmp_path / "page.html")
    browser.open(tmp_path / "page.html")
    picture, scene = browser.picture(), view.scene
    whole = whole_configurations(robot, scene.data.q[:1])[0]
    (left, low), (right, high) = scene.sheet.low, scene.sheet.high
    sheet = np.array([[0.0, y, z] for y in (left, right) for z in (low, high)])
    points = np.concatenate([view.shapes.corners(robot, whole), in_root(robot, np.concatenate([sheet, scene.shown.source[0]]), whole)])
    places = pixels(browser, points)
    legend = browser.run("document.getElementById('panel').getBoundingClientRect().right")
    assert places[:, 0].min() >= legend
    assert places[:, 0].max() <= WIDTH
    assert places[:, 1].min() >= 0
    assert places[:, 1].max() <= HEIGHT
    assert max(np.ptp(places[:, 0]) / (WIDTH - legend), np.ptp(places[:, 1]) / HEIGHT) > 0.7
    assert coloured(picture, BEAMS[0], 60).sum() > 20
    assert complaints(browser) == []


def test_the_served_page_is_the_same_and_needs_no_network(browser: Browser, arm7_view: View) -> None:
    """Over the live server the scene comes up as from a file; nothing but the page itself is asked for."""
    with arm7_view.serve(0) as server:
        browser.open(server.url)
        asked = browser.run("performance.getEntriesByType('resource').map(entry => entry.name).filter(name => !name.startsWith('data:'))")
        assert asked == []
        assert browser.run("viewer.scene_tree.find(['meshcat', 'solid']).object.visible") is True
    assert complaints(browser) == []


def test_a_small_window_folds_the_legend(browser: Browser, arm7_page: Path) -> None:
    """On a telephone the legend is folded, so that the scene is seen; one press brings it back."""
    browser.resize(420, 800)
    try:
        browser.open(arm7_page)
        assert browser.run("document.getElementById('panel').offsetHeight") < 80
        browser.run("document.getElementById('fold').click()")
        assert browser.run("document.getElementById('panel').offsetHeight") > 300
    finally:
        browser.resize(WIDTH, HEIGHT)


def test_beams_keep_their_colours_beside_uncalibrated_ones(browser: Browser, robots: dict[str, Robot], tmp_path: Path) -> None:
    """After a small calibration both run side by side: the uncalibrated ones hide little of the calibrated ones' colours."""
    robot = without_meshes(robots["ur5"])
    data, corrected = measured(robot, 3, 0.1)
    view_of(robot, data, corrected).write_html(tmp_path / "ur5.html")
    browser.open(tmp_path / "ur5.html")
    counts = []
    for wanted in (("beams",), ("beams", "nominal beams")):
        show_only(browser, *wanted)
        picture = browser.picture()
        counts.append([coloured(picture, colour, 30).sum() for colour in BEAMS])
    assert (np.array(counts[1]) > 0.9 * np.array(counts[0])).all()
