"""Fig. 4: how the estimated errors of case 1 came to rest, kind by kind, beside the errors that were put in."""

from __future__ import annotations

import numpy as np

from urdfcal.base.geometry import DEG, MM
from urdfcal.output.paper.estimates import last_protocol
from urdfcal.output.report.plots.axes import Axes
from urdfcal.output.report.plots.parameters import convergence_pictures
from urdfcal.output.report.plots.svg import Picture, draw_picture
from urdfcal.simulation.paper import Repeated

_PANELS = {
    "(a)": ("Estimated link length", "d_a", MM),
    "(b)": ("Estimated link offset", "d_d", MM),
    "(c)": ("Estimated link twist", "d_alpha", DEG),
    "(d)": ("Estimated joint disturbance", "d_theta", DEG),
}
_HEIGHT = 160  # [px]


def figure_pictures(repeated: Repeated) -> list[Picture]:
    """Panels (a) to (d); the thin line is the error that was put in on every joint."""
    drawn = {picture.title[:3]: picture for picture in convergence_pictures(repeated.first[last_protocol(repeated)])}
    return [_panel(repeated, key, drawn[key]) for key in _PANELS if key in drawn]


def _panel(repeated: Repeated, key: str, picture: Picture) -> Picture:
    title, kind, size = _PANELS[key]
    put_in = {float(value) for value in _true(repeated, kind) / size}

    def draw(axes: Axes) -> None:
        for value in put_in:
            axes.across(y=value)
        picture.draw(axes)

    return draw_picture("convergence", f"{key} {title}", "", _HEIGHT, draw)


def _true(repeated: Repeated, kind: str) -> np.ndarray:
    names = repeated.errors.names
    return repeated.truth[[column for column, name in enumerate(names) if name.endswith(f".{kind}")]]
