"""The filter: properties, on problems without a robot."""

from __future__ import annotations

import numpy as np
import pytest

from urdfcal.estimation.ekf import Belief, compress, iterated_schedule, paper_schedule, taken_in, update
from urdfcal.estimation.noise import Noise
from urdfcal.estimation.normal import Normal
from urdfcal.estimation.residual import Linearisation


def linear_problem(rng: np.random.Generator, m: int = 40, p: int = 6) -> tuple[Belief, np.ndarray, np.ndarray, np.ndarray]:
    """Prior, Jacobian, measurement and covariance of a random linear problem."""
    root = rng.normal(size=(p, p))
    prior = Belief(rng.normal(size=p), root @ root.T + np.eye(p))
    return prior, rng.normal(size=(m, p)), rng.normal(size=m), np.diag(rng.uniform(0.5, 2, m))


def batch(prior: Belief, H: np.ndarray, y: np.ndarray, R: np.ndarray) -> Belief:
    """The same answer by normal equations."""
    information = np.linalg.inv(prior.P) + H.T @ np.linalg.inv(R) @ H
    P = np.linalg.inv(information)
    return Belief(prior.x + P @ H.T @ np.linalg.inv(R) @ (y - H @ prior.x), P)


def test_an_update_is_the_batch_answer(rng: np.random.Generator) -> None:
    """On a linear problem one update equals the batch estimate to 1e-10."""
    prior, H, y, R = linear_problem(rng)
    found, _ = update(prior, y - H @ prior.x, H, R)
    expected = batch(prior, H, y, R)
    np.testing.assert_allclose(found.x, expected.x, atol=1e-10)
    np.testing.assert_allclose(found.P, expected.P, atol=1e-10)


def test_updates_one_by_one_are_the_stacked_one(rng: np.random.Generator) -> None:
    """Measurements taken in turn give the belief of all at once, and their NIS add up."""
    prior, H, y, R = linear_problem(rng)
    belief, total = prior, 0.0
    for row in range(len(y)):
        belief, nis = update(belief, y[row : row + 1] - H[row : row + 1] @ belief.x, H[row : row + 1], R[row : row + 1, row : row + 1])
        total += nis
    stacked, whole = update(prior, y - H @ prior.x, H, R)
    np.testing.assert_allclose(belief.x, stacked.x, atol=1e-10)
    np.testing.assert_allclose(belief.P, stacked.P, atol=1e-10)
    assert total == pytest.approx(whole, rel=1e-9)


def test_the_covariance_stays_symmetric_and_positive(rng: np.random.Generator) -> None:
    """Joseph's form keeps P a covariance through many precise measurements of a badly scaled state."""
    belief = Belief(np.zeros(4), np.diag([1e6, 1.0, 1e-6, 1e-12]))
    for _ in range(300):
        H = rng.normal(size=(2, 4))
        belief, _ = update(belief, rng.normal(size=2), H, 1e-10 * np.eye(2))
    np.testing.assert_array_equal(belief.P, belief.P.T)
    assert np.linalg.eigvalsh(belief.P).min() >= -1e-18


@pytest.mark.parametrize("seen", [6, 4], ids=["full rank", "two directions unseen"])
def test_compressed_measurements_say_the_same(rng: np.random.Generator, seen: int) -> None:
    """At most p rows carry the information of all, also where some directions are not seen."""
    prior, H, y, _ = linear_problem(rng)
    H = H[:, :seen] @ rng.normal(size=(seen, 6))
    normal = Normal.of_rows(H, y - H @ prior.x)
    rows, short = compress(normal, np.ones(6))
    assert len(short) == len(rows) == seen
    found = taken_in(prior, normal)
    expected = batch(prior, H, y, np.eye(len(y)))
    np.testing.assert_allclose(found.x, expected.x, atol=1e-9)
    np.testing.assert_allclose(found.P, expected.P, atol=1e-9)


@pytest.mark.parametrize("sigma", [0.1, 1.0, 1e3])
def test_independent_parameters_take_in_at_once_what_updates_would_one_by_one(rng: np.random.Generator, sigma: float) -> None:
    """Mean and covariance are those of an update a row, also where a direction is not seen, and where nearly nothing is known before."""
    _, H, y, _ = linear_problem(rng)
    H = H[:, :5] @ rng.normal(size=(5, 6))
    prior = one_by_one = Belief.independent(rng.normal(size=6), sigma * rng.uniform(0.5, 2, 6))
    for row, value in zip(H, y, strict=True):
        one_by_one, _ = update(one_by_one, np.atleast_1d(value - row @ one_by_one.x), row[None], np.eye(1))
    found = taken_in(prior, Normal.of_rows(H, y - H @ prior.x))
    np.testing.assert_allclose(H @ found.x, H @ one_by_one.x, atol=1e-12 * max(1.0, sigma) ** 2)
    np.testing.assert_allclose(found.P, one_by_one.P, atol=1e-12 * max(1.0, sigma) ** 2)


