"""The chi-squared distribution, without scipy, which takes longer to load than a fit takes.

Its upper tail has a closed form for whole degrees of freedom (Abramowitz and Stegun, 26.4.4 and 26.4.5); quantiles are found on it by
bisection.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
import numpy.typing as npt

from urdfcal.base.geometry import Matrix

GATE = 0.999  # share of good poses that lie within the gate
MEDIANS = {1: 0.454936, 2: 2 * math.log(2.0), 3: 2.365974}  # rounded to these digits, on which the figures of robust fits rest
_HALVINGS = 100  # more than a double has digits


def tail(squared: float, degrees: int) -> float:
    """Probability that chi-squared with so many degrees of freedom is larger."""
    half, odd = squared / 2, degrees % 2
    chance = math.erfc(math.sqrt(half)) if odd else math.exp(-half)
    term = 2 * math.sqrt(half / math.pi) * math.exp(-half) if odd else half * math.exp(-half)
    for below in range(2 - odd, degrees, 2):
        chance += term
        term *= half / (below / 2 + 1)
    return chance


@cache
def quantile(share: float, degrees: int) -> float:
    """What a share of chi-squared with so many degrees of freedom lies below."""
    low, high = 0.0, 1.0
    while tail(high, degrees) > 1 - share:
        low, high = high, 2 * high
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        low, high = (middle, high) if tail(middle, degrees) > 1 - share else (low, middle)
    return (low + high) / 2


def chi_squared_gate(numbers: int) -> float:
    """What good poses of so many numbers stay within; 0 for nothing measured."""
    return quantile(GATE, numbers) if numbers else 0.0


def median(degrees: int) -> float:
    """What half of chi-squared with so many degrees of freedom lies below; nan for none."""
    return MEDIANS.get(degrees) or (quantile(0.5, degrees) if degrees else math.nan)


def medians(freedom: npt.NDArray[Any]) -> Matrix:
    """Medians by degrees of freedom; there are few different ones."""
    some, which = np.unique(freedom, return_inverse=True)
    return np.array([median(int(degrees)) for degrees in some.tolist()])[which].reshape(freedom.shape)
