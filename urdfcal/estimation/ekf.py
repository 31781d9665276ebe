"""The extended Kalman filter, equations (13) to (15), and its two schedules. Nothing here knows of robots.

    P+ = P + Q                                   predict (13); the state stays
    S = H P H' + R,  K = P H' S^-1               (14)
    x+ = x + K (m - h(x)),  P+ = (I - K H) P     (15), the covariance in Joseph form

`paper` sweeps the whole pose set again and again with Q and R until the state stands still. `iterated` uses the data once: it
relinearises the one update of the prior until it reproduces itself, which is the maximum a posteriori estimate, and its
covariance counts every measurement once. Where that creeps, or stalls, its step is mended by what the update leaves out (`valley.py`);
the covariance stays the filter's.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from urdfcal.base.geometry import Matrix, Vector
from urdfcal.base.progress import each
from urdfcal.estimation.noise import Noise, Weights
from urdfcal.estimation.normal import Normal
from urdfcal.estimation.residual import Linearisation, Linearise
from urdfcal.estimation.valley import Gradient, Valley

TOLERANCE = 1e-7
MAX_SWEEPS = {"iterated": 100, "paper": 5000}
STOPS = {
    "converged": "the step fell under the tolerance",
    "max_sweeps": "the sweeps allowed were used up before the step fell under the tolerance",
    "stalled": "no fraction of the step made the fit better",
    "left_screen": "a measured beam no longer meets the screen in the model",
    "not_finite": "numbers ceased to be finite",
}
_HALVINGS = 30
_NEARLY = 1e-2  # [sigmas] steps under which noise that is not stated is estimated
_SHRINKS = 0.1  # steps that shrink faster than this are Newton's last ones
_PATIENCE, _MORE = 8, 12  # sweeps before a fit may be said to creep, and that are still to come at its pace where it does
_BELIEVED, _AS_MODELLED = 0.25, 0.75  # shares of the promised gain under which a radius shrinks, and over which it grows
_STANDSTILL = 1e-12  # [m] and [rad]: steps below it are rounding
_INFLATED = 1e6  # times the others may make a variance larger before the inverse of an information is not trusted
_ROUNDING = 1e-13  # share of the largest eigenvalue under which an information eigenvalue is rounding


@dataclass(frozen=True)
class Belief:
    """A Gaussian over the parameters.

    Attributes:
        x: Mean, (p,).
        P: Covariance, (p, p).
    """

    x: Vector
    P: Matrix

    @staticmethod
    def independent(mean: Vector, sigma: Vector) -> Belief:
        """Parameters of which none tells anything of another, such as a prior; means and standard deviations, (p,)."""
        return Belief(mean, np.diag(sigma**2))


@dataclass(frozen=True)
class Sweep:
    """One line of the history, for Fig. 4."""

    x: Vector
    step: float
    residual_rms: float


@dataclass(frozen=True)
class Estimate:
    """What an estimator found.

    Attributes:
        belief: Estimate and covariance.
        stop: Key of STOPS.
        noise: The noise that was assumed at the end.
        history: State, norm of its change and residual after every sweep, starting with the prior.
    """

    belief: Belief
    stop: str
    noise: Noise
    history: list[Sweep] = field(default_factory=list)

    @property
    def converged(self) -> bool:
        """Whether the estimator came to rest."""
        return self.stop == "converged"


def update(belief: Belief, innovation: Vector, H: Matrix, R: Matrix) -> tuple[Belief, float]:
    """One Kalman update, equations (14)-(15), in Joseph form: with A = I - K H it is A P A' + K R K', multiplied out by the few rows of H.

    Args:
        belief: Before the measurement.
        innovation: m - h(x), (m,).
        H: Jacobian of h, (m, p).
        R: Covariance of the measurement, (m, m).

    Returns:
        The belief after it, and the normalised innovation squared, chi-squared with m degrees of freedom.
    """
    HP = H @ belief.P
    inverse = np.linalg.inv(HP @ H.T + R)
    K = (inverse @ HP).T
    return Belief(belief.x + K @ innovation, _joseph(belief.P, HP, H, K, K @ R)), float(innovation @ inverse @ innovation)


def _joseph(P: Matrix, HP: Matrix, H: Matrix, K: Any, KR: Any) -> Matrix:
    """(I - K H) P (I - K H)' + K R K'."""
    AP = P - K @ HP
    P = AP + (KR - AP @ H.T) @ K.T
    return np.asarray((P + P.T) / 2)


def taken_in(prior: Belief, normal: Normal) -> Belief:
    """The belief after many measurements of unit covariance of which the normal equations are known, the innovation at the prior's mean."""
    P = _of_independent(prior.P, normal.A) if np.count_nonzero(prior.P) == len(prior.x) else None
    if P is not None:
        return Belief(prior.x + P @ normal.b, P)
    H, innovation = compress(normal, np.sqrt(prior.P.diagonal()))
    HP = H @ prior.P
    K = np.linalg.solve(HP @ H.T + np.eye(len(H)), HP).T
    return Belief(prior.x + K @ innovation, _joseph(prior.P, HP, H, K, K))


