"""Where the screen is, from one simulated picture of it."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pinocchio as pin
import pytest

from tests.conftest import CliResult
from tests.support.helpers import assert_poses_close
from tests.support.vision_scenes import board_light, board_pictures, marker_light, picture, random_camera
from urdfcal.base.errors import InputError
from urdfcal.base.geometry import distance_mm_mrad
from urdfcal.sensors.camera import Camera, Side
from urdfcal.vision.camera.boards import Chessboard
from urdfcal.vision.camera.camera_file import camera_yaml, read_camera
from urdfcal.vision.camera.marker_search import find_markers
from urdfcal.vision.camera.markers import ScreenMarkers, read_screen_markers
from urdfcal.vision.camera.plane_pose import PlanePoints, fit_plane
from urdfcal.vision.camera.screen_pose import screen_from_board, screen_from_markers

CENTRES = {0: (0.55, 0.4), 1: (-0.55, 0.4), 2: (0.55, -0.4), 3: (-0.55, -0.4), 4: (0.0, 0.4)}
SIZE = (960, 720)
SCREEN_YAML = """dictionary: DICT_4X4_50
size_mm: 100
placement_mm: 0
side: {side}
markers: {{0: [550, 400], 1: [-550, 400], 2: [550, -400], 3: [-550, -400], 4: [0, 400]}}
"""
RunCli = Callable[..., CliResult]


def layout(side: Side = "front", placement: float = 0.0) -> ScreenMarkers:
    return ScreenMarkers("DICT_4X4_50", 0.1, CENTRES, side, placement)


def without_screen(camera: Camera) -> Camera:
    return replace(camera, T_camera_screen=None, side="front")


@pytest.mark.parametrize("side", ["front", "back"])
def test_the_screen_comes_back_from_either_side(side: Side) -> None:
    """Within a fraction of a millimetre and milliradian, though one marker is hidden and one is 25 mm off; both are named."""
    rng = np.random.default_rng(11)
    camera = random_camera(rng, side, size=SIZE)
    moved = {1: np.array([0.02, -0.015])}
    shown = picture(camera, marker_light(layout(side), moved, hidden=(2,)), rng)
    found = screen_from_markers(without_screen(camera), shown, layout(side), "screen.png")
    assert found.camera.side == side
    assert (sorted(found.used), found.hidden, found.unknown) == ([0, 3, 4], (2,), ())
    ((wrong, off),) = found.wrong
    assert wrong == 1
    np.testing.assert_allclose(off, moved[1], atol=1e-3)
    assert_poses_close(found.camera.T_camera_screen, camera.T_camera_screen, mm=1.0, mrad=1.0)
    assert found.fit.rms < 0.15


@pytest.mark.parametrize("side", ["front", "back"])
def test_corners_have_their_order_and_a_fraction_of_a_pixel(side: Side) -> None:
    """Corner 0 is at (+y, +z) of the centre from either side; the error is a few hundredths of a pixel."""
    rng = np.random.default_rng(12)
    camera = random_camera(rng, side, oblique_deg=35, size=SIZE)
    found = find_markers(picture(camera, marker_light(layout()), rng), layout(side), camera)
    assert sorted(marker.id for marker in found) == sorted(CENTRES)
    for marker in found:
        expected = camera.pixels_of_spots(layout().corners_of(marker.id)[:, 1:])
        np.testing.assert_allclose(marker.pixels, expected, atol=0.35)
    off = np.array([marker.pixels - camera.pixels_of_spots(layout().corners_of(marker.id)[:, 1:]) for marker in found])
    assert np.sqrt((off**2).mean()) < 0.1


def noisy_points(camera: Camera, rng: np.random.Generator, noise: float, placement: float) -> PlanePoints:
    """Corners of five markers put up with that accuracy, seen with that noise."""
    markers = layout()
    true, pixels = [], []
    for marker in CENTRES:
        points = markers.corners_of(marker)
        turn = rng.normal(0, placement / (markers.size / 2)) if placement else 0.0
        arms = points - points.mean(axis=0)
        shifted = points + [0, *rng.normal(0, placement, 2)] + turn * np.column_stack([0 * arms[:, 0], -arms[:, 2], arms[:, 1]])
        true.append(points)
        pixels.append(camera.pixels_of_spots(shifted[:, 1:]) + rng.normal(0, noise, (4, 2)))
    return PlanePoints(np.concatenate(true), np.concatenate(pixels), np.repeat(np.arange(5), 4), placement)


@pytest.mark.parametrize(("noise", "placement"), [(0.1, 0.0), (0.1, 1e-3), (0.5, 5e-4)])
def test_the_covariance_of_the_pose_is_right(noise: float, placement: float) -> None:
    """Over 24 random cameras the squared pose error is six times the covariance, neither more nor less."""
    normalised = []
    for seed in range(24):
        rng = np.random.default_rng(seed)
        camera = random_camera(rng, "front" if seed % 2 else "back", size=SIZE)
        fit = fit_plane(without_screen(camera), noisy_points(camera, rng, noise, placement))
        assert fit is not None
        xi = pin.log6(fit.T_camera_plane.actInv(camera.T_camera_screen)).vector
        normalised.append(xi @ np.linalg.solve(fit.covariance, xi) / 6)
    assert 0.7 < np.mean(normalised) < 1.45, np.sort(normalised)


def test_markers_put_up_by_hand_are_not_wrong() -> None:
    """Half a millimetre off is what screen.yaml says of every marker: none is left out, and the pose is as good as that allows."""
    rng = np.random.default_rng(13)
    camera = random_camera(rng, size=SIZE)
    moved = {marker: rng.normal(0, 5e-4, 2) for marker in CENTRES}
    found = screen_from_markers(without_screen(camera), picture(camera, marker_light(layout(), moved), rng), layout(placement=5e-4), "a")
    assert found.wrong == ()
    xi = pin.log6(found.camera.T_camera_screen.actInv(camera.T_camera_screen)).vector
    assert xi @ np.linalg.solve(found.fit.covariance, xi) < 22.5  # 99.9 %


@pytest.mark.parametrize("side", ["front", "back"])
@pytest.mark.parametrize("upright", [0.0, 60.0])
def test_a_chessboard_on_the_screen_will_do(side: Side, upright: float) -> None:
    """Its first corner is the one at the top left seen from the front, from whichever side, however the camera is rolled up to 90 deg."""
    rng = np.random.default_rng(14)
    camera = random_camera(rng, side, oblique_deg=35, size=SIZE)
    roll = pin.SE3(pin.exp3(np.array([0, 0, np.radians(upright)])), np.zeros(3))
    camera = replace(camera, T_camera_screen=roll * camera.T_camera_screen)
    board, origin = Chessboard(9, 6, 0.06), np.array([0.3, 0.2])
    shown = picture(camera, board_light(board, origin), rng)
    found = screen_from_board(without_screen(camera), shown, board, (0.3, 0.2), side, "screen.png")
    assert_poses_close(found.camera.T_camera_screen, camera.T_camera_screen, mm=2.5, mrad=1.5)
    assert found.camera.side == side


def test_what_cannot_decide_the_screen_is_refused() -> None:
    """One marker, none, markers seen from the other side, and two that contradict each other."""
    rng = np.random.default_rng(15)
    camera = random_camera(rng, oblique_deg=20, size=SIZE)
    lens, markers = without_screen(camera), layout()
    with pytest.raises(InputError, match=r"only one of the screen's markers \(3\).*expected 2 or more"):
        screen_from_markers(lens, picture(camera, marker_light(markers, hidden=(0, 1, 2, 4)), rng), markers, "screen.png")
    shown = picture(camera, marker_light(markers), rng)
    with pytest.raises(InputError, match=r"mirrored for a camera at the back.*side: front in screen.yaml"):
        screen_from_markers(lens, shown, layout("back"), "screen.png")
    with pytest.raises(InputError, match=r"none of the screen's markers but \[0, 1, 2, 3, 4\]"):
        screen_from_markers(lens, shown, replace(markers, centres={7: (0, 0), 8: (1, 0)}), "screen.png")
    two = replace(markers, centres={0: CENTRES[0], 1: (-0.35, 0.4)})
    with pytest.raises(InputError, match=r"markers .* contradict each other"):
        screen_from_markers(lens, shown, two, "screen.png")
    with pytest.raises(InputError, match="none of the screen's markers, expected 2"):
        screen_from_markers(lens, np.full(SIZE[::-1], 90, np.uint8), markers, "screen.png")


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Camera]:
    """A picture of the screen from the back, the lens as a file and the layout."""
    folder, rng = tmp_path_factory.mktemp("scene"), np.random.default_rng(16)
    camera = random_camera(rng, "back", oblique_deg=30, size=SIZE)
    (folder / "lens.yaml").write_bytes(camera_yaml(without_screen(camera)))
    (folder / "screen.yaml").write_text(SCREEN_YAML.format(side="back"), "utf-8")
    cv2.imwrite(str(folder / "screen.png"), picture(camera, marker_light(layout(), {4: np.array([0.0, 0.03])}), rng))
    return folder, camera


def test_a_screen_is_added_to_a_known_lens(run_cli: RunCli, scene: tuple[Path, Camera], tmp_path: Path) -> None:
    """`--lens` keeps the lens, adds the pose with its covariance, and names what is odd."""
    folder, truth = scene
    words = ("--lens", folder / "lens.yaml", "--screen", folder / "screen.png", "--markers", folder / "screen.yaml")
    done = run_cli("camera", *words, "-o", "camera.yaml", "--json")
    assert done.code == 0, done.err
    camera, machine = read_camera(tmp_path / "camera.yaml"), json.loads(done.out)
    np.testing.assert_array_equal(camera.matrix, truth.matrix)
    assert camera.side == machine["screen"]["side"] == "back"
    assert_poses_close(camera.T_camera_screen, truth.T_camera_screen, mm=0.6, mrad=0.6)
    assert "marker 4 is left out: it lies 30." in done.err
    np.testing.assert_allclose(camera.screen_covariance, machine["screen"]["covariance"])
    off_mm, _ = distance_mm_mrad(camera.T_camera_screen, truth.T_camera_screen)
    assert off_mm < 4e3 * np.sqrt(np.trace(camera.screen_covariance[:3, :3]))
    spoken = run_cli("camera", *words, "-o", "again.yaml")
    assert "screen seen from the back, by 4 markers (0, 1, 2, 3)" in spoken.out


def test_lens_and_screen_in_one_go(run_cli: RunCli, tmp_path: Path) -> None:
    """Views of a board and a picture of the screen, all by one camera, give the whole camera.yaml."""
    rng, size = np.random.default_rng(17), (640, 480)
    camera, board = random_camera(rng, oblique_deg=30, size=size), Chessboard(9, 6, 0.025)
    for index, made in enumerate(board_pictures(camera, board, 9, rng)):
        cv2.imwrite(str(tmp_path / f"view{index}.png"), made)
    cv2.imwrite(str(tmp_path / "screen.png"), picture(camera, marker_light(layout()), rng))
    (tmp_path / "screen.yaml").write_text(SCREEN_YAML.format(side="front"), "utf-8")
    words = ("camera", "view*.png", "--board", "9x6:25mm", "--screen", "screen.png", "--markers", "screen.yaml", "-o", "camera.yaml")
    done = run_cli(*words)
    assert done.code == 0, done.err
    found = read_camera(tmp_path / "camera.yaml")
    spots = rng.uniform(-0.4, 0.4, (30, 2))
    off = found.spots_of_pixels(camera.pixels_of_spots(spots)) - spots
    assert np.sqrt((off**2).mean()) < 1e-3, off
    assert "plain lens from 9 views" in done.out
    assert "screen seen from the front, by 5 markers" in done.out


def test_a_screen_picture_that_will_not_do_is_refused(run_cli: RunCli, scene: tuple[Path, Camera], tmp_path: Path) -> None:
    """Another size than the lens's, no picture, no board: one line, exit 2, nothing written."""
    folder, _ = scene
    cv2.imwrite(str(tmp_path / "small.png"), np.zeros((240, 320), np.uint8))
    cv2.imwrite(str(tmp_path / "empty.png"), np.full(SIZE[::-1], 90, np.uint8))
    (tmp_path / "text.png").write_text("none", "utf-8")
    markers = ("--markers", folder / "screen.yaml")
    board = ("--screen-board", "9x6:60mm", "--board-origin", "300,200")
    for name, on_it, complaint in (
        ("small.png", markers, "small.png: is 320 x 240 px, expected 960 x 720 px as"),
        ("text.png", markers, "text.png: is not readable as a picture"),
        ("missing.png", markers, "missing.png: cannot be read"),
        ("empty.png", markers, "empty.png: shows none of the screen's markers"),
        ("empty.png", board, "empty.png: no chessboard with 9 x 6 inner corners found"),
        ("empty.png", (*board[:3], "300"), "--board-origin 300: expected Y,Z in mm"),
    ):
        done = run_cli("camera", "--lens", folder / "lens.yaml", "--screen", name, *on_it, "-o", "camera.yaml")
        assert (done.code, done.out, done.err.count("\n")) == (2, "", 1), done.err
        assert complaint in done.err
        assert not (tmp_path / "camera.yaml").exists()


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("DICT_4X4_50", "DICT_4X4_5", "'DICT_4X4_5' is unknown; did you mean 'DICT_4X4_50'"),
        ("size_mm: 100", "size_mm: -1", "entry 'size_mm'"),
        ("size_mm: 100\n", "", "entry 'size_mm' is missing"),
        ("size_mm: 100", "size: 100", "entry 'size' is unknown; did you mean 'size_mm'|entry 'size_mm' is missing"),
        ("4: [0, 400]", "50: [0, 400]", "marker 50 is not in DICT_4X4_50, which has 0 to 49"),
        ("4: [0, 400]", "4: [500, 400]", "markers 0 and 4 lie upon each other"),
        ("4: [0, 400]", "4: [0]", r"entry 'markers.4"),
        ("4: [0, 400]", "3: [0, 400]", "entry '3' stands twice"),
        ("side: front", "side: top", "entry 'side'"),
    ],
)
def test_a_broken_layout_is_refused_by_name(old: str, new: str, words: str, tmp_path: Path) -> None:
    """File, line and entry."""
    path, text = tmp_path / "screen.yaml", SCREEN_YAML.format(side="front")
    assert old in text
    path.write_text(text.replace(old, new), "utf-8")
    with pytest.raises(InputError, match=words) as refusal:
        read_screen_markers(path)
    assert str(refusal.value).startswith(str(path))


def test_a_layout_is_read_in_metres(tmp_path: Path) -> None:
    """Corner 0 of a marker is at (+y, +z) of its centre, and corners go around clockwise seen from the front."""
    path = tmp_path / "screen.yaml"
    path.write_text(SCREEN_YAML.format(side="front"), "utf-8")
    markers = read_screen_markers(path)
    assert markers.centres == CENTRES
    np.testing.assert_allclose(markers.corners_of(0), [[0, 0.6, 0.45], [0, 0.5, 0.45], [0, 0.5, 0.35], [0, 0.6, 0.35]], atol=1e-12)
