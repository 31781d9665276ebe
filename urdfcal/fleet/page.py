"""A fleet on a page: how good each robot became, who stands out, each parameter over all of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from urdfcal.base.geometry import Vector
from urdfcal.base.terminal import displayed, many, rounded
from urdfcal.fleet.outcome import USES, WHEN, Outcome, by_model, units_of
from urdfcal.fleet.prior import FleetPrior
from urdfcal.fleet.prior_file import prior_name
from urdfcal.fleet.told import opening, shared_words
from urdfcal.fleet.unlike import StandsOut
from urdfcal.model.parameters import Parameter
from urdfcal.output.report.document import Table
from urdfcal.output.report.html import filled_page
from urdfcal.output.report.plots.axes import Axes, Look
from urdfcal.output.report.plots.svg import Picture, draw_picture, row_ends, row_height

_INTERVAL = 1.96
_MOST_ROWS = 40  # robots that a picture names
_MOST_NAMED = 12  # robots of whom the same is said
_UNBROKEN = "\N{NO-BREAK SPACE}"


def fleet_page(outcomes: Sequence[Outcome], priors: Sequence[FleetPrior], unlike: Sequence[StandsOut]) -> str:
    """The page, as an HTML document."""
    good = [own for own in outcomes if own.result]
    models = by_model(outcomes)
    of_model = {prior.model: prior for prior in priors}
    parameters = [each for model, own in models.items() for each in _parameters(own, of_model.get(model), model if len(models) > 1 else "")]
    return filled_page(
        "fleet.html.j2",
        opening=[f"{line[0].upper()}{line[1:]}." for line in opening(outcomes)],
        level="good" if len(good) == len(outcomes) and all(own.use != "no" for own in good) else "note",
        robots=_robots(outcomes),
        said=_said(outcomes),
        unlike=_unlike(unlike),
        shared=[f"{said[0].upper()}{said[1:]}." for said in shared_words(priors)],
        priors=[(prior_name(prior, priors), _prior(prior), _gains(prior)) for prior in priors],
        pictures={"accuracy": _accuracy(good), "parameters": parameters},
    )


def _robots(outcomes: Sequence[Outcome]) -> Table:
    """A row a robot; columns in which nobody has anything are left out."""
    known = [(when, unit) for unit in units_of(outcomes) for when in WHEN if any(np.isfinite(own.mean(when, unit)) for own in outcomes)]
    rows = []
    for own in outcomes:
        figures = (_figure(own.mean(*each)) for each in known)
        verdict = USES[own.use].replace(" ", _UNBROKEN)
        rows.append((own.name, verdict, str(own.result.get("poses", {}).get("count", "–")), *figures))
    return Table(("robot", "verdict", "poses", *(f"{when}, {unit}" for when, unit in known)), tuple(rows), words=2)


def _said(outcomes: Sequence[Outcome]) -> Table | None:
    """What is held against robots, those of whom the same is said together, failed ones first."""
    said: dict[tuple[str, str], list[str]] = {}
    for use in reversed(USES):
        for own in outcomes:
            if own.use == use and own.said:
                said.setdefault((USES[use].replace(" ", _UNBROKEN), own.said), []).append(own.name)
    if not said:
        return None
    rows = [(verdict, why, _listed(names)) for (verdict, why), names in said.items()]
    return Table(("verdict", "what is said", "robots"), tuple(rows), words=3)


def _listed(names: Sequence[str]) -> str:
    more = f" and {len(names) - _MOST_NAMED} more" if len(names) > _MOST_NAMED else ""
    return ", ".join(names[:_MOST_NAMED]) + more


def _figure(value: float) -> str:
    return rounded(value, 3) if np.isfinite(value) else "–"


def _unlike(unlike: Sequence[StandsOut]) -> Table | None:
    if not unlike:
        return None
    rows = []
    for own in unlike:
        unit, size = displayed(own.unit)
        rows.append((own.robot, own.what, rounded(own.value / size, 3), rounded(own.median / size, 3), unit, f"{own.times:+.1f}"))
    return Table(("robot", "what", "its own", "fleet's median", "unit", "σ off"), tuple(rows), words=2)


def _prior(prior: FleetPrior) -> Table:
    rows = []
    for group, scale in prior.scales.items():
        unit, size = displayed("m" if group == "translation" else "rad")
        rows.append((f"{group}s of joints", rounded(scale / size, 3), unit, f"{prior.counts[group]:.0f}"))
    return Table(("errors", "standard deviation", "unit", "numbers that told"), tuple(rows))


def _gains(prior: FleetPrior) -> str:
    gains, robots = np.array(list(prior.gains.values())), many(len(prior.gains), "robot")
    of = f" of {prior.model}" if prior.model else ""
    return (
        f"{robots}{of}, each left out in turn: under what the others say, its measurements are more probable than under the usual prior "
        f"for {int((gains > 0).sum())} of {len(gains)}, by {rounded(np.median(gains), 2)} nats in the median."
    )


def _accuracy(good: Sequence[Outcome]) -> list[Picture]:
    """Before and after, a picture for each unit that is read."""
    found = []
    for unit in units_of(good) if good else ():
        own = [each for each in good if np.isfinite(each.mean("after", unit))]
        shown = sorted(own, key=lambda each: -each.mean("after", unit))[:_MOST_ROWS]
        caption = "Mean distance from measured to predicted" + (
            f"; the {_MOST_ROWS} worst of {len(own)}." if len(own) > len(shown) else "."
        )
        found.append(draw_picture("accuracy", f"Before and after, in {unit}", caption, row_height(len(shown)), _Accuracy(shown, unit).draw))
    return found


@dataclass(frozen=True)
class _Accuracy:
    robots: Sequence[Outcome]
    unit: str

    def draw(self, axes: Axes) -> None:
        place = -np.arange(len(self.robots), dtype=float)
        seen: list[Vector] = []
        for when, look in (("before", Look("soft", "o")), ("after", Look("c0", "o")), ("test", Look("c1", "D"))):
            values = np.array([own.mean(when, self.unit) for own in self.robots])
            if np.isfinite(values).any():
                seen.append(values[values > 0])
                axes.points(np.where(values > 0, values, np.nan), place, look, {"test": "after, of test poses"}.get(when, when))
        axes.rows = [own.name for own in self.robots]
        all_seen = np.concatenate(seen) if seen else np.empty(0)
        if len(all_seen):
            axes.x_kind, axes.x_ends = "log", (0.7 * float(all_seen.min()), 1.4 * float(all_seen.max()))
        axes.x_label, axes.y_ends = f"in {self.unit}", row_ends(len(self.robots))


def _parameters(good: Sequence[Outcome], prior: FleetPrior | None, model: str) -> list[Picture]:
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
            title = f"{title}: {model}" if model else title
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
            shared = {own.name: own.value for own in self.prior.shared}
            middle = np.array([shared.get(name, 0.0) for name in self.values]) / size
            axes.bars(middle - half, middle + half, place, "band")
        axes.across(x=0.0)
        for row, own in zip(place, self.values.values(), strict=True):
            axes.points(np.array(own) / size, np.full(len(own), row), Look("c0", "o", size=4.0))
        axes.rows = list(self.values)
        axes.x_label, axes.y_ends = f"in {unit}", row_ends(len(self.values))
