"""How far a long computation has come, told to whoever listens: nobody by default, and nothing here prints.

with counted("sweep", 5000) as advance:
for ...:
advance()
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from typing import Protocol, TypeVar

Item = TypeVar("Item")


class Listener(Protocol):
    """Who wants to know."""

    def begin(self, what: str, total: int | None) -> Callable[[], None]:
        """Hear that something is done so many times, or nobody knows how often; what is given back is called after each."""

    def end(self, advance: Callable[[], None]) -> None:
        """Hear that it is done, or given up."""


_listener: ContextVar[Listener | None] = ContextVar("listener", default=None)


@contextmanager
def listening(listener: Listener) -> Iterator[None]:
    """Tell a listener of everything that is counted inside."""
    token = _listener.set(listener)
    try:
        yield
    finally:
        _listener.reset(token)


@contextmanager
def counted(what: str, total: int | None = None) -> Iterator[Callable[[], None]]:
    """Count something.

    Args:
        what: What one of it is, in a word or two.
        total: How many there will be at most; None where nobody knows.

    Yields:
        To be called after each.
    """
    listener = _listener.get()
    if listener is None:
        yield lambda: None
        return
    advance = listener.begin(what, total)
    try:
        yield advance
    finally:
        listener.end(advance)


def each(items: Iterable[Item], what: str, total: int | None = None) -> Iterator[Item]:
    """Items, counted while they are gone through."""
    with counted(what, total) as advance:
        for item in items:
            yield item
            advance()
