"""Collada files made lighter: only numbers change, and each corner keeps its own normal and its place in the texture."""

from __future__ import annotations

from typing import Any

import numpy as np
from lxml import etree

from urdfcal.base.geometry import Matrix
from urdfcal.output.view.light_file import MeshFile, OfAnotherForm, fans, in_words, numbers_in, whole_numbers_in
from urdfcal.output.view.thinning import Faces, Part, Thinned, renumbering, thinned

_PRIMITIVES = ("triangles", "polylist")
_OTHERS = ("polygons", "trifans", "tristrips", "lines", "linestrips")


class Collada(MeshFile):
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
            raise OfAnotherForm
        self._positions = self._sources[inputs["POSITION"]]
        faces = [primitive.corners[:, :, primitive.vertex] for primitive in self._primitives]
        self.part = Part(self._positions.rows, np.concatenate(faces))
        self._require_numbers_fit()

    def _require_numbers_fit(self) -> None:
        count = min(len(self._sources[name].rows) for name in self._of_vertices)
        columns = [(names, each.corners[:, :, offset]) for each in self._primitives for offset, names in each.names_of_others.items()]
        fit = all(0 <= own.min() <= own.max() < len(self._sources[name].rows) for names, own in columns for name in names if own.size)
        if not fit or count < len(self._positions.rows) or self._positions.rows.shape[1] != 3:
            raise OfAnotherForm

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
        numbers, stride = numbers_in(_text(self._array)), int(self._accessor.get("stride", "1"))
        if stride < 1 or len(numbers) % stride or self._accessor.get("offset", "0") != "0":
            raise OfAnotherForm
        self.rows: Matrix = numbers.reshape(-1, stride)

    @staticmethod
    def fits(source: Any) -> bool:
        """Whether it is a list of numbers that stand in the file."""
        accessor = source.find("{*}technique_common/{*}accessor")
        return source.find("{*}float_array") is not None and accessor is not None and accessor.get("stride", "1").isdecimal()

    def write(self, rows: Matrix) -> None:
        """Put other rows in their place."""
        self._array.text = in_words(rows)
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
            raise OfAnotherForm
        self.vertex, stride = found[0], 1 + max(int(offset) for offset, _, _ in inputs)
        self.names = {at: tuple(dict.fromkeys(name for offset, _, name in inputs if int(offset) == at)) for at in range(stride)}
        numbers = whole_numbers_in(_text(element.find("{*}p")))
        if len(numbers) % stride:
            raise OfAnotherForm
        self.corners = fans(numbers.reshape(-1, stride), self._counts(len(numbers) // stride))

    @property
    def names_of_others(self) -> dict[int, tuple[str, ...]]:
        """The lists beside the vertices, by their offset."""
        return {offset: names for offset, names in self.names.items() if offset != self.vertex and names}

    def _counts(self, corners: int) -> Faces:
        counts = self._element.find("{*}vcount")
        if counts is None and not corners % 3:
            return np.full(corners // 3, 3)
        return whole_numbers_in(_text(counts))

    def write(self, corners: Faces) -> None:
        """Put other triangles in their place."""
        name = etree.QName(self._element)
        self._element.tag = f"{{{name.namespace}}}triangles" if name.namespace else "triangles"
        for counts in self._element.findall("{*}vcount"):
            self._element.remove(counts)
        self._element.set("count", str(len(corners)))
        self._element.find("{*}p").text = " ".join(map(str, corners.reshape(-1).tolist()))


def _name(element: Any) -> str:
    return str(element.get("source", "")).removeprefix("#")


def _text(element: Any) -> bytes:
    """What stands in an element; nothing where there is none."""
    return (element.text or "").encode() if element is not None else b""
