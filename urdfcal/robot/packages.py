"""Where a ROS package lies, without ROS: `$(find pkg)` and `package://pkg/...`."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from importlib.util import find_spec
from pathlib import Path
from xml.etree import ElementTree

import urdfcal
from urdfcal.base.errors import RobotError

OWN = "urdfcal"  # whose robots/ holds the macros of the rig and the robots that come along
_DEPTH = 3  # how far below an entry of ROS_PACKAGE_PATH a package.xml is looked for, and above a description its own

_LARGEST_MANIFEST = 1_000_000  # bytes of a package.xml


def find_package(name: str, package_dirs: Sequence[str | Path] = ()) -> Path:
    """Find the folder of a package.

    `urdfcal` is the one that runs, so that `$(find urdfcal)/robots/slm.urdf.xacro` has its macros however it was installed. Others are
    looked for, in this order: `package_dirs` (the package itself or a folder that holds it), ROS_PACKAGE_PATH,
    AMENT_PREFIX_PATH, and the prefix into which pip puts example-robot-data.

    Raises:
        RobotError: there is no such package; says where it was looked for.
    """
    if not name or name in (".", "..") or set("/\\") & set(name):
        raise RobotError(f"'{name}' is no name of a package; expected one such as tiago_description")
    if name == OWN:
        return own_package()
    for candidate in _candidates(name, package_dirs):
        if candidate.is_dir():
            return candidate.resolve()
    raise RobotError(f"package '{name}' was not found; name the folder that holds it with --package-dir, or set ROS_PACKAGE_PATH")


def own_package() -> Path:
    """The folder that holds our robots/: the package where it was installed, and the checkout's in a checkout.

    Raises:
        RobotError: it is in neither.
    """
    package = Path(urdfcal.__file__).parent
    for folder in (package, package.parent):
        if (folder / "robots" / "slm.urdf.xacro").is_file():
            return folder
    raise RobotError(f"robots/slm.urdf.xacro, which comes with {OWN}, is neither in {package} nor beside it; install {OWN} again")


def resolve_uri(uri: str, package_dirs: Sequence[str | Path] = ()) -> str:
    """A `package://pkg/path` as a path of this machine; anything else is given back as it is."""
    package, rest = package_of(uri)
    return str(find_package(package, package_dirs) / rest) if uri.startswith("package://") else uri


def package_of(uri: str) -> tuple[str, str]:
    """The package of a `package://pkg/path`, which some write with a slash more, and the path in it; nothing where there is none."""
    if not uri.startswith("package://"):
        return "", ""
    package, _, rest = uri.removeprefix("package://").lstrip("/").partition("/")
    return package, rest


def is_at_home(path: Path, description: Path, package_dirs: Sequence[str | Path] = (), package: str = "") -> bool:
    """Whether a file belongs to a robot or to a package, so that its content may be shown to whom the robot is shown.

    At home is what lies, after all links are followed, below the description's folder or that of its own package, below
    `package_dirs`, or in a folder where packages are looked for. A workspace may link packages, and installed files to their sources:
    from there a link may lead to any place of the same package, told by its package.xml.

    Args:
        path: An absolute path, as it was named; `..` in it is not followed before links are.
        description: The file that names it.
        package_dirs: As for `find_package`.
        package: In which it was found.

    Raises:
        OSError: the file is not there, or its links go round.
    """
    resolved, named = path.resolve(strict=True), Path(os.path.normpath(path))
    own = (description.resolve().parent, *_own_package(description.resolve().parent))
    if any(resolved.is_relative_to(folder) for folder in (*own, *_searched(package_dirs))):
        return True
    below = [named.relative_to(folder).parts for folder in _installed() if named.is_relative_to(folder)]
    names = {package, *(parts[0] for parts in below if parts)} - {""}
    return bool(names) and any(_declared_name(folder) in names for folder in resolved.parents)


def _own_package(folder: Path) -> list[Path]:
    """The package that a folder is, or is in."""
    above = [folder, *folder.parents][: _DEPTH + 1]
    return [each for each in above if _declared_name(each) is not None][:1]


def _searched(package_dirs: Sequence[str | Path]) -> list[Path]:
    """All folders in which packages are looked for."""
    return [folder.resolve() for folder in (*map(Path, package_dirs), *_ros_paths(), *_installed(), _pip_prefix() / "share")]


def _ros_paths() -> list[Path]:
    return [Path(entry) for entry in os.environ.get("ROS_PACKAGE_PATH", "").split(os.pathsep) if entry]


def _installed() -> list[Path]:
    return [Path(prefix) / "share" for prefix in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if prefix]


def _candidates(name: str, package_dirs: Sequence[str | Path]) -> Iterator[Path]:
    for folder in (*map(Path, package_dirs), *_ros_paths()):
        yield folder / name
        if folder.name == name or _declared_name(folder) == name:
            yield folder
        yield from _declared_below(folder, name, _DEPTH)
    for folder in _installed():
        yield folder / name
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
    manifest = folder / "package.xml"
    try:
        if not manifest.is_file() or manifest.stat().st_size > _LARGEST_MANIFEST:  # a pipe would be waited for
            return None
        text = ElementTree.parse(manifest).findtext("name")
    except (OSError, ElementTree.ParseError, ValueError, LookupError):
        return None
    return text.strip() if text else None


def _pip_prefix() -> Path:
    """The prefix that the `pin` and `example-robot-data` wheels share."""
    found = find_spec("pinocchio")  # not imported, which takes half a second
    assert found is not None
    assert found.origin is not None
    return Path(found.origin).resolve().parents[4]
