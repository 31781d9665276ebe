"""Pictures as SVG that takes its colours and fonts from the page, so that they follow light and dark; written without a plotting library.

All are equally wide and stand in galleries of equal columns, so that their letters are of one size throughout a page.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from urdfcal.base.geometry import Matrix
from urdfcal.output.report.plots.axes import Axes, Look
from urdfcal.output.report.plots.elements import element
from urdfcal.output.report.plots.marks import SHAPES
from urdfcal.output.report.plots.scales import Scale

SERIES = 8  # colours of the page, c0 to c7
SANE = 1e6  # [mm] and [deg]: beyond is not drawn
WIDTH = 340.0  # [px], at which letters have the page's size for pictures
_LETTER = 7.4  # [px] of a figure or letter of 12 px, in a wide font
_LABEL, _TOP, _BOTTOM, _RIGHT, _LEAST_LEFT = 20.0, 5.0, 34.0, 10.0, 38.0
_APART = 10.0  # [px] between what stands at two ticks of x
_LINE = 18.0  # [px] that a tick of y wants
_MOST_TICKS = 9
_MOST_NAME = 26  # letters of a row's name


@dataclass(frozen=True)
class Key:
    """An entry of a legend."""

    label: str
    svg: str


@dataclass(frozen=True)
class Picture:
    """A picture and what it says.

    Attributes:
        gallery: Where in the report it stands.
        title: What it shows.
        caption: How it is to be read; may be empty.
        svg: The drawing.
        keys: What its legend says, in reading order.
        draw: Draws it in a pair of axes, these or others of the same kind.
        height: Of these, [px]; 0 where both have the same scale.
    """

    gallery: str
    title: str
    caption: str
    svg: str
    keys: tuple[Key, ...]
    draw: Callable[[Axes], None]
    height: float


def look_of(index: int) -> tuple[str, str]:
    """Colour and mark of the frame, laser or target with this number; in the next eight each colour has another mark."""
    return f"c{index % SERIES}", SHAPES[(index + index // SERIES) % len(SHAPES)]


def draw_picture(gallery: str, title: str, caption: str, height: float, draw: Callable[[Axes], None]) -> Picture:
    """One picture with one pair of axes, this high [px]; what has a label gets a key."""
    axes = Axes()
    draw(axes)
    frame = _framed(axes, height)
    inside = element("svg", axes.drawn(frame.pixels), x=frame.left, y=frame.top, width=frame.width, height=frame.height)
    drawing = element(
        "svg",
        _furniture(axes, frame) + inside,
        viewBox=f"0 0 {WIDTH:g} {frame.top + frame.height + _BOTTOM:.5g}",
        role="img",
        aria_label=" ".join(each for each in (f"{title}.", caption, f"{axes.y_label or 'Rows'} against {axes.x_label}.") if each),
    )
    return Picture(gallery, title, caption, drawing, tuple(_key(label, look) for label, look in axes.keys.items()), draw, height)


@dataclass(frozen=True)
class _Frame:
    left: float
    top: float
    width: float
    height: float
    x: Scale
    y: Scale

    def pixels(self, points: Matrix) -> Matrix:
        """Points (n, 2) of the data in pixels from the frame's upper left corner; nan where they are not to be drawn."""
        at = np.stack([self.width * self.x.share(points[:, 0]), self.height * (1 - self.y.share(points[:, 1]))], axis=1)
        return np.where(np.abs(at) < SANE, at, np.nan)


def _framed(axes: Axes, height: float) -> _Frame:
    x, y = axes.scales()
    names = [shortened(name) for name in axes.rows] or list(y.ticks(_most(height)).values())
    left = max(_LEAST_LEFT, 9 + _LETTER * max((len(name) for name in names), default=0))
    width = WIDTH - left - _RIGHT
    return _Frame(
        left, _LABEL if axes.y_label else _TOP, width, width * (y.high - y.low) / (x.high - x.low) if axes.equal else height, x, y
    )


