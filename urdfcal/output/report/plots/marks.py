"""Lines and marks as paths of SVG, in hundreds of bytes where a shape for each would take tens of thousands."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from urdfcal.base.geometry import Matrix

DOT, RING = "o", "O"
SHAPES = "os^Dv*PX"  # a frame's mark by its number, so that figures can be read without their colours
OPEN = "oO+"  # the numbers of one reading: filled, hollow, a cross


def line_path(points: Matrix) -> str:
    """A line through points (n, 2) [px], with gaps where they are nan."""
    words, up = [], True
    seen = np.isfinite(points)[:, 0] & np.isfinite(points)[:, 1]
    for (x, y), there in zip(np.round(points, 1).tolist(), seen.tolist(), strict=True):
        if there:
            words.append(f"{'M' if up else 'L'}{x:g} {y:g}")
        up = not there
    return "".join(words)


def marks_path(points: Matrix, shape: str, size: float) -> str:
    """A mark of some size across [px] at each point (n, 2)."""
    stroke = _STROKES[shape](size / 2)
    good = points[np.isfinite(points).all(axis=1)]
    return "".join(f"M{x:g} {y:g}{stroke}" for x, y in np.round(good, 1).tolist())


def is_open(shape: str) -> bool:
    """Whether a mark is drawn by its outline."""
    return shape in "O+X"


def _circle(half: float) -> str:
    return f"m{-half:g} 0a{half:g} {half:g} 0 1 0 {2 * half:g} 0a{half:g} {half:g} 0 1 0 {-2 * half:g} 0z"


def _polygon(*corners: tuple[float, float]) -> Callable[[float], str]:
    """A shape through corners in units of half the size, around the mark's place."""
    steps = np.diff([(0.0, 0.0), *corners], axis=0).tolist()

    def stroke(half: float) -> str:
        return f"m{'l'.join(f'{half * x:.3g} {half * y:.3g}' for x, y in steps)}z"

    return stroke


def _star(half: float) -> str:
    turns = np.pi * (np.arange(10) / 5 - 0.5)
    far = np.where(np.arange(10) % 2, 0.5, 1.25)
    corners = [(float(x), float(y)) for x, y in np.round(np.stack([far * np.cos(turns), far * np.sin(turns)], axis=1), 3)]
    return _polygon(*corners)(half)


_PLUS = ((-0.35, -1), (0.35, -1), (0.35, -0.35), (1, -0.35), (1, 0.35), (0.35, 0.35), (0.35, 1), (-0.35, 1))
_STROKES: dict[str, Callable[[float], str]] = {
    "o": _circle,
    "O": _circle,
    "s": _polygon((-0.9, -0.9), (0.9, -0.9), (0.9, 0.9), (-0.9, 0.9)),
    "^": _polygon((0, -1.1), (1.05, 0.85), (-1.05, 0.85)),
    "v": _polygon((0, 1.1), (1.05, -0.85), (-1.05, -0.85)),
    "D": _polygon((0, -1.2), (1.2, 0), (0, 1.2), (-1.2, 0)),
    "P": _polygon(*_PLUS, (-0.35, 0.35), (-1, 0.35), (-1, -0.35), (-0.35, -0.35)),
    "*": _star,
    "+": lambda half: f"m{-half:g} 0h{2 * half:g}m{-half:g} {-half:g}v{2 * half:g}",
    "X": lambda half: f"m{-half:g} {-half:g}l{2 * half:g} {2 * half:g}m0 {-2 * half:g}l{-2 * half:g} {2 * half:g}",
}
