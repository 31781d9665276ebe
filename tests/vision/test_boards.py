"""Boards in rendered pictures: corners by number, sigmas that hold, and the way to a file that fit reads."""

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
from tests.support.flat_boards import board_camera, facing, rendered, true_pixels
from tests.support.paths import ROBOTS_DIR, SHARED_DATA
from urdfcal.base.errors import UsageError
from urdfcal.calibration.rig_file import read_rig_file
from urdfcal.robot.robot import load_robot
from urdfcal.vision.camera.board_search import BoardSeen, find_boards, looks_the_same_turned
from urdfcal.vision.camera.boards import BoardView, Chessboard
from urdfcal.vision.camera.camera_file import camera_yaml
from urdfcal.vision.camera.lens import calibrate_lens
from urdfcal.vision.camera.sought import parse_board, parse_boards
from urdfcal.vision.pictures import read_grey

TURNS = np.linspace(0, 2 * np.pi, 720, endpoint=False)
RunCli = Callable[..., CliResult]
CAMERA = board_camera()
UR5 = ROBOTS_DIR / "ur5" / "ur5.urdf.xacro"
PHOTOGRAPHS = SHARED_DATA / "opencv_chessboard"
SPECS = {
    "9x6:25mm": 0.42,
    "charuco:7x5:40mm:30mm": 0.45,
    "apriltag:36h11:6x4:30mm": 0.42,
    "aruco:4X4_50:1x1:80mm@7": 0.4,
    "circles:4x11:20mm": 0.42,
}


def found(spec: str, picture: np.ndarray) -> BoardSeen | str:
    return find_boards(picture, CAMERA, [parse_board(spec)])[0]


@pytest.mark.parametrize("spec", SPECS)
def test_corners_are_where_they_are_within_their_sigmas(spec: str) -> None:
    """To 60 deg oblique, blurred and noisy, most corners are found, none under another's number, each off as its sigma says."""
    sought, scaled, count = parse_board(spec), [], 0
    for seed, (tilt, blur) in enumerate([(20, 0.0), (60, 1.0)]):
        rng = np.random.default_rng(seed)
        T = facing(sought, SPECS[spec], tilt, rng.uniform(0, 360), rng.uniform(-30, 30))
        seen = found(spec, rendered(CAMERA, [(sought, T)], rng, blur=blur, rays=3))
        assert isinstance(seen, BoardSeen), seen
        off = seen.pixels - true_pixels(CAMERA, sought, T)[seen.corners]
        assert np.abs(off).max() < 1.0
        scaled.append((off / seen.sigmas[:, None]).ravel())
        count += len(off)
    assert count > 0.8 * 2 * sought.grid.corners
    assert 0.4 < np.sqrt((np.concatenate(scaled) ** 2).mean()) < 1.6


def test_large_tags_are_found_where_a_lens_bows_their_edges() -> None:
    """A tag that fills half the picture: corners to a few hundredths of a pixel, where straight edges are 1 px off; alone on its paper."""
    sought, camera = parse_board("aruco:4X4_50:1x1:80mm@7"), replace(CAMERA, distortion=np.array([-0.25, 0.03, 5e-4, -4e-4, 0.0]))
    for seed, (distance, about) in enumerate([(0.18, 40), (0.2, 150), (0.25, 260)]):
        rng = np.random.default_rng(seed)
        T = facing(sought, distance, 25, about, rng.uniform(-30, 30))
        (seen,) = find_boards(rendered(camera, [(sought, T)], rng, blur=0.7, rays=3), camera, [sought])
        assert isinstance(seen, BoardSeen), seen
        assert np.abs(seen.pixels - true_pixels(camera, sought, T)[seen.corners]).max() < 0.1


def test_oblique_and_blurred_corners_have_larger_sigmas() -> None:
    """The same board tilted, or farther out of focus, is known less well."""
    sought, sigmas = parse_board("charuco:7x5:40mm:30mm"), []
    for tilt, blur in ((0, 0.7), (60, 0.7), (0, 1.8)):
        picture = rendered(CAMERA, [(sought, facing(sought, 0.45, tilt, 90))], np.random.default_rng(1), noise=4, blur=blur, rays=2)
        seen = found("charuco:7x5:40mm:30mm", picture)
        assert isinstance(seen, BoardSeen), seen
        sigmas.append(np.median(seen.sigmas))
    assert sigmas[1] > 1.2 * sigmas[0]
    assert sigmas[2] > 1.1 * sigmas[0]


