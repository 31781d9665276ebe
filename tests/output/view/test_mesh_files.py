"""What a description may put into the page: its own meshes and textures, of a stated size; all else is a simple shape and a line."""

from __future__ import annotations

import base64
import contextlib
import gzip
import os
import re
import struct
import time
import zlib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.support.meshes import OBJ, STL, TRIANGLE, collada, showing
from tests.support.small_robot import robot_of
from urdfcal.base.errors import RobotError
from urdfcal.output.view import collada as limits
from urdfcal.output.view import mesh_files
from urdfcal.output.view.collada import scan_collada
from urdfcal.output.view.shapes import Shapes, robot_shapes
from urdfcal.output.view.viewer import view_of
from urdfcal.robot.robot import Robot

SECRET = "SECRET-TOKEN-abc123"
PNG = cv2.imencode(".png", np.full((4, 4, 3), 200, np.uint8))[1].tobytes()
ENTITY = b'<!DOCTYPE COLLADA [<!ENTITY x SYSTEM "file:///etc/passwd">]>'
OUTSIDE = (
    "../../secret/own.png",
    "../../secret/id_rsa",
    "/proc/self/environ",
    "/etc/hostname",
    "{secret}/own.png",
    "file://{secret}/own.png",
)


@pytest.fixture
def secret(tmp_path: Path) -> Path:
    """Meshes and pictures that are not the robot's, beside its folder."""
    folder = tmp_path / "secret"
    folder.mkdir()
    (folder / "id_rsa").write_text(SECRET)
    (folder / "own.stl").write_text(STL + SECRET)
    (folder / "own.obj").write_text(OBJ + "# " + SECRET)
    (folder / "own.dae").write_text(collada() + f"<!-- {SECRET} -->")
    (folder / "own.png").write_bytes(PNG + SECRET.encode())
    return folder


@pytest.fixture
def home(tmp_path: Path) -> Path:
    """The robot's folder."""
    folder = tmp_path / "home"
    (folder / "meshes").mkdir(parents=True)
    return folder


def is_shown(shapes: Shapes) -> bool:
    """Whether the mesh of `upper` is drawn, and not simple shapes."""
    return "upper" not in shapes.simple and "upper_0" in {shape.name for shape in shapes.model.geometryObjects}


def content_of(robot: Robot) -> bytes:
    """All that is in the page, base64 undone."""
    page = view_of(robot).html
    scene = re.search(r'id="urdfcal-scene">([^<]*)<', page)
    assert scene
    commands = gzip.decompress(base64.b64decode(scene[1]))
    pictures = [base64.b64decode(found) for found in re.findall(rb"base64,([A-Za-z0-9+/=]+)", commands)]
    return b"\n".join([page.encode(), commands, *pictures])


def refused(robot: Robot, words: str) -> None:
    """The link is a simple shape, one line says why, and nothing of the secret is in the page."""
    shapes = robot_shapes(robot)
    assert not is_shown(shapes)
    assert [bool(re.search(words, line)) for line in shapes.warnings] == [True]
    assert "\n" not in shapes.warnings[0]
    assert SECRET.encode() not in content_of(robot)


@pytest.mark.parametrize("ending", ["stl", "obj", "dae"])
@pytest.mark.parametrize(
    "named",
    [
        "{secret}/own.{ending}",
        "file://{secret}/own.{ending}",
        "../secret/own.{ending}",
        "meshes/../../secret/own.{ending}",
        "link.{ending}",
        "meshes/folder/own.{ending}",
        "package://arm/../../../secret/own.{ending}",
    ],
)
def test_meshes_of_others_are_not_read(home: Path, secret: Path, named: str, ending: str) -> None:
    """By whatever road: absolute, as a URI, upwards, out of a package, by links to files and to folders."""
    (home / f"link.{ending}").symlink_to(secret / f"own.{ending}")
    (home / "meshes" / "folder").symlink_to(secret, target_is_directory=True)
    (home / "packages" / "arm").mkdir(parents=True)
    robot = showing(named.format(secret=secret, ending=ending), home)
    robot = replace(robot, description=replace(robot.description, package_dirs=(home / "packages",)))
    refused(robot, "lies outside the folders of the description and of packages; .*--package-dir")


