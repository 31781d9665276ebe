"""CSV, in and out: the one reader and the one writer of tables.

In: UTF-8 with or without byte-order mark, any line ending; separator `,`, `;`, tab or spaces, detected in the header; with `;` or spaces a
decimal comma is understood; lines that start with # are comments, and those without anything in a cell are none; a unit stands in
brackets behind a column's name, such as `joint1 [deg]`, or in a row under the header; `NaN` is an empty cell. `table_layout` has the rest.
Out: separator `,`, decimal points, 12 significant digits, nothing for nan, and no row that would be read as a comment.
"""

from __future__ import annotations

import csv
import hashlib
import io
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from urdfcal.base.errors import MeasurementError, did_you_mean
from urdfcal.base.geometry import DEG, MM, Mask, Vector
from urdfcal.base.reading import TABLE, content_of
from urdfcal.base.table_layout import counts_by_one, header_at, separator_of, text_of_sheet, unit_of, units_row, words_of

LENGTHS = {"m": 1.0, "mm": MM}
ANGLES = {"rad": 1.0, "deg": DEG, "mrad": 1e-3}
_NUMBER = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?")
_LINE_END = re.compile(r"\r\n|\n|\r")
_UNNAMED = re.compile(r"(Unnamed: \d+)?")  # what pandas calls a column without a name


@dataclass(frozen=True)
class Table:
    """A CSV file as named columns; rows are split when cells are first asked for, so that what is wrong with the header is said first.

    Attributes:
        path: The file; of a table in memory what it is called in messages.
        sha256: Of its bytes.
        header_line: Line of the header; 0 of a table in memory, whose rows are counted from 1.
        names: Of the columns, without their units.
        units: Unit of each column that states one.
        separator: Between cells.
        body: Line number and text of each row.
        positions: Of the columns among the cells; the empty tuple if every cell is one.
        notes: What was taken for something that the file does not say, for warnings.
    """

    path: Path
    sha256: str
    header_line: int
    names: tuple[str, ...]
    units: Mapping[str, str]
    separator: str
    body: tuple[tuple[int, str], ...]
    positions: tuple[int, ...] = ()
    notes: tuple[str, ...] = ()

    def __len__(self) -> int:
        """Number of rows."""
        return len(self.body)

    @property
    def lines(self) -> list[int]:
        """Line of each row in the file."""
        return [line for line, _ in self.body]

    @cached_property
    def columns(self) -> Mapping[str, list[str]]:
        """Cells by column name.

        Raises:
            MeasurementError: a row has fewer cells than the header, or more.
        """
        rows = [self._cells(row) for row in range(len(self))]
        places = self.positions or range(len(self.names))
        return {
            name: ["" if _is_nan(cells[place]) else cells[place] for cells in rows] for place, name in zip(places, self.names, strict=True)
        }

    def nothing(self, row: int, name: str) -> str:
        """What a cell that says nothing looks like: it is empty, or has a NaN."""
        place = self.names.index(name)
        cell = self._cells(row)[self.positions[place] if self.positions else place]
        return f"the cell is '{cell}'" if cell else "the cell is empty"

    @property
    def header(self) -> str:
        """Where the header stands, for messages: `FILE:LINE`."""
        return _place(self.path, self.header_line)

    def title(self, name: str) -> str:
        """A column's name with its unit, as in the header."""
        return f"{name} [{self.units[name]}]" if name in self.units else name

    def renamed(self, names: Mapping[str, str]) -> Table:
        """The same table with other names for some of its columns.

        Raises:
            MeasurementError: two columns then have one name.
        """
        own = {name: names.get(name, name) for name in self.names}
        _require_once(self.path, self.header_line, tuple(own.values()))
        return replace(self, names=tuple(own.values()), units={own[name]: unit for name, unit in self.units.items()})

    def fail(self, row: int | None, column: str, message: str) -> MeasurementError:
        """An error that names the row's line, or the header's, and the column."""
        return _fault(self.path, self.header_line if row is None else self.body[row][0], column, message)

    def require(self, name: str, what: str) -> None:
        """Refuse a table without a column."""
        if name not in self.names:
            raise self.fail(None, name, f"is missing; expected {what}{did_you_mean(name, self.names)}")

    def refuse(self, name: str, wrong: Mask, message: str) -> None:
        """Refuse the first cell of a column that is wrong, if there is one; its text goes before the message."""
        for row in np.flatnonzero(wrong)[:1]:
            raise self.fail(int(row), name, f"'{self.columns[name][row]}' {message}")

    def numbers(
        self, name: str, units: Mapping[str, float], way_out: str = "expected a number", *, empty: bool = False, most: float = math.inf
    ) -> Vector:
        """A column in SI units, (n,).

        Args:
            name: The column.
            units: Factors of the units that it can have; the first is the default.
            way_out: What was expected of a cell that is no number.
            empty: Whether a cell can be empty, which is nan then.
            most: No cell may be farther from zero, in its own unit.

        Raises:
            MeasurementError: naming line and column.
        """
        factor = self._factor(name, units)
        cells = self.columns[name]
        numbers = np.array([self._number(cell) for cell in cells])
        for row in np.flatnonzero(~(np.isfinite(numbers) & (np.abs(numbers) <= most))):
            if cells[row] or not empty:
                found = _no_number(cells[row], numbers[row], most) if cells[row] else self.nothing(int(row), name)
                raise self.fail(int(row), name, f"{found}; {way_out}")
        return factor * numbers

    def with_point(self, cell: str) -> str:
        """A cell; with a decimal point if it is a number with a decimal comma, and this file can have such."""
        if self.separator not in "; " or "," not in cell:
            return cell
        text = cell.replace(",", ".")
        return text if _NUMBER.fullmatch(text) else cell

    def _factor(self, name: str, units: Mapping[str, float]) -> float:
        unit = self.units.get(name, next(iter(units)))
        if unit not in units:
            raise self.fail(None, name, f"unit '{unit}' is not understood, expected {' or '.join(units)}")
        return units[unit]

    def _number(self, cell: str) -> float:
        """A cell as a number; nan if it is none."""
        text = self.with_point(cell)
        return float(text) if _NUMBER.fullmatch(text) else math.nan

    def _cells(self, row: int) -> list[str]:
        line, text = self.body[row]
        cells, width = _split(self.path, line, text, self.separator), max(self.positions, default=len(self.names) - 1) + 1
        if len(cells) < width or any(cells[width:]):
            way_out = "; a decimal comma needs ; between the cells" if len(cells) > width and self.separator == "," else ""
            raise self.fail(row, "", f"the row has {len(cells)} cells, expected {width} as in the header{way_out}")
        return cells


