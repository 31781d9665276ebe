"""Steps along a valley: Newton's, and no longer than a radius; and the filter that takes them where it would creep."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import least_squares

from urdfcal.base.geometry import Matrix, Vector
from urdfcal.estimation.ekf import Belief, Estimate, iterated_schedule
from urdfcal.estimation.noise import Noise
from urdfcal.estimation.residual import Linearisation
from urdfcal.estimation.valley import Valley

PRIOR = Belief(np.array([0.0, 0.3, -0.2]), np.diag([1.0, 1.0, 4.0]))


class Bent:
    """h = (A x, k x1^2 / 2): what is left over of the last number bends the cost along x1 by `bend` times what holds it."""

    def __init__(self, bend: float, rng: np.random.Generator, k: float = 0.02) -> None:
        self.A, self.k = np.vstack([rng.normal(0, 3, (30, 3)) * [1, 0, 1], [0, 1, 0]]), k
        self.y = np.append(self.A @ [0.5, 0.2, -0.4] + rng.normal(0, 1, 31), 2 * bend / k)  # the prior and one number hold x1: 2

    def linearise(self, x: Vector) -> Linearisation:
        h = np.append(self.A @ x, self.k * x[1] ** 2 / 2)
        J = np.vstack([self.A, [0, self.k * x[1], 0]])
        ones = np.ones((len(h), 1), dtype=bool)
        return Linearisation((self.y - h)[:, None], J[:, None], np.empty((len(h), 1, 0)), ones, np.full((len(h), 1), np.nan))

    def gradient(self, x: Vector) -> Vector:
        here = self.linearise(x)
        return np.asarray(here.jacobian[:, 0].T @ here.residual[:, 0] - (x - PRIOR.x) / np.diag(PRIOR.P))

    def hessian(self, x: Vector) -> Matrix:
        small = 1e-6
        return np.array([(self.gradient(x - small * e) - self.gradient(x + small * e)) / (2 * small) for e in np.eye(3)])

    def covariance(self, x: Vector) -> Matrix:
        J = self.linearise(x).jacobian[:, 0]
        return np.asarray(np.linalg.inv(J.T @ J + np.linalg.inv(PRIOR.P)))

    def filtered(self, **how: int) -> Estimate:
        return iterated_schedule(self.linearise, PRIOR, Noise(1.0, np.zeros(0)), **how)


def valley(problem: Bent, x: Vector, radius: float = np.inf) -> Valley:
    found = Valley.at(x, problem.gradient(x), problem.covariance(x), problem.gradient, radius)
    assert found is not None
    return found


@pytest.mark.parametrize("bend", [-5.0, -0.5, 0.5, 0.9])
def test_a_step_without_bounds_is_newton_s(bend: float, rng: np.random.Generator) -> None:
    """It solves the normal equations with the second derivatives in them to a hundredth, and promises what a quadratic cost falls by."""
    problem, x = Bent(bend, rng), np.array([0.1, 0.5, 0.3])
    step, promised, _ = valley(problem, x).step(1e6)
    g, H = problem.gradient(x), problem.hessian(x)
    P, left = problem.covariance(x), g - H @ step
    assert np.sqrt(left @ P @ left) < 0.011 * np.sqrt(g @ P @ g)
    assert promised == pytest.approx(2 * g @ step - step @ H @ step, rel=1e-2)


@pytest.mark.parametrize("bend", [-5.0, 0.5, 3.0], ids=["stiffer", "flatter", "negative curvature"])
def test_a_bounded_step_is_the_best_of_its_length(bend: float, rng: np.random.Generator) -> None:
    """It is as long as the radius in sigmas, and no other step that short lowers the quadratic cost further."""
    problem, x, radius = Bent(bend, rng), np.array([0.1, 0.5, 0.3]), 0.3
    step, promised, length = valley(problem, x, radius).step(radius)
    P, g, H = problem.covariance(x), problem.gradient(x), problem.hessian(x)
    assert length == pytest.approx(radius, rel=1e-6)
    assert np.sqrt(step @ np.linalg.solve(P, step)) == pytest.approx(radius, rel=1e-6)
    others = rng.normal(size=(20000, 3)) @ np.linalg.cholesky(P).T
    others *= radius / np.sqrt(np.einsum("ni,ij,nj->n", others, np.linalg.inv(P), others))[:, None]
    assert promised > 0.99 * np.max(2 * others @ g - np.einsum("ni,ij,nj->n", others, H, others))


def test_no_step_without_a_gradient(rng: np.random.Generator) -> None:
    """Where the model cannot produce what was measured nearby, or nothing is left to gain, there is no valley."""
    problem, x = Bent(0.5, rng), np.zeros(3)
    assert Valley.at(x, problem.gradient(x), np.eye(3), lambda _: None, 1.0) is None
    assert Valley.at(x, np.zeros(3), np.eye(3), problem.gradient, 1.0) is None


@pytest.mark.parametrize("bend", [-0.95, 0.95, 0.99], ids=["too far each time", "too short each time", "flat"])
def test_a_filter_that_would_creep_does_not(bend: float, rng: np.random.Generator) -> None:
    """Where each step of the filter leaves over nine tenths it rests in a few, at the optimum and with the covariance counted once."""
    problem = Bent(bend, rng)
    found = problem.filtered()
    assert found.converged
    assert len(found.history) < 20 < np.log(1e-7) / np.log(abs(bend))  # what the filter's own pace would take

    def rows(x: Vector) -> Vector:
        return np.append(problem.linearise(x).residual[:, 0], (x - PRIOR.x) / np.sqrt(np.diag(PRIOR.P)))

    best = least_squares(rows, PRIOR.x, method="lm", xtol=1e-15, ftol=1e-15, gtol=1e-15).x
    np.testing.assert_allclose(found.belief.x, best, atol=1e-3)  # where SciPy can no longer tell costs apart
    still = np.linalg.solve(problem.hessian(found.belief.x), problem.gradient(found.belief.x))
    np.testing.assert_allclose(still, 0, atol=1e-6)
    np.testing.assert_allclose(found.belief.P, problem.covariance(found.belief.x), rtol=1e-6)


def test_a_filter_that_does_not_creep_is_left_alone(rng: np.random.Generator) -> None:
    """Where steps shrink by themselves none is looked at that the filter does not take: one linearisation a sweep."""
    problem, asked = Bent(0.2, rng), 0
    plain = problem.linearise

    def counted(x: Vector) -> Linearisation:
        nonlocal asked
        asked += 1
        return plain(x)

    problem.linearise = counted  # type: ignore[method-assign]
    found = problem.filtered()
    assert found.converged
    assert asked == len(found.history) - 1
