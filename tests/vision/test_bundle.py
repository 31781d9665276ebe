"""How far views disagree on a lens, from their residuals and derivatives alone."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from urdfcal.vision.camera.bundle import CHANCE, excess_between_views


def looks_at(rng: np.random.Generator, alike: float = 1.0) -> list[Any]:
    """Six views of 40 rows and four numbers of the lens, each view pulled its own way; the last two numbers differ by `alike`."""
    looks = []
    for _ in range(6):
        D = rng.normal(size=(40, 4))
        D[:, 3] = D[:, 2] + alike * D[:, 3]
        looks.append(SimpleNamespace(followed=D, residual=rng.normal(size=40) + D[:, :3] @ rng.normal(0, 0.5, 3)))
    return looks


def by_inverses(looks: list[Any], variances: np.ndarray) -> np.ndarray:
    """The excess as the module's opening lines write it."""
    parts = [look.followed.T @ look.followed / v for look, v in zip(looks, variances, strict=True)]
    S, apart, scatter, found, traces = sum(parts), 0.0, 0.0, 0.0, []
    for look, v, S_v in zip(looks, variances, parts, strict=True):
        without = np.linalg.inv(S - S_v)
        d, C_v = without @ look.followed.T @ look.residual / v, without @ S_v @ np.linalg.inv(S)
        apart, scatter, found = apart + d**2, scatter + np.diag(C_v), found + d @ S @ d
        traces.append([np.trace(S @ C_v), 2 * np.trace(S @ C_v @ S @ C_v)])
    expected, variance = np.sum(traces, axis=0)
    assert found > expected + CHANCE * np.sqrt(variance)
    return np.maximum(apart / scatter, found / expected)


def test_the_excess_is_that_of_the_formula_with_inverses() -> None:
    """Whitened sums and plain inverses give the same."""
    looks, variances = looks_at(np.random.default_rng(7)), np.random.default_rng(8).uniform(0.5, 2, 6)
    assert np.allclose(excess_between_views(SimpleNamespace(variances=variances), looks), by_inverses(looks, variances), rtol=1e-9)


def test_numbers_that_can_hardly_be_told_apart_leave_the_excess_to_rounding() -> None:
    """With two columns 1e-6 apart the rows' order does not matter, where plain inverses lose their signs."""
    looks, rng = looks_at(np.random.default_rng(7), alike=1e-6), np.random.default_rng(9)
    orders = [rng.permutation(40) for _ in looks]
    other = [SimpleNamespace(followed=a.followed[o], residual=a.residual[o]) for a, o in zip(looks, orders, strict=True)]
    bundle = SimpleNamespace(variances=np.ones(6))
    assert np.allclose(excess_between_views(bundle, looks), excess_between_views(bundle, other), rtol=1e-2)


def test_what_one_view_alone_tells_no_other_can_gainsay() -> None:
    """A number of the lens that a single view sees counts neither for nor against agreement."""
    looks = looks_at(np.random.default_rng(7))
    rest = [SimpleNamespace(followed=np.delete(look.followed, 3, axis=1), residual=look.residual) for look in looks]
    for look in looks[1:]:
        look.followed[:, 3] = 0
    bundle = SimpleNamespace(variances=np.ones(6))
    lone = excess_between_views(bundle, looks)
    assert np.isfinite(lone).all()
    assert lone[0] > 1 < excess_between_views(bundle, rest)[0]
