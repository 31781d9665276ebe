"""How well the touches of a place agree, before and after calibration."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from urdfcal.output.report.plots.axes import Axes, Look
from urdfcal.output.report.plots.marks import DOT, RING
from urdfcal.output.report.plots.svg import Picture, draw_picture, row_ends, row_height
from urdfcal.output.report.residuals import Residuals

MOST_PLACES = 30  # in a picture or a table; of more the worst are shown


@dataclass(frozen=True)
class PlaceScatter:
    """How well the touches of one place agree.

    Attributes:
        label: `fit` or `test`.
        kind: `plane` or `socket`.
        name: The place's label.
        touches: How many there are.
        before, after: Root of the mean squared distance with the nominal and with the calibrated robot, [mm].
    """

    label: str
    kind: str
    name: str
    touches: int
    before: float
    after: float


def scatter_of_places(sets: Sequence[Residuals]) -> list[PlaceScatter]:
    """The touches of every place, whatever touched it; fitted places first, each set's worst first."""
    found = [scatter for label in ("fit", "test") for scatter in _scatters([own for own in sets if own.label == label])]
    return sorted(found, key=lambda scatter: (scatter.label, -scatter.after))


def _scatters(sets: Sequence[Residuals]) -> Iterator[PlaceScatter]:
    touching = [own for own in sets if own.sensor.touches]
    for kind, name in dict.fromkeys((own.sensor.title, str(name)) for own in touching for name in own.touched):
        same = [own for own in touching if own.sensor.title == kind]
        sizes = [np.stack([own.before_size, own.after_size])[:, own.touched == name] for own in same]
        before, after = np.sqrt(np.mean(np.concatenate(sizes, axis=1) ** 2, axis=1)).tolist()
        yield PlaceScatter(touching[0].label, kind, name, sum(size.shape[1] for size in sizes), before, after)


def consistency_pictures(sets: Sequence[Residuals]) -> list[Picture]:
    """How far the touches of each place lie apart before and after calibration."""
    found = []
    scatters = scatter_of_places(sets)
    for label, kind in dict.fromkeys((scatter.label, scatter.kind) for scatter in scatters):
        own = [scatter for scatter in scatters if (scatter.label, scatter.kind) == (label, kind)]
        shown = own[:MOST_PLACES]
        caption = f"RMS distance of the touches from their {kind}; hollow with the nominal robot, filled with the calibrated one."
        caption += f" The worst {MOST_PLACES} of {len(own)}." if len(own) > MOST_PLACES else ""
        title = f"Consistency of {kind}s, {label} poses"
        found.append(draw_picture("consistency", title, caption, row_height(len(shown)), _Consistency(shown).draw))
    return found


@dataclass(frozen=True)
class _Consistency:
    scatters: Sequence[PlaceScatter]

    def draw(self, axes: Axes) -> None:
        height = -np.arange(len(self.scatters), dtype=float)
        before, after = (np.array([getattr(scatter, phase) for scatter in self.scatters]) for phase in ("before", "after"))
        gap = np.full_like(height, np.nan)
        axes.points(np.stack([before, after, gap], axis=1).ravel(), np.repeat(height, 3), Look("c0", dash="solid", width=0.8))
        axes.points(before, height, Look("c0", RING), "before")
        axes.points(after, height, Look("c0", DOT), "after")
        axes.rows = [scatter.name for scatter in self.scatters]
        axes.x_label, axes.y_ends = "RMS in mm", row_ends(len(self.scatters))
        axes.x_ends = (0.0, 1.06 * max(float(np.max([before, after])), 1e-6))
