"""Files: written whole or not at all, alone or together; YAML read with the lines that its entries stand on."""

from __future__ import annotations

import contextlib
import os
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from urdfcal.base.errors import InputError, UsageError

_DEEPEST = 30  # levels of nesting; no file of ours has more than six


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
        node: The same as PyYAML's tree of nodes.
    """

    path: Path
    content: Any
    node: Any

    def line(self, steps: Sequence[Any] = ()) -> int | None:
        """The line of an entry such as ("joints", "joint3"), or of the last step that is there."""
        node = self.node
        for step in steps:
            entries = node.value if isinstance(getattr(node, "value", None), list) else []
            if entries and isinstance(entries[0], tuple):
                below = [value for key, value in entries if key.value == str(step)]
            else:
                below = entries[step : step + 1] if isinstance(step, int) else []
            if not below:
                break
            node = below[0]
        return None if node is None else int(node.start_mark.line) + 1


def read_yaml(path: str | Path, error: type[InputError]) -> YamlFile:
    """Read a YAML file, without aliases, repeated entries or endless nesting.

    Args:
        path: The file, UTF-8.
        error: What is raised if it cannot be read.
    """
    import yaml

    path = Path(path)
    try:
        reader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
        text = _text(path, error)
        _check_events(path, yaml.parse(text, Loader=reader), error)
        loader = reader(text)
        try:
            node = loader.get_single_node()
            _check_nodes(path, node, error)
            return YamlFile(path, None if node is None else loader.construct_document(node), node)
        finally:
            loader.dispose()
    except yaml.YAMLError as trouble:
        mark = getattr(trouble, "problem_mark", None)
        raise error(
            f"not readable as YAML: {getattr(trouble, 'problem', None) or trouble}", path, mark.line + 1 if mark else None
        ) from None
    except InputError:
        raise
    except Exception as trouble:  # PyYAML lets a dozen kinds through for odd numbers, dates and tags
        raise error(f"not readable as YAML: {type(trouble).__name__} {trouble}", path) from None


def _text(path: Path, error: type[InputError]) -> str:
    try:
        return path.read_bytes().decode("utf-8-sig")
    except OSError as trouble:
        raise error(f"cannot be read: {trouble.strerror or trouble}", path) from None
    except UnicodeDecodeError as trouble:
        raise error("is not UTF-8 text; save it as UTF-8", path, trouble.object[: trouble.start].count(b"\n") + 1) from None


def _check_events(path: Path, events: Iterable[Any], error: type[InputError]) -> None:
    """Refuse aliases, with which a small file becomes a large one, and nesting at which PyYAML's C code breaks down."""
    from yaml.events import AliasEvent, CollectionEndEvent, CollectionStartEvent

    depth = 0
    for event in events:
        line = event.start_mark.line + 1
        depth += isinstance(event, CollectionStartEvent) - isinstance(event, CollectionEndEvent)
        if isinstance(event, AliasEvent):
            raise error(f"the alias '*{event.anchor}' is refused; write the entry out", path, line)
        if depth > _DEEPEST:
            raise error(f"nested more than {_DEEPEST} levels deep", path, line)


def _check_nodes(path: Path, root: Any, error: type[InputError]) -> None:
    """Refuse an entry that stands twice, and whole numbers too long to be turned into a double or a message."""
    waiting = [] if root is None else [root]
    while waiting:
        node = waiting.pop()
        if node.tag.endswith(":int") and len(node.value) > 100:
            raise error(f"a number of {len(node.value)} digits", path, node.start_mark.line + 1)
        keys: set[Any] = set()
        for below in node.value if isinstance(node.value, list) else []:
            key, value = below if isinstance(below, tuple) else (None, below)
            if key is not None and not isinstance(key.value, list):
                if key.value in keys:
                    raise error(f"the entry '{key.value}' stands twice", path, key.start_mark.line + 1)
                keys.add(key.value)
            waiting.append(value)


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
