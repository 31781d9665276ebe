"""Sheets to print, true to scale: paper, lines, words, a bar to hold a ruler against, the file. All in [mm] from the lower left corner."""

from __future__ import annotations

import io
import re
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from urdfcal.base.errors import UsageError

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Size = tuple[float, float]
FULL = "full"  # one page as large as what is on it
PAPERS_MM: dict[str, Size] = {"A4": (210.0, 297.0), "A3": (297.0, 420.0), "A2": (420.0, 594.0), "A1": (594.0, 841.0), "A0": (841.0, 1189.0)}
PAPERS_MM |= {"letter": (215.9, 279.4), "legal": (215.9, 355.6), "tabloid": (279.4, 431.8)}
ENDINGS = (".pdf", ".svg", ".png")
MARGIN_MM = 8.0  # that printers leave blank
INCH_MM = 25.4
GREY = "0.45"
_LEAST_MM, MOST_MM = 40.0, 5000.0  # a PDF's pages end at 200 inches
_MOST_PIXELS = 1e8
_FONT, _LETTER_MM = 6.0, 0.19  # points; how wide a letter of one point is


def paper_size(text: str) -> Size | None:
    """Width and height of a page, [mm]; None where it is as large as what is on it.

    Raises:
        UsageError: there is no such paper.
    """
    known = {name.lower(): size for name, size in PAPERS_MM.items()}
    if text.lower() == FULL:
        return None
    if text.lower() in known:
        return known[text.lower()]
    match = re.fullmatch(r"(\d+(?:\.\d+)?)x(\d+(?:\.\d+)?)(?:mm)?", text)
    if match is None:
        raise UsageError(f"--paper {text}: expected {', '.join([*PAPERS_MM, FULL])}, or a size in mm such as 600x400")
    size = float(match[1]), float(match[2])
    if not (min(size) >= _LEAST_MM and max(size) <= MOST_MM):
        raise UsageError(f"--paper {text}: expected sides of {_LEAST_MM:g} to {MOST_MM:g} mm")
    return size


def paper_for(needed: Size) -> str:
    """The smallest of A4 to A0 that holds a page, either way; else its size in mm."""
    for name in ("A4", "A3", "A2", "A1", "A0"):
        if turned_for(needed, PAPERS_MM[name]) is not None:
            return name
    return "x".join(f"{np.ceil(side):.0f}" for side in needed)


def turned_for(needed: Size, paper: Size) -> Size | None:
    """The paper, turned the way of what is needed or else the other, where it then holds it; None where it is too small."""
    upright = sorted(paper, reverse=needed[0] > needed[1])
    for size in ((upright[0], upright[1]), (upright[1], upright[0])):
        if needed[0] <= size[0] + 1e-9 and needed[1] <= size[1] + 1e-9:
            return size
    return None


def page(size: Size) -> tuple[Figure, Axes]:
    """An empty page."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(size[0] / INCH_MM, size[1] / INCH_MM))
    axes = figure.add_axes((0, 0, 1, 1), xlim=(0, size[0]), ylim=(0, size[1]))
    axes.set_axis_off()
    return figure, axes


def draw_marker(axes: Axes, cells: Any, place: Size, size: float) -> None:
    """A marker by its cells, True where white, about a place: black, with white runs on it along rows and columns.

    So that no seam shows between white cells.
    """
    count, (left, top) = len(cells), (place[0] - size / 2, place[1] + size / 2)
    cell = size / count
    rectangle(axes, left, top - size, size, size, "black")
    for row in range(count):
        for start, stop in _runs(cells[row]):
            rectangle(axes, left + start * cell, top - (row + 1) * cell, (stop - start) * cell, cell, "white")
    for column in range(count):
        for start, stop in _runs(cells[:, column]):
            rectangle(axes, left + column * cell, top - stop * cell, cell, (stop - start) * cell, "white")


def _runs(white: Any) -> list[tuple[int, int]]:
    """Where runs of True start and stop."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], white.astype(int), [0]])))
    return [(int(start), int(stop)) for start, stop in edges.reshape(-1, 2)]


def rectangle(axes: Axes, left: float, bottom: float, width: float, height: float, colour: str) -> None:
    """A filled rectangle; its edges are where they are, not on whole pixels of a picture."""
    from matplotlib.patches import Rectangle

    patch = Rectangle((left, bottom), width, height, facecolor=colour, edgecolor="none", linewidth=0)
    patch.set_snap(False)
    axes.add_patch(patch)


def circle(axes: Axes, middle: Size, radius: float) -> None:
    """A black one."""
    from matplotlib.patches import Circle

    axes.add_patch(Circle(middle, radius, facecolor="black", edgecolor="none", linewidth=0))


def line(axes: Axes, x: Sequence[float], y: Sequence[float], colour: str = GREY, zorder: float = 2) -> None:
    """A thin one."""
    axes.plot(x, y, color=colour, linewidth=0.5, solid_capstyle="butt", zorder=zorder)


def draw_scale(axes: Axes, size: Size) -> None:
    """A bar to hold a ruler against."""
    length = 100.0 if size[0] > 150 else 20.0
    left, bottom = (size[0] - length) / 2, MARGIN_MM
    line(axes, (left, left + length), (bottom, bottom), "black")
    for x in np.arange(0, length + 1, 10):
        line(axes, (left + x, left + x), (bottom, bottom + (3 if x % 50 == 0 else 1.5)), "black")
    words = f"{length:g} mm when printed at 100 % (no fit to page)"
    draw_words(axes, size, bottom + 3.2, words)


def draw_words(axes: Axes, size: Size, bottom: float, words: str) -> None:
    """A line in the middle of a page, in letters as small as its width asks for."""
    points = min(_FONT, (size[0] - 2 * MARGIN_MM) / (len(words) * _LETTER_MM))
    axes.text(size[0] / 2, bottom, words, ha="center", va="bottom", fontsize=points, parse_math=False)


def require_file(pages: Sequence[Size], what: str, ending: str, paper: str, dpi: float) -> None:
    """Refuse several pages where a file has one, and pictures that are too large.

    Raises:
        UsageError: names the way out.
    """
    if len(pages) > 1 and ending != ".pdf":
        wider = "" if what != "sheet" else " or take --paper full"
        raise UsageError(f"the {what} takes {len(pages)} pages of {paper}, and a {ending} file has one; write a .pdf{wider}")
    if ending == ".png" and np.prod(pages[0]) * (dpi / INCH_MM) ** 2 > _MOST_PIXELS:
        largest = np.sqrt(_MOST_PIXELS / np.prod(pages[0])) * INCH_MM
        raise UsageError(
            f"the picture would have more than {_MOST_PIXELS / 1e6:.0f} million pixels; take --dpi {largest:.0f} or less, or a .pdf"
        )


def saved(figures: Sequence[Figure], title: str, ending: str, dpi: float) -> bytes:
    """The file; the same pages give the same bytes."""
    import matplotlib
    from matplotlib.backends.backend_pdf import PdfPages

    stream = io.BytesIO()
    with matplotlib.rc_context({"pdf.fonttype": 42, "svg.hashsalt": "urdfcal", "svg.fonttype": "path"}):
        if ending == ".pdf":
            with PdfPages(stream, metadata={"Title": title, "Creator": "urdfcal markers", "CreationDate": None}) as pages:
                for figure in figures:
                    pages.savefig(figure)
        elif ending == ".svg":
            figures[0].savefig(stream, format="svg", metadata={"Date": None, "Creator": "urdfcal markers"})
        else:
            figures[0].savefig(stream, format="png", dpi=dpi, metadata={"Software": "urdfcal markers"})
    return stream.getvalue()
