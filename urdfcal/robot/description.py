"""The text of a robot: a URDF's own bytes, or what xacro makes of a xacro file."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from urdfcal.base.errors import RobotError
from urdfcal.base.files import is_yaml
from urdfcal.base.reading import DESCRIPTION, content_of
from urdfcal.robot.entities import refuse_entities
from urdfcal.robot.xacro_child import USUAL_LIMIT, XacroLimit, expanded

_TABLES = (".csv", ".tsv", ".txt", ".xlsx", ".xls")
_ENDINGS = re.compile(r"(\.(xacro|urdf|xml))+$", re.IGNORECASE)


@dataclass(frozen=True)
class Description:
    """A robot description as text.

    Attributes:
        path: The file that was named by the user.
        text: URDF document, byte for byte; for xacro the expanded document.
        expanded: Whether the text is xacro's work and not the file's own bytes.
        package_dirs: Folders given by the user in which packages are looked for.
        included: Files beside it that xacro read.
        xacro_args: Values that were given to its xacro arguments.
        xacro_limit: Time and memory that its expansion may take.
    """

    path: Path
    text: bytes
    expanded: bool
    package_dirs: tuple[Path, ...] = ()
    included: tuple[Path, ...] = ()
    xacro_args: Mapping[str, str] = field(default_factory=dict)
    xacro_limit: XacroLimit = USUAL_LIMIT

    @property
    def stem(self) -> str:
        """File name without .xacro, .urdf and .xml at its end: `arm7` for `arm7.urdf.xacro`, `cell.left` for `cell.left.urdf`."""
        return _ENDINGS.sub("", self.path.name) or self.path.name

    @property
    def label(self) -> str:
        """How messages name the text; line numbers of an expanded document are its own."""
        return f"{self.path} (expanded)" if self.expanded else str(self.path)


def read_description(
    path: str | Path,
    xacro_args: Mapping[str, str] | None = None,
    package_dirs: Sequence[str | Path] = (),
    xacro_limit: XacroLimit = USUAL_LIMIT,
) -> Description:
    """Read a URDF or xacro file.

    A xacro file is code: its `${...}` and `$(eval ...)` run Python, in a process of its own.

    Args:
        path: URDF or xacro; taken as xacro by its name (`.xacro`) or by a `<xacro:...>` tag in it.
        xacro_args: Values of `<xacro:arg>`.
        package_dirs: Folders in which `$(find pkg)` looks first.
        xacro_limit: Time and memory that its expansion may take.

    Raises:
        RobotError: the file cannot be read or expanded, is a table or YAML, declares entities, or knows nothing of a xacro argument.
    """
    path = Path(path)
    folders = tuple(Path(folder) for folder in package_dirs)
    for folder in folders:
        if not folder.is_dir():
            raise RobotError(f"--package-dir {folder}: no such folder")
    text = _read_bytes(path)
    _refuse_others(path, text)
    tags = refuse_entities(text, path)
    if path.suffix.lower() != ".xacro" and not any(tag.startswith("xacro:") for tag in tags):
        if xacro_args:
            raise RobotError(f"is a plain URDF and takes no xacro argument ({', '.join(xacro_args)})", path)
        if text[:2] in (b"\xff\xfe", b"\xfe\xff") or b"\x00" in text[:64]:
            raise RobotError("is in UTF-16 or UTF-32, whose bytes cannot be kept; save it as UTF-8", path)
        return Description(path, text, expanded=False, package_dirs=folders)
    found = expanded(path, xacro_args or {}, folders, xacro_limit)
    included = tuple(file for file in dict.fromkeys(found.files) if file != path)
    return Description(
        path,
        found.text,
        expanded=True,
        package_dirs=folders,
        included=included,
        xacro_args=dict(xacro_args or {}),
        xacro_limit=xacro_limit,
    )


def _refuse_others(path: Path, text: bytes) -> None:
    """Refuse measurements, or a calibration, in the robot's place.

    Raises:
        RobotError: the file is called a table, or YAML, and is no XML.
    """
    what = "a table" if path.suffix.lower() in _TABLES else "YAML" if is_yaml(path) else ""
    if what and not text.lstrip(b"\xef\xbb\xbf \t\r\n").startswith(b"<"):
        behind = "the measurements" if what == "a table" else "other files"
        raise RobotError(f"is {what} where the robot is expected; the robot's URDF or xacro comes first, then {behind}", path)


def _read_bytes(path: str | Path) -> bytes:
    return content_of(path, DESCRIPTION, RobotError)
