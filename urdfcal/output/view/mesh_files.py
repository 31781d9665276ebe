"""The mesh files and textures that may be shown: the robot's own, no larger than stated, and what they say that they are.

A page is passed on. A description from elsewhere must not put files of its reader into it, nor keep the reader's machine busy: where a
file lies, what it is and how large are looked at before it is read.
"""

from __future__ import annotations

import base64
import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from urdfcal.base.errors import RobotError
from urdfcal.base.native import native_stderr
from urdfcal.output.view.collada import scan_collada
from urdfcal.output.view.stl import HEAD, facets_in_bytes
from urdfcal.robot.description import Description
from urdfcal.robot.packages import is_at_home, package_of, resolve_uri
from urdfcal.vision.picture_header import KINDS, is_too_short, stated_size
from urdfcal.vision.pictures import decoded

MOST_OF_A_MESH = 40_000_000  # bytes of one file
MOST_CORNERS = 1_500_000  # of the triangles of one mesh; a triangle takes 1 kB where it is built
MOST_CORNERS_TOGETHER = 5_000_000  # of all meshes of one robot, one that is shown twice counts twice
MOST_OF_A_TEXTURE = 16_000_000  # bytes
MOST_TOGETHER = 160_000_000  # bytes of all that one robot shows, a file that is shown twice counts twice
MOST_PIXELS = 2**25  # of one texture: 8192 x 4096
MOST_PIXELS_TOGETHER = 2**27  # a browser takes four bytes for each

READABLE = (".dae", ".obj", ".stl")  # what meshcat can show
Textures = Mapping[str, str]  # name in the Collada file: the picture as a data: URI
_LINE_ENDS = bytes.maketrans(b"\r\f\0", b"\n\n\n")  # what else ends a line for Assimp
_FACE = re.compile(rb"^[ \t]*f[ \t](.*)$", re.MULTILINE)
_LIBRARY = re.compile(rb"^[ \t]*mtllib[ \t]+(.+)$", re.MULTILINE)
_MOST_LIBRARIES = 100  # names of .mtl files in an .obj


