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
    left = sum(bool(each.said) for each in found)
    whole = "the calibrated robot comes where it was wanted at every one" if not left else f"{left} with reservations, see the warnings"
    table = figures_table("the calibrated robot is off by")
    for heading in ("mean", "worst"):
        table.add_column(f"{heading}\nbefore", justify="right")
    for heading in ("mean", "worst"):
        table.add_column(f"{heading}\nafter", justify="right")
    for unit in ("mm", "deg"):
        figures = [np.array([getattr(each, f"{when}_{unit}") for each in found]) for when in ("before", "left")]
        table.add_row(unit, *(f"{value:.3f}" for each in figures for value in (each.mean(), each.max())))
    return [f"{many(len(found), 'target')} of '{way.tool}' in '{way.base}': {whole}", "", table]


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
