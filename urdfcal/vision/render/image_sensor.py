"""From light on a sensor to the numbers of a picture: shot noise, read noise, uneven pixels, mosaic, tone curve, eight bits."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from urdfcal.base.geometry import Array3

Pixels = npt.NDArray[np.uint8]
Light = npt.NDArray[np.float32]
_STRIP = 64  # rows; even, so that each begins with the same colours of the mosaic


@dataclass(frozen=True)
class ImageSensor:
    """A camera's sensor and what it does to the light.

    Attributes:
        well: Electrons at full scale; shot noise is their square root.
        read: Read noise, electrons.
        uneven: Standard deviation of the pixels' own sensitivities.
        black: Offset of black, of full scale.
        mosaic: Whether each pixel sees one colour (RGGB) and the others are interpolated.
        tone: Whether the sRGB curve is applied, as in pictures for people.
    """

    well: float = 10000.0
    read: float = 12.0
    uneven: float = 0.005
    black: float = 0.01
    mosaic: bool = False
    tone: bool = False

    def expose(self, light: Array3 | Light, rng: np.random.Generator, pattern: Light | None = None) -> Pixels:
        """The picture (h, w, 3) in OpenCV's order blue, green, red, that some light (h, w, 3) makes.

        Args:
            light: Linear, 1 is full scale, red, green, blue.
            rng: Source of the noise.
            pattern: The pixels' own sensitivities, from `pattern`, which stay from picture to picture.
        """
        if self.mosaic:
            return self._with_mosaic(light, rng, pattern)
        pixels = np.empty(light.shape, np.uint8)
        for rows in strips(len(light)):
            pixels[rows] = self._numbers(self._levels(light[rows], rng, None if pattern is None else pattern[rows]))
        return pixels

    def _levels(self, light: Array3 | Light, rng: np.random.Generator, pattern: Light | None) -> Light:
        """What some rows of pixels hold, 0 to 1, with their noise."""
        level = np.clip(light, 0, 50).astype(np.float32)
        if pattern is not None:
            level *= pattern
        spread = np.sqrt(level / self.well + np.float32(self.read / self.well) ** 2)  # Poisson's is Gauss's at so many electrons
        level += spread * rng.standard_normal(level.shape, dtype=np.float32) + np.float32(self.black)
        return np.clip(level, 0, 1, out=level)

    def _numbers(self, level: Light) -> Pixels:
        """Levels as eight bits, in OpenCV's order of colours."""
        if self.tone:
            level = np.where(level <= 0.0031308, 12.92 * level, 1.055 * np.power(np.maximum(level, 1e-9), 1 / 2.4) - 0.055)
        return np.rint(255 * level).astype(np.uint8)[..., ::-1]

    def _with_mosaic(self, light: Array3 | Light, rng: np.random.Generator, pattern: Light | None) -> Pixels:
        """One colour a pixel, the rest interpolated by OpenCV's edge-aware method, which wants the whole picture."""
        raw, pixels = np.empty(light.shape[:2], np.uint16), np.empty(light.shape, np.uint8)
        for rows in strips(len(light)):
            level = self._levels(light[rows], rng, None if pattern is None else pattern[rows])
            one = level[..., 1].copy()
            one[::2, ::2], one[1::2, 1::2] = level[::2, ::2, 0], level[1::2, 1::2, 2]
            raw[rows] = np.rint(one * 65535).astype(np.uint16)
        full = cv2.cvtColor(raw, cv2.COLOR_BayerBG2RGB_EA)
        for rows in strips(len(light)):
            pixels[rows] = self._numbers(full[rows].astype(np.float32) / np.float32(65535))
        return pixels

    def pattern(self, size: tuple[int, int], rng: np.random.Generator) -> Light:
        """The sensitivities of a sensor's pixels, (h, w, 3)."""
        own = np.empty((size[1], size[0], 3), np.float32)
        for rows in strips(len(own)):
            own[rows] = 1 + self.uneven * rng.standard_normal(own[rows].shape)
        return own


def strips(height: int) -> Iterator[slice]:
    """The rows of a picture, an even number at a time: what is made on the way to a picture takes many times its own memory."""
    return (slice(top, min(top + _STRIP, height)) for top in range(0, height, _STRIP))
