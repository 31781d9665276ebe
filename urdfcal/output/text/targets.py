"""Corrected targets, as text and for machines."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from urdfcal.base.terminal import figures_table, many
from urdfcal.deploy.targets import Corrected
from urdfcal.robot.way import Way

if TYPE_CHECKING:
    from rich.console import RenderableType


def target_blocks(found: Sequence[Corrected], way: Way) -> list[RenderableType]:
    """How many, and how far off the real tool was and is."""
    table = figures_table("the calibrated robot is off by")
    for heading in ("mean", "worst"):
        table.add_column(f"{heading}\nbefore", justify="right")
    for heading in ("mean", "worst"):
        table.add_column(f"{heading}\nafter", justify="right")
    for unit, cells in off_figures(found):
        table.add_row(unit, *cells)
    return [f"{many(len(found), 'target')} of '{way.tool}' in '{way.base}': {outcome(found)}", "", table]


def outcome(found: Sequence[Corrected]) -> str:
    """Whether all targets came out."""
    left = sum(bool(each.said) for each in found)
    return "the calibrated robot comes where it was wanted at every one" if not left else f"{left} with reservations, see the warnings"


def off_figures(found: Sequence[Corrected]) -> list[tuple[str, list[str]]]:
    """How far off the tool was and is, mean and worst of either, in mm and in deg."""
    rows = []
    for unit in ("mm", "deg"):
        figures = [np.array([getattr(each, f"{when}_{unit}") for each in found]) for when in ("before", "left")]
        rows.append((unit, [f"{value:.3f}" for each in figures for value in (each.mean(), each.max())]))
    return rows


def targets_json(found: Sequence[Corrected]) -> dict[str, Any]:
    """The same for machines, target by target; SI where the name says nothing."""
    return {
        "targets": [
            {
                "line": each.target.line,
                "before_mm": each.before_mm,
                "before_deg": each.before_deg,
                "left_mm": each.left_mm,
                "left_deg": each.left_deg,
                "values": each.values.tolist(),
                "joints": each.q.tolist(),
                "reservation": each.said or None,
            }
            for each in found
        ]
    }
