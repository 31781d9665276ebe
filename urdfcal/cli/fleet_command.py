"""`urdfcal fleet`: many robots, each calibrated by itself, on as many processes as there are."""

from __future__ import annotations

import logging
import math
import os
import shlex
from collections.abc import Iterator, Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from urdfcal.base.errors import FitRejected, UsageError
from urdfcal.cli.console import finish, say, warn, working_through
from urdfcal.cli.options import Json, Quiet

if TYPE_CHECKING:
    from urdfcal.fleet.manifest import FleetRow
    from urdfcal.fleet.outcome import Outcome

MARK = "fleet.json"  # what tells a folder of ours
_BATCHES = 8  # a worker
_MOST_ROWS = 16  # of a batch: what is in flight is lost where a worker dies
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
    from urdfcal.fleet.prior import fleet_prior
    from urdfcal.fleet.told import counted
    from urdfcal.fleet.unlike import standing_out
    from urdfcal.fleet.written import written

    rows = fleet_rows(manifest, _words(options))
    into = _folder(output)
    with working_through(f"fitting {many(len(rows), 'robot')}", quiet):
        outcomes = _all(rows, into, workers, scheduler)
    likelihoods = {own.name: told for own in outcomes if (told := own.likelihood) is not None}
    prior = fleet_prior(likelihoods)
    unlike = standing_out(outcomes)
    files = written(into, outcomes, prior, unlike)
    unsure = [own.name for own in outcomes if own.joints and not own.noise_known]
    few = f"fewer than {LEAST_POSES} poses, and the noise of what was read is not stated: left out of the prior"
    warn([f"{', '.join(unsure[:_TOLD])}{' ...' if len(unsure) > _TOLD else ''}: {few}"] if unsure else [], quiet)
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
    from urdfcal.cli.fleet_worker import fit_rows

    found: dict[str, Outcome] = {}
    with counted("robot", len(rows)) as advance:
        count = workers or os.cpu_count() or 1
        done = map(lambda batch: fit_rows(batch, into), _batches(rows, 1)) if scheduler is None and count == 1 else None
        for outcomes in done or _spread(_batches(rows, count), into, count, scheduler):
            for own in outcomes:
                found[own.name] = own
                advance()
    return [found[row.name] for row in rows]


def _batches(rows: Sequence[FleetRow], workers: int) -> list[Sequence[FleetRow]]:
    size = max(1, min(_MOST_ROWS, len(rows) // (workers * _BATCHES)))
    return [rows[start : start + size] for start in range(0, len(rows), size)]


def _spread(batches: Sequence[Sequence[FleetRow]], into: Path, workers: int, scheduler: str | None) -> Iterator[list[Outcome]]:
    """What workers made of batches, as it comes.

    Raises:
        UsageError: dask is not installed, or the scheduler does not answer.
    """
    from importlib import import_module

    from urdfcal.cli.fleet_worker import fit_rows

    try:
        dask, distributed = import_module("dask"), import_module("distributed")
    except ImportError:
        raise UsageError("several processes want dask: pip install 'urdfcal[fleet]', or use --workers 1") from None
    one_thread = {name: "1" for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")}
    with dask.config.set({"distributed.nanny.pre-spawn-environ": one_thread, "distributed.scheduler.allowed-failures": 1}):
        try:
            own = {"n_workers": workers, "threads_per_worker": 1, "dashboard_address": None, "silence_logs": logging.CRITICAL}
            cluster = distributed.LocalCluster(**own) if scheduler is None else None
            client = distributed.Client(cluster or scheduler, timeout="10s")
        except (OSError, ValueError, TimeoutError, RuntimeError) as error:
            raise _no_workers(workers, scheduler, error) from None
        with client, cluster or nullcontext():
            tasks = {client.submit(fit_rows, batch, into, pure=False): batch for batch in batches}
            for task in distributed.as_completed(list(tasks)):
                yield task.result() if task.status == "finished" else [_lost(row.name, task) for row in tasks[task]]


def _no_workers(workers: int, scheduler: str | None, error: Exception) -> UsageError:
    said = " ".join(str(error).split()) or type(error).__name__
    if scheduler is not None:
        return UsageError(f"--scheduler {scheduler}: does not answer: {said}")
    return UsageError(f"{workers} processes cannot be started here: {said}; --workers 1 does without")


def _lost(name: str, task: Any) -> Outcome:
    from urdfcal.fleet.outcome import Outcome

    error = " ".join(f"{task.exception()}".split())
    return Outcome(name, 70, f"the process that fitted it ended: {error[:200]}; run the command again, or with --workers 1")


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