def read_table(path: str | Path, header: str, rows: str) -> Table:
    """Read a CSV file.

    Args:
        path: The file.
        header: What the header must hold, for messages.
        rows: What its rows are, for messages.

    Raises:
        MeasurementError: it cannot be read, has no header or no row, or the header is malformed.
    """
    path = Path(path)
    content = content_of(path, TABLE, MeasurementError)
    text, notes = _text(path, content)
    return table_of_text(path, text, header, rows, hashlib.sha256(content).hexdigest(), notes)


def table_in_memory(label: str, columns: Mapping[str, Sequence[str]], header: str, rows: str) -> Table:
    """Columns in memory as the table that a file of them would be read as; rows are counted from 1.

    Args:
        label: What the table is called in messages.
        columns: Cells by the column's name, which may state a unit as in a file; all of one length.
        header: As for `read_table`.
        rows: As for `read_table`.

    Raises:
        MeasurementError: there is no row, or the header is malformed.
    """
    text = csv_text(list(columns), zip(*columns.values(), strict=True)).decode()
    return table_of_text(Path(label), text, header, rows, first=0)


def table_of_text(path: Path, text: str, header: str, rows: str, sha256: str = "", notes: Sequence[str] = (), first: int = 1) -> Table:
    """A table from its text, wherever that comes from.

    Args:
        path: The file, or what else it is called in messages.
        text: All of it.
        header: As for `read_table`.
        rows: As for `read_table`.
        sha256: Hash of what it was read from.
        notes: What is to be said of it already.
        first: Number of the first line.

    Raises:
        MeasurementError: it has no header or no row, or the header is malformed.
    """
    notes = list(notes)
    if text.lstrip().startswith("<"):
        raise MeasurementError(f"is XML, as robot descriptions are; expected a table with {header}, which comes after the robot", path)
    lines = _filled_lines(text, first)
    if not lines:
        raise MeasurementError(f"the file has no header line; expected {header}", path)
    start = header_at([text for _, text in lines])
    (line, head), *body = lines[start:]
    if start:
        notes.append(f"{_place(path, line)}: taken for the header; what stands above it is taken for a title")
    separator = separator_of(head, [row for _, row in body])
    titles = words_of(head) if separator == " " else _split(path, line, head, separator)
    _require_names(path, line, titles, body[0][1] if body else "", header)
    under = _units_under(path, body, separator)
    names, units, positions = _named(path, line, titles, body[bool(under) :], separator, notes)
    if under:
        notes.append(f"{path}:{body[0][0]}: taken for a row of units")
        units = _with_units(
            path, line, units, {name: under[place] for name, place in zip(names, positions, strict=True) if place < len(under)}
        )
        body = body[1:]
    if not body:
        raise MeasurementError(f"there is a header and no row; expected {rows}", path, line)
    return Table(path, sha256, line, names, units, separator, tuple(body), positions, tuple(notes))


