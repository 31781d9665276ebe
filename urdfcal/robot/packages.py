"""Where a ROS package lies, without ROS: `$(find pkg)` and `package://pkg/...`."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from importlib.util import find_spec
from pathlib import Path
from xml.etree import ElementTree

from urdfcal.base.errors import RobotError

_DEPTH = 3  # how far below an entry of ROS_PACKAGE_PATH a package.xml is looked for


def find_package(name: str, package_dirs: Sequence[str | Path] = ()) -> Path:
    """Find the folder of a package.

    Looked for, in this order: `package_dirs` (the package itself or a folder that holds it), ROS_PACKAGE_PATH,
    AMENT_PREFIX_PATH, and the prefix into which pip puts example-robot-data.

    Raises:
        RobotError: there is no such package; says where it was looked for.
    """
    if not name or name in (".", "..") or set("/\\") & set(name):
        raise RobotError(f"'{name}' is no name of a package; expected one such as tiago_description")
    for candidate in _candidates(name, package_dirs):
        if candidate.is_dir():
            return candidate.resolve()
    raise RobotError(f"package '{name}' was not found; name the folder that holds it with --package-dir, or set ROS_PACKAGE_PATH")


def resolve_uri(uri: str, package_dirs: Sequence[str | Path] = ()) -> str:
    """A `package://pkg/path` as a path of this machine; anything else is given back as it is."""
    if not uri.startswith("package://"):
        return uri
    package, _, rest = uri.removeprefix("package://").partition("/")
    return str(find_package(package, package_dirs) / rest)


def _candidates(name: str, package_dirs: Sequence[str | Path]) -> Iterator[Path]:
    ros_paths = [entry for entry in os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep) if entry]
    for folder in (Path(entry) for entry in (*package_dirs, *ros_paths)):
        yield folder / name
        if folder.name == name or _declared_name(folder) == name:
            yield folder
        yield from _declared_below(folder, name, _DEPTH)
    for prefix in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep):
        if prefix:
            yield Path(prefix) / "share" / name
    share = _pip_prefix() / "share"
    yield share / name
    yield share / "example-robot-data" / "robots" / name


def _declared_below(folder: Path, name: str, depth: int) -> Iterator[Path]:
    try:
        entries = sorted(entry for entry in folder.iterdir() if entry.is_dir() and not entry.name.startswith(".")) if depth else []
    except OSError:  # not there, or not ours to read
        return
    for below in entries:
        if _declared_name(below) == name:
            yield below
        else:
            yield from _declared_below(below, name, depth - 1)


def _declared_name(folder: Path) -> str | None:
    """The name in a folder's package.xml; None where there is none that can be read."""
    try:
        text = ElementTree.parse(folder / "package.xml").findtext("name")
    except (OSError, ElementTree.ParseError, ValueError, LookupError):
        return None
    return text.strip() if text else None


def _pip_prefix() -> Path:
    """The prefix that the `pin` and `example-robot-data` wheels share."""
    found = find_spec("pinocchio")  # not imported, which takes half a second
    assert found is not None
    assert found.origin is not None
    return Path(found.origin).resolve().parents[4]