def _most(height: float) -> int:
    """Ticks that y has room for."""
    return min(max(int(height / _LINE), 3), _MOST_TICKS - 2)


def _ticks_beside(scale: Scale, width: float) -> dict[float, str]:
    """As many ticks of x as there is room for."""
    for most in range(_MOST_TICKS, 2, -1):
        ticks = scale.ticks(most)
        if sum(_LETTER * len(name) + _APART for name in ticks.values()) <= width:
            return ticks
    return scale.ticks(2)


def _furniture(axes: Axes, frame: _Frame) -> str:
    """Grid, ticks and labels."""
    beside = _ticks_beside(frame.x, frame.width)
    rows = {-float(row): shortened(name) for row, name in enumerate(axes.rows)}
    ticks = rows or frame.y.ticks(_most(frame.height))
    across = {value: frame.left + at for value, at in _places(frame, 0, beside)}
    down = {value: frame.top + at for value, at in _places(frame, 1, ticks)}
    low = frame.top + frame.height
    grid = "".join(f"M{at:.5g} {frame.top:g}V{low:.5g}" for at in across.values())
    grid += "" if rows else "".join(f"M{frame.left:.5g} {at:.5g}h{frame.width:.5g}" for at in down.values())
    words = [_word(beside[value], at, low + 14, "middle") for value, at in across.items()]
    words += [_word(ticks[value], frame.left - 5, at + 4, "end") for value, at in down.items()]
    words += [_word(axes.x_label, frame.left + frame.width / 2, low + 29, "middle")]
    words += [_word(axes.y_label, 0.0, 11, "start")] if axes.y_label else []
    edge = f"M{frame.left:.5g} {frame.top:g}V{low:.5g}h{frame.width:.5g}"
    lines = element("path", d=grid, class_="grid") + element("path", d=edge, class_="edge")
    return lines + "".join(words)


def _places(frame: _Frame, axis: int, ticks: dict[float, str]) -> list[tuple[float, float]]:
    """Where ticks stand, of those inside the frame."""
    values = np.array(list(ticks), dtype=float)
    points = np.full((len(values), 2), np.nan)
    points[:, axis] = values
    far = frame.pixels(points)[:, axis] if len(values) else values
    length = (frame.width, frame.height)[axis]
    return [(value, at) for value, at in zip(values.tolist(), far.tolist(), strict=True) if -0.5 <= at <= length + 0.5]


def _word(text: str, x: float, y: float, anchor: str) -> str:
    return element("text", text, x=round(x, 1), y=round(y, 1), text_anchor=anchor)


def _key(label: str, look: Look) -> Key:
    ends = np.array([[1.0, 6.0], [23.0, 6.0]]) if look.dash else np.array([[6.0, 6.0]])
    swatch = Look(look.colour, "", look.dash, look.width).drawn(ends) if look.dash else ""
    swatch += (
        Look(look.colour, look.mark, None, look.width, max(look.size, 5.0)).drawn(ends.mean(axis=0, keepdims=True)) if look.mark else ""
    )
    width = 24 if look.dash else 12
    return Key(label, element("svg", swatch, viewBox=f"0 0 {width} 12", width=width, height=12, aria_hidden="true"))


def row_height(rows: int) -> float:
    """Height [px] of a picture with so many rows."""
    return 16.0 * (rows + 0.6)


def row_ends(rows: int) -> tuple[float, float]:
    """Ends of y for rows at 0, -1, -2 ..."""
    return -(rows - 1) - 0.8, 0.8


def shortened(name: str) -> str:
    """A row's name, with its middle left out where it is too long to stand beside a picture."""
    if len(name) <= _MOST_NAME:
        return name
    head = _MOST_NAME // 2 - 1
    return f"{name[:head]}…{name[-(_MOST_NAME - head - 1) :]}"


def sane(values: Matrix) -> Matrix:
    """The values, nan where they are nothing that can be drawn."""
    return np.where(np.isfinite(values) & (np.abs(values) < SANE), values, np.nan)