def _require_names(path: Path, line: int, titles: Sequence[str], row: str, header: str) -> None:
    """Refuse numbers, or a title above them, in the header's place.

    Raises:
        MeasurementError: the table begins with its first row.
    """
    filled = [title for title in titles if title]
    below = _split(path, line + 1, row, separator_of(row))
    if filled and all(map(_like_number, filled)):
        found = f"the first line has numbers alone ({', '.join(filled[:2])}{' ...' if len(filled) > 2 else ''})"
    elif len(filled) == 1 and len(below) > 1 and all(map(_like_number, below)):
        found = f"above the numbers stands '{filled[0]}' alone"
    else:
        return
    raise MeasurementError(f"there is no header line: {found}; expected {header}", path, line)


def _like_number(cell: str) -> bool:
    return bool(_NUMBER.fullmatch(cell.replace(",", "."))) or _is_nan(cell)


def _units_under(path: Path, body: Sequence[tuple[int, str]], separator: str) -> list[str | None]:
    """Units of the columns, where the first row is one of units."""
    return (units_row(_split(path, *body[0], separator)) if body else None) or []


def _with_units(path: Path, line: int, units: dict[str, str], under: Mapping[str, str | None]) -> dict[str, str]:
    """The header's units and those under it.

    Raises:
        MeasurementError: they are at odds.
    """
    for name, unit in under.items():
        if unit and units.get(name, unit) != unit:
            raise _fault(path, line, name, f"the header says [{units[name]}] and the row under it {unit}; leave one of the two out")
    return units | {name: unit for name, unit in under.items() if unit}


def csv_text(names: Sequence[str], rows: Iterable[Sequence[str | float]], comments: Iterable[str] = ()) -> bytes:
    """Write a CSV file.

    Args:
        names: The header.
        rows: Text and numbers.
        comments: Lines for the head of the file.
    """
    text = io.StringIO()
    text.writelines(f"# {_one_line(comment)}\n" for comment in comments)
    csv.writer(text, lineterminator="\n").writerows(_written(row) for row in (names, *rows))
    return text.getvalue().encode(errors="backslashreplace")


def _written(row: Sequence[str | float]) -> list[str]:
    """Cells of a row; a # at its front would make a comment of it."""
    first, *others = (_one_line(value) if isinstance(value, str) else _digits(value) for value in row)
    return [first.lstrip("# "), *others]


def _digits(number: float) -> str:
    return "" if math.isnan(number) else f"{number:.12g}"


def _one_line(text: str) -> str:
    return " ".join(text.split())


def _text(path: Path, content: bytes) -> tuple[str, list[str]]:
    """A file's text, and what is to be said of where it comes from."""
    sheet = text_of_sheet(path, content)
    if sheet is not None:
        text, name = sheet
        return text, [f"{path}: of the workbook's sheets the first one, '{name}', is read"] if name else []
    try:
        return content.decode("utf-8-sig"), []
    except UnicodeDecodeError as error:
        line = len(_LINE_END.split(error.object[: error.start].decode("latin-1")))
        raise MeasurementError("is not UTF-8 text; save it as CSV in UTF-8", path, line) from None


