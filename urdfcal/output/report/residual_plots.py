"""Pictures of spots: where they were measured and predicted, and how far that is apart."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from urdfcal.base.geometry import MM, Array3, Matrix, Vector
from urdfcal.output.report.residuals import SpotResiduals, Suspect
from urdfcal.output.report.svg import DASHES, INK, MARKERS, SANE, SERIES, Picture, draw_picture

if TYPE_CHECKING:
    from matplotlib.axes import Axes


MOST_ARROWS = 400  # a laser; of more spots the worst and others of every size are drawn
MOST_WORST = 40
MOST_LABELS = 6
_FAR = 6  # times the median distance: what lies beyond shares the last bin


def screen_pictures(residuals: Sequence[SpotResiduals], suspects: Sequence[Suspect]) -> list[Picture]:
    """Measured and predicted spots before and after, of the fitted and the test poses, all on the same piece of the screen."""
    if not residuals:
        return []
    window = drawn_window(np.concatenate([each.data.spots[each.data.seen] for each in residuals]) / MM)
    factors = [magnification(window, distance) for distance in (residuals[0].before_mm, residuals[0].after_mm)]
    found = []
    for spots in residuals:
        own = [suspect for suspect in suspects if suspect.set == spots.label]
        found += [
            _screen_picture("before", spots.before_mm, _Screen(spots, spots.before, factors[0], window, [])),
            _screen_picture("after", spots.after_mm, _Screen(spots, spots.after, factors[1], window, own)),
        ]
    return found


def _screen_picture(phase: str, distance_mm: Matrix, screen: _Screen) -> Picture:
    scale = "at true scale" if screen.factor == 1 else f"magnified {screen.factor:g} times"
    caption = f"Marks are measured spots, seen from the screen's +x side; arrows, {scale}, point to where the robot model puts them."
    rows = _thinned(distance_mm)
    if any(len(kept) == MOST_ARROWS for kept in rows):
        caption += f" Of many spots, the worst {MOST_WORST} and others of every size are drawn."
    width, height = np.ptp(screen.window, axis=0)
    title = f"{screen.spots.label.capitalize()} poses {phase} calibration"
    return draw_picture("spots", title, caption, 0.95 + 3.67 * float(height / width), lambda axes: screen.draw(axes, rows))


def drawn_window(points: Matrix) -> Matrix:
    """The piece of a plane that holds all points (n, 2), [[left, bottom], [right, top]], [mm]; neither slim nor empty."""
    low, high = (points.min(axis=0), points.max(axis=0)) if len(points) else (np.zeros(2), np.zeros(2))
    half = np.maximum((high - low) / 2 * 1.08, 1.0)
    half = np.maximum(half, half[::-1] * (0.85, 0.4))
    return np.array([(low + high) / 2 - half, (low + high) / 2 + half])


def magnification(window: Matrix, distance_mm: Matrix | Vector) -> float:
    """1, 2, 5, 10, 20 ... so that a usual arrow is seen and a long one stays in the picture."""
    seen = distance_mm[np.isfinite(distance_mm)]
    usual = float(np.median(seen)) if len(seen) else 0.0
    if not 0 < usual < SANE:
        return 1.0
    wanted = max(0.03 * float(np.ptp(window, axis=0).max()) / usual, 1.0)
    decade = 10.0 ** np.floor(np.log10(wanted))
    return float(decade * max(step for step in (1, 2, 5) if step * decade <= wanted * (1 + 1e-9)))


def _thinned(distance_mm: Matrix) -> list[Any]:
    """For each laser the rows that are drawn."""
    return [thinned_rows(np.flatnonzero(np.isfinite(column) & (column < SANE)), column) for column in distance_mm.T]


def thinned_rows(rows: Any, distance_mm: Vector, most: int = MOST_ARROWS) -> Any:
    """Of many rows the worst, and others of every size."""
    if len(rows) <= most:
        return rows
    order, worst = rows[np.argsort(distance_mm[rows])], most * MOST_WORST // MOST_ARROWS
    others = order[:-worst]
    return np.concatenate([others[np.linspace(0, len(others) - 1, most - worst).astype(int)], order[-worst:]])


@dataclass(frozen=True)
class _Screen:
    spots: SpotResiduals
    predicted: Array3
    factor: float
    window: Matrix
    suspects: list[Suspect]

    def draw(self, axes: Axes, rows_by_laser: list[Any]) -> None:
        data = self.spots.data
        for index, (laser, rows) in enumerate(zip(data.lasers, rows_by_laser, strict=True)):
            measured, colour = data.spots[rows, index] / MM, SERIES[index % len(SERIES)]
            arrows = (self.predicted[rows, index] / MM - measured) * self.factor
            axes.plot(*arrow_lines(measured, arrows), color=colour, linewidth=0.8, solid_joinstyle="miter")
            axes.plot(*measured.T, MARKERS[index % len(MARKERS)], color=colour, markersize=2.4, label=laser)
        for suspect in self.suspects[:MOST_LABELS]:
            axes.annotate(
                suspect.pose, data.spots[suspect.row, suspect.column] / MM, (3, 3), textcoords="offset points", fontsize=8, clip_on=True
            )
        left_bottom, right_top = self.window
        axes.set(xlim=(left_bottom[0], right_top[0]), ylim=(left_bottom[1], right_top[1]))
        axes.set(xlabel="y on the screen in mm", ylabel="z on the screen in mm")
        axes.set_aspect("equal")


def arrow_lines(tails: Matrix, arrows: Matrix) -> tuple[Vector, Vector]:
    """All arrows as one line with gaps, which is far smaller in SVG than a shape for each."""
    tips = tails + arrows
    side = arrows[:, ::-1] * (-1, 1)
    gap = np.full_like(tails, np.nan)
    strokes = np.stack([tails, tips, tips - 0.25 * arrows + 0.12 * side, tips, tips - 0.25 * arrows - 0.12 * side, gap], axis=1)
    return strokes[..., 0].ravel(), strokes[..., 1].ravel()


def histogram_pictures(residuals: Sequence[SpotResiduals]) -> list[Picture]:
    """How often which distance occurs, before and after."""
    if not residuals:
        return []
    fitted = residuals[0]
    found = [_histogram("Distances before calibration", "Fitted poses, nominal robot.", fitted, fitted.before_mm, None)]
    text = "The line is what noise alone would show."
    for spots in residuals:
        found.append(_histogram(f"Distances after calibration, {spots.label} poses", text, spots, spots.after_mm, spots.sigma / MM))
    return found


def _histogram(title: str, caption: str, spots: SpotResiduals, distance_mm: Matrix, sigma_mm: Matrix | None) -> Picture:
    good = np.isfinite(distance_mm) & (distance_mm < SANE)
    edges = distance_bins(distance_mm[good])
    far = int(np.count_nonzero(distance_mm[good] > edges[-1]))
    distance_mm = np.minimum(distance_mm, edges[-1])
    caption += f" The last bin also holds {far} farther away." if far else ""
    counts = [np.histogram(own[seen], edges)[0] for own, seen in zip(distance_mm.T, good.T, strict=True)]
    highest = max(1, *(int(each.max()) for each in counts))

    def draw(axes: Axes) -> None:
        for index, laser in enumerate(spots.data.lasers):
            colour, style = SERIES[index % len(SERIES)], DASHES[index % 4]
            axes.stairs(counts[index], edges, fill=True, color=colour, alpha=0.18)
            axes.stairs(counts[index], edges, color=colour, linestyle=style, linewidth=1.4, label=laser)
        if sigma_mm is not None and good.any():
            axes.plot(*_noise_alone(sigma_mm[good], edges, good.sum() / good.any(axis=0).sum()), color=INK, label="noise alone")
        axes.set(xlabel="distance from measured to predicted spot in mm", ylabel="spots", xlim=(0, edges[-1]), ylim=(0, 1.25 * highest))

    return draw_picture("histograms", title, caption, 2.8, draw)


def distance_bins(distances: Vector) -> Vector:
    """Bins from zero to the farthest, or to where nothing but outliers would be."""
    farthest = min(float(distances.max(initial=0.0)), _FAR * float(np.median(distances))) if distances.size else 0.0
    return np.linspace(0, farthest * 1.02 or 1.0, min(max(int(np.sqrt(distances.size)) + 2, 8), 30))


def _noise_alone(sigma_mm: Vector, edges: Vector, spots: float) -> tuple[Vector, Vector]:
    """How many of so many spots to expect in a bin, at any distance, when the coordinates have these standard deviations."""
    distance = np.linspace(0, edges[-1], 160)
    sigma = np.quantile(sigma_mm, np.linspace(0, 1, 21))
    density = np.mean(distance[:, None] / sigma**2 * np.exp(-0.5 * (distance[:, None] / sigma) ** 2), axis=1)
    return distance, spots * (edges[1] - edges[0]) * density
