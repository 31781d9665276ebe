"""How far beams point past the spots that were measured: a residual that is finite for any pose of screen and module.

A spot s on the screen and a beam from p along z miss each other by the difference of two unit vectors,

    e = z - u,    u = (s - p) / |s - p|

which needs no beam to meet the screen, is never longer than 2, and changes with the twist [v, w] of the module by

    de = w x z + (I - u u') (v + w x p) / |s - p|

The fit here is meant for starts, not for answers: it is damped, robust, and knows of no noise but the one that it sees.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from urdfcal.base.geometry import MM, Array3, Array4, Mask, Matrix, Vector
from urdfcal.base.rotations import skew
from urdfcal.calibration.problem import Problem
from urdfcal.sensors.spots import Beams, beams_in

_RAYLEIGH = 1.1774  # median length of a two-dimensional Gaussian of unit sigma
_REACH = 2.5  # [scales] misses well beyond this lose their say (Cauchy's weight)
_TRUST = 0.3  # the scale is held to be this much smaller against the prior: on the way it is mostly error yet to be explained
_LEAST_DISTANCE = 10 * MM  # a source nearer to its spot than this is taken to be this far
_DAMPING, _MOST_DAMPING = 1e-3, 1e8
_REST = 1e-3  # [sigmas or scales] a step that changes nothing worth knowing


@dataclass(frozen=True)
class Misses:
    """What the beams miss at one state.

    Attributes:
        e: z - u, (n, lasers, 3); 0 where no spot was seen.
        distance: From source to spot, (n, lasers), [m]; 1 where no spot was seen.
        jacobian: de/dx, (n, lasers, 3, p); no columns where it was not asked for.
    """

    e: Array3
    distance: Matrix
    jacobian: Array4


@dataclass(frozen=True)
class AimFit:
    """A robust fit of the beams' directions.

    Attributes:
        x: State, (p,), [m] and [rad].
        scale: Robust standard deviation of a spot coordinate, seen along the beam, [m].
    """

    x: Vector
    scale: float


@dataclass(frozen=True)
class Wanted:
    """What an aim fit may move, and how far.

    Attributes:
        mean: Where the prior has the parameters, (p,).
        sigma: Its standard deviations, (p,).
        least: The smallest standard deviation of a spot coordinate worth believing, [m].
        only: Columns of x that may move, (k,); all of them if None.
    """

    mean: Vector
    sigma: Vector
    least: float
    only: npt.NDArray[np.intp] | None = None

    @property
    def free(self) -> npt.NDArray[np.intp]:
        """Columns of x that may move, (k,)."""
        return np.arange(len(self.mean)) if self.only is None else self.only

    def pull(self, x: Vector) -> float:
        """The prior's cost at x."""
        return float(np.sum(((x - self.mean) / self.sigma)[self.free] ** 2))


def misses(model: Problem, x: Vector, derivatives: bool = True) -> Misses:
    """How far every beam that was seen points past its spot at x."""
    n, lasers = model.data.seen.shape
    errors, chain = model.errors, model.errors.chain
    p = len(errors.names) if derivatives else 0
    e, distance, jacobian = np.empty((n, lasers, 3)), np.empty((n, lasers)), np.empty((n, lasers, 3, p))
    for rows, motion in model.motions(x):
        e[rows], distance[rows], by_twist = _missed(beams_in(chain, motion), model.data.spots[rows])
        if p:
            by_parameter = by_twist.reshape(-1, 3 * lasers, 6) @ motion.jac1
            jacobian[rows] = by_parameter.reshape(-1, lasers, 3, p) * motion.placed.placed.moves[chain.laser_frames][:, None]
    return Misses(e, distance, jacobian)


