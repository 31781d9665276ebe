"""What the residuals say that the model lacks, as a table: what, where, how surely, what became of it, and what would confirm it."""

from __future__ import annotations

from typing import TYPE_CHECKING

from urdfcal.base.terminal import figures_table, titled
from urdfcal.calibration.asking.stands_out import StandsOut
from urdfcal.calibration.result import FitResult

if TYPE_CHECKING:
    from rich.console import RenderableType

COLUMNS = ("what", "where", "it is", "would be confirmed by", "gain in nats")

TITLE = "What the residuals of this fit ask for beside geometry; the gain is theirs alone, in log evidence"


def stands_out_rows(calibration: FitResult) -> list[tuple[str, ...]]:
    """A row for each, strongest first."""
    return [(own.words, own.where, _became(own), own.confirmed_by, f"{own.gain:.0f}") for own in calibration.stands_out]


def _became(own: StandsOut) -> str:
    """Where it went; geometry alone, which is what the URDF carries, is off by what a compensation would make up for."""
    if own.in_fit:
        return "in the fit"
    return "in the sigmas and, with the pair, the compensation" if own.entered else "in the sigmas"


def stands_out_blocks(calibration: FitResult) -> list[RenderableType]:
    """For people; nothing where nothing stands out."""
    if not calibration.stands_out:
        return []
    table = figures_table(*COLUMNS[:-1])
    table.add_column(COLUMNS[-1].replace(" in ", "\n"), justify="right")
    for row in stands_out_rows(calibration):
        table.add_row(*row)
    return ["", titled(TITLE, table)]
