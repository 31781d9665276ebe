"""Simulated pictures: spots where the camera's geometry has them, light that adds up, and the whole line from render to spots."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.conftest import CliResult
from tests.support.paths import ROBOTS_DIR
from tests.support.vision_scene import camera
from urdfcal.sensors.camera import Camera
from urdfcal.vision.camera.camera_file import camera_yaml
from urdfcal.vision.camera.markers import ScreenMarkers
from urdfcal.vision.render.image_sensor import ImageSensor
from urdfcal.vision.render.light import Beam, Lighting, backdrop, spot_light
from urdfcal.vision.render.pictures import in_picture
from urdfcal.vision.render.usual_camera import usual_camera

ARM = ROBOTS_DIR / "arm7" / "arm7.urdf.xacro"
SQUARELY = np.array([1.0, 0.0, 0.0])


@pytest.mark.parametrize("spot", [(0.0, 0.0), (0.13, -0.09), (-0.2, 0.11)])
def test_the_light_s_centroid_is_the_projected_spot(spot: tuple[float, float]) -> None:
    """The centroid of the rendered light is the spot's projection through the lens, to a hundredth of a pixel."""
    view = camera(oblique_deg=45.0, k1=-0.25)
    light, rows, columns = spot_light(view, np.array(spot), SQUARELY, Beam()) or pytest.fail("no light")
    red = light[..., 0]
    u, v = np.meshgrid(np.arange(columns.start, columns.stop), np.arange(rows.start, rows.stop))
    centroid = np.array([(red * u).sum(), (red * v).sum()]) / red.sum()
    assert centroid == pytest.approx(view.pixels_of_spots(np.array([spot]))[0], abs=0.01)


def test_a_spot_s_light_is_its_area() -> None:
    """The sum of the pixels is brightness times 2 pi width^2 in pixels: a pixel integrates, and a slanted beam keeps its light."""
    view = camera(oblique_deg=0.0, k1=0.0)
    for direction in (SQUARELY, np.array([np.cos(0.9), np.sin(0.9), 0.0])):
        light, _, _ = spot_light(view, np.zeros(2), direction, Beam(brightness=0.5, width=2e-3)) or pytest.fail("no light")
        metres = np.sqrt(np.linalg.det(view.spot_jacobian(view.pixels_of_spots(np.zeros((1, 2))))[0]))
        assert light[..., 0].sum() == pytest.approx(0.5 * 2 * np.pi * (2e-3 / metres) ** 2, rel=0.02)


def test_markers_are_seen_where_they_are() -> None:
    """OpenCV's detector finds the rendered markers, with their corners where the lens puts them."""
    markers = ScreenMarkers("DICT_4X4_50", 0.1, {0: (0.2, 0.12), 3: (-0.15, -0.1)})
    view = camera(size=(640, 480), oblique_deg=35.0)
    pixels = ImageSensor().expose(backdrop(view, Lighting(0.4), markers), np.random.default_rng(0))
    detector = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50))
    corners, ids, _ = detector.detectMarkers(cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY))
    assert sorted(np.ravel(ids)) == [0, 3]
    for found, marker in zip(corners, np.ravel(ids), strict=True):
        expected = view.pixels_of_spots(markers.corners_of(int(marker))[:, 1:])
        assert np.abs(found[0] - expected).max() < 1.5


def test_the_sensor_s_noise_is_what_is_stated() -> None:
    """Mean and standard deviation of a flat picture are those of shot and read noise, and light beyond full scale clips."""
    sensor = ImageSensor(well=10000, read=12, uneven=0, black=0.01)
    pixels = sensor.expose(np.full((200, 200, 3), 0.4), np.random.default_rng(0)).astype(float)
    assert pixels.mean() == pytest.approx(255 * 0.41, abs=0.05)
    assert pixels.std() == pytest.approx(255 * np.sqrt(4000 + 144) / 10000, rel=0.03)
    assert (sensor.expose(np.full((5, 5, 3), 3.0), np.random.default_rng(0)) == 255).all()


