"""Tables II and III as text and for machines."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

from urdfcal.paper import PROTOCOLS, Figures, Line
from urdfcal.report import figures_table, titled

if TYPE_CHECKING:
    from rich.console import RenderableType

    from urdfcal.geometry import Vector

LASERS = ("l1", "l2")


def paper_blocks(lines: list[Line], runs: int) -> list[RenderableType]:
    """Table II, then Table III for each protocol, each beside the published figures."""
    blocks: list[RenderableType] = [f"SIMULATED, means over {runs} draws of poses and noise; mean/std/max distance in mm", ""]
    blocks.append(_table("Table II: before calibration", [line for line in lines if not line.protocol], measured=False))
    for protocol in PROTOCOLS:
        blocks += ["", _table(f"Table III: after calibration, {protocol} a pose", [line for line in lines if line.protocol == protocol], measured=True)]
    return [
        *blocks,
        "",
        "true: distance to the noise-free spot at the true joint positions; measured: to the measured spot, from the readings.",
        "The published figures are for one draw of the authors' own poses, which are not given.",
    ]


def paper_json(lines: Iterable[Line]) -> dict[str, Any]:
    """Every line for machines; [mm]."""
    return {
        "lines": [
            {
                "protocol": line.protocol,
                "estimator": line.estimator,
                "case": line.case,
                "poses": line.poses,
                "to_true_mm": line.to_true.tolist(),
                "to_measured_mm": None if line.to_measured is None else line.to_measured.tolist(),
                "published_mm": line.published,
            }
            for line in lines
        ]
    }


def _table(title: str, lines: list[Line], measured: bool) -> RenderableType:
    table = figures_table("case", *(["estimator"] if measured else []))
    for kind in ("true", *(["measured"] if measured else []), "published"):
        for laser in LASERS:
            table.add_column(f"{laser}\n{kind}", justify="right", no_wrap=True)
    for line in lines:
        cells = [_figures(row) for row in line.to_true]
        if measured and line.to_measured is not None:
            cells += [_figures(row) for row in line.to_measured]
        cells += [_figures(row) for row in line.published] if line.published else ["", ""]
        table.add_row(f"{line.case} {line.poses}", *([line.estimator] if measured else []), *cells)
    return titled(title, table)


def _figures(figures: Vector | Figures) -> str:
    return "/".join(f"{figure:.2f}" if figure < 10 else f"{figure:.1f}" for figure in figures)
