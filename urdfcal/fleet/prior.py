"""What errors of a fleet's joints look like: how large they are, and which of them all robots share; each robot left out in turn.

Whether robots are alike shows where one is left out: its own evidence under what the others say, beside that under the usual prior.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from urdfcal.fleet.likelihood import Alike, Likelihood
from urdfcal.fleet.scales import USUAL, for_the_next, without_each
from urdfcal.fleet.shared import Fleet, Shared, fleet_of, with_shared

LEAST_ROBOTS = 3
_EXACTLY = 30  # robots up to which the others are looked at anew without each


@dataclass(frozen=True)
class FleetPrior:
    """Standard deviations of the joints' errors over a fleet, [m] and [rad].

    Attributes:
        scales: By group, for another robot of it.
        counts: How many parameters of how many robots decided each, as an effective number.
        gains: By robot: log evidence under what the others say less that under the usual prior, [nats].
        shared: Errors that all robots have, around which theirs are of these scales.
        model: The robots' name in their description.
    """

    scales: Mapping[str, float]
    counts: Mapping[str, float]
    gains: Mapping[str, float]
    shared: Sequence[Shared] = ()
    model: str = ""


def fleet_prior(robots: Mapping[str, Likelihood], model: str = "") -> FleetPrior | None:
    """The prior of robots of one model; None of fewer than three."""
    if len(robots) < LEAST_ROBOTS:
        return None
    fleet, shared = with_shared(Alike.stacked(list(robots.values())))
    others = _one_by_one(robots, fleet) if len(robots) <= _EXACTLY else _at_once(robots, fleet)
    usual = {name: own.evidence(USUAL) for name, own in robots.items()}
    gains = {name: robots[name].evidence(USUAL | scales, mean) - usual[name] for name, (scales, mean) in others.items()}
    return FleetPrior(for_the_next(fleet.about, fleet.scales, fleet.counts), fleet.counts, gains, shared, model)


def _one_by_one(robots: Mapping[str, Likelihood], fleet: Fleet) -> dict[str, tuple[dict[str, float], dict[str, float]]]:
    """Scales and mean of the others, by robot."""
    found = {}
    for name in robots:
        rest = fleet_of(Alike.stacked([other for each, other in robots.items() if each != name]), fleet.names, fleet.scales)
        found[name] = for_the_next(rest.about, rest.scales, rest.counts), rest.shared
    return found


def _at_once(robots: Mapping[str, Likelihood], fleet: Fleet) -> dict[str, tuple[dict[str, float], dict[str, float]]]:
    """The same of many, among which one changes little: the mean stays, and scales move as their fixed point does."""
    alike: dict[tuple[str, ...], list[str]] = {}
    for name, own in robots.items():
        alike.setdefault(own.names, []).append(name)
    order = [name for names in alike.values() for name in names]
    return {name: (scales, fleet.shared) for name, scales in zip(order, without_each(fleet.about, fleet.scales), strict=True)}
