"""A CSV file as named columns, for tables that are not measurements: poses without spots, readings on a bench.

Separator `,`, `;` or tab, detected; with `;` a decimal comma is understood; lines that start with # are comments; units stand in
brackets behind a column's name, as in measurements.csv.
"""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from urdfcal.base.errors import MeasurementError, did_you_mean
from urdfcal.base.geometry import DEG, MM, Vector

LENGTHS = {"m": 1.0, "mm": MM}
ANGLES = {"rad": 1.0, "deg": DEG}
_NUMBER = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?")
_HEADER = re.compile(r"\s*([^\[\]]*?)\s*(?:\[\s*([^\[\]]*?)\s*\])?\s*")


@dataclass(frozen=True)
class CsvTable:
    """A table.

    Attributes:
        path: The file.
        header: The header's cells as they stand, by the column's name without its unit.
        units: Unit of each column that states one.
        columns: Cells by column name.
        lines: Line of each row in the file.
        header_line: Line of the header.
        decimal_comma: Whether 1,5 is a number.
    """

    path: Path
    header: Mapping[str, str]
    units: Mapping[str, str]
    columns: Mapping[str, list[str]]
    lines: list[int]
    header_line: int
    decimal_comma: bool

    def __len__(self) -> int:
        """Number of rows."""
        return len(self.lines)

    def fail(self, row: int | None, column: str, message: str) -> MeasurementError:
        """An error that names the row's line, or the header's, and the column."""
        return MeasurementError(f"column '{column}': {message}", self.path, self.header_line if row is None else self.lines[row])

    def require(self, name: str, what: str) -> None:
        """Refuse a table without a column."""
        if name not in self.columns:
            raise self.fail(None, name, f"is missing; expected {what}{did_you_mean(name, self.columns)}")

    def numbers(self, name: str, allowed: Mapping[str, float], empty: bool = False) -> Vector:
        """A column in SI units, (n,); nan for an empty cell where that is allowed.

        Args:
            name: The column.
            allowed: Factors of the units that it can have; the first is the default.
            empty: Whether a cell can be empty.

        Raises:
            MeasurementError: naming line and column.
        """
        unit = self.units.get(name, next(iter(allowed)))
        if unit not in allowed:
            raise self.fail(None, name, f"unit '{unit}' is not understood, expected {' or '.join(allowed)}")
        return np.array([self._number(name, row, cell, empty) for row, cell in enumerate(self.columns[name])]) * allowed[unit]

    def _number(self, name: str, row: int, cell: str, empty: bool) -> float:
        if not cell and empty:
            return math.nan
        text = cell.replace(",", ".") if self.decimal_comma and "." not in cell else cell
        if not _NUMBER.fullmatch(text) or not math.isfinite(float(text)):
            raise self.fail(row, name, f"'{cell}' is not a finite number" if cell else "the cell is empty, expected a number")
        return float(text)


def read_csv_table(path: str | Path, what: str) -> CsvTable:
    """Read a table.

    Args:
        path: The file, UTF-8.
        what: What its rows are, for messages.

    Raises:
        MeasurementError: it cannot be read, has no row, or a row or the header is malformed.
    """
    rows, separator = _rows(Path(path))
    if len(rows) < 2:
        raise MeasurementError(f"has {'a header and no row' if rows else 'no header'}; expected a header and {what}", path)
    (header_line, cells), body = rows[0], rows[1:]
    while cells and not cells[-1]:
        cells.pop()
    parsed = [_header_cell(path, header_line, cell, position) for position, cell in enumerate(cells, start=1)]
    names = [name for name, _ in parsed]
    for name in names:
        if names.count(name) > 1:
            raise MeasurementError(f"column '{name}': stands twice", path, header_line)
    for line, row in body:
        if len(row) < len(names) or any(row[len(names) :]):
            raise MeasurementError(f"the row has {len(row)} cells, expected {len(names)} as in the header", path, line)
    return CsvTable(
        Path(path),
        dict(zip(names, cells, strict=True)),
        {name: unit for name, unit in parsed if unit is not None},
        {name: [row[position] for _, row in body] for position, name in enumerate(names)},
        [line for line, _ in body],
        header_line,
        separator == ";",
    )


def _header_cell(path: str | Path, line: int, cell: str, position: int) -> tuple[str, str | None]:
    match = _HEADER.fullmatch(cell)
    if match is None:
        raise MeasurementError(f"column '{cell}': expected a name and perhaps a unit, such as 'joint1 [deg]'", path, line)
    if not match[1]:
        raise MeasurementError(f"cell {position} of the header is empty, expected a name", path, line)
    return match[1], match[2]


def _rows(path: Path) -> tuple[list[tuple[int, list[str]]], str]:
    try:
        text = path.read_bytes().decode("utf-8-sig")
    except OSError as error:
        raise MeasurementError(f"cannot be read: {error.strerror or error}", path) from None
    except UnicodeDecodeError as error:
        raise MeasurementError("is not UTF-8 text; save it as CSV in UTF-8", path, error.object[: error.start].count(b"\n") + 1) from None
    lines = [(number, line) for number, line in enumerate(re.split(r"\r\n|\n|\r", text), start=1)]
    kept = [(number, line) for number, line in lines if line.strip() and not line.lstrip().startswith("#")]
    separator = max(";\t,", key=kept[0][1].count) if kept else ","
    try:
        return [
            (n, [c.strip() for c in next(csv.reader([line], delimiter=separator, skipinitialspace=True))]) for n, line in kept
        ], separator
    except csv.Error as error:
        raise MeasurementError(f"cannot be split into cells: {error}", path) from None
