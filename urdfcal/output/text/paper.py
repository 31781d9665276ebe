"""The paper's tables beside ours as text and for machines: II and III of its simulation, V to VII of its experiment."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

from urdfcal.base.terminal import figures_table, titled
from urdfcal.output.paper.distances import SIMULATED_HERE
from urdfcal.output.paper.estimates import table_v
from urdfcal.output.paper.exhibit import draws
from urdfcal.simulation.paper import ESTIMATORS, Line, Repeated
from urdfcal.simulation.published import Figures
from urdfcal.simulation.study import CASES

if TYPE_CHECKING:
    from rich.console import RenderableType
    from rich.table import Table

    from urdfcal.base.geometry import Vector


LASERS = ("l1", "l2")


def paper_blocks(lines: list[Line], runs: int) -> list[RenderableType]:
    """Table II, then Table III for each protocol, each beside the published figures."""
    blocks: list[RenderableType] = [f"SIMULATED, mean over {draws(runs)} of poses and noise. All figures: mean/std/max distance in mm.", ""]
    blocks.append(_table_ii([line for line in lines if not line.protocol]))
    for protocol in dict.fromkeys(line.protocol for line in lines if line.protocol):
        own = [line for line in lines if line.protocol == protocol]
        blocks += _table_iii(f"Table III, {protocol} a pose: distance to the noise-free spot after calibration", own)
        blocks += ["", _measured(f"The same, {protocol} a pose: distance to the measured spot, as predicted", own)]
    return [*blocks, "", "The published figures are for the authors' own poses and noise, which are not given."]


def paper_json(studies: Sequence[Repeated]) -> dict[str, Any]:
    """Every line and every mean estimate for machines; distances in mm, estimates in SI."""
    return {
        "runs": studies[0].runs,
        "seed": studies[0].seed,
        "lines": [_line_json(repeated.study.section, line) for repeated in studies for line in repeated.lines],
        "estimates": [each for repeated in studies for each in _estimates_json(repeated)],
    }


def study_blocks(repeated: Repeated) -> list[RenderableType]:
    """The tables of a study: II and III, or V to VII."""
    if repeated.study.section == 4:
        return paper_blocks(repeated.lines, repeated.runs)
    before = [line for line in repeated.lines if not line.protocol]
    return [
        f"{SIMULATED_HERE}. Mean over {draws(repeated.runs)} of poses and noise. Distances: mean/std/max in mm.",
        "",
        _table_ii(before, "Table VI: before calibration"),
        "",
        _table_vii(repeated),
        "",
        *_table_v(repeated),
    ]


def _line_json(section: int, line: Line) -> dict[str, Any]:
    return {
        "section": section,
        "protocol": line.protocol,
        "estimator": line.estimator,
        "case": line.case,
        "poses": line.poses,
        "to_true_mm": line.to_true.tolist(),
        "to_measured_mm": None if line.to_measured is None else line.to_measured.tolist(),
        "published_mm": line.published,
    }


def _estimates_json(repeated: Repeated) -> Iterator[dict[str, Any]]:
    for (protocol, estimator, case), found in repeated.estimates.items():
        rows = zip(repeated.errors.names, found.mean(axis=0).tolist(), repeated.truth.tolist(), repeated.errors.units, strict=True)
        parameters = [{"name": name, "mean": mean, "truth": truth, "unit": unit} for name, mean, truth, unit in rows]
        yield {"section": repeated.study.section, "protocol": protocol, "estimator": estimator, "case": case, "parameters": parameters}


def _table_vii(repeated: Repeated) -> RenderableType:
    """Every protocol beside what is published."""
    table = figures_table("case", "laser")
    _figure_columns(table, [*(f"{protocol},\nours" for protocol in repeated.study.protocols), "\npublished"])
    lines = {protocol: [line for line in repeated.lines if line.protocol == protocol] for protocol in repeated.study.protocols}
    for own in zip(*lines.values(), strict=True):
        for index, laser in enumerate(LASERS):
            ours = [_figures(line.to_measured[index]) for line in own if line.to_measured is not None]
            table.add_row(_case(own[0]), laser, *ours, _published(own[0], index))
    return titled("Table VII: distance to the measured spot after calibration by the EKF", table)


def _table_v(repeated: Repeated) -> list[RenderableType]:
    """Published and own estimates; the page has their differences, too."""
    exhibit = table_v(repeated)
    table = figures_table("parameter")
    _figure_columns(table, [f"case {case},\n{whose}" for case in CASES for whose in ("published", "ours")])
    for row in exhibit.table.rows:
        table.add_row(str(row[0]), *(str(cell) for at, cell in enumerate(row) if at and at % 3))
    return [titled(exhibit.title, table), "", exhibit.note]


def _table_ii(lines: list[Line], title: str = "Table II: before calibration") -> RenderableType:
    table = figures_table("case", "laser")
    _figure_columns(table, ["ours", "published"])
    for line in lines:
        for index, laser in enumerate(LASERS):
            table.add_row(_case(line), laser, _figures(line.to_true[index]), _published(line, index))
    return titled(title, table)


def _table_iii(title: str, lines: list[Line]) -> list[RenderableType]:
    """LSE, then the EKF, each beside what is published; five columns of figures beside each other are wider than a terminal."""
    lse, ekf, stated = ESTIMATORS
    blocks: list[RenderableType] = []
    for estimators in ((lse,), (ekf, stated)):
        table = figures_table("case", "laser")
        _figure_columns(table, [f"{estimators[0]}, ours", "published", *(f"{name}, ours" for name in estimators[1:])])
        for own in _by_case(lines):
            for index, laser in enumerate(LASERS):
                first, *others = (_figures(own[name].to_true[index]) for name in estimators)
                table.add_row(_case(own[lse]), laser, first, _published(own[estimators[0]], index), *others)
        blocks += ["", titled(f"{title} by the {estimators[0]}", table)]
    return blocks


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