def _of_independent(P: Matrix, information: Matrix) -> Matrix | None:
    """The covariance after that of parameters of which none tells anything of another, (P^-1 + H'H)^-1; None where rounding spoils it.

    Taken in units of what each parameter would be known to by itself, its diagonal says by how much the others make that worse.
    """
    whole = information.copy()
    whole.flat[:: len(P) + 1] += 1 / P.diagonal()
    scale = 1 / np.sqrt(whole.diagonal())
    try:
        inverse = np.linalg.inv(whole * scale * scale[:, None])
    except np.linalg.LinAlgError:
        return None
    if not 0 < inverse.diagonal().min() <= inverse.diagonal().max() < _INFLATED:
        return None
    return np.asarray((inverse + inverse.T) * (scale / 2) * scale[:, None])


def compress(normal: Normal, sigma: Vector) -> tuple[Matrix, Vector]:
    """Replace many measurements of unit covariance, with their innovations, by at most p that say the same of the state.

    Any root B of the information, B'B = H'H, will do, with the innovation B^-T H' innovation. Where the information is well
    conditioned that is its Cholesky factor; else the rows sqrt(L) V' of its eigenvectors, without those that rounding alone would
    claim to know. Both are taken in units of what each parameter would be known to by itself, given the standard deviations `sigma`
    before the measurement.
    """
    scale = 1 / np.sqrt(normal.A.diagonal() + 1 / sigma**2)
    information, gradient = normal.A * scale * scale[:, None], scale * normal.b
    try:
        root = np.linalg.cholesky(information)
        pivots = root.diagonal()
        if pivots.min() > 1e-5 * pivots.max():
            return root.T / scale, np.linalg.solve(root, gradient)
    except np.linalg.LinAlgError:
        pass  # not positive definite: some direction is not seen at all
    values, vectors = np.linalg.eigh(information)
    kept = values > _ROUNDING * values[-1]
    lengths, rows = np.sqrt(values[kept]), vectors[:, kept].T
    return (lengths[:, None] * rows) / scale, (rows @ gradient) / lengths


