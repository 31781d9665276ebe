"""What the data decided: which parameters, which of their combinations, and what was left to the prior.

Being determined is measured against the prior: a parameter, or a combination, is determined when its posterior standard deviation
is under half its prior one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from urdfcal.geometry import Matrix, Vector

DETERMINED = 0.5  # posterior over prior standard deviation
_NEGLIGIBLE = 0.02  # share of a direction's largest component that is not worth a word


@dataclass(frozen=True)
class Combination:
    """A weighted sum of parameters.

    Attributes:
        terms: Weight of each parameter.
        value: The sum at the estimate, [m] or [rad] times the weights.
        sigma: Its posterior standard deviation.
        determined: Whether the data decided it.
    """

    terms: dict[str, float]
    value: float
    sigma: float
    determined: bool

    def words(self) -> str:
        """`joint1.d_d + joint2.d_d`."""
        text = ""
        for name, weight in self.terms.items():
            size = "" if abs(abs(weight) - 1) < 1e-3 else f"{abs(weight):.3g} "
            text += f" {'-' if weight < 0 else '+'} {size}{name}"
        return text.removeprefix(" + ").strip()


@dataclass(frozen=True)
class Identifiability:
    """What a fit decided.

    Attributes:
        rank: Number of directions of the state that the data determined.
        determined: For each parameter, whether its sigma is under half its prior's.
        combinations: For the parameters that are not: the sums that are determined, then the directions that are not.
    """

    rank: int
    determined: tuple[bool, ...]
    combinations: tuple[Combination, ...]


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
    open_ = directions[:, variances >= DETERMINED**2]
    determined = np.sqrt(np.diag(scaled)) < DETERMINED
    combinations = [
        _combination(names, weights, x, P, prior_sigma)
        for weights in [*_determined_sums(open_, prior_sigma), *(prior_sigma * row for row in _sparse_basis(open_.T))]
    ]
    return Identifiability(len(names) - open_.shape[1], tuple(bool(flag) for flag in determined), tuple(combinations))


def _combination(names: Sequence[str], weights: Vector, x: Vector, P: Matrix, prior_sigma: Vector) -> Combination:
    weights = weights / np.abs(weights).max()
    first = weights[np.flatnonzero(weights)[0]]
    weights = weights * np.sign(first)
    sigma, prior = np.sqrt(weights @ P @ weights), np.linalg.norm(weights * prior_sigma)
    terms = {name: float(weight) for name, weight in zip(names, weights, strict=True) if weight}
    return Combination(terms, float(weights @ x), float(sigma), bool(sigma < DETERMINED * prior))


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