@pytest.mark.parametrize("ending", ["stl", "obj", "dae"])
def test_package_dir_makes_a_folder_the_robots_own(home: Path, secret: Path, ending: str) -> None:
    """The way out that the warning names."""
    robot = showing(f"../secret/own.{ending}", home)
    assert is_shown(robot_shapes(replace(robot, description=replace(robot.description, package_dirs=(secret,)))))


@pytest.mark.parametrize(
    "named",
    ["meshes/a.stl", "./meshes/a.stl", "{home}/meshes/a.stl", "file://{home}/meshes/a.stl", "meshes/link.stl", "urdf/../meshes/a.stl"],
)
def test_the_robots_own_meshes_are_shown(home: Path, named: str) -> None:
    """Also by links that stay in its folder."""
    (home / "urdf").mkdir()
    (home / "meshes" / "a.stl").write_text(STL)
    (home / "meshes" / "link.stl").symlink_to("a.stl")
    shapes = robot_shapes(showing(named.format(home=home), home))
    assert is_shown(shapes)
    assert shapes.warnings == ()


def test_a_description_has_the_package_that_it_is_in(home: Path) -> None:
    """`../meshes` from its folder `urdf` is usual; without a package.xml above it --package-dir is asked for."""
    (home / "urdf").mkdir()
    (home / "meshes" / "a.stl").write_text(STL)
    refused(showing("../meshes/a.stl", home / "urdf"), "--package-dir")
    (home / "package.xml").write_text("<package><name>arm</name></package>")
    assert is_shown(robot_shapes(showing("../meshes/a.stl", home / "urdf")))


def test_an_installed_package_may_link_to_its_sources(tmp_path: Path, home: Path, secret: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As colcon's --symlink-install leaves it; a link to anything but the same package is another's."""
    source, share = tmp_path / "src" / "arm", tmp_path / "install" / "share" / "arm"
    for folder in (source / "meshes", share / "meshes"):
        folder.mkdir(parents=True)
    (source / "package.xml").write_text("<package><name>arm</name></package>")
    (source / "meshes" / "a.stl").write_text(STL)
    (share / "meshes" / "a.stl").symlink_to(source / "meshes" / "a.stl")
    (share / "meshes" / "b.stl").symlink_to(secret / "own.stl")
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path / "install"))
    for named in ("package://arm/meshes/a.stl", f"{share}/meshes/a.stl"):
        assert is_shown(robot_shapes(showing(named, home)))
    refused(showing("package://arm/meshes/b.stl", home), "lies outside")
    refused(showing(f"{source}/meshes/a.stl", home), "lies outside")


def test_a_link_that_ends_otherwise_is_judged_by_its_end(home: Path) -> None:
    """What a name promises counts for nothing."""
    (home / ".key").write_text(SECRET)
    (home / "a.obj").symlink_to(".key")
    refused(showing("a.obj", home), r"none of \.dae, \.obj, \.stl")


@pytest.mark.parametrize("ending", ["stl", "obj", "dae"])
@pytest.mark.parametrize("make", [os.mkfifo, os.mkdir], ids=["pipe", "folder"])
def test_what_is_no_regular_file_is_not_opened(home: Path, ending: str, make: Callable[[Path], None]) -> None:
    """A pipe would be waited for without end."""
    make(home / f"a.{ending}")
    refused(showing(f"a.{ending}", home), "no regular file")


@pytest.mark.parametrize("target", ["/dev/zero", "/proc/self/environ", "a.stl"], ids=["device", "process", "itself"])
def test_links_to_devices_and_in_circles_are_refused(home: Path, target: str) -> None:
    """They lead out of the folder, or nowhere."""
    (home / "a.stl").symlink_to(target)
    refused(showing("a.stl", home), "lies outside|was not found")


@pytest.mark.parametrize(
    "name", ["x" * 5000 + ".stl", "a&#10;b.stl", "\\\\host\\share\\a.stl", "http://192.0.2.1/a.stl", "file://host/a.stl"]
)
def test_names_that_can_be_no_file_are_said(home: Path, name: str) -> None:
    """Nothing is fetched."""
    refused(showing(name, home), "was not found")


@pytest.mark.parametrize("ending", ["stl", "obj", "dae"])
def test_a_mesh_that_is_too_large_is_not_read(home: Path, ending: str) -> None:
    """A file of a terabyte without content: were it read, this test would not end."""
    with (home / f"a.{ending}").open("wb") as file:
        file.truncate(10**12)
    refused(showing(f"a.{ending}", home), "has 1000000 MB, the most is 40 MB")


def test_all_meshes_together_have_a_limit(home: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each may be small; the one that is too much is a simple shape."""
    monkeypatch.setattr(mesh_files, "MOST_TOGETHER", int(1.5 * len(STL)))
    (home / "a.stl").write_text(STL)
    files = mesh_files.MeshFiles(showing("a.stl", home).description)
    files.find("a.stl")
    with pytest.raises(RobotError, match="more than 0 MB"):
        files.find("a.stl")


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("a.stl", b"\0" * 80 + struct.pack("<I", 4_000_000_000), "no STL"),
        ("a.stl", b"id_rsa " + SECRET.encode(), "no STL"),
        ("a.stl", b"", "no STL"),
        ("a.obj", SECRET.encode(), "no faces"),
        ("a.dae", SECRET.encode(), "no whole XML"),
        ("a.dae", b"<svg/>", "no Collada"),
        (
            "a.dae",
            b'<!DOCTYPE COLLADA [<!ENTITY x SYSTEM "file:///etc/passwd">]>' + collada("<node>&x;</node>")[21:].encode(),
            "document type",
        ),
    ],
)
def test_content_must_be_what_the_name_says(home: Path, name: str, content: bytes, words: str) -> None:
    """Assimp guesses kinds from content, and some of them open other files; here the ending decides."""
    (home / name).write_bytes(content)
    refused(showing(name, home), words)


