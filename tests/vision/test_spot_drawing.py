"""What `spots --debug` draws: marks in the picture, every spot enlarged, and what the marks mean."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from urdfcal.vision.spots import drawing
from urdfcal.vision.spots.detector import PixelSpot, RefusedSpot, Sighting

HEIGHT, WIDTH = 120, 520


def spot(u: float, v: float, colour: str = "red") -> PixelSpot:
    """A spot of standard width 1 px, known to 0.05 px."""
    return PixelSpot(colour, np.array([u, v]), 0.05**2 * np.eye(2), 1.0, 500.0, 0, 50.0)


@pytest.fixture
def picture(tmp_path: Path) -> Path:
    """A dark picture with bright green pixels at (0, 0) and (150, 60)."""
    pixels = np.full((HEIGHT, WIDTH, 3), 40, np.uint8)
    pixels[0, 0] = pixels[60, 150] = (40, 255, 40)
    cv2.imwrite(str(tmp_path / "picture.png"), pixels)
    return tmp_path / "picture.png"


def image_of(content: bytes) -> np.ndarray:
    """The drawing, blue first."""
    return np.asarray(cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_COLOR)).astype(int)


@pytest.mark.parametrize("at", [(0.0, 0.0), (150.0, 60.0)], ids=["corner", "middle"])
def test_a_spot_is_enlarged_about_its_centre(picture: Path, at: tuple[float, float]) -> None:
    """The pixel of the spot fills the middle of the enlarged picture, also where the spot lies in a corner."""
    image = image_of(drawing.drawn(picture, Sighting((spot(*at),), ()), {}))
    tile = image[HEIGHT + drawing._GAP :, drawing._GAP :][: drawing._TILE, : drawing._TILE]
    bright = np.argwhere((tile[..., 1] > 200) & (tile[..., 0] < 120) & (tile[..., 2] < 120))
    pixel = drawing._TILE / 17
    np.testing.assert_allclose(bright.mean(axis=0), (drawing._TILE - 1) / 2, atol=2)
    np.testing.assert_allclose(np.ptp(bright, axis=0), pixel, atol=3)


def test_every_mark_has_its_place(picture: Path) -> None:
    """Labelled and unlabelled spots have their colours, what is refused a cross, and the drawing grows by rows of spots and the legend."""
    refused = RefusedSpot(np.array([250.0, 30.0]), "too wide", 30.0)
    marked, bare = spot(60, 40), spot(120, 80)
    image = image_of(drawing.drawn(picture, Sighting((marked, bare), (refused,)), {"laser_1": marked}))
    for centre, colour in (((60, 40), drawing._COLOURS["red"]), ((120, 80), drawing._UNLABELLED), ((250, 30), drawing._REFUSED)):
        around = image[centre[1] - 10 : centre[1] + 11, centre[0] - 10 : centre[0] + 11]
        assert (np.abs(around - colour).max(axis=-1) < 110).sum() > 8
    alone = image_of(drawing.drawn(picture, Sighting((), (refused,)), {}))
    row = drawing._TILE + 3 * drawing._LINE + 6 + 2 * drawing._GAP
    assert image.shape[0] - alone.shape[0] == row  # both spots fit beside one another
    assert alone.shape[0] > HEIGHT + 3 * drawing._LINE
