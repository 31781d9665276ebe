"""A fit without some of its poses, from the sums of all: cross-validation does not fit again.

Where everything is as linear as it looks from the estimate, the normal equations of all poses less those of the poses that are left out
are those of the others, and their solution is the others' fit. Whether it is so linear shows at the poses that were left out, of which
nothing held the parameters: where they are not where the Jacobian has them, the others are fitted from the estimate on.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from urdfcal.base.geometry import Vector
from urdfcal.calibration.problem import Problem, problem_of
from urdfcal.estimation.ekf import Belief, Estimate, iterated_schedule, taken_in
from urdfcal.estimation.normal import Normal
from urdfcal.estimation.residual import Linearisation

Rows = npt.NDArray[np.intp]

_STRAIGHT = 1e-2  # of the noise's standard deviation, by which predictions may be off where the fit is taken for linear


class LeftOut:
    """A fit, and what it is without some of its poses, with priors and noise as they are."""

    def __init__(self, model: Problem, found: Estimate) -> None:
        """Of a problem and its estimate."""
        self.model, self.noise, self.x, linearisation = model, found.noise.hold(), found.belief.x, model.linearise(found.belief.x)
        weights, count = self.noise.weights(linearisation), len(model.data)
        self._residual, self._jacobian = linearisation.residual, linearisation.jacobian
        self._H = weights.of_poses(linearisation.jacobian)
        self._e = weights.of_poses(linearisation.residual[..., None])[..., 0]
        self._pose_of = np.arange(count) if linearisation.poses is None else linearisation.poses[:count]
        self._all = self._normal(np.arange(len(self._H)))

    def of(self, rows: Rows) -> Linearisation:
        """Some rows, all readings of their poses, under the fit of all others."""
        held, moved = Problem(self.model.errors, self.model.data.subset(rows)), self._moved(np.unique(self._pose_of[rows]))
        there, straight = held.linearise(moved), self._residual[rows] - self._jacobian[rows] @ (moved - self.x)
        bent = (there.residual[: len(rows)] - straight) / self.noise.of_numbers(there)[: len(rows)]
        if there.usable and np.abs(bent).max(initial=0.0) < _STRAIGHT:
            return there
        return held.linearise(self._fitted_without(rows))

    def _normal(self, poses: Rows) -> Normal:
        return Normal.of_rows(self._H[poses].reshape(-1, len(self.x)), self._e[poses].ravel())

    @property
    def _prior(self) -> Belief:
        return Belief.independent(self.model.errors.mean, self.model.errors.sigma)

    def _moved(self, poses: Rows) -> Vector:
        """The parameters without some poses, if all is linear, (p,)."""
        own, whole, prior = self._normal(poses), self._all, self._prior
        rest = Normal(whole.A - own.A, whole.b - own.b, whole.c - own.c)
        return taken_in(prior, rest.moved(self.x - prior.x)).x

    def _fitted_without(self, rows: Rows) -> Vector:
        data = self.model.data
        kept = problem_of(self.model.errors, data.subset(np.setdiff1d(np.arange(len(data)), rows)), self.noise)
        return iterated_schedule(kept.linearise, self._prior, self.noise, start=self.x).belief.x
