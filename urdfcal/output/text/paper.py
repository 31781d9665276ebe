"""Tables II and III as text and for machines."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

from urdfcal.base.terminal import figures_table, titled
from urdfcal.simulation.paper import ESTIMATORS, PROTOCOLS, Figures, Line

if TYPE_CHECKING:
    from rich.console import RenderableType
    from rich.table import Table

    from urdfcal.base.geometry import Vector


LASERS = ("l1", "l2")


def paper_blocks(lines: list[Line], runs: int) -> list[RenderableType]:
    """Table II, then Table III for each protocol, each beside the published figures."""
    draws = "one draw" if runs == 1 else f"{runs} draws"
    blocks: list[RenderableType] = [f"SIMULATED, mean over {draws} of poses and noise. All figures: mean/std/max distance in mm.", ""]
    blocks.append(_table_ii([line for line in lines if not line.protocol]))
    for protocol in PROTOCOLS:
        own = [line for line in lines if line.protocol == protocol]
        blocks += ["", _table_iii(f"Table III, {protocol} a pose: after calibration, distance to the noise-free spot", own)]
        blocks += ["", _measured(f"The same, {protocol} a pose: distance to the measured spot, predicted from the readings", own)]
    return [*blocks, "", "The published figures are for the authors' own poses and noise, which are not given."]


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


def _table_ii(lines: list[Line]) -> RenderableType:
    table = figures_table("case", "laser")
    _figure_columns(table, ["ours", "published"])
    for line in lines:
        for index, laser in enumerate(LASERS):
            table.add_row(_case(line), laser, _figures(line.to_true[index]), _published(line, index))
    return titled("Table II: before calibration", table)


def _table_iii(title: str, lines: list[Line]) -> RenderableType:
    table = figures_table("case", "laser")
    _figure_columns(
        table, [f"{name}\n{whose}" for name, whose in (("LSE", "ours"), ("LSE", "published"), ("EKF", "ours"), ("EKF", "published"))]
    )
    _figure_columns(table, ["EKF, noise\nstated, ours"])
    for own in _by_case(lines):
        lse, ekf, stated = (own[estimator] for estimator in ESTIMATORS)
        for index, laser in enumerate(LASERS):
            ours = [_figures(line.to_true[index]) for line in (lse, ekf, stated)]
            table.add_row(_case(lse), laser, ours[0], _published(lse, index), ours[1], _published(ekf, index), ours[2])
    return titled(title, table)


def _measured(title: str, lines: list[Line]) -> RenderableType:
    table = figures_table("case", "laser")
    _figure_columns(table, list(ESTIMATORS))
    for own in _by_case(lines):
        for index, laser in enumerate(LASERS):
            figures = [_figures(line.to_measured[index]) for line in own.values() if line.to_measured is not None]
            table.add_row(_case(own[ESTIMATORS[0]]), laser, *figures)
    return titled(title, table)


def _by_case(lines: list[Line]) -> list[dict[str, Line]]:
    """The lines of each case and set, by estimator."""
    keys = dict.fromkeys((line.case, line.poses) for line in lines)
    return [{line.estimator: line for line in lines if (line.case, line.poses) == key} for key in keys]


def _figure_columns(table: Table, names: list[str]) -> None:
    for name in names:
        table.add_column(name, justify="right", no_wrap=True)


def _case(line: Line) -> str:
    return f"{line.case} {line.poses}"


def _published(line: Line, laser: int) -> str:
    return _figures(line.published[laser]) if line.published else ""


def _figures(figures: Vector | Figures) -> str:
    return "/".join(f"{figure:.2f}" if figure < 10 else f"{figure:.1f}" for figure in figures)
