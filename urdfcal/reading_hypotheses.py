"""Mistakes in what instruments beside lasers read, and in the joints, recognised from how well the readings fit with them undone.

Measuring frames and targets stand anywhere, so each hypothesis (`mistakes.py`) has them placed anew. All are tried with the joints as
the URDF has them, the best ones with a robust fit of everything. What is left over is compared in units of the usual noise, by the
median of each kind of reading and the worst of the kinds.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from urdfcal.ekf import Belief, Estimate
from urdfcal.error_model import ErrorModel
from urdfcal.errors import FitRejected
from urdfcal.geometry import Vector
from urdfcal.hypotheses import Hypothesis, Judged, best_of, times_better
from urdfcal.measurements import Mask, Measurements
from urdfcal.method import observations_of
from urdfcal.mistakes import Mistake, mistakes_of_joints, mistakes_of_readings
from urdfcal.noise import LEAST_FREEDOM, Noise
from urdfcal.nominal import nominal_fit
from urdfcal.robust import kind_scales, reweighted, squared_distances
from urdfcal.spot_model import SpotModel, model_for, start_sigma
from urdfcal.start import INCREDIBLE, MOST_JOINT_TURN

_TOLD_APART = 4.0  # what asks hardly more of the joints' priors than the mistake that is named, chi-squared, is named beside it
_PLAUSIBLE = 10.0  # [times the usual noise] what may be left over without a second look
_STILL = 1e-6  # of a circle
_QUICK = 4  # sweeps that place the instruments for every hypothesis
_POSES = 200  # enough to tell a mistake from none


def readings_explained(model: SpotModel, found: Estimate, noise: Noise) -> bool:
    """Whether a fit put most readings where they were made and believes nothing of the joints that the prior does not.

    Args:
        model: Of the measurements.
        found: A fit of them.
        noise: As stated, or where its estimation started.
    """
    errors = model.errors
    of_joints = _of_joints(errors)
    if np.any(np.abs(found.belief.x - errors.mean)[of_joints] > INCREDIBLE * errors.sigma[of_joints]):
        return False
    return found.converged and _left_over(model, found.belief.x, noise) < _PLAUSIBLE


def best_reading_hypothesis(errors: ErrorModel, data: Measurements, noise: Noise) -> Hypothesis | None:
    """The mistake that explains the readings many times better than none does, if there is one.

    Args:
        errors: The error model that is to be fitted, before its instruments were placed.
        data: The measurements.
        noise: As stated, or where its estimation starts.
    """
    if data.numbers - len(errors.names) < LEAST_FREEDOM:  # too few to tell one mistake from another
        return None
    mistakes = (*mistakes_of_readings(data), *mistakes_of_joints(data, errors.chain.inputs))
    fits = best_of([_trial(errors, data, noise, mistake) for mistake in mistakes], 1.0)
    if not fits or fits[0].scale > _PLAUSIBLE:
        return None
    named, *others = fits
    stands = _trial(errors, data, noise, Mistake("", lambda data: data))
    times = times_better(stands.judged(), stands.left, named, 1.0)
    alike = [fit.undone for fit in others if fit.cost(1.0) < named.cost(1.0) + _TOLD_APART]
    return Hypothesis(named.undone, times, named.scale, " or with ".join(alike)) if times > 1 else None


@dataclass(frozen=True)
class _Trial:
    """The measurements with a mistake undone.

    Attributes:
        undone: What was undone.
        model: Of some of them; None where instruments cannot be placed.
        x: The state at which joints and mount are nominal, (p,).
        noise: As stated, or where its estimation starts.
        shrunk: How many times less the joints turn: an arm that hardly moves leaves little over of anything, and explains nothing.
        left: What the nominal robot leaves over, times that.
    """

    undone: str
    model: SpotModel | None
    x: Vector
    noise: Noise
    shrunk: float
    left: float

    def judged(self) -> Judged:
        """A robust fit; `cost` is what it asks of the joints' priors, chi-squared."""
        if self.model is None:
            return Judged(self.undone, np.inf, lambda _: np.inf, False)
        errors = self.model.errors
        prior = Belief.independent(errors.mean, errors.sigma)
        x = reweighted(observations_of(self.model), prior, self.noise, start=self.x).belief.x
        of_joints = _of_joints(errors)
        pull = float(np.sum(((x - errors.mean)[of_joints] / errors.sigma[of_joints]) ** 2))
        turns = np.abs(x - errors.mean)[of_joints & (np.array(errors.units) == "rad")]
        left = self.shrunk * _left_over(self.model, x, self.noise)
        return Judged(self.undone, left, lambda _: pull, not np.any(turns > MOST_JOINT_TURN))


def _trial(errors: ErrorModel, data: Measurements, noise: Noise, mistake: Mistake) -> _Trial:
    before, some = _some_poses(data), _some_poses(mistake.change(data))
    shrunk = max(_turning(errors, before) / max(_turning(errors, some), _STILL), 1.0)
    try:
        nominal = nominal_fit(errors, some, noise, _QUICK)
    except FitRejected:  # a camera that no place suits
        return _Trial(mistake.undone, None, errors.mean, noise, shrunk, np.inf)
    model = model_for(nominal.errors, some, noise)
    return _Trial(mistake.undone, model, nominal.x, noise, shrunk, shrunk * _left_over(model, nominal.x, noise))


def _turning(errors: ErrorModel, data: Measurements) -> float:
    """How much of a circle the turning joints see: 0 for joints at rest, 1 for all directions alike."""
    turning = [index for index, joint in enumerate(errors.chain.inputs) if not joint.prismatic]
    return float(np.sqrt(np.mean(1 - np.abs(np.exp(1j * data.q[:, turning]).mean(axis=0)) ** 2))) if turning else 1.0


def _of_joints(errors: ErrorModel) -> Mask:
    """Which parameters are errors of joints, (p,)."""
    return np.array([parameter.kind == "joint" for parameter in errors.parameters], dtype=bool)


def _left_over(model: SpotModel, x: Vector, noise: Noise) -> float:
    """Robust scale of what is left over at x, in units of the stated or the usual noise, whichever is larger; the worst of the kinds."""
    here = model.linearise(x)
    if not np.isfinite(here.residual).all():
        return np.inf
    usual = Noise(np.maximum(noise.sigma, start_sigma(model.data)), noise.joint_sigma)
    return float(kind_scales(here, squared_distances(here, usual)).max())


def _some_poses(data: Measurements) -> Measurements:
    """Enough poses to judge by; all of them where touches must not lose each other."""
    if len(data) <= _POSES or any(each.places for each in data.readings):
        return data
    return data.subset(np.linspace(0, len(data) - 1, _POSES).astype(int))
