"""The chi-squared distribution without scipy, against scipy."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

from urdfcal.estimation.chi_squared import GATE, chi_squared_gate, medians, quantile, tail

DEGREES = [1, 2, 3, 4, 6, 7, 12, 60, 400]


@pytest.mark.parametrize("degrees", DEGREES)
@pytest.mark.parametrize("squared", [0.0, 0.01, 1.0, 7.5, 40.0, 600.0])
def test_the_tail_is_scipy_s(degrees: int, squared: float) -> None:
    """For odd and even degrees of freedom, in the bulk and far out."""
    assert tail(squared, degrees) == pytest.approx(chi2.sf(squared, degrees), rel=1e-11, abs=1e-300)


@pytest.mark.parametrize("degrees", DEGREES)
@pytest.mark.parametrize("share", [1e-3, 0.5, GATE, 1 - 1e-9])
def test_quantiles_are_scipy_s(degrees: int, share: float) -> None:
    """From one in a thousand to where one in a thousand million lies beyond."""
    assert quantile(share, degrees) == pytest.approx(chi2.ppf(share, degrees), rel=1e-8, abs=1e-9)


@pytest.mark.parametrize("degrees", DEGREES)
def test_quantile_and_tail_undo_each_other(degrees: int) -> None:
    """What lies beyond a quantile is the rest."""
    for share in (0.01, 0.5, GATE):
        assert tail(quantile(share, degrees), degrees) == pytest.approx(1 - share, rel=1e-12)


def test_the_gate_of_nothing_is_zero() -> None:
    """A pose at which nothing was read passes nothing; others have the 99.9 % quantile."""
    assert chi_squared_gate(0) == 0
    assert chi_squared_gate(4) == pytest.approx(chi2.ppf(0.999, 4), rel=1e-12)


def test_medians_of_many() -> None:
    """Element by element, to the digits of the table; nan where there is no freedom."""
    freedom = np.array([[1, 2, 3], [6, 0, 2]])
    expected = np.where(freedom > 0, chi2.median(np.maximum(freedom, 1)), np.nan)
    np.testing.assert_allclose(medians(freedom), expected, rtol=1e-6)
