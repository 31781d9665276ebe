"""What tells, while xacro is at work, where its results come from: other content of files, numbers moved a little, marks and calls.

Everything here runs in the child process.
"""

from __future__ import annotations

import contextlib
import io
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

MOVED, MOVED_TEXT = "urdfcal_moved", "urdfcal_moved_text"  # functions that a traced file calls
MARK = "urdfcal_at"  # attribute of an element: where it stands in the sources
CALLS, TO = "urdfcal_calls", ">"  # attribute of a joint or an origin: the calls that it comes out of, each as call>macro


def content_over(overlay: Mapping[str, bytes], filename: str | Path) -> bytes | None:
    """What is read in place of a file; None where it is the file itself."""
    return overlay.get(os.path.realpath(filename))


@contextlib.contextmanager
def probing(overlay: Mapping[str, bytes], loaded: dict[Path, None]) -> Iterator[None]:
    """Let xacro load YAML from the overlay, know our functions, and note on joints and origins the calls that they come out of.

    Args:
        overlay: Content by a file's real path.
        loaded: Is given the YAML files that are loaded.
    """
    import xacro

    def opening(filename: str, *_: object) -> Any:
        loaded[Path(filename)] = None
        content = content_over(overlay, filename)
        return open(filename) if content is None else io.TextIOWrapper(io.BytesIO(content))

    its = {name: getattr(xacro, name) for name in ("eval_all", "handle_macro_call", "resolve_macro")}
    xacro._global_symbols.update({MOVED: moved, MOVED_TEXT: moved_text})
    xacro.open = opening
    for name, function in _noting(its).items():
        setattr(xacro, name, function)
    try:
        yield
    finally:
        del xacro.open
        for name in (MOVED, MOVED_TEXT):
            del xacro._global_symbols[name]
        for name, function in its.items():
            setattr(xacro, name, function)


def moved(value: Any, by: float) -> Any:
    """A number a little further on; anything else as it is."""
    return value + by if isinstance(value, int | float) and not isinstance(value, bool) else value


def moved_text(text: str, by: float) -> Any:
    """The same of text that may be a number."""
    try:
        return float(text) + by
    except ValueError:
        return text


def _noting(its: Mapping[str, Any]) -> dict[str, Any]:
    """Functions of xacro, which also note the calls; marks are taken off before xacro sees them as parameters."""
    calls: list[str] = []
    waiting: list[str] = []

    def eval_all(node: Any, *rest: Any) -> Any:
        if node.tagName in ("joint", "origin") and node.getAttribute(MARK):
            node.setAttribute(CALLS, " ".join(calls))
        return its["eval_all"](node, *rest)

    def resolve_macro(*arguments: Any) -> Any:
        found = its["resolve_macro"](*arguments)
        if waiting:
            calls.append(f"{waiting.pop()}{TO}{found[2].body.getAttribute(MARK)}")
        return found

    def handle_macro_call(node: Any, *rest: Any) -> Any:
        mark = node.getAttribute(MARK) if node.tagName.startswith("xacro:") else ""  # xacro asks of every element
        if not mark:
            return its["handle_macro_call"](node, *rest)
        node.removeAttribute(MARK)
        depth = len(calls)
        waiting.append(mark)
        try:
            return its["handle_macro_call"](node, *rest)
        finally:
            del calls[depth:]
            waiting.clear()

    return {"eval_all": eval_all, "handle_macro_call": handle_macro_call, "resolve_macro": resolve_macro}