def nested(depth: int) -> str:
    """Nodes within nodes."""
    return collada("<node>" * depth + TRIANGLE + "</node>" * depth)


def doubled(generations: int) -> str:
    """Nodes each of which holds the next one twice."""
    inside = "".join(f'<node id="n{k}">{2 * f"<instance_node url=#n{k + 1}/>"}</node>' for k in range(generations))
    library = f'<library_nodes>{inside}<node id="n{generations}">{TRIANGLE}</node></library_nodes>'
    return collada('<node id="r"><instance_node url="#n0"/></node>', re.sub(r"url=(#\w+)", r'url="\1"', library))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (collada(f'<node id="a">{TRIANGLE}<instance_node url="#a"/></node>'), "within themselves"),
        (collada(f'<node id="a">{TRIANGLE}<node id="b"><instance_node url="#a"/></node></node>'), "within themselves"),
        (collada(f'<node id="a">{TRIANGLE}<instance_node url="#s"/></node>'), "within themselves"),
        (nested(50_000), "within one another"),
        (doubled(40), "unfold to more than 10000"),
        (collada(10_001 * f"<node>{TRIANGLE}</node>"), "unfold to more than 10000"),
    ],
    ids=["itself", "grandchild", "scene", "deep", "doubling", "many"],
)
def test_a_collada_file_that_would_end_the_process_is_not_built(home: Path, text: str, words: str) -> None:
    """Assimp runs out of stack or memory over each of them, which nothing can catch."""
    (home / "a.dae").write_text(text)
    refused(showing("a.dae", home), words)


def test_usual_nesting_is_shown(home: Path) -> None:
    """Far below the limits, with nodes used several times."""
    for text in (nested(60), doubled(6)):
        (home / "a.dae").write_text(text)
        assert is_shown(robot_shapes(showing("a.dae", home)))


def test_elements_are_counted_while_they_are_read(monkeypatch: pytest.MonkeyPatch) -> None:
    """A tree of all of them is never built."""
    monkeypatch.setattr(limits, "MOST_ELEMENTS", 100)
    with pytest.raises(RobotError, match="more than 100 elements"):
        scan_collada(collada("<extra/>" * 100).encode())


@pytest.mark.parametrize(
    "named",
    [
        "../../secret/own.png",
        "../../secret/id_rsa",
        "/proc/self/environ",
        "/etc/hostname",
        "{secret}/own.png",
        "file://{secret}/own.png",
        "link.png",
    ],
)
def test_textures_of_others_are_not_put_into_the_page(home: Path, secret: Path, named: str) -> None:
    """The mesh is drawn without colours, and one line says why."""
    (home / "meshes" / "link.png").symlink_to(secret / "own.png")
    (home / "meshes" / "a.dae").write_text(collada(textures=(named.format(secret=secret),)))
    robot = showing("meshes/a.dae", home)
    shapes = robot_shapes(robot)
    assert is_shown(shapes)
    assert re.search("1 meshes are drawn without colours, .*lies outside", *shapes.warnings)
    content = content_of(robot)
    assert SECRET.encode() not in content
    for found in (b"PATH=", b"base64,/"):
        assert found not in content
    hostname = Path("/etc/hostname")
    assert not hostname.is_file() or base64.b64encode(hostname.read_bytes()) not in content


