"""Which files this process has opened to read, whatever road named them: folders, patterns, includes, files named in files.

Python tells of every file that it opens (PEP 578); a child process keeps its own list, and hands it on.
"""

from __future__ import annotations

import contextlib
import os
import sys
from collections.abc import Iterable, Iterator
from functools import cache

_opened: dict[str, None] = {}
_resting: list[None] = []


def begin() -> None:
    """Forget what was opened so far, and note what will be."""
    _hooked()
    _opened.clear()


def opened() -> tuple[str, ...]:
    """Absolute paths of all that has been opened to read."""
    return tuple(_opened)


def note(paths: Iterable[str | os.PathLike[str]]) -> None:
    """Add files that another process read for us."""
    _opened.update(dict.fromkeys(map(os.path.abspath, paths)))


@contextlib.contextmanager
def unnoted() -> Iterator[None]:
    """Reading in here makes no file an input: it is looked at for what it would lose."""
    _resting.append(None)
    try:
        yield
    finally:
        _resting.pop()


def reads(place: str | os.PathLike[str]) -> bool:
    """Whether a place is one of the files that were opened to read, under this name or another."""
    try:
        its = os.stat(place)
    except OSError:
        return False
    return any(_same(path, its) for path in _opened)


def _same(path: str, its: os.stat_result) -> bool:
    try:
        return os.path.samestat(os.stat(path), its)
    except OSError:
        return False


@cache
def _hooked() -> None:
    sys.addaudithook(_heard)


def _heard(event: str, details: tuple[object, ...]) -> None:
    if event != "open" or _resting:
        return
    path, _, flags = details
    if isinstance(path, str) and isinstance(flags, int) and flags & os.O_ACCMODE == os.O_RDONLY and not path.endswith((".py", ".pyc")):
        _opened[os.path.abspath(path)] = None
