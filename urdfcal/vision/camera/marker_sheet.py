"""The sheet of markers to print and put up, true to scale.

The whole sheet on one page (`full`, or where it fits the paper); otherwise one marker a page, to be cut along the crop marks and
put up with its centre lines on the place that the page names. Nothing but white lies within one cell of a marker.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from urdfcal.base.errors import UsageError
from urdfcal.base.geometry import MM
from urdfcal.vision.camera.markers import ScreenMarkers

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


Paper = Literal["A4", "A3", "full"]
PAPERS_MM = {"A4": (210.0, 297.0), "A3": (297.0, 420.0)}
ENDINGS = (".pdf", ".svg", ".png")
_MARGIN_MM = 8.0  # that printers leave blank
_NOTES_MM = 24.0  # below and above a marker, for words and the scale bar
_MARK_MM = 5.0
_MOST_PIXELS = 1e8
_INCH_MM = 25.4
_GREY = "0.45"


@dataclass(frozen=True)
class Page:
    """One page, all in [mm] from its lower left corner.

    Attributes:
        size: Width and height.
        places: Centres of the markers on it.
        origin: The screen's origin, where the page holds the whole sheet.
    """

    size: tuple[float, float]
    places: dict[int, tuple[float, float]]
    origin: tuple[float, float] | None = None


def marker_sheet(markers: ScreenMarkers, ending: str, paper: Paper = "A4", dpi: float = 300.0, mirror: bool = False) -> bytes:
    """A file to print.

    Args:
        markers: What is on the screen.
        ending: `.pdf`, `.svg` or `.png`.
        paper: A page's size; `full` for one page as large as the sheet.
        dpi: Of a PNG.
        mirror: Print as seen from the back, for paper that is put on the screen's back.

    Raises:
        UsageError: it does not fit the paper, needs several pages where the format has one, or is too large a picture.
    """
    pages = sheet_pages(markers, paper, mirror)
    if len(pages) > 1 and ending != ".pdf":
        raise UsageError(f"the sheet takes {len(pages)} pages of {paper}, and a {ending} file has one; write a .pdf or take --paper full")
    if ending == ".png" and np.prod(pages[0].size) * (dpi / _INCH_MM) ** 2 > _MOST_PIXELS:
        largest = np.sqrt(_MOST_PIXELS / np.prod(pages[0].size)) * _INCH_MM
        raise UsageError(
            f"the picture would have more than {_MOST_PIXELS / 1e6:.0f} million pixels; take --dpi {largest:.0f} or less, or a .pdf"
        )
    return _saved([_drawn(markers, page, mirror) for page in pages], ending, dpi)


def sheet_pages(markers: ScreenMarkers, paper: Paper, mirror: bool = False) -> list[Page]:
    """How the markers are laid on pages.

    Raises:
        UsageError: a marker is larger than the paper.
    """
    whole = _whole_page(markers, mirror)
    if paper == "full":
        return [whole]
    size = np.array(PAPERS_MM[paper])
    for turned in (size, size[::-1]):
        if (np.array(whole.size) <= turned).all():
            shift = (turned - whole.size) / 2
            places = {marker: _pair(shift + place) for marker, place in whole.places.items()}
            return [Page(_pair(turned), places, None if whole.origin is None else _pair(shift + whole.origin))]
    needed = _quiet_mm(markers) + 2 * _MARGIN_MM + 2 * _MARK_MM, _quiet_mm(markers) + 2 * _MARGIN_MM + 2 * _NOTES_MM
    if needed[0] > size[0] or needed[1] > size[1]:
        larger = "A3 or full" if paper == "A4" else "full"
        raise UsageError(
            f"a marker of {markers.size / MM:g} mm needs a page of {needed[0]:.0f} x {needed[1]:.0f} mm; take --paper {larger}"
        )
    return [Page(_pair(size), {marker: _pair(size / 2)}) for marker in markers.centres]


def _whole_page(markers: ScreenMarkers, mirror: bool) -> Page:
    """One page that holds the sheet as it hangs on the screen: +y to the left, +z up."""
    ids, centres = list(markers.centres), np.array(list(markers.centres.values())) / MM
    places = centres * [1 if mirror else -1, 1]
    least, most = places.min(axis=0), places.max(axis=0)
    border = _quiet_mm(markers) / 2 + _MARGIN_MM + np.array([_MARK_MM, _NOTES_MM])
    page = most - least + 2 * border
    return Page(
        _pair(page), {marker: _pair(place - least + border) for marker, place in zip(ids, places, strict=True)}, _pair(border - least)
    )


def _quiet_mm(markers: ScreenMarkers) -> float:
    """Side of a marker with the white around it."""
    cells = len(markers.cells_of(next(iter(markers.centres))))
    return markers.size / MM * (cells + 2) / cells


def _drawn(markers: ScreenMarkers, page: Page, mirror: bool) -> Figure:
    from matplotlib.figure import Figure

    figure = Figure(figsize=_pair(np.array(page.size) / _INCH_MM))
    axes = figure.add_axes((0, 0, 1, 1), xlim=(0, page.size[0]), ylim=(0, page.size[1]))
    axes.set_axis_off()
    for marker, place in page.places.items():
        cells = markers.cells_of(marker)
        _draw_marker(axes, cells[:, ::-1] if mirror else cells, place, markers.size / MM)
        _draw_marks(axes, place, _quiet_mm(markers))
        y, z = np.array(markers.centres[marker]) / MM
        mirrored = ", mirrored for the screen's back" if mirror else ""
        small = min(8.0, _quiet_mm(markers) / 12)
        axes.text(place[0], place[1] + _quiet_mm(markers) / 2 + 7, "↑ top", ha="center", va="bottom", fontsize=small * 1.3)
        axes.text(
            place[0],
            place[1] - _quiet_mm(markers) / 2 - 7,
            f"id {marker}   {markers.dictionary}   {markers.size / MM:g} mm{mirrored}\ncentre at y = {y:g} mm, z = {z:g} mm",
            ha="center",
            va="top",
            fontsize=small,
            linespacing=1.4,
        )
    if page.origin is not None:
        _draw_origin(axes, page.origin)
    _draw_scale(axes, page)
    return figure


def _draw_marker(axes: Axes, cells: Any, place: tuple[float, float], size: float) -> None:
    """Black with white runs on it, along the rows and along the columns, so that no seam shows between white cells."""
    count, (left, top) = len(cells), (place[0] - size / 2, place[1] + size / 2)
    cell = size / count
    _rectangle(axes, left, top - size, size, size, "black")
    for row in range(count):
        for start, stop in _runs(cells[row]):
            _rectangle(axes, left + start * cell, top - (row + 1) * cell, (stop - start) * cell, cell, "white")
    for column in range(count):
        for start, stop in _runs(cells[:, column]):
            _rectangle(axes, left + column * cell, top - stop * cell, cell, (stop - start) * cell, "white")


def _runs(white: Any) -> list[tuple[int, int]]:
    """Where runs of True start and stop."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], white.astype(int), [0]])))
    return [(int(start), int(stop)) for start, stop in edges.reshape(-1, 2)]