def arm_camera() -> Camera:
    """A small camera that sees the arm's whole screen."""
    return camera(size=(480, 360), oblique_deg=20.0, mm_per_px=5.0, k1=-0.1)


def test_simulate_render_spots(tmp_path: Path, run_cli: Callable[..., CliResult]) -> None:
    """The rendered spots of simulated measurements come back: each of the right laser, within a millimetre or so, none false."""
    (tmp_path / "camera.yaml").write_bytes(camera_yaml(arm_camera()))
    errors = ROBOTS_DIR / "arm7" / "errors.yaml"
    done = run_cli("simulate", ARM, "-o", "m.csv", "--poses", "8", "--errors", errors, "--spot-noise-mm", "0", "--screen-size-m", "1.2")
    assert done.code == 0, done.err
    look = ("--spot-mm", "16", "--missing", "0.1", "--frames", "2")
    done = run_cli("render", ARM, "m.csv", "--camera", "camera.yaml", "-o", "pics", *look, "--dark", "dark.png", "--seed", "3")
    assert done.code == 0, done.err
    assert len(list((tmp_path / "pics").glob("*.png"))) == 16
    done = run_cli(
        *("spots", "pics", "--camera", "camera.yaml", "--robot", ARM, "--poses", "m.csv", "--dark", "dark.png"),
        *("-o", "found.csv", "--pixels", "--debug", "seen", "--json"),
    )
    assert done.code == 0, done.err
    assert len(list((tmp_path / "seen").glob("*.jpg"))) == 16
    truth = np.genfromtxt(tmp_path / "pics" / "truth.csv", delimiter=",", names=True, skip_header=1, deletechars="")
    found = np.genfromtxt(tmp_path / "found.csv", delimiter=",", names=True, skip_header=1, deletechars="")
    both = 0
    for laser in ("laser_1", "laser_2"):
        for axis in "yz":
            there = np.isfinite(found[f"{laser}.{axis}"])
            assert not (there & np.isnan(truth[f"{laser}.{axis}"])).any()
            off = (found[f"{laser}.{axis}"] - truth[f"{laser}.{axis}"])[there]
            assert np.abs(off).max() < 1.5e-3
            assert (np.abs(off) < 5 * found[f"{laser}.sigma"][there]).all()
            both += int(there.sum())
    assert both >= 20
    assert run_cli("evaluate", ARM, "found.csv", "-q").code == 0


def test_a_calibrated_robot_shows_its_own_spots(tmp_path: Path, run_cli: Callable[..., CliResult]) -> None:
    """With the truth of a simulation as calibration, poses alone give the spots that the simulation measured without noise."""
    (tmp_path / "camera.yaml").write_bytes(camera_yaml(arm_camera()))
    run_cli("simulate", ARM, "-o", "m.csv", "--poses", "3", "--spot-noise-mm", "0", "--screen-size-m", "1.2")
    assert run_cli("render", ARM, "m.csv", "--camera", "camera.yaml", "-o", "measured").code == 0
    done = run_cli("render", ARM, "m.csv", "--camera", "camera.yaml", "-o", "modelled", "--calibrated", "m_truth.yaml")
    assert done.code == 0, done.err
    one, other = ((tmp_path / folder / "truth.csv").read_text().splitlines()[2:] for folder in ("measured", "modelled"))
    for a, b in zip(one, other, strict=True):
        assert [float(x) for x in a.split(",") if x] == pytest.approx([float(x) for x in b.split(",") if x], abs=1e-6)


def test_without_a_camera_one_is_placed(tmp_path: Path, run_cli: Callable[..., CliResult]) -> None:
    """A camera that sees all spots is put in front of the screen and written beside the pictures; spots are found through it."""
    run_cli("simulate", ARM, "-o", "m.csv", "--poses", "2", "--spot-noise-mm", "0")
    done = run_cli("render", ARM, "m.csv", "-o", "pics")
    assert (done.code, "4 spots" in done.out, "camera.yaml" in done.out) == (0, True, True)
    done = run_cli("spots", "pics", "--camera", "pics/camera.yaml", "--robot", ARM, "--poses", "m.csv", "-o", "found.csv")
    assert done.code == 0, done.err
    truth, found = (np.genfromtxt(tmp_path / name, delimiter=",", names=True, skip_header=1) for name in ("pics/truth.csv", "found.csv"))
    off = found["laser_1y"] - truth["laser_1y"]
    assert np.nanmax(np.abs(off)) < 1e-3


