"""The command line: its commands put together, its errors turned into one line and an exit code."""

from __future__ import annotations

import os
import sys
from copy import copy
from functools import cache
from typing import Annotated, Any, NoReturn

import typer

from urdfcal.base import opened
from urdfcal.base.errors import UrdfcalError
from urdfcal.base.foreign_text import shown
from urdfcal.base.garbage import look_seldom
from urdfcal.cli.apply_command import apply
from urdfcal.cli.boards_command import boards
from urdfcal.cli.camera_command import camera
from urdfcal.cli.compare_command import compare
from urdfcal.cli.console import asked_quiet
from urdfcal.cli.correct_command import correct
from urdfcal.cli.described import CODES, described
from urdfcal.cli.fit_command import fit
from urdfcal.cli.fleet_command import fleet
from urdfcal.cli.help import OurCommand, OurGroup
from urdfcal.cli.import_command import import_
from urdfcal.cli.look_commands import check, dh, evaluate
from urdfcal.cli.markers_command import markers
from urdfcal.cli.measurements_command import measurements
from urdfcal.cli.module_command import module
from urdfcal.cli.paper_command import paper
from urdfcal.cli.poses_command import poses
from urdfcal.cli.render_command import render
from urdfcal.cli.rig_command import rig
from urdfcal.cli.run import run, told
from urdfcal.cli.simulate_commands import SimulateCommand, simulate
from urdfcal.cli.spots_command import spots
from urdfcal.cli.streams import our_streams, settle
from urdfcal.cli.view_command import view

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

_LOOKING: tuple[Any, ...] = (fit, measurements, evaluate, check, dh, rig, poses, simulate, fleet)
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
def _commands(wanted: str) -> Any:
    """What typer makes of the command that is wanted, else of all, once a process: it evaluates the annotations of every option."""
    own = [command for command in app.registered_commands if command.name == wanted]
    alone = copy(app)
    alone.registered_commands = own or app.registered_commands
    return typer.main.get_command(alone)


def main() -> NoReturn:
    """Run the command line; every error of the user's is one line on stderr and exit code 2."""
    look_seldom()
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # our matrices are small: on a busy machine threads cost far more than they bring
    try:
        sys.argv[0] = "urdfcal"  # as it is called in what is recorded, also where it ran as a module
        with our_streams() as heard:
            opened.begin()
            code = run(_commands(sys.argv[1] if len(sys.argv) > 1 else ""))
            settle()
    except UrdfcalError as error:  # of the streams themselves
        sys.exit(told(str(error), error.exit_code))
    if {"-v", "--verbose"} & set(sys.argv) or not (code or asked_quiet()):
        for line in heard:
            told(f"warning: a library says: {shown(line)}", 0)
    sys.exit(code)
