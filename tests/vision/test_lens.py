"""Boards in pictures, and the lens that they show."""

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
from tests.support.paths import SHARED_DATA
from tests.support.vision_scenes import FRONT_VIEW, board_light, board_pictures, picture, random_camera
from urdfcal.base.errors import InputError, UsageError
from urdfcal.sensors.camera import Camera
from urdfcal.vision.camera.boards import BoardView, Chessboard, parse_charuco, parse_chessboard
from urdfcal.vision.camera.camera_file import read_camera
from urdfcal.vision.camera.lens import calibrate_lens
from urdfcal.vision.pictures import picture_files, read_grey

BOARD = Chessboard(9, 6, 0.025)
PHOTOGRAPHS = SHARED_DATA / "opencv_chessboard"
RunCli = Callable[..., CliResult]


def simulated_views(camera: Camera, count: int, noise: float, rng: np.random.Generator) -> list[BoardView]:
    """Corners of tilted boards all over the picture, with Gaussian noise [px]."""
    views: list[BoardView] = []
    middle = BOARD.points.mean(axis=0)
    while len(views) < count:
        turn = pin.exp3(np.radians([1, 1, 0.4]) * rng.uniform(-40, 40, 3))
        place = np.array([*rng.uniform(-0.18, 0.18, 2) * 520 / camera.matrix[0, 0], rng.uniform(0.2, 0.4)])
        pixels = camera.project((BOARD.points - middle) @ turn.T + place)
        if np.isfinite(pixels).all() and (pixels > 0).all() and (pixels < camera.size).all():
            views.append(BoardView(f"view{len(views)}", BOARD.points, pixels + rng.normal(0, noise, pixels.shape)))
    return views


def true_camera(lens: str = "plain") -> Camera:
    distortion = {
        "plain": np.array([-0.2, 0.05, 1e-3, -5e-4, 0.0]),
        "rational": np.array([0.3, 0.02, 5e-4, -5e-4, 0.002, 0.6, 0.1, 0.01]),
        "fisheye": np.array([-0.05, 0.02, -0.01, 0.002]),
    }[lens]
    focal = 300.0 if lens == "rational" else 520.0  # a denominator is needed where the lens is wide
    return Camera((800, 600), np.array([[focal, 0, 405], [0, focal + 2, 297], [0, 0, 1]]), distortion, lens)


def numbers_of(camera: Camera) -> np.ndarray:
    return np.concatenate([camera.matrix[[0, 1, 0, 1], [0, 1, 2, 2]], camera.distortion])