def aim_fit(model: Problem, wanted: Wanted, x: Vector, iterations: int = 40) -> AimFit:
    """Turn the beams towards the spots: Levenberg-Marquardt with Cauchy's weights, the scale from the median miss.

    Args:
        model: Beams and spots.
        wanted: Prior, and which parameters may move.
        x: Where to start, (p,).
        iterations: How many steps are tried.
    """
    here, damping, seen = misses(model, x), _DAMPING, model.data.seen
    scale = _scale(here, seen)
    for _ in range(iterations):
        weighing = _Weighing(here.distance, max(scale, wanted.least), seen)
        moved = x + _step(here, weighing, wanted, x, damping)
        there = misses(model, moved)  # with its derivatives at once: nearly every step is taken
        if weighing.cost(there) + wanted.pull(moved) > weighing.cost(here) + wanted.pull(x):
            damping = min(10 * damping, _MOST_DAMPING)
            continue
        rest = np.max(np.abs(moved - x) / wanted.sigma) < _REST
        last, here, x, damping = scale, there, moved, damping / 10
        scale = _scale(here, seen)
        if rest and abs(scale - last) < _REST * last:
            break
    return AimFit(x, scale)


def aim_cost(model: Problem, wanted: Wanted, x: Vector, scale: float) -> float:
    """Robust cost of a state, data and prior together, where a spot coordinate has the given standard deviation [m]."""
    here = misses(model, x, derivatives=False)
    return _Weighing(here.distance, scale, model.data.seen, trust=1.0).cost(here) + wanted.pull(x)


class _Weighing:
    """Cauchy's cost of misses in units of the scale; distances and scale are those of one state."""

    def __init__(self, distance: Matrix, scale: float, seen: Mask, trust: float = _TRUST) -> None:
        self.seen, self.reach, self.lever = seen, _REACH / trust, distance / (scale * trust)

    def cost(self, at: Misses) -> float:
        return float(self.reach**2 * np.sum(np.log1p(self._squares(at)[self.seen] / self.reach**2)))

    def roots(self, at: Misses) -> Matrix:
        """Square roots of the weights of each e, (n, lasers)."""
        return np.asarray(self.lever * self.seen / np.sqrt(1 + self._squares(at) / self.reach**2))

    def _squares(self, at: Misses) -> Matrix:
        return np.asarray(np.sum(at.e**2, axis=-1) * self.lever**2)


def _missed(beams: Beams, spots: Array3) -> tuple[Array3, Matrix, Array4]:
    """What beams miss their spots by, how far those are, and the derivative by each laser's twist, (n, lasers, 3, 6)."""
    seen = ~np.isnan(spots[..., 0])
    p, z = beams.source, beams.direction
    to_spot = np.concatenate([np.zeros((*seen.shape, 1)), spots], axis=-1) - p
    distance = np.where(seen, np.maximum(np.linalg.norm(to_spot, axis=-1), _LEAST_DISTANCE), 1.0)
    u = np.where(seen[..., None], to_spot / distance[..., None], z)
    across = (np.eye(3) - u[..., :, None] * u[..., None, :]) / distance[..., None, None]
    jacobian = np.concatenate([across, -across @ _skew(p) - _skew(z)], axis=-1)
    return z - u, distance, jacobian * seen[..., None, None]


def _skew(vectors: Array3) -> Array4:
    """The matrices of v x ., (n, lasers, 3, 3)."""
    return skew(vectors.reshape(-1, 3)).reshape(*vectors.shape, 3)


def _scale(at: Misses, seen: Mask) -> float:
    missed = (np.linalg.norm(at.e, axis=-1) * at.distance)[seen]
    return float(np.median(missed)) / _RAYLEIGH


def _step(here: Misses, weighing: _Weighing, wanted: Wanted, x: Vector, damping: float) -> Vector:
    """The damped Gauss-Newton step, (p,); solved for in units of the prior's sigmas."""
    free, sigma = wanted.free, wanted.sigma[wanted.free]
    roots = weighing.roots(here)[..., None]
    J = (here.jacobian[..., free] * roots[..., None]).reshape(-1, len(sigma)) * sigma
    gradient = J.T @ (here.e * roots).ravel() + (x - wanted.mean)[free] / sigma
    information = J.T @ J + np.eye(len(sigma))
    information[np.diag_indices(len(sigma))] *= 1 + damping
    step = np.zeros_like(x)
    step[free] = -sigma * np.linalg.solve(information, gradient)
    return step
