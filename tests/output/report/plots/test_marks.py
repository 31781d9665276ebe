"""Paths of lines and marks."""

from __future__ import annotations

import re

import numpy as np
import pytest

from urdfcal.output.report.plots.marks import OPEN, SHAPES, line_path, marks_path


def test_a_line_has_gaps_where_values_are_none() -> None:
    """It starts anew behind each, and a point by itself is no stroke to anywhere."""
    points = np.array([[0, 1], [2, 3.04], [np.nan, 0], [4, 5], [6, np.nan], [7, 8], [9, 10]])
    assert line_path(points) == "M0 1L2 3M4 5M7 8L9 10"


@pytest.mark.parametrize("shape", sorted({*SHAPES, *OPEN}))
def test_marks_are_around_their_points_and_of_their_size(shape: str) -> None:
    """Corners lie evenly around the point, about half the size away."""
    path = marks_path(np.array([[10.0, 20.0], [np.nan, 1.0]]), shape, 4.0)
    start, moves = re.fullmatch(r"M10 20(m[-\d.]+ [-\d.]+)(.*)", path).groups()  # type: ignore[union-attr]
    at = np.array([float(word) for word in start[1:].split()])
    if "a" in moves:
        assert at == pytest.approx([-2, 0])
        return
    corners = [at]
    for command, words in re.findall(r"([lmhv])([-\d. ]+)", re.sub(r"(?<=\d)l", " l", moves)):
        step = [float(word) for word in words.split()]
        corners.append(corners[-1] + ((step[0], 0) if command == "h" else (0, step[0]) if command == "v" else step))
    low, high = np.min(corners, axis=0), np.max(corners, axis=0)
    assert (low + high) / 2 == pytest.approx([0, 0], abs=0.4)
    assert high - low == pytest.approx([4, 4], rel=0.3)
