"""Text as the terminal shows it: tables, titles, values with their sigmas."""

from __future__ import annotations

import io
import math
import textwrap
from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING, Any

from urdfcal.base.foreign_text import shown
from urdfcal.base.geometry import DEG, MM
from urdfcal.base.minus import with_minus

if TYPE_CHECKING:
    from rich.console import RenderableType
    from rich.table import Table


WIDTH = 100
_LARGE = 1e9  # numbers from here on have an exponent


def as_text(blocks: Iterable[RenderableType], columns: int = 0) -> str:
    """Rich blocks as plain text; sentences are broken between words at so many columns, if any are named."""
    from rich.console import Console

    stream = io.StringIO()
    console = Console(file=stream, width=WIDTH, color_system=None, highlight=False, markup=False, emoji=False)
    for block in blocks:
        text = "\n".join(_between_words(block, columns)) if isinstance(block, str) and columns else block
        console.print(shown(text) if isinstance(text, str) else text, soft_wrap=isinstance(text, str))
    return "\n".join(line.rstrip() for line in stream.getvalue().splitlines()) + "\n"


def _between_words(text: str, columns: int) -> Iterator[str]:
    """The lines of a text with none longer than so many columns, further ones indented as the first."""
    for line in text.splitlines():
        indent = " " * (len(line) - len(line.lstrip()))
        yield from textwrap.wrap(line, columns, subsequent_indent=f"{indent}  ", break_long_words=False, break_on_hyphens=False) or [""]


def rounded(value: float, digits: int) -> str:
    """A number to so many digits that count, as people write it: 160, and not 1.6e+02."""
    text = f"{value:.{digits}g}"
    return with_minus(f"{float(text):.0f}" if "e+" in text and abs(value) < _LARGE else text)


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
            super().add_row(*(Text(shown(cell)) if isinstance(cell, str) else cell for cell in plain), **how)

        def add_column(self, header: RenderableType = "", *rest: Any, **how: Any) -> None:
            super().add_column(Text(shown(header)) if isinstance(header, str) else header, *rest, **how)

    table = ShownTable(box=box.SIMPLE_HEAD, pad_edge=False, show_edge=False)
    for label in labels:
        table.add_column(label)
    return table


def titled(title: str, table: Table) -> RenderableType:
    """A table under its title."""
    from rich.console import Group
    from rich.text import Text

    return Group(Text(shown(title)), Text(""), table)
