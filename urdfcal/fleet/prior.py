"""What errors of a fleet's joints look like: prior variances by evidence over all of its robots.

Of each robot the data say a Gaussian of its joints' parameters, with information L and vector h, everything else marginalised out. With the
fleet's prior N(0, D), D the variance of each parameter's group, robot i has P_i = (L_i + D^-1)^-1 and x_i = P_i h_i, and

    log evidence = 1/2 sum_i [log det D^-1 - log det(L_i + D^-1) + h_i' P_i h_i]

is greatest where every group's variance is the sum of x^2 over that of 1 - P / D, how far the data decide it, of all robots. Whether robots
are alike shows where one is left out: its own evidence under the variances that the others have, beside that under the usual prior.

L is what a fit's posterior has beyond its prior, P^-1 - D^-1. Where that prior was chosen by the data, the posterior is a little wider than
the one of known variances, and L a little less.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from urdfcal.base.errors import InputError
from urdfcal.base.files import read_yaml
from urdfcal.base.geometry import DEG, MM, Array3, Matrix, Vector
from urdfcal.base.yaml_kinds import is_not
from urdfcal.model.parameters import DEFAULT_PRIORS, Parameter, PriorScale

LEAST_ROBOTS = 3
_GROUPS = ("translation", "rotation", "zero")
_ROUNDS, _STILL = 2000, 1e-6
_LEAST = {"translation": 1e-6, "rotation": 1e-6, "zero": 1e-6}  # [m] and [rad]: below, nothing is told from none
_WORDS = {"translation": ("translation_mm", MM), "rotation": ("rotation_deg", DEG), "zero": ("zero_deg", DEG)}


@dataclass(frozen=True, eq=False)
class Likelihood:
    """What a robot's data say of its joints.

    Attributes:
        names: Parameters.
        groups: `translation`, `rotation` or `zero` of each.
        information: L, (k, k).
        vector: h, (k,).
    """

    names: tuple[str, ...]
    groups: tuple[str, ...]
    information: Matrix
    vector: Vector

    @staticmethod
    def of(names: Sequence[str], units: Sequence[str], x: Vector, P: Matrix, prior_sigma: Vector) -> Likelihood:
        """From a posterior N(x, P) and the standard deviations of the prior before it, whose mean is zero."""
        scaled = np.linalg.inv(P / np.outer(prior_sigma, prior_sigma))
        size, V = np.linalg.eigh((scaled + scaled.T) / 2 - np.eye(len(x)))
        beyond = (V * np.maximum(size, 0.0)) @ V.T
        groups = tuple(Parameter(name, unit, "joint", 0.0, 1.0).scale_group for name, unit in zip(names, units, strict=True))
        vector = (beyond @ (x / prior_sigma) + x / prior_sigma) / prior_sigma
        return Likelihood(tuple(names), groups, beyond / np.outer(prior_sigma, prior_sigma), vector)

    def posterior(self, variance: Vector) -> tuple[Vector, Matrix]:
        """X and P under a prior with these variances, (k,)."""
        P: Matrix = np.asarray(np.linalg.inv(self.information + np.diag(1 / variance)), dtype=np.float64)
        return P @ self.vector, P

    def evidence(self, scales: Mapping[str, float]) -> float:
        """Log evidence of the data, but for a constant."""
        variance = self.variances(scales)
        x, P = self.posterior(variance)
        return 0.5 * (float(np.linalg.slogdet(P)[1]) - float(np.log(variance).sum()) + float(self.vector @ x))

    def variances(self, scales: Mapping[str, float]) -> Vector:
        """Of every parameter's group."""
        return np.array([scales[group] ** 2 for group in self.groups])


@dataclass(frozen=True)
class FleetPrior:
    """Standard deviations of the joints' errors over a fleet, [m] and [rad].

    Attributes:
        scales: By group.
        counts: How many parameters of how many robots decided each, as an effective number.
        gains: By robot: log evidence under the others' prior less that under the usual one, [nats].
    """

    scales: Mapping[str, float]
    counts: Mapping[str, float]
    gains: Mapping[str, float]


