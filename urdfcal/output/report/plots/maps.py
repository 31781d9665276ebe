"""Maps of readings: where they were made, and where the robot model puts them, on the screen or in the planes of the measuring frame."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from urdfcal.base.geometry import Array3, Matrix, Vector
from urdfcal.output.report.plots.axes import Axes, Look
from urdfcal.output.report.plots.svg import SANE, Picture, draw_picture, look_of
from urdfcal.output.report.residuals import Residuals, Rows, numbered
from urdfcal.output.report.suspects import Suspect

MOST_NAMED = 12  # lasers or targets that a legend can hold
_MOST_ARROWS = 800  # in all planes of a set's map together
_LEAST_ARROWS = 20  # of a target in a plane
_WORST = 0.1  # share of the arrows that are the longest, where there are too many
_MOST_LABELS = 6
_LEAST_SIDES = (1.2, 0.45)  # width and height of a map over the other: three beside each other leave a page room
_MARGIN = 0.05  # for arrows that point outward, of the larger side
_PHASES = ("before", "after")
_MAPS = (("fit", 0), ("fit", 1), ("test", 1))
_PLANES = {2: ((0, 1),), 3: ((0, 1), (0, 2))}  # seen from above and from the side: all that there is of a point


def map_pictures(sets: Sequence[Residuals], suspects: Sequence[Suspect]) -> list[Picture]:
    """Measured and predicted places of spots and targets before and after; of test poses after calibration alone.

    Args:
        sets: Residuals; those of sensors that have a map are drawn.
        suspects: Readings that are named in the pictures.
    """
    numbers = numbered(sets)
    return [each.picture() for axes in _PLANES for each in _maps([own for own in sets if _axes(own) == axes], suspects, numbers)]


def map_words(sets: Sequence[Residuals], frame: str) -> list[str]:
    """How the maps are to be read: what marks are, and where."""
    drawn = [own for own in sets if own.places is not None]
    seen: dict[bool, list[str]] = {}
    for own in drawn:
        seen.setdefault(_on_screen(own), []).append(own.sensor.drawn)
    places = {True: "seen from the screen's +x side", False: f"in {frame}"}
    words = "; ".join(f"{' and '.join(dict.fromkeys(marks))}, {places[screen]}" for screen, marks in seen.items())
    return [f"In the maps, marks are {words}; arrows point to where the robot model puts them."] if words else []


def _axes(own: Residuals) -> int:
    return 0 if own.places is None else own.places.shape[2]


def _maps(drawn: Sequence[Residuals], suspects: Sequence[Suspect], numbers: Mapping[str, int]) -> Iterator[_Map]:
    """All maps of what is drawn in the same space; the maps of a plane have the same window, those of a phase the same magnification."""
    for plane in _PLANES[_axes(drawn[0])] if drawn else ():
        window = _window(drawn, plane)
        for label, phase in _MAPS:
            shown = [own for own in drawn if own.label == label]
            if not shown:
                continue
            named = [suspect for suspect in suspects if suspect.set == label and phase]
            sizes = [_sizes(own, phase) for own in drawn if own.label == "fit"]
            factor = magnification(window, np.concatenate(sizes)) if sizes else 1.0
            yield _Map(shown, phase, plane, window, factor, named, numbers)


def _window(drawn: Sequence[Residuals], plane: tuple[int, int]) -> Matrix:
    places = [own.places[:, :, plane].reshape(-1, 2) for own in drawn if own.places is not None]
    window = drawn_window(_good(np.concatenate(places)))
    return np.asarray(window + np.array([[-1.0], [1.0]]) * _MARGIN * np.ptp(window, axis=0).max())


def _on_screen(own: Residuals) -> bool:
    return own.sensor.seen_from == "screen"


def _sizes(own: Residuals, phase: int) -> Vector:
    return own.after_size if phase else own.before_size


@dataclass(frozen=True)
class _Map:
    shown: Sequence[Residuals]
    phase: int
    plane: tuple[int, int]
    window: Matrix
    factor: float
    suspects: Sequence[Suspect]
    numbers: Mapping[str, int]

    def picture(self) -> Picture:
        return draw_picture("maps", self._title(), self._caption(), 0.0, self._draw)

    def _title(self) -> str:
        first = self.shown[0]
        plane = f", {' and '.join(self._names())}" if len(_PLANES[_axes(first)]) > 1 else ""
        return f"{first.label.capitalize()} poses {_PHASES[self.phase]} calibration{plane}"

    def _names(self) -> list[str]:
        return [self.shown[0].sensor.components[axis] for axis in self.plane]

    def _caption(self) -> str:
        caption = "Arrows at true scale." if self.factor == 1 else f"Arrows magnified {self.factor:g} times."
        many = any(len(own.rows) > self._most for own in self.shown)
        return f"{caption} Of many, the worst and others of every size are drawn." if many else caption

    @property
    def _most(self) -> int:
        """How many arrows a laser or target may have."""
        return max(_MOST_ARROWS // len(_PLANES[_axes(self.shown[0])]) // len(self.shown), _LEAST_ARROWS)

    def _draw(self, axes: Axes) -> None:
        for own in self.shown:
            self._draw_arrows(axes, own)
        for suspect in self.suspects[:_MOST_LABELS]:
            self._draw_name(axes, suspect)
        axes.x_ends, axes.y_ends = ((float(low), float(high)) for low, high in self.window.T)
        on_screen = _on_screen(self.shown[0])
        axes.x_label, axes.y_label = (f"{name} on the screen in mm" if on_screen else f"{name} in mm" for name in self._names())
        axes.equal = True

    def _draw_arrows(self, axes: Axes, own: Residuals) -> None:
        sizes, residual = _sizes(own, self.phase), own.after if self.phase else own.before
        rows = thinned_rows(np.flatnonzero(np.isfinite(sizes) & (sizes < SANE)), sizes, self._most)
        tails, arrows = self._at(own)[rows], -residual[rows][:, self.plane] * self.factor
        colour, mark = look_of(self.numbers[own.name])
        label = own.name if 1 < len(self.shown) <= MOST_NAMED else ""
        axes.points(*arrow_lines(tails, arrows), Look(colour, dash="solid", width=0.9))
        once = np.unique(tails, axis=0)
        axes.points(once[:, 0], once[:, 1], Look(colour, mark, size=3.2), label)

    def _draw_name(self, axes: Axes, suspect: Suspect) -> None:
        for own in self.shown:
            if own.name == suspect.name:
                axes.name(suspect.pose, self._at(own)[suspect.row])

    def _at(self, own: Residuals) -> Matrix:
        """Where readings are in this plane, (n, 2)."""
        assert own.places is not None
        return np.asarray(own.places[self.phase][:, self.plane])


def drawn_window(points: Matrix) -> Matrix:
    """The piece of a plane that holds all points (n, 2), [[left, bottom], [right, top]], [mm]; neither slim nor empty."""
    low, high = (points.min(axis=0), points.max(axis=0)) if len(points) else (np.zeros(2), np.zeros(2))
    half = np.maximum((high - low) / 2 * 1.08, 1.0)
    half = np.maximum(half, half[::-1] * _LEAST_SIDES)
    return np.array([(low + high) / 2 - half, (low + high) / 2 + half])


def magnification(window: Matrix, sizes: Vector) -> float:
    """1, 2, 5, 10, 20 ... so that a usual arrow is seen and a long one stays in the picture."""
    seen = sizes[np.isfinite(sizes)]
    usual = float(np.median(seen)) if len(seen) else 0.0
    if not 0 < usual < SANE:
        return 1.0
    wanted = max(0.03 * float(np.ptp(window, axis=0).max()) / usual, 1.0)
    decade = 10.0 ** np.floor(np.log10(wanted))
    return float(decade * max(step for step in (1, 2, 5) if step * decade <= wanted * (1 + 1e-9)))


def thinned_rows(rows: Rows, sizes: Vector, most: int) -> Rows:
    """Of many rows the worst, and others of every size."""
    if len(rows) <= most:
        return rows
    order, worst = rows[np.argsort(sizes[rows])], int(most * _WORST)
    others = order[:-worst]
    return np.concatenate([others[np.linspace(0, len(others) - 1, most - worst).astype(int)], order[-worst:]])


def arrow_lines(tails: Matrix, arrows: Matrix) -> tuple[Vector, Vector]:
    """All arrows as one line with gaps, which is far smaller in SVG than a shape for each."""
    tips = tails + arrows
    side = arrows[:, ::-1] * (-1, 1)
    gap = np.full_like(tails, np.nan)
    strokes = np.stack([tails, tips, tips - 0.25 * arrows + 0.12 * side, tips, tips - 0.25 * arrows - 0.12 * side, gap], axis=1)
    return strokes[..., 0].ravel(), strokes[..., 1].ravel()


def _good(points: Matrix | Array3) -> Matrix:
    return np.asarray(points[(np.isfinite(points) & (np.abs(points) < SANE)).all(axis=1)])
