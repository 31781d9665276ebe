"""What stands first: may the calibration be used, why not, and how far off it is predicted to be."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from urdfcal.base.geometry import MM
from urdfcal.base.terminal import figures_table, rounded, titled
from urdfcal.calibration.analysis.tool_accuracy import Gain, ToolAccuracy
from urdfcal.calibration.analysis.verdict import Verdict

if TYPE_CHECKING:
    from rich.console import RenderableType

FIGURES = ("median", "95 %", "worst")
PREDICTED = "Predicted error over the workspace, in mm"


def verdict_words(verdict: Verdict) -> str:
    """`Verdict: can be used`, first in the terminal and in every report."""
    return f"Verdict: {verdict.summary}"


def verdict_blocks(verdict: Verdict, headline: str = "") -> list[RenderableType]:
    """For a terminal: the verdict with its reasons, how far off readings were and are, the predicted accuracy, and what would help."""
    blocks: list[RenderableType] = [f"{verdict_words(verdict)}{':' if verdict.reasons else ''}"]
    blocks += [*(f"  {reason}" for reason in verdict.reasons), *([headline] if headline else [])]
    if verdict.advice:
        blocks += ["What would help:", *(f"  {advice}" for advice in verdict.advice)]
    if verdict.tool is not None:
        blocks += ["", _table(verdict), "", constant_words(verdict.tool)]
    return blocks


def accuracy_rows(verdict: Verdict) -> list[tuple[str, ...]]:
    """What is predicted: its name, and median, 95 % and worst over the workspace, before and after, in mm."""
    tool = verdict.tool
    if tool is None:
        return []
    cases: list[tuple[str, Gain | None]] = [
        (f"{tool.link} in the frame of {tool.base}", tool.in_base),
        ("the same, up to a constant", tool.up_to_constant),
        ("spots, at the poses measured", verdict.spots),
    ]
    return [
        (name, *(rough_mm(figure) for own in (gain.before, gain.after) for figure in (own.median, own.p95, own.worst)))
        for name, gain in cases
        if gain is not None
    ]


def constant_words(tool: ToolAccuracy) -> str:
    """What the constant may be."""
    base = f"{rough_mm(tool.base_shift)} mm and {rounded(tool.base_turn * 1e3, 2)} mrad"
    return f"What the constant may be (a standard deviation): base {base}, tool {rough_mm(tool.tool_shift)} mm"


def rough_mm(value: float) -> str:
    """A length in metres as millimetres, two digits that count."""
    if not math.isfinite(value):
        return "unknown"
    return f"{value / MM:.0f}" if abs(value) >= 9.95 * MM else f"{value / MM:#.2g}"


def _table(verdict: Verdict) -> RenderableType:
    table = figures_table("")
    for phase in ("before", "after"):  # as in the table of distances
        for figure in FIGURES:
            table.add_column(f"{figure}\n{phase}", justify="right")
    for row in accuracy_rows(verdict):
        table.add_row(*row)
    return titled(PREDICTED, table)
