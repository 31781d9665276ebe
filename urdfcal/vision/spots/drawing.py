"""Pictures with what was found in them: marks in the picture, below it each spot enlarged and what the marks mean.

A ring is three standard widths of a spot wide; the cross in the enlarged picture is at its centre, and its ellipse is where the centre
lies with three standard deviations.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from urdfcal.base.terminal import many
from urdfcal.vision.spots.detector import PixelSpot, Sighting

Pixels = npt.NDArray[np.uint8]

_COLOURS = {"red": (60, 60, 255), "green": (60, 255, 60), "blue": (255, 120, 60)}  # blue first, as OpenCV has them
_REFUSED, _UNLABELLED, _PAPER, _INK = (0, 200, 255), (255, 255, 0), (32, 32, 32), (235, 235, 235)
_MOST_REFUSED, _MOST_ENLARGED = 15, 6
_TILE, _GAP, _LINE = 220, 12, 20  # [px] side of an enlarged spot, between two, and of a line of words
_AROUND = 5.0  # half side of what is enlarged over the spot's width
_LEAST_AROUND = 8  # [px]
_SMALL, _USUAL = 0.42, 0.5  # of letters
_FONT = cv2.FONT_HERSHEY_SIMPLEX


def drawn(path: Path, sighting: Sighting, labels: Mapping[str, PixelSpot]) -> bytes:
    """A JPEG of a picture: a ring and the laser's name around each spot, a cross and the reason at what was refused.

    Args:
        path: The picture.
        sighting: What was found in it.
        labels: The pose's spot of each laser.
    """
    from urdfcal.vision.picture_file import picture_content
    from urdfcal.vision.pictures import decoded

    pixels = decoded(picture_content(path))
    assert pixels is not None  # it has been read before
    picture = np.ascontiguousarray(pixels if pixels.dtype == np.uint8 else pixels.astype(np.float32) * (255 / 65535), dtype=np.uint8)
    spots = [(spot, _label_of(spot, labels)) for spot in sighting.spots]
    below = [_enlarged(picture, spot, laser) for spot, laser in spots[:_MOST_ENLARGED]]
    for refused in sighting.refused[:_MOST_REFUSED]:
        _cross(picture, refused.centre)
        _write(picture, refused.reason, refused.centre[0] + 8, refused.centre[1] + 4, _REFUSED, _SMALL)
    for spot, laser in spots:
        _ring(picture, spot, laser)
    legend = _legend(sighting, picture.shape[1])
    image = _stacked([picture, _row(below, legend.shape[1]), legend])
    return bytes(cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 90])[1])


def _label_of(spot: PixelSpot, labels: Mapping[str, PixelSpot]) -> str:
    near = [(float(np.linalg.norm(other.centre - spot.centre)), laser) for laser, other in labels.items() if other.colour == spot.colour]
    return min(near)[1] if near and min(near)[0] < max(3.0, spot.width) else ""


def _cross(image: Pixels, centre: npt.NDArray[np.float64]) -> None:
    cv2.drawMarker(image, (round(float(centre[0])), round(float(centre[1]))), _REFUSED, cv2.MARKER_TILTED_CROSS, 9, 1, cv2.LINE_AA)


def _ring(image: Pixels, spot: PixelSpot, laser: str) -> None:
    radius, colour = max(3 * spot.width, 8), _colour(spot, laser)
    centre = (round(float(spot.centre[0]) * 16), round(float(spot.centre[1]) * 16))
    cv2.circle(image, centre, round(radius * 16), (0, 0, 0), 3, cv2.LINE_AA, 4)
    cv2.circle(image, centre, round(radius * 16), colour, 1, cv2.LINE_AA, 4)
    _write(image, laser or f"{spot.colour}, whose?", spot.centre[0] + radius + 5, spot.centre[1] - 5, colour, _USUAL)


def _colour(spot: PixelSpot, laser: str) -> tuple[int, int, int]:
    return _COLOURS[spot.colour] if laser else _UNLABELLED


def _enlarged(picture: Pixels, spot: PixelSpot, laser: str) -> Pixels:
    """A spot's neighbourhood with its centre, (height, width, 3), and in words whose it is and where."""
    half = max(_LEAST_AROUND, round(_AROUND * spot.width))
    side, low = 2 * half + 1, np.round(spot.centre).astype(int) - half
    padded = cv2.copyMakeBorder(picture, half, half, half, half, cv2.BORDER_CONSTANT)  # a spot may lie at the edge
    cut = np.ascontiguousarray(padded[low[1] + half : low[1] + half + side, low[0] + half : low[0] + half + side])
    tile = np.asarray(cv2.resize(cut, (_TILE, _TILE), interpolation=cv2.INTER_NEAREST), dtype=np.uint8)
    scale = _TILE / side
    centre = (spot.centre - low + 0.5) * scale  # the first pixel's centre is (0, 0)
    for axis in np.eye(2):
        ends = [tuple(np.round(16 * (centre + sign * inner * axis)).astype(int).tolist()) for sign in (-1, 1) for inner in (6, 16)]
        for start, end in (ends[:2], ends[2:]):
            cv2.line(tile, start, end, _INK, 1, cv2.LINE_AA, 4)
    _ellipse(tile, centre, spot, scale)
    sigma = np.sqrt(np.trace(spot.covariance) / 2)
    words = (laser or f"{spot.colour}, whose?", f"({spot.centre[0]:.2f}, {spot.centre[1]:.2f}) \u00b1 {sigma:.2f} px", f"{side} px across")
    below = np.full((len(words) * _LINE + 6, _TILE, 3), _PAPER, np.uint8)
    for line, text in enumerate(words):
        _letters(below, text, 0, (line + 1) * _LINE - 4, _colour(spot, laser) if line == 0 else _INK, _SMALL)
    return _stacked([tile, below])


