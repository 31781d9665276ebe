"""Weights, and noise that is estimated."""

from __future__ import annotations

import numpy as np
import pytest

from urdfcal.estimation.noise import Noise
from urdfcal.estimation.residual import Linearisation


def one_set(rng: np.random.Generator, n: int = 5, m: int = 4, joints: int = 3) -> Linearisation:
    """A random linearisation in which one pose misses a beam."""
    measured = np.ones((n, m), dtype=bool)
    measured[1, 2:] = False
    parts = [rng.normal(size=shape) for shape in ((n, m), (n, m, 2), (n, m, joints))]
    for part in parts:
        part[~measured] = 0.0
    return Linearisation(*parts, measured, np.full((n, m), np.nan))


def test_joint_noise_reaches_the_spots(rng: np.random.Generator) -> None:
    """Whitened by R_i = R_spot + J_q R_q J_q', chi-squared is r' R^-1 r pose by pose, over what was measured."""
    here, noise = one_set(rng), Noise(0.5, np.array([0.1, 0.2, 0.3]))
    expected = 0.0
    for pose in range(5):
        seen = here.measured[pose]
        J_q, r = here.joint_jacobian[pose][seen], here.residual[pose][seen]
        expected += r @ np.linalg.solve(0.25 * np.eye(seen.sum()) + J_q @ np.diag(noise.joint_sigma**2) @ J_q.T, r)
    assert noise.chi_squared(here) == pytest.approx(expected, rel=1e-12)


def test_whitening_treats_residual_and_jacobian_alike(rng: np.random.Generator) -> None:
    """W r and W J keep r = J x for any x, with and without joint noise."""
    here = one_set(rng)
    x = np.array([0.3, -0.7])
    exact = Linearisation(here.jacobian @ x, here.jacobian, here.joint_jacobian, here.measured, here.stated_sigma)
    for joints in (np.zeros(3), np.array([0.1, 0.0, 0.3])):
        weights = Noise(0.5, joints).weights(exact)
        np.testing.assert_allclose(weights.jacobian(exact) @ x, weights.residual(exact), atol=1e-12)


def test_stated_sigma_of_a_spot_overrides(rng: np.random.Generator) -> None:
    """Where the measurement states its own sigma that one is used, elsewhere the common one."""
    here = one_set(rng)
    stated = here.stated_sigma.copy()
    stated[0] = 2.0
    own = Linearisation(here.residual, here.jacobian, here.joint_jacobian, here.measured, stated)
    expected = np.sum(here.residual[0] ** 2) / 4 + np.sum(here.residual[1:] ** 2) / 0.25
    assert Noise(0.5, np.zeros(3)).chi_squared(own) == pytest.approx(expected)


def test_estimated_noise_makes_chi_squared_its_degrees_of_freedom(rng: np.random.Generator) -> None:
    """Without joint noise one step suffices; with it the fixed point is reached by repetition."""
    here = one_set(rng)
    found = Noise(3.0, np.zeros(3), stated=False).estimated(here, 25.0)
    assert found.chi_squared(here) == pytest.approx(25.0)
    with_joints = Noise(3.0, np.full(3, 0.1), stated=False)
    for _ in range(50):
        with_joints = with_joints.estimated(here, 25.0)
    assert with_joints.chi_squared(here) == pytest.approx(25.0, rel=1e-6)


def test_a_fit_that_nearly_runs_through_its_data_says_nothing_of_their_noise(rng: np.random.Generator) -> None:
    """With few degrees of freedom the noise stays where it was."""
    assert Noise(1e-3, np.zeros(3), stated=False).estimated(one_set(rng), 5.0).spot_sigma == 1e-3
