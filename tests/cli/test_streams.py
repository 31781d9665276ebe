"""Streams: full, closed, broken or listened to by a terminal, a command says one line at most, and steers nothing."""

from __future__ import annotations

import io
import os
import subprocess
import sys
import warnings
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.conftest import CliResult
from tests.support.paths import ROBOTS_DIR
from tests.support.small_robot import CSV, URDF
from urdfcal.base.errors import RobotError
from urdfcal.base.foreign_text import shown
from urdfcal.base.terminal import as_text, figures_table, titled
from urdfcal.cli.streams import Shown

Run = Callable[..., CliResult]
DH = f"'{sys.executable}' -m urdfcal.cli dh '{ROBOTS_DIR / 'arm7' / 'arm7.urdf.xacro'}'"
HOSTILE = "a\x1b[31mb\x07c\x9bd\u202ee\x7f"
WRITTEN = "a\\x1b[31mb\\x07c\\x9bd\\u202ee\\x7f"


def in_shell(words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(["bash", "-c", f"set -o pipefail; {words}"], capture_output=True, text=True, check=False)


@pytest.mark.parametrize(
    ("redirection", "code", "words"),
    [
        ("> /dev/full", 2, "standard output cannot be written to: No space left on device"),
        ("--json > /dev/full", 2, "standard output cannot be written to: No space left on device"),
        (">&-", 2, "standard output is closed"),
        ("| head -1", 0, ""),
        ("| true", 0, ""),
        ("--json | true", 0, ""),
        ("-x 2> /dev/full", 2, ""),
        ("-x 2>&-", 2, ""),
        ("<&-", 0, ""),
    ],
)
def test_streams_that_take_nothing_are_no_traceback(redirection: str, code: int, words: str) -> None:
    """A full or closed stdout is one line and exit code 2, a reader that goes away is quiet, and a full stderr changes no exit code."""
    done = in_shell(f"{DH} {redirection}")
    assert done.returncode == code, done.stderr
    assert (words in done.stderr, done.stderr.count("\n")) == (True, 1 if words else 0)


def test_ctrl_c_is_130(run_cli: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    """An interruption is one word."""
    from urdfcal.robot import robot

    def interrupted(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(robot, "load_robot", interrupted)
    assert run_cli("dh", "x.urdf") == CliResult(130, "", "urdfcal: interrupted\n")


def test_foreign_text_is_shown_and_not_sent(run_cli: Run, tmp_path: Path) -> None:
    """Control characters in names of links, columns, labels and files come out as what they are, in messages, warnings and tables."""
    link = HOSTILE.replace("\x1b", "").replace("\x07", "")  # what XML can hold
    (tmp_path / "r.urdf").write_text(URDF.replace("laser_2", link), "utf-8")
    (tmp_path / "m.csv").write_text(CSV.replace("turn", f"{HOSTILE},turn").replace("\n0", "\n1,0").replace("laser_2", link), "utf-8")
    runs = [
        run_cli("evaluate", "r.urdf", "m.csv", "--laser", "laser_1", "--laser", link, "-v"),
        run_cli("dh", "r.urdf", "--tip", HOSTILE),
        run_cli("dh", HOSTILE),
        run_cli(HOSTILE),
    ]
    said = [run.out + run.err for run in runs]
    for text in said:
        assert not {*"\x1b\x07\x9b\x7f\u202e\r"} & set(text)
    assert "\\x9b" in runs[0].out + runs[0].err
    assert all(WRITTEN in text for text in said[1:3])


def test_tables_show_what_rich_would_take_for_marks() -> None:
    """Names in brackets stand in tables as they are, control characters are written out, and line ends stay."""
    table = figures_table("[bold]name")
    table.add_row("[/red] [link=x]y :smile:")
    table.add_row(HOSTILE)
    text = as_text([titled(HOSTILE, table), f"one\n{HOSTILE}"])
    assert all(word in text for word in ("[bold]name", "[/red] [link=x]y :smile:", f"one\n{WRITTEN}"))
    assert text.count(WRITTEN) == 3
    assert shown("a\tb\nµ°±→") == "a\tb\nµ°±→"


@pytest.mark.parametrize(("encoding", "written"), [("utf-8", "\u22121 ±"), ("latin-1", "-1 ±"), ("ascii", "-1 ?")])
def test_a_minus_keeps_its_meaning_in_every_encoding(encoding: str, written: str) -> None:
    """Where a stream has no true minus a hyphen stands for it, and no question mark."""
    sink = io.BytesIO()
    stream = Shown(io.TextIOWrapper(sink, encoding, errors="replace"))
    stream.write("\u22121 ±")
    stream.flush()
    assert sink.getvalue().decode(encoding) == written


@pytest.mark.parametrize("quiet", [True, False])
def test_libraries_speak_through_us(quiet: bool, run_cli: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    """What native code writes to stderr, and NumPy warns of, is a warning of ours after a command that went well, each once."""
    from urdfcal.model import dh

    table = dh.table_with_slides

    def loud(*given: object) -> object:
        os.write(2, b"libpng warning: \x1b[31miCCP\n" * 3)
        with warnings.catch_warnings():
            warnings.simplefilter("always")
            warnings.warn("overflow encountered in matmul", RuntimeWarning, stacklevel=1)
        return table(*given)  # type: ignore[arg-type]

    monkeypatch.setattr(dh, "table_with_slides", loud)
    run = run_cli("dh", ROBOTS_DIR / "arm7" / "arm7.urdf.xacro", *(["-q"] if quiet else []))
    expected = [
        "urdfcal: warning: a library says: RuntimeWarning: overflow encountered in matmul",
        "urdfcal: warning: a library says: libpng warning: \\x1b[31miCCP",
    ]
    assert (run.code, run.err.splitlines()) == (0, [] if quiet else expected)


def test_libraries_keep_still_about_what_is_refused(run_cli: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    """A refusal is one line, whatever a library wrote on the way."""
    from urdfcal.robot import robot

    def loud(*_: object, **__: object) -> None:
        os.write(2, b"urdfdom: line 1\n")
        raise RobotError("is no robot")

    monkeypatch.setattr(robot, "load_robot", loud)
    assert run_cli("dh", "x.urdf") == CliResult(2, "", "urdfcal: is no robot\n")
