"""Pictures of readings: where targets were measured and predicted, how far that is apart, and how well touches of a place agree."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from urdfcal.base.geometry import Array3, Matrix, Vector
from urdfcal.output.report.reading_residuals import AT_PLACES, ReadingResiduals
from urdfcal.output.report.residual_plots import MOST_LABELS, arrow_lines, distance_bins, drawn_window, magnification, thinned_rows
from urdfcal.output.report.residuals import Suspect
from urdfcal.output.report.svg import DASHES, INK, MARKERS, SANE, SERIES, Picture, draw_picture

if TYPE_CHECKING:
    from matplotlib.axes import Axes


MOST_PLACES = 30  # in a picture or a table; of more the worst are shown
_PLANES = ((0, 1), (0, 2), (1, 2))
_MARGIN = 0.05  # for arrows that point outward, of the larger side
_MOST_NAMED = 12  # targets that a legend can hold
_MOST_ARROWS = 200  # in a plane, of all targets together
_MOST_MARKS = 1500  # in all pictures of components together
_PHASES = ("before", "after")
_NOUNS = {
    "point": "Points",
    "orientation": "Orientations",
    "distance": "Measured distances",
    "pixel": "Pixels",
    "plane": "Touches of planes",
    "socket": "Touches of sockets",
}


def place_pictures(sets: Sequence[ReadingResiduals], suspects: Sequence[Suspect], frame: str) -> list[Picture]:
    """Measured and predicted places of targets in the three planes of the measuring frame; test poses after calibration alone.

    Args:
        sets: Readings; those that say where a target was are drawn.
        suspects: Readings that are named in the pictures.
        frame: What the measuring frame is called.
    """
    found = []
    drawn = [each for each in sets if each.kind in AT_PLACES]
    for label, phase in (("fit", 0), ("fit", 1), ("test", 1)):
        own = [each for each in drawn if each.label == label]
        fitted = [each for each in drawn if each.label == "fit"]
        named = [suspect for suspect in suspects if suspect.set == label and phase]
        found += [_Places(own, fitted, drawn, phase, plane, frame, named).picture() for plane in _PLANES if own]
    return found


@dataclass(frozen=True)
class _Places:
    own: list[ReadingResiduals]
    fitted: list[ReadingResiduals]
    drawn: list[ReadingResiduals]
    phase: int
    plane: tuple[int, int]
    frame: str
    suspects: list[Suspect]

    def picture(self) -> Picture:
        window = drawn_window(_good(np.concatenate([each.places[:, :, self.plane].reshape(-1, 2) for each in self.drawn])))
        window += np.array([[-1.0], [1.0]]) * _MARGIN * np.ptp(window, axis=0).max()
        factor = magnification(window, np.concatenate([self._sizes(each) for each in self.fitted]))
        one, other = ("xyz"[axis] for axis in self.plane)
        scale = "at true scale" if factor == 1 else f"magnified {factor:g} times"
        marks = "Marks are sockets" if all(each.kind == "socket" for each in self.own) else "Marks are measured points"
        caption = f"{marks}, in {self.frame}; arrows, {scale}, point to where the robot model puts the target."
        if any(len(each.rows) > self._most for each in self.own):
            caption += " Of many, the worst and others of every size are drawn."
        width, height = np.ptp(window, axis=0)
        title = f"{self.own[0].label.capitalize()} poses {_PHASES[self.phase]} calibration, {one} and {other}"
        return draw_picture("readings", title, caption, 0.95 + 3.67 * float(height / width), lambda axes: self.draw(axes, window, factor))

    @property
    def _most(self) -> int:
        """How many arrows a target may have."""
        return max(_MOST_ARROWS // len(self.own), 20)

    def _sizes(self, each: ReadingResiduals) -> Vector:
        return each.after_size if self.phase else each.before_size

    def draw(self, axes: Axes, window: Matrix, factor: float) -> None:
        for index, each in enumerate(self.own):
            sizes, residual = self._sizes(each), each.after if self.phase else each.before
            rows = thinned_rows(np.flatnonzero(np.isfinite(sizes) & (sizes < SANE)), sizes, self._most)
            tails, arrows = each.places[self.phase][rows][:, self.plane], -residual[rows][:, self.plane] * factor
            colour = SERIES[index % len(SERIES)]
            label = each.name if 1 < len(self.own) <= _MOST_NAMED else "_none"
            axes.plot(*arrow_lines(tails, arrows), color=colour, linewidth=0.8, solid_joinstyle="miter")
            axes.plot(*np.unique(tails, axis=0).T, MARKERS[index % len(MARKERS)], color=colour, markersize=2.4, label=label)
        for suspect in self.suspects[:MOST_LABELS]:
            self._name(axes, suspect)
        (left, bottom), (right, top) = window
        axes.set(xlim=(left, right), ylim=(bottom, top), xlabel=f"{'xyz'[self.plane[0]]} in mm", ylabel=f"{'xyz'[self.plane[1]]} in mm")
        axes.set_aspect("equal")
        axes.locator_params(nbins=5)

    def _name(self, axes: Axes, suspect: Suspect) -> None:
        for each in self.own:
            if each.name == suspect.laser:
                at = each.places[1][suspect.row][list(self.plane)]
                axes.annotate(suspect.pose, at, (3, 3), textcoords="offset points", fontsize=8, clip_on=True)


def component_pictures(sets: Sequence[ReadingResiduals]) -> list[Picture]:
    """What is left of each reading's numbers after calibration, against the pose: drifts and jumps show here."""
    most = max(_MOST_MARKS // max(sum(each.after.shape[1] for each in sets), 1), 40)
    return [_components(each, most) for each in sets]


def _components(each: ReadingResiduals, most: int) -> Picture:
    sizes, named = each.after_size, each.after.shape[1] == 3
    rows = np.sort(thinned_rows(np.flatnonzero(np.isfinite(sizes) & (sizes < SANE)), sizes, most))

    def draw(axes: Axes) -> None:
        for index, column in enumerate(each.after[rows].T):
            label = "xyz"[index] if named else "_none"
            axes.plot(each.rows[rows] + 1, column, MARKERS[index], color=SERIES[index], markersize=2.6, linewidth=0, label=label)
        axes.axhline(0, color=INK, linewidth=0.8)
        axes.set(xlabel=f"{each.label} pose, in the file's order", ylabel=f"residual in {each.unit}")

    caption = "Measured less predicted by the calibrated robot, number by number."
    caption += f" Of {len(each.rows)} the worst and others of every size are drawn." if len(rows) < len(each.rows) else ""
    return draw_picture("components", f"{each.name}: residuals of {each.label} poses after calibration", caption, 2.8, draw)


def size_pictures(sets: Sequence[ReadingResiduals]) -> list[Picture]:
    """How often which size of residual occurs before and after, each kind of reading on its own."""
    found = []
    for kind in dict.fromkeys(each.kind for each in sets):
        noun = _NOUNS.get(kind, kind.capitalize())
        fitted, tested = ([each for each in sets if (each.kind, each.label) == (kind, label)] for label in ("fit", "test"))
        found.append(
            _histogram(f"{noun} before calibration", "Fitted poses, nominal robot.", fitted, [e.before_size for e in fitted], False)
        )
        for label, own in (("fit", fitted), ("test", tested)):
            if own:
                text = "The line is what noise alone would show."
                found.append(_histogram(f"{noun} after calibration, {label} poses", text, own, [e.after_size for e in own], True))
    return found


def _histogram(title: str, caption: str, own: Sequence[ReadingResiduals], sizes: Sequence[Vector], noise: bool) -> Picture:
    kept = [size[np.isfinite(size) & (size < SANE)] for size in sizes]
    together = np.concatenate(kept)
    edges = distance_bins(together)
    far = int(np.count_nonzero(together > edges[-1]))
    caption += f" The last bin also holds {far} farther away." if far else ""
    counts = [np.histogram(np.minimum(size, edges[-1]), edges)[0] for size in kept]
    highest = max(1, *(int(each.max()) for each in counts), 1)

    def draw(axes: Axes) -> None:
        for index, (each, count) in enumerate(zip(own, counts, strict=True)):
            colour, label = SERIES[index % len(SERIES)], each.name if len(own) <= _MOST_NAMED else "_none"
            axes.stairs(count, edges, fill=True, color=colour, alpha=0.18)
            axes.stairs(count, edges, color=colour, linestyle=DASHES[index % 4], linewidth=1.4, label=label)
        if noise and len(together):
            axes.plot(*_noise_alone(own, edges, len(together) / sum(len(each) > 0 for each in kept)), color=INK, label="noise alone")
        what = "angle" if own[0].unit == "deg" else "distance"
        axes.set(
            xlabel=f"{what} from measured to predicted in {own[0].unit}", ylabel="readings", xlim=(0, edges[-1]), ylim=(0, 1.25 * highest)
        )

    return draw_picture("histograms", title, caption, 2.8, draw)


def _noise_alone(own: Sequence[ReadingResiduals], edges: Vector, readings: float) -> tuple[Vector, Vector]:
    """How many of so many readings to expect in a bin at any size: the length of k normal numbers has the chi distribution."""
    size = np.linspace(0, edges[-1], 160)
    sigma = np.concatenate([np.sqrt(np.nanmean(each.sigma**2, axis=1)) for each in own])
    sigma = np.quantile(sigma[np.isfinite(sigma)], np.linspace(0, 1, 21))
    k = max(round(float(np.mean(np.concatenate([each.numbers for each in own])))), 1)
    ratio = size[:, None] / sigma
    density = np.mean(ratio ** (k - 1) * np.exp(-0.5 * ratio**2) / sigma, axis=1) * 2 ** (1 - k / 2) / math.gamma(k / 2)
    return size, readings * (edges[1] - edges[0]) * density


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


def scatter_of_places(sets: Sequence[ReadingResiduals]) -> list[PlaceScatter]:
    """The touches of every place, whatever touched it; fitted places first, each set's worst first."""
    found = [scatter for label in ("fit", "test") for scatter in _scatters([each for each in sets if each.label == label])]
    return sorted(found, key=lambda scatter: (scatter.label, -scatter.after))


def _scatters(sets: Sequence[ReadingResiduals]) -> Iterator[PlaceScatter]:
    touching = [each for each in sets if each.kind in ("plane", "socket")]
    for kind, name in dict.fromkeys((each.kind, str(name)) for each in touching for name in each.touched):
        sizes = [np.stack([each.before_size, each.after_size])[:, each.touched == name] for each in touching if each.kind == kind]
        before, after = np.sqrt(np.mean(np.concatenate(sizes, axis=1) ** 2, axis=1)).tolist()
        yield PlaceScatter(touching[0].label, kind, name, sum(size.shape[1] for size in sizes), before, after)


def consistency_pictures(sets: Sequence[ReadingResiduals]) -> list[Picture]:
    """How far the touches of each place lie apart before and after calibration."""
    found = []
    scatters = scatter_of_places(sets)
    for label, kind in dict.fromkeys((scatter.label, scatter.kind) for scatter in scatters):
        own = [scatter for scatter in scatters if (scatter.label, scatter.kind) == (label, kind)]
        shown = own[:MOST_PLACES]
        caption = f"RMS distance of the touches from their {kind}; hollow with the nominal robot, filled with the calibrated one."
        caption += f" The worst {MOST_PLACES} of {len(own)}." if len(own) > MOST_PLACES else ""
        height = 0.8 + 0.2 * len(shown)
        found.append(draw_picture("consistency", f"Consistency of {kind}s, {label} poses", caption, height, _Consistency(shown).draw))
    return found


@dataclass(frozen=True)
class _Consistency:
    scatters: Sequence[PlaceScatter]

    def draw(self, axes: Axes) -> None:
        height = -np.arange(len(self.scatters), dtype=float)
        before, after = (np.array([getattr(each, phase) for each in self.scatters]) for phase in _PHASES)
        axes.hlines(height, np.minimum(before, after), np.maximum(before, after), color=SERIES[0], linewidth=0.8)
        look: Any = {"linewidth": 0, "color": SERIES[0], "markersize": 4}
        axes.plot(before, height, "o", markerfacecolor="none", **look)
        axes.plot(after, height, "o", **look)
        axes.set_yticks(height, [each.name for each in self.scatters], fontsize=9.5)
        axes.set(xlabel="RMS in mm", ylim=(height[-1] - 0.8, 0.8), xlim=(0, 1.06 * max(float(np.max([before, after])), 1e-6)))
        axes.grid(False, axis="y")


def _good(points: Matrix | Array3) -> Matrix:
    return np.asarray(points[(np.isfinite(points) & (np.abs(points) < SANE)).all(axis=1)])
