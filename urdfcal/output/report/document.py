"""The parts that a report is made of, whatever it is written as."""

from __future__ import annotations

from dataclasses import dataclass

from urdfcal.base.minus import with_minus

_MANY_ROWS, _SLIM, _SHORT = 12, 4, 36  # rows, columns, letters of a row's name


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

    @property
    def shown(self) -> list[list[Cell]]:
        """The rows, figures with a true minus."""
        return [
            [with_minus(cell) if at >= self.words and isinstance(cell, str) else cell for at, cell in enumerate(row)] for row in self.rows
        ]

    @property
    def long(self) -> bool:
        """Whether it is slim and has so many rows that they had better stand in two columns where there is room."""
        names = max((len(str(row[0])) for row in self.rows), default=0)
        return len(self.rows) >= _MANY_ROWS and self.words < len(self.columns) <= _SLIM and names <= _SHORT and not self.groups

    @property
    def compared(self) -> bool:
        """Whether two groups of the same figures stand beside each other, as before and after."""
        width = self.groups[-1][1] if len(self.groups) == 3 else 0
        return bool(width) and self.columns[-2 * width : -width] == self.columns[-width:]


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
