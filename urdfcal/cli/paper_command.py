"""`urdfcal paper`: the paper's simulation, and its experiment as a simulation, beside what is published."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from urdfcal.cli.console import ProgressBar, say, show
from urdfcal.cli.inputs import load, papers_arm
from urdfcal.cli.notes import about, listed
from urdfcal.cli.options import (
    OUTPUT,
    Json,
    Lasers,
    Overwrite,
    PackageDirs,
    Quiet,
    Screen,
    Seed,
    Verbose,
    XacroArgs,
    XacroLimits,
)
from urdfcal.cli.places import deliver, named, require_ending, require_places, stated_file, told

if TYPE_CHECKING:
    from urdfcal.robot.robot import Robot
    from urdfcal.simulation.paper import Repeated
    from urdfcal.simulation.study import Study

_MOST_RUNS = 10_000  # more take days


class Section(StrEnum):
    """Which section of the paper is repeated."""

    SIMULATION = "4"
    EXPERIMENT = "5"


_ARMS = {4: "arm7", 5: "arm4"}


def paper(
    robot: Annotated[
        Path | None,
        typer.Argument(
            metavar="ROBOT", help="The arm of Table I, or of Table IV. Default: those that come with urdfcal.", show_default=False
        ),
    ] = None,
    section: Annotated[
        Section | None,
        typer.Option(
            help="4, the simulation, or 5, the experiment, as a simulation. Default: 4; for files without ROBOT both.", show_default=False
        ),
    ] = None,
    runs: Annotated[int, typer.Option(min=1, max=_MOST_RUNS, help="Draws of poses and noise that are averaged.")] = 5,
    seed: Seed = 0,
    report: Annotated[
        Path | None,
        typer.Option(
            metavar="HTML",
            parser=stated_file,
            help="Also write Tables I to VII and Fig. 4, published beside repeated, as a page.",
            show_default=False,
            rich_help_panel=OUTPUT,
        ),
    ] = None,
    latex: Annotated[
        Path | None,
        typer.Option(
            metavar="TEX",
            parser=stated_file,
            help="Also write the tables for LaTeX (booktabs).",
            show_default=False,
            rich_help_panel=OUTPUT,
        ),
    ] = None,
    overwrite: Overwrite = False,
    screen: Screen = None,
    laser: Lasers = None,
    xacro_arg: XacroArgs = None,
    xacro_limit: XacroLimits = None,
    package_dir: PackageDirs = None,
    as_json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Repeat the paper's simulation, and its experiment as a simulation, beside the published tables."""
    from urdfcal.output.text.paper import paper_json, study_blocks
    from urdfcal.simulation import study as studies

    both = section is None and robot is None and (report or latex)
    arms = {number: robot or papers_arm(_ARMS[number]) for number in ([4, 5] if both else [int(section or 4)])}
    report, latex, made_of = _places(report, latex, arms, overwrite)
    wanted = []
    for number, file in arms.items():
        arm = load(file, xacro_arg, package_dir, screen, laser, xacro_limit=xacro_limit, quiet=quiet)
        say(verbose, about(arm))
        wanted.append((studies.STUDIES[number], arm))
    found = _repeated(wanted, runs, seed, quiet or as_json)
    contents = _files(found, report, latex, made_of)
    deliver(contents)
    blocks = [block for number, repeated in enumerate(found) for block in ([""] if number else []) + study_blocks(repeated)]
    written = ["", f"wrote {listed(told(contents))}"] if contents and not quiet else []
    show(paper_json(found) | {"files": [str(place) for place in contents]} if as_json else None, [*blocks, *written])


def _places(report: Path | None, latex: Path | None, arms: Mapping[int, Path], overwrite: bool) -> tuple[Path | None, Path | None, str]:
    """Where the files go, refused before anything is worked out, and a hash of what they are made of.

    Raises:
        UsageError: a place cannot be written to, has another ending, or holds what is not ours.
    """
    from urdfcal.output.paper.latex import LATEX_MARK
    from urdfcal.output.paper.page import PAGE_MARK
    from urdfcal.output.replaced import inputs_sha256, require_marked

    report, latex = report and named(report, "paper.html"), latex and named(latex, "paper.tex")
    require_places(*filter(None, (report, latex)), inputs=arms.values())
    made_of = inputs_sha256(arms.values())
    for option, place, endings, what, mark in (
        ("--report", report, (".html", ".htm"), "a page", PAGE_MARK),
        ("--latex", latex, (".tex",), "a file for LaTeX", LATEX_MARK),
    ):
        if place is not None:
            require_ending(option, place, endings, what)
            if not overwrite:
                require_marked(place, (mark, made_of), "result of urdfcal paper for the same arms")
    return report, latex, made_of


def _repeated(wanted: Sequence[tuple[Study, Robot]], runs: int, seed: int, quiet: bool) -> list[Repeated]:
    """All studies under one bar, which advances fit by fit."""
    from urdfcal.simulation.paper import repeat

    with ProgressBar("simulating", runs * sum(study.fits for study, _ in wanted), quiet) as advance:
        return [repeat(arm, study, runs, seed, advance) for study, arm in wanted]


def _files(found: Sequence[Repeated], report: Path | None, latex: Path | None, made_of: str) -> dict[str | Path, bytes]:
    from urdfcal.output.paper.latex import paper_latex
    from urdfcal.output.paper.page import paper_page

    contents: dict[str | Path, bytes] = {}
    for place, made in ((report, paper_page), (latex, paper_latex)):
        if place is not None:
            contents[place] = made(found, made_of).encode("utf-8", "backslashreplace")
    return contents
