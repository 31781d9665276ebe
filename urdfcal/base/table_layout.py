"""How people lay a table out: lines of a title above the header, a row of units under it, spaces between cells, a sheet of Excel.

A header is the first line that has most cells of all lines above the numbers. Where the first line is as wide as any of them, it is the
header, whatever it holds.
"""

from __future__ import annotations

import csv
import io
import re
import warnings
from collections.abc import Sequence
from pathlib import Path

from urdfcal.base.errors import MeasurementError

_WORDS = {
    "m": ("meter", "meters", "metre", "metres"),
    "mm": ("millimeter", "millimeters", "millimetre", "millimetres"),
    "rad": ("radian", "radians"),
    "deg": ("degree", "degrees", "°", "º", "degs"),
    "px": ("pixel", "pixels"),
    "kg": ("kilogram", "kilograms"),
}
UNITS = {word: unit for unit, words in _WORDS.items() for word in (unit, *words)}
_SEPARATORS = ";\t,"
_SPACE_BEFORE_UNIT = re.compile(r"\s+(?=[\[(])")
_NUMBER_LIKE = re.compile(r"[+-]?\.?\d")
_TITLES = 20  # lines among which the header is looked for
_ZIP = b"PK\x03\x04"  # what a workbook begins with
_OLD_EXCEL = b"\xd0\xcf\x11\xe0"


def unit_of(word: str) -> str | None:
    """The unit that a word such as `Deg`, `millimeters` or `°` means: m, mm, rad, deg, px or kg; None if it means none of them."""
    return UNITS.get(word.strip().casefold())


def header_at(lines: Sequence[str]) -> int:
    """Which line is the header; those before it are a title.

    Args:
        lines: Of a table, without comments and blank lines.
    """
    head, most = 0, len(_filled(lines[0], separator_of(lines[0])))
    for number, line in enumerate(lines[1:_TITLES], start=1):
        separator = separator_of(line, lines[number + 1 :])
        cells = _filled(line, separator)
        if any(_NUMBER_LIKE.match(cell) for cell in cells):
            if len(cells) > 1:
                break
        elif len(cells) > max(most, 1) and _numbers_follow(lines[number + 1 : number + 3], separator, len(cells)):
            head, most = number, len(cells)
    return head


def separator_of(head: str, rows: Sequence[str] = ()) -> str:
    """What stands between the cells: `;`, tab or `,`; spaces where the header has none of these, and the rows as many words as it."""
    separator = max(_SEPARATORS, key=head.count)
    if separator in head or not rows:
        return separator
    words = len(words_of(head))
    return " " if words > 1 and len(rows[0].split()) == words else separator


def words_of(head: str) -> list[str]:
    """Cells of a header that has spaces between them; a space before a unit is none."""
    return _SPACE_BEFORE_UNIT.sub("", head).split()


def units_row(cells: Sequence[str]) -> list[str | None] | None:
    """The unit of each column, from a row of nothing but units; None if it is no such row."""
    words = [cell.strip("[]() \"'") for cell in cells]
    units = [unit_of(word) for word in words]
    known = all(unit or word in ("", "-", "1") for word, unit in zip(words, units, strict=True))
    return units if known and any(units) else None


def counts_by_one(cells: Sequence[str]) -> bool:
    """Whether a column holds nothing but whole numbers in a row, as an index does."""
    if not all(cell.isdecimal() for cell in cells):
        return False
    numbers = [int(cell) for cell in cells]
    return numbers == list(range(numbers[0], numbers[0] + len(numbers)))


def text_of_sheet(path: Path, content: bytes) -> tuple[str, str] | None:
    """The first sheet of a workbook as CSV, and its name where there are others; None if the content is no workbook.

    Raises:
        MeasurementError: it cannot be read, or what reads it is not installed.
    """
    if content.startswith(_OLD_EXCEL):
        raise MeasurementError("is a workbook of the old .xls kind; save it as CSV or as .xlsx", path)
    if not content.startswith(_ZIP):
        return None
    try:
        import openpyxl
    except ImportError:
        raise MeasurementError("is a workbook; save it as CSV, or install what reads it: pip install 'urdfcal[xlsx]'", path) from None
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of styles and the like, which mean nothing here
            book = openpyxl.load_workbook(io.BytesIO(content), data_only=True)
    except Exception as error:  # whatever a broken archive makes openpyxl raise
        raise MeasurementError(f"is no workbook that can be read: {' '.join(str(error).split())}; save it as CSV", path) from None
    sheet, text = book.worksheets[0], io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([_cell(value) for value in row] for row in sheet.iter_rows(values_only=True))
    return text.getvalue(), str(sheet.title) if len(book.worksheets) > 1 else ""


def _cell(value: object) -> str:
    return "" if value is None else " ".join(str(value).split())


def _numbers_follow(rows: Sequence[str], separator: str, width: int) -> bool:
    """Whether one of the next rows has as many cells, or one more for an index, half of them numbers."""
    for cells in (_filled(row, separator) for row in rows):
        numbers = sum(bool(_NUMBER_LIKE.match(cell)) for cell in cells)
        if 2 * numbers >= len(cells) and len(cells) in (width, width + 1):
            return True
    return False


def _filled(line: str, separator: str) -> list[str]:
    cells = words_of(line) if separator == " " else line.split(separator)
    return [cell.strip(' "') for cell in cells if cell.strip(' "')]