def huge_png() -> bytes:
    """400 megapixels in a few bytes."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = struct.pack(">IIBBBBB", 20_000, 20_000, 1, 0, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + chunk(b"IDAT", zlib.compress(b"\0" * (2501 * 20_000))) + chunk(b"IEND", b"")


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (SECRET.encode(), "none of the pictures"),
        (f'<svg xmlns="http://www.w3.org/2000/svg"><text>{SECRET}</text></svg>'.encode(), "none of the pictures"),
        (PNG[:33] + SECRET.encode(), "not readable as a picture"),
        (b"GIF89a\x01\0\x01\0" + SECRET.encode(), "not readable as a picture"),
        (huge_png(), "20000 x 20000 pixels, the most is 33554432"),
    ],
    ids=["text", "svg", "no pixels", "gif", "huge"],
)
def test_textures_must_be_pictures(home: Path, capfd: pytest.CaptureFixture[str], content: bytes, words: str) -> None:
    """Of a kind that a browser shows, decoded once, of a stated size; libraries say nothing of their own."""
    (home / "t.png").write_bytes(content)
    (home / "a.dae").write_text(collada(textures=("t.png",)))
    robot = showing("a.dae", home)
    assert re.search(f"without colours.*t.png.*{words}", *robot_shapes(robot).warnings)
    assert SECRET.encode() not in content_of(robot)
    assert capfd.readouterr() == ("", "")


def test_own_textures_are_in_the_page_once_read(home: Path) -> None:
    """To the byte, by the name that the file has for them."""
    (home / "meshes" / "t x.png").write_bytes(PNG)
    (home / "meshes" / "a.dae").write_text(collada(textures=("./t x.png",)))
    shapes = robot_shapes(showing("meshes/a.dae", home))
    assert shapes.warnings == ()
    assert shapes.textures == {str(home / "meshes" / "a.dae"): {"./t x.png": "data:image/png;base64," + base64.b64encode(PNG).decode()}}
    assert PNG in content_of(showing("meshes/a.dae", home))


@pytest.mark.parametrize("line", ["mtllib pipe.mtl", "  mtllib\tpipe.mtl  ", "mtllib \\\npipe.mtl", "x\rmtllib a b pipe.mtl", ""])
def test_materials_beside_a_mesh_are_not_waited_for(home: Path, line: str) -> None:
    """Assimp opens what an .obj names, and the file of its own name; both may be pipes."""
    os.mkfifo(home / ("pipe.mtl" if line else "a.mtl"))
    (home / "a.obj").write_bytes(f"{line}\n{OBJ}".encode())
    refused(showing("a.obj", home), "mtl is no regular file")


def test_materials_of_others_are_not_read_and_missing_ones_do_no_harm(home: Path, secret: Path) -> None:
    """Which a mesh without its .mtl is the usual case of."""
    (home / "a.obj").write_text(f"mtllib ../secret/id_rsa\n{OBJ}")
    refused(showing("a.obj", home), "id_rsa lies outside")
    for libraries in ("", "a.mtl", "nowhere.mtl"):
        (home / "a.obj").write_text(f"mtllib {libraries}\n{OBJ}")
        (home / "a.mtl").write_text("newmtl m\nKd 1 0 0\n")
        assert is_shown(robot_shapes(showing("a.obj", home)))


@pytest.mark.parametrize("number", ["nan", "inf", "-inf", "1e400", "1e30", "2000"])
@pytest.mark.parametrize("kind", ["stl", "obj", "dae"])
def test_corners_that_cannot_be_drawn_leave_the_shape_out(home: Path, kind: str, number: str) -> None:
    """No number, or beyond a kilometre: a box about them would fill the page's camera with nan, and the page would stay empty."""
    text = {"stl": STL.replace("vertex 1 0", f"vertex {number} 0"), "obj": OBJ.replace("v 1 0", f"v {number} 0")}
    (home / f"a.{kind}").write_text(text.get(kind) or collada().replace(">0 0 0 1 0", f">0 0 0 {number} 0"))
    robot = showing(f"a.{kind}", home)
    shapes = robot_shapes(robot)
    assert not is_shown(shapes)
    assert re.search("corners that are no numbers or beyond 1000 m|cannot be read", *shapes.warnings)
    assert b"NaN" not in re.sub(rb"<script>.*?</script>", b"", content_of(robot), flags=re.DOTALL).split(b"urdfcal-scene")[0]


