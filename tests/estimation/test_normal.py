"""Normal equations from sums by kind, against the products of whitened rows."""

from __future__ import annotations

import numpy as np
import pytest

from urdfcal.estimation.noise import Noise
from urdfcal.estimation.residual import Block, Linearisation

SIGMA = np.array([0.3, 2.0])


def linearised(rng: np.random.Generator, stated: float, known: int = 0) -> Linearisation:
    """Two kinds of numbers, some of which were not measured and a share of which state their own noise, and known rows at the end."""
    n, m, p = 40, 5, 4
    measured = rng.random((n, m)) < 0.8
    residual, jacobian = np.where(measured, rng.normal(size=(n, m)), 0.0), np.where(measured[..., None], rng.normal(size=(n, m, p)), 0.0)
    sigma = np.where(rng.random((n, m)) < stated, rng.uniform(0.1, 3.0, (n, m)), np.nan)
    if known:
        measured[-known:], sigma[-known:] = np.arange(m) == 0, np.nan
        residual[-known:, 1:], jacobian[-known:, 1:], sigma[-known:, 0] = 0.0, 0.0, 0.01
    blocks = (Block("a", slice(0, 2), 0), Block("b", slice(2, 5), 1))
    return Linearisation(residual, jacobian, np.empty((n, m, 0)), measured, sigma, blocks, known=known)


@pytest.mark.parametrize("known", [0, 3])
@pytest.mark.parametrize("stated", [0.0, 0.4, 1.0])
def test_sums_whiten_as_rows_do(stated: float, known: int, rng: np.random.Generator) -> None:
    """H'H, H'e and e'e by kind of noise are those of the whitened rows, whatever states its own noise and is known beforehand."""
    here, noise, dx = linearised(rng, stated, known), Noise(SIGMA, np.zeros(0)), rng.normal(size=4)
    H, e = noise.weights(here).jacobian(here), noise.weights(here).residual(here)
    for found, moved in ((noise.normal(here), e), (noise.normal(here).moved(dx), e + H @ dx)):
        np.testing.assert_allclose(found.A, H.T @ H, rtol=1e-12, atol=1e-9)
        np.testing.assert_allclose(found.b, H.T @ moved, rtol=1e-10, atol=1e-9)
        assert found.c == pytest.approx(moved @ moved, rel=1e-12)
    parts = list(noise.by_kind(here))
    np.testing.assert_allclose(sum(part.A for part in parts), H.T @ H, rtol=1e-12, atol=1e-9)
    own = (np.isnan(here.stated_sigma) & (here.kinds == 1)).ravel()
    np.testing.assert_allclose(parts[1].A, H[own].T @ H[own], rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("stating", [False, True])
def test_decided_are_leverages(stating: bool, rng: np.random.Generator) -> None:
    """The parameters that each kind decides are the sum of the leverages of its numbers; known rows have none."""
    here, noise, root = linearised(rng, 0.5, known=2), Noise(SIGMA, np.zeros(0)), rng.normal(size=(4, 4))
    leverages = here.leverages(noise.weights(here).jacobian(here), root @ root.T)
    own = here.read & (np.isnan(here.stated_sigma) != stating)
    expected = [leverages[own & (here.kinds == kind)].sum() for kind in range(2)]
    np.testing.assert_allclose(noise.decided(here, root @ root.T, stating), expected, rtol=1e-10)


def test_a_jacobian_is_worked_out_when_it_is_wanted(rng: np.random.Generator) -> None:
    """A function in the place of the Jacobian is called once, and not before."""
    here, calls = linearised(rng, 0.0), list[int]()
    whole = here.jacobian

    def asked() -> np.ndarray:
        calls.append(1)
        return whole

    lazy = Linearisation(here.residual, asked, here.joint_jacobian, here.measured, here.stated_sigma, here.blocks)
    assert not calls
    assert lazy.jacobian is whole
    assert lazy.jacobian is whole
    assert calls == [1]