@pytest.mark.parametrize("spec", ["charuco:7x5:40mm:30mm", "apriltag:36h11:6x4:30mm"])
def test_half_a_board_counts(spec: str) -> None:
    """With half of it hidden, the corners that are seen have their own numbers."""
    sought = parse_board(spec)
    T = facing(sought, SPECS[spec], 20, 45)
    picture = rendered(CAMERA, [(sought, T)], np.random.default_rng(2), rays=2)
    picture[:, :300] = 90
    seen = found(spec, picture)
    assert isinstance(seen, BoardSeen), seen
    assert 0.2 * sought.grid.corners < len(seen.corners) < 0.7 * sought.grid.corners
    assert np.abs(seen.pixels - true_pixels(CAMERA, sought, T)[seen.corners]).max() < 1.0


def test_a_chessboard_turned_round_keeps_its_first_corner() -> None:
    """Seen upside down, corner 0 is the same corner of the board."""
    sought = parse_board("9x6:25mm")
    for roll in (0, 90, 180):
        T = facing(sought, 0.5, 15, 30, roll)
        seen = found("9x6:25mm", rendered(CAMERA, [(sought, T)], np.random.default_rng(3), rays=2))
        assert isinstance(seen, BoardSeen), seen
        assert np.abs(seen.pixels - true_pixels(CAMERA, sought, T)).max() < 1.0


def test_a_chessboard_that_is_hidden_in_part_is_named() -> None:
    """What is seen of it is said, and which board need not be seen whole."""
    sought = parse_board("9x6:25mm")
    picture = rendered(CAMERA, [(sought, facing(sought, 0.42, 10, 60))], np.random.default_rng(4), rays=2)
    picture[:, 300:390] = 90
    seen = found("9x6:25mm", picture)
    assert isinstance(seen, str)
    assert "part of the board is hidden" in seen
    assert "a ChArUco board (charuco:) need not" in seen
    assert found("9x6:25mm", np.full_like(picture, 120)) == "no chessboard with 9 x 6 inner corners found"


def test_centres_of_circles_are_not_the_centres_of_their_ellipses() -> None:
    """Before a wide lens large oblique circles are off by more than ten sigma without the correction, and within their sigmas with it."""
    sought, camera = parse_board("circles:2x5:24mm:21mm"), board_camera(focal=400)
    T = facing(sought, 0.13, 50, 20)
    picture = rendered(camera, [(sought, T)], np.random.default_rng(6), blur=0.7, rays=3)
    (seen,) = find_boards(picture, camera, [sought])
    raw = sought.board.find(picture, "")
    assert isinstance(seen, BoardSeen), seen
    assert isinstance(raw, BoardView), raw
    truth = true_pixels(camera, sought, T)
    assert np.abs((seen.pixels - truth[seen.corners]) / seen.sigmas[:, None]).max() < 4
    assert np.linalg.norm(raw.pixels - truth[seen.corners], axis=1).max() > 10 * seen.sigmas.max()


def test_a_grid_of_circles_turned_round_keeps_its_first(rng: np.random.Generator) -> None:
    """With an odd number of rows nothing looks the same turned; with an even one it does, which is said."""
    sought = parse_board("circles:4x11:20mm")
    for roll in (0, 90, 180):
        T = facing(sought, 0.45, 15, 30, roll)
        seen = found("circles:4x11:20mm", rendered(CAMERA, [(sought, T)], rng, rays=2))
        assert isinstance(seen, BoardSeen), seen
        assert np.abs(seen.pixels - true_pixels(CAMERA, sought, T)[seen.corners]).max() < 0.2
    texture = cv2.GaussianBlur(rng.integers(0, 255, (480, 640)).astype(np.uint8), (0, 0), 2)  # hundreds of spots: given up at once
    assert "no asymmetric grid of 4 x 11 circles found" in str(found("circles:4x11:20mm", cv2.equalizeHist(texture)))
    assert [looks_the_same_turned(parse_board(f"circles:4x{rows}:20mm").board) for rows in (10, 11)] == [True, False]


def test_a_lens_comes_from_circles_without_their_shift(rng: np.random.Generator) -> None:
    """Centroids of large circles, exact but for a hundredth of a pixel, give the lens within its sigmas: their shift is undone."""
    sought, views = parse_board("circles:4x11:20mm:18mm"), []
    points = sought.grid.points()
    for about in range(0, 360, 30):
        T = facing(sought, rng.uniform(0.3, 0.45), rng.uniform(15, 45), about, rng.uniform(-30, 30), (rng.uniform(-0.05, 0.05), 0))
        rim = 9e-3 * np.column_stack([np.cos(TURNS), np.sin(TURNS), 0 * TURNS])
        outlines = [CAMERA.project((point + rim) @ T.rotation.T + T.translation) for point in points]
        moments = [cv2.moments((64 * outline).astype(np.float32)) for outline in outlines]
        pixels = np.array([[m["m10"] / m["m00"], m["m01"] / m["m00"]] for m in moments]) / 64
        views.append(
            BoardView(str(about), points, pixels + rng.normal(0, 0.01, pixels.shape), np.array([m["m00"] for m in moments]) / 64**2)
        )
    fit = calibrate_lens(views, CAMERA.size, "plain")
    sigmas = np.sqrt(np.diag(fit.camera.lens_covariance))[:4]
    off = (fit.camera.matrix - CAMERA.matrix)[[0, 1, 0, 1], [0, 1, 2, 2]]
    assert np.abs(off / sigmas).max() < 4
    assert fit.camera.rms < 0.02
    blind = calibrate_lens([replace(view, areas=None) for view in views], CAMERA.size, "plain")
    shifted = (blind.camera.matrix - CAMERA.matrix)[[0, 1], [0, 1]]
    assert (np.abs(off[:2]) < np.abs(shifted) / 3).all()


