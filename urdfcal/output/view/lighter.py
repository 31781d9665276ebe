"""Mesh files rewritten with fewer triangles, for pages that are to be passed on: STL, Wavefront OBJ and Collada.

Only numbers change: of a Collada file nodes, materials and textures stay as they are, and each corner keeps its own normal and its place
in the texture. A file of a form that is not looked for here stays as it is.
"""

from __future__ import annotations

import warnings
from abc import ABC, abstractmethod
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from lxml import etree

from urdfcal.base.geometry import Matrix
from urdfcal.output.view.stl import facets_of, stl_bytes, with_normals
from urdfcal.output.view.thinning import Faces, Part, Thinned, renumbering, thinned

_DIGITS = 5  # significant ones of the largest number of a list
_PRIMITIVES = ("triangles", "polylist")
_OTHERS = ("polygons", "trifans", "tristrips", "lines", "linestrips")


class MeshFile(ABC):
    """A mesh file that can be made lighter.

    Attributes:
        parts: Its triangles.
    """

    parts: list[Part]

    @abstractmethod
    def lighter(self, cells: float) -> bytes:
        """The file on a grid of so many cells along its longest side; to be asked for once."""


def mesh_file(path: Path) -> MeshFile | None:
    """A file that was looked at before, read to be made lighter; None where it is of a form that is left as it is."""
    readers: dict[str, Callable[[bytes], MeshFile]] = {".stl": _Stl, ".obj": _Obj, ".dae": _Collada}
    reader = readers[path.suffix.lower()]
    try:
        found = reader(path.read_bytes())
    except (_OfAnotherForm, etree.XMLSyntaxError):
        return None
    fit = all(np.isfinite(part.points).all() and _within(part) for part in found.parts)
    return found if fit and any(len(part.faces) for part in found.parts) else None


def _within(part: Part) -> bool:
    return not part.faces.size or bool(part.faces.min() >= 0 and part.faces.max() < len(part.points))


class _OfAnotherForm(Exception):
    """Nothing is wrong with the file; it is not one that is made lighter here."""


class _Stl(MeshFile):
    """Facets, each with its own normal, which the one that is left of it keeps: it is lit as before."""

    def __init__(self, content: bytes) -> None:
        try:
            corners, normals = facets_of(content)
        except ValueError:
            raise _OfAnotherForm from None
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
            raise _OfAnotherForm
        places = _numbers(b" ".join(b" ".join(point) for point in points)).reshape(-1, 3)
        corners = _whole(b" ".join(b" ".join(face) for face in faces)) - 1  # a number below zero counts from behind: of another form
        self.parts = [Part(places, _fans(corners[:, None], np.array([len(face) for face in faces], dtype=np.intp))[:, :, 0])]

    def lighter(self, cells: float) -> bytes:
        """See the base class."""
        (left,) = thinned(self.parts, cells)
        corners = "\n".join(f"v {_words(point)}" for point in left.points)
        faces = "\n".join("f {} {} {}".format(*face) for face in (left.faces + 1).tolist())
        return f"{corners}\n{faces}\n".encode()


class _Collada(MeshFile):
    """Geometries, each a part; one that has anything but triangles and polygons stays as it is."""

    def __init__(self, content: bytes) -> None:
        parser = etree.XMLParser(resolve_entities=False, no_network=True, huge_tree=True, remove_blank_text=True, remove_comments=True)
        self._root = etree.fromstring(content, parser)
        found = [_Geometry(mesh) for mesh in self._root.iter("{*}mesh") if _is_of_our_form(mesh)]
        self._geometries = [geometry for geometry in found if len(geometry.part.faces)]
        self.parts = [geometry.part for geometry in self._geometries]

    def lighter(self, cells: float) -> bytes:
        """See the base class."""
        for geometry, left in zip(self._geometries, thinned(self.parts, cells), strict=True):
            geometry.put(left)
        content: bytes = etree.tostring(self._root, encoding="utf-8", xml_declaration=True)
        return content


