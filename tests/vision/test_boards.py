"""Boards in rendered pictures: corners by number, sigmas that hold, and the way to a file that fit reads."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.conftest import CliResult
from tests.support.flat_boards import board_camera, facing, rendered, true_pixels
from urdfcal.base.errors import UsageError
from urdfcal.calibration.rig_file import read_rig_file
from urdfcal.vision.camera.board_search import BoardSeen, find_boards
from urdfcal.vision.camera.camera_file import camera_yaml
from urdfcal.vision.camera.sought import parse_board, parse_boards

RunCli = Callable[..., CliResult]
CAMERA = board_camera()
SPECS = {
    "9x6:25mm": 0.42,
    "charuco:7x5:40mm:30mm": 0.45,
    "apriltag:36h11:6x4:30mm": 0.42,
    "aruco:4X4_50:1x1:80mm@7": 0.4,
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


WRONG = {
    "apriltag:36h11:6x4": "no board of this description",
    "apriltag:36h12:6x4:30mm": "no apriltag dictionary '36h12'; did you mean '36h11'?",
    "aruco:4X4_50:9x6:30mm": "needs ids to 53, and DICT_4X4_50 has 0 to 49",
    "9x6:25mm@3": "a chessboard has no ids",
    "charuco:7x5:30mm:40mm": "a marker is smaller than its square",
    "=9x6:25mm": "expected a link before =",
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
