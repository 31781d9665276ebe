"""The camera's geometry and its file."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pinocchio as pin
import pytest

from tests.support.helpers import assert_poses_close, central_differences
from tests.support.vision_scenes import random_camera
from urdfcal.base.errors import InputError, ShapeMismatch, UsageError
from urdfcal.sensors.camera import Camera
from urdfcal.sensors.lenses import intrinsic_names, projected, unprojected, unprojected_grid, widest_tangent
from urdfcal.vision.camera.camera_file import camera_yaml, read_camera

MATRIX = np.array([[800.0, 0, 640], [0, 805, 360], [0, 0, 1]])
LENSES = {
    "plain": np.array([-0.25, 0.06, 1e-3, -5e-4, 0.01]),
    "rational": np.array([0.1, -0.02, 1e-3, 5e-4, 0.01, 0.35, -0.01, 0.02]),
    "fisheye": np.array([-0.02, 0.01, -3e-3, 5e-4]),
}


def camera_with(lens: str) -> Camera:
    return replace(random_camera(np.random.default_rng(3)), size=(1280, 720), matrix=MATRIX, distortion=LENSES[lens], lens=lens)


def pixels_of(camera: Camera, count: int = 200) -> np.ndarray:
    return np.random.default_rng(1).uniform(0, np.array(camera.size) * 0.999, (count, 2))


@pytest.mark.parametrize("lens", LENSES)
def test_project_takes_a_pixels_ray_back_to_it(lens: str) -> None:
    """Rays are the inverse of project, everywhere in the picture, and have unit length."""
    camera, pixels = camera_with(lens), pixels_of(camera_with(lens))
    rays = camera.rays(pixels)
    np.testing.assert_allclose(np.linalg.norm(rays, axis=1), 1.0, atol=1e-12)
    np.testing.assert_allclose(camera.project(rays * 2.5), pixels, atol=1e-6)


@pytest.mark.parametrize("lens", ["plain", "rational"])
def test_rays_agree_with_opencv(lens: str) -> None:
    """OpenCV's undistortion, iterated to the end, has the same rays."""
    camera, pixels = camera_with(lens), pixels_of(camera_with(lens))
    criteria = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 500, 1e-12)
    undistort = getattr(cv2, "undistortPointsIter", None)  # OpenCV 4; a keyword of undistortPoints in OpenCV 5
    expected = (
        undistort(pixels[:, None], camera.matrix, camera.distortion, np.eye(3), np.eye(3), criteria)
        if undistort
        else cv2.undistortPoints(pixels[:, None], camera.matrix, camera.distortion, criteria=criteria)
    )[:, 0]
    rays = camera.rays(pixels)
    np.testing.assert_allclose(rays[:, :2] / rays[:, 2:], expected, atol=1e-8)


@pytest.mark.parametrize("lens", LENSES)
def test_jacobians_are_the_derivatives(lens: str) -> None:
    """By the point, by the lens and by the pixel, against central differences."""
    camera = camera_with(lens)
    pixels = pixels_of(camera, 8)
    points = camera.rays(pixels) * 2.0
    by_point = central_differences(lambda shift: camera.project(points + shift), np.zeros(3), 1e-6)
    np.testing.assert_allclose(camera.project_jacobian(points), by_point, atol=1e-4)
    by_pixel = central_differences(lambda shift: camera.spots_of_pixels(pixels + shift), np.zeros(2), 1e-3)
    np.testing.assert_allclose(camera.spot_jacobian(pixels), by_pixel, atol=1e-8)

    def moved(lens_numbers: np.ndarray) -> np.ndarray:
        fx, fy, cx, cy, *distortion = lens_numbers
        return projected(points, np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]]), np.array(distortion), camera.lens)[0]

    numbers = np.concatenate([MATRIX[[0, 1, 0, 1], [0, 1, 2, 2]], camera.distortion])
    by_lens = projected(points, MATRIX, camera.distortion, camera.lens)[2]
    np.testing.assert_allclose(by_lens, central_differences(moved, numbers, 1e-6), rtol=1e-6, atol=1e-5)


