"""STL files: facets, each of three corners and a normal, in bytes or in words."""

from __future__ import annotations

import re

import numpy as np

from urdfcal.base.geometry import Array3, Matrix

HEAD = 84  # bytes
FACET = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
_CORNER = re.compile(rb"vertex\s+(\S+)\s+(\S+)\s+(\S+)")
_NORMAL = re.compile(rb"normal\s+(\S+)\s+(\S+)\s+(\S+)")
_LEAST_NORMAL = 0.5  # length of a normal that counts as stated


def facets_in_bytes(head: bytes, size: int) -> int | None:
    """How many facets a file of this size [bytes] states in its head; None where it has not the size of so many, and is in words."""
    count = int.from_bytes(head[HEAD - 4 : HEAD], "little")
    return count if len(head) >= HEAD and size == HEAD + FACET.itemsize * count else None


def facets_of(content: bytes) -> tuple[Array3, Matrix]:
    """Corners (t, 3, 3) and normals (t, 3) as the file has them.

    Raises:
        ValueError: some of it is no number, or the facets are not whole.
    """
    if facets_in_bytes(content, len(content)) is not None:
        facets = np.frombuffer(content, FACET, offset=HEAD)
        return facets["corners"].astype(float), facets["normal"].astype(float)
    corners = np.array(_CORNER.findall(content)).astype(float).reshape(-1, 3, 3)
    return corners, np.array(_NORMAL.findall(content)).astype(float).reshape(len(corners), 3)


def with_normals(corners: Array3, normals: Matrix) -> Matrix:
    """Unit normals of facets; those that are not stated, which would be drawn black, from the corners."""
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    found = np.where(length > _LEAST_NORMAL, normals, across)
    return np.asarray(found / np.maximum(np.linalg.norm(found, axis=1, keepdims=True), np.finfo(float).tiny))


def stl_bytes(corners: Array3, normals: Matrix) -> bytes:
    """A file of facets in bytes."""
    facets = np.zeros(len(corners), FACET)
    facets["corners"], facets["normal"] = corners, normals
    return bytes(HEAD - 4) + len(facets).to_bytes(4, "little") + facets.tobytes()


def lit(content: bytes) -> bytes:
    """A file as it can be drawn: the same bytes, or with the normals that it does not state."""
    try:
        corners, normals = facets_of(content)
    except ValueError:  # Assimp has read it: it is drawn as the browser reads it
        return content
    if (np.linalg.norm(normals, axis=1) > _LEAST_NORMAL).all():
        return content
    return stl_bytes(corners, with_normals(corners, normals))
