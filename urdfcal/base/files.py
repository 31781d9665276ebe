"""Files: written whole or not at all, alone or together (`whole_files`); YAML read with the lines that its entries stand on."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from urdfcal.base.errors import InputError
from urdfcal.base.reading import YAML, content_of
from urdfcal.base.whole_files import require_writable, write_together, write_whole

__all__ = ["YamlFile", "read_yaml", "require_writable", "sha256", "write_together", "write_whole"]

YAML_ENDINGS = (".yaml", ".yml")


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


def is_yaml(path: Path) -> bool:
    """Whether a file is called YAML, as calibrations are and descriptions are not."""
    return path.suffix.lower() in YAML_ENDINGS


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


def sha256(content: bytes) -> str:
    """Hash of some bytes, in hexadecimal."""
    return hashlib.sha256(content).hexdigest()


def _text(path: Path, error: type[InputError]) -> str:
    try:
        return content_of(path, YAML, error).decode("utf-8-sig")
    except UnicodeDecodeError as trouble:
        raise error("is not UTF-8 text; save it as UTF-8", path, trouble.object[: trouble.start].count(b"\n") + 1) from None
