"""Files appear whole or not at all; YAML is read with its lines."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from urdfcal.base.errors import RigError, UsageError
from urdfcal.base.files import read_yaml, require_writable, write_together, write_whole


def test_a_file_is_replaced_whole(tmp_path: Path) -> None:
    """Writing replaces a file, with the permissions that a new file has, and leaves nothing beside it."""
    for content in (b"old", b"new\r\n\x00"):
        write_whole(tmp_path / "a", content)
    (tmp_path / "b").touch()
    assert (tmp_path / "a").read_bytes() == b"new\r\n\x00"
    assert (tmp_path / "a").stat().st_mode == (tmp_path / "b").stat().st_mode
    assert sorted(os.listdir(tmp_path)) == ["a", "b"]


def test_of_several_files_none_is_written_if_one_cannot_be(tmp_path: Path) -> None:
    """When the second file has no place, the first stays as it was and nothing is left behind."""
    (tmp_path / "a").write_bytes(b"old")
    (tmp_path / "folder").mkdir()
    for wrong in (tmp_path / "nope" / "b", tmp_path / "folder"):
        with pytest.raises(UsageError, match=f"{wrong}: cannot be written"):
            write_together({tmp_path / "a": b"new", wrong: b"new"})
    assert (tmp_path / "a").read_bytes() == b"old"
    assert sorted(os.listdir(tmp_path)) == ["a", "folder"]


def test_places_are_looked_at_before_any_work(tmp_path: Path) -> None:
    """A folder, or a file in a folder that is not there, is refused; a file that exists is not."""
    write_whole(tmp_path / "a", b"")
    require_writable(tmp_path / "a")
    for wrong, message in ((tmp_path, "is a folder, expected a file name"), (tmp_path / "nope" / "a", "the folder .*nope does not exist")):
        with pytest.raises(UsageError, match=message):
            require_writable(wrong)


def test_entries_know_their_lines(tmp_path: Path) -> None:
    """The line of an entry is found by its steps; where a step is missing, that of the last one that is there."""
    (tmp_path / "a.yaml").write_bytes(b"\xef\xbb\xbf# c\r\na: 1\r\nb:\r\n  c: [1,\r\n    2]\r\n  3: x\r\n")
    file = read_yaml(tmp_path / "a.yaml", RigError)
    assert file.content == {"a": 1, "b": {"c": [1, 2], 3: "x"}}
    assert [file.line(steps) for steps in ((), ["a"], ["b", "c", 1], ["b", 3], ["b", "d"], ["a", "e"])] == [2, 2, 5, 6, 4, 2]


BAD = {
    "alias": ("a: &x [1]\nb: *x", ":2: the alias '*x' is refused; write the entry out"),
    "endless alias": ("a: &x [*x]", ":1: the alias '*x' is refused"),
    "laughs": (
        "a: &a [x, x]\n" + "\n".join(f"{b}: &{b} [*{a}, *{a}, *{a}]" for a, b in zip("abcdefgh", "bcdefghi", strict=True)),
        ":2: the alias '*a' is refused",
    ),
    "twice": ("a: 1\nb: {c: 1,\n c: 2}", ":3: the entry 'c' stands twice"),
    "deep": ("\n" + "[" * 100_000, ":2: nested more than 30 levels deep"),
    "long number": ("a: 1\nb: 0x" + "f" * 5000, ":2: a number of 5002 digits"),
    "syntax": ("a: 1\nb: c: d", ":2: not readable as YAML: mapping values are not allowed in this context"),
    "tag": ("a: !!python/name:os.system", ":1: not readable as YAML: could not determine a constructor for the tag"),
    "date": ("a: 2024-13-45", ": not readable as YAML: ValueError month must be in 1..12"),
    "odd tag": ("a: !!int ''", ": not readable as YAML: IndexError"),
    "two documents": ("a: 1\n---\nb: 1", ":2: not readable as YAML"),
    "control characters": ("a: \x01", ": not readable as YAML: unacceptable character"),
    "key": ("? [1]\n: 2", ":1: not readable as YAML: found unhashable key"),
}


@pytest.mark.parametrize("case", BAD)
def test_yaml_that_is_no_plain_tree_is_refused(case: str, tmp_path: Path) -> None:
    """Aliases, repeated entries, endless nesting and bad YAML are refused with their line, in no time."""
    text, message = BAD[case]
    (tmp_path / "a.yaml").write_text(text, "utf-8")
    with pytest.raises(RigError) as error:
        read_yaml(tmp_path / "a.yaml", RigError)
    assert str(error.value).startswith(f"{tmp_path}/a.yaml{message}")


def test_other_bytes_are_refused(tmp_path: Path) -> None:
    """Text that is not UTF-8 is refused with its line, a missing file by name."""
    (tmp_path / "a.yaml").write_bytes(b"a: 1\nb: \xfc")
    with pytest.raises(RigError, match=r"a\.yaml:2: is not UTF-8 text; save it as UTF-8"):
        read_yaml(tmp_path / "a.yaml", RigError)
    with pytest.raises(RigError, match=r"nope\.yaml: cannot be read: No such file"):
        read_yaml(tmp_path / "nope.yaml", RigError)