def test_spots_and_pixels_are_inverse() -> None:
    """A spot's pixel leads back to the spot, from the front and from the back."""
    for side in ("front", "back"):
        camera = random_camera(np.random.default_rng(5), side)
        spots = np.random.default_rng(6).uniform(-0.7, 0.7, (50, 2))
        np.testing.assert_allclose(camera.spots_of_pixels(camera.pixels_of_spots(spots)), spots, atol=1e-9)


@pytest.mark.parametrize("lens", LENSES)
@pytest.mark.parametrize(("beyond", "step"), [(500, 7.0), (0, 4.0), (-300, 0.9)], ids=["turning back", "picture", "parts of pixels"])
def test_the_rays_of_a_grid_are_those_of_its_pixels(lens: str, beyond: float, step: float) -> None:
    """Projected again, the rays of pixels, or of parts of pixels, are within 2e-4 px of them, also far out where a lens turns back."""
    camera = camera_with(lens)
    u, v = (np.arange(-beyond, size + beyond, step) for size in camera.size)
    one_by_one = unprojected(np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2), MATRIX, camera.distortion, camera.lens)
    grid = unprojected_grid(u, v, MATRIX, camera.distortion, camera.lens)
    assert grid.shape == (len(v), len(u), 3)
    np.testing.assert_array_equal(np.isnan(grid).reshape(-1, 3)[:, 0], np.isnan(one_by_one)[:, 0])
    again = camera.project(grid.reshape(-1, 3)).reshape(len(v), len(u), 2)
    off = np.abs(again - np.stack(np.meshgrid(u, v), axis=-1))
    assert np.nanmax(off) < 2e-4


def test_the_spots_of_a_grid_are_those_of_its_pixels() -> None:
    """Also where the camera looks past the screen's horizon, in which part there is no spot."""
    camera = random_camera(np.random.default_rng(5), "front", oblique_deg=1.0)
    turned = replace(camera, T_camera_screen=pin.SE3(pin.exp3(np.array([0.0, 1.45, 0.0])), np.zeros(3)) * camera.T_camera_screen)
    u, v = np.arange(camera.size[0]) + 0.0, np.arange(100, 200) + 0.0
    spots = turned.spots_of_grid(u, v)
    expected = turned.spots_of_pixels(np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)).reshape(spots.shape)
    assert 0.2 < np.isnan(expected).mean() < 0.9
    np.testing.assert_array_equal(np.isnan(spots), np.isnan(expected))
    near = np.abs(expected).max(axis=-1) < 10
    np.testing.assert_allclose(spots[near], expected[near], atol=1e-5)


def test_left_is_plus_y_from_the_front_and_right_from_the_back() -> None:
    """+y appears at the left and +z at the top from the front; from the back +y is at the right."""
    for side, sign in (("front", -1), ("back", 1)):
        camera = random_camera(np.random.default_rng(5), side, oblique_deg=1.0)
        origin, left, up = camera.pixels_of_spots(np.array([[0, 0], [0.3, 0], [0, 0.3]]))
        assert np.sign(left[0] - origin[0]) == sign
        assert up[1] < origin[1]
        centre = camera.T_camera_screen.actInv(np.zeros(3))
        assert np.sign(centre[0]) == sign


def test_nothing_is_seen_behind_the_camera_or_where_the_lens_turns_back() -> None:
    """Beyond the range of the lens model a point is nan; OpenCV would put it into the picture."""
    camera = replace(camera_with("plain"), distortion=np.array([-0.3, 0, 0, 0, 0]))
    assert widest_tangent(tuple(camera.distortion), "plain") == pytest.approx(np.sqrt(1 / 0.9))
    far = np.array([[1.6, 0.0, 1.0], [0.0, 0.0, -1.0], [0.1, 0.0, 1.0]])
    assert np.isfinite(camera.project(far)).all(axis=1).tolist() == [False, False, True]
    by_opencv = cv2.projectPoints(far[:1], np.zeros(3), np.zeros(3), MATRIX, camera.distortion)[0].ravel()
    assert (by_opencv < camera.size).all()
    corner = np.array([[10_000.0, 10_000.0]])
    assert np.isnan(camera.rays(corner)).all()
    assert np.isnan(camera.spot_jacobian(corner)).all()


