"""Text as the terminal shows it: tables, titles, values with their sigmas."""

from __future__ import annotations

import io
import math
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

from urdfcal.base.breaking import BreakingText, between_words
from urdfcal.base.foreign_text import shown
from urdfcal.base.geometry import DEG, MM
from urdfcal.base.minus import with_minus

if TYPE_CHECKING:
    from rich.console import Console, ConsoleOptions, RenderableType, RenderResult
    from rich.table import Table


WIDTH = 80
_GAPS = ((0, 1), (0, 1, 0, 0), (0, 0))  # between the columns of a table: three blanks; where it is too wide two, or one
_MOST = 10_000  # columns that any table could want
_SMALL = 1e-7  # and below this
_FINE, _COARSE = 1e-2, 100.0  # distances below and above are told more finely, and more coarsely
_LARGE = 1e9  # numbers from here on have an exponent


def as_text(blocks: Iterable[RenderableType], columns: int = 0) -> str:
    """Rich blocks as plain text, tables in 80 columns; where a terminal is named by its columns, sentences are broken between words there.

    Tables take more only if the terminal has more.
    """
    from rich.console import Console

    stream = io.StringIO()
    console = Console(file=stream, width=max(columns, WIDTH), color_system=None, highlight=False, markup=False, emoji=False)
    for block in blocks:
        text = "\n".join(between_words(block, columns)) if isinstance(block, str) and columns else block
        console.print(shown(text) if isinstance(text, str) else text, soft_wrap=isinstance(text, str))
    return "\n".join(line.rstrip() for line in stream.getvalue().splitlines()) + "\n"


def rounded(value: float, digits: int) -> str:
    """A number to so many digits that count, as people write it: 160, and not 1.6e+02; 0.00001, and not 1e-05."""
    text = f"{value:.{digits}g}"
    if "e-" in text and abs(value) > _SMALL:
        text = f"{value:.{digits - 1 - math.floor(math.log10(abs(value)))}f}".rstrip("0")
    return with_minus(f"{float(text):.0f}" if "e+" in text and abs(value) < _LARGE else text)


def distance(value: float) -> str:
    """A distance in mm, or in what it was read in: to a thousandth, and where that were nothing to two digits that count."""
    if 0 < value < _FINE:
        return rounded(value, 2)
    return f"{value:.3f}" if value < _COARSE else f"{value:.1f}"


def decimals(value: float, digits: int) -> str:
    """A number with so many decimals; never a zero below zero."""
    text = f"{value:.{digits}f}"
    return text if float(text) else text.removeprefix("-")


def many(count: int, what: str) -> str:
    """`1 pose`, `2 poses`."""
    return f"{count} {what}{'' if count == 1 else 's'}"


def value_and_sigma(value: float, sigma: float) -> str:
    """`+0.9987 ± 0.0210`: the sigma with three digits that count, the value as far."""
    if not (math.isfinite(sigma) and sigma > 0):
        return with_minus(f"{value:+.6g}")
    digits = min(max(2 - math.floor(math.log10(sigma)), 0), 9)
    return with_minus(f"{value:+.{digits}f} ± {sigma:.{digits}f}")


def displayed(unit: str) -> tuple[str, float]:
    """Unit that people read, and its size in SI: mm for m, deg for rad, % for a share; others stay."""
    return {"m": ("mm", MM), "rad": ("deg", DEG), "": ("%", 1e-2)}.get(unit, (unit, 1.0))


def figures_table(*labels: str) -> Table:
    """An empty table of ours with its first, left-aligned columns."""
    from rich import box
    from rich.table import Table
    from rich.text import Text

    class ShownTable(Table):
        """A table whose cells are text and nothing else: no marks of rich, and nothing that steers a terminal."""

        def add_row(self, *cells: RenderableType | None, **how: Any) -> None:
            figures = [column.justify == "right" for column in self.columns] + [False] * len(cells)
            plain = (with_minus(cell) if isinstance(cell, str) and figure else cell for cell, figure in zip(cells, figures, strict=False))
            super().add_row(*(BreakingText(shown(cell)) if isinstance(cell, str) else cell for cell in plain), **how)

        def add_column(self, header: RenderableType = "", *rest: Any, **how: Any) -> None:
            numbers = how.get("justify") == "right"  # to which names give way
            figures: dict[str, Any] = {"no_wrap": True, "overflow": "fold"} if numbers else {}
            super().add_column(Text(shown(header)) if isinstance(header, str) else header, *rest, **(figures | how))

        def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
            wide, near, tight = _GAPS
            for gaps, whole in ((wide, True), (near, True), (tight, True), (near, False), (tight, False)):  # whole, or broken between words
                self.padding = gaps
                wanted = self.__rich_measure__(console, options.update(max_width=_MOST))
                if (wanted.maximum if whole else wanted.minimum) <= options.max_width:
                    break
            yield from super().__rich_console__(console, options)

    table = ShownTable(box=box.SIMPLE_HEAD, pad_edge=False, show_edge=False)
    for label in labels:
        table.add_column(label)
    return table


def titled(title: str, table: Table) -> RenderableType:
    """A table under its title."""
    from rich.console import Group
    from rich.text import Text

    return Group(Text(shown(title)), Text(""), table)