@pytest.fixture(scope="module")
def views_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Six simulated pictures of a board."""
    folder, rng = tmp_path_factory.mktemp("views"), np.random.default_rng(4)
    camera = replace(random_camera(rng, size=(640, 480)))
    for index, made in enumerate(board_pictures(camera, BOARD, 6, rng)):
        cv2.imwrite(str(folder / f"view{index}.png"), made)
    return folder


@pytest.mark.parametrize("lens", ["plain", "rational", "fisheye"])
def test_the_lens_comes_back_within_its_sigmas(lens: str) -> None:
    """Over ten sets of views the squared error is what the covariance says, and the RMS is the noise.

    Of the rational model's distortion only combinations are determined; its first four numbers are compared.
    """
    truth, normalised, rms = true_camera(lens), [], []
    for seed in range(10):
        views = simulated_views(truth, 14, 0.1, np.random.default_rng(seed))
        found = calibrate_lens(views, truth.size, lens).camera
        chosen = slice(0, 4 if lens == "rational" else None)
        off = (numbers_of(found) - numbers_of(truth))[chosen]
        normalised.append(off @ np.linalg.solve(found.lens_covariance[chosen, chosen], off) / len(off))
        rms.append(found.rms)
    assert 0.5 < np.mean(normalised) < 1.9, normalised
    assert np.mean(rms) == pytest.approx(0.1 * np.sqrt(2), rel=0.06)


def test_the_sigmas_are_opencvs() -> None:
    """Our covariance, poses eliminated, has the standard deviations of calibrateCameraExtended."""
    truth = true_camera()
    views = simulated_views(truth, 12, 0.2, np.random.default_rng(1))
    fit = calibrate_lens(views, truth.size, "plain")
    points, pixels = [view.points.astype(np.float32) for view in views], [view.pixels.astype(np.float32) for view in views]
    blank = np.zeros((3, 3)), np.zeros(5)
    rms, matrix, _, _, _, sigma, _, by_view = cv2.calibrateCameraExtended(points, pixels, truth.size, *blank)
    assert fit.camera.rms == pytest.approx(rms, rel=1e-4)
    np.testing.assert_allclose(fit.camera.matrix, matrix, atol=0.02)
    np.testing.assert_allclose(np.sqrt(np.diag(fit.camera.lens_covariance)), sigma.ravel()[:9], rtol=0.03)
    np.testing.assert_allclose(fit.view_rms, by_view.ravel(), rtol=1e-3)


@pytest.mark.parametrize("lens", ["plain", "rational"])
def test_the_model_is_chosen_by_evidence(lens: str) -> None:
    """Views by a plain lens give a plain lens, views by a lens that needs the denominator a rational one."""
    truth = true_camera(lens)
    for seed in range(4):
        fit = calibrate_lens(simulated_views(truth, 14, 0.1, np.random.default_rng(seed)), truth.size)
        assert fit.camera.lens == lens, fit.bic


def test_a_view_that_does_not_fit_is_left_out_and_named() -> None:
    """A view with corners in the wrong order, and one of a bent board, do not touch the lens."""
    truth = true_camera()
    views = simulated_views(truth, 14, 0.1, np.random.default_rng(2))
    clean = calibrate_lens(views[2:], truth.size, "plain")
    bent = views[0].pixels + 3 * np.sin(views[0].points[:, :1] * 30)
    spoilt = [BoardView("bent", BOARD.points, bent), BoardView("shifted", BOARD.points, np.roll(views[1].pixels, 1, axis=0)), *views[2:]]
    fit = calibrate_lens(spoilt, truth.size, "plain")
    assert {name for name, _ in fit.dropped} == {"bent", "shifted"}
    np.testing.assert_allclose(fit.camera.matrix, clean.camera.matrix, atol=1e-3)
    assert not clean.dropped


def unlike_views(truth: Camera, seed: int, count: int = 15) -> list[BoardView]:
    """Views of unlike sharpness: the noise of each is drawn, log-normal about 0.1 px."""
    rng = np.random.default_rng(seed)
    views = simulated_views(truth, count, 0.0, rng)
    noise = 0.1 * np.exp(rng.normal(0, 0.6, count))
    return [replace(view, pixels=view.pixels + rng.normal(0, own, view.pixels.shape)) for view, own in zip(views, noise, strict=True)]


def test_views_that_are_less_sharp_are_kept_and_weigh_less() -> None:
    """None of 12 sets of 15 loses a view, the errors are what the sigmas say, and these are smaller than with all views alike."""
    truth, normalised, gained = true_camera(), [], []
    for seed in range(12):
        views = unlike_views(truth, seed)
        fit = calibrate_lens(views, truth.size, "plain")
        assert not fit.dropped
        off = numbers_of(fit.camera) - numbers_of(truth)
        normalised.append(off @ np.linalg.solve(fit.camera.lens_covariance, off) / len(off))
        points, pixels = [view.points.astype(np.float32) for view in views], [view.pixels.astype(np.float32) for view in views]
        alike = cv2.calibrateCameraExtended(points, pixels, truth.size, np.zeros((3, 3)), np.zeros(5))[5].ravel()
        gained.append(alike[0] / np.sqrt(fit.camera.lens_covariance[0, 0]))
    assert 0.5 < np.mean(normalised) < 1.9, normalised
    assert np.median(gained) > 1.1


def test_sigmas_hold_where_corners_of_a_view_are_off_together() -> None:
    """Views that are bent by 0.15 px each in its own way: the squared error is what the widened covariance says, and is not without."""
    truth, widened, bare = true_camera(), [], []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        u = BOARD.points[:, :2] / BOARD.points[:, :2].max(axis=0) * 2 - 1
        fields = np.column_stack([u[:, 0] ** 2, u[:, 1] ** 2, u[:, 0] * u[:, 1], u[:, 0] ** 3, u[:, 1] ** 3])
        views = [replace(view, pixels=view.pixels + fields @ rng.normal(0, 0.15, (5, 2))) for view in simulated_views(truth, 15, 0.05, rng)]
        fit = calibrate_lens(views, truth.size, "plain")
        off = numbers_of(fit.camera) - numbers_of(truth)
        widened.append(off @ np.linalg.solve(fit.camera.lens_covariance, off) / len(off))
        bare.append(widened[-1] * fit.excess)
    assert 0.3 < np.mean(widened) < 2.0, widened
    assert np.mean(bare) > 3


def test_the_weighed_optimum_is_scipys() -> None:
    """A general optimiser over lens and poses, each view's residual over its own noise, ends at the same lens."""
    from scipy.optimize import least_squares

    truth = true_camera()
    fit = calibrate_lens(unlike_views(truth, 3, 8), truth.size, "plain")
    scales = fit.view_rms / np.sqrt(2)
    start = np.concatenate([numbers_of(fit.camera) * (1 + 1e-4), *[pin.log6(pose).vector for pose in fit.poses]])

    def residuals(x: np.ndarray) -> np.ndarray:
        lens = replace(truth, matrix=np.array([[x[0], 0, x[2]], [0, x[1], x[3]], [0, 0, 1]]), distortion=x[4:9])
        poses = [pin.exp6(part) for part in x[9:].reshape(-1, 6)]
        seen = [lens.project(view.points @ pose.rotation.T + pose.translation) for view, pose in zip(fit.views, poses, strict=True)]
        return np.concatenate([((a - v.pixels) / s).ravel() for a, v, s in zip(seen, fit.views, scales, strict=True)])

    found = least_squares(residuals, start, x_scale="jac", xtol=1e-12, ftol=1e-12).x[:9]
    sigma = np.sqrt(np.diag(fit.camera.lens_covariance))
    assert np.abs((found - numbers_of(fit.camera)) / sigma).max() < 0.1


