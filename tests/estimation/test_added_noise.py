"""Noise that numbers of a row have in common, against whole covariances."""

from __future__ import annotations

import numpy as np
import pytest

from urdfcal.estimation.added_noise import products, volume, whitened

ROWS, COLUMNS = 9, 5


@pytest.fixture(params=[(3, 2), (3, 3), (2, 5)], ids=["few sources", "as many", "many sources"])
def E(request: pytest.FixtureRequest, rng: np.random.Generator) -> np.ndarray:
    """What each of k sources does to each of m numbers, (k, m, n)."""
    m, sources = request.param
    return rng.normal(size=(sources, m, ROWS))


def test_products_are_those_of_the_inverse_covariance(E: np.ndarray, rng: np.random.Generator) -> None:
    """Row by row C' (I + s E E')^-1 C, and log det of the covariance, for every size of the noise; whitened columns have them, too."""
    columns = rng.normal(size=(COLUMNS, E.shape[1], ROWS))
    for variance, (found, grown) in zip((0.3, 4.0), products(columns, E, (0.3, 4.0)), strict=True):
        expected, logs = np.zeros((COLUMNS, COLUMNS)), 0.0
        for row in range(ROWS):
            R = np.eye(E.shape[1]) + variance * E[:, :, row].T @ E[:, :, row]
            expected += columns[:, :, row] @ np.linalg.inv(R) @ columns[:, :, row].T
            logs += np.linalg.slogdet(R)[1]
        np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12)
        flat = whitened(columns, E, variance).reshape(COLUMNS, -1)
        np.testing.assert_allclose(flat @ flat.T, expected, rtol=1e-12, atol=1e-12)
        assert grown == pytest.approx(logs, rel=1e-12)
        assert volume(E, variance) == pytest.approx(logs, rel=1e-12)
