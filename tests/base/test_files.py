"""YAML is read with its lines."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from urdfcal.base.errors import RigError
from urdfcal.base.files import read_yaml


def test_entries_know_their_lines(tmp_path: Path) -> None:
    """The line of an entry is found by its steps; where a step is missing, that of the last one that is there."""
    (tmp_path / "a.yaml").write_bytes(b"\xef\xbb\xbf# c\r\na: 1\r\nb:\r\n  c: [1,\r\n    2]\r\n  3: x\r\nd:\r\n\r\ne: 1\r\n")
    file = read_yaml(tmp_path / "a.yaml", RigError)
    assert file.content == {"a": 1, "b": {"c": [1, 2], "3": "x"}, "d": None, "e": 1}
    steps: tuple[list[str | int], ...] = ([], ["a"], ["b", "c", 1], ["b", 3], ["b", "d"], ["b", "c", 2], ["a", "e"], ["d"], ["f"])
    assert [file.line(steps) for steps in steps] == [2, 2, 5, 6, 4, 4, 2, 7, 2]


@pytest.mark.parametrize(("text", "line"), [("", None), ("# c\n", None), ("# c\nword", 2), ("\n- 1", 2)])
def test_a_document_knows_its_first_line(text: str, line: int | None, tmp_path: Path) -> None:
    """An empty one has none."""
    (tmp_path / "a.yaml").write_text(text, "utf-8")
    assert read_yaml(tmp_path / "a.yaml", RigError).line() == line


VALUES: dict[str, object] = {  # as they stand in a file, and as they are read
    "3": 3,
    "-3": -3,
    "1_000": 1000,
    "0x1f": 31,
    "0.5": 0.5,
    "1.": 1.0,
    "-.5": -0.5,
    "1.5e+3": 1500.0,
    "1.5e3": 1500.0,
    "1e-3": 1e-3,
    "1e999": np.inf,
    "-.inf": -np.inf,
    "true": True,
    "False": False,
    "~": None,
    "null": None,
    "": None,
    "yes": "yes",
    "off": "off",
    "1:30": "1:30",
    "010": "010",
    "2024-13-45": "2024-13-45",
    "=": "=",
    "'1'": "1",
    "x:y\t# c": "x:y",
    "\t1\t# c": 1,
    "|\n  x\n  y": "x\ny\n",
    ">-\n  x\n  y": "x y",
}


@pytest.mark.parametrize("text", VALUES)
def test_values_are_those_of_yaml_1_2(text: str, tmp_path: Path) -> None:
    """Numbers, truth values and text, as Python's own types; what two readers could read in two ways is text."""
    (tmp_path / "a.yaml").write_text(f"a: {text}\n", "utf-8")
    found = read_yaml(tmp_path / "a.yaml", RigError).content["a"]
    assert (found, type(found)) == (VALUES[text], type(VALUES[text]))


def test_content_is_of_pythons_own_types(tmp_path: Path) -> None:
    """Lists and dictionaries, not ruamel.yaml's."""
    (tmp_path / "a.yaml").write_text("a: {b: [1, {c: 2}]}", "utf-8")
    content = read_yaml(tmp_path / "a.yaml", RigError).content
    assert {type(content), type(content["a"]), type(content["a"]["b"][1])} == {dict}
    assert type(content["a"]["b"]) is list


def test_names_of_entries_are_text(tmp_path: Path) -> None:
    """A joint may be called 08, 1e3 or on, and is not mistaken for another that is the same number."""
    (tmp_path / "a.yaml").write_text("{8: 1, 08: 2, 8.0: 3, 1e3: 4, on: 5, null: 6, <<: 7, 2024-01-01: 8}", "utf-8")
    content = read_yaml(tmp_path / "a.yaml", RigError).content
    assert list(content) == ["8", "08", "8.0", "1e3", "on", "null", "<<", "2024-01-01"]


UNREADABLE = ": not readable as YAML: "
BAD = {
    "alias": ("a: &x [1]\nb: *x", ":2: the alias '*x' is refused; write the entry out"),
    "endless alias": ("a: &x [*x]", ":1: the alias '*x' is refused"),
    "laughs": (
        "a: &a [x, x]\n" + "\n".join(f"{b}: &{b} [*{a}, *{a}, *{a}]" for a, b in zip("abcdefgh", "bcdefghi", strict=True)),
        ":2: the alias '*a' is refused",
    ),
    "twice": ("a: 1\nb: {c: 1,\n 'c': 2}", ":3: the entry 'c' stands twice"),
    "deep list": ("\n" + "[" * 100_000, ":2: nested more than 30 levels deep"),
    "deep entries": ("\n" + "{a: " * 100_000, ":2: nested more than 30 levels deep"),
    "deep block": ("\n".join(" " * depth + "a:" for depth in range(1000)), ":31: nested more than 30 levels deep"),
    "deep names": ("? " * 1000, ":1: nested more than 30 levels deep"),
    "long number": ("a: 1\nb: 0x" + "f" * 5000, ":2: a number of 5002 digits"),
    "syntax": ("a: 1\nb: c: d", f":2{UNREADABLE}"),
    "tag": ("a: !!python/name:os.system", ":1: the tag '!!python/name:os.system' is refused; write the value without it"),
    "odd tag": ("a: 1\nb: !!int ''", ":2: the tag '!!int' is refused"),
    "odd number": ("a: 0x_", UNREADABLE),
    "two documents": ("a: 1\n---\nb: 1", f":2{UNREADABLE}"),
    "control characters": ("a: 1\nb: \x01", f":2{UNREADABLE}"),
    "half a character": ('a: 1\nb: "\\ud83d"', ":2: half of a character"),
    "key": ("a: 1\n? [1]\n: 2", ":2: the name of an entry is a list or has entries of its own; expected text"),
    "tab": ("a:\n\tb: 1", f":2{UNREADABLE}"),
}


@pytest.mark.parametrize("case", BAD)
def test_yaml_that_is_no_plain_tree_is_refused(case: str, tmp_path: Path) -> None:
    """Aliases, tags, repeated entries, endless nesting and bad YAML are refused in one line that says where, in no time."""
    text, message = BAD[case]
    (tmp_path / "a.yaml").write_text(text, "utf-8")
    with pytest.raises(RigError) as error:
        read_yaml(tmp_path / "a.yaml", RigError)
    assert str(error.value).startswith(f"{tmp_path}/a.yaml{message}")
    assert len(str(error.value).splitlines()) == 1


def test_thirty_levels_are_read(tmp_path: Path) -> None:
    """The deepest that is not refused."""
    (tmp_path / "a.yaml").write_text("[" * 30 + "]" * 30, "utf-8")
    assert str(read_yaml(tmp_path / "a.yaml", RigError).content) == "[" * 30 + "]" * 30


def test_other_bytes_are_refused(tmp_path: Path) -> None:
    """Text that is not UTF-8 is refused with its line, a missing file by name."""
    (tmp_path / "a.yaml").write_bytes(b"a: 1\nb: \xfc")
    with pytest.raises(RigError, match=r"a\.yaml:2: is not UTF-8 text; save it as UTF-8"):
        read_yaml(tmp_path / "a.yaml", RigError)
    with pytest.raises(RigError, match=r"nope\.yaml: cannot be read: No such file"):
        read_yaml(tmp_path / "nope.yaml", RigError)