def test_corners_are_found_to_a_fraction_of_a_pixel(rng: np.random.Generator) -> None:
    """On simulated pictures with distortion, tilt, blur and noise."""
    camera = random_camera(rng, oblique_deg=40, size=(640, 480))
    origin = np.array([0.45, 0.25])
    board = Chessboard(9, 6, 0.1)
    found = board.find(picture(camera, board_light(board, origin), rng), "view")
    assert isinstance(found, BoardView)
    truth = camera.pixels_of_spots(origin - board.points[:, :2])
    nearest = np.linalg.norm(found.pixels[:, None] - truth[None], axis=2).min(axis=1)
    assert np.sqrt((nearest**2).mean()) < 0.06
    assert nearest.max() < 0.25


def test_a_part_of_a_larger_board_is_no_board(rng: np.random.Generator) -> None:
    """OpenCV finds 8 x 6 corners on a board of 9 x 6; we say that it goes on."""
    camera = random_camera(rng, oblique_deg=30, size=(640, 480))
    shown = picture(camera, board_light(Chessboard(9, 6, 0.1), np.array([0.45, 0.25]), rim=0.4), rng)
    assert "goes on beyond 8 x 6" in str(Chessboard(8, 6, 0.1).find(shown, "view"))
    assert "no chessboard with 9 x 7" in str(Chessboard(9, 7, 0.1).find(shown, "view"))
    assert isinstance(Chessboard(6, 9, 0.1).find(shown, "view"), BoardView)


def test_a_charuco_board_may_be_seen_in_part() -> None:
    """The corners of half a board have the same points as on the whole."""
    board = parse_charuco("7x5:40mm:30mm")
    drawn = board.opencv_board().generateImage((1400, 1000))
    whole, half = board.find(drawn, "whole"), board.find(np.ascontiguousarray(drawn[:, :700]), "half")
    assert isinstance(whole, BoardView)
    assert isinstance(half, BoardView)
    assert (len(whole.pixels), len(half.pixels)) == (24, 8)
    np.testing.assert_allclose(whole.pixels, whole.points[:, :2] / 0.04 * 200 - 0.5, atol=0.3)
    np.testing.assert_allclose(half.pixels, half.points[:, :2] / 0.04 * 200 - 0.5, atol=0.3)
    assert "no ChArUco board" in str(board.find(np.full_like(drawn, 255), "empty"))
    assert "only" in str(board.find(np.ascontiguousarray(drawn[:500, :500]), "corner"))


