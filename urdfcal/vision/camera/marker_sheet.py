"""The sheet of markers to print and put up, true to scale.

The whole sheet on one page (`full`, or where it fits the paper); otherwise one marker a page, to be cut along the crop marks and
put up with its centre lines on the place that the page names. Nothing but white lies within one cell of a marker.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from urdfcal.base.errors import UsageError
from urdfcal.base.geometry import MM
from urdfcal.vision.camera import sheet
from urdfcal.vision.camera.markers import ScreenMarkers
from urdfcal.vision.camera.sheet import GREY, MARGIN_MM

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_NOTES_MM = 24.0  # below and above a marker, for words and the scale bar
_MARK_MM = 5.0


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


def marker_sheet(markers: ScreenMarkers, ending: str, paper: str = "A4", dpi: float = 300.0, mirror: bool = False) -> bytes:
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
    sheet.require_file([page.size for page in pages], "sheet", ending, paper, dpi)
    return sheet.saved([_drawn(markers, page, mirror) for page in pages], "Markers for the screen", ending, dpi)


def sheet_pages(markers: ScreenMarkers, paper: str, mirror: bool = False) -> list[Page]:
    """How the markers are laid on pages.

    Raises:
        UsageError: a marker is larger than the paper.
    """
    whole, size = _whole_page(markers, mirror), sheet.paper_size(paper)
    turned = whole.size if size is None else sheet.turned_for(whole.size, size)
    if size is None or turned is None:
        return [whole] if size is None else _one_a_page(markers, paper, size)
    shift = (np.array(turned) - whole.size) / 2
    places = {marker: _pair(shift + place) for marker, place in whole.places.items()}
    return [Page(turned, places, None if whole.origin is None else _pair(shift + whole.origin))]


def _one_a_page(markers: ScreenMarkers, paper: str, size: sheet.Size) -> list[Page]:
    needed = _quiet_mm(markers) + 2 * MARGIN_MM + 2 * _MARK_MM, _quiet_mm(markers) + 2 * MARGIN_MM + 2 * _NOTES_MM
    if needed[0] > size[0] or needed[1] > size[1]:
        larger = "A3 or full" if paper == "A4" else "full"
        raise UsageError(
            f"a marker of {markers.size / MM:g} mm needs a page of {needed[0]:.0f} x {needed[1]:.0f} mm; take --paper {larger}"
        )
    return [Page(size, {marker: _pair(np.array(size) / 2)}) for marker in markers.centres]


def _whole_page(markers: ScreenMarkers, mirror: bool) -> Page:
    """One page that holds the sheet as it hangs on the screen: +y to the left, +z up."""
    ids, centres = list(markers.centres), np.array(list(markers.centres.values())) / MM
    places = centres * [1 if mirror else -1, 1]
    least, most = places.min(axis=0), places.max(axis=0)
    border = _quiet_mm(markers) / 2 + MARGIN_MM + np.array([_MARK_MM, _NOTES_MM])
    page = most - least + 2 * border
    return Page(
        _pair(page), {marker: _pair(place - least + border) for marker, place in zip(ids, places, strict=True)}, _pair(border - least)
    )


def _quiet_mm(markers: ScreenMarkers) -> float:
    """Side of a marker with the white around it."""
    cells = len(markers.cells_of(next(iter(markers.centres))))
    return markers.size / MM * (cells + 2) / cells


def _drawn(markers: ScreenMarkers, page: Page, mirror: bool) -> Figure:
    figure, axes = sheet.page(page.size)
    for marker, place in page.places.items():
        cells = markers.cells_of(marker)
        sheet.draw_marker(axes, cells[:, ::-1] if mirror else cells, place, markers.size / MM)
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
    sheet.draw_scale(axes, page.size)
    return figure


def _draw_marks(axes: Axes, place: tuple[float, float], side: float) -> None:
    """Crop marks at the corners of the white, and ticks on the marker's centre lines."""
    half = side / 2
    for right in (-1, 1):
        for up in (-1, 1):
            x, y = place[0] + right * half, place[1] + up * half
            sheet.line(axes, (x, x), (y, y + up * _MARK_MM))
            sheet.line(axes, (x, x + right * _MARK_MM), (y, y))
        sheet.line(axes, (place[0] + right * half, place[0] + right * (half + _MARK_MM)), (place[1], place[1]), "black")
        sheet.line(axes, (place[0], place[0]), (place[1] + right * half, place[1] + right * (half + _MARK_MM)), "black")


def _draw_origin(axes: Axes, origin: tuple[float, float]) -> None:
    """A cross at y = z = 0; on a marker it is not seen, and not needed."""
    sheet.line(axes, (origin[0] - _MARK_MM, origin[0] + _MARK_MM), (origin[1], origin[1]), zorder=0)
    sheet.line(axes, (origin[0], origin[0]), (origin[1] - _MARK_MM, origin[1] + _MARK_MM), zorder=0)
    axes.text(origin[0] + 1, origin[1] + 1, "y = z = 0", fontsize=5, color=GREY, zorder=0)


def _pair(numbers: Any) -> tuple[float, float]:
    return float(numbers[0]), float(numbers[1])
