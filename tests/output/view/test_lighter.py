"""Meshes with fewer triangles: what is left, where it is, and that colours, textures and light stay."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path

import coal
import numpy as np
import pytest
from lxml import etree

from tests.support.meshes import STL, collada, showing
from urdfcal.base.geometry import Matrix
from urdfcal.output.view import light_meshes
from urdfcal.output.view.lighter import mesh_file
from urdfcal.output.view.shapes import robot_shapes
from urdfcal.output.view.stl import lit
from urdfcal.output.view.thinning import Faces, Part, cells_for, count_thinned, thinned

CELLS = 24.0


def ball(rings: int = 60) -> tuple[Matrix, Faces]:
    """A ball of radius 1 about (5, 0, 0), closed."""
    down, around = np.meshgrid(np.linspace(0, np.pi, rings), np.linspace(0, 2 * np.pi, 2 * rings, endpoint=False), indexing="ij")
    points = np.stack([5 + np.sin(down) * np.cos(around), np.sin(down) * np.sin(around), np.cos(down)], -1).reshape(-1, 3)
    ring, k = np.meshgrid(np.arange(rings - 1) * 2 * rings, np.arange(2 * rings), indexing="ij")
    here, after = ring + k, ring + (k + 1) % (2 * rings)
    faces = [np.stack([here, here + 2 * rings, after], -1), np.stack([after, here + 2 * rings, after + 2 * rings], -1)]
    return points, np.concatenate(faces).reshape(-1, 3)


def stl(points: Matrix, faces: Faces, normals: bool = True) -> bytes:
    """An STL in bytes, its normals outwards from (5, 0, 0), or none."""
    out = points[faces].mean(axis=1) - (5, 0, 0)
    out = out / np.linalg.norm(out, axis=1, keepdims=True) * normals
    rows = (struct.pack("<12fH", *n, *c.ravel(), 0) for n, c in zip(out, points[faces], strict=True))
    return bytes(80) + struct.pack("<I", len(faces)) + b"".join(rows)


def obj(points: Matrix, faces: Faces) -> bytes:
    """A Wavefront OBJ."""
    return "\n".join(["v {} {} {}".format(*p) for p in points] + ["f {} {} {}".format(*(f + 1)) for f in faces]).encode()


def textured(points: Matrix, faces: Faces) -> bytes:
    """A Collada file whose corners have normals and places in a picture that say where they are: the corner's own x, y and z."""

    def source(name: str, rows: Matrix) -> str:
        numbers = " ".join(map(str, rows.ravel()))
        names = "".join(f'<param name="{each}" type="float"/>' for each in ("ST" if rows.shape[1] == 2 else "XYZ"))
        accessor = f'<accessor source="#{name}a" count="{len(rows)}" stride="{rows.shape[1]}">{names}</accessor>'
        array = f'<float_array id="{name}a" count="{rows.size}">{numbers}</float_array>'
        return f'<source id="{name}">{array}<technique_common>{accessor}</technique_common></source>'

    lists = source("p", points) + source("n", points - (5, 0, 0)) + source("t", points[:, :2])
    pointed = (("VERTEX", "v"), ("NORMAL", "n"), ("TEXCOORD", "t"))
    inputs = "".join(f'<input semantic="{what}" source="#{name}" offset="{at}"/>' for at, (what, name) in enumerate(pointed))
    numbers = " ".join(map(str, np.repeat(faces, 3, axis=1).ravel()))
    mesh = (
        f'{lists}<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>'
        f'<polylist material="m" count="{len(faces)}">{inputs}<vcount>{"3 " * len(faces)}</vcount><p>{numbers}</p></polylist>'
    )
    text = collada(textures=("own.png",))
    start, end = text.index("<mesh>") + 6, text.index("</mesh>")
    return (text[:start] + mesh + text[end:]).encode()


