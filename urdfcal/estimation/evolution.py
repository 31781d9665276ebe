"""Differential evolution by SciPy, over the directions that the data can see, polished by the iterated filter.

The paper leaves evolutionary algorithms as further work. They need no derivative and no good start, but thousands of predictions; the
directions that the data cannot see stay at the prior, so that the search has no valley floors to wander in.
"""

from __future__ import annotations

import numpy as np

from urdfcal.base.geometry import Vector
from urdfcal.base.progress import counted
from urdfcal.estimation.ekf import Belief, Estimate, Sweep, iterated_schedule
from urdfcal.estimation.noise import Noise
from urdfcal.estimation.residual import Linearise

_REACH = 3.0  # prior standard deviations searched either way
_SEEN = 1e-9
_GENERATIONS, _POPULATION = 60, 3
_LOST = 1e6  # cost, in metres RMS, of a state at which a measured beam misses the screen


def differential_evolution(
    linearise: Linearise, prior: Belief, noise: Noise, rng: np.random.Generator, *, tolerance: float = 1e-7, max_sweeps: int | None = None
) -> Estimate:
    """The maximum a posteriori estimate, searched by differential evolution and polished to the filter's tolerance.

    Args:
        linearise: Residual and Jacobian of the whole set at a state.
        prior: Before the data; the search covers three standard deviations of every seen direction.
        noise: Of the measurements.
        rng: Source of randomness.
        tolerance: Of the polishing.
        max_sweeps: Of the polishing.
    """
    from scipy import optimize

    linearisation = linearise(prior.x)
    if not linearisation.usable:
        return Estimate(prior, linearisation.trouble, noise, [Sweep(prior.x, np.nan, linearisation.rms)])
    scale = np.sqrt(np.diag(prior.P))
    H = linearisation.jacobian.reshape(-1, len(scale)) * scale
    values, vectors = np.linalg.eigh(H.T @ H)
    seen = vectors[:, values > _SEEN * values[-1]]

    def state(u: Vector) -> Vector:
        return np.asarray(prior.x + scale * (seen @ u))

    def cost(u: Vector) -> float:
        there = linearise(state(u))
        return float(there.rms) if there.usable else _LOST

    bounds = [(-_REACH, _REACH)] * seen.shape[1]
    with counted("generation", _GENERATIONS) as advance:
        found = optimize.differential_evolution(
            cost,
            bounds,
            maxiter=_GENERATIONS,
            popsize=_POPULATION,
            x0=np.zeros(seen.shape[1]),
            rng=rng,
            polish=False,
            init="halton",
            callback=lambda intermediate_result: advance(),
        )
    polished = iterated_schedule(linearise, prior, noise, start=state(found.x), tolerance=tolerance, max_sweeps=max_sweeps)
    searched = [
        Sweep(prior.x, np.nan, linearisation.rms),
        Sweep(state(found.x), float(np.linalg.norm(state(found.x) - prior.x)), float(found.fun)),
    ]
    return Estimate(polished.belief, polished.stop, polished.noise, [*searched, *polished.history[1:]])
