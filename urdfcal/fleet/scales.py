"""How large errors of robots' joints are: prior variances by evidence over all robots.

With the prior N(0, D), D the variance of each parameter's group, the log evidence of all robots is greatest where every group's variance is
the sum of x^2 over that of 1 - P / D, how far the data decide it, of all robots: MacKay's fixed point.

Few robots tell of a variance with a chi-squared of few degrees of freedom, and no errors at all are the most probable where they are below
what is seen. The next robot is to be told neither: its prior's variance is the mean over what the evidence leaves of it, all standard
deviations up to the usual one being as probable before.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from urdfcal.base.geometry import Matrix, Vector
from urdfcal.fleet.likelihood import Alike
from urdfcal.model.parameters import DEFAULT_PRIORS

GROUPS = ("translation", "rotation", "zero")
USUAL = {group: DEFAULT_PRIORS["joint"].sigma("m" if group == "translation" else "rad") for group in GROUPS}
_ROUNDS, _STILL = 2000, 1e-6
_LEAST = 1e-6  # [m] and [rad]: below, nothing is told from none
_MANY = 20.0  # numbers from which the mean of a variance is that of a chi-squared
_GRID = 25
_STEP = 0.02  # of a logarithm, for differences


def scales_of(stacks: Sequence[Alike], start: Mapping[str, float] | None = None) -> tuple[dict[str, float], dict[str, float]]:
    """Standard deviations by group where the evidence is greatest, and how many numbers decided each."""
    present = present_in(stacks)
    scales, counts = {group: (start or {}).get(group, USUAL[group] / 10) for group in present}, dict.fromkeys(present, 0.0)
    for _ in range(_ROUNDS):
        squares, counts = sums(stacks, scales)
        new = {group: max(float(np.sqrt(squares[group] / max(counts[group], 1e-9))), _LEAST) for group in present}
        still = max((abs(np.log(new[group] / scales[group])) for group in present), default=0.0) < _STILL
        scales = new
        if still:
            break
    return scales, counts


def present_in(stacks: Sequence[Alike]) -> list[str]:
    """Groups of which there are parameters."""
    return [group for group in GROUPS if any(group in own.groups for own in stacks)]


def sums(stacks: Sequence[Alike], scales: Mapping[str, float]) -> tuple[dict[str, float], dict[str, float]]:
    """By group: sums of x^2 over all robots, and of how far the data decide it."""
    squares, counts = (total.sum(axis=0) for total in by_robot(stacks, scales))
    return dict(zip(scales, squares.tolist(), strict=True)), dict(zip(scales, counts.tolist(), strict=True))


def by_robot(stacks: Sequence[Alike], scales: Mapping[str, float]) -> tuple[Matrix, Matrix]:
    """The same of each robot, (r, groups) in the order of the stacks and scales."""
    parts = []
    for own in stacks:
        member = np.array([[name == group for group in scales] for name in own.groups], dtype=float)
        parts.append([told @ member for told in own.told(scales)])
    return np.concatenate([part[0] for part in parts]), np.concatenate([part[1] for part in parts])


def without_each(stacks: Sequence[Alike], scales: Mapping[str, float]) -> list[dict[str, float]]:
    """The same without each robot in turn, in the order of the stacks.

    By the derivative of the fixed point: for many robots, of which none says much.
    """
    squares, counts = by_robot(stacks, scales)

    def moved(by: Vector) -> Vector:
        other = {group: scale * float(np.exp(step)) for (group, scale), step in zip(scales.items(), by, strict=True)}
        new = np.divide(*(np.maximum(part.sum(axis=0), 1e-300) for part in by_robot(stacks, other)))
        return np.asarray(0.5 * np.log(new) - np.log(list(scales.values())))

    still = moved(np.zeros(len(scales)))
    slope = np.column_stack([(moved(_STEP * axis) - still) / _STEP for axis in np.eye(len(scales))])
    rest = np.maximum(squares.sum(axis=0) - squares, 1e-300) / np.maximum(counts.sum(axis=0) - counts, 1e-9)
    off = 0.5 * np.log(rest) - np.log(list(scales.values()))
    logs = np.log(list(scales.values())) + np.linalg.solve(np.eye(len(scales)) - slope, off.T).T
    return [dict(zip(scales, np.maximum(np.exp(row), _LEAST).tolist(), strict=True)) for row in logs]


def for_the_next(stacks: Sequence[Alike], scales: Mapping[str, float], counts: Mapping[str, float]) -> dict[str, float]:
    """Standard deviations that another robot may be told."""
    return {
        group: scale * float(np.sqrt(counts[group] / (counts[group] - 3))) if counts[group] > _MANY else _mean(stacks, scales, group)
        for group, scale in scales.items()
    }


def _mean(stacks: Sequence[Alike], scales: Mapping[str, float], group: str) -> float:
    tried = np.geomspace(max(_LEAST, 0.02 * min(scales[group], USUAL[group])), USUAL[group], _GRID)
    logs = np.array([sum(own.evidence({**scales, group: float(scale)}) for own in stacks) for scale in tried])
    weight = np.exp(logs - logs.max()) * tried
    return float(np.sqrt(weight @ tried**2 / weight.sum()))