@pytest.mark.parametrize("far", [0.1, 1.0, 30.0])
def test_the_usual_camera_sees_everything(far: float, rng: np.random.Generator) -> None:
    """All spots lie inside the picture and fill a good part of it, however large the screen is."""
    spots = np.vstack([rng.uniform(-far, far, (40, 2)) + far, [np.nan, np.nan]])
    view = usual_camera(spots)
    pixels = view.pixels_of_spots(spots[:-1])
    size = np.array(view.size)
    assert (pixels > 0).all()
    assert (pixels < size - 1).all()
    assert np.ptp(pixels, axis=0).max() > (0.15 if far < 0.2 else 0.4) * size.min()


def test_the_usual_camera_is_placed_for_most_spots(rng: np.random.Generator) -> None:
    """One spot far off does not take the camera away from the rest, and markers are seen beside the spots."""
    spots = rng.uniform(-0.5, 0.5, (20, 2))
    near, marks = usual_camera(spots), np.array([[2.0, 1.0], [-2.0, -1.0]])
    far_off = usual_camera(np.vstack([spots, [300.0, 20.0]]))
    assert far_off.pixels_of_spots(spots) == pytest.approx(near.pixels_of_spots(spots))
    assert in_picture(near, marks).tolist() == [False, False]
    assert in_picture(usual_camera(spots, marks), np.vstack([spots, marks])).all()


@pytest.mark.usefixtures("small_pictures")
def test_spots_that_no_picture_shows_are_counted(tmp_path: Path, run_cli: Callable[..., CliResult]) -> None:
    """Beams beside the screen, as stated or as the URDF draws it, make no spot, and are counted; so are tiny spots, and those outside."""
    joints = ",".join(f"joint{k}" for k in range(1, 8))
    rows = [",".join(["0"] * 7 + spots) for spots in (["0.1", "0", "-0.1", "0"], ["0.2", "0.1", "0.9", "0"], ["0", "0.1", "200", "0"])]
    (tmp_path / "m.csv").write_text(f"{joints},laser_1.y,laser_1.z,laser_2.y,laser_2.z\n" + "\n".join(rows) + "\n")
    (tmp_path / "screen.yaml").write_text("dictionary: DICT_4X4_50\nsize_mm: 100\nmarkers: {0: [400, 300], 1: [-400, -300]}\n")
    done = run_cli("render", ARM, "m.csv", "-o", "pics", "--screen-size-m", "1", "--markers", "screen.yaml")
    assert (done.code, done.err) == (0, "urdfcal: warning: not shown of 6 spots: 2 beside the screen\n")
    grey = cv2.imread(str(tmp_path / "pics" / "1.png"), cv2.IMREAD_GRAYSCALE)
    detector = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50))
    assert sorted(np.ravel(detector.detectMarkers(grey)[1])) == [0, 1]
    done = run_cli("render", ARM, "m.csv", "-o", "more", "--spot-mm", "0.5")
    assert (done.code, "not shown of 6 spots: 1 beside the screen, 1 outside of the picture" in done.err) == (0, True)
    assert "4 of 4 spots are under 1 px wide" in done.err


def test_positions_a_full_turn_away_are_rendered_where_they_are(tmp_path: Path, run_cli: Callable[..., CliResult]) -> None:
    """Poses counted from 0 to 360 deg show the spots that the same poses show, with one warning."""
    run_cli("simulate", ARM, "-o", "m.csv", "--poses", "3", "--spot-noise-mm", "0")
    q = np.genfromtxt(tmp_path / "m.csv", delimiter=",", skip_header=5)[:, 1:8]
    truth = {}
    for name, angles in (("same", np.degrees(q)), ("counted", np.degrees(q) % 360)):
        head = ",".join(f"joint{k} [deg]" for k in range(1, 8))
        np.savetxt(tmp_path / f"{name}.csv", angles, fmt="%.12g", delimiter=",", header=head, comments="")
        done = run_cli("render", ARM, f"{name}.csv", "-o", name)
        assert (done.code, "a full turn or more outside the limits" in done.err) == (0, name == "counted"), done.err
        truth[name] = np.genfromtxt(tmp_path / name / "truth.csv", delimiter=",", skip_header=2)
    np.testing.assert_allclose(truth["same"], truth["counted"], atol=1e-9)


