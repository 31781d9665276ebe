"""The report's pictures as figures of matplotlib, in the colours of the report's light page; pyplot knows nothing of them."""

from __future__ import annotations

import io
import re
from collections.abc import Mapping, Sequence
from functools import cache
from importlib.resources import files
from math import ceil
from typing import Any

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

from urdfcal.output.report.plots.svg import BAND, INK, LINE, SERIES, Picture, house_style

_TITLE = 0.35  # [inches] above a picture
_COLOURS = ("color", "facecolor", "edgecolor", "markerfacecolor", "markeredgecolor")


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
    heights = [max(picture.height for picture in row) + _TITLE for row in rows]
    width = columns * max(picture.width for picture in pictures)
    with house_style():
        figure = Plot(figsize=(width, sum(heights)), layout="constrained")
        parts = figure.subfigures(ceil(len(pictures) / columns), columns, height_ratios=heights, squeeze=False)
        for part, picture in zip(parts.ravel(), pictures, strict=False):
            picture.draw_on(part)
            part.suptitle(picture.title, fontsize=11, color=INK)
        _colour(figure)
    return figure


@cache
def _palette() -> Mapping[str, str]:
    """What the stand-ins are on the report's light page."""
    sheet = files("urdfcal.output.report").joinpath("page", "report.css").read_text("utf-8")
    light = dict(re.findall(r"--(\w+): (#\w+)", sheet[: sheet.index("}")]))
    series = {stand_in: light[f"c{index}"] for index, stand_in in enumerate(SERIES)}
    return {INK: light["ink"], LINE: light["line"], BAND: light["band"], **series}


def _colour(figure: Figure) -> None:
    """Colours in place of the stand-ins, also for ticks that are made when the figure is looked at."""
    palette = _palette()
    for axes in figure.findobj(lambda artist: hasattr(artist, "tick_params")):
        axes.tick_params(color=palette[LINE], labelcolor=palette[INK], grid_color=palette[LINE], grid_linewidth=0.5)  # type: ignore[attr-defined]
    for artist in figure.findobj():
        for what in _COLOURS:
            _recolour(artist, what, palette)
    figure.set_facecolor("white")


def _recolour(artist: Any, what: str, palette: Mapping[str, str]) -> None:
    read, write = getattr(artist, f"get_{what}", None), getattr(artist, f"set_{what}", None)
    if read is None or write is None:
        return
    try:
        known = palette.get(to_hex(read()))
    except (ValueError, TypeError):  # several colours, or none that is stated
        return
    if known is not None:
        write(known)
