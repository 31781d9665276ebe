"""Ctrl-C that asks a long search for the best that it has found so far, in place of ending it.

    with until_interrupted() as asked:
        ...                # loops of the search look at enough() and stop where it says so
    if asked():
        ...                # what was found is the best so far

A second Ctrl-C ends it as ever. Nothing asks for anything outside such a block.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar

_asked: ContextVar[threading.Event | None] = ContextVar("asked", default=None)


def enough() -> bool:
    """Whether somebody wants what there is, and no better."""
    asked = _asked.get()
    return asked is not None and asked.is_set()


@contextmanager
def until_interrupted() -> Iterator[Callable[[], bool]]:
    """Hear the first Ctrl-C inside as a wish for what there is; only in the main thread, which alone hears of it, and where it is heeded.

    Yields:
        Tells whether it came.
    """
    asked = threading.Event()
    token = _asked.set(asked)
    heeded = threading.current_thread() is threading.main_thread() and signal.getsignal(signal.SIGINT) is signal.default_int_handler
    if not heeded:
        try:
            yield asked.is_set
        finally:
            _asked.reset(token)
        return
    before = signal.getsignal(signal.SIGINT)

    def heard(number: int, frame: object) -> None:
        if asked.is_set():
            raise KeyboardInterrupt
        asked.set()

    signal.signal(signal.SIGINT, heard)
    try:
        yield asked.is_set
    finally:
        signal.signal(signal.SIGINT, before)
        _asked.reset(token)
