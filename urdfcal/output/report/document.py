"""The parts that a report is made of, whatever it is written as."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Share:
    """A part of a whole, shown as a bar where there can be one.

    Attributes:
        value: 1 is the whole.
        mark: Where a line is drawn across the bar.
    """

    value: float
    mark: float

    def __str__(self) -> str:
        """`3.1 %`."""
        return f"{self.value * 100:.2g} %" if self.value < 0.995 else f"{self.value * 100:.0f} %"


Cell = str | Share


@dataclass(frozen=True)
class Table:
    """Rows under named columns.

    Attributes:
        columns: Their headings.
        rows: Cells, as many a row as there are columns.
        words: How many columns from the left are words; the others are figures.
        groups: Headings over several columns each, with their counts; an empty heading over none.
    """

    columns: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]
    words: int = 1
    groups: tuple[tuple[str, int], ...] = ()


@dataclass(frozen=True)
class Points:
    """A list of sentences."""

    lines: tuple[str, ...]


@dataclass(frozen=True)
class Gallery:
    """The place of some pictures; left out where there are none."""

    key: str


Block = str | Table | Points | Gallery


@dataclass(frozen=True)
class Section:
    """A heading and what stands under it; a text is a paragraph."""

    key: str
    title: str
    blocks: tuple[Block, ...]