def test_an_old_charuco_board_is_understood() -> None:
    """Boards with an even number of rows, printed before OpenCV 4.6, begin with the other colour."""
    board = parse_charuco("5x4:40mm:30mm")
    for legacy in (False, True):
        found = board.find(board.opencv_board(legacy).generateImage((1000, 800)), "view")
        assert isinstance(found, BoardView)
        np.testing.assert_allclose(found.pixels, found.points[:, :2] / 0.04 * 200 - 0.5, atol=0.3)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("9x6", "expected COLUMNSxROWS:SQUARE"),
        ("2x6:25mm", "expected 3 to 100"),
        ("9x6:0mm", "0 mm, expected"),
        ("9*6:25mm", "counting inner corners"),
    ],
)
def test_a_board_that_is_none_is_refused(text: str, words: str) -> None:
    """With the form that is expected."""
    with pytest.raises(UsageError, match=words):
        parse_chessboard(text)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("7x5:30mm:40mm", "smaller than its square"),
        ("7x5:40mm:30mm:DICT_4X4_5", "no dictionary"),
        ("7x5:40mm", "expected COLUMNSxROWS:SQUARE:MARKER"),
        ("20x20:40mm:30mm", "too few markers"),
    ],
)
def test_a_charuco_board_that_is_none_is_refused(text: str, words: str) -> None:
    """With the form that is expected."""
    with pytest.raises(UsageError, match=words):
        parse_charuco(text)


def test_units_of_a_board() -> None:
    """Millimetres unless stated otherwise."""
    assert parse_chessboard("9x6:25") == parse_chessboard("9x6:2.5cm") == parse_chessboard("9x6:0.025m") == BOARD


def test_too_few_or_senseless_views_are_refused() -> None:
    """Two views are none; noise is no lens."""
    truth, rng = true_camera(), np.random.default_rng(0)
    with pytest.raises(InputError, match="2 views show the board, expected 3"):
        calibrate_lens(simulated_views(truth, 2, 0.1, rng), truth.size)
    with pytest.raises(InputError, match=r"no plain lens explains|lens's axis|expected under"):
        calibrate_lens([BoardView(str(index), BOARD.points, rng.uniform(0, 600, (54, 2))) for index in range(4)], truth.size, "plain")


def test_camera_writes_what_it_found(run_cli: RunCli, views_folder: Path, tmp_path: Path) -> None:
    """From pictures to camera.yaml; the JSON has the same numbers."""
    done = run_cli("camera", views_folder, "--board", "9x6:25mm", "-o", "camera.yaml", "--json")
    assert done.code == 0, done.err
    machine, stored = json.loads(done.out), read_camera(tmp_path / "camera.yaml")
    assert machine["intrinsics"]["fx"] == stored.matrix[0, 0]
    assert len(machine["views"]) == 6
    assert stored.size == (640, 480)
    assert stored.T_camera_screen is None
    truth = random_camera(np.random.default_rng(4), size=(640, 480))
    sigma = np.sqrt(np.diag(stored.lens_covariance))
    assert np.abs(stored.matrix[0, 0] - truth.matrix[0, 0]) < 4 * sigma[0]
    assert "only 6 views" in done.err
    spoken = run_cli("camera", f"{views_folder}/*.png", "--board", "9x6:25mm", "-o", "camera.yaml")
    ruled = [line for line in spoken.out.splitlines() if max(map(line.count, "─━-")) > 20]
    assert max(map(len, ruled), default=0) <= 80
    assert "plain lens from 6 views, 324 corners" in spoken.out
    assert "wrote camera.yaml" in spoken.out


def test_a_view_without_a_board_is_named(run_cli: RunCli, views_folder: Path, tmp_path: Path) -> None:
    """The others decide."""
    cv2.imwrite(str(tmp_path / "empty.png"), np.full((480, 640), 90, np.uint8))
    done = run_cli("camera", views_folder, "empty.png", "--board", "9x6:25mm", "-o", "camera.yaml")
    assert done.code == 0
    assert "warning: empty.png: left out, no chessboard with 9 x 6 inner corners found" in done.err


def refused(done: CliResult, tmp_path: Path, *words: str) -> None:
    """One line, exit 2, nothing written."""
    assert (done.code, done.out) == (2, "")
    assert done.err.count("\n") == 1, done.err
    assert not (tmp_path / "camera.yaml").exists()
    for word in words:
        assert word in done.err


