"""Text as the terminal shows it: tables, titles, values with their sigmas."""

from __future__ import annotations

import io
import math
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

from urdfcal.base.foreign_text import shown
from urdfcal.base.geometry import DEG, MM

if TYPE_CHECKING:
    from rich.console import RenderableType
    from rich.table import Table


WIDTH = 100


def as_text(blocks: Iterable[RenderableType]) -> str:
    """Rich blocks as plain text."""
    from rich.console import Console

    stream = io.StringIO()
    console = Console(file=stream, width=WIDTH, color_system=None, highlight=False, markup=False, emoji=False)
    for block in blocks:
        console.print(shown(block) if isinstance(block, str) else block, soft_wrap=isinstance(block, str))
    return "\n".join(line.rstrip() for line in stream.getvalue().splitlines()) + "\n"


def value_and_sigma(value: float, sigma: float) -> str:
    """`+0.9987 ± 0.0210`: the sigma with three digits that count, the value as far."""
    if not (math.isfinite(sigma) and sigma > 0):
        return f"{value:+.6g}"
    digits = min(max(2 - math.floor(math.log10(sigma)), 0), 9)
    return f"{value:+.{digits}f} ± {sigma:.{digits}f}"


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
            super().add_row(*(Text(shown(cell)) if isinstance(cell, str) else cell for cell in cells), **how)

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
