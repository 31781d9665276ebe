"""Where in a picture a laser spot may be: small places with more of one colour than of the others.

Lamps, glare, markers and the screen are neutral: the difference between a colour and the larger of the other two is near zero on
them, and high on laser light. A core that is clipped to white has no colour; it is filled with what is around it, so that the
core of a spot becomes high and the core of a lamp stays low. Candidates are only where to look: `spot_tests` decides.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from urdfcal.vision.pictures import Picture

COLOURS = ("red", "green", "blue")
_SHRINK, _BACKGROUND = 4, 21  # the local background: a median over 84 px
_SMOOTHING = 1.0  # [px]
_NOISES, _LEVELS = 7.0, 7.0  # a candidate stands out by so many noises and grey levels of 255
_MOST = 150  # candidates a colour in a picture
Image = npt.NDArray[np.float32]


@dataclass(frozen=True)
class Candidate:
    """A place that may hold a spot.

    Attributes:
        colour: Index of its colour: red 0, green 1, blue 2.
        u: Middle of what is above half of its peak, [px].
        v: The same downwards, [px].
        radius: Of a circle with the area above half of the peak, [px].
        height: Of the peak over the local background, of 255.
    """

    colour: int
    u: float
    v: float
    radius: float
    height: float


def candidates(picture: Picture, colour: int, largest: float) -> Iterator[Candidate]:
    """Places of one colour that may hold a spot, the highest first; what is larger than `largest` [px] is not among them.

    Args:
        picture: The picture.
        colour: 0, 1 or 2.
        largest: Greatest radius at half of the peak, [px].
    """
    excess = _colour_excess(picture, colour, largest)
    smooth = cv2.GaussianBlur(excess, (0, 0), _SMOOTHING)
    height = smooth - _background(excess)
    least = max(_NOISES * _noise(height), _LEVELS)
    taken = np.zeros(height.shape, np.uint8)
    for v, u in _peaks(height, least)[:_MOST]:
        if not taken[v, u]:
            found = _region(height, taken, u, v, largest)
            if found is not None:
                yield Candidate(colour, *found, float(height[v, u]))


def _colour_excess(picture: Picture, colour: int, largest: float) -> Image:
    """A colour minus the larger of the other two, clipped cores filled with the height of their rims."""
    others = [channel for channel in range(3) if channel != colour]
    light = picture.light
    excess = light[..., colour] - np.maximum(light[..., others[0]], light[..., others[1]])
    clipped = picture.clipped[..., colour].astype(np.uint8)
    count, labels, stats, _ = cv2.connectedComponentsWithStats(clipped)
    small = (stats[:, cv2.CC_STAT_AREA] <= np.pi * largest**2) & (np.arange(count) > 0)
    if small.any():
        _fill(excess, np.asarray(labels, dtype=np.int32), np.asarray(stats, dtype=np.int32), np.flatnonzero(small))
    return np.ascontiguousarray(excess)


def _fill(excess: Image, labels: npt.NDArray[np.int32], stats: npt.NDArray[np.int32], cores: npt.NDArray[np.intp]) -> None:
    """Raise each clipped core to the upper quartile of the ring, three pixels wide, around it."""
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (7, 7))
    for core in cores:
        left, top, width, height = stats[core, :4]
        rows, columns = slice(max(top - 3, 0), top + height + 3), slice(max(left - 3, 0), left + width + 3)
        inside = labels[rows, columns] == core
        ring = (cv2.dilate(inside.astype(np.uint8), kernel) > 0) & (labels[rows, columns] == 0)
        if ring.any():
            part = excess[rows, columns]
            part[inside] = np.maximum(part[inside], np.quantile(part[ring], 0.75))


def _background(excess: Image) -> Image:
    """The median over a wide window, by way of a small picture of eight bits."""
    h, w = excess.shape
    small = cv2.resize(excess, (max(w // _SHRINK, 1), max(h // _SHRINK, 1)), interpolation=cv2.INTER_AREA)
    eight = np.clip(small / 2 + 128, 0, 255).astype(np.uint8)
    middle = (cv2.medianBlur(eight, _BACKGROUND).astype(np.float32) - 128) * 2
    return np.asarray(cv2.resize(cv2.GaussianBlur(middle, (0, 0), 2.0), (w, h), interpolation=cv2.INTER_LINEAR), dtype=np.float32)


def _noise(height: Image) -> float:
    """Standard deviation by the median, which small bright places do not move."""
    sample = height[::2, ::2]
    return 1.4826 * float(np.median(np.abs(sample - np.median(sample))))


def _peaks(height: Image, least: float) -> npt.NDArray[np.intp]:
    """Rows and columns of the local maxima above `least`, highest first, (k, 2)."""
    top = (height >= cv2.dilate(height, np.ones((5, 5), np.uint8))) & (height >= least)
    places = np.argwhere(top)
    return places[np.argsort(-height[top], kind="stable")]


def _region(height: Image, taken: npt.NDArray[np.uint8], u: int, v: int, largest: float) -> tuple[float, float, float] | None:
    """Middle and radius of what is connected to a peak and above half of it; None where it is too large."""
    reach = int(np.ceil(3 * largest)) + 2
    top, left = max(v - reach, 0), max(u - reach, 0)
    part = height[top : v + reach + 1, left : u + reach + 1]
    _, labels = cv2.connectedComponents((part > height[v, u] / 2).astype(np.uint8))
    inside = labels == labels[v - top, u - left]
    taken[top : top + part.shape[0], left : left + part.shape[1]][inside] = 1
    radius = float(np.sqrt(inside.sum() / np.pi))
    if radius > largest:
        return None
    rows, columns = np.nonzero(inside)
    return left + float(columns.mean()), top + float(rows.mean()), radius
