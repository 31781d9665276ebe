"""Pictures of residuals: how often which size occurs against what noise alone would show, and number by number against the pose."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from urdfcal.base.geometry import Vector
from urdfcal.output.report.plots.axes import DASHES, Axes, Look
from urdfcal.output.report.plots.maps import MOST_NAMED, thinned_rows
from urdfcal.output.report.plots.marks import OPEN
from urdfcal.output.report.plots.svg import SANE, Picture, draw_picture, look_of
from urdfcal.output.report.residuals import Residuals, numbered

_FAR = 6  # times the median size: what lies beyond shares the last bin
_MOST_MARKS = 1500  # in all pictures of components together
_LEAST_MARKS = 40


def size_pictures(sets: Sequence[Residuals]) -> list[Picture]:
    """How often which size of residual occurs before and after, each kind of reading on its own."""
    kinds, numbers = dict.fromkeys(own.sensor.noise for own in sets), numbered(sets)
    return [picture for kind in kinds for picture in _sizes_of_kind(kind, sets, numbers)]


def _sizes_of_kind(kind: str, sets: Sequence[Residuals], numbers: Mapping[str, int]) -> list[Picture]:
    fitted, tested = ([own for own in sets if (own.sensor.noise, own.label) == (kind, label)] for label in ("fit", "test"))
    noun, found = (fitted or tested)[0].sensor.words.several, []
    noun = noun[0].upper() + noun[1:]
    if fitted:
        sizes = [own.before_size for own in fitted]
        found.append(_histogram(f"{noun} before", "Fitted poses, nominal robot.", fitted, sizes, numbers, noise=False))
    for label, shown in (("fit", fitted), ("test", tested)):
        if shown:
            title, text = f"{noun} after, {label} poses", "The line is what noise alone would show."
            found.append(_histogram(title, text, shown, [own.after_size for own in shown], numbers, noise=True))
    return found


def _histogram(
    title: str, caption: str, shown: Sequence[Residuals], sizes: Sequence[Vector], numbers: Mapping[str, int], noise: bool
) -> Picture:
    kept = [size[np.isfinite(size) & (size < SANE)] for size in sizes]
    together = np.concatenate(kept)
    edges = size_bins(together)
    far = int(np.count_nonzero(together > edges[-1]))
    caption += f" The last bin also holds {far} farther away." if far else ""
    counts = [np.histogram(np.minimum(size, edges[-1]), edges)[0] for size in kept]
    words = shown[0].sensor.words

    def draw(axes: Axes) -> None:
        for index, (own, count) in enumerate(zip(shown, counts, strict=True)):
            look = Look(look_of(numbers[own.name])[0], dash=DASHES[index % len(DASHES)])
            axes.steps(count, edges, look, own.name if 1 < len(shown) <= MOST_NAMED else "")
        if noise and len(together):
            alone = _noise_alone(shown, edges, len(together) / sum(len(size) > 0 for size in kept))
            axes.points(*alone, Look("ink", dash="solid", width=1.1), "noise alone")
        axes.x_label, axes.y_label = f"{words.apart} from measured to predicted in {words.unit}", "readings"
        axes.x_ends, axes.y_ends = (0.0, float(edges[-1])), (0.0, 1.25 * max(1, *(int(count.max()) for count in counts), 1))

    return draw_picture("histograms", title, caption, 120, draw)


def size_bins(sizes: Vector) -> Vector:
    """Bins from zero to the farthest, or to where nothing but outliers would be."""
    farthest = min(float(sizes.max(initial=0.0)), _FAR * float(np.median(sizes))) if sizes.size else 0.0
    return np.linspace(0, farthest * 1.02 or 1.0, min(max(int(np.sqrt(sizes.size)) + 2, 8), 30))


def _noise_alone(shown: Sequence[Residuals], edges: Vector, readings: float) -> tuple[Vector, Vector]:
    """How many of so many readings to expect in a bin at any size: the length of k normal numbers has the chi distribution."""
    size = np.linspace(0, edges[-1], 160)
    sigma = np.concatenate([np.sqrt(np.nanmean(own.sigma**2, axis=1)) for own in shown])
    sigma = np.quantile(sigma[np.isfinite(sigma)], np.linspace(0, 1, 21))
    k = max(round(float(np.mean(np.concatenate([own.numbers for own in shown])))), 1)
    ratio = size[:, None] / sigma
    density = np.mean(ratio ** (k - 1) * np.exp(-0.5 * ratio**2) / sigma, axis=1) * 2 ** (1 - k / 2) / math.gamma(k / 2)
    return size, readings * (edges[1] - edges[0]) * density


def component_pictures(sets: Sequence[Residuals]) -> list[Picture]:
    """What is left of each reading's numbers after calibration, against the pose: drifts and jumps show here."""
    most = max(_MOST_MARKS // max(sum(own.sensor.numbers for own in sets), 1), _LEAST_MARKS)
    numbers = numbered(sets)
    return [_components(own, most, numbers[own.name]) for own in sets]


def _components(own: Residuals, most: int, number: int) -> Picture:
    sizes, names = own.after_size, own.sensor.components
    rows = np.sort(thinned_rows(np.flatnonzero(np.isfinite(sizes) & (sizes < SANE)), sizes, most))

    def draw(axes: Axes) -> None:
        for index, column in enumerate(own.after[rows].T):
            look = Look(look_of(number)[0], OPEN[index], size=4.0 if index else 3.4)
            axes.points(np.asarray(own.rows[rows] + 1.0), np.asarray(column), look, names[index] if names else "")
        axes.across(y=0.0)
        axes.x_label, axes.y_label, axes.whole = f"{own.label} pose, in the file's order", f"residual in {own.unit}", True

    caption = f"Of {len(own.rows)} the worst and others of every size are drawn." if len(rows) < len(own.rows) else ""
    return draw_picture("components", f"{own.name}, {own.label} poses", caption, 120, draw)
