"""Mesh files rewritten with fewer triangles, for pages that are to be passed on: STL, Wavefront OBJ and Collada.

Only numbers change: of a Collada file nodes, materials and textures stay as they are, and each corner keeps its own normal and its place
in the texture. A file of a form that is not looked for here stays as it is.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from lxml import etree

from urdfcal.output.view.light_collada import Collada
from urdfcal.output.view.light_file import MeshFile, OfAnotherForm, fans, in_words, numbers_in, whole_numbers_in
from urdfcal.output.view.stl import facets_of, stl_bytes, with_normals
from urdfcal.output.view.thinning import Part, thinned


def mesh_file(path: Path) -> MeshFile | None:
    """A file that was looked at before, read to be made lighter; None where it is of a form that is left as it is."""
    readers: dict[str, Callable[[bytes], MeshFile]] = {".stl": _Stl, ".obj": _Obj, ".dae": Collada}
    reader = readers[path.suffix.lower()]
    try:
        found = reader(path.read_bytes())
    except (OfAnotherForm, etree.XMLSyntaxError):
        return None
    fit = all(np.isfinite(part.points).all() and _within(part) for part in found.parts)
    return found if fit and any(len(part.faces) for part in found.parts) else None


def _within(part: Part) -> bool:
    return not part.faces.size or bool(part.faces.min() >= 0 and part.faces.max() < len(part.points))


class _Stl(MeshFile):
    """Facets, each with its own normal, which the one that is left of it keeps: it is lit as before."""

    def __init__(self, content: bytes) -> None:
        try:
            corners, normals = facets_of(content)
        except ValueError:
            raise OfAnotherForm from None
        self._normals = with_normals(corners, normals)
        self.parts = [Part(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3))]

    def lighter(self, cells: float) -> bytes:
        """See the base class."""
        (left,) = thinned(self.parts, cells)
        return stl_bytes(left.points[left.faces], self._normals[left.kept])


class _Obj(MeshFile):
    """Corners and faces; colours of an OBJ are not shown, and what has no normals is drawn flat."""

    def __init__(self, content: bytes) -> None:
        rows = [line.split() for line in content.splitlines()]
        points = [row[1:4] for row in rows if row[:1] == [b"v"]]
        faces = [[word.partition(b"/")[0] for word in row[1:]] for row in rows if row[:1] == [b"f"]]
        if b"\\" in content or any(len(point) != 3 for point in points) or any(len(face) < 3 for face in faces):
            raise OfAnotherForm
        places = numbers_in(b" ".join(b" ".join(point) for point in points)).reshape(-1, 3)
        corners = (
            whole_numbers_in(b" ".join(b" ".join(face) for face in faces)) - 1
        )  # a number below zero counts from behind: of another form
        self.parts = [Part(places, fans(corners[:, None], np.array([len(face) for face in faces], dtype=np.intp))[:, :, 0])]

    def lighter(self, cells: float) -> bytes:
        """See the base class."""
        (left,) = thinned(self.parts, cells)
        corners = "\n".join(f"v {in_words(point)}" for point in left.points)
        faces = "\n".join("f {} {} {}".format(*face) for face in (left.faces + 1).tolist())
        return f"{corners}\n{faces}\n".encode()