BAD = {
    "degrees": (("render", ARM, "deg.csv", "-o", "pics"), "deg.csv:2: column 'joint2': 1 of 1 cells lie outside the limits"),
    "no spot": (("render", ARM, "off.csv", "-o", "pics"), "no beam meets the screen in these poses"),
    "no camera": (("render", ARM, "m.csv", "--camera", "none.yaml", "-o", "pics"), "none.yaml: cannot be read"),
    "no poses": (("render", ARM, "none.csv", "--camera", "camera.yaml", "-o", "pics"), "none.csv: cannot be read"),
    "colour": (
        ("render", ARM, "m.csv", "--camera", "camera.yaml", "-o", "pics", "--colours", "rad"),
        "no laser colour 'rad'; did you mean 'red'?",
    ),
    "number of colours": (
        ("render", ARM, "m.csv", "-o", "pics", "--colours", "red,red,red"),
        "--colours red,red,red: 3 colours for 2 lasers",
    ),
    "dark jpg": (("render", ARM, "m.csv", "-o", "pics", "--dark", "dark.jpg"), "--dark dark.jpg: ends in '.jpg', expected .png"),
    "side": (
        ("render", ARM, "m.csv", "--camera", "camera.yaml", "--markers", "back.yaml", "-o", "pics"),
        "back.yaml: side back, but camera.yaml looks from the front",
    ),
    "usual side": (
        ("render", ARM, "m.csv", "--markers", "back.yaml", "-o", "pics"),
        "back.yaml: side back, but the camera without --camera looks from the front",
    ),
    "share": (
        ("render", ARM, "m.csv", "--camera", "camera.yaml", "-o", "pics", "--missing", "2"),
        "--missing 2: expected a number from 0 to 1",
    ),
    "full folder": (("render", ARM, "m.csv", "--camera", "camera.yaml", "-o", "."), "is not empty"),
    "no joint": (("render", ARM, "q.csv", "--camera", "camera.yaml", "-o", "pics"), "q.csv:1: column 'joint1': is missing"),
    "no images": (("spots", "empty", "--camera", "camera.yaml", "-o", "f.csv"), "empty: holds no picture"),
    "missing image": (("spots", "a.png", "--camera", "camera.yaml", "-o", "f.csv"), "a.png: does not exist"),
    "unreadable": (("spots", "broken.png", "--camera", "camera.yaml", "-o", "f.csv"), "broken.png: cannot be read as a picture"),
    "size": (("spots", "small.png", "--camera", "camera.yaml", "-o", "f.csv"), "small.png: is 30 x 20 px, expected the camera's 480 x 360"),
    "grey": (("spots", "grey.png", "--pixels", "-o", "f.csv"), "grey.png: is grey: without colour a spot looks like a lamp"),
    "nothing asked": (("spots", "small.png", "-o", "f.csv"), "spots need --camera CAMERA.yaml"),
    "frames": (("spots", "small.png", "--pixels", "--frames", "two", "-o", "f.csv"), "--frames two: expected auto, one or named"),
    "colours": (("spots", "small.png", "--pixels", "--colours", "red,red,red", "-o", "f.csv"), "3 colours for 2 lasers"),
    "no row": (
        ("spots", "small.png", "--pixels", "--poses", "image.csv", "-o", "f.csv"),
        "image.csv:1: column 'image': no row(s) for the picture small.png",
    ),
    "other number": (
        ("spots", "small.png", "--pixels", "--robot", ARM, "--lasers", "3", "-o", "f.csv"),
        "--lasers 3: the robot has 2: laser_1 and laser_2",
    ),
    "other number of names": (("spots", "small.png", "--pixels", "--laser", "a", "--lasers", "2", "-o", "f.csv"), "--laser names 1: a"),
    "no robot": (("spots", "small.png", "--pixels", "--screen", "wall", "-o", "f.csv"), "--screen, --xacro-arg and --package-dir are"),
    "size without camera": (("spots", "small.png", "--pixels", "--screen-size-m", "2", "-o", "f.csv"), "--screen-size-m needs --camera"),
    "no screen": (("spots", "small.png", "--camera", "lens.yaml", "-o", "f.csv"), "the camera knows no screen"),
}