class Curve:
    """y = exp(a t) + b, measured with noise: a small nonlinear problem."""

    def __init__(self, rng: np.random.Generator, sigma: float, n: int = 200) -> None:
        self.t = np.linspace(0, 1, n)
        self.y = np.exp(0.7 * self.t) + 0.3 + rng.normal(0, sigma, n)

    def linearise(self, x: np.ndarray) -> Linearisation:
        growth = np.exp(x[0] * self.t)
        jacobian = np.stack([self.t * growth, np.ones_like(self.t)], axis=-1)
        ones = np.ones((len(self.t), 1), dtype=bool)
        return Linearisation(
            (self.y - growth - x[1])[:, None], jacobian[:, None], np.empty((len(self.t), 1, 0)), ones, np.full((len(self.t), 1), np.nan)
        )


def test_iterated_finds_the_map_estimate(rng: np.random.Generator) -> None:
    """At rest the gradient of the posterior is zero and the covariance is the inverse of its Gauss-Newton Hessian."""
    curve, prior, sigma = Curve(rng, 0.05), Belief(np.array([0.0, 0.0]), np.diag([0.5**2, 0.2**2])), 0.05
    found = iterated_schedule(curve.linearise, prior, Noise(sigma, np.zeros(0)))
    assert found.stop == "converged"
    here = curve.linearise(found.belief.x)
    J, r = here.jacobian[:, 0] / sigma, here.residual[:, 0] / sigma
    gradient = J.T @ r - np.linalg.solve(prior.P, found.belief.x - prior.x)
    np.testing.assert_allclose(gradient, 0, atol=1e-4 * np.abs(J.T).sum())
    np.testing.assert_allclose(found.belief.P, np.linalg.inv(J.T @ J + np.linalg.inv(prior.P)), rtol=1e-6)


def test_noise_that_is_not_stated_is_found(rng: np.random.Generator) -> None:
    """The spot noise is estimated from the residual, with its degrees of freedom."""
    ratios = []
    for _ in range(40):
        found = iterated_schedule(Curve(rng, 0.003, 60).linearise, Belief(np.zeros(2), np.eye(2)), Noise(1.0, np.zeros(0), stated=False))
        ratios.append((found.noise.spot_sigma / 0.003) ** 2)
    assert np.mean(ratios) == pytest.approx(1.0, abs=4 * np.sqrt(2 / 58 / 40))


def test_data_count_once(rng: np.random.Generator) -> None:
    """More sweeps do not make the iterated schedule surer of itself."""
    curve, prior = Curve(rng, 0.05), Belief(np.zeros(2), np.eye(2))
    few = iterated_schedule(curve.linearise, prior, Noise(0.05, np.zeros(0)), tolerance=1e-2)
    many = iterated_schedule(curve.linearise, prior, Noise(0.05, np.zeros(0)), tolerance=1e-12)
    assert len(many.history) >= len(few.history)
    np.testing.assert_allclose(np.diag(many.belief.P), np.diag(few.belief.P), rtol=1e-2)


def test_paper_schedule_is_newton_as_noise_vanishes(rng: np.random.Generator) -> None:
    """With an R that is nothing beside Q the sweeps are Newton's: a handful end at the exact answer."""
    curve = Curve(rng, 0.0)
    found = paper_schedule(curve.linearise, Belief(np.zeros(2), np.eye(2)), Noise(1.0, np.zeros(0)), q=1.0, r=1e-12, tolerance=1e-12)
    assert found.stop == "converged"
    assert len(found.history) < 12
    np.testing.assert_allclose(found.belief.x, [0.7, 0.3], atol=1e-10)


def test_sweeps_that_run_out_are_said(rng: np.random.Generator) -> None:
    """A schedule that may not finish says so, and keeps its history."""
    found = paper_schedule(Curve(rng, 0.1).linearise, Belief(np.zeros(2), np.eye(2)), Noise(1.0, np.zeros(0)), tolerance=0.0, max_sweeps=7)
    assert (found.stop, len(found.history)) == ("max_sweeps", 8)


def test_a_step_that_overshoots_is_damped() -> None:
    """Where the full step raises the cost it is halved until it does not."""

    def arctangent(x: np.ndarray) -> Linearisation:
        return Linearisation(
            np.array([[-np.arctan(x[0])]]),
            np.array([[[1 / (1 + x[0] ** 2)]]]),
            np.empty((1, 1, 0)),
            np.ones((1, 1), dtype=bool),
            np.full((1, 1), np.nan),
        )

    found = iterated_schedule(arctangent, Belief(np.array([5.0]), np.diag([1e6])), Noise(1e-3, np.zeros(0)))
    assert found.stop == "converged"
    assert abs(found.belief.x[0]) < 1e-6


def test_a_model_that_cannot_see_the_data_stops_with_its_reason() -> None:
    """Beams that leave the screen, or numbers that are not finite, are a stop reason and not a crash."""

    def off_screen(x: np.ndarray) -> Linearisation:
        nothing, all_of = np.zeros((1, 1)), np.ones((1, 1), dtype=bool)
        return Linearisation(nothing, np.zeros((1, 1, 1)), np.empty((1, 1, 0)), all_of, nothing, lost=all_of)

    for schedule in (iterated_schedule, paper_schedule):
        found = schedule(off_screen, Belief(np.zeros(1), np.eye(1)), Noise(1e-3, np.zeros(0)))
        assert found.stop == "left_screen"
