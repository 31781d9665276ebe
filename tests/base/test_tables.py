"""CSV: a table is read the same however it is written, faults are one message, and what was written comes back."""

from __future__ import annotations

import hashlib
import math
from pathlib import Path

import numpy as np
import pytest

from urdfcal.base.errors import MeasurementError
from urdfcal.base.tables import LENGTHS, Table, csv_text, read_table

TEXT = "label,x [mm],y\na,1.5,-2e-1\nb,,3\n"


def read(folder: Path, text: str | bytes) -> Table:
    (folder / "t.csv").write_bytes(text if isinstance(text, bytes) else text.encode())
    return read_table(folder / "t.csv", "label and x", "one row a thing")


SAME = {
    "comma": TEXT,
    "semicolon": TEXT.replace(",", ";"),
    "decimal comma": TEXT.replace(",", ";").replace(".", ","),
    "tab": TEXT.replace(",", "\t"),
    "CRLF": TEXT.replace("\n", "\r\n"),
    "CR": TEXT.replace("\n", "\r"),
    "no end of line": TEXT.removesuffix("\n"),
    "byte-order mark": f"\ufeff{TEXT}",
    "comments and blank lines": f"# a; b\n\n{TEXT}  # c\n  \n",
    "blanks": TEXT.replace(",", " ,  ").replace("[mm]", "[ mm ]"),
    "quotes": "\n".join(",".join(f'"{cell}"' for cell in line.split(",")) for line in TEXT.splitlines()),
    "trailing separators": TEXT.replace("\n", ",,\n"),
}


@pytest.mark.parametrize("case", SAME)
def test_the_same_table_is_read_however_it_is_written(case: str, tmp_path: Path) -> None:
    """Encoding, separator, decimal comma, line ends, comments, blanks and quotes change no cell."""
    table = read(tmp_path, SAME[case])
    assert (table.names, dict(table.units), len(table)) == (("label", "x", "y"), {"x": "mm"}, 2)
    assert table.columns["label"] == ["a", "b"]
    np.testing.assert_array_equal(table.numbers("x", LENGTHS, empty=True), [0.0015, np.nan])
    np.testing.assert_array_equal(table.numbers("y", LENGTHS), [-0.2, 3])


def test_lines_and_the_hash_are_those_of_the_file(tmp_path: Path) -> None:
    """Messages count comments and blank lines, and the hash is of the bytes, byte-order mark and all."""
    text = f"\ufeff# a\r\n\r\n{TEXT}".encode()
    table = read(tmp_path, text)
    assert (table.header_line, table.lines, table.sha256) == (3, [4, 5], hashlib.sha256(text).hexdigest())
    assert str(table.fail(1, "x", "wrong")) == f"{tmp_path}/t.csv:5: column 'x': wrong"
    assert str(table.fail(None, "x", "wrong")) == f"{tmp_path}/t.csv:3: column 'x': wrong"


UNREADABLE = {
    "empty": ("", ": the file has no header line; expected label and x"),
    "no row": ("\nx\n# end", ":2: there is a header and no row; expected one row a thing"),
    "Latin-1 behind CR": ("x\r\u00e4\r".encode("latin-1"), ":2: is not UTF-8 text; save it as CSV in UTF-8"),
    "Latin-1 behind a byte-order mark": ("\ufeffx\n".encode() + b"\xe4\n", ":2: is not UTF-8 text"),
    "no closing bracket": ("x [mm,y\n1,2", ":1: column 'x [mm': the unit has no closing bracket, expected for example 'joint1 [deg]'"),
    "no opening bracket": ("x mm],y\n1,2", ":1: column 'x mm]': the unit has no opening bracket"),
    "no name": ("x,,y\n1,2,3", ":1: cell 2 of the header is empty, expected a name"),
    "unit alone": ("x,[mm]\n1,2", ":1: column '[mm]': cell 2 of the header is empty"),
    "twice": ("x,y,x [mm]\n1,2,3", ":1: column 'x': stands twice, in cells 1 and 3"),
}


@pytest.mark.parametrize("case", UNREADABLE)
def test_what_is_no_table_is_refused(case: str, tmp_path: Path) -> None:
    """A file without header or rows, in another encoding, or with a malformed header."""
    text, message = UNREADABLE[case]
    with pytest.raises(MeasurementError) as error:
        read(tmp_path, text)
    assert str(error.value).startswith(f"{tmp_path}/t.csv{message}")