def _is_of_our_form(mesh: Any) -> bool:
    primitives = [each for name in _PRIMITIVES for each in mesh.iterfind(f"{{*}}{name}")]
    whole = all(len(each.findall("{*}p")) == 1 for each in primitives)
    others = any(mesh.find(f"{{*}}{name}") is not None for name in _OTHERS)
    return whole and not others and len(primitives) > 0 and len(mesh.findall("{*}vertices")) == 1


class _Geometry:
    """The <mesh> of one geometry: its lists of numbers, and its primitives, whose corners point into them.

    Lists that are pointed to together, by one number, are a group and stay in step.
    """

    def __init__(self, mesh: Any) -> None:
        self._sources = {each.get("id", ""): _Source(each) for each in mesh.iterfind("{*}source") if _Source.fits(each)}
        self._primitives = [_Primitive(each) for name in _PRIMITIVES for each in mesh.iterfind(f"{{*}}{name}")]
        vertices = mesh.find("{*}vertices")
        inputs = {each.get("semantic", ""): _name(each) for each in vertices.iterfind("{*}input")}
        beside = [name for primitive in self._primitives for name in primitive.names[primitive.vertex] if name != vertices.get("id")]
        self._of_vertices = tuple(dict.fromkeys((*inputs.values(), *beside)))
        groups = {tuple(names) for primitive in self._primitives for names in primitive.names_of_others.values()}
        every = [name for group in (self._of_vertices, *groups) for name in group]
        if "POSITION" not in inputs or len(set(every)) < len(every) or not set(every) <= set(self._sources):
            raise _OfAnotherForm
        self._positions = self._sources[inputs["POSITION"]]
        faces = [primitive.corners[:, :, primitive.vertex] for primitive in self._primitives]
        self.part = Part(self._positions.rows, np.concatenate(faces))
        self._require_numbers_fit()

    def _require_numbers_fit(self) -> None:
        count = min(len(self._sources[name].rows) for name in self._of_vertices)
        columns = [(names, each.corners[:, :, offset]) for each in self._primitives for offset, names in each.names_of_others.items()]
        fit = all(0 <= own.min() <= own.max() < len(self._sources[name].rows) for names, own in columns for name in names if own.size)
        if not fit or count < len(self._positions.rows) or self._positions.rows.shape[1] != 3:
            raise _OfAnotherForm

    def put(self, left: Thinned) -> None:
        """Write what is left into the document."""
        for source in (self._sources[name] for name in self._of_vertices):
            source.write(left.points if source is self._positions else source.rows[left.first])
        edges = np.cumsum([0, *(len(primitive.corners) for primitive in self._primitives)])
        corners = []
        for primitive, low, high in zip(self._primitives, edges, edges[1:], strict=False):
            own = (left.kept >= low) & (left.kept < high)
            corners.append(primitive.corners[left.kept[own] - low])
            corners[-1][:, :, primitive.vertex] = left.faces[own]
        self._drop_unused(corners)
        for own, primitive in zip(corners, self._primitives, strict=True):
            primitive.write(own)

    def _drop_unused(self, corners: list[Faces]) -> None:
        """Leave of normals and places in textures those that some corner has."""
        columns: dict[tuple[str, ...], list[Faces]] = {}
        for own, primitive in zip(corners, self._primitives, strict=True):
            for offset, names in primitive.names_of_others.items():
                columns.setdefault(names, []).append(own[:, :, offset])
        for names, pointing in columns.items():
            used, renumbered = renumbering(np.concatenate([each.reshape(-1) for each in pointing]))
            for source in (self._sources[name] for name in names):
                source.write(source.rows[used])
            for each in pointing:
                each[...] = renumbered[each]


class _Source:
    """A list of numbers, so many a row."""

    def __init__(self, source: Any) -> None:
        self._array, self._accessor = source.find("{*}float_array"), source.find("{*}technique_common/{*}accessor")
        numbers, stride = _numbers(_text(self._array)), int(self._accessor.get("stride", "1"))
        if stride < 1 or len(numbers) % stride or self._accessor.get("offset", "0") != "0":
            raise _OfAnotherForm
        self.rows: Matrix = numbers.reshape(-1, stride)

    @staticmethod
    def fits(source: Any) -> bool:
        """Whether it is a list of numbers that stand in the file."""
        accessor = source.find("{*}technique_common/{*}accessor")
        return source.find("{*}float_array") is not None and accessor is not None and accessor.get("stride", "1").isdecimal()

    def write(self, rows: Matrix) -> None:
        """Put other rows in their place."""
        self._array.text = _words(rows)
        self._array.set("count", str(rows.size))
        self._accessor.set("count", str(len(rows)))


