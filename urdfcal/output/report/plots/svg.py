"""Pictures as SVG that takes its colours and fonts from the page, so that they follow light and dark."""

from __future__ import annotations

import io
import re
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from urdfcal.base.geometry import Matrix

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure, FigureBase


INK, LINE, BAND = "#000a01", "#000a02", "#000a03"  # stand-ins: the page says what they are
SERIES = tuple(f"#000b{index:02x}" for index in range(8))
MARKERS = "os^Dv*PX"
DASHES = ("-", "--", ":", "-.")
SANE = 1e6  # [mm] and [deg]: beyond is not drawn
_VARIABLES = {INK: "ink", LINE: "line", BAND: "band", **{stand_in: f"c{index}" for index, stand_in in enumerate(SERIES)}}
NARROW, WIDE = 4.6, 6.4  # [inches] of a picture in a gallery of three columns and of two; 72 units an inch
_LETTER, _HANDLE = 0.07, 0.48  # [inches] in a legend, about
_STYLE: Any = {
    "svg.fonttype": "none",
    "svg.hashsalt": "urdfcal",
    "font.size": 10.5,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.edgecolor": LINE,
    "axes.labelcolor": INK,
    "axes.facecolor": "none",
    "axes.formatter.useoffset": False,
    "figure.facecolor": "none",
    "grid.color": LINE,
    "grid.linewidth": 0.5,
    "legend.frameon": False,
    "legend.fontsize": 9.5,
    "lines.linewidth": 1.2,
    "lines.markersize": 3.5,
    "text.color": INK,
    "text.parse_math": False,
    "xtick.color": LINE,
    "ytick.color": LINE,
    "xtick.labelcolor": INK,
    "ytick.labelcolor": INK,
}


@dataclass(frozen=True)
class Picture:
    """A picture and what it says.

    Attributes:
        gallery: Where in the report it stands.
        title: What it shows.
        caption: How it is to be read.
        draw: Draws it.
        height, width: Of the drawing, [inches].
    """

    gallery: str
    title: str
    caption: str
    draw: Callable[[Axes], None]
    height: float
    width: float

    @cached_property
    def svg(self) -> str:
        """The drawing for a page."""
        from matplotlib.figure import Figure

        with house_style():
            figure = Figure(figsize=(self.width, self.height), layout="constrained")
            self.draw_on(figure)
            return _svg(figure, self.title, self.caption)

    def draw_on(self, figure: FigureBase) -> None:
        """Draw it on an empty figure, or a part of one; what has a label gets a legend below."""
        axes = figure.subplots()
        self.draw(axes)
        handles, labels = axes.get_legend_handles_labels()
        if handles:
            columns = _columns(labels, self.width)
            figure.legend(handles, labels, loc="outside lower center", ncols=columns, handlelength=1.6, columnspacing=1.2)


@contextmanager
def house_style() -> Iterator[None]:
    """Our own settings, whatever the user's matplotlibrc says; no warning of letters that the page's own font will have."""
    import matplotlib

    with matplotlib.rc_context(), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(_STYLE)
        yield


def draw_picture(gallery: str, title: str, caption: str, height: float, draw: Callable[[Axes], None], width: float = NARROW) -> Picture:
    """One picture with one pair of axes."""
    return Picture(gallery, title, caption, draw, height, width)


def _columns(labels: Sequence[str], width: float) -> int:
    """How many labels stand beside each other in a legend."""
    return max(1, min(4, int(width / (_HANDLE + _LETTER * max(len(label) for label in labels)))))


def _svg(figure: Figure, title: str, caption: str) -> str:
    """The drawing as an element for a page: colours by variables, fonts from the page, ids of its own."""
    from lxml import etree
    from matplotlib.backends.backend_svg import FigureCanvasSVG

    stream = io.BytesIO()
    unsaid = {"Date": None, "Creator": None, "Format": None, "Type": None}
    canvas: Any = FigureCanvasSVG(figure)
    canvas.print_svg(stream, metadata=unsaid)  # `savefig` draws all twice
    root = etree.fromstring(stream.getvalue(), etree.XMLParser(remove_comments=True, resolve_entities=False))
    own = re.sub(r"\W+", "-", title.lower())
    for element in root.iter():
        for name, value in element.attrib.items():
            element.set(name, _on_page(etree.QName(name).localname, " ".join(str(value).split()), own))
        element.text, element.tail = _flat(element.text), _flat(element.tail)
    for metadata in root.findall("{*}metadata"):
        root.remove(metadata)
    for name in ("width", "height", "version"):
        root.attrib.pop(name, "")
    root.attrib.update({"role": "img", "aria-label": f"{title}. {caption}"})
    return str(etree.tostring(root, encoding="unicode", with_tail=False))


def _on_page(name: str, value: str, own: str) -> str:
    """An attribute's value as the page has it."""
    if name == "id":
        return f"{own}-{value}"
    if name == "href":
        return value.replace("#", f"#{own}-", 1)
    return re.sub("|".join(_VARIABLES), lambda found: f"var(--{_VARIABLES[found[0]]})", value.replace("url(#", f"url(#{own}-"))


def _flat(text: str | None) -> str | None:
    return text and re.sub(r"\s*\n\s*", " ", text)


def sane(values: Matrix) -> Matrix:
    """The values, nan where they are nothing that can be drawn."""
    return np.where(np.isfinite(values) & (np.abs(values) < SANE), values, np.nan)
