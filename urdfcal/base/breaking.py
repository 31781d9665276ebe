"""Where lines are broken: between words, and in tables a name that is too long behind a dot, an underscore or the like."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rich.console import Console, ConsoleOptions, RenderResult
    from rich.measure import Measurement

_PIECE = re.compile(r"[^._/:@-]*[._/:@-]+|[^._/:@-]+")


class BreakingText:
    """A cell that is broken where people would break it."""

    def __init__(self, text: str) -> None:
        self.text = text

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        from rich.text import Text

        yield Text("\n".join(broken(self.text, options.max_width)), overflow="fold")

    def __rich_measure__(self, console: Console, options: ConsoleOptions) -> Measurement:
        from rich.cells import cell_len
        from rich.measure import Measurement

        whole, least = (max(map(cell_len, parts), default=0) for parts in (self.text.splitlines(), self.text.split()))
        return Measurement(least, whole)


def between_words(text: str, columns: int) -> Iterator[str]:
    """The lines of a text with none longer than so many columns, further ones indented as the first."""
    for line in text.splitlines():
        indent = " " * (len(line) - len(line.lstrip()))
        yield from textwrap.wrap(line, columns, subsequent_indent=f"{indent}  ", break_long_words=False, break_on_hyphens=False) or [""]


def broken(text: str, width: int) -> list[str]:
    """A text as lines of at most so many columns; what has no place to break is longer."""
    return [line for given in text.splitlines() for line in _filled(given.split(" "), width)]


def _filled(words: Iterable[str], width: int) -> Iterator[str]:
    """Lines of words, each as full as it can be."""
    from rich.cells import cell_len

    line = ""
    for word in words:
        if line and cell_len(f"{line} {word}") > width:
            yield line
            line = word
        else:
            line = f"{line} {word}" if line else word
        if cell_len(line) > width:
            *full, line = _split_name(line, width)
            yield from full
    yield line


def _split_name(name: str, width: int) -> Iterator[str]:
    """A name in lines, each ending where a part of it ends."""
    line = ""
    for piece in _PIECE.findall(name):
        if line and len(line) + len(piece) > width:
            yield line
            line = piece
        else:
            line += piece
    yield line
