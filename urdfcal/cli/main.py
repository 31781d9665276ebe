"""The command line: its commands put together, its errors turned into one line and an exit code."""

from __future__ import annotations

import contextlib
import os
import sys
import traceback
from functools import cache
from pathlib import Path
from typing import Annotated, Any, NoReturn

import typer

from urdfcal.base import opened
from urdfcal.base.errors import FitRejected, UrdfcalError
from urdfcal.base.foreign_text import shown
from urdfcal.cli.apply_command import apply
from urdfcal.cli.boards_command import boards
from urdfcal.cli.camera_command import camera, markers
from urdfcal.cli.compare_command import compare
from urdfcal.cli.console import asked_quiet, fitting
from urdfcal.cli.correct_command import correct
from urdfcal.cli.described import CODES, described
from urdfcal.cli.fit_command import fit
from urdfcal.cli.help import OurCommand, OurGroup
from urdfcal.cli.import_command import import_
from urdfcal.cli.look_commands import check, dh, evaluate
from urdfcal.cli.measurements_command import measurements
from urdfcal.cli.module_command import module
from urdfcal.cli.paper_command import paper
from urdfcal.cli.render_command import render
from urdfcal.cli.rig_command import rig
from urdfcal.cli.simulate_commands import SimulateCommand, simulate
from urdfcal.cli.spots_command import spots
from urdfcal.cli.streams import about_stdout, drop_stdout, our_streams, require_written, settle, unprinted
from urdfcal.cli.usage import usage_words
from urdfcal.cli.view_command import view

_INTERRUPTED = 130  # what typer makes of Ctrl-C

app = typer.Typer(
    name="urdfcal",
    help="Find the real geometry of a robot arm from measurements and write it back into its URDF.",
    cls=OurGroup,
    epilog=CODES,
    invoke_without_command=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)

_LOOKING: tuple[Any, ...] = (fit, measurements, evaluate, check, dh, rig, simulate)
_RESULTS: tuple[Any, ...] = (apply, correct, import_, compare, paper, view)
for _command in (*_LOOKING, *_RESULTS, camera, boards, markers, spots, render, module):
    _name = _command.__name__.removesuffix("_")  # `import` is a word of Python's own
    app.command(_name, cls=SimulateCommand if _command is simulate else OurCommand, **described(_name))(_command)


@app.callback()
def _top(
    context: typer.Context,
    version: Annotated[bool, typer.Option("--version", help="Print the version and exit.")] = False,
) -> None:
    if version:
        _print_version()
        raise typer.Exit
    if context.invoked_subcommand is None:
        print(context.get_help())


@app.command("version", cls=OurCommand, **described("version"))
def _print_version() -> None:
    """Print the version."""
    from urdfcal.base.version import __version__

    print(__version__)


@cache
def _commands() -> Any:
    """What typer makes of all commands, once a process: it evaluates the annotations of every option."""
    return typer.main.get_command(app)


def main() -> NoReturn:
    """Run the command line; every error of the user's is one line on stderr and exit code 2."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # our matrices are small: on a busy machine threads cost far more than they bring
    try:
        sys.argv[0] = "urdfcal"  # as it is called in what is recorded, also where it ran as a module
        with our_streams() as heard:
            opened.begin()
            code = _run()
            settle()
    except UrdfcalError as error:  # of the streams themselves
        sys.exit(_told(str(error), error.exit_code))
    if {"-v", "--verbose"} & set(sys.argv) or not (code or asked_quiet()):
        for line in heard:
            _told(f"warning: a library says: {shown(line)}", 0)
    sys.exit(code)


def _run() -> int:
    """The command, its errors told; its exit code."""
    try:
        code = _commands()(standalone_mode=False, prog_name="urdfcal")
        require_written()
        return _told("interrupted", code) if code == _INTERRUPTED else code if isinstance(code, int) else 0
    except FitRejected as error:
        way_out = " (--force writes it anyway)" if error.forceable else ""
        return _told(f"rejected: {error}; nothing written{way_out}", error.exit_code)
    except UrdfcalError as error:
        return _told(str(error), error.exit_code)
    except (typer.Abort, KeyboardInterrupt):
        return _told("interrupted", _INTERRUPTED)
    except BrokenPipeError:  # whoever read it has seen enough
        drop_stdout()
        return 0
    except Exception as error:
        if hasattr(error, "format_message"):  # typer's own usage errors
            return _told(usage_words(error), 2)
        if isinstance(error, OSError) and about_stdout(error):
            return _told(str(unprinted(error)), 2)
        return _told(_ours(error), 70)


def _ours(error: Exception) -> str:
    """An error of ours in a line: what and where it is, and how to report it; with --verbose the traceback goes before it."""
    if {"-v", "--verbose"} & set(sys.argv):
        traceback.print_exception(error)
    frame = traceback.extract_tb(error.__traceback__)[-1]
    what = " ".join(f"{type(error).__name__}: {error}".split())
    return (
        f"an error of ours, nothing was written: {what} ({Path(frame.filename).name}:{frame.lineno}); please report it with this line, "
        "the command and its files; --verbose shows where it came from"
    )


def _told(message: str, code: int) -> int:
    """Say what went wrong, where anybody listens; the exit code."""
    with contextlib.suppress(OSError):  # stderr is full or closed: the exit code has to do
        print(fitting(f"urdfcal: {message}", sys.stderr), file=sys.stderr)
    return code
