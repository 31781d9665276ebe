"""The sheet of markers, true to scale."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path

import cv2
import matplotlib
import numpy as np
import pytest
from lxml import etree

from tests.conftest import CliResult
from urdfcal.base.errors import UsageError
from urdfcal.vision.camera.marker_sheet import marker_sheet, sheet_pages
from urdfcal.vision.camera.markers import ScreenMarkers, aruco_dictionary

POINT_MM = 25.4 / 72
LARGE = ScreenMarkers("DICT_4X4_50", 0.1, {0: (0.55, 0.4), 1: (-0.55, 0.4), 7: (0.1, -0.4)})
SMALL = ScreenMarkers("DICT_5X5_100", 0.03, {0: (0.04, 0.06), 1: (-0.04, 0.06), 99: (0.01, -0.06)})
RunCli = Callable[..., CliResult]


def seen_in(content: bytes, markers: ScreenMarkers, dpi: float) -> dict[int, np.ndarray]:
    """Corners (4, 2) of the markers in a PNG, in mm to the right and up."""
    picture = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_GRAYSCALE)
    corners, ids, _ = cv2.aruco.ArucoDetector(aruco_dictionary(markers.dictionary)).detectMarkers(picture)
    return {int(number): quad.reshape(4, 2) * [1, -1] / dpi * 25.4 for number, quad in zip(ids.ravel(), corners, strict=True)}


@pytest.mark.parametrize(("markers", "paper", "dpi"), [(SMALL, "A4", 300), (SMALL, "full", 200), (LARGE, "full", 50)])
def test_a_png_is_true_to_scale(markers: ScreenMarkers, paper: str, dpi: float) -> None:
    """OpenCV finds every marker in it, in its size and at its place as seen from the front: +y to the left, +z up."""
    found = seen_in(marker_sheet(markers, ".png", paper, dpi), markers, dpi)
    assert sorted(found) == sorted(markers.centres)
    pixel = 25.4 / dpi
    shift = found[0][0] - markers.corners_of(0)[0, 1:] * [-1000, 1000]
    for marker, corners in found.items():
        np.testing.assert_allclose(corners, markers.corners_of(marker)[:, 1:] * [-1000, 1000] + shift, atol=2 * pixel)


def test_a_mirrored_sheet_is_read_from_its_back() -> None:
    """Turned around it is the sheet as it is seen from the front."""
    content = marker_sheet(SMALL, ".png", "A4", 200, mirror=True)
    picture = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_GRAYSCALE)
    turned = cv2.imencode(".png", cv2.flip(picture, 1))[1].tobytes()
    straight, back = seen_in(marker_sheet(SMALL, ".png", "A4", 200), SMALL, 200), seen_in(turned, SMALL, 200)
    assert sorted(straight) == sorted(back)
    for marker, corners in straight.items():
        np.testing.assert_allclose(back[marker], corners, atol=0.3)


def rectangles(page: str) -> list[tuple[float, ...]]:
    """The rectangles of a PDF page, (left, bottom, right, top) in mm."""
    corners = re.findall(r"([\d.-]+) ([\d.-]+) m\s+([\d.-]+) ([\d.-]+) l\s+([\d.-]+) ([\d.-]+) l", page)
    return [tuple(float(number) * POINT_MM for number in (c[0], c[1], c[4], c[5])) for c in corners]


@pytest.mark.parametrize(("paper", "pages"), [("A4", 3), ("A3", 3), ("full", 1)])
def test_a_pdf_is_true_to_scale(paper: str, pages: int) -> None:
    """Its pages have the paper's size, and on each the black squares the markers'; one marker a page where the sheet is larger."""
    with matplotlib.rc_context({"pdf.compression": 0}):
        text = marker_sheet(LARGE, ".pdf", paper).decode("latin-1")
    boxes = [[float(number) * POINT_MM for number in box.split()] for box in re.findall(r"/MediaBox \[([^\]]*)\]", text)]
    expected = {"A4": (210, 297), "A3": (297, 420), "full": sheet_pages(LARGE, "full")[0].size}[paper]
    assert len(boxes) == pages
    for box in boxes:
        np.testing.assert_allclose(box[2:], expected, atol=1e-3)
    squares = [box for box in rectangles(text) if abs(box[2] - box[0] - 100) < 1e-3 and abs(box[3] - box[1] - 100) < 1e-3]
    assert len(squares) == 3
    centres = np.array([[(box[0] + box[2]) / 2, (box[1] + box[3]) / 2] for box in squares])
    if paper == "full":
        np.testing.assert_allclose(centres - centres[0], [[0, 0], [1100, 0], [450, -800]], atol=1e-3)
    else:
        np.testing.assert_allclose(centres, np.tile(np.array(expected) / 2, (3, 1)), atol=1e-3)


def test_an_svg_is_true_to_scale() -> None:
    """Its size stands in points, one drawing unit is one point, and the black squares measure 30 mm."""
    root = etree.fromstring(marker_sheet(SMALL, ".svg"))
    size = [float(root.get(side).removesuffix("pt")) * POINT_MM for side in ("width", "height")]
    np.testing.assert_allclose(size, [210, 297], atol=1e-3)
    assert root.get("viewBox") == f"0 0 {root.get('width').removesuffix('pt')} {root.get('height').removesuffix('pt')}"
    sides = []
    for path in root.iter("{http://www.w3.org/2000/svg}path"):
        numbers = np.array(re.findall(r"-?[\d.]+", path.get("d") or ""), dtype=float)
        if path.get("style", "").startswith("opacity") or "fill: #" in path.get("style", "") or path.get("style") is None:
            pairs = numbers.reshape(-1, 2) if len(numbers) % 2 == 0 and len(numbers) else np.empty((0, 2))
            sides += [np.ptp(pairs, axis=0) * POINT_MM] if len(pairs) else []
    squares = [side for side in sides if np.abs(side - 30).max() < 1e-2]
    assert len(squares) == 3


def test_nothing_but_white_is_near_a_marker() -> None:
    """One cell of white lies around each, which detectors need."""
    dpi = 200
    content = marker_sheet(SMALL, ".png", "A4", dpi)
    picture = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_GRAYSCALE)
    cell = 30 / 7
    for corners in seen_in(content, SMALL, dpi).values():
        middle, half = corners.mean(axis=0) * [1, -1], 15 + 0.9 * cell
        left, top, right, bottom = (np.array([*(middle - half), *(middle + half)]) / 25.4 * dpi).round().astype(int)
        ring = picture[top:bottom, left:right].copy()
        width = round(0.8 * cell / 25.4 * dpi)
        ring[width:-width, width:-width] = 255
        assert ring.min() == 255


def test_a_small_sheet_takes_one_page_and_a_marker_larger_than_paper_none() -> None:
    """A sheet that fits the paper is printed as it hangs; a marker that fits no paper asks for a larger one."""
    (page,) = sheet_pages(SMALL, "A4")
    assert page.size == (210, 297)
    assert page.origin is not None
    assert len(sheet_pages(LARGE, "A4")) == 3
    huge = ScreenMarkers("DICT_4X4_50", 0.2, LARGE.centres)
    assert len(sheet_pages(huge, "A3")) == 3 or pytest.fail("20 cm fit A3")
    with pytest.raises(UsageError, match="take --paper A3 or full"):
        sheet_pages(huge, "A4")


def test_markers_writes_a_sheet(run_cli: RunCli, tmp_path: Path) -> None:
    """The file and its pages, for people and machines; the same input gives the same bytes."""
    (tmp_path / "screen.yaml").write_text("dictionary: DICT_4X4_50\nsize_mm: 100\nmarkers: {0: [550, 400], 1: [-550, 400]}\n", "utf-8")
    done = run_cli("markers", "screen.yaml", "-o", "sheet.pdf")
    assert done.code == 0, done.err
    assert "2 markers on 2 pages of 210 x 297 mm" in done.out
    first = (tmp_path / "sheet.pdf").read_bytes()
    assert first.startswith(b"%PDF")
    machine = json.loads(run_cli("markers", "screen.yaml", "-o", "sheet.pdf", "--json").out)
    assert (machine["pages"], machine["markers"]) == (2, [0, 1])
    assert (tmp_path / "sheet.pdf").read_bytes() == first


@pytest.mark.parametrize(
    ("words", "complaint"),
    [
        (("-o", "sheet.doc"), "a sheet ends in .pdf, .svg or .png"),
        (("-o", "sheet.svg"), "takes 2 pages of A4"),
        (("-o", "sheet.png", "--paper", "full", "--dpi", "1200"), "take --dpi"),
        (("-o", "sheet.pdf", "--paper", "A5"), "expected A4, A3, A2"),
        (("-o", "nowhere/sheet.pdf"), "does not exist"),
    ],
)
def test_a_sheet_that_cannot_be_is_refused(run_cli: RunCli, tmp_path: Path, words: tuple[str, ...], complaint: str) -> None:
    """One line, exit 2, nothing written."""
    (tmp_path / "screen.yaml").write_text("dictionary: DICT_4X4_50\nsize_mm: 100\nmarkers: {0: [550, 400], 1: [-550, 400]}\n", "utf-8")
    done = run_cli("markers", "screen.yaml", *words)
    assert (done.code, done.out, done.err.count("\n")) == (2, "", 1), done.err
    assert complaint in done.err
    assert [path.name for path in tmp_path.iterdir()] == ["screen.yaml"]