def test_a_camera_without_a_screen_says_so() -> None:
    """Spots need a screen; distortion must fit the lens."""
    camera = replace(camera_with("plain"), T_camera_screen=None)
    with pytest.raises(UsageError, match="knows no screen"):
        camera.pixels_of_spots(np.zeros((1, 2)))
    with pytest.raises(ShapeMismatch, match="8 distortion numbers"):
        replace(camera, lens="rational")


@pytest.mark.parametrize("lens", LENSES)
def test_a_camera_comes_back_from_its_file(lens: str, tmp_path: Path, rng: np.random.Generator) -> None:
    """Everything that is written is read again, to the last digit that counts."""
    size = len(intrinsic_names(camera_with(lens).lens))
    root = rng.normal(size=(size, size))
    camera = replace(
        camera_with(lens), side="back", rms=0.2, lens_covariance=root @ root.T, screen_rms=0.1, screen_covariance=np.eye(6) * 1e-6
    )
    path = tmp_path / "camera.yaml"
    path.write_bytes(camera_yaml(camera, {"command": "urdfcal camera"}))
    again = read_camera(path)
    np.testing.assert_array_equal(again.matrix, camera.matrix)
    np.testing.assert_array_equal(again.distortion, camera.distortion)
    np.testing.assert_array_equal(again.lens_covariance, camera.lens_covariance)
    np.testing.assert_array_equal(again.screen_covariance, camera.screen_covariance)
    assert (again.size, again.lens, again.side, again.rms, again.screen_rms) == (camera.size, lens, "back", 0.2, 0.1)
    assert_poses_close(again.T_camera_screen, camera.T_camera_screen, mm=1e-9, mrad=1e-9)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("lens: plain", "lens: round", "entry 'lens'"),
        ("fx: 800.0", "fx: -800.0", "expected positive"),
        ("fx: 800.0", "fz: 800.0", "a plain lens has fx, fy"),
        ("fx: 800.0", "fx: .nan", "entry 'intrinsics.fx'"),
        ("size_px: [1280, 720]", "size_px: [1280]", "entry 'size_px"),
        ("side: front", "side: left", "entry 'screen.side'"),
        ("intrinsics:", "numbers:", "is no camera"),
        ("rpy: [", "rpy: [1.0, ", "entry 'screen.rpy"),
    ],
)
def test_a_broken_camera_file_is_refused_by_name(old: str, new: str, words: str, tmp_path: Path) -> None:
    """One line that names the file and the entry."""
    text = camera_yaml(camera_with("plain")).decode()
    assert old in text
    path = tmp_path / "camera.yaml"
    path.write_text(text.replace(old, new), "utf-8")
    with pytest.raises(InputError, match=words) as refusal:
        read_camera(path)
    assert str(refusal.value).startswith(str(path))
    assert "\n" not in str(refusal.value)


def test_se3_of_the_screen_is_a_rotation() -> None:
    """The scenes' cameras are proper placements (no mirror in space, from either side)."""
    for side in ("front", "back"):
        rotation = random_camera(np.random.default_rng(8), side).T_camera_screen.rotation
        assert np.linalg.det(rotation) == pytest.approx(1.0)
        np.testing.assert_allclose(pin.exp3(pin.log3(rotation)), rotation, atol=1e-12)


ROS = """\
image_width: 640
image_height: 480
camera_name: eye
camera_matrix: {rows: 3, cols: 3, data: [535.9, 0, 342.3, 0, 536.0, 235.6, 0, 0, 1]}
distortion_model: MODEL
distortion_coefficients: {rows: 1, cols: 5, data: NUMBERS}
rectification_matrix: {rows: 3, cols: 3, data: [1, 0, 0, 0, 1, 0, 0, 0, 1]}
"""
ECHOED = """\
width: 640
height: 480
distortion_model: MODEL
d: NUMBERS
k: [535.9, 0.0, 342.3, 0.0, 536.0, 235.6, 0.0, 0.0, 1.0]
binning_x: 0
"""
PLAIN = "size_px: [640, 480]\nintrinsics: {fx: 535.9, fy: 536.0, cx: 342.3, cy: 235.6}\n"


