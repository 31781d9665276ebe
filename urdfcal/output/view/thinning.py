"""Meshes with fewer triangles: corners in one cell of a grid become one, triangles that lose a corner go (vertex clustering).

    cell = floor((p - low) / size),   size = extent of the mesh / cells

It takes any triangles, closed or not, moves no corner by more than a cell, and leaves what is coarser than the grid as it is.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from urdfcal.base.geometry import Mask, Matrix

Faces = npt.NDArray[np.intp]

FINEST, COARSEST = 1024, 24  # cells along the longest side of a mesh
_LEAST_OF_A_PART = 12  # cells along the longest side of a part of it, however small that is
_HALVINGS = 7  # of the range of cells, while the finest grid that fits is looked for: to 3 %
_BITS = 20  # of a key for the cell along each axis


@dataclass(frozen=True)
class Part:
    """A piece of a mesh: corners (v, 3) in any unit, and triangles (t, 3) of their numbers."""

    points: Matrix
    faces: Faces


@dataclass(frozen=True)
class Thinned:
    """What is left of a part.

    Attributes:
        points: The corners that are left, (k, 3).
        first: Which corner each of them was, the first of those that became one, (k,).
        faces: Triangles of their numbers, (s, 3).
        kept: Which triangles these were, (s,).
    """

    points: Matrix
    first: Faces
    faces: Faces
    kept: Faces


def count_thinned(parts: Sequence[Part], cells: float) -> int:
    """How many triangles of a mesh are left, at most."""
    extent = _extent(parts)
    return sum(int(_spanning(_keys(part, extent / cells)[part.faces]).sum()) for part in parts)


def thinned(parts: Sequence[Part], cells: float) -> list[Thinned]:
    """The parts of a mesh on a grid of so many cells along its longest side."""
    extent = _extent(parts)
    return [_thinned(part, extent / cells) for part in parts]


def cells_for(meshes: Sequence[tuple[Sequence[Part], int]], most: int) -> float:
    """The finest grid that leaves no more than so many triangles of all meshes, each of which is shown some times."""

    def fits(cells: float) -> bool:
        return sum(times * count_thinned(parts, cells) for parts, times in meshes) <= most

    if fits(FINEST):
        return float(FINEST)
    low, high = float(COARSEST), float(FINEST)
    for _ in range(_HALVINGS):
        middle = float(np.sqrt(low * high))
        low, high = (middle, high) if fits(middle) else (low, middle)
    return low


def _thinned(part: Part, size: float) -> Thinned:
    keys = _keys(part, size)
    _, first, cluster = np.unique(keys, return_index=True, return_inverse=True)
    cluster = cluster.reshape(-1)
    weight = np.bincount(cluster)
    middle = np.column_stack([np.bincount(cluster, axis) / weight for axis in part.points.T])
    spanning = np.flatnonzero(_spanning(keys[part.faces]))
    faces = cluster[part.faces[spanning]]
    once = _once(faces, len(first))
    used, renumbered = renumbering(faces[once])
    return Thinned(middle[used], first[used], renumbered[faces[once]], spanning[once])


def _once(faces: Faces, corners: int) -> Faces:
    """Which triangles are no repetition of one before, with the same side in front."""
    turned = np.take_along_axis(faces, (np.argmin(faces, axis=1)[:, None] + np.arange(3)) % 3, axis=1)
    a, b, c = turned.T
    return np.sort(np.unique((a * corners + b) * corners + c, return_index=True)[1])


def renumbering(numbers: Faces) -> tuple[Faces, Faces]:
    """Which numbers there are, rising, and the place of each number among them, by the number."""
    there = np.zeros(int(numbers.max(initial=-1)) + 1, dtype=bool)
    there[numbers] = True
    return np.flatnonzero(there), np.cumsum(there) - 1


def _keys(part: Part, size: float) -> Faces:
    """The cell of every corner as one number, (v,)."""
    if not len(part.points):
        return np.empty(0, dtype=np.intp)
    low = part.points.min(axis=0)
    own = float(np.max(part.points.max(axis=0) - low))
    cell = max(min(size, own / _LEAST_OF_A_PART), own / 2**_BITS, np.finfo(float).tiny)
    index = np.floor((part.points - low) / cell).astype(np.intp)
    return np.asarray(((index[:, 0] << (2 * _BITS)) + (index[:, 1] << _BITS)) + index[:, 2])


def _spanning(keys: Faces) -> Mask:
    """Which triangles have their corners in three cells."""
    a, b, c = keys.T
    return np.asarray((a != b) & (b != c) & (c != a))


def _extent(parts: Sequence[Part]) -> float:
    """The longest side of the largest part."""
    return max((float(np.ptp(part.points, axis=0).max()) for part in parts if len(part.points)), default=0.0)
