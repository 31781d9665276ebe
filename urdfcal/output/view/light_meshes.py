"""The meshes of one robot, made lighter together where they are too many triangles for a page that is to be passed on."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory

from lxml import etree

from urdfcal.output.view.light_file import MeshFile
from urdfcal.output.view.lighter import mesh_file
from urdfcal.output.view.thinning import cells_for

MOST_TRIANGLES = 80_000  # of all shapes of a robot; a page has some 25 bytes for each


@contextmanager
def light_meshes(root: etree._Element, triangles: int) -> Iterator[Mapping[str, bytes]]:
    """Name lighter files in a description's meshes, where the robot has too many triangles.

    The files are there as long as the context is.

    Args:
        root: The description; its meshes name files that were looked at.
        triangles: How many they have together, a file that is shown twice counted twice.

    Yields:
        The content of each lighter file, by its path.
    """
    if triangles <= MOST_TRIANGLES:
        yield {}
        return
    shown = [mesh for mesh in root.iterfind("link/visual/geometry/mesh") if mesh.get("filename")]
    times = Counter(mesh.get("filename", "") for mesh in shown)
    files = {name: file for name in times if (file := mesh_file(Path(name))) is not None}
    with TemporaryDirectory(prefix="urdfcal-meshes-") as folder:
        written = _written(files, times, triangles, Path(folder))
        for mesh in shown:
            mesh.set("filename", str(written.get(mesh.get("filename", ""), mesh.get("filename"))))
        yield {str(path): path.read_bytes() for path in written.values()}


def _written(files: Mapping[str, MeshFile], times: Mapping[str, int], triangles: int, folder: Path) -> dict[str, Path]:
    """The lighter files, by what they stand for; those of other forms have their share of the triangles, too."""
    own = sum(times[name] * len(part.faces) for name, file in files.items() for part in file.parts)
    most = max(MOST_TRIANGLES - (triangles - own), MOST_TRIANGLES // 2)
    cells = cells_for([(file.parts, times[name]) for name, file in files.items()], most)
    written = {name: folder / str(number) / Path(name).name for number, name in enumerate(files)}
    for name, path in written.items():
        path.parent.mkdir()
        path.write_bytes(files[name].lighter(cells))
    return written
