"""A command, run: its errors turned into one line and an exit code."""

from __future__ import annotations

import contextlib
import io
import sys
import traceback
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import typer

from urdfcal.base import opened
from urdfcal.base.errors import FitRejected, UrdfcalError
from urdfcal.cli.console import fitting
from urdfcal.cli.streams import about_stdout, drop_stdout, require_written, unprinted
from urdfcal.cli.usage import usage_words

_INTERRUPTED = 130  # what typer makes of Ctrl-C


class Heard(NamedTuple):
    """What a command did: its exit code, and what it said on stdout and stderr."""

    code: int
    out: str
    err: str


def run(command: Any, words: list[str] | None = None) -> int:
    """A command of typer's with these words, or those of the command line, its errors told; its exit code."""
    try:
        code = command(args=words, standalone_mode=False, prog_name="urdfcal")
        require_written()
        return told("interrupted", code) if code == _INTERRUPTED else code if isinstance(code, int) else 0
    except FitRejected as error:
        way_out = " (--force writes it anyway)" if error.forceable else ""
        return told(f"rejected: {error}; nothing written{way_out}", error.exit_code)
    except UrdfcalError as error:
        return told(str(error), error.exit_code)
    except (typer.Abort, KeyboardInterrupt):
        return told("interrupted", _INTERRUPTED)
    except BrokenPipeError:  # whoever read it has seen enough
        drop_stdout()
        return 0
    except Exception as error:
        if hasattr(error, "format_message"):  # typer's own usage errors
            return told(usage_words(error), 2)
        if isinstance(error, OSError) and about_stdout(error):
            return told(str(unprinted(error)), 2)
        return told(error_of_ours(error), 70)


def called(command: Callable[..., None], words: Sequence[str]) -> Heard:
    """A command called from within: one at a time, since what it prints is caught from the whole process."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        opened.begin()
        code = run(_commanded(command), list(words))
    return Heard(code, out.getvalue(), err.getvalue())


@cache
def _commanded(command: Callable[..., None]) -> Any:
    """A function as typer's command, made once: that takes longer than reading a robot."""
    app = typer.Typer(add_completion=False)
    app.command()(command)
    return typer.main.get_command(app)


def error_of_ours(error: Exception) -> str:
    """An error of ours in a line: what and where it is, and how to report it; with --verbose the traceback goes before it."""
    if {"-v", "--verbose"} & set(sys.argv):
        traceback.print_exception(error)
    frame = traceback.extract_tb(error.__traceback__)[-1]
    what = " ".join(f"{type(error).__name__}: {error}".split())
    return (
        f"an error of ours, nothing was written: {what} ({Path(frame.filename).name}:{frame.lineno}); please report it with this line, "
        "the command and its files; --verbose shows where it came from"
    )


def told(message: str, code: int) -> int:
    """Say what went wrong, where anybody listens; the exit code."""
    with contextlib.suppress(OSError):  # stderr is full or closed: the exit code has to do
        print(fitting(f"urdfcal: {message}", sys.stderr), file=sys.stderr)
    return code