def test_swapped_sides_and_an_older_pattern_are_told() -> None:
    """A ChArUco board stated with its sides swapped is named; one of OpenCV's older pattern is taken, and known as such."""
    sought = parse_board("charuco:7x5:40mm:30mm")
    picture = rendered(CAMERA, [(sought, facing(sought, 0.45, 15, 60))], np.random.default_rng(4), rays=2)
    assert "sides are swapped" in str(found("charuco:5x7:40mm:30mm", picture))
    even = parse_board("charuco:7x6:30mm:22mm").board
    for legacy in (False, True):
        drawn = even.opencv_board(legacy).generateImage((560, 460), marginSize=20)
        assert even.is_legacy(drawn) == legacy


def test_two_boards_are_told_apart_by_their_ids(tmp_path: Path, run_cli: RunCli, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each has columns under its link that fit reads with the rig.yaml beside them; a picture without boards is named."""
    monkeypatch.chdir(tmp_path)
    words = ("hand=charuco:5x4:30mm:22mm", "wall=charuco:5x4:30mm:22mm@10")
    sought = parse_boards(words, None)
    Path("camera.yaml").write_bytes(camera_yaml(CAMERA, {}))
    poses = [facing(one, 0.5, 20, 80, 0, beside) for one, beside in zip(sought, [(-0.11, 0), (0.11, 0.02)], strict=True)]
    pictures = rendered(CAMERA, list(zip(sought, poses, strict=True)), np.random.default_rng(5), rays=2)
    cv2.imwrite("p1.png", pictures)
    cv2.imwrite("p2.png", np.full_like(pictures, 128))
    Path("poses.csv").write_text("image,turn,lift\np2.png,0.1,0.2\np1.png,0.3,0.4\n")
    options = ("--camera", "camera.yaml", "--poses", "poses.csv", "--camera-link", "lens", "-o", "m.csv", "--debug", "seen")
    done = run_cli("boards", "p1.png", "p2.png", "--board", words[0], "--board", words[1], *options, "--json")
    assert done.code == 0, done.err
    assert "p2: hand not taken, no ChArUco board" in done.err
    told = json.loads(done.out)["boards"]
    assert [told[link]["corners"] for link in ("hand", "wall")] == [12, 12]
    rig = read_rig_file("m_rig.yaml")
    assert rig.reference == "lens"
    assert rig.grids() == {one.link: one.grid for one in sought}
    head, row = [line.split(",") for line in Path("m.csv").read_text().splitlines() if not line.startswith("#")]
    cells = dict(zip(head, row, strict=True))
    assert (cells["pose"], cells["turn"], cells["lift"]) == ("p1", "0.3", "0.4")
    for one, T in zip(sought, poses, strict=True):
        pixels = [[float(cells[f"{one.link}:{corner}.{ending}"]) for ending in "uv"] for corner in range(12)]
        assert np.abs(np.array(pixels) - true_pixels(CAMERA, one, T)).max() < 0.5
    assert len(list(Path("seen").iterdir())) == 2


@pytest.mark.skipif(not PHOTOGRAPHS.is_dir(), reason="the photographs are not there")
def test_photographs_beside_opencv() -> None:
    """On OpenCV's own views every corner is within a pixel of its detector's, and off the board's pose by less than its reference."""
    files = [PHOTOGRAPHS / f"left{number:02d}.jpg" for number in (1, 2, 4, 8)]
    pictures = [read_grey(path) for path in files]
    board = Chessboard(9, 6, 0.025)
    views = [view for path in files if isinstance(view := board.find(read_grey(path), path.name), BoardView)]
    camera = calibrate_lens(views, (640, 480), "plain").camera
    for picture in pictures:
        (seen,) = find_boards(picture, camera, [parse_board("9x6:25mm")])
        assert isinstance(seen, BoardSeen), seen
        _, corners = cv2.findChessboardCorners(picture, (9, 6))
        apart = np.linalg.norm(seen.pixels[:, None] - corners.reshape(1, -1, 2), axis=2).min(axis=1)
        assert len(seen.corners) == 54
        assert apart.max() < 1.5
        assert seen.rms < 0.409


WRONG = {
    "apriltag:36h11:6x4": "no board of this description",
    "apriltag:36h12:6x4:30mm": "no apriltag dictionary '36h12'; did you mean '36h11'?",
    "aruco:4X4_50:9x6:30mm": "needs ids to 53, and DICT_4X4_50 has 0 to 49",
    "9x6:25mm@3": "a chessboard has no ids",
    "charuco:7x5:30mm:40mm": "a marker is smaller than its square",
    "=9x6:25mm": "expected a link before =",
    "circles:4x11:20mm:19mm": "circles of 19 mm nearly touch",
    "circles:4x11:20mm@3": "a grid of circles has no ids",
    "circles:4x11": "expected COLUMNSxROWS:STEP",
}


@pytest.mark.parametrize("text", WRONG)
def test_what_is_no_board_is_refused(text: str) -> None:
    """One line says what was found and what was expected."""
    with pytest.raises(UsageError, match=WRONG[text].replace("?", r"\?")):
        parse_board(text)


def test_boards_that_share_ids_are_refused() -> None:
    """The line says with which id the other could begin."""
    with pytest.raises(UsageError, match="share ids; let one begin elsewhere, such as @17"):
        parse_boards(("a=charuco:7x5:40mm:30mm", "b=charuco:7x5:40mm:30mm"), None)


@pytest.mark.slow
def test_pictures_of_a_wrist_camera_calibrate_the_arm(tmp_path: Path, run_cli: RunCli, monkeypatch: pytest.MonkeyPatch) -> None:
    """A UR5 with wrong joint zeros and a camera on its wrist: from rendered pictures of a board the zeros come back as their sigmas say."""
    monkeypatch.chdir(tmp_path)
    robot, sought, rng = load_robot(UR5), parse_board("charuco:7x5:40mm:30mm"), np.random.default_rng(0)
    model, data = robot.model, robot.model.createData()
    tool, names = model.getFrameId("tool0"), [name for name in model.names[1:] if name.endswith("_joint")]
    zeros = {name: rng.normal(0, 0.01) for name in names[1:-1]}
    wrong = np.array([zeros.get(name, 0.0) for name in names])

    def placed(q: np.ndarray) -> pin.SE3:
        pin.framesForwardKinematics(model, data, q)
        return data.oMf[tool].copy()

    home, T_tool_camera = (
        np.array([0.3, -1.3, 1.6, -1.8, -1.4, 0.2]),
        pin.SE3(pin.exp3(np.array([0.1, -0.05, 0.2])), np.array([0.03, 0.05, 0.04])),
    )
    T_base_board = placed(home) * T_tool_camera * facing(sought, 0.5, 10, 40)
    rows = []
    while len(rows) < 30:
        q = home + rng.uniform(-1, 1, 6) * [0.3, 0.25, 0.3, 0.5, 0.5, 0.9]
        T = (placed(q + wrong) * T_tool_camera).actInv(T_base_board)
        pixels = true_pixels(CAMERA, sought, T)
        if T.translation[2] > 0.25 and ((pixels > 5) & (pixels < np.array(CAMERA.size) - 5)).all(axis=1).mean() > 0.8:
            cv2.imwrite(f"p{len(rows):02d}.png", rendered(CAMERA, [(sought, T)], rng, blur=0.6, rays=2))
            rows.append([f"p{len(rows):02d}.png", *map(repr, q.tolist())])
    Path("poses.csv").write_text("\n".join(",".join(row) for row in [["image", *names], *rows]))
    Path("camera.yaml").write_bytes(camera_yaml(CAMERA, {}))
    words = ("--board", "base_link=charuco:7x5:40mm:30mm", "--camera", "camera.yaml", "--camera-link", "tool0")
    assert run_cli("boards", "p*.png", *words, "--poses", "poses.csv", "-o", "m.csv").code == 0
    options = ("--camera", "camera.yaml", "--rig", "m_rig.yaml", "--error-model", "offset", "-o", "out.urdf", "--json")
    done = run_cli("fit", UR5, "m.csv", *options)
    assert done.code == 0, done.err
    estimated = {entry["name"]: entry for entry in json.loads(done.out)["parameters"]}
    off = np.array([(estimated[f"{name}.d_theta"]["value"] - zero) / estimated[f"{name}.d_theta"]["sigma"] for name, zero in zeros.items()])
    assert np.abs(off).max() < 3.5
    assert max(estimated[f"{name}.d_theta"]["sigma"] for name in zeros) < 2e-3
