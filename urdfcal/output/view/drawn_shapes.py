"""A robot's shapes as meshcat objects: primitives, and mesh files as they are or as they were made lighter.

Of a mesh file nothing is read but the file itself and the textures that were looked at; a Collada file whose textures are not to be
shown is drawn without colours, as Assimp read it.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import coal
import numpy as np

from urdfcal.output.view.meshes import Faces
from urdfcal.output.view.recorder import Collada, mg
from urdfcal.output.view.shapes import Shapes
from urdfcal.output.view.stl import lit

_ROUND, _CAP = 32, 8  # corners of a capsule around its axis, and rings of each of its caps
_ALONG_Y = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])  # what turns three.js's cylinders, along y, to z


def draw_shapes(node: Any, shapes: Shapes) -> None:
    """Put every shape below a node of the scene, by its name; where they stand is the animation's."""
    for shape in shapes.model.geometryObjects:
        drawn = _object(shape, shapes)
        if isinstance(drawn, Collada):
            drawn.send(node[shape.name], _material(shape) if shape.overrideMaterial else None)
        else:
            node[shape.name].set_object(drawn, _material(shape))


class _Cylinder(mg.Cylinder):  # type: ignore[misc]
    """A cylinder along z."""

    def intrinsic_transform(self) -> Any:
        return _ALONG_Y


def _object(shape: Any, shapes: Shapes) -> Any:
    """What meshcat calls a geometry, or a Collada file."""
    form = shape.geometry
    if isinstance(form, coal.BVHModelBase):
        return _mesh(shape, shapes)
    if isinstance(form, coal.Capsule):
        return _capsule(form.radius, form.halfLength)
    if isinstance(form, coal.Cylinder):
        return _Cylinder(2 * form.halfLength, form.radius)
    if isinstance(form, coal.Box):
        return mg.Box((2 * form.halfSide).tolist())
    return mg.Sphere(form.radius)


def _mesh(shape: Any, shapes: Shapes) -> Any:
    path = shape.meshPath
    content = shapes.lighter[path] if path in shapes.lighter else Path(path).read_bytes()
    ending = Path(path).suffix.lower()
    if ending == ".stl":
        return mg.MeshGeometry(lit(content), "stl")
    if ending == ".obj":
        return mg.MeshGeometry(content.decode("utf-8", "replace"), "obj")
    textures = shapes.textures.get(path)
    if textures is not None:
        return Collada(content.decode("utf-8", "replace"), dict(textures))
    form = shape.geometry
    triangles = [form.tri_indices(number) for number in range(form.num_tris)]
    faces = [[each[0], each[1], each[2]] for each in triangles]  # these can be indexed, and not gone through
    corners = form.vertices() / shape.meshScale  # the scene scales it again
    return mg.TriangularMeshGeometry(corners.astype(np.float32), np.array(faces, dtype=np.intp).reshape(-1, 3))


def _capsule(radius: float, half: float) -> Any:
    """A capsule along z whose caps' centres are at -half and half, [m]."""
    rings = np.linspace(-np.pi / 2, np.pi / 2, 2 * _CAP)
    around = np.linspace(0, 2 * np.pi, _ROUND, endpoint=False)
    height = radius * np.sin(rings) + np.where(np.arange(2 * _CAP) < _CAP, -half, half)
    across = radius * np.cos(rings)[:, None]
    points = np.stack([across * np.cos(around), across * np.sin(around), np.broadcast_to(height[:, None], (2 * _CAP, _ROUND))], axis=-1)
    return mg.TriangularMeshGeometry(points.reshape(-1, 3), _between_rings(2 * _CAP))


def _between_rings(count: int) -> Faces:
    """Triangles between rings, one after the other."""
    ring, k = np.meshgrid(np.arange(count - 1) * _ROUND, np.arange(_ROUND), indexing="ij")
    here, after = ring + k, ring + (k + 1) % _ROUND
    faces = [np.stack([here, after, here + _ROUND], -1), np.stack([after, after + _ROUND, here + _ROUND], -1)]
    return np.concatenate(faces).reshape(-1, 3)


def _material(shape: Any) -> Any:
    red, green, blue, opacity = (float(each) for each in shape.meshColor)
    colour = sum(int(each * 255) << shift for each, shift in ((red, 16), (green, 8), (blue, 0)))
    return mg.MeshPhongMaterial(color=colour, opacity=opacity, transparent=opacity < 1)