def test_broken_views_are_refused_in_one_line(run_cli: RunCli, views_folder: Path, tmp_path: Path) -> None:
    """No board, wrong size of board, unreadable picture, empty folder, no match, other size of picture."""
    options = ("--board", "9x6:25mm", "-o", "camera.yaml")
    (tmp_path / "none").mkdir()
    refused(run_cli("camera", "none", *options), tmp_path, "none: the folder holds no picture")
    refused(run_cli("camera", "none/*.png", *options), tmp_path, "none/*.png: no file matches")
    refused(run_cli("camera", "nowhere", *options), tmp_path, "nowhere: no such file or folder")
    (tmp_path / "broken.png").write_bytes((views_folder / "view0.png").read_bytes()[:60])
    refused(run_cli("camera", views_folder, "broken.png", *options), tmp_path, "broken.png: is not readable as a picture")
    (tmp_path / "text.jpg").write_text("no picture", "utf-8")
    refused(run_cli("camera", "text.jpg", *options), tmp_path, "text.jpg: is not readable as a picture")
    cv2.imwrite(str(tmp_path / "small.png"), np.zeros((240, 320), np.uint8))
    refused(run_cli("camera", views_folder, "small.png", *options), tmp_path, "small.png: is 320 x 240 px, expected 640 x 480 px as")
    for index in range(3):
        cv2.imwrite(str(tmp_path / f"none/empty{index}.png"), np.full((240, 320), 90, np.uint8))
    refused(run_cli("camera", "none", *options), tmp_path, "none of 3 pictures show the board", "no chessboard with 9 x 6", "and 2 more")
    refused(
        run_cli("camera", f"{views_folder}/view[0-2].png", "--board", "8x6:25mm", "-o", "camera.yaml"),
        tmp_path,
        "shows 9 x 6: is it --board 9x6:25mm?",
    )


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (("views",), "say which board"),
        (("views", "--board", "9x6:25mm", "--charuco", "7x5:40mm:30mm"), "say which board"),
        (("--board", "9x6:25mm"), "no views"),
        (("views", "--board", "9x6:25mm", "--fisheye", "--distortion", "plain"), "expected one of them"),
        (("views", "--board", "9x6:25mm", "--distortion", "round"), "expected auto, plain or rational"),
        (("views", "--board", "9x6:25mm", "--markers", "screen.yaml"), "need --screen IMAGE"),
        (("--lens", "lens.yaml"), "--lens needs --screen"),
        (("views", "--lens", "lens.yaml", "--screen", "a.png"), "leave out IMAGES"),
        (("--lens", "lens.yaml", "--screen", "a.png"), "say what is on the screen"),
        (("--lens", "lens.yaml", "--screen", "a.png", "--screen-board", "9x6:25mm"), "belong together"),
        (
            ("--lens", "lens.yaml", "--screen", "a.png", "--screen-board", "9x6:25mm", "--board-origin", "1,2", "--side", "top"),
            "front or back",
        ),
    ],
)
def test_options_that_do_not_go_together_are_refused(run_cli: RunCli, tmp_path: Path, words: tuple[str, ...], complaint: str) -> None:
    """Before anything is read."""
    refused(run_cli("camera", *words, "-o", "camera.yaml"), tmp_path, complaint)


def test_pictures_keep_the_sensors_axes(tmp_path: Path) -> None:
    """A turn in the EXIF data is not made, so that all views of a lens are of one size."""
    content = cv2.imencode(".jpg", np.zeros((20, 30), np.uint8))[1].tobytes()
    exif = b"Exif\x00\x00MM\x00*\x00\x00\x00\x08\x00\x01\x01\x12\x00\x03\x00\x00\x00\x01\x00\x06\x00\x00\x00\x00\x00\x00"
    path = tmp_path / "turned.jpg"
    path.write_bytes(content[:2] + b"\xff\xe1" + (len(exif) + 2).to_bytes(2, "big") + exif + content[2:])
    assert cv2.imread(str(path)).shape[:2] == (30, 20)
    assert read_grey(path).shape == (20, 30)


@pytest.mark.skipif(not PHOTOGRAPHS.is_dir(), reason="the chessboard photographs (../shared/data/opencv_chessboard) are not here")
@pytest.mark.parametrize(("side", "reference"), [("left", 0.409), ("right", 0.459)])
def test_real_photographs(side: str, reference: float) -> None:
    """OpenCV's 13 views a camera: under half of the residual that the usual fixed window has, and a plain lens."""
    views = [BOARD.find(read_grey(path), path.name) for path in picture_files([f"{PHOTOGRAPHS}/{side}*.jpg"])]
    assert all(isinstance(view, BoardView) for view in views)
    fit = calibrate_lens([view for view in views if isinstance(view, BoardView)], (640, 480))
    assert fit.camera.lens == "plain"
    assert fit.camera.rms < reference / 2
    assert not fit.dropped


def test_the_front_view_is_upright() -> None:
    """The scenes' board hangs as the documentation says: columns to the right, rows down, seen from the front."""
    np.testing.assert_array_equal(FRONT_VIEW @ np.array([0, -1, 0]), [1, 0, 0])
    np.testing.assert_array_equal(FRONT_VIEW @ np.array([0, 0, -1]), [0, 1, 0])
