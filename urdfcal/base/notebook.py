"""Short HTML for notebooks: a title, a line, tables. Foreign text is escaped, and colours are those of the page, light or dark.

Notebooks that are not trusted show no style sheets, so that every element has its own style; lines and shades are half transparent.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from html import escape
from typing import Literal

from urdfcal.base.foreign_text import shown

Tone = Literal["good", "warn", "bad", "none"]

_TONES: dict[Tone, str] = {"good": "#1a9167", "warn": "#c98500", "bad": "#d0453b", "none": "rgba(128, 128, 128, .55)"}
_SOFT = "opacity: .72"
_CELL = "padding: .2em .9em .2em 0; border: 0; border-bottom: 1px solid rgba(128, 128, 128, .28); background: none"
_MOST_ROWS = 60  # that a cell's output is asked to hold


@dataclass(frozen=True)
class Listing:
    """A table.

    Attributes:
        columns: Headings.
        rows: Cells.
        words: How many columns from the left are words; the others are figures.
        title: What stands above it.
        folded: Whether it is shown on a click alone.
    """

    columns: Sequence[str]
    rows: Sequence[Sequence[object]]
    words: int = 1
    title: str = ""
    folded: bool = False


def card(title: str, lines: Sequence[str], listings: Sequence[Listing] = (), tone: Tone = "none") -> str:
    """What a notebook shows of something.

    Args:
        title: What it is.
        lines: Sentences below.
        listings: Tables; those without a row are left out.
        tone: Good news or bad, at its edge.
    """
    edge = f"border-left: 4px solid {_TONES[tone]}; padding: .1em 0 .1em .9em; max-width: 62em; line-height: 1.45"
    said = "".join(f'<div style="{_SOFT}">{_text(line)}</div>' for line in lines if line)
    tables = "".join(part for listing in listings if len(listing.rows) for part in _table(listing))
    return f'<div style="{edge}"><div style="font-weight: 600">{_text(title)}</div>{said}{tables}</div>'


def _table(listing: Listing) -> Iterator[str]:
    head = "".join(_cell("th", column, place >= listing.words) for place, column in enumerate(listing.columns))
    rows = "".join(
        f'<tr style="background: none">{"".join(_cell("td", cell, place >= listing.words) for place, cell in enumerate(row))}</tr>'
        for row in listing.rows[:_MOST_ROWS]
    )
    left = len(listing.rows) - _MOST_ROWS
    more = f'<div style="{_SOFT}">and {left} more</div>' if left > 0 else ""
    style = "border-collapse: collapse; border: 0; margin: .35em 0; font-variant-numeric: tabular-nums; font-size: .92em"
    table = f'<div style="overflow-x: auto"><table style="{style}"><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table></div>{more}'
    title = f'<span style="{_SOFT}">{_text(listing.title)}</span>' if listing.title else ""
    yield (
        f"<details><summary>{title}</summary>{table}</details>" if listing.folded else f'<div style="margin-top: .5em">{title}</div>{table}'
    )


def _cell(kind: str, cell: object, figure: bool) -> str:
    side = "right" if figure else "left"
    weight = f"; font-weight: 400; {_SOFT}" if kind == "th" else ""
    return f'<{kind} style="text-align: {side}; white-space: nowrap; {_CELL}{weight}">{_text(str(cell))}</{kind}>'


def _text(text: str) -> str:
    return escape(shown(" ".join(text.split())))