@pytest.mark.parametrize("text", [ROS, ECHOED], ids=["file", "echoed"])
@pytest.mark.parametrize(
    ("model", "numbers"),
    [
        ("plumb_bob", [-0.27, -0.04, 0.0018, -0.0003, 0.24]),
        ("plumb_bob", [-0.27, -0.04, 0.0018, -0.0003]),
        ("plumb_bob", []),
        ("''", []),
        ("rational_polynomial", [-0.27, -0.04, 0.0018, -0.0003, 0.24, 0.1, 0.02, 0.003]),
    ],
)
def test_ros_and_its_numbers_put_points_where_opencv_does(text: str, model: str, numbers: list[float], tmp_path: Path) -> None:
    """What camera_info says of a lens is the camera whose pixels OpenCV computes from the same numbers."""
    path = tmp_path / "info.yaml"
    path.write_text(text.replace("MODEL", model).replace("NUMBERS", str(numbers)))
    matrix = np.array([[535.9, 0, 342.3], [0, 536.0, 235.6], [0, 0, 1]])
    points = np.array([[0.1, -0.2, 1.0], [-0.3, 0.1, 1.2]])
    by_opencv = cv2.projectPoints(points, np.zeros(3), np.zeros(3), matrix, np.array(numbers) if numbers else None)[0][:, 0]
    camera = read_camera(path)
    np.testing.assert_allclose(camera.project(points), by_opencv, atol=1e-9)
    assert camera.size == (640, 480)


def test_what_opencv_writes_of_a_camera_is_read(tmp_path: Path) -> None:
    """A FileStorage of OpenCV, with its own first line and tags, and a fisheye of ROS, are the cameras that they are."""
    path, matrix = tmp_path / "camera.yml", np.array([[535.9, 0, 342.3], [0, 536.0, 235.6], [0, 0, 1]])
    stored = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    stored.write("image_width", 640)
    stored.write("image_height", 480)
    stored.write("camera_matrix", matrix)
    stored.write("distortion_coefficients", np.array([[-0.27, -0.04, 0.0018, -0.0003, 0.24]]))
    stored.release()
    camera = read_camera(path)
    np.testing.assert_array_equal(camera.matrix, matrix)
    np.testing.assert_array_equal(camera.distortion, [-0.27, -0.04, 0.0018, -0.0003, 0.24])
    path.write_text(ROS.replace("MODEL", "equidistant").replace("NUMBERS", "[0.1, 0.01, 0.02, 0.003]"))
    assert read_camera(path).lens == "fisheye"


def test_a_camera_without_distortion_is_a_pinhole(tmp_path: Path) -> None:
    """Numbers of the distortion that nobody wrote are zero: pixels are (fx X / Z + cx, fy Y / Z + cy)."""
    path = tmp_path / "camera.yaml"
    path.write_text(PLAIN)
    point = np.array([[0.2, -0.1, 1.6]])
    np.testing.assert_allclose(read_camera(path).project(point), [[535.9 / 8 + 342.3, -536.0 / 16 + 235.6]], atol=1e-9)
    path.write_text(PLAIN.replace("235.6}", "235.6, k1: -0.2}"))
    assert read_camera(path).distortion.tolist() == [-0.2, 0, 0, 0, 0]


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("plumb_bob", "double_sphere", "found 'double_sphere', expected plumb_bob, rational_polynomial"),
        ("[0.1]", "[0.1, 0, 0, 0, 0, 0.2]", "6 coefficients, of which a plain lens has 5"),
        ("[0.1]", "[a]", "'distortion_coefficients': expected numbers"),
        ("535.9, 0, 342.3", "535.9, 2, 342.3", r"expected \[fx, 0, cx"),
        ("535.9, 0, 342.3", "535.9, 342.3", "expected 9 numbers, found 8"),
        ("image_width", "image_wide", "has no entries 'image_width'"),
        ("camera_name: eye", "binning_x: 2", "not binned"),
        ("image_width: 640", "image_width: wide", "'image_width': found 'wide', expected a whole number"),
    ],
)
def test_a_broken_camera_info_is_refused_by_name(old: str, new: str, words: str, tmp_path: Path) -> None:
    """One line that names the file, the entry, what was found and what is expected."""
    text = ROS.replace("MODEL", "plumb_bob").replace("NUMBERS", "[0.1]")
    assert old in text
    path = tmp_path / "info.yaml"
    path.write_text(text.replace(old, new))
    with pytest.raises(InputError, match=words) as refusal:
        read_camera(path)
    assert str(refusal.value).startswith(str(path))