def _ellipse(tile: Pixels, centre: npt.NDArray[np.float64], spot: PixelSpot, scale: float) -> None:
    """Where the centre lies, with three standard deviations."""
    variances, axes = np.linalg.eigh(spot.covariance)
    size = np.maximum(np.round(16 * 3 * scale * np.sqrt(np.maximum(variances, 0.0))), 16).astype(int)
    angle = float(np.degrees(np.arctan2(axes[1, 0], axes[0, 0])))
    at = (round(float(centre[0]) * 16), round(float(centre[1]) * 16))
    cv2.ellipse(tile, at, (int(size[0]), int(size[1])), angle, 0, 360, _INK, 1, cv2.LINE_AA, 4)


def _legend(sighting: Sighting, width: int) -> Pixels:
    """What the marks mean, and how many there are."""
    whose, refused = len(sighting.spots), len(sighting.refused)
    rows = [
        f"ring: a spot and whose it is; {many(whose, 'spot')}"
        + (f", the brightest {_MOST_ENLARGED} enlarged" if whose > _MOST_ENLARGED else ""),
        "below the picture: the centre \u00b1 its standard deviation; the ellipse holds three of them",
        f"cross: what is no spot, and why; {refused}" + (f", {_MOST_REFUSED} drawn" if refused > _MOST_REFUSED else ""),
    ]
    colours = (_INK, _INK, _REFUSED)
    need = max(_width(row, _SMALL) for row in rows) + 3 * _GAP
    found = np.full((len(rows) * _LINE + _GAP, max(width, need), 3), _PAPER, np.uint8)
    for line, (text, colour) in enumerate(zip(rows, colours, strict=True)):
        _letters(found, text, _GAP, (line + 1) * _LINE - 4, colour, _SMALL)
    return found


def _row(tiles: Sequence[Pixels], width: int) -> Pixels:
    """Tiles beside one another, in as many rows as they need."""
    if not tiles:
        return np.empty((0, width, 3), np.uint8)
    each = max(1, (width - _GAP) // (_TILE + _GAP))
    height = tiles[0].shape[0] + _GAP
    found = np.full((height * -(-len(tiles) // each) + _GAP, max(width, _TILE + 2 * _GAP), 3), _PAPER, np.uint8)
    for number, tile in enumerate(tiles):
        top, left = _GAP + number // each * height, _GAP + number % each * (_TILE + _GAP)
        found[top : top + tile.shape[0], left : left + _TILE] = tile
    return found


def _stacked(images: Sequence[Pixels]) -> Pixels:
    """Images below one another, to the width of the widest."""
    width = max(image.shape[1] for image in images)
    grown = [cv2.copyMakeBorder(each, 0, 0, 0, width - each.shape[1], cv2.BORDER_CONSTANT, value=_PAPER) for each in images if len(each)]
    return np.ascontiguousarray(np.concatenate(grown), dtype=np.uint8)


def _write(image: Pixels, text: str, u: float, v: float, colour: tuple[int, int, int], size: float) -> None:
    """Words on a ground of their own, inside the picture."""
    width, height = _width(text, size), round(22 * size)
    at = (max(min(round(float(u)), image.shape[1] - width - 2), 2), max(min(round(float(v)), image.shape[0] - 3), height + 2))
    cv2.rectangle(image, (at[0] - 2, at[1] - height - 2), (at[0] + width + 2, at[1] + 4), (0, 0, 0), -1)
    _letters(image, text, *at, colour, size)


def _width(text: str, size: float) -> int:
    return int(cv2.getTextSize(text.replace("\u00b1", "+"), _FONT, size, 1)[0][0])


def _letters(image: Pixels, text: str, u: int, v: int, colour: tuple[int, int, int], size: float) -> None:
    """Write words; OpenCV's letters have no plus-minus, so it is a plus with a line below."""
    before, sign, _ = text.partition("\u00b1")
    cv2.putText(image, text.replace("\u00b1", "+"), (u, v), _FONT, size, colour, 1, cv2.LINE_AA)
    if sign:
        left, right = u + _width(before, size), u + _width(f"{before}+", size)
        cv2.line(image, (left, v + 2), (right - 1, v + 2), colour, 1, cv2.LINE_AA)