def iterated_schedule(
    linearise: Linearise,
    prior: Belief,
    noise: Noise,
    *,
    start: Vector | None = None,
    tolerance: float = TOLERANCE,
    max_sweeps: int | None = None,
) -> Estimate:
    """The maximum a posteriori estimate: one update of the prior, relinearised until its step is under `tolerance` sigmas.

    A step that would raise the cost, or let a measured beam miss the screen, is halved. Where that creeps or stalls, as along a flat
    valley, steps are those of Newton within a radius from there on. Noise that is not stated is estimated from the residual whenever
    the state has come to rest.

    Args:
        linearise: Residual and Jacobian of the whole set at a state.
        prior: Before the data.
        noise: Of the measurements.
        start: Where to linearise first; the prior mean by default.
        tolerance: Largest step of any parameter still to come, in its own posterior standard deviations, that counts as rest.
        max_sweeps: How many steps are allowed.
    """
    scale = np.sqrt(np.diag(prior.P))
    x = prior.x if start is None else start
    linearisation = linearise(x)
    belief, history = Belief(x, prior.P), [Sweep(x, np.nan, linearisation.rms)]
    if not linearisation.usable:
        return Estimate(belief, linearisation.trouble, noise, history)
    settled, last, curved, radius, since, guessed = noise.settled(linearisation), 0.0, False, np.inf, 0, False
    for sweep in each(range(max_sweeps or MAX_SWEEPS["iterated"]), "sweep"):
        here, weights, normal = linearisation, noise.weights(linearisation), noise.normal(linearisation)
        P = taken_in(prior, normal).P
        gradient = normal.b - (x - prior.x) / scale**2
        step = P @ gradient  # of the update's mean from x, but without the rounding of a whole update
        valley = Valley.at(x, gradient, P, _gradients(linearise, weights, prior), radius) if curved else None
        if valley is not None:
            step, _, _ = valley.step(radius)
        belief = Belief(x + step, P)
        sigmas = _largest(step, belief.P)
        shrinking = sigmas / last if last else 1.0
        left, last = sigmas * (shrinking if shrinking < _SHRINKS else 1.0), sigmas  # at least as small would be the step after this one
        if not settled and sigmas < _NEARLY:
            better = noise.estimated(linearisation, degrees_of_freedom(linearisation, noise, belief))
            settled, noise, last = better.close_to(noise, linearisation), better, 0.0
        elif left < tolerance or np.abs(step).max() < _STANDSTILL:
            return Estimate(belief, "converged", noise, [*history, Sweep(belief.x, float(np.linalg.norm(step)), linearisation.rms)])
        else:
            if valley is None:
                moved, there = _damped(linearise, x, step, linearisation, weights, prior)
            else:
                moved, there, radius = _within(valley, radius, linearise, x, linearisation, weights, prior)
            if there is None and curved:
                return Estimate(replace(belief, x=x), "stalled", noise, history)
            if there is not None:
                history.append(Sweep(moved, float(np.linalg.norm(moved - x)), there.rms))
                x, linearisation = moved, there
            if there is None or (not curved and _creeps(sweep - since, sigmas, shrinking, tolerance)):
                if settled or guessed:
                    curved, radius, last = True, 1.0, 0.0
                else:
                    noise = noise.estimated(linearisation, degrees_of_freedom(here, noise, belief))
                    since, last, guessed = sweep, 0.0, True
    return Estimate(replace(belief, x=x), "max_sweeps", noise, history)


def paper_schedule(
    linearise: Linearise,
    prior: Belief,
    noise: Noise,
    *,
    q: float = 1e-4,
    r: float = 1e-4,
    tolerance: float = TOLERANCE,
    max_sweeps: int | None = None,
) -> Estimate:
    """The paper's schedule: predict and update with the stacked poses, sweep after sweep, Q = q I and R = r I.

    Stops when the norm of the state change is under `tolerance` (m and rad), as in section IV. The covariance that comes out is
    the filter's own: it forgets by Q and counts the data in every sweep, and is no statement about accuracy.

    Args:
        linearise: Residual and Jacobian of the whole set at a state.
        prior: P0 and the starting state.
        noise: Kept for the report; the schedule has its own R.
        q: Variance added in every sweep, m^2 and rad^2.
        r: Variance of a spot coordinate, m^2.
        tolerance: Norm of the state change that ends the sweeps.
        max_sweeps: How many sweeps are allowed.
    """
    linearisation = linearise(prior.x)
    belief, history = prior, [Sweep(prior.x, np.nan, linearisation.rms)]
    Q, unit = q * np.eye(len(prior.x)), Weights.uniform(np.sqrt(r))
    allowed = max_sweeps or MAX_SWEEPS["paper"]
    for _ in each(range(allowed), "sweep", allowed):
        if not linearisation.usable:
            return Estimate(belief, linearisation.trouble, noise, history)
        predicted = Belief(belief.x, belief.P + Q)
        belief = taken_in(predicted, unit.normal(linearisation))
        step = float(np.linalg.norm(belief.x - predicted.x))
        if not np.isfinite(step):
            return Estimate(predicted, "not_finite", noise, [*history, Sweep(belief.x, step, linearisation.rms)])
        linearisation = linearise(belief.x)
        history.append(Sweep(belief.x, step, linearisation.rms))
        if step < tolerance:
            return Estimate(belief, "converged", noise, history)
    return Estimate(belief, "max_sweeps", noise, history)


