"""The minus sign."""

from __future__ import annotations

import pytest

from urdfcal.base.minus import with_minus


def test_what_is_negative_has_a_true_minus() -> None:
    """Also in exponents, behind brackets and without a leading zero."""
    assert with_minus("-1.5 ± 2e-05 (-1, -.5)") == "\u22121.5 ± 2e\u221205 (\u22121, \u2212.5)"


@pytest.mark.parametrize("text", ["5-fold", "--gravity", "2026-11-28", "file-3.csv", "a - b", "-o", "laser-1", "--3"])
def test_what_is_no_number_keeps_its_hyphen(text: str) -> None:
    """Names, options, dates and dashes between words."""
    assert with_minus(text) == text
