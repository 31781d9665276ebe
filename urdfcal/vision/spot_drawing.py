"""A picture with what was found in it drawn on."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from urdfcal.vision.spot_detector import PixelSpot, Sighting

_COLOURS = {"red": (60, 60, 255), "green": (60, 255, 60), "blue": (255, 120, 60)}
_REFUSED, _UNLABELLED = (0, 200, 255), (255, 255, 0)
_MOST_REFUSED = 15
Pixels = npt.NDArray[np.uint8]


def drawn(path: Path, sighting: Sighting, labels: Mapping[str, PixelSpot]) -> bytes:
    """A JPEG of a picture: a ring and the laser's name around each spot, a cross and the reason at what was refused.

    Args:
        path: The picture.
        sighting: What was found in it.
        labels: The pose's spot of each laser.
    """
    from urdfcal.vision.spot_images import decoded

    pixels = decoded(np.frombuffer(path.read_bytes(), np.uint8))
    assert pixels is not None  # it has been read before
    image = np.ascontiguousarray(pixels if pixels.dtype == np.uint8 else pixels.astype(np.float32) * (255 / 65535), dtype=np.uint8)
    for refused in sighting.refused[:_MOST_REFUSED]:
        u, v = (round(float(x)) for x in refused.centre)
        cv2.drawMarker(image, (u, v), _REFUSED, cv2.MARKER_TILTED_CROSS, 9, 1, cv2.LINE_AA)
        _write(image, refused.reason, u + 8, v + 4, _REFUSED, 0.36)
    for spot in sighting.spots:
        _ring(image, spot, _label_of(spot, labels))
    return bytes(cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 90])[1])


def _label_of(spot: PixelSpot, labels: Mapping[str, PixelSpot]) -> str:
    near = [(float(np.linalg.norm(other.centre - spot.centre)), laser) for laser, other in labels.items() if other.colour == spot.colour]
    return min(near)[1] if near and min(near)[0] < max(3.0, spot.width) else ""


def _ring(image: Pixels, spot: PixelSpot, laser: str) -> None:
    u, v = (round(float(x) * 16) for x in spot.centre)
    radius = max(3 * spot.width, 8)
    colour = _COLOURS[spot.colour] if laser else _UNLABELLED
    cv2.circle(image, (u, v), round(radius * 16), (0, 0, 0), 3, cv2.LINE_AA, 4)
    cv2.circle(image, (u, v), round(radius * 16), colour, 1, cv2.LINE_AA, 4)
    sigma = np.sqrt(np.trace(spot.covariance) / 2)
    text = f"{laser or spot.colour + ', whose?'}  ({spot.centre[0]:.2f}, {spot.centre[1]:.2f}) +- {sigma:.2f} px"
    _write(image, text, round(u / 16 + radius + 5), round(v / 16 - 5), colour, 0.5)


def _write(image: Pixels, text: str, u: int, v: int, colour: tuple[int, int, int], size: float) -> None:
    (width, height), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, size, 1)
    at = (max(min(u, image.shape[1] - width - 2), 2), max(min(v, image.shape[0] - 3), height + 2))
    cv2.rectangle(image, (at[0] - 2, at[1] - height - 2), (at[0] + width + 2, at[1] + 4), (0, 0, 0), -1)
    cv2.putText(image, text, at, cv2.FONT_HERSHEY_SIMPLEX, size, colour, 1, cv2.LINE_AA)
