"""A picture with the boards that were found in it drawn on."""

from __future__ import annotations

from collections.abc import Sequence
from textwrap import wrap

import cv2
import numpy as np

from urdfcal.vision.camera.board_search import BoardSeen
from urdfcal.vision.camera.sought import Sought
from urdfcal.vision.pictures import Grey

_FOUND, _FAILED = (60, 255, 60), (0, 200, 255)
_LETTER_PX = 8
_SHIFT = 4  # bits behind the point of OpenCV's coordinates


def drawn_boards(picture: Grey, boards: Sequence[Sought], seen: Sequence[BoardSeen | str]) -> bytes:
    """A JPEG: a ring and its number at each corner, and why a board was not found."""
    image = cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR)
    lines = 0
    for sought, view in zip(boards, seen, strict=True):
        if isinstance(view, BoardSeen):
            _draw(image, view)
            text, colour = f"{sought.link}: {len(view.corners)} corners, RMS {view.rms:.2f} px", _FOUND
        else:
            text, colour = f"{sought.link}: {view}", _FAILED
        for part in wrap(text, max(20, image.shape[1] // _LETTER_PX)):
            lines += 1
            _write(image, part, lines, colour)
    return bytes(cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 90])[1])


def _write(image: np.ndarray, text: str, line: int, colour: tuple[int, int, int]) -> None:
    """A line of words on black; an outline of thicker letters would be wider than they are."""
    (width, height), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, 0.42, 1)
    cv2.rectangle(image, (4, 16 * line - height - 3), (width + 8, 16 * line + 4), (0, 0, 0), cv2.FILLED)
    cv2.putText(image, text, (6, 16 * line), cv2.FONT_HERSHEY_SIMPLEX, 0.42, colour, 1, cv2.LINE_AA)


def _draw(image: np.ndarray, view: BoardSeen) -> None:
    for corner, pixel in zip(view.corners, view.pixels, strict=True):
        u, v = (round(float(x) * 2**_SHIFT) for x in pixel)
        cv2.circle(image, (u, v), 4 << _SHIFT, _FOUND, 1, cv2.LINE_AA, _SHIFT)
        at = (round(float(pixel[0])) + 5, round(float(pixel[1])) - 3)
        cv2.putText(image, str(int(corner)), at, cv2.FONT_HERSHEY_SIMPLEX, 0.3, _FOUND, 1, cv2.LINE_AA)
