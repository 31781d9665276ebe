"""Errors that all robots of a model share: their description is wrong, and not they.

Robots' errors are N(m, D) then, with few entries of m that are not zero. Which ones is found by evidence, one after the other: each entry
that comes in has a usual prior of its own, and must be the more probable by as much as there are others that it might have been.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from urdfcal.base.geometry import Matrix, Vector
from urdfcal.fleet.likelihood import Alike
from urdfcal.fleet.scales import USUAL, scales_of

_SURE = 3.0  # [nats] beyond what the choice among parameters costs: 20 to 1
_MOST = 6  # entries; where there are more, it is another robot
_ROUNDS, _STILL = 50, 1e-4


@dataclass(frozen=True)
class Shared:
    """An error that all robots share.

    Attributes:
        name: Parameter.
        unit: m or rad.
        value: [m] or [rad].
        sigma: Standard deviation.
        gain: How much more probable it makes the data, [nats].
    """

    name: str
    unit: str
    value: float
    sigma: float
    gain: float


@dataclass(frozen=True, eq=False)
class Fleet:
    """Robots with their scales and the mean of their errors.

    Attributes:
        stacks: The robots.
        names: Whose mean is not zero.
        scales: By group.
        counts: Numbers that decided each.
        mean: Of those, [m] and [rad].
        covariance: Of the mean.
        evidence: Log evidence, the mean marginalised out.
    """

    stacks: Sequence[Alike]
    names: tuple[str, ...]
    scales: Mapping[str, float]
    counts: Mapping[str, float]
    mean: Vector
    covariance: Matrix
    evidence: float

    @property
    def shared(self) -> dict[str, float]:
        """The mean by name."""
        return dict(zip(self.names, self.mean.tolist(), strict=True))

    @property
    def about(self) -> list[Alike]:
        """What is left of the robots' errors beyond it."""
        return [own.about(self.shared) for own in self.stacks]


def fleet_of(stacks: Sequence[Alike], names: Sequence[str] = (), start: Mapping[str, float] | None = None) -> Fleet:
    """Scales and mean together, where these parameters have a mean."""
    mean: Vector = np.zeros(len(names))
    scales, counts, told = dict(start or {}), dict[str, float](), (np.zeros(0), np.zeros((0, 0)))
    width = _widths(stacks, names)
    for _ in range(_ROUNDS if names else 1):
        scales, counts = scales_of([own.about(dict(zip(names, mean.tolist(), strict=True))) for own in stacks], scales)
        told = _of_mean(stacks, names, scales)
        new = np.asarray(np.linalg.solve(told[1] + np.diag(1 / width**2), told[0]), dtype=np.float64)
        moved = float(np.max(np.abs(new - mean) / width, initial=0.0))
        mean = new
        if moved < _STILL:
            break
    covariance = np.asarray(np.linalg.inv(told[1] + np.diag(1 / width**2)), dtype=np.float64)
    evidence = sum(own.evidence(scales) for own in stacks) + 0.5 * float(told[0] @ mean)
    evidence += 0.5 * float(np.linalg.slogdet(covariance)[1] - 2 * np.log(width).sum())
    return Fleet(stacks, tuple(names), scales, counts, mean, covariance, evidence)


def with_shared(stacks: Sequence[Alike]) -> tuple[Fleet, list[Shared]]:
    """The fleet with what all of its robots share."""
    fleet, gains = fleet_of(stacks), list[float]()
    every = sorted({name for own in stacks for name in own.names})
    seen = np.diag(_of_mean(stacks, every, fleet.scales)[1]) * _widths(stacks, every) ** 2 > 1
    candidates = max(int(seen.sum()), 1)  # what nobody sees cannot be it
    while len(gains) < _MOST and (name := _most_probable(fleet)):
        wider = fleet_of(stacks, (*fleet.names, name), fleet.scales)
        if wider.evidence - fleet.evidence < _SURE + np.log(candidates):
            break
        gains.append(wider.evidence - fleet.evidence)
        fleet = wider
    units = _units(stacks)
    rows = zip(fleet.names, fleet.mean.tolist(), np.sqrt(np.diag(fleet.covariance)).tolist(), gains, strict=True)
    return fleet, [Shared(name, units[name], value, sigma, gain) for name, value, sigma, gain in rows]


def _most_probable(fleet: Fleet) -> str:
    """The parameter whose mean would gain the most at these scales; empty where none is left."""
    left = sorted({name for own in fleet.stacks for name in own.names} - set(fleet.names))
    if not left:
        return ""
    b, A = _of_mean(fleet.about, left, fleet.scales)
    A_own, width = np.diag(A), _widths(fleet.stacks, left)
    gain = 0.5 * (b**2 / (A_own + 1 / width**2) - np.log1p(width**2 * A_own))
    return left[int(np.argmax(gain))]


def _of_mean(stacks: Sequence[Alike], names: Sequence[str], scales: Mapping[str, float]) -> tuple[Vector, Matrix]:
    """What all robots say of these entries of the mean, the others being zero: vector and information."""
    b, A = np.zeros(len(names)), np.zeros((len(names), len(names)))
    for own in stacks:
        at = [names.index(name) for name in own.names if name in names]
        theirs = [index for index, name in enumerate(own.names) if name in names]
        information, vector = own.of_mean(scales)
        b[at] += vector.sum(axis=0)[theirs]
        A[np.ix_(at, at)] += information.sum(axis=0)[np.ix_(theirs, theirs)]
    return b, A


def _units(stacks: Sequence[Alike]) -> dict[str, str]:
    return {name: "m" if group == "translation" else "rad" for own in stacks for name, group in zip(own.names, own.groups, strict=True)}


def _widths(stacks: Sequence[Alike], names: Sequence[str]) -> Vector:
    groups = {name: group for own in stacks for name, group in zip(own.names, own.groups, strict=True)}
    return np.array([USUAL[groups[name]] for name in names])