@pytest.mark.parametrize(("words", "said"), BAD.values(), ids=BAD)
def test_bad_input_is_one_line(words: tuple[str | Path, ...], said: str, tmp_path: Path, run_cli: Callable[..., CliResult]) -> None:
    """Bad input is refused with exit code 2, one line that says what and where, and nothing written."""
    from dataclasses import replace

    (tmp_path / "camera.yaml").write_bytes(camera_yaml(arm_camera()))
    (tmp_path / "lens.yaml").write_bytes(camera_yaml(replace(arm_camera(), size=(30, 20), T_camera_screen=None)))
    (tmp_path / "back.yaml").write_text("dictionary: DICT_4X4_50\nsize_mm: 100\nside: back\nmarkers: {0: [400, 300]}\n")
    (tmp_path / "empty").mkdir()
    (tmp_path / "broken.png").write_bytes(b"\x89PNG no more")
    rng = np.random.default_rng(0)
    cv2.imwrite(str(tmp_path / "small.png"), rng.integers(0, 255, (20, 30, 3)).astype(np.uint8))
    cv2.imwrite(str(tmp_path / "grey.png"), rng.integers(0, 255, (20, 30)).astype(np.uint8))
    (tmp_path / "q.csv").write_text("pose,q\na,1\n")
    (tmp_path / "image.csv").write_text("image,q\nother.png,1\n")
    (tmp_path / "m.csv").write_text("pose," + ",".join(f"joint{k}" for k in range(1, 8)) + "\na" + ",0" * 7 + "\n")
    (tmp_path / "deg.csv").write_text("pose," + ",".join(f"joint{k}" for k in range(1, 8)) + "\na,0,30" + ",0" * 5 + "\n")
    (tmp_path / "off.csv").write_text("pose," + ",".join(f"joint{k}" for k in range(1, 8)) + "\na,-3.1" + ",0" * 6 + "\n")
    before = sorted(tmp_path.rglob("*"))
    done = run_cli(*words)
    assert (done.code, done.err.count("\n")) == (2, 1), done.err
    assert said in done.err
    assert sorted(tmp_path.rglob("*")) == before


def two_pictures(folder: Path, ending: str = ".png", names: tuple[str, ...] = ("p1", "p2"), colours: str = "red,red") -> list[Path]:
    """Pictures of two spots each, the first laser's on the left."""
    from tests.support.vision_scene import shot

    folder.mkdir(exist_ok=True)
    rng, looks = np.random.default_rng(2), [Beam(colour) for colour in colours.split(",")]
    for name in names:
        cv2.imwrite(str(folder / f"{name}{ending}"), shot(camera(), [(120.0, 90.0), (300.0, 200.0)], looks, rng)[0])
    return [folder / f"{name}{ending}" for name in names]


