"""TODO."""

from __future__ import annotations

import math
from functools import cache
from math import exp, factorial

import numpy as np

from urdfcal.base.geometry import Matrix

GATE = 0.999  # share of good poses that lie within the gate
MEDIANS = {1: 0.454936, 2: 2 * np.log(2.0), 3: 2.365974, 6: 5.348121}  # of chi-squared, by degrees of freedom


@cache
def chi_squared_gate(numbers: int) -> float:
    """The 99.9 % quantile of chi-squared; 0 for nothing measured.

    A beam gives two numbers, and for an even number of degrees of freedom the tail beyond 2 h is exp(-h) (1 + h + ... + h^(k-1)/(k-1)!).
    """
    low, high = 0.0, 20.0 + 5.0 * numbers
    while high - low > 1e-9 and numbers:
        half = (low + high) / 4
        tail = exp(-half) * sum(half**power / factorial(power) for power in range(numbers // 2))
        low, high = (2 * half, high) if tail > 1 - GATE else (low, 2 * half)
    return low


def medians(freedom: Matrix) -> Matrix:
    """Of chi-squared; there are few different degrees of freedom."""
    some, which = np.unique(freedom, return_inverse=True)
    return np.array([_median(each) for each in some.tolist()])[which].reshape(freedom.shape)


def _median(freedom: int) -> float:
    """Of chi-squared, by Wilson and Hilferty where it is not tabulated."""
    return MEDIANS.get(int(freedom), float(freedom) * (1 - 2 / (9 * max(float(freedom), 1.0))) ** 3) if freedom else np.nan


def chance_beyond(squared: float, degrees: int) -> float:
    """Probability that chi-squared with so many degrees of freedom is larger."""
    half, odd = squared / 2, degrees % 2
    chance = math.erfc(math.sqrt(half)) if odd else math.exp(-half)
    for below in range(2 - odd, degrees, 2):
        chance += half ** (below / 2) * math.exp(-half) / math.gamma(below / 2 + 1)
    return chance


def chi_squared_median(degrees: int) -> float:
    """The median of chi-squared with so many degrees of freedom, by bisection."""
    low, high = 0.0, 2.0 * degrees + 2
    while high - low > 1e-12 * degrees:
        middle = (low + high) / 2
        low, high = (middle, high) if chance_beyond(middle, degrees) > 0.5 else (low, middle)
    return (low + high) / 2
