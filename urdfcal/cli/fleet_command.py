"""`urdfcal fleet`: many robots, each calibrated by itself, on as many processes as there are."""

from __future__ import annotations

import math
import shlex
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from urdfcal.base.errors import FitRejected, UsageError
from urdfcal.cli.console import finish, say, warn, working_through
from urdfcal.cli.options import Json, Quiet

if TYPE_CHECKING:
    from urdfcal.fleet.manifest import FleetRow
    from urdfcal.fleet.outcome import Outcome
    from urdfcal.fleet.spread import Lost

MARK = "fleet.json"  # what tells a folder of ours
_TOLD = 8  # robots that are named one by one


def fleet(
    manifest: Annotated[
        str,
        typer.Argument(
            metavar="MANIFEST",
            help="CSV with columns description, measurements and, if need be, name and options (of fit); or a pattern of folders with a "
            "description and measurements each.",
            show_default=False,
        ),
    ],
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="DIR", help="A folder a robot, summary, prior.yaml and page.", show_default=False)
    ],
    options: Annotated[
        str, typer.Option("--fit", metavar="OPTIONS", help="Options of fit for all robots, in quotes: '--no-sag'.", show_default=False)
    ] = "",
    workers: Annotated[int | None, typer.Option(min=1, help="Processes. Default: one a core.", show_default=False)] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(metavar="ADDRESS", help="A dask scheduler that is there, tcp://host:8786; it must see the files.", show_default=False),
    ] = None,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Calibrate many robots: each in a folder of its own, what is done stays done, and all of them in one summary."""
    from urdfcal.base.terminal import many
    from urdfcal.estimation.evidence import LEAST_POSES
    from urdfcal.fleet.manifest import fleet_rows
    from urdfcal.fleet.told import counted, shared_words
    from urdfcal.fleet.unlike import standing_out
    from urdfcal.fleet.written import fleet_priors, written

    rows = fleet_rows(manifest, _words(options))
    into = _folder(output)
    with working_through(f"fitting {many(len(rows), 'robot')}", quiet):
        outcomes = _all(rows, into, workers, scheduler)
    priors = fleet_priors(outcomes)
    files = written(into, outcomes, priors, standing_out(outcomes))
    unsure = [own.name for own in outcomes if own.result and not own.noise_known]
    few = f"fewer than {LEAST_POSES} poses, and the noise of what was read is not stated: left out of the prior"
    warn([f"{', '.join(unsure[:_TOLD])}{' ...' if len(unsure) > _TOLD else ''}: {few}"] if unsure else [], quiet)
    warn(shared_words(priors), quiet)
    bad = [own for own in outcomes if own.use in ("no", "failed")]
    warn([f"{own.name}: {own.said}" for own in bad[:_TOLD]], quiet)
    warn([f"and {len(bad) - _TOLD} more: see summary.csv"] if len(bad) > _TOLD else [], quiet)
    finish(_machine(outcomes, files) if as_json else None, _told(outcomes, files), quiet)
    if bad:
        say(True, f"urdfcal: of {many(len(rows), 'robot')} {counted(bad)}: see {into / 'summary.csv'}")
        raise typer.Exit(FitRejected.exit_code)


def _words(options: str) -> list[str]:
    try:
        return shlex.split(options)
    except ValueError as error:
        raise UsageError(f"--fit {options}: {error}") from None


def _folder(output: Path) -> Path:
    """The folder of the results, marked as one.

    Raises:
        UsageError: it cannot be written, or holds something else.
    """
    from urdfcal.base.files import write_whole

    try:
        output.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(f"-o {output}: cannot be made: {error.strerror}") from None
    if not (output / MARK).is_file():
        if any(output.iterdir()):
            raise UsageError(f"-o {output}: is there already and is no folder of urdfcal fleet; name another")
        write_whole(output / MARK, b'{"urdfcal": "fleet"}\n')
    return output.resolve()


def _all(rows: Sequence[FleetRow], into: Path, workers: int | None, scheduler: str | None) -> list[Outcome]:
    """Every robot, in the order of the manifest."""
    from urdfcal.base.progress import counted
    from urdfcal.cli.fleet_worker import LOADED, fit_row
    from urdfcal.fleet.spread import Lost, spread

    found: dict[int, Outcome] = {}
    with counted("robot", len(rows)) as advance:
        for place, own in spread(partial(fit_row, into=into), rows, workers, scheduler, loading=LOADED):
            found[place] = _lost(rows[place].name, own) if isinstance(own, Lost) else own
            advance()
    return [found[place] for place in range(len(rows))]


def _lost(name: str, lost: Lost) -> Outcome:
    from urdfcal.fleet.outcome import Outcome

    return Outcome(name, 70, f"the process that fitted it ended: {lost.why}; run the command again, or with --workers 1")


def _told(outcomes: Sequence[Outcome], files: Sequence[Path]) -> str:
    from urdfcal.fleet.told import opening

    kept = sum(own.kept for own in outcomes)
    lines = [*opening(outcomes), *([f"{kept} from an earlier run"] if kept else [])]
    return "\n".join([*lines, "wrote " + ", ".join(str(file) for file in files)])


def _machine(outcomes: Sequence[Outcome], files: Sequence[Path]) -> dict[str, Any]:
    from urdfcal.fleet.outcome import summary_rows

    def plain(value: Any) -> Any:
        return None if isinstance(value, float) and math.isnan(value) else value

    rows = [{key: plain(value) for key, value in row.items()} for row in summary_rows(outcomes)]
    return {"robots": rows, "kept": sum(own.kept for own in outcomes), "files": [str(file) for file in files]}