class MeshFiles:
    """Finds the files of one robot, and keeps account of how much they are.

    Attributes:
        textures: Of every Collada file found so far, by its path; None where it is to be drawn without colours.
        refused_textures: Why textures that are there are not shown.
    """

    def __init__(self, description: Description) -> None:
        self.textures: dict[str, Textures | None] = {}
        self.refused_textures: list[str] = []
        self._description = description
        self._bytes = self._pixels = self._corners = 0
        self._corners_of: dict[str, int] = {}  # by the Collada file's path

    @property
    def triangles(self) -> int:
        """Of all files found so far, one that was found twice counts twice."""
        return self._corners // 3

    def find(self, uri: str) -> Path:
        """The file that a <mesh> names, all links followed.

        Raises:
            RobotError: there is none, it is not the robot's own, too large, or no mesh that can be shown.
        """
        if not uri:
            raise RobotError("a <mesh> has no filename")
        path = Path(resolve_uri(uri, self._description.package_dirs).removeprefix("file://"))
        package, _ = package_of(uri)
        path = self._own_file(uri, path, self._description.path.parent, MOST_OF_A_MESH, package)
        if path.suffix.lower() not in READABLE:
            raise RobotError(f"{uri} is none of {', '.join(READABLE)}")
        self._count(uri, path)
        try:
            self._count_corners({".dae": self._check_collada, ".obj": self._check_obj, ".stl": _check_stl}[path.suffix.lower()](path))
        except RobotError as error:
            raise RobotError(f"{uri} {error}") from None
        except OSError as error:
            raise RobotError(f"{uri} cannot be read: {error.strerror or error}") from None
        return path

    def _own_file(self, name: str, path: Path, beside: Path, most: int, package: str = "") -> Path:
        """A regular file of the robot's own, all links followed, relative names beside a folder."""
        path = path if path.is_absolute() else beside.resolve() / path
        try:
            resolved = path.resolve(strict=True)
            own = is_at_home(path, self._description.path, self._description.package_dirs, package)
            regular, size = resolved.is_file(), resolved.stat().st_size
        except (OSError, RuntimeError, ValueError):  # links that go round; names that can be none
            raise _Missing(f"{name} was not found; name the folder that holds its package with --package-dir") from None
        if not own:
            raise RobotError(
                f"{name} lies outside the folders of the description and of packages; name a folder that holds it with --package-dir"
            )
        if not regular:
            raise RobotError(f"{name} is no regular file")
        if size > most:
            raise RobotError(f"{name} has {size / 1e6:.0f} MB, the most is {most / 1e6:.0f} MB")
        return resolved

    def _count(self, name: str, path: Path) -> None:
        size = path.stat().st_size
        if self._bytes + size > MOST_TOGETHER:
            raise RobotError(f"with {name} the robot's meshes and textures have more than {MOST_TOGETHER / 1e6:.0f} MB")
        self._bytes += size

    def _count_corners(self, corners: int) -> None:
        if corners > MOST_CORNERS:
            raise RobotError(f"has {corners} corners of triangles, the most is {MOST_CORNERS}")
        if self._corners + corners > MOST_CORNERS_TOGETHER:
            raise RobotError(f"is too much: the robot's meshes have more than {MOST_CORNERS_TOGETHER} corners of triangles")
        self._corners += corners

    def _check_collada(self, path: Path) -> int:
        """Its corners; its textures are kept."""
        if str(path) not in self.textures:
            found = scan_collada(_text(path))
            self.textures[str(path)] = self._pictures(found.pictures, path.parent) if found.well_formed else None
            self._corners_of[str(path)] = found.corners
        return self._corners_of[str(path)]

    def _pictures(self, names: list[str], folder: Path) -> Textures | None:
        """The textures of a file; None if one of them is not to be shown."""
        try:
            return {name: self._picture(name, folder) for name in dict.fromkeys(names)}
        except _Missing:
            return None
        except (RobotError, OSError) as error:
            self.refused_textures.append(str(error))
            return None

    def _picture(self, name: str, folder: Path) -> str:
        """A texture as a data: URI; its header is looked at first, since a small file may unfold to a huge picture."""
        path = self._own_file(name, Path(name.removeprefix("file://")), folder, MOST_OF_A_TEXTURE)
        content = path.read_bytes()
        stated = stated_size(content)
        if stated is None:
            raise RobotError(f"{name} is none of the pictures that a browser shows ({', '.join(KINDS)})")
        kind, width, height = stated
        if not 0 < width * height <= MOST_PIXELS:
            raise RobotError(f"{name} has {width} x {height} pixels, the most is {MOST_PIXELS} in all")
        if is_too_short(content):
            raise RobotError(f"{name} has too few bytes for the {width} x {height} pixels that it states")
        if self._pixels + width * height > MOST_PIXELS_TOGETHER:
            raise RobotError(f"with {name} the robot's textures have more than {MOST_PIXELS_TOGETHER} pixels")
        with native_stderr():  # of libraries that read pictures
            if decoded(np.frombuffer(content, np.uint8)) is None:
                raise RobotError(f"{name} is not readable as a picture")
        self._count(name, path)
        self._pixels += width * height
        return f"data:image/{kind.lower()};base64,{base64.b64encode(content).decode()}"

    def _check_obj(self, path: Path) -> int:
        """Its corners; refuse what Assimp would open beside it and is not the robot's own. A library that is missing does no harm."""
        content = re.sub(rb"\\\r?\n", b" ", _text(path)).translate(_LINE_ENDS)
        corners = sum(len(face.split()) for face in _FACE.findall(content))
        if not corners:
            raise RobotError("has no faces")
        lines = [line.decode("utf-8", "replace").strip() for line in _LIBRARY.findall(content)]
        names = list(dict.fromkeys((path.with_suffix(".mtl").name, *lines, *(word for line in lines for word in line.split()))))
        if len(names) > _MOST_LIBRARIES:
            raise RobotError(f"names more than {_MOST_LIBRARIES} material files")
        for name in names:
            for file in (Path(name), path.parent / name.lstrip("/")):
                try:
                    self._own_file(name, file, path.parent, MOST_OF_A_MESH)
                except _Missing:
                    continue
        return corners


class _Missing(RobotError):
    """A file that is not there."""


def _text(path: Path) -> bytes:
    """The bytes of a mesh in words. meshcat hands them to the browser as text, and takes no other encoding."""
    content = path.read_bytes()
    try:
        content.decode()
    except UnicodeDecodeError as error:
        raise RobotError(f"is not UTF-8 text (byte {error.start})") from None
    return content


def _check_stl(path: Path) -> int:
    """Its corners. Its size must be that of the facets that it states, or it must open as one in words does."""
    with path.open("rb") as file:
        head = file.read(HEAD)
        facets = facets_in_bytes(head, path.stat().st_size)
        if facets is not None:
            return 3 * facets
        if head.lstrip().lower().startswith(b"solid"):
            return (head + file.read()).count(b"vertex")
    raise RobotError("is no STL: it neither opens with 'solid' nor has the size of the facets that it states")
