"""How well a corner is known from its own neighbourhood: its sharpness, the noise of the picture, and how obliquely it is seen.

A corner c minimises sum_i m_i (g_i . (p_i - c))^2 over the pixels p_i of its window (Foerstner), g_i the gradients and m_i a
bell. Noise of the gradients, sigma_g^2 each, moves it with covariance

    C = sigma_g^2 G^-1 (sum_i m_i^2 |p_i - c|^2 g_i g_i') G^-1        G = sum_i m_i g_i g_i'

so that blur, which lowers the gradients, and obliqueness, which narrows the window and turns the edges towards each other, raise it. The
noise of the picture is the median of what a mask that is blind to planes and edges gives (Immerkaer 1996).
"""

from __future__ import annotations

import cv2
import numpy as np

from urdfcal.base.geometry import Matrix, Vector
from urdfcal.vision.pictures import Grey

LEAST_SIGMA_PX, MOST_SIGMA_PX = 0.02, 5.0
_OF_WINDOW = 0.08  # px times px of window: what gradients between whole pixels are off in sharp pictures, more in smaller windows
_MASK = np.array([[1.0, -2.0, 1.0], [-2.0, 4.0, -2.0], [1.0, -2.0, 1.0]])
_ROUNDING = 0.29  # grey levels, of whole numbers
_OF_MEDIAN = 0.6745  # of a Gaussian's sigma: the median of its absolute values


def picture_noise(picture: Grey) -> float:
    """Standard deviation of a pixel's noise, in grey levels; not below that of rounding."""
    told = cv2.filter2D(picture.astype(np.float32), cv2.CV_32F, _MASK)
    return max(_ROUNDING, float(np.median(np.abs(told))) / 6.0 / _OF_MEDIAN)


def corner_sigmas(picture: Grey, pixels: Matrix, windows: Vector, noise: float) -> Vector:
    """Standard deviation of a coordinate of each corner, (n,), [px].

    Args:
        picture: Brightness, (height, width).
        pixels: Corners, (n, 2).
        windows: Half the side of the window that each was found in, (n,), [px].
        noise: Of a pixel, in grey levels.
    """
    sigmas = np.empty(len(pixels))
    for window in np.unique(windows):
        chosen = np.flatnonzero(windows == window)
        sigmas[chosen] = _of_window(picture, pixels[chosen], int(window), noise)
    without_noise = np.hypot(LEAST_SIGMA_PX, _OF_WINDOW / windows)
    return np.clip(np.hypot(sigmas, without_noise), LEAST_SIGMA_PX, MOST_SIGMA_PX)


def _of_window(picture: Grey, pixels: Matrix, window: int, noise: float) -> Vector:
    reach = np.arange(-window, window + 1, dtype=float)
    away = np.stack(np.meshgrid(reach, reach), axis=-1).reshape(-1, 2)
    bell = np.exp(-(away**2).sum(axis=1) / window**2)
    places = (pixels[:, None] + away).astype(np.float32)

    def levels(shift: tuple[int, int]) -> Matrix:
        moved = places + np.array(shift, dtype=np.float32)
        sampled = cv2.remap(picture.astype(np.float32), moved[..., 0], moved[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        return np.asarray(sampled, dtype=float)

    g = np.stack([levels((1, 0)) - levels((-1, 0)), levels((0, 1)) - levels((0, -1))], axis=-1) / 2
    G = np.einsum("i,nia,nib->nab", bell, g, g)
    middle = np.einsum("i,nia,nib->nab", bell**2 * (away**2).sum(axis=1), g, g) * noise**2 / 2
    inverse = np.linalg.pinv(G)
    variance = np.trace(inverse @ middle @ inverse, axis1=1, axis2=2) / 2
    flat = np.linalg.det(G) <= 1e-9 * np.trace(G, axis1=1, axis2=2) ** 2
    return np.asarray(np.where(flat, MOST_SIGMA_PX, np.sqrt(variance)))
