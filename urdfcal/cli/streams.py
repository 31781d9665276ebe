"""The three streams of a command: foreign text is shown on them and never steers the terminal, and libraries speak through us."""

from __future__ import annotations

import contextlib
import errno
import io
import os
import sys
import tempfile
import warnings
from collections.abc import Iterator
from typing import Any, TextIO

from urdfcal.base.errors import UsageError
from urdfcal.base.foreign_text import shown
from urdfcal.base.minus import MINUS

_MOST = 5  # lines of libraries that are passed on


class Shown:
    """A stream of text on which control characters are written out, and a minus never becomes the sign of an unknown letter."""

    def __init__(self, stream: TextIO) -> None:
        self.raw, self.minus = stream, MINUS if _has(stream, MINUS) else "-"

    def write(self, text: str) -> int:
        """Write, as it may be shown."""
        self.raw.write(shown(text).replace(MINUS, self.minus))
        return len(text)

    def __getattr__(self, name: str) -> Any:
        return getattr(self.raw, name)


def _has(stream: Any, letter: str) -> bool:
    """Whether a stream's encoding has this letter."""
    try:
        letter.encode(getattr(stream, "encoding", None) or "utf-8")
    except UnicodeEncodeError:
        return False
    return True


def raw(stream: Any) -> Any:
    """The stream itself, for what draws on the terminal by control characters of ours."""
    return getattr(stream, "raw", stream) if isinstance(stream, Shown) else stream


@contextlib.contextmanager
def our_streams() -> Iterator[list[str]]:
    """Streams for the time of one command.

    Yields:
        Filled at its end: each line that a library wrote to stderr, or warned of through Python.

    Raises:
        UsageError: there is no standard output.
    """
    _fill_gaps()
    before = sys.stdout, sys.stderr
    heard: list[str] = []
    try:
        sys.stderr = _safe(sys.stderr)
        if sys.stdout is None:
            raise UsageError("standard output is closed; send it to a file, or to /dev/null")
        sys.stdout = _safe(sys.stdout)
        with warnings.catch_warnings(), _native(heard):
            warnings.showwarning = lambda message, category, *_, **__: heard.extend(_for_users(message, category))
            yield heard
    finally:
        heard[:] = list(dict.fromkeys(heard))[:_MOST]
        sys.stdout, sys.stderr = before


def _for_users(message: Warning | str, category: type[Warning]) -> list[str]:
    """A library's warning, unless it is for whoever maintains what calls the library."""
    return [] if issubclass(category, DeprecationWarning | FutureWarning) else [f"{category.__name__}: {message}"]


def require_written() -> None:
    """Bring out what was printed.

    Raises:
        BrokenPipeError: nobody reads it any more.
        UsageError: there is no room for it.
    """
    try:
        sys.stdout.flush()
    except BrokenPipeError:
        raise
    except OSError as error:
        raise unprinted(error) from None


def unprinted(error: OSError) -> UsageError:
    """What to say of a stream that takes nothing more."""
    return UsageError(f"standard output cannot be written to: {error.strerror or error}; what stands in files is whole")


def about_stdout(error: OSError) -> bool:
    """Whether an error came from printing: our files have names in their errors, and errors of their own."""
    return error.filename is None and error.errno in (errno.ENOSPC, errno.EBADF, errno.EIO, errno.EFBIG, errno.EDQUOT)


def settle() -> None:
    """Bring out what was printed, or drop it where it has no place, so that it fails no second time when Python ends."""
    try:
        sys.stdout.flush()
    except OSError:
        drop_stdout()


def drop_stdout() -> None:
    """Let what is still to be printed go nowhere."""
    with contextlib.suppress(OSError, ValueError):
        sink = os.open(os.devnull, os.O_WRONLY)
        os.dup2(sink, 1)
        os.close(sink)
        sys.stdout.flush()


def _safe(stream: TextIO) -> Any:
    if isinstance(stream, io.TextIOWrapper):
        stream.reconfigure(errors="replace")  # a terminal that lacks a letter is no reason to fail
    return Shown(stream)


def _fill_gaps() -> None:
    """Stand-ins for streams that the caller closed: no file of ours may get their numbers, and with them what is printed."""
    for number in (0, 1, 2):
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)
    if sys.stderr is None:
        sys.stderr = open(os.devnull, "w")


@contextlib.contextmanager
def _native(heard: list[str]) -> Iterator[None]:
    """What libraries write to the stream behind our back is kept; ours goes where it went."""
    with tempfile.TemporaryFile() as sink:
        ours = os.dup(2)
        safe, sys.stderr = sys.stderr, _beside(sys.stderr, ours)
        os.dup2(sink.fileno(), 2)
        try:
            yield
        finally:
            os.dup2(ours, 2)
            sys.stderr = safe
            os.close(ours)
            sink.seek(0)
            heard += [line.strip() for line in sink.read().decode(errors="backslashreplace").splitlines() if line.strip()]


def _beside(stream: Any, descriptor: int) -> Any:
    """The same stream by another number, where it goes to stderr's own."""
    try:
        own = stream.fileno() == 2
    except (OSError, ValueError, AttributeError):
        return stream
    if not own:
        return stream
    return Shown(open(descriptor, "w", buffering=1, encoding=stream.encoding, errors="replace", closefd=False))
