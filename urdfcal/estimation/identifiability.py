"""What the data can decide and what they decided: rank, hidden directions, combinations, observability indices.

Everything is measured against the prior: with the whitened Jacobian H and the prior standard deviations D, the singular values of
H D tell how many times narrower than its prior the data make each direction of the state. A parameter, or a combination, is
*determined* when its posterior standard deviation is under half its prior one; a direction is *hidden* when no spot moves with it
at all. Where the data determine a sum alone, a term whose prior is much wider than its partners' falls under half of it by what holds
the partners and not by the data, so that no term of such a sum counts as determined.

Observability indices of L seen directions with singular values s_1 >= ... >= s_L from m poses:

    O1 = (s_1 ... s_L)^(1/L) / sqrt(m)     Borm and Menq, 1989/1991
    O2 = s_L / s_1                         Driels and Pathre, 1990
    O3 = s_L                               Nahvi, Hollerbach and Hayward, 1994
    O4 = s_L^2 / s_1                       Nahvi and Hollerbach, 1996
    O5 = 1 / (1/s_1 + ... + 1/s_L)         Sun and Hollerbach, 2008
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from urdfcal.base.geometry import Matrix, Vector
from urdfcal.base.terminal import many

DETERMINED = 0.5  # posterior over prior standard deviation
HIDDEN = 1e-9  # share of the largest singular value under which a direction moves no spot
_MOST_TERMS = 6  # of a combination in words
_NEGLIGIBLE = 0.02  # share of a direction's largest component that is not worth a word
_MOSTLY = 0.5  # share of a parameter's variance that open directions must make up for it to be a term of what is seen as sums alone


@dataclass(frozen=True)
class Combination:
    """A weighted sum of parameters.

    Attributes:
        terms: Weight of each parameter.
        value: The sum at the estimate, [m] or [rad] times the weights.
        sigma: Its posterior standard deviation.
        determined: Whether the data decided it.
        left: Share of its prior standard deviation that the data left.
    """

    terms: dict[str, float]
    value: float
    sigma: float
    determined: bool
    left: float

    def words(self) -> str:
        """`joint1.d_d + joint2.d_d`."""
        return in_words(self.terms)


@dataclass(frozen=True)
class Identifiability:
    """What a fit decided.

    Attributes:
        rank: Number of directions of the state that the data determined.
        determined: For each parameter, whether its sigma is under half its prior's, and not because a partner's prior is narrow.
        combinations: For the parameters that are not: the sums that are determined, then the directions that are not.
        left: For each parameter the share of its prior standard deviation that the data left.
    """

    rank: int
    determined: tuple[bool, ...]
    combinations: tuple[Combination, ...]
    left: tuple[float, ...]


def identify(names: Sequence[str], x: Vector, P: Matrix, prior_sigma: Vector) -> Identifiability:
    """Tell from a posterior what the data decided.

    In units of the prior the covariance is between 0 and I; the eigenvectors whose variance stays above DETERMINED^2 are the
    directions that the data left open.

    Args:
        names: Parameter names, (p,).
        x: Estimate, (p,).
        P: Posterior covariance, (p, p).
        prior_sigma: Prior standard deviations, (p,).
    """
    scaled = P / np.outer(prior_sigma, prior_sigma)
    variances, directions = np.linalg.eigh(scaled)
    wide = variances >= DETERMINED**2
    open_ = directions[:, wide]
    mostly_open = np.sum(open_**2 * variances[wide], axis=1) > _MOSTLY * np.diag(scaled)
    left = np.sqrt(np.diag(scaled))
    sums = [_combination(names, weights, x, P, prior_sigma) for weights in _determined_sums(open_ * mostly_open[:, None], prior_sigma)]
    rest = [_open_direction(names, row, x, P, prior_sigma) for row in _sparse_basis(open_.T)]
    alone = dict(zip(names, (left < DETERMINED).tolist(), strict=True))
    told = [each.terms for each in sums if each.determined and len(each.terms) > 1 and not all(alone[name] for name in each.terms)]
    determined = tuple(flag and not any(name in terms for terms in told) for name, flag in alone.items())
    return Identifiability(len(names) - open_.shape[1], determined, (*sums, *rest), tuple(left.tolist()))


def with_sigmas(seen: Identifiability, P: Matrix, names: Sequence[str]) -> Identifiability:
    """The same with the standard deviations that another covariance gives the combinations."""
    column = {name: index for index, name in enumerate(names)}

    def sigma(terms: Mapping[str, float]) -> float:
        weights = np.zeros(len(names))
        weights[[column[name] for name in terms]] = list(terms.values())
        return float(np.sqrt(weights @ P @ weights))

    return replace(seen, combinations=tuple(replace(combination, sigma=sigma(combination.terms)) for combination in seen.combinations))


@dataclass(frozen=True)
class Observability:
    """What a set of poses can see before any fit.

    Attributes:
        singular_values: Of the prior-scaled, whitened Jacobian, (p,), largest first.
        rank: How many directions move the spots at all.
        hidden: What is left of the parameters that take part in hidden directions: the sums that do move the spots, and single
            parameters that never do (weight on themselves, `seen` False).
        weak: Directions that are seen, but not well enough to halve the prior, and how many times worse than the median one.
        indices: O1 to O5.
    """

    singular_values: Vector
    rank: int
    hidden: tuple[HiddenSum, ...]
    weak: tuple[tuple[str, float], ...]
    indices: dict[str, float]


@dataclass(frozen=True)
class HiddenSum:
    """A sum of parameters of which only the whole moves the spots, or a parameter that moves none."""

    terms: dict[str, float]
    seen: bool

    def words(self) -> str:
        """`only joint1.d_d + joint2.d_d moves the spots`."""
        return f"only {in_words(self.terms)} moves the spots" if self.seen else f"{in_words(self.terms)} moves no spot"


def observe(names: Sequence[str], H: Matrix, prior_sigma: Vector, poses: int) -> Observability:
    """What a whitened Jacobian can see, in units of the prior.

    Args:
        names: Parameter names, (p,).
        H: Whitened Jacobian, (m, p).
        prior_sigma: Prior standard deviations, (p,).
        poses: Number of poses, for O1.
    """
    _, values, rows = np.linalg.svd(np.linalg.qr(H * prior_sigma, mode="r"))
    values = np.concatenate([values, np.zeros(len(names) - len(values))])
    seen = values > HIDDEN * values[0]
    strong = values[seen]
    half = np.sqrt(1 / DETERMINED**2 - 1)  # below it the posterior keeps more than half of the prior
    weak = [
        (in_words(dict(zip(names, _cleaned(row * prior_sigma), strict=True))), float(np.median(strong) / value))
        for row, value in zip(rows[seen], strong, strict=True)
        if value < half
    ]
    return Observability(values, int(seen.sum()), tuple(_hidden(names, rows[~seen].T, prior_sigma)), tuple(weak), indices(strong, poses))


def indices(values: Vector, poses: int) -> dict[str, float]:
    """O1 to O5 of the singular values of the seen directions."""
    return {
        "O1": float(np.exp(np.mean(np.log(values))) / np.sqrt(poses)),
        "O2": float(values[-1] / values[0]),
        "O3": float(values[-1]),
        "O4": float(values[-1] ** 2 / values[0]),
        "O5": float(1 / np.sum(1 / values)),
    }


def correlated_groups(names: Sequence[str], P: Matrix, limit: float = 0.95) -> list[tuple[str, ...]]:
    """Parameters that hang together by correlations above a limit, largest group first."""
    sigma = np.sqrt(np.diag(P))
    linked = np.abs(P / np.outer(sigma, sigma)) > limit
    left, groups = set(range(len(names))), []
    while left:
        group, front = set(), {left.pop()}
        while front:
            group |= front
            front = {other for member in front for other in np.flatnonzero(linked[member]).tolist()} - group
        left -= group
        if len(group) > 1:
            groups.append(tuple(names[member] for member in sorted(group)))
    return sorted(groups, key=len, reverse=True)


def in_words(terms: Mapping[str, float]) -> str:
    """A weighted sum as `joint1.d_d + joint2.d_d`, terms of weight 0 left out; of very long ones the largest terms."""
    shown = sorted((name for name in terms if terms[name]), key=lambda name: -abs(terms[name]))[:_MOST_TERMS]
    left = sum(1 for weight in terms.values() if weight) - len(shown)
    text = ""
    for name, weight in ((name, weight) for name, weight in terms.items() if name in shown):
        size = "" if abs(abs(weight) - 1) < 1e-3 else f"{abs(weight):.3g} "
        text += f" {'-' if weight < 0 else '+'} {size}{name}" if weight else ""
    return text.removeprefix(" + ").strip() + (f" + {many(left, 'smaller term')}" if left else "")


def _hidden(names: Sequence[str], null: Matrix, prior_sigma: Vector) -> list[HiddenSum]:
    sums = []
    unseen = [index for index in range(len(names)) if null.size and np.linalg.norm(null[index]) > 1 - 1e-6]
    for index in unseen:
        sums.append(HiddenSum({names[index]: 1.0}, seen=False))
    for weights in _determined_sums(null, prior_sigma):
        terms = dict(zip(names, _cleaned(weights), strict=True))
        sums.append(HiddenSum({name: weight for name, weight in terms.items() if weight}, seen=True))
    return sums


def _cleaned(weights: Vector) -> Vector:
    """Scaled to a largest weight of one, the first positive, without what is negligible."""
    weights = weights / np.abs(weights).max()
    weights = np.where(np.abs(weights) < _NEGLIGIBLE, 0.0, weights)
    return np.asarray(weights * np.sign(weights[np.flatnonzero(weights)[0]]))


def _combination(names: Sequence[str], weights: Vector, x: Vector, P: Matrix, prior_sigma: Vector) -> Combination:
    weights = _cleaned(weights)
    sigma, prior = np.sqrt(weights @ P @ weights), np.linalg.norm(weights * prior_sigma)
    terms = {name: float(weight) for name, weight in zip(names, weights, strict=True) if weight}
    return Combination(terms, float(weights @ x), float(sigma), bool(sigma < DETERMINED * prior), float(sigma / prior))


def _open_direction(names: Sequence[str], row: Vector, x: Vector, P: Matrix, prior_sigma: Vector) -> Combination:
    """A direction that the data left open, given in units of the prior; what is left of its prior is taken in those units, too."""
    away = row / np.linalg.norm(row) / prior_sigma
    return replace(_combination(names, prior_sigma * row, x, P, prior_sigma), determined=False, left=float(np.sqrt(away @ P @ away)))


def _determined_sums(open_: Matrix, prior_sigma: Vector) -> list[Vector]:
    """Weights of sums that the open directions leave alone, within the parameters that those directions move."""
    moved = np.abs(open_).max(axis=1, initial=0.0) > _NEGLIGIBLE
    if not moved.any():
        return []
    _, singular, right = np.linalg.svd(open_[moved].T)
    rank = int(np.sum(singular > 1e-9))
    sums = []
    for row in _sparse_basis(right[rank:]):
        weights = np.zeros(len(prior_sigma))
        weights[moved] = row / prior_sigma[moved]
        sums.append(weights)
    return sums


def _sparse_basis(rows: Matrix) -> list[Vector]:
    """A basis of the same space with zeros in it: reduced row echelon form with full pivoting."""
    rows = rows.copy()
    free = list(range(len(rows)))
    basis: list[Vector] = []
    used: list[int] = []
    while free:
        block = np.abs(rows[free])
        block[:, used] = 0.0
        row, column = np.unravel_index(int(np.argmax(block)), block.shape)
        pivot = free.pop(int(row))
        rows[pivot] /= rows[pivot, column]
        for other in range(len(rows)):
            if other != pivot:
                rows[other] -= rows[other, column] * rows[pivot]
        used.append(int(column))
    for row_ in rows:
        basis.append(np.where(np.abs(row_) < _NEGLIGIBLE * np.abs(row_).max(), 0.0, row_))
    return basis
