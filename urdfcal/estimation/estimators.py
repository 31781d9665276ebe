"""The estimators by name, one call for all: residual and Jacobian as a function, prior and noise in, an estimate out."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from urdfcal.base.errors import UsageError
from urdfcal.base.geometry import Vector
from urdfcal.estimation.ekf import Belief, Estimate, degrees_of_freedom, iterated_schedule, paper_schedule, posterior
from urdfcal.estimation.noise import Noise
from urdfcal.estimation.residual import Linearise
from urdfcal.estimation.robust import Observations, iteratively_reweighted

ESTIMATORS = ("ekf", "lse", "robust", "evolution")
_LEAST_R, _MOST = 1e-20, 1e6  # of Q and R, [m^2] and [rad^2]: what numbers can be inverted
SCHEDULES = ("iterated", "paper")
USUAL_Q, USUAL_R = 1e-4, 1e-4


@dataclass(frozen=True)
class Method:
    """Which estimator, and how far it goes.

    Attributes:
        estimator: One of ESTIMATORS.
        schedule: Of the EKF: `iterated` or `paper`.
        tolerance: When to stop; the estimator's own default if None.
        max_sweeps: How many sweeps are allowed; the estimator's own default if None.
        q: Q = q I of the `paper` schedule.
        r: R = r I of the `paper` schedule.
        gated: Whether outliers are taken out.
        rng: For `evolution`.
        start: Where to begin, (p,); the prior mean if None.
    """

    estimator: str = "ekf"
    schedule: str = "iterated"
    tolerance: float | None = None
    max_sweeps: int | None = None
    q: float = USUAL_Q
    r: float = USUAL_R
    gated: bool = True
    rng: np.random.Generator | None = None
    start: Vector | None = None

    def __post_init__(self) -> None:
        if self.estimator not in ESTIMATORS:
            raise UsageError(f"no estimator '{self.estimator}'; there are: {', '.join(ESTIMATORS)}")
        if self.schedule not in SCHEDULES:
            raise UsageError(f"no schedule '{self.schedule}'; there are: {', '.join(SCHEDULES)}")
        if not (0 <= self.q <= _MOST and _LEAST_R <= self.r <= _MOST):
            bounds = f"Q must lie between 0 and {_MOST:g} and R between {_LEAST_R:g} and {_MOST:g}"
            raise UsageError(f"{bounds}, found q = {self.q:g} and r = {self.r:g}")
        if self.estimator != "ekf" and self.schedule == "paper":
            raise UsageError(f"the schedule 'paper' is the EKF's; the estimator '{self.estimator}' has none")
        if not self.as_published and (self.q, self.r) != (USUAL_Q, USUAL_R):
            raise UsageError("process and measurement noise (q, r) belong to the schedule 'paper' alone; state spot_sigma elsewhere")
        if self.estimator == "robust" and self.limits():
            raise UsageError("the robust estimator takes no tolerance and no number of sweeps")

    @property
    def label(self) -> str:
        """Estimator and, of the EKF, its schedule."""
        return f"ekf, {self.schedule}" if self.estimator == "ekf" else self.estimator

    @property
    def as_published(self) -> bool:
        """Whether the filter sweeps as in the paper, and nothing is done beside it."""
        return self.estimator == "ekf" and self.schedule == "paper"

    @property
    def gates(self) -> bool:
        """Whether outliers are told apart: not in the paper's schedule; always where the estimator itself weighs them down."""
        return self.estimator == "robust" or (self.gated and not self.as_published)

    @property
    def shrinks(self) -> bool:
        """Whether the joints' prior scales may be chosen by evidence: where the noise is Gaussian and the data count once."""
        return self.estimator != "robust" and not self.as_published

    @property
    def refit(self) -> Method:
        """How a fit that follows is made, of fewer readings or under other priors: what evolution has found, the filter polishes."""
        return replace(self, estimator="ekf") if self.estimator == "evolution" else self

    def limits(self) -> dict[str, Any]:
        """Tolerance and sweeps, as far as they are set."""
        return {name: value for name in ("tolerance", "max_sweeps") if (value := getattr(self, name)) is not None}

    def run(self, linearise: Linearise, prior: Belief, noise: Noise) -> Estimate:
        """Fit one set of data."""
        if self.estimator == "robust":
            return iteratively_reweighted(Observations.of(linearise, prior.x), prior, noise, start=self.start)
        if self.estimator == "evolution":
            from urdfcal.estimation.evolution import differential_evolution

            return differential_evolution(linearise, prior, noise, self.rng or np.random.default_rng(0), **self.limits())
        if self.estimator == "lse":
            from urdfcal.estimation.least_squares import levenberg_marquardt

            return levenberg_marquardt(linearise, prior, noise, start=self.start, **self.limits())
        if self.schedule == "paper":
            swept = paper_schedule(linearise, prior, noise, q=self.q, r=self.r, **self.limits())
            return with_honest_covariance(linearise, swept, prior, noise)
        return iterated_schedule(linearise, prior, noise, start=self.start, **self.limits())


def with_honest_covariance(linearise: Linearise, swept: Estimate, prior: Belief, noise: Noise) -> Estimate:
    """The paper's estimate with the covariance that the data used once give it; the filter's own counts them in every sweep.

    Spot noise that is not stated is estimated from the residual, as elsewhere.
    """
    linearisation = linearise(swept.belief.x)
    if not linearisation.usable:
        return swept
    P = posterior(linearisation, prior, noise)
    if not noise.settled(linearisation):
        noise = noise.estimated(linearisation, degrees_of_freedom(linearisation, noise, Belief(swept.belief.x, P)))
        P = posterior(linearisation, prior, noise)
    return replace(swept, belief=Belief(swept.belief.x, P), noise=noise)
