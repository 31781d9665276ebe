"""A fleet on a page: how good each robot became, who stands out, each parameter over all of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from urdfcal.base.geometry import Vector
from urdfcal.base.terminal import displayed, many, rounded
from urdfcal.fleet.outcome import Outcome, StandsOut
from urdfcal.fleet.prior import FleetPrior
from urdfcal.model.parameters import Parameter
from urdfcal.output.report.document import Table
from urdfcal.output.report.html import filled_page
from urdfcal.output.report.plots.axes import Axes, Look
from urdfcal.output.report.plots.svg import Picture, draw_picture, row_ends, row_height

_INTERVAL = 1.96
_MOST_ROWS = 40  # robots that a picture names
_USE = {"yes": "can be used", "reservations": "with reservations", "no": "do not use", "failed": "failed"}


def fleet_page(outcomes: Sequence[Outcome], prior: FleetPrior | None, unlike: Sequence[StandsOut]) -> str:
    """The page, as an HTML document."""
    good = [own for own in outcomes if own.result]
    drawn = {"accuracy": _accuracy(good), "parameters": _parameters(good, prior)}
    return filled_page(
        "fleet.html.j2",
        opening=_opening(outcomes),
        level="good" if len(good) == len(outcomes) and all(own.use != "no" for own in good) else "note",
        robots=_robots(outcomes),
        unlike=_unlike(unlike),
        prior=_prior(prior),
        gains=_gains(prior),
        pictures=drawn,
    )


def _opening(outcomes: Sequence[Outcome]) -> list[str]:
    counts = {use: sum(own.use == use for own in outcomes) for use in _USE}
    said = [f"{many(len(outcomes), 'robot')}: " + ", ".join(f"{count} {_USE[use]}" for use, count in counts.items() if count) + "."]
    good = [own for own in outcomes if own.result]
    if good:
        before, after = ([own.mean_mm(when) for own in good] for when in ("before", "after"))
        said.append(
            f"Mean distance from measured to predicted, over robots: median {rounded(np.median(before), 3)} mm before and "
            f"{rounded(np.median(after), 3)} mm after; the worst {rounded(max(before), 3)} mm before and {rounded(max(after), 3)} mm after."
        )
    return said


def _robots(outcomes: Sequence[Outcome]) -> Table:
    rows = [
        (own.name, _USE[own.use], own.said, str(own.row()["poses"]), *(_mm(own.mean_mm(when)) for when in ("before", "after", "test")))
        for own in outcomes
    ]
    return Table(("robot", "verdict", "what is said", "poses", "before, mm", "after, mm", "test, mm"), tuple(rows), words=3)


def _mm(value: float) -> str:
    return rounded(value, 3) if np.isfinite(value) else "–"


def _unlike(unlike: Sequence[StandsOut]) -> Table | None:
    if not unlike:
        return None
    rows = []
    for own in unlike:
        unit, size = displayed(own.unit)
        rows.append((own.robot, own.what, rounded(own.value / size, 3), rounded(own.median / size, 3), unit, f"{own.times:+.1f}"))
    return Table(("robot", "what", "its own", "fleet's median", "unit", "σ off"), tuple(rows), words=2)


def _prior(prior: FleetPrior | None) -> Table | None:
    if prior is None:
        return None
    rows = []
    for group, scale in prior.scales.items():
        unit, size = displayed("m" if group == "translation" else "rad")
        rows.append((f"{group}s of joints", rounded(scale / size, 3), unit, f"{prior.counts[group]:.0f}"))
    return Table(("errors", "standard deviation", "unit", "numbers that told"), tuple(rows))


def _gains(prior: FleetPrior | None) -> str:
    if prior is None:
        return ""
    gains = np.array(list(prior.gains.values()))
    return (
        f"Each robot left out in turn: under the prior of the others its measurements are the more probable than under the usual one for "
        f"{int((gains > 0).sum())} of {len(gains)}, by {rounded(np.median(gains), 2)} nats in the median."
    )


def _accuracy(good: Sequence[Outcome]) -> list[Picture]:
    if not good:
        return []
    shown = sorted(good, key=lambda own: -own.mean_mm("after"))[:_MOST_ROWS]
    caption = "Mean distance from measured to predicted" + (f"; the {_MOST_ROWS} worst of {len(good)}." if len(good) > len(shown) else ".")
    return [draw_picture("accuracy", "Before and after", caption, row_height(len(shown)), _Accuracy(shown).draw)]


@dataclass(frozen=True)
class _Accuracy:
    robots: Sequence[Outcome]

    def draw(self, axes: Axes) -> None:
        place = -np.arange(len(self.robots), dtype=float)
        seen: list[Vector] = []
        for when, look in (("before", Look("soft", "o")), ("after", Look("c0", "o")), ("test", Look("c1", "D"))):
            values = np.array([own.mean_mm(when) for own in self.robots])
            if np.isfinite(values).any():
                seen.append(values[values > 0])
                axes.points(np.where(values > 0, values, np.nan), place, look, {"test": "after, of test poses"}.get(when, when))
        axes.rows = [own.name for own in self.robots]
        all_seen = np.concatenate(seen) if seen else np.empty(0)
        if len(all_seen):
            axes.x_kind, axes.x_ends = "log", (0.7 * float(all_seen.min()), 1.4 * float(all_seen.max()))
        axes.x_label, axes.y_ends = "in mm", row_ends(len(self.robots))


def _parameters(good: Sequence[Outcome], prior: FleetPrior | None) -> list[Picture]:
    """Every joint parameter of all robots, lengths and angles apart, over the band of the fleet's prior."""
    found = []
    for unit_si, title in (("m", "Lengths over the fleet"), ("rad", "Angles over the fleet")):
        values: dict[str, list[float]] = {}
        for own in good:
            joints = set(own.joints.get("names", ()))
            for parameter in own.result["parameters"]:
                if parameter["name"] in joints and parameter["unit"] == unit_si and parameter["determined"]:
                    values.setdefault(parameter["name"], []).append(parameter["value"])
        if values:
            unit, _ = displayed(unit_si)
            caption = f"A mark a robot, in {unit}" + ("; the band is the fleet's prior (95 %)." if prior is not None else ".")
            found.append(draw_picture("parameters", title, caption, row_height(len(values)), _Spread(values, unit_si, prior).draw))
    return found


@dataclass(frozen=True)
class _Spread:
    values: dict[str, list[float]]
    unit: str
    prior: FleetPrior | None

    def draw(self, axes: Axes) -> None:
        unit, size = displayed(self.unit)
        place = -np.arange(len(self.values), dtype=float)
        if self.prior is not None:
            groups = [Parameter(name, self.unit, "joint", 0.0, 1.0).scale_group for name in self.values]
            half = _INTERVAL * np.array([self.prior.scales.get(group, np.nan) for group in groups]) / size
            axes.bars(-half, half, place, "band")
        axes.across(x=0.0)
        for row, own in zip(place, self.values.values(), strict=True):
            axes.points(np.array(own) / size, np.full(len(own), row), Look("c0", "o", size=4.0))
        axes.rows = list(self.values)
        axes.x_label, axes.y_ends = f"in {unit}", row_ends(len(self.values))
