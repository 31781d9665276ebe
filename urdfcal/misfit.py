"""Do residuals scatter as the noise says? Chi-squared of every kind of reading over its own degrees of freedom.

A fit draws predictions towards what was measured. With H the whitened Jacobian and P the covariance of the parameters, a whitened
residual has the variance 1 - h, h = diag(H P H') its leverage, so that the degrees of freedom of some numbers are sum(1 - h).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from urdfcal.geometry import Matrix
from urdfcal.noise import LEAST_FREEDOM, Linearisation, Noise
from urdfcal.reading_kinds import KINDS

_SURE = 4.0  # sigmas of chi-squared beyond which it is no chance


@dataclass(frozen=True)
class Misfit:
    """How a kind of reading scatters.

    Attributes:
        chi_squared: Per degree of freedom.
        freedom: Degrees of freedom.
    """

    chi_squared: float
    freedom: float

    @property
    def odd(self) -> bool:
        """Whether it is no chance that they scatter more, or less, than the noise says."""
        return self.freedom >= LEAST_FREEDOM and abs(self.sigmas) > _SURE

    @property
    def sigmas(self) -> float:
        """How many of its own standard deviations chi-squared is too large."""
        return (self.chi_squared - 1) / float(np.sqrt(2 / max(self.freedom, 1.0)))


def misfits(here: Linearisation, noise: Noise, P: Matrix) -> tuple[Misfit, ...]:
    """One for each kind of reading, in the order of the noise.

    Args:
        here: Residual and Jacobian at the estimate.
        noise: Of the measurements.
        P: Covariance of the parameters, (p, p).

    Returns:
        Of a kind of which any state their own noise, that of those alone.
    """
    weights, stating = noise.weights(here), here.measured & ~here.unstated
    own = np.where((here.of_kinds(stating) > 0)[here.kinds], stating, here.measured)
    squares = np.where(own, (weights.residual(here) ** 2).reshape(own.shape), 0.0)
    free = np.where(own, 1 - here.leverages(weights.jacobian(here), P), 0.0)
    return tuple(
        Misfit(float(chi_squared / max(freedom, 1.0)), float(freedom))
        for chi_squared, freedom in zip(here.of_kinds(squares), here.of_kinds(free), strict=True)
    )


def misfit_words(found: Mapping[str, Misfit], kind: str, stated: bool) -> str:
    """`the spots scatter 2 times as much as the stated noise explains (chi-square 4 per degree of freedom)`."""
    own = found[kind]
    noise = "stated noise" if stated else "stated noise of the joints"
    return (
        f"the {KINDS[kind].several} scatter {np.sqrt(own.chi_squared):.2g} times as much as the {noise} explains "
        f"(chi-square {own.chi_squared:.3g} per degree of freedom)"
    )
