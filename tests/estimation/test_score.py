"""Score tests against batch algebra with whole covariances."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from urdfcal.base.geometry import Matrix, Vector
from urdfcal.estimation.score import SIZES, Fitted, rows_times

ROWS, M, PARAMETERS = 20, 3, 5


@pytest.fixture
def fitted(rng: np.random.Generator) -> Fitted:
    H = rng.normal(size=(ROWS * M, PARAMETERS))
    return Fitted(H, H @ rng.normal(size=PARAMETERS) + rng.normal(size=ROWS * M), ROWS * M)


def marginal(S: Matrix, y: Vector) -> float:
    """Log density of y ~ N(0, c S), c by maximum likelihood, less a constant."""
    return float(-0.5 * (len(y) * np.log(y @ np.linalg.solve(S, y)) + np.linalg.slogdet(S)[1]))


def test_a_gain_is_the_ratio_of_marginal_likelihoods(fitted: Fitted, rng: np.random.Generator) -> None:
    """What the score says without another fit is what the data's whole covariance says with the columns and without."""
    B = rng.normal(size=(ROWS * M, 2))
    S = np.eye(ROWS * M) + fitted.H @ fitted.H.T
    expected = [marginal(S + size**2 * B @ B.T, fitted.y) - marginal(S, fitted.y) for size in SIZES]
    np.testing.assert_allclose(fitted.asked(B).gains, expected, rtol=1e-9, atol=1e-9)


def test_a_fit_with_the_columns_in_it_has_that_gain(fitted: Fitted, rng: np.random.Generator) -> None:
    """Log evidence of the fit that knows of the columns, less that of the one which does not."""
    B, expected = rng.normal(size=(ROWS * M, 2)), []
    for size in SIZES:
        expected.append(fitted.beside(size * B).log_evidence - fitted.log_evidence)
    np.testing.assert_allclose(fitted.asked(B).gains, expected, rtol=1e-9, atol=1e-9)


def test_many_pairs_are_asked_as_each_alone(fitted: Fitted, rng: np.random.Generator) -> None:
    """Waves over the rows times one column, all at once."""
    column, one, other = rng.normal(size=ROWS * M), rng.normal(size=(ROWS, 7)), rng.normal(size=(ROWS, 7))
    pairs, gains = fitted.asked_in_pairs(column, one, other), []
    for wave in range(7):
        B = column[:, None] * np.repeat(np.column_stack([one[:, wave], other[:, wave]]), M, axis=0)
        alone = fitted.asked(B)
        np.testing.assert_allclose(pairs.score(wave).gains, alone.gains, rtol=1e-9, atol=1e-9)
        gains.append(alone.gains.max())
    assert pairs.best == int(np.argmax(gains))


def test_noise_that_a_row_has_in_common_is_a_covariance(fitted: Fitted, rng: np.random.Generator) -> None:
    """Rows times the roots of an inverse covariance have the likelihood that it gives them, and columns asked later are treated alike."""
    U, B = rng.normal(size=(ROWS, M, 2)), rng.normal(size=(ROWS * M, 2))
    R = np.eye(M) + U @ U.transpose(0, 2, 1)
    values, vectors = np.linalg.eigh(R)
    spread = fitted.spread((vectors / np.sqrt(values)[:, None]) @ vectors.transpose(0, 2, 1))
    whole = np.zeros((ROWS * M, ROWS * M))
    for row in range(ROWS):
        whole[row * M : row * M + M, row * M : row * M + M] = R[row]
    S = whole + fitted.H @ fitted.H.T
    assert spread.log_evidence - 0.5 * np.sum(np.log(values)) == pytest.approx(marginal(S, fitted.y), abs=1e-9)
    expected = [marginal(S + size**2 * B @ B.T, fitted.y) - marginal(S, fitted.y) for size in SIZES]
    np.testing.assert_allclose(spread.asked(B).gains, expected, rtol=1e-9, atol=1e-9)


def test_held_out_rows_are_predicted_by_the_others(fitted: Fitted) -> None:
    """One row at a time: the Gaussian conditional of the whole covariance, with the others' noise."""
    S, y, density = np.eye(ROWS * M) + fitted.H @ fitted.H.T, fitted.y, 0.0
    folds = [np.array([row]) for row in range(ROWS)]
    for row in range(ROWS):
        own, rest = np.arange(row * M, row * M + M), np.delete(np.arange(ROWS * M), np.arange(row * M, row * M + M))
        gain = S[np.ix_(own, rest)] @ np.linalg.inv(S[np.ix_(rest, rest)])
        off, spread = y[own] - gain @ y[rest], S[np.ix_(own, own)] - gain @ S[np.ix_(rest, own)]
        scale = float(y[rest] @ np.linalg.solve(S[np.ix_(rest, rest)], y[rest])) / len(rest)
        density -= 0.5 * float(off @ np.linalg.solve(spread * scale, off) + np.linalg.slogdet(spread * scale)[1])
    assert fitted.predicted(folds, ROWS) == pytest.approx(density, abs=1e-9)


def test_noise_that_is_larger_than_it_should_be_is_no_nuisance(fitted: Fitted, rng: np.random.Generator) -> None:
    """The whole set with a scatter ten times as large, priors with it, answers the same."""
    B = rng.normal(size=(ROWS * M, 2))
    np.testing.assert_allclose(replace(fitted, y=10 * fitted.y).asked(B).gains, fitted.asked(B).gains, rtol=1e-9, atol=1e-9)


def test_rows_are_multiplied_by_their_own_matrix(rng: np.random.Generator) -> None:
    """A block-diagonal matrix, without the zeros."""
    roots, columns = rng.normal(size=(ROWS, M, M)), rng.normal(size=(ROWS * M, 2))
    expected = np.concatenate([roots[row] @ columns[row * M : row * M + M] for row in range(ROWS)])
    np.testing.assert_allclose(rows_times(roots, columns), expected, atol=1e-12)


def test_a_thinned_fit_is_that_of_some_rows(fitted: Fitted, rng: np.random.Generator) -> None:
    """Every third row, with its share of the degrees of freedom."""
    B = rng.normal(size=(ROWS * M, 2))
    some = fitted.thinned(ROWS, 3)
    rows = np.concatenate([np.arange(row * M, row * M + M) for row in range(0, ROWS, 3)])
    expected = Fitted(fitted.H[rows], fitted.y[rows], ROWS * M * 7 / ROWS)
    np.testing.assert_allclose(some.asked(B[rows]).gains, expected.asked(B[rows]).gains, rtol=1e-12)


def test_more_precise_numbers_weigh_more(rng: np.random.Generator) -> None:
    """Evidence and what there is to explain under other precisions are those of a fit whose rows were scaled by them."""
    fitted, weights = Fitted(rng.normal(size=(60, 4)), rng.normal(size=60), 56.0), rng.uniform(0.2, 1.0, 60)
    scaled = Fitted(fitted.H * weights[:, None], fitted.y * weights, 56.0)
    np.testing.assert_allclose(fitted.weighed(weights), (scaled.log_evidence, scaled.total), rtol=1e-12)
