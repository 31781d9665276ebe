"""The criteria of optimal design are what the literature defines, and what is chosen serves them."""

from __future__ import annotations

import numpy as np
import pytest

from urdfcal.planning.criteria import NAMES, Design
from urdfcal.planning.selection import exchanged, fewest, greedy, information

OTHERS = [name for name in NAMES if name != "I"]


def defined(name: str, s: np.ndarray, poses: int) -> float:
    """A criterion by its definition over singular values, from the largest to the smallest."""
    return {
        "D": np.prod(s**-2.0) ** (1 / len(s)),
        "A": np.mean(s**-2.0),
        "E": np.max(s**-2.0),
        "O1": np.prod(s) ** (1 / len(s)) / np.sqrt(poses),
        "O2": s[-1] / s[0],
        "O3": s[-1],
        "O4": s[-1] ** 2 / s[0],
        "O5": 1 / np.sum(1 / s),
    }[name]


def better(name: str, one: float, other: float) -> bool:
    """Whether the first is better by more than rounding: variances are small, indices large."""
    return one < other * (1 - 1e-9) if name in "DAE" else one > other * (1 + 1e-9)


def stacked(design: Design, rows: np.ndarray) -> np.ndarray:
    """Singular values of the rows' Jacobians in units of the prior, the prior's own rows below them."""
    H = np.concatenate([design.H[rows].reshape(-1, design.H.shape[-1]) * design.sigma, np.eye(design.H.shape[-1])])
    return np.linalg.svd(H, compute_uv=False)


@pytest.fixture
def design(rng: np.random.Generator) -> Design:
    """Thirty candidates of two numbers each, five parameters of different priors."""
    H, root = rng.normal(size=(30, 2, 5)) * [5, 1, 3, 20, 2], rng.normal(size=(5, 5))
    return Design(H, rng.uniform(0.5, 2, 5), root @ root.T, np.zeros((5, 5)))


@pytest.mark.parametrize("name", OTHERS)
def test_values_are_those_of_the_singular_values(design: Design, name: str) -> None:
    """What a plan is told to be worth is its criterion's definition over the SVD of the stacked Jacobian."""
    rows = np.array([3, 8, 1, 20])
    assert design.value(name, information(design.H[rows]), 4) == pytest.approx(defined(name, stacked(design, rows), 4), rel=1e-9)


@pytest.mark.parametrize("name", OTHERS)
def test_no_exchange_of_a_chosen_pose_is_better(design: Design, name: str) -> None:
    """Of all single exchanges, tried one by one by the definition, none is better; and no random choice of fifty is."""
    by = design.by(name)
    chosen, _ = exchanged(design.H, by, greedy(design.H, by, 6)[0])
    here = defined(name, stacked(design, chosen), 6)
    for place in range(6):
        for row in set(range(30)) - set(chosen.tolist()):
            tried = np.array([*np.delete(chosen, place), row])
            assert not better(name, defined(name, stacked(design, tried), 6), here)
    for seed in range(50):
        drawn = np.random.default_rng(seed).choice(30, 6, replace=False)
        assert not better(name, defined(name, stacked(design, drawn), 6), here)


def test_i_is_what_fits_are_off_by(design: Design, rng: np.random.Generator) -> None:
    """The mean squared error of 20 000 least-squares estimates with the prior, of parameters drawn from it, is the tr(P M) promised."""
    chosen, left = exchanged(design.H, design.by("I"), greedy(design.H, design.by("I"), 4)[0])
    H, sigma = design.H[chosen].reshape(-1, 5), design.sigma
    x = rng.normal(size=(20_000, 5)) * sigma
    read = x @ H.T + rng.normal(size=(20_000, len(H)))
    rows = np.concatenate([H, np.diag(1 / sigma)])
    found = np.linalg.lstsq(rows, np.concatenate([read, np.zeros_like(x)], axis=1).T, rcond=None)[0].T
    squared = np.einsum("ni,ij,nj->n", found - x, design.M, found - x)
    assert left[-1] == pytest.approx(squared.mean(), rel=0.05)


def test_as_few_as_suffice_are_enough_and_no_fewer_are(design: Design) -> None:
    """What is asked for is reached, and by none of the exchanged choices of one pose less."""
    by = design.by("I")
    chosen, left = greedy(design.H, by, 20)
    enough = left[9]
    few, after = fewest(design.H, by, chosen, left, enough)
    assert after[-1] <= enough
    assert len(few) <= 9
    assert exchanged(design.H, by, greedy(design.H, by, len(few) - 1)[0])[1][-1] > enough
    assert len(fewest(design.H, by, chosen, left, 0.0)[0]) == 20


def test_what_was_measured_before_counts_for_every_criterion(design: Design) -> None:
    """With information of earlier poses every criterion that cannot lose by it, unlike ratios, begins better, and further ones help."""
    known = information(design.H[:8])
    more = Design(design.H[8:], design.sigma, design.M, known)
    for name in set(NAMES) - {"O2", "O4"}:
        by = more.by(name)
        assert by.left(known) < by.left(np.zeros((5, 5)))
        assert exchanged(more.H, by, greedy(more.H, by, 3, known)[0], known)[1][-1] < by.left(known)
