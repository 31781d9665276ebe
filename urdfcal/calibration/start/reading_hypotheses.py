"""Mistakes in what instruments beside lasers read: measuring frames and targets stand anywhere, so each hypothesis has them placed anew.

All are tried with the joints as the URDF has them, the best ones with a robust fit of everything. What is left over is compared in
units of the usual noise, by the median of each kind of reading and the worst of the kinds.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from urdfcal.base.errors import FitRejected
from urdfcal.base.geometry import SE3, Mask, Matrix, Vector
from urdfcal.base.progress import each
from urdfcal.calibration.problem import Problem, problem_of
from urdfcal.calibration.start.hypotheses import BETTER, Bounds, Hypothesis, MistakeFit, mistakes_in, named_mistake
from urdfcal.calibration.start.mistakes import UNTOUCHED, Mistake
from urdfcal.calibration.start.nominal import nominal_fit
from urdfcal.calibration.start.rig_search import INCREDIBLE, MOST_JOINT_TURN
from urdfcal.estimation.ekf import Belief, Estimate
from urdfcal.estimation.noise import LEAST_FREEDOM, Noise
from urdfcal.estimation.residual import Linearisation
from urdfcal.estimation.robust import Observations, degrees, iteratively_reweighted, kind_scales, mahalanobis_squared
from urdfcal.model.error_model import ErrorModel
from urdfcal.sensors.measurements import Measurements, start_sigma

_PLAUSIBLE = 10.0  # [times the usual noise] what may be left over without a second look
_BOUNDS = Bounds(1.0, _PLAUSIBLE)
_LEAST_ODD, _ODD_SHARE = 3, 0.05  # poses that do not fit, at least, for a look at whether a mistake explains them
_PROMISING = 2.0  # how many times better a quick look must be there for a thorough one
_STILL = 1e-6  # of a circle
_QUICK = 4  # sweeps that place the instruments for every hypothesis
_POSES = 200  # enough to tell a mistake from none


def readings_explained(model: Problem, found: Estimate, noise: Noise) -> bool:
    """Whether a fit put all but a few poses where they were made and believes nothing of the joints that the prior does not.

    Args:
        model: Of the measurements.
        found: A fit of them.
        noise: As stated, or where its estimation started.
    """
    errors = model.errors
    of_joints = _of_joints(errors)
    if np.any(np.abs(found.belief.x - errors.mean)[of_joints] > INCREDIBLE * errors.sigma[of_joints]):
        return False
    if not found.converged or _left_over(model, found.belief.x, noise) >= _PLAUSIBLE:
        return False
    if not _enough(model.data, _unexplained(model, found.belief.x, noise)):
        return True
    return not _enough(model.data, _unexplained(model, _robust(model, found.belief.x, noise), noise))


def best_reading_hypothesis(
    errors: ErrorModel, data: Measurements, noise: Noise, links: Mapping[str, SE3] | None = None
) -> Hypothesis | None:
    """The mistake that explains the readings many times better than none does, if there is one.

    Args:
        errors: The error model that is to be fitted, before its instruments were placed.
        data: The measurements.
        noise: As stated, or where its estimation starts.
        links: Where links that are fixed to the reference stand on it, `references.links_of_reference`.
    """
    if data.numbers - len(errors.names) < LEAST_FREEDOM:  # too few to tell one mistake from another
        return None
    stands = _undone(errors, data, noise, UNTOUCHED)
    mistakes = list(mistakes_in(errors, data, beams=False, links=links))
    trials = [_undone(errors, data, noise, mistake) for mistake in each(mistakes, "common mistake", len(mistakes))]
    return named_mistake(trials, stands, _BOUNDS) or _named_by_some(trials, stands)


def _named_by_some(trials: Sequence[_ReadingsUndone], stands: _ReadingsUndone) -> Hypothesis | None:
    """The same where a mistake spoils too few poses to move a median: judged by the poses that do not fit as they stand.

    So it is where joints were moved one at a time: all poses but those that move the joint that is read wrongly are right.
    """
    odd = stands.unexplained()
    if stands.model is None or not _enough(data := stands.model.data, odd):
        return None
    judged, stands = [replace(trial, judges=odd) for trial in trials], replace(stands, judges=odd)
    found = named_mistake([trial for trial in judged if _PROMISING * trial.left < stands.left], stands, _BOUNDS)
    return found and replace(found, what=f"{_pose_count(data, odd)} of {data.pose_count} poses fit")


def _enough(data: Measurements, odd: Mask) -> bool:
    """Whether poses with readings that do not fit, (n,), are more than a stray one or two."""
    return _pose_count(data, odd) >= max(_LEAST_ODD, _ODD_SHARE * data.pose_count)


def _pose_count(data: Measurements, rows: Mask) -> int:
    """How many poses some rows, (n,), are readings of."""
    return len(np.unique(data.pose_of[rows]))


@dataclass(frozen=True)
class _ReadingsUndone:
    """The measurements with a mistake undone.

    Attributes:
        mistake: What was undone.
        model: Of some of them; None where instruments cannot be placed.
        x: The state at which joints and mount are nominal, (p,).
        noise: As stated, or where its estimation starts.
        shrunk: How many times less the joints turn: an arm that hardly moves leaves little over of anything, and explains nothing.
        judges: The poses whose readings are looked at, (n,); all of them if None.
    """

    mistake: Mistake
    model: Problem | None
    x: Vector
    noise: Noise
    shrunk: float
    judges: Mask | None = None

    @cached_property
    def left(self) -> float:
        """What the nominal robot leaves over, as many times more as joints turn less."""
        return np.inf if self.model is None else self.shrunk * self._left_over(self.x)

    def _left_over(self, x: Vector) -> float:
        """Of all poses, and of those that judge."""
        assert self.model is not None
        everywhere = _left_over(self.model, x, self.noise)
        return everywhere if self.judges is None else max(everywhere, _left_over(self.model, x, self.noise, self.judges))

    @cached_property
    def _fitted(self) -> Vector:
        """State of a robust fit, (p,)."""
        assert self.model is not None
        return _robust(self.model, self.x, self.noise)

    def unexplained(self) -> Mask:
        """Poses of which a robust fit leaves far more over than the noise, (n,)."""
        return np.zeros(0, dtype=bool) if self.model is None else _unexplained(self.model, self._fitted, self.noise)

    def judged(self) -> MistakeFit:
        """A robust fit; `cost` is what it asks of the joints' priors, chi-squared."""
        if self.model is None:
            return MistakeFit(self.mistake, np.inf, lambda _: np.inf, False)
        errors, x = self.model.errors, self._fitted
        of_joints = _of_joints(errors)
        pull = float(np.sum(((x - errors.mean)[of_joints] / errors.sigma[of_joints]) ** 2))
        turns = np.abs(x - errors.mean)[of_joints & (np.array(errors.units) == "rad")]
        sane = not np.any(turns > MOST_JOINT_TURN) and self._spoils_none()
        return MistakeFit(self.mistake, self.shrunk * self._left_over(x), lambda _: pull, sane)

    def _spoils_none(self) -> bool:
        """Whether poses that judge are explained, and no others are lost for it."""
        return self.judges is None or bool(np.count_nonzero(self.unexplained()) * BETTER <= np.count_nonzero(self.judges))