@pytest.mark.parametrize("debug", ["shots", "shots/seen", "elsewhere"])
def test_drawings_fall_on_no_picture(debug: str, tmp_path: Path, run_cli: Callable[..., CliResult]) -> None:
    """Drawings are refused where pictures are looked for, and where one would fall on a file of the command: nothing is written."""
    pictures = two_pictures(tmp_path / "shots", ".jpg")
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "elsewhere" / "p1.jpg").symlink_to(pictures[0])
    before = {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    done = run_cli("spots", "shots", "--pixels", "-o", "f.csv", "--debug", debug)
    assert (done.code, done.err.count("\n"), f"--debug {debug}: " in done.err) == (2, 1, True), done.err
    assert {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()} == before
    assert run_cli("spots", "shots", "--pixels", "-o", "f.csv", "--debug", "seen").code == 0


def test_pictures_of_render_find_their_poses_again(tmp_path: Path, run_cli: Callable[..., CliResult]) -> None:
    """Labels that no file can be named after come back from the pictures' names, in whatever order, and stand in the measurements."""
    (tmp_path / "camera.yaml").write_bytes(camera_yaml(arm_camera()))
    run_cli("simulate", ARM, "-o", "m.csv", "--poses", "3", "--spot-noise-mm", "0", "--screen-size-m", "1.2")
    labels = ["z home/pose", "b far", "1st one"]
    header, *body = [line for line in (tmp_path / "m.csv").read_text().splitlines() if not line.startswith("#")]
    start = header.split(",").index("pose")
    assert start == 0
    rows = [f"{label},{line.split(',', 1)[1]}" for label, line in zip(labels, body, strict=True)]
    (tmp_path / "m.csv").write_text("\n".join([header, *rows]) + "\n")
    assert run_cli("render", ARM, "m.csv", "--camera", "camera.yaml", "-o", "pics", "--spot-mm", "16").code == 0
    done = run_cli("spots", "pics", "--camera", "camera.yaml", "--robot", ARM, "--poses", "m.csv", "-o", "found.csv")
    assert (done.code, "joined by order" in done.err) == (0, False), done.err
    found = {line.split(",")[0]: line.split(",")[1:8] for line in (tmp_path / "found.csv").read_text().splitlines()[2:]}
    assert found == {label: line.split(",")[1:8] for label, line in zip(labels, rows, strict=True)}


def test_a_robot_without_a_camera_cannot_tell_like_lasers_apart(tmp_path: Path, run_cli: Callable[..., CliResult]) -> None:
    """Spots of one colour in pixels alone are refused with --robot, unless their order is stated; two colours tell the lasers apart."""
    two_pictures(tmp_path / "like")
    two_pictures(tmp_path / "unlike", colours="green,red")
    words = ("--pixels", "--robot", ARM, "-o", "f.csv")
    done = run_cli("spots", "like", *words)
    assert (done.code, done.err.count("\n")) == (2, 1), done.err
    assert "pixels and one colour do not say which spot is whose of laser_1 and laser_2" in done.err
    assert not (tmp_path / "f.csv").exists()
    assert run_cli("spots", "like", *words, "--order", "right-left").code == 0
    assert (tmp_path / "f.csv").read_text().splitlines()[2].split(",")[1].startswith("300.")
    assert run_cli("spots", "unlike", *words, "--overwrite").code == 0
    assert (tmp_path / "f.csv").read_text().splitlines()[2].split(",")[1].startswith("300.")


def test_pixels_alone_need_no_camera(tmp_path: Path, run_cli: Callable[..., CliResult]) -> None:
    """Plain pictures give `.u .v .sigma_px`, and a picture with nothing in it an empty row."""
    from tests.support.vision_scene import shot

    rng = np.random.default_rng(2)
    pixels, truth = shot(camera(), [(120.0, 90.0), (300.0, 200.0)], [Beam(), Beam()], rng)
    cv2.imwrite(str(tmp_path / "p1.png"), pixels)
    cv2.imwrite(str(tmp_path / "p2.png"), shot(camera(), [], [], rng)[0])
    done = run_cli("spots", "p1.png", "p2.png", "--pixels", "-o", "f.csv")
    assert done.code == 0, done.err
    _, header, first, second = (tmp_path / "f.csv").read_text().splitlines()
    assert header == "pose,laser_1.u,laser_1.v,laser_1.sigma_px,laser_2.u,laser_2.v,laser_2.sigma_px"
    cells = first.split(",")
    assert [float(cells[k]) for k in (1, 2, 4, 5)] == pytest.approx([*truth[0], *truth[1]], abs=0.2)
    assert second == "p2" + "," * 6