def fleet_prior(robots: Mapping[str, Likelihood]) -> FleetPrior | None:
    """The prior of a fleet, each of its robots left out in turn; None of fewer than three."""
    if len(robots) < LEAST_ROBOTS:
        return None
    scales, counts = _scales(list(robots.values()))
    usual = {group: DEFAULT_PRIORS["joint"].sigma("m" if group == "translation" else "rad") for group in _GROUPS}
    gains = {}
    for name, own in robots.items():
        others, _ = _scales([other for each, other in robots.items() if each != name], scales)
        gains[name] = own.evidence(usual | others) - own.evidence(usual)
    return FleetPrior(scales, counts, gains)


@dataclass(frozen=True, eq=False)
class _Alike:
    """Robots with the same parameters, stacked: information (r, k, k), vector (r, k), groups of the parameters."""

    groups: tuple[str, ...]
    information: Array3
    vector: Matrix

    @staticmethod
    def stacked(robots: Sequence[Likelihood]) -> list[_Alike]:
        """Robots by their parameters."""
        alike: dict[tuple[str, ...], list[Likelihood]] = {}
        for own in robots:
            alike.setdefault(own.names, []).append(own)
        return [
            _Alike(own[0].groups, np.array([each.information for each in own]), np.array([each.vector for each in own]))
            for own in alike.values()
        ]

    def told(self, scales: Mapping[str, float]) -> tuple[Vector, Vector]:
        """Of every parameter, over all of the robots: sums of x^2, and of how far the data decide it."""
        variance = np.array([scales[group] ** 2 for group in self.groups])
        P = np.linalg.inv(self.information + np.diag(1 / variance))
        x = (P @ self.vector[..., None])[..., 0]
        return np.sum(x**2, axis=0), np.sum(1 - np.diagonal(P, axis1=1, axis2=2) / variance, axis=0)


def _scales(robots: Sequence[Likelihood], start: Mapping[str, float] | None = None) -> tuple[dict[str, float], dict[str, float]]:
    """Standard deviations by group, and how many numbers decided each: MacKay's fixed point, where the evidence is greatest."""
    stacks = _Alike.stacked(robots)
    present = [group for group in _GROUPS if any(group in own.groups for own in stacks)]
    usual = DEFAULT_PRIORS["joint"]
    scales = {group: (start or {}).get(group, usual.sigma("m" if group == "translation" else "rad") / 10) for group in present}
    for _ in range(_ROUNDS):
        squares, counts = dict.fromkeys(present, 0.0), dict.fromkeys(present, 0.0)
        for own in stacks:
            for group, square, count in zip(own.groups, *own.told(scales), strict=True):
                squares[group] += float(square)
                counts[group] += float(count)
        new = {group: max(float(np.sqrt(squares[group] / max(counts[group], 1e-9))), _LEAST[group]) for group in present}
        still = max((abs(np.log(new[group] / scales[group])) for group in present), default=0.0) < _STILL
        scales = new
        if still:
            break
    return scales, counts


def prior_entries(prior: FleetPrior) -> dict[str, Any]:
    """The content of prior.yaml."""
    return {
        "urdfcal": "prior",
        "robots": len(prior.gains),
        "joint": {_WORDS[group][0]: float(f"{scale / _WORDS[group][1]:.6g}") for group, scale in prior.scales.items()},
        "told_by": {group: round(count, 1) for group, count in prior.counts.items()},
        "left_out_nats": {name: round(gain, 2) for name, gain in prior.gains.items()},
    }


def read_prior(path: str | Path) -> PriorScale:
    """The joints' prior of a prior.yaml.

    Raises:
        InputError: the file is none.
    """
    file = read_yaml(path, InputError)
    content = file.content
    if not isinstance(content, dict) or content.get("urdfcal") != "prior" or not isinstance(content.get("joint"), dict):
        raise InputError(is_not("prior", content, "joint", "fleet"), path)
    stated, usual = content["joint"], DEFAULT_PRIORS["joint"]
    scales = {"translation": usual.translation, "rotation": usual.rotation, "zero": usual.rotation}
    for group, (word, size) in _WORDS.items():
        value = stated.get(word)
        if value is None:
            continue
        if isinstance(value, bool) or not isinstance(value, int | float) or not 1e-9 < value < 1e6:
            raise InputError(f"entry 'joint.{word}': found {value!r}, expected a number above zero", path, file.line(("joint", word)))
        scales[group] = value * size
    return PriorScale(scales["translation"], scales["rotation"], scales["zero"])