FORMS: dict[str, Callable[[Matrix, Faces], bytes]] = {".stl": stl, ".obj": obj, ".dae": textured}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A ball in every form, with a picture beside it."""
    there = tmp_path_factory.mktemp("balls")
    for ending, written in FORMS.items():
        (there / f"ball{ending}").write_bytes(written(*ball()))
    return there


@pytest.mark.parametrize("ending", FORMS)
def test_fewer_triangles_are_the_same_ball(folder: Path, ending: str) -> None:
    """Assimp reads as many triangles from the lighter file as were counted, all corners within a cell of the ball."""
    file = mesh_file(folder / f"ball{ending}")
    assert file is not None
    light, left = folder / f"light{ending}", count_thinned(file.parts, CELLS)
    light.write_bytes(file.lighter(CELLS))
    read = coal.MeshLoader().load(str(light), np.ones(3))
    assert 200 < read.num_tris <= left < len(ball()[1]) / 2
    assert left - read.num_tris < 0.05 * left  # lines at the poles, that one reader drops
    assert np.abs(np.linalg.norm(read.vertices() - (5, 0, 0), axis=1) - 1).max() < 2 / CELLS


def test_corners_keep_their_normals_and_textures(folder: Path) -> None:
    """In the lighter Collada file normal and place in the picture of every corner are those of a corner in its cell."""
    file = mesh_file(folder / "ball.dae")
    assert file is not None
    root = etree.fromstring(file.lighter(CELLS))
    lists = {each.get("id"): np.array(each.find("{*}float_array").text.split(), float) for each in root.iter("{*}source")}
    corners = np.array(root.find(".//{*}triangles/{*}p").text.split(), int).reshape(-1, 3)
    places, normals, pictures = lists["p"].reshape(-1, 3), lists["n"].reshape(-1, 3), lists["t"].reshape(-1, 2)
    at = places[corners[:, 0]]
    assert np.abs(at - (5, 0, 0) - normals[corners[:, 1]]).max() < 2 / CELLS
    assert np.abs(at[:, :2] - pictures[corners[:, 2]]).max() < 2 / CELLS
    assert root.find(".//{*}image/{*}init_from").text == "own.png"
    assert root.find(".//{*}triangles").get("material") == "m"
    assert [each.get("count") for each in root.iter("{*}accessor")] == [str(len(own)) for own in (places, normals, pictures)]


def test_facets_are_lit_as_before(folder: Path) -> None:
    """Facets of a lighter STL have normals of facets that were there, which on a ball point outwards."""
    file = mesh_file(folder / "ball.stl")
    assert file is not None
    facets = np.frombuffer(file.lighter(CELLS)[84:], np.dtype([("n", "<f4", 3), ("c", "<f4", (3, 3)), ("a", "<u2")]))
    out = facets["c"].mean(axis=1) - (5, 0, 0)
    assert np.sum(out * facets["n"], axis=1).min() > 0.8


def test_what_is_coarser_than_the_grid_stays() -> None:
    """A box keeps its twelve triangles, its corners and their order on any grid."""
    points = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
    faces = np.array([[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5]])
    (left,) = thinned([Part(points, faces)], CELLS)
    np.testing.assert_array_equal(left.points[left.faces], points[faces])


def test_the_finest_grid_that_fits_is_taken() -> None:
    """The triangles that are left are no more than asked for, and not far fewer; a small share is not needed."""
    part = Part(*ball())
    cells = cells_for([((part,), 2)], 10_000)
    assert 0.75 * 10_000 < 2 * count_thinned([part], cells) <= 10_000


def test_a_facet_without_a_normal_gets_one() -> None:
    """Normals of length zero, with which facets would be drawn black, are the facets' own; stated ones stay to the bit."""
    points, faces = ball(12)
    stated = stl(points, faces)
    assert lit(stated) == stated
    found = np.frombuffer(lit(stl(points, faces, normals=False))[84:], np.dtype([("n", "<f4", 3), ("c", "<f4", (3, 3)), ("a", "<u2")]))
    area = np.linalg.norm(np.cross(found["c"][:, 1] - found["c"][:, 0], found["c"][:, 2] - found["c"][:, 0]), axis=1)
    whole = area > 1e-6  # at the poles triangles are lines
    assert whole.mean() > 0.9
    assert np.sum((found["c"].mean(axis=1) - (5, 0, 0)) * found["n"], axis=1)[whole].min() > 0.9
    words = STL.replace("normal 0 0 1", "normal 0 0 0").encode()
    assert np.frombuffer(lit(words)[84:96], "<f4").tolist() == [0, 0, 1]


@pytest.mark.parametrize("ending", FORMS)
def test_a_robot_with_too_many_triangles_is_made_lighter(folder: Path, ending: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Above the limit shapes are rewritten to fit, at the same place and size; below it nothing is."""
    robot = showing(f"ball{ending}", folder)
    whole = robot_shapes(robot)
    monkeypatch.setattr(light_meshes, "MOST_TRIANGLES", 5000)
    light = robot_shapes(robot)
    shape, before = (each.model.geometryObjects[each.model.getGeometryId("upper_0")] for each in (light, whole))
    assert not whole.lighter
    assert len(light.lighter[shape.meshPath]) < 0.4 * (folder / f"ball{ending}").stat().st_size
    assert shape.geometry.num_tris <= 5000 < before.geometry.num_tris
    q = np.zeros(robot.model.nq)
    assert np.abs(light.corners(robot, q).mean(axis=0) - whole.corners(robot, q).mean(axis=0)).max() < 0.02
    assert shape.meshPath not in light.warnings


@pytest.mark.parametrize(
    "change",
    [("<p>0 1 2</p>", "<p>0 1 7</p>"), ("<p>0 1 2</p>", "<p>0 1</p>"), ("<p>0 1 2</p>", "<p>0 1 x</p>"), ('source="#p"', 'source="#q"')],
    ids=str,
)
def test_a_file_of_another_form_stays(tmp_path: Path, change: tuple[str, str]) -> None:
    """What does not point where it says, or holds no numbers, is not rewritten."""
    file = tmp_path / "mesh.dae"
    file.write_text(collada().replace(*change))
    assert mesh_file(file) is None
