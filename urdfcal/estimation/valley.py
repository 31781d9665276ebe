"""Steps along a curved or flat valley, where Gauss-Newton creeps: Newton's step in the few directions in which it differs.

The update of the iterated filter leaves out what residuals make of the second derivatives, H = J'J + P0^-1 + S, S = -sum r h''. Where the
data hold a direction firmly that is nothing. Along a flat valley S is as large as the rest: the filter then goes too short or too far
each time, and creeps. With the covariance P = (J'J + P0^-1)^-1 of the filter as metric, H is the identity but for those few directions,
so that a small Krylov space of P H, grown from the filter's own step, holds Newton's step. Products with H are differences of gradients

    H z = (g(x) - g(x + e z)) / e,      g = J'r - P0^-1 (x - x0)

of one linearisation each, with the weights held. Within the space a step no longer than a radius is taken (Levenberg-Marquardt's
damping; a direction of negative curvature is followed to the radius), and the radius follows from what the cost says of it. After Gould,
Lucidi, Roma and Toint, Solving the trust-region subproblem using the Lanczos method, SIAM Journal on Optimization 9, 1999.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from urdfcal.base.geometry import Matrix, Vector

_MOST = 20  # directions of a space
_EXACT = 0.01  # share of the gradient that may be left outside of the space; less, the closer to rest
_SMALL = 1e-3  # [sigmas] and
_SMALL_STATE = 1e-5  # [m] and [rad]: steps of the differences
_NOTHING = 1e-10  # share of the first direction under which a further one is rounding
_BISECTIONS = 60
_TINY = 1e-300

Gradient = Callable[[Vector], "Vector | None"]


@dataclass(frozen=True)
class Valley:
    """The cost near a state, in the directions that matter: 2 (b'y) - y'T y is what a step Z y lowers it by.

    Attributes:
        Z: The directions, one sigma each and orthogonal in the metric of the covariance, (p, k).
        b: The gradient along them, (k,).
        curvatures: Eigenvalues of T, (k,).
        axes: Its eigenvectors, (k, k).
    """

    Z: Matrix
    b: Vector
    curvatures: Vector
    axes: Matrix

    @staticmethod
    def at(x: Vector, g: Vector, P: Matrix, gradient: Gradient, radius: float) -> Valley | None:
        """The valley at a state.

        Args:
            x: The state, (p,).
            g: Gradient there, (p,); half of what the cost falls by per unit.
            P: The filter's covariance, (p, p).
            gradient: The same elsewhere; None where the model cannot produce what was measured.
            radius: Of the step that will be taken, [sigmas]; a short one needs few directions.

        Returns:
            None where no gradient can be had nearby.
        """
        length = max(float(g @ P @ g), 0.0) ** 0.5
        if not length > 0:
            return None
        duals, Z, HZ = [g / length], [P @ g / length], []
        least = min(_EXACT, length**0.5) * length
        while True:
            product = _product(x, g, Z[-1], gradient)
            if product is None:
                return None
            HZ.append(product)
            T = np.array(Z) @ np.array(HZ).T
            rest = product - np.array(duals).T @ (np.array(Z) @ product)
            rest -= np.array(duals).T @ (np.array(Z) @ rest)
            size = max(float(rest @ P @ rest), 0.0) ** 0.5
            valley = Valley(np.array(Z).T, np.append(length, np.zeros(len(Z) - 1)), *np.linalg.eigh((T + T.T) / 2))
            if size * abs(valley.within(radius)[-1]) < least or size < _NOTHING or len(Z) == min(_MOST, len(x)):
                return valley
            duals.append(rest / size)
            Z.append(P @ rest / size)

    def step(self, radius: float) -> tuple[Vector, float, float]:
        """The step within a radius that lowers the cost most, (p,), what it would lower it by, and its length, [sigmas]."""
        y = self.within(radius)
        z = self.axes.T @ y
        return self.Z @ y, float(2 * self.b @ y - self.curvatures @ z**2), float(np.linalg.norm(y))

    def within(self, radius: float) -> Vector:
        """The same along the directions, (k,)."""
        along, least = self.axes.T @ self.b, max(0.0, -float(self.curvatures[0]))

        def damped(more: float) -> Vector:
            return np.asarray(along / np.maximum(self.curvatures + more, _TINY))

        if least or np.linalg.norm(damped(0.0)) > radius:
            low, high = least, least + float(np.linalg.norm(along)) / radius
            for _ in range(_BISECTIONS):
                middle = (low + high) / 2
                low, high = (middle, high) if np.linalg.norm(damped(middle)) > radius else (low, middle)
            least = high
        return np.asarray(self.axes @ damped(least))


def _product(x: Vector, g: Vector, z: Vector, gradient: Gradient) -> Vector | None:
    """H z by a difference of gradients."""
    small = min(_SMALL, _SMALL_STATE / float(np.max(np.abs(z))))
    there = gradient(x + small * z)
    return None if there is None else (g - there) / small