def test_a_file_that_cannot_be_read_is_refused(tmp_path: Path) -> None:
    """A missing file and a folder are refused by name."""
    for name in ("none.csv", "."):
        with pytest.raises(MeasurementError, match=r"cannot be read: (No such file|Is a directory)"):
            read_table(tmp_path / name, "columns", "rows")


BAD_CELLS = {
    "word": ("up", ":3: column 'x': 'up' is not a number; expected a number"),
    "empty": ("", ":3: column 'x': the cell is empty; expected a number"),
    "nan": ("nan", ":3: column 'x': the cell is 'nan'; expected a number"),
    "overflow": ("1e999", ":3: column 'x': '1e999' is not finite"),
    "far": ("-1e7", ":3: column 'x': '-1e7' is beyond 1e+06; expected a number"),
    "underscore": ("1_0", ":3: column 'x': '1_0' is not a number"),
    "arabic digit": ("\u0661", ":3: column 'x': '\u0661' is not a number"),
    "another cell": ("1,5", ":3: the row has 3 cells, expected 2 as in the header; a decimal comma needs ; between the cells"),
    "endless": ("1" * 200_000, ":3: cannot be split into cells: field larger than field limit"),
}


@pytest.mark.parametrize("case", BAD_CELLS)
def test_what_is_no_number_is_refused(case: str, tmp_path: Path) -> None:
    """Each fault of a cell names line and column, what was found and what was expected."""
    cell, message = BAD_CELLS[case]
    table = read(tmp_path, f"x,y\n1,2\n{cell},4\n")
    with pytest.raises(MeasurementError) as error:
        table.numbers("x", LENGTHS, most=1e6)
    assert str(error.value).startswith(f"{tmp_path}/t.csv{message}")


def test_thousands_are_no_decimal_comma(tmp_path: Path) -> None:
    """1.234,5 could be either, and is refused."""
    with pytest.raises(MeasurementError, match=r"'1\.234,5' is not a number"):
        read(tmp_path, "x;y\n1.234,5;1").numbers("x", LENGTHS)


def test_columns_are_required_and_cells_refused_by_name(tmp_path: Path) -> None:
    """A missing column gets its nearest name, an unknown unit those that there are, a wrong cell its text."""
    table = read(tmp_path, "depth [in],y\n1,2\n3,-4\n")
    with pytest.raises(MeasurementError, match=r"t\.csv:1: column 'dept': is missing; expected it; did you mean 'depth'\?"):
        table.require("dept", "it")
    with pytest.raises(MeasurementError, match=r"t\.csv:1: column 'depth': unit 'in' is not understood, expected m or mm"):
        table.numbers("depth", LENGTHS)
    with pytest.raises(MeasurementError, match=r"t\.csv:3: column 'y': '-4' is below zero"):
        table.refuse("y", table.numbers("y", LENGTHS) < 0, "is below zero")
    table.refuse("y", np.zeros(2, dtype=bool), "is anything")


def test_columns_can_have_other_names(tmp_path: Path) -> None:
    """Cells and units go with the new name, and no name may then stand twice."""
    table = read(tmp_path, TEXT).renamed({"x": "z"})
    assert (table.names, table.title("z"), table.title("y"), table.columns["z"]) == (("label", "z", "y"), "z [mm]", "y", ["1.5", ""])
    with pytest.raises(MeasurementError, match="column 'y': stands twice, in cells 2 and 3"):
        table.renamed({"z": "y"})


def test_what_was_written_comes_back(tmp_path: Path) -> None:
    """Text keeps its commas and quotes, numbers 12 digits, nan is an empty cell, and a # in front makes no comment of a row."""
    labels, numbers = ["# a", 'say "b, c"', "two\nlines", "\u00fc;#"], [math.pi, -1e-20, math.nan, 1e17]
    content = csv_text(["name", "x"], zip(labels, numbers, strict=True), ["first\nsecond", "third"])
    table = read(tmp_path, content)
    assert table.columns["name"] == ["a", 'say "b, c"', "two lines", "\u00fc;#"]
    np.testing.assert_allclose(table.numbers("x", LENGTHS, empty=True), numbers, rtol=1e-11)
    assert content.decode().startswith("# first second\n# third\nname,x\na,3.14159265359\n")
