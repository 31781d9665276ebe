"""What is drawn in one pair of axes: lines, marks, steps, bars and names, in the units of the data."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from urdfcal.base.geometry import Matrix, Vector
from urdfcal.output.report.plots.elements import element
from urdfcal.output.report.plots.marks import is_open, line_path, marks_path
from urdfcal.output.report.plots.scales import Kind, Scale, around

Dash = Literal["solid", "dashed", "dotted", "dashdot"]
ToPixels = Callable[[Matrix], Matrix]

DASHES: tuple[Dash, ...] = ("solid", "dashed", "dotted", "dashdot")
_PATTERNS: dict[Dash, str | None] = {"solid": None, "dashed": "5 3", "dotted": "1.5 2.5", "dashdot": "6 2.5 1.5 2.5"}
_MARK_SPACING = 10  # marks at most on a line that has more points than can be told apart


@dataclass(frozen=True)
class Look:
    """How something is drawn.

    Attributes:
        colour: Class of the page that holds the colour: `c0` to `c7`, `ink`, `soft`, `band`.
        mark: Shape of marks, of `marks.SHAPES`; the empty string for none.
        dash: Of the line; None for no line.
        width: Of the line, [px].
        size: Of the marks, [px].
    """

    colour: str
    mark: str = ""
    dash: Dash | None = None
    width: float = 1.4
    size: float = 5.0

    def drawn(self, points: Matrix) -> str:
        """A line through points (n, 2) [px], marks at them, or both."""
        line = (
            element("path", d=line_path(points), fill="none", stroke_width=self.width, stroke_dasharray=_PATTERNS[self.dash])
            if self.dash
            else ""
        )
        every = max(len(points) // _MARK_SPACING, 1) if self.dash and len(points) > 4 * _MARK_SPACING else 1
        marks = marks_path(points[::every], self.mark, self.size) if self.mark else ""
        bare = {"fill": "none", "stroke_width": 1.2} if self.mark and is_open(self.mark) else {"stroke": "none"}
        return element("g", line + (element("path", d=marks, **bare) if marks else ""), class_=self.colour)


@dataclass
class Axes:
    """A pair of axes that is being drawn in.

    Attributes:
        x_label, y_label: What stands at the axes.
        x_ends, y_ends: Their ends; found from what is drawn where they are None.
        x_kind, y_kind: Their scales.
        whole: Whether x has ticks at whole numbers alone.
        equal: Whether a unit is as long on both.
        rows: Names at y = 0, -1, -2 ... in place of ticks.
        keys: What the legend says, in reading order.
    """

    x_label: str = ""
    y_label: str = ""
    x_ends: tuple[float, float] | None = None
    y_ends: tuple[float, float] | None = None
    x_kind: Kind = "linear"
    y_kind: Kind = "linear"
    whole: bool = False
    equal: bool = False
    rows: Sequence[str] = ()
    keys: dict[str, Look] = field(default_factory=dict)
    _layers: list[Callable[[ToPixels], str]] = field(default_factory=list)
    _seen: list[Matrix] = field(default_factory=list)

    def points(self, x: Vector, y: Vector, look: Look, label: str = "") -> None:
        """A line, marks or both through points (n,), (n,); nan makes a gap."""
        at = np.stack(np.broadcast_arrays(np.asarray(x, dtype=float), np.asarray(y, dtype=float)), axis=1)
        self._add(lambda pixels: look.drawn(pixels(at)), at, label, look)

    def steps(self, counts: Vector, edges: Vector, look: Look, label: str = "") -> None:
        """A histogram of counts (n,) between edges (n + 1,), lightly filled."""
        x, y = np.repeat(edges, 2), np.concatenate([[0.0], np.repeat(counts, 2), [0.0]])
        at = np.stack([x, y], axis=1)

        def layer(pixels: ToPixels) -> str:
            area = element("path", d=line_path(pixels(at)) + "z", stroke="none", opacity=0.18)
            return element("g", area, class_=look.colour) + look.drawn(pixels(at))

        self._add(layer, at, label, look)

    def bars(self, low: Vector, high: Vector, rows: Vector, colour: str) -> None:
        """Bars along x from low (n,) to high (n,), one at each row (n,)."""
        corners = np.stack([np.stack([low, rows - 0.4], axis=1), np.stack([high, rows + 0.4], axis=1)])

        def layer(pixels: ToPixels) -> str:
            ends = np.round([pixels(corner) for corner in corners], 1)
            boxes = "".join(
                f"M{left:g} {down:g}H{right:g}V{up:g}H{left:g}z" for (left, down), (right, up) in ends.transpose(1, 0, 2).tolist()
            )
            return element("path", d=boxes, class_=colour, stroke="none")

        self._layers.append(layer)

    def across(self, *, x: float | None = None, y: float | None = None) -> None:
        """A line from end to end at this x or y."""

        def layer(pixels: ToPixels) -> str:
            far = 1e4  # [px], beyond any picture
            at = pixels(np.array([[x if x is not None else np.nan, y if y is not None else np.nan]]))[0]
            ends = [[at[0], -far], [at[0], far]] if x is not None else [[-far, at[1]], [far, at[1]]]
            return Look("ink", dash="solid", width=0.8).drawn(np.array(ends))

        self._layers.append(layer)

    def name(self, text: str, at: Vector) -> None:
        """A word beside a point (2,)."""

        def layer(pixels: ToPixels) -> str:
            x, y = np.round(pixels(np.asarray(at, dtype=float)[None])[0], 1).tolist()
            return element("text", text, x=x + 4, y=y - 4, class_="ink") if np.isfinite([x, y]).all() else ""

        self._layers.append(layer)

    def scales(self) -> tuple[Scale, Scale]:
        """Of x and y."""
        seen = np.concatenate(self._seen) if self._seen else np.zeros((0, 2))
        x, y = self.x_ends or around(seen[:, 0]), self.y_ends or around(seen[:, 1])
        return Scale(*x, self.x_kind, self.whole), Scale(*y, self.y_kind)

    def drawn(self, pixels: ToPixels) -> str:
        """All that is in the axes."""
        return "".join(layer(pixels) for layer in self._layers)

    def _add(self, layer: Callable[[ToPixels], str], at: Matrix, label: str, look: Look) -> None:
        self._layers.append(layer)
        self._seen.append(at)
        if label:
            self.keys[label] = look
