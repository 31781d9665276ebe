"""Corrected targets as a page: how far off the real tool was and is, target by target over the program."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from urdfcal.base.terminal import many, rounded
from urdfcal.deploy.targets import Corrected
from urdfcal.output.report.document import Block, Gallery, Points, Section, Table
from urdfcal.output.report.plain import PlainReport, made_of_section, plain_page
from urdfcal.output.report.plots.axes import Axes, Look
from urdfcal.output.report.plots.residuals import size_bins
from urdfcal.output.report.plots.svg import Picture, draw_picture, sane
from urdfcal.output.report.verdict import Opening
from urdfcal.output.text.targets import off_figures
from urdfcal.robot.way import Way

_MOST_ROWS = 400  # beyond, the table has the worst; all are in --json
_SHOWN = {"mm": "Position", "deg": "Orientation"}
_UNITS = tuple(_SHOWN)


def targets_page(
    found: Sequence[Corrected], way: Way, source: Path, said: Sequence[str], files: Iterable[tuple[str, Path | None]], made_of: str
) -> bytes:
    """The page.

    Args:
        found: Target by target.
        way: Whose tool and base.
        source: The file with the targets.
        said: What of it stays as it stands.
        files: What the page is made of: a word and the file.
        made_of: Their hash.
    """
    left = [each for each in found if each.said]
    headline = _headline(found, way)
    opening = Opening("warn" if left or said else "good", _summary(found), headline, (), _figures(found), "")
    sections = (_program(found), *_reservations(source, left, said), _targets(found), made_of_section(files))
    subtitle = f"{source}: {many(len(found), 'target')} of {way.tool} in {way.base}"
    return plain_page(PlainReport("Corrected targets", subtitle, opening, sections), _pictures(found), made_of)


def _summary(found: Sequence[Corrected]) -> str:
    left = sum(bool(each.said) for each in found)
    return (
        f"{left} of {many(len(found), 'target')} with reservations"
        if left
        else "The calibrated robot comes where it was wanted at every one"
    )


def _headline(found: Sequence[Corrected], way: Way) -> str:
    before, after = (max((getattr(each, name) for each in found), default=0.0) for name in ("before_mm", "left_mm"))
    was = f"With the targets as they were, the calibrated robot's {way.tool} was up to {rounded(before, 3)} mm off"
    return f"{was}; now {'under 0.001' if after < 1e-3 else f'up to {rounded(after, 3)}'} mm."


def _figures(found: Sequence[Corrected]) -> Table:
    rows = tuple((unit, *cells) for unit, cells in off_figures(found))
    return Table(("", "mean", "worst", "mean", "worst"), rows, groups=(("", 1), ("before", 2), ("after", 2)))


def _program(found: Sequence[Corrected]) -> Section:
    text = "How far off the calibrated robot has its tool, in the file's order: with each target as it was, and as it is now."
    return Section("program", "Over the program", (text, Gallery("program"), Gallery("histograms")))


def _reservations(source: Path, left: Sequence[Corrected], said: Sequence[str]) -> tuple[Section, ...]:
    lines = (*said, *(f"{source.name}:{each.target.line}: {each.said}" for each in left))
    return (Section("reservations", "To be looked at", (Points(lines),)),) if lines else ()


def _targets(found: Sequence[Corrected]) -> Section:
    chosen = sorted(sorted(range(len(found)), key=lambda index: -found[index].before_mm)[:_MOST_ROWS])
    rows = tuple(
        (str(found[at].target.line), *(f"{getattr(found[at], f'{when}_{unit}'):.3f}" for when in ("before", "left") for unit in _UNITS))
        for at in chosen
    )
    note = f"The {len(rows)} of {len(found)} that were farthest off." if len(rows) < len(found) else "By the line on which it stands."
    blocks: tuple[Block, ...] = (note, Table(("line", *_UNITS, *_UNITS), rows, groups=(("", 1), ("before", 2), ("after", 2))))
    return Section("targets", "Target by target", blocks)


def _pictures(found: Sequence[Corrected]) -> list[Picture]:
    return [*(_over(found, unit) for unit in _UNITS), _sizes(found)]


def _over(found: Sequence[Corrected], unit: str) -> Picture:
    before, after = (sane(np.array([getattr(each, f"{when}_{unit}") for each in found])) for when in ("before", "left"))
    number = np.arange(1, len(found) + 1, dtype=float)

    def draw(axes: Axes) -> None:
        axes.points(number, before, Look("c1", mark="o", dash="dotted", width=0.8, size=4), "before")
        axes.points(number, after, Look("c0", mark="s", dash="solid", width=0.8, size=4), "after")
        most = float(np.nanmax(np.concatenate([before, after, [1e-6]])))
        axes.x_label, axes.y_label, axes.whole = "target, in the file's order", f"off by {unit}", True
        axes.y_ends = (-0.03 * most, 1.08 * most)

    return draw_picture("program", _SHOWN[unit], "", 150, draw)


def _sizes(found: Sequence[Corrected]) -> Picture:
    before, after = (np.array([getattr(each, name) for each in found]) for name in ("before_mm", "left_mm"))
    edges = size_bins(np.concatenate([before, after]))
    counts = [np.histogram(np.minimum(each, edges[-1]), edges)[0] for each in (before, after)]

    def draw(axes: Axes) -> None:
        axes.steps(counts[0], edges, Look("c1", dash="dotted"), "before")
        axes.steps(counts[1], edges, Look("c0", dash="solid"), "after")
        axes.x_label, axes.y_label = "off by mm", "targets"
        axes.x_ends, axes.y_ends = (0.0, float(edges[-1])), (0.0, 1.15 * max(int(max(each.max() for each in counts)), 1))

    return draw_picture("histograms", "How often how far", "", 120, draw)