def _filled_lines(text: str, first: int) -> list[tuple[int, str]]:
    """Number and text of the lines that are neither comments nor without anything in a cell."""
    lines = enumerate(_LINE_END.split(text), start=first)
    return [(number, line) for number, line in lines if line.strip(' \t,;"\x0b\x0c\u00a0') and not line.lstrip().startswith("#")]


def _split(path: Path, line: int, text: str, separator: str) -> list[str]:
    if separator == " ":
        return text.split()
    try:
        return [cell.strip() for cell in next(csv.reader([text], delimiter=separator, skipinitialspace=True))]
    except csv.Error as error:
        raise MeasurementError(f"cannot be split into cells: {error}", path, line) from None


def _named(
    path: Path, line: int, titles: list[str], body: Sequence[tuple[int, str]], separator: str, notes: list[str]
) -> tuple[tuple[str, ...], dict[str, str], tuple[int, ...]]:
    """Names of a header's columns, the units of those that state one, and which cells they are.

    Empty cells at its end are no columns, nor are cells that are empty in every row; an index that pandas wrote is none either.
    """
    while titles and not titles[-1]:
        titles.pop()
    kept = [place for place, title in enumerate(titles) if not _means_nothing(place, title, path, line, body, separator, notes)]
    named = [_name_and_unit(path, line, titles[place], place + 1) for place in kept]
    names = tuple(name for name, _ in named)
    _require_once(path, line, names)
    return names, {name: unit for name, unit in named if unit is not None}, tuple(kept)


def _means_nothing(
    place: int, title: str, path: Path, line: int, body: Sequence[tuple[int, str]], separator: str, notes: list[str]
) -> bool:
    """Whether a column without a name is empty, or the index that pandas puts first."""
    if not _UNNAMED.fullmatch(title):
        return False
    rows = [_split(path, *row, separator) for row in body]
    cells = [row[place] if place < len(row) else "" for row in rows]
    if not any(cells):
        return True
    index = place == 0 and counts_by_one(cells)
    if index:
        notes.append(f"{_place(path, line)}: the first column has no name and counts the rows; it is taken for an index and not used")
    return index


def _name_and_unit(path: Path, line: int, title: str, position: int) -> tuple[str, str | None]:
    if title.endswith(")") and (unit := unit_of(title[:-1].rpartition("(")[2])):
        title = f"{title.rpartition('(')[0]}[{unit}]"
    name, bracket, unit = (word.strip() for word in title.removesuffix("]").partition("["))
    if bool(bracket) != title.endswith("]"):
        raise _fault(
            path, line, title, f"the unit has no {'closing' if bracket else 'opening'} bracket, expected for example 'joint1 [deg]'"
        )
    if not name:
        raise _fault(path, line, title, f"cell {position} of the header is empty, expected a name")
    return name, (unit_of(unit) or unit) if bracket else None


def _require_once(path: Path, line: int, names: Sequence[str]) -> None:
    for position, name in enumerate(names):
        first = names.index(name)
        if first < position:
            raise _fault(path, line, name, f"stands twice, in cells {first + 1} and {position + 1}")


def _place(path: Path, line: int) -> str:
    return f"{path}:{line}" if line else str(path)


def _fault(path: Path, line: int, column: str, message: str) -> MeasurementError:
    return MeasurementError(f"column '{column}': {message}" if column else message, path, line)


def _no_number(cell: str, number: float, most: float) -> str:
    """What keeps a cell from being taken for a number."""
    if math.isfinite(number):
        return f"'{cell}' is beyond {most:g}"
    return f"'{cell}' is not {'finite' if _is_infinite(cell) else 'a number'}"


def _is_nan(cell: str) -> bool:
    """Whether a cell says that there is nothing, as many programs write it."""
    return len(cell) == 3 and cell.lower() == "nan"


def _is_infinite(text: str) -> bool:
    """Whether Python takes a text for an infinite number or nan."""
    try:
        return not math.isfinite(float(text))
    except ValueError:
        return False
