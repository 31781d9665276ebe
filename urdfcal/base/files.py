"""Files: written whole or not at all, alone or together; YAML read with the lines that its entries stand on."""

from __future__ import annotations

import contextlib
import os
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from urdfcal.base.errors import InputError, UsageError
from urdfcal.base.reading import YAML, content_of


def write_whole(path: str | Path, content: bytes) -> None:
    """Write a file next to its place and move it there.

    Raises:
        UsageError: the place cannot be written to.
    """
    write_together({path: content})


def write_together(contents: Mapping[str | Path, bytes]) -> None:
    """Write several files next to their places and, once all are written, move them there.

    Raises:
        UsageError: a place cannot be written to; no file has been touched then.
    """
    waiting: dict[Path, str] = {}
    try:
        for path, content in contents.items():
            _write_beside(Path(path), content, waiting)
        while waiting:
            path = next(iter(waiting))
            os.replace(waiting[path], path)
            del waiting[path]
    except OSError as error:
        raise UsageError(f"{next(iter(waiting), path)}: cannot be written: {error.strerror or error}") from None
    finally:
        for temporary in waiting.values():
            with contextlib.suppress(OSError):
                os.unlink(temporary)


def _write_beside(path: Path, content: bytes, waiting: dict[Path, str]) -> None:
    try:
        handle, waiting[path] = tempfile.mkstemp(prefix=f".{path.name}.", dir=path.parent)
        with os.fdopen(handle, "wb") as stream:
            stream.write(content)
        os.chmod(waiting[path], 0o666 & ~_umask())
        if path.is_dir():
            raise IsADirectoryError(f"{path} is a folder")
    except OSError as error:
        raise UsageError(f"{path}: cannot be written: {error.strerror or error}") from None


def require_writable(path: str | Path) -> None:
    """Refuse a place that cannot be written to, before any work is done for it.

    Raises:
        UsageError: the folder is missing or closed to us, or the path is a folder.
    """
    path = Path(path)
    if path.is_dir():
        raise UsageError(f"{path}: is a folder, expected a file name")
    if not path.parent.is_dir():
        raise UsageError(f"{path}: the folder {path.parent} does not exist")
    if not os.access(path.parent, os.W_OK | os.X_OK):
        raise UsageError(f"{path}: the folder {path.parent} cannot be written to")


@dataclass(frozen=True)
class YamlFile:
    """A YAML document and where its entries stand.

    Attributes:
        path: The file.
        content: The document as Python objects; None where it is empty.
        tree: The same as ruamel.yaml keeps it, with lines.
        start: The line that it begins on; None where it is empty.
    """

    path: Path
    content: Any
    tree: Any
    start: int | None

    def line(self, steps: Sequence[Any] = ()) -> int | None:
        """The line of an entry such as ("joints", "joint3"), or of the last step that is there."""
        from urdfcal.base.yaml_tree import line_of

        return line_of(self.tree, steps) or self.start


def read_yaml(path: str | Path, error: type[InputError]) -> YamlFile:
    """Read a YAML file, without aliases, tags, repeated entries or endless nesting; names of entries are text.

    Args:
        path: The file, UTF-8.
        error: What is raised if it cannot be read.
    """
    from urdfcal.base.yaml_tree import NotPlain, plain, read_tree

    path = Path(path)
    try:
        tree, start = read_tree(_text(path, error))
    except NotPlain as trouble:
        raise error(str(trouble), path, trouble.line) from None
    return YamlFile(path, plain(tree), tree, start)


def _text(path: Path, error: type[InputError]) -> str:
    try:
        return content_of(path, YAML, error).decode("utf-8-sig")
    except UnicodeDecodeError as trouble:
        raise error("is not UTF-8 text; save it as UTF-8", path, trouble.object[: trouble.start].count(b"\n") + 1) from None


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