def test_nodes_of_one_name_within_one_another_are_usual(home: Path) -> None:
    """Exporters leave names that are not unique, which only matters where something refers to them."""
    (home / "a.dae").write_text(collada(f'<node name="Node"><node name="Node">{TRIANGLE}</node></node>'))
    assert is_shown(robot_shapes(showing("a.dae", home)))
    with pytest.raises(RobotError, match="within themselves"):
        scan_collada(collada(f'<node id="x" name="a"><node id="a">{TRIANGLE}</node><instance_node url="#a"/></node>').encode())


@pytest.mark.parametrize(
    "content",
    [b"\n" * 2_000_000, b" " * 2_000_000, b"mtllib " + b" " * 1_000_000 + b"x" + b" " * 1_000_000 + b"y", b"mtllib" + b" a b" * 500_000],
    ids=["lines", "spaces", "gap", "names"],
)
def test_looking_through_an_obj_takes_no_longer_than_it_is(home: Path, content: bytes) -> None:
    """Megabytes of nothing are a matter of moments; an expression that starts over at every letter would take hours."""
    (home / "a.obj").write_bytes(content + b"\n" + OBJ.encode())
    start = time.process_time()
    with contextlib.suppress(RobotError):
        mesh_files.MeshFiles(showing("a.obj", home).description).find("a.obj")
    assert time.process_time() - start < 10


@pytest.mark.parametrize(
    ("name", "content"), [("a.obj", "v 0 0 0\nf 1 2 3\n"), ("a.stl", "solid x\nvertex\n"), ("a.dae", collada().replace("<p>", "<p>9 "))]
)
def test_one_mesh_that_cannot_be_read_spoils_no_other(home: Path, name: str, content: str) -> None:
    """Its link is a simple shape and the line names it; the others are shown."""
    (home / name).write_text(content)
    (home / "b.stl").write_text(STL)
    robot = showing(name, home)
    second = '<link name="base"><visual><geometry><mesh filename="b.stl"/></geometry></visual></link>'
    robot = robot_of(robot.description.text.decode().replace('<link name="base"/>', second), str(home / "small.urdf"))
    shapes = robot_shapes(robot)
    assert shapes.simple == ("upper",)
    assert "base_0" in {shape.name for shape in shapes.model.geometryObjects}
    assert re.search(f"1 meshes are drawn as simple shapes, the first because {name} cannot be read: ", *shapes.warnings)


FACET = STL.split("solid s\n")[1].split("endsolid")[0]


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.stl", b"\0" * 80 + struct.pack("<I", 12) + b"\0" * 600),
        ("a.stl", f"solid s\n{12 * FACET}endsolid s\n".encode()),
        ("a.obj", (OBJ + "f 1 2 3\n" * 11).encode()),
        ("a.dae", collada(12 * f"<node>{TRIANGLE}</node>").encode()),
        ("a.dae", collada().replace("0 1 2</p>", "0 1 2 " * 12 + "</p>").encode()),
        ("a.dae", collada('<node id="a">' + 3 * TRIANGLE + "</node>" + 3 * '<node><instance_node url="#a"/></node>').encode()),
    ],
    ids=["binary", "words", "obj", "instances", "indices", "nodes"],
)
def test_triangles_are_counted_before_they_are_built(home: Path, monkeypatch: pytest.MonkeyPatch, name: str, content: bytes) -> None:
    """Twelve triangles are 36 corners, however they are written; a few bytes may stand for very many."""
    (home / name).write_bytes(content)
    for together in (False, True):
        monkeypatch.setattr(mesh_files, "MOST_CORNERS", 36)
        monkeypatch.setattr(mesh_files, "MOST_CORNERS_TOGETHER", 36)
        mesh_files.MeshFiles(showing(name, home).description).find(name)
        monkeypatch.setattr(mesh_files, "MOST_CORNERS_TOGETHER" if together else "MOST_CORNERS", 35)
        with pytest.raises(RobotError, match=r"35 corners|most is 35"):
            mesh_files.MeshFiles(showing(name, home).description).find(name)
