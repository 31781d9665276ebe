"""A unified diff of bytes, as `git apply` and `patch -p1` take it: line ends, byte-order marks and encodings as they are."""

from __future__ import annotations

import difflib
from collections.abc import Iterator, Mapping
from pathlib import Path

from urdfcal.output.sources.layout import Layout, is_installed

_NO_END = "\\ No newline at end of file\n"


def patch_text(before: Mapping[Path, bytes], after: Mapping[Path, bytes], layout: Layout) -> bytes:
    """Changes of files; an installed file becomes a new one.

    Args:
        before: Their bytes, by real path.
        after: Those that changed.
        layout: Tells their ways.
    """
    found = (_diff(b"" if is_installed(file) else before[file], text, layout.way(file), is_installed(file)) for file, text in after.items())
    way = layout.description.resolve().relative_to(layout.root) if layout.description.resolve().is_relative_to(layout.root) else ""
    head = f"Calibrated origins of {layout.description.name}, by urdfcal. Apply it with `git apply` or `patch -p1` where {way} lies.\n\n"
    return b"".join([head.encode("utf-8", "surrogateescape"), *found])


def _diff(old: bytes, new: bytes, way: Path, added: bool) -> bytes:
    name = way.as_posix()
    tab = "\t" if " " in name else ""
    head = [f"diff --git a/{name} b/{name}\n", *(["new file mode 100644\n"] if added else [])]
    its = difflib.unified_diff([*_lines(old)], [*_lines(new)], "/dev/null" if added else f"a/{name}{tab}", f"b/{name}{tab}")
    return "".join([*head, *_ended(its)]).encode("utf-8", "surrogateescape")


def _lines(text: bytes) -> Iterator[str]:
    """Lines by their line feeds alone; a byte that is no UTF-8 comes back as it was."""
    start = 0
    while start < len(text):
        end = text.find(b"\n", start) + 1 or len(text)
        yield text[start:end].decode("utf-8", "surrogateescape")
        start = end


def _ended(lines: Iterator[str]) -> Iterator[str]:
    for line in lines:
        yield line
        if not line.endswith("\n"):
            yield f"\n{_NO_END}"