class _Primitive:
    """Triangles, or polygons cut into triangles: which row of each list each corner has.

    Attributes:
        corners: (t, 3, offsets).
        vertex: The offset of the vertices.
        names: The lists that each offset points into.
    """

    def __init__(self, element: Any) -> None:
        self._element = element
        inputs = [(each.get("offset", ""), each.get("semantic"), _name(each)) for each in element.iterfind("{*}input")]
        found = [int(offset) for offset, semantic, _ in inputs if semantic == "VERTEX" and offset.isdecimal()]
        if len(found) != 1 or not all(offset.isdecimal() for offset, _, _ in inputs):
            raise _OfAnotherForm
        self.vertex, stride = found[0], 1 + max(int(offset) for offset, _, _ in inputs)
        self.names = {at: tuple(dict.fromkeys(name for offset, _, name in inputs if int(offset) == at)) for at in range(stride)}
        numbers = _whole(_text(element.find("{*}p")))
        if len(numbers) % stride:
            raise _OfAnotherForm
        self.corners = _fans(numbers.reshape(-1, stride), self._counts(len(numbers) // stride))

    @property
    def names_of_others(self) -> dict[int, tuple[str, ...]]:
        """The lists beside the vertices, by their offset."""
        return {offset: names for offset, names in self.names.items() if offset != self.vertex and names}

    def _counts(self, corners: int) -> Faces:
        counts = self._element.find("{*}vcount")
        if counts is None and not corners % 3:
            return np.full(corners // 3, 3)
        return _whole(_text(counts))

    def write(self, corners: Faces) -> None:
        """Put other triangles in their place."""
        name = etree.QName(self._element)
        self._element.tag = f"{{{name.namespace}}}triangles" if name.namespace else "triangles"
        for counts in self._element.findall("{*}vcount"):
            self._element.remove(counts)
        self._element.set("count", str(len(corners)))
        self._element.find("{*}p").text = " ".join(map(str, corners.reshape(-1).tolist()))


def _fans(corners: Faces, counts: Faces) -> Faces:
    """Polygons of so many corners each, (c, k), cut into triangles about their first corners, (t, 3, k)."""
    if counts.sum() != len(corners) or (len(counts) and counts.min() < 3):
        raise _OfAnotherForm
    first = np.cumsum(counts) - counts
    cut = np.repeat(first, counts - 2)
    within = np.arange(len(cut)) - np.repeat(np.cumsum(counts - 2) - (counts - 2), counts - 2)
    return np.asarray(corners[np.stack([cut, cut + within + 1, cut + within + 2], axis=-1)])


def _name(element: Any) -> str:
    return str(element.get("source", "")).removeprefix("#")


def _text(element: Any) -> bytes:
    """What stands in an element; nothing where there is none."""
    return (element.text or "").encode() if element is not None else b""


def _numbers(text: bytes) -> Matrix:
    """Numbers with white space between them, (n,)."""
    return np.asarray(_read(text, np.float64))


def _whole(text: bytes) -> Faces:
    """Whole numbers with white space between them, (n,)."""
    return np.asarray(_read(text, np.int64), dtype=np.intp)


def _read(text: bytes, kind: Any) -> Any:
    with warnings.catch_warnings():
        warnings.simplefilter("error", DeprecationWarning)  # how numpy says that it found something else
        try:
            return np.fromstring(text, dtype=kind, sep=" ")
        except (DeprecationWarning, ValueError):
            raise _OfAnotherForm from None


def _words(rows: Matrix) -> str:
    """Numbers as they are written, to a share of the largest that cannot be seen."""
    largest = float(np.abs(rows).max()) if rows.size else 0.0
    digits = _DIGITS - 1 - int(np.floor(np.log10(largest))) if largest > 0 else 0
    return " ".join(map(repr, (np.round(rows, digits) + 0.0).ravel().tolist()))
