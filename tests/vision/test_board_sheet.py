"""Boards to print: true to scale, found by the same words, and only on paper that holds them."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path

import cv2
import matplotlib
import numpy as np
import pytest

from tests.conftest import CliResult
from tests.vision.test_markers import POINT_MM, rectangles
from urdfcal.base.errors import UsageError
from urdfcal.sensors.camera import Camera
from urdfcal.vision.camera.board_search import BoardSeen, find_boards
from urdfcal.vision.camera.board_sheet import board_pages, board_sheet
from urdfcal.vision.camera.sought import parse_board

RunCli = Callable[..., CliResult]
DPI = 72.0
# where corner 0 is from the upper left of what is black, and how far its columns and rows reach, mm
SPECS = {
    "9x6:25mm": ((25, 25), (200, 125)),
    "charuco:6x5:40mm:30mm@3": ((40, 40), (160, 120)),
    "apriltag:36h11:4x3:40mm:12mm": ((0, 0), (196, 144)),
    "aruco:4X4_50:1x1:80mm@7": ((0, 0), (80, 80)),
    "circles:4x11:20mm": ((7, 7), (140, 200)),
}


def flat_camera(picture: np.ndarray) -> Camera:
    """One before which the sheet lies 1 m away with the same scale as in the picture."""
    height, width = picture.shape
    focal = 1000 / 25.4 * DPI
    return Camera((width, height), np.array([[focal, 0, width / 2], [0, focal, height / 2], [0, 0, 1]]), np.zeros(5))


@pytest.mark.parametrize("spec", SPECS)
def test_what_is_printed_is_found_in_its_true_size(spec: str) -> None:
    """Every corner of the rasterised sheet is found, under its own number and to a tenth of a pixel where the words say."""
    (page,) = board_pages([spec], "A3")
    content = board_sheet([page], ".png", "A3", DPI)
    picture = cv2.GaussianBlur(cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_GRAYSCALE), (0, 0), 0.7)  # as any lens does
    (seen,) = find_boards(picture, flat_camera(picture), [parse_board(spec)])
    assert isinstance(seen, BoardSeen), seen
    assert len(seen.corners) == parse_board(spec).grid.corners
    first, reach = SPECS[spec]
    found = (seen.pixels + 0.5) * 25.4 / DPI  # mm from the upper left of the page
    np.testing.assert_allclose(np.ptp(found, axis=0), reach, atol=0.1 * 25.4 / DPI)
    truth = np.array([parse_board(spec).grid.at(int(corner))[:2] for corner in seen.corners]) * 1000
    dark = np.argwhere(picture[: round(0.9 * len(picture))] < 128).min(axis=0)[::-1] * 25.4 / DPI
    np.testing.assert_allclose(found, truth + dark + first, atol=0.6 * 25.4 / DPI)  # where black begins is known to half a pixel
    off = found - truth - (found - truth).mean(axis=0)
    assert np.abs(off).max() < 0.12 * 25.4 / DPI


def test_a_pdf_has_a_page_for_each_board_true_to_scale() -> None:
    """Pages have the paper's size, turned as the board is; the squares measure what the words say, and their words stand on the page."""
    pages = board_pages(["9x6:25mm", "apriltag:36h11:3x4:40mm"], "A4")
    with matplotlib.rc_context({"pdf.compression": 0, "pdf.fonttype": 3}):
        text = board_sheet(pages, ".pdf", "A4").decode("latin-1")
    boxes = [[float(number) * POINT_MM for number in box.split()][2:] for box in re.findall(r"/MediaBox \[([^\]]*)\]", text)]
    np.testing.assert_allclose(boxes, [[297, 210], [210, 297]], atol=1e-3)
    sides = np.array([(box[2] - box[0], box[3] - box[1]) for box in rectangles(text)])
    assert (np.abs(sides - 25).max(axis=1) < 1e-3).sum() == 35
    assert (np.abs(sides - 40).max(axis=1) < 1e-3).sum() == 12


def test_a_board_takes_the_paper_that_holds_it() -> None:
    """What does not fit is told which paper would; that paper, a custom one, and a page of its own size take it."""
    with pytest.raises(UsageError, match=r"does not fit on A4: 280 x 200 mm needs A3 .* take --paper A3"):
        board_pages(["charuco:7x5:40mm:30mm"], "A4")
    for paper, size in (("A3", (420, 297)), ("300x240", (300, 240)), ("full", (296, 235))):
        assert board_pages(["charuco:7x5:40mm:30mm"], paper)[0].page == pytest.approx(size)
    with pytest.raises(UsageError, match="needs 1765x1187"):
        board_pages(["apriltag:36h11:6x4:230mm"], "A0")


def test_markers_prints_boards(run_cli: RunCli, tmp_path: Path) -> None:
    """The file and its pages, for people and machines; what does not go together is refused in one line, with nothing written."""
    done = run_cli("markers", "--board", "9x6:25mm", "--board", "circles:4x11:15mm", "-o", "boards.pdf")
    assert done.code == 0, done.err
    assert "2 boards on 2 pages" in done.out
    words = ("markers", "--board", "hand=9x6:25mm", "-o", "one.svg", "--json")
    assert json.loads(run_cli(*words).out)["boards"] == [{"board": "9x6:25mm", "size_mm": [250, 175]}]
    for words, complaint in (
        (("--board", "9x6:25mm", "--board", "5x4:25mm", "-o", "x.svg"), "takes 2 pages of A4"),
        (("--board", "9x6:25mm", "--mirror", "-o", "x.pdf"), "a board is looked at from its front"),
        (("screen.yaml", "--board", "9x6:25mm", "-o", "x.pdf"), "say what to print"),
        (("--board", "9x6", "-o", "x.pdf"), "expected COLUMNSxROWS:SQUARE"),
        (("--board", "9x6:25mm", "--paper", "9x9", "-o", "x.pdf"), "expected sides of 40 to 5000 mm"),
    ):
        done = run_cli("markers", *words)
        assert (done.code, done.out, done.err.count("\n")) == (2, "", 1), done.err
        assert complaint in done.err
    assert sorted(path.name for path in tmp_path.iterdir()) == ["boards.pdf", "one.svg"]
