"""Score tests against batch algebra with whole covariances."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from urdfcal.base.geometry import Array3, Matrix, Vector
from urdfcal.estimation.left_out_rows import predicted
from urdfcal.estimation.score import SIZES, Fitted

ROWS, M, PARAMETERS, MORE = 20, 3, 5, 4
OWN = np.arange(PARAMETERS)
TWO = PARAMETERS + np.arange(2)


@dataclass(frozen=True)
class Case:
    """Rows of a fit, H, of further columns, B, and what was measured less what the prior expects; the residual is taken somewhere."""

    H: Matrix
    B: Matrix
    y: Vector
    at: Vector
    numbers: float = ROWS * M

    @property
    def columns(self) -> Array3:
        """All columns and the residual, (columns + 1, m, n)."""
        every = np.column_stack([self.H, self.B, self.y - self.H @ self.at])
        return np.ascontiguousarray(every.reshape(ROWS, M, -1).transpose(2, 1, 0))

    @property
    def fitted(self) -> Fitted:
        """The fit by its sums."""
        flat = self.columns.reshape(PARAMETERS + MORE + 1, -1)
        return replace(Fitted.of(flat @ flat.T, self.at, self.numbers), numbers=self.numbers)


@pytest.fixture
def case(rng: np.random.Generator) -> Case:
    H, B, at = rng.normal(size=(ROWS * M, PARAMETERS)), rng.normal(size=(ROWS * M, MORE)), rng.normal(size=PARAMETERS)
    return Case(H, B, H @ (at + 0.1 * rng.normal(size=PARAMETERS)) + rng.normal(size=ROWS * M), at)


def marginal(S: Matrix, y: Vector) -> float:
    """Log density of y ~ N(0, c S), c by maximum likelihood, less a constant."""
    return float(-0.5 * (len(y) * np.log(y @ np.linalg.solve(S, y)) + np.linalg.slogdet(S)[1]))


def gains(case: Case, B: Matrix) -> list[float]:
    """What the data's whole covariance says with some columns more than without."""
    S = np.eye(ROWS * M) + case.H @ case.H.T
    return [marginal(S + size**2 * B @ B.T, case.y) - marginal(S, case.y) for size in SIZES]


def test_a_gain_is_the_ratio_of_marginal_likelihoods(case: Case) -> None:
    """What the score says without another fit is what the data's whole covariance says with the columns and without."""
    np.testing.assert_allclose(case.fitted.asked(TWO).gains, gains(case, case.B[:, :2]), rtol=1e-9, atol=1e-9)


def test_where_the_residual_is_taken_does_not_count(case: Case) -> None:
    """At the prior's mean, at the estimate and elsewhere sums say the same."""
    for at in (np.zeros(PARAMETERS), case.fitted.x):
        other = replace(case, at=at).fitted
        np.testing.assert_allclose(other.asked(TWO).gains, case.fitted.asked(TWO).gains, rtol=1e-10)
        np.testing.assert_allclose(other.x, case.fitted.x, rtol=1e-10)
    whole = np.linalg.solve(case.H.T @ case.H + np.eye(PARAMETERS), case.H.T @ case.y)
    np.testing.assert_allclose(case.fitted.x, whole, rtol=1e-10)


def test_a_fit_with_the_columns_in_it_has_that_gain(case: Case) -> None:
    """Log evidence of the fit that knows of the columns, less that of the one which does not."""
    expected = [case.fitted.beside(TWO, size).log_evidence - case.fitted.log_evidence for size in SIZES.tolist()]
    np.testing.assert_allclose(case.fitted.asked(TWO).gains, expected, rtol=1e-9, atol=1e-9)


def test_what_was_found_is_known_to_further_questions(case: Case) -> None:
    """Columns in the fit, three times as large as usual, are as if they had been among its parameters."""
    known = replace(case, H=np.column_stack([case.H, 3 * case.B[:, 2:]]), at=np.append(case.at, np.zeros(2)))
    beside = case.fitted.beside(TWO + 2, 3.0)
    np.testing.assert_allclose(beside.asked(TWO).gains, gains(known, case.B[:, :2]), rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("beside", [False, True], ids=["bare", "with columns beside"])
def test_waves_are_asked_as_each_alone(case: Case, rng: np.random.Generator, beside: bool) -> None:
    """Sin and cos of every multiple of an angle times one column, all at once; in single precision to six digits."""
    column, waves = rng.normal(size=(M, ROWS)), np.exp(1j * np.outer(rng.uniform(-3, 3, ROWS), np.arange(1, 8)))
    fitted = case.fitted.beside(TWO, 0.3) if beside else case.fitted
    known = replace(case, H=np.column_stack([case.H, 0.3 * case.B[:, :2]])) if beside else case
    left, expected = fitted.left(case.columns), []
    for wave in waves.T:
        B = np.stack([column * wave.imag, column * wave.real])
        expected.append(gains(known, B.transpose(2, 1, 0).reshape(-1, 2)))
        np.testing.assert_allclose(fitted.asked_of(left, B).gains, expected[-1], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(fitted.asked_in_waves(left, column, waves).gains, np.max(expected, axis=1), rtol=1e-9)
    single = fitted.asked_in_waves(left.astype(np.float32), column.astype(np.float32), waves.astype(np.complex64))
    np.testing.assert_allclose(single.gains, np.max(expected, axis=1), rtol=1e-4)


def test_held_out_rows_are_predicted_by_the_others(case: Case) -> None:
    """One row at a time: the Gaussian conditional of the whole covariance, with the others' noise; in strips as in one piece."""
    S, y, density = np.eye(ROWS * M) + case.H @ case.H.T, case.y, 0.0
    for row in range(ROWS):
        own, rest = np.arange(row * M, row * M + M), np.delete(np.arange(ROWS * M), np.arange(row * M, row * M + M))
        gain = S[np.ix_(own, rest)] @ np.linalg.inv(S[np.ix_(rest, rest)])
        off, spread = y[own] - gain @ y[rest], S[np.ix_(own, own)] - gain @ S[np.ix_(rest, own)]
        scale = float(y[rest] @ np.linalg.solve(S[np.ix_(rest, rest)], y[rest])) / len(rest)
        density -= 0.5 * float(off @ np.linalg.solve(spread * scale, off) + np.linalg.slogdet(spread * scale)[1])
    rows, parts = case.fitted.kept.rows(case.columns), (np.arange(13), np.arange(13, ROWS))
    assert predicted(case.fitted, lambda: iter([(rows, np.arange(ROWS))]), ROWS, ROWS) == pytest.approx(density, abs=1e-9)
    assert predicted(case.fitted, lambda: ((rows[:, :, part], part) for part in parts), ROWS, ROWS) == pytest.approx(density, abs=1e-9)


def test_noise_that_is_larger_than_it_should_be_is_no_nuisance(case: Case) -> None:
    """The whole set with a scatter ten times as large, priors with it, answers the same."""
    larger = replace(case, y=10 * case.y, at=10 * case.at)
    np.testing.assert_allclose(larger.fitted.asked(TWO).gains, case.fitted.asked(TWO).gains, rtol=1e-9, atol=1e-9)
