"""The report's pictures as figures of matplotlib, in the colours of the report's light page; pyplot knows nothing of them."""

from __future__ import annotations

import io
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from importlib.resources import files
from math import ceil
from typing import Any

import matplotlib
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure, SubFigure

from urdfcal.base.geometry import Vector
from urdfcal.output.report.plots.axes import Axes, Look
from urdfcal.output.report.plots.marks import is_open
from urdfcal.output.report.plots.svg import Picture

_INCH = 80.0  # [px] of a picture that stand on an inch
_WIDTH = 4.4  # [inches] of a picture
_HANDLE, _LETTER = 0.55, 0.07  # [inches] of a legend's entry, about
_AROUND = 1.1  # [inches] above and below the axes: title, labels, legend
_SQUARE = 3.4  # [inches] of a picture whose axes have the same scale
_STYLE: dict[str, Any] = {
    "font.size": 9.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "text.parse_math": False,
}


class Plot(Figure):
    """A figure that a notebook shows, whether or not it was set up for matplotlib."""

    def _repr_png_(self) -> bytes:
        stream = io.BytesIO()
        canvas: Any = FigureCanvasAgg(self)
        canvas.print_png(stream)
        return stream.getvalue()


def figure_of(pictures: Sequence[Picture], columns: int = 2) -> Plot:
    """Pictures beside and below each other, each under its title."""
    columns = min(columns, len(pictures))
    rows = [pictures[start : start + columns] for start in range(0, len(pictures), columns)]
    heights = [max(picture.height / _INCH or _SQUARE for picture in row) + _AROUND for row in rows]
    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        style: Any = _STYLE | {"grid.color": _palette()["line"], "axes.edgecolor": _palette()["line"]}
        matplotlib.rcParams.update(style)
        figure = Plot(figsize=(columns * _WIDTH, sum(heights)), layout="constrained", facecolor="white")
        parts = figure.subfigures(ceil(len(pictures) / columns), columns, height_ratios=heights, squeeze=False)
        for part, picture in zip(parts.ravel(), pictures, strict=False):
            _draw(part, picture)
    return figure


def _draw(part: SubFigure, picture: Picture) -> None:
    axes = _OnMatplotlib(own=part.subplots())
    picture.draw(axes)
    axes.finish()
    part.suptitle(picture.title, fontsize=10)
    handles, labels = axes.own.get_legend_handles_labels()
    if handles:
        part.legend(handles, labels, loc="outside lower center", ncols=_columns(labels), frameon=False, fontsize=8)


def _columns(labels: Sequence[str]) -> int:
    """How many labels stand beside each other."""
    return max(1, min(4, len(labels), int(_WIDTH / (_HANDLE + _LETTER * max(map(len, labels))))))


@dataclass
class _OnMatplotlib(Axes):
    """Axes of the report's kind that draw on matplotlib's own."""

    own: Any = field(default=None)

    def points(self, x: Vector, y: Vector, look: Look, label: str = "") -> None:
        """A line, marks or both."""
        hollow = bool(look.mark) and is_open(look.mark)
        self.own.plot(
            x,
            y,
            color=_palette()[look.colour],
            linestyle=look.dash or "none",
            linewidth=look.width,
            marker=look.mark.lower() if look.mark == "O" else look.mark or None,
            markersize=look.size,
            markerfacecolor="none" if hollow else None,
            label=label or "_none",
        )

    def steps(self, counts: Vector, edges: Vector, look: Look, label: str = "") -> None:
        """A histogram, lightly filled."""
        self.own.stairs(counts, edges, fill=True, color=_palette()[look.colour], alpha=0.18)
        self.own.stairs(counts, edges, color=_palette()[look.colour], linestyle=look.dash, linewidth=look.width, label=label or "_none")

    def bars(self, low: Vector, high: Vector, rows: Vector, colour: str) -> None:
        """Bars along x."""
        self.own.barh(rows, np.asarray(high) - low, left=low, height=0.8, color=_palette()[colour])

    def across(self, *, x: float | None = None, y: float | None = None) -> None:
        """A line from end to end."""
        if x is not None:
            self.own.axvline(x, color=_palette()["ink"], linewidth=0.8)
        if y is not None:
            self.own.axhline(y, color=_palette()["ink"], linewidth=0.8)

    def name(self, text: str, at: Vector) -> None:
        """A word beside a point."""
        self.own.annotate(text, at, (3, 3), textcoords="offset points", fontsize=8, clip_on=True, parse_math=False)

    def finish(self) -> None:
        """What was said of the axes: labels, ends, scales, names of rows."""
        self.own.set(xlabel=self.x_label, ylabel=self.y_label)
        for axis, kind in (("x", self.x_kind), ("y", self.y_kind)):
            if kind != "linear":
                getattr(self.own, f"set_{axis}scale")(kind, **({"linthresh": 1} if kind == "symlog" else {}))
        if self.rows:
            self.own.set_yticks(-np.arange(len(self.rows), dtype=float), self.rows, fontsize=8)
        if self.equal:
            self.own.set_aspect("equal")
        self.own.set(**{f"{axis}lim": ends for axis, ends in (("x", self.x_ends), ("y", self.y_ends)) if ends is not None})


@cache
def _palette() -> Mapping[str, str]:
    """The colours of the report's light page by their classes."""
    sheet = files("urdfcal.output.report").joinpath("page", "report.css").read_text("utf-8")
    return dict(re.findall(r"--([\w-]+): (#\w+)", sheet[: sheet.index("}")]))