def _undone(errors: ErrorModel, data: Measurements, noise: Noise, mistake: Mistake) -> _ReadingsUndone:
    before, some = _some_poses(data), _some_poses(mistake.change(data))
    shrunk = max(_turning(errors, before) / max(_turning(errors, some), _STILL), 1.0)
    try:
        nominal = nominal_fit(errors, some, noise, _QUICK)
    except FitRejected:  # a camera that no place suits
        return _ReadingsUndone(mistake, None, errors.mean, noise, shrunk)
    return _ReadingsUndone(mistake, problem_of(nominal.errors, some, noise), nominal.x, noise, shrunk)


def _turning(errors: ErrorModel, data: Measurements) -> float:
    """How much of a circle the turning joints see: 0 for joints at rest, 1 for all directions alike."""
    turning = [index for index, joint in enumerate(errors.chain.inputs) if not joint.prismatic]
    return float(np.sqrt(np.mean(1 - np.abs(np.exp(1j * data.q[:, turning]).mean(axis=0)) ** 2))) if turning else 1.0


def _of_joints(errors: ErrorModel) -> Mask:
    """Which parameters are errors of joints, (p,)."""
    return np.array([parameter.kind == "joint" for parameter in errors.parameters], dtype=bool)


def _robust(model: Problem, x: Vector, noise: Noise) -> Vector:
    """State of a robust fit that begins at x, (p,)."""
    prior = Belief.independent(model.errors.mean, model.errors.sigma)
    return iteratively_reweighted(Observations.of(model.linearise, x), prior, noise, start=x).belief.x


def _left_over(model: Problem, x: Vector, noise: Noise, poses: Mask | None = None) -> float:
    """Robust scale of what is left over at x, in units of the stated or the usual noise, whichever is larger; the worst of the kinds.

    Of some poses (n,), or of all.
    """
    linearisation = model.linearise(x)
    if not np.isfinite(linearisation.residual).all():
        return np.inf
    d2 = _usual_squares(model, linearisation, noise)
    if poses is not None:
        d2 = np.where(np.append(poses, np.zeros(len(d2) - len(poses), dtype=bool))[:, None], d2, np.nan)  # known lengths stand behind
    return float(kind_scales(linearisation, d2).max())


def _unexplained(model: Problem, x: Vector, noise: Noise) -> Mask:
    """Poses with a reading that is left over at x by far more than the usual noise, (n,)."""
    linearisation = model.linearise(x)
    n = len(model.data)
    d2, freedom = _usual_squares(model, linearisation, noise)[:n], degrees(linearisation)[:n]
    return np.asarray(np.any(np.nan_to_num(d2) > _PLAUSIBLE**2 * freedom, axis=1))


def _usual_squares(model: Problem, linearisation: Linearisation, noise: Noise) -> Matrix:
    usual = Noise(np.maximum(noise.sigma, start_sigma(model.data)), noise.joint_sigma)
    return mahalanobis_squared(linearisation, usual)


def _some_poses(data: Measurements) -> Measurements:
    """Enough poses to judge by; all of them where touches must not lose each other."""
    if len(data) <= _POSES or any(reading.places for reading in data.readings):
        return data
    return data.subset(np.linspace(0, len(data) - 1, _POSES).astype(int))