def degrees_of_freedom(linearisation: Linearisation, noise: Noise, belief: Belief) -> Vector:
    """Numbers of each kind that do not state their noise, less the parameters that they, and not the prior, decide, (kinds,).

    Where none states any that is n - tr(P H'H).
    """
    shares = linearisation.of_kinds(np.where(linearisation.unstated, linearisation.shares, 0.0))
    return np.asarray(shares - noise.decided(linearisation, belief.P))


def _damped(
    linearise: Linearise, x: Vector, step: Vector, linearisation: Linearisation, weights: Weights, prior: Belief
) -> tuple[Vector, Linearisation | None]:
    """The longest of step, step/2, step/4 ... that does not raise the cost."""
    cost = _cost(linearisation, weights, x, prior)
    for halving in range(_HALVINGS):
        moved = x + step / 2**halving
        there = linearise(moved)
        if there.usable and _cost(there, weights, moved, prior) <= cost * (1 + 1e-9) + 1e-12:
            return moved, there
    return x, None


def _within(
    valley: Valley, radius: float, linearise: Linearise, x: Vector, linearisation: Linearisation, weights: Weights, prior: Belief
) -> tuple[Vector, Linearisation | None, float]:
    """The longest step within the radius, or one fourth as wide ..., that does not raise the cost; and the radius of the next one."""
    cost = _cost(linearisation, weights, x, prior)
    for _ in range(_HALVINGS):
        step, promised, length = valley.step(radius)
        moved = x + step
        there = linearise(moved)
        after = _cost(there, weights, moved, prior) if there.usable else np.inf
        rounding = cost * 1e-9 + 1e-12
        kept = 1.0 if promised < rounding and after <= cost + rounding else (cost - after) / promised
        if kept < _BELIEVED:
            radius = length * _BELIEVED
        elif kept > _AS_MODELLED:
            radius = max(radius, 2 * length)
        if after <= cost + rounding:
            return moved, there, radius
    return x, None, radius


def _gradients(linearise: Linearise, weights: Weights, prior: Belief) -> Gradient:
    """Half of what the cost falls by per unit of each parameter at a state, with the weights held; None where there is no cost."""

    def gradient(x: Vector) -> Vector | None:
        there = linearise(x)
        if not there.usable:
            return None
        return np.asarray(weights.residual(there) @ weights.jacobian(there) - (x - prior.x) / np.diag(prior.P))

    return gradient


def _largest(step: Vector, P: Matrix) -> float:
    """The largest step of any parameter, in its own standard deviations."""
    return float(np.max(np.abs(step) / np.sqrt(np.diag(P))))


def _creeps(sweep: int, sigmas: float, shrinking: float, tolerance: float) -> bool:
    """Whether steps shrink so slowly that at their pace many more are to come."""
    if sweep < _PATIENCE:
        return False
    return shrinking >= 1 or np.log(tolerance / sigmas) / np.log(shrinking) > _MORE


def _cost(linearisation: Linearisation, weights: Weights, x: Vector, prior: Belief) -> float:
    residual = weights.residual(linearisation)
    return float(residual @ residual + np.sum((x - prior.x) ** 2 / np.diag(prior.P)))


def posterior(linearisation: Linearisation, prior: Belief, noise: Noise) -> Matrix:
    """Covariance of the parameters, (p, p), once the data of one linearisation have been counted once; the prior's where they overflow."""
    normal = noise.normal(linearisation)
    return taken_in(prior, normal).P if np.isfinite(normal.A).all() else prior.P


def told(prior: Belief, H: Matrix, innovation: Vector | None = None) -> Belief:
    """The belief after many measurements of unit covariance at once.

    Args:
        prior: Before them.
        H: Their whitened Jacobian, (m, p).
        innovation: Measured less predicted at the prior's mean, whitened, (m,); none if only the covariance is asked for.
    """
    return taken_in(prior, Normal.of_rows(H, np.zeros(len(H)) if innovation is None else innovation))