def _rectangle(axes: Axes, left: float, bottom: float, width: float, height: float, colour: str) -> None:
    from matplotlib.patches import Rectangle

    axes.add_patch(Rectangle((left, bottom), width, height, facecolor=colour, edgecolor="none", linewidth=0, antialiased=False))


def _draw_marks(axes: Axes, place: tuple[float, float], side: float) -> None:
    """Crop marks at the corners of the white, and ticks on the marker's centre lines."""
    half = side / 2
    for right in (-1, 1):
        for up in (-1, 1):
            x, y = place[0] + right * half, place[1] + up * half
            _line(axes, (x, x), (y, y + up * _MARK_MM))
            _line(axes, (x, x + right * _MARK_MM), (y, y))
        _line(axes, (place[0] + right * half, place[0] + right * (half + _MARK_MM)), (place[1], place[1]), "black")
        _line(axes, (place[0], place[0]), (place[1] + right * half, place[1] + right * (half + _MARK_MM)), "black")


def _draw_origin(axes: Axes, origin: tuple[float, float]) -> None:
    """A cross at y = z = 0; on a marker it is not seen, and not needed."""
    _line(axes, (origin[0] - _MARK_MM, origin[0] + _MARK_MM), (origin[1], origin[1]), zorder=0)
    _line(axes, (origin[0], origin[0]), (origin[1] - _MARK_MM, origin[1] + _MARK_MM), zorder=0)
    axes.text(origin[0] + 1, origin[1] + 1, "y = z = 0", fontsize=5, color=_GREY, zorder=0)


def _draw_scale(axes: Axes, page: Page) -> None:
    """A bar to hold a ruler against."""
    length = 100.0 if page.size[0] > 150 else 20.0
    left, bottom = (page.size[0] - length) / 2, _MARGIN_MM
    _line(axes, (left, left + length), (bottom, bottom), "black")
    for x in np.arange(0, length + 1, 10):
        _line(axes, (left + x, left + x), (bottom, bottom + (3 if x % 50 == 0 else 1.5)), "black")
    axes.text(page.size[0] / 2, bottom + 3.2, f"{length:g} mm when printed at 100 % (no fit to page)", ha="center", va="bottom", fontsize=6)


def _line(axes: Axes, x: Sequence[float], y: Sequence[float], colour: str = _GREY, zorder: float = 2) -> None:
    axes.plot(x, y, color=colour, linewidth=0.5, solid_capstyle="butt", zorder=zorder)


def _saved(figures: Sequence[Figure], ending: str, dpi: float) -> bytes:
    import matplotlib
    from matplotlib.backends.backend_pdf import PdfPages

    stream = io.BytesIO()
    with matplotlib.rc_context({"pdf.fonttype": 42, "svg.hashsalt": "urdfcal", "svg.fonttype": "path"}):
        if ending == ".pdf":
            with PdfPages(
                stream, metadata={"Title": "Markers for the screen", "Creator": "urdfcal markers", "CreationDate": None}
            ) as pages:
                for figure in figures:
                    pages.savefig(figure)
        elif ending == ".svg":
            figures[0].savefig(stream, format="svg", metadata={"Date": None, "Creator": "urdfcal markers"})
        else:
            figures[0].savefig(stream, format="png", dpi=dpi, metadata={"Software": "urdfcal markers"})
    return stream.getvalue()


def _pair(numbers: Any) -> tuple[float, float]:
    return float(numbers[0]), float(numbers[1])
