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
from urdfcal.geometry import DEG, Vector
from urdfcal.hypotheses import Hypothesis
from urdfcal.measurements import Measurements
from urdfcal.method import observations_of
from urdfcal.mistakes import Mistake, mistakes_of_joints, mistakes_of_readings
from urdfcal.noise import Noise
from urdfcal.nominal import nominal_fit
from urdfcal.robust import kind_scales, reweighted, squared_distances
from urdfcal.spot_model import SpotModel, model_for, start_sigma

_BETTER = 4.0  # how many times better a mistake must explain the data to be named
_ALIKE = 1.5  # mistakes that fit this much worse than the best are as good as it: what asks least of the joints' priors is named
_TOLD_APART = 4.0  # and what asks hardly more of them, chi-squared, is named beside it
_PLAUSIBLE = 10.0  # [times the usual noise] what may be left over without a second look
_INCREDIBLE = 6.0  # [sigmas of the prior] a joint that a fit moved farther asks for a second look
_MOST_JOINT_TURN = 20 * DEG  # no joint is made worse than that
_QUICK = 4  # sweeps that place the instruments for every hypothesis
_BEST = 6  # hypotheses that are tried to the end
_POSES = 200  # enough to tell a mistake from none


def readings_explained(model: SpotModel, found: Estimate, noise: Noise) -> bool:
    """Whether a fit put most readings where they were made and believes nothing of the joints that the prior does not.

    Args:
        model: Of the measurements.
        found: A fit of them.
        noise: As stated, or where its estimation started.
    """
    errors = model.errors
    of_joints = np.array([parameter.kind == "joint" for parameter in errors.parameters], dtype=bool)
    if np.any(np.abs(found.belief.x - errors.mean)[of_joints] > _INCREDIBLE * errors.sigma[of_joints]):
        return False
    return found.converged and _left_over(model, found.belief.x, noise) < _PLAUSIBLE


def best_reading_hypothesis(errors: ErrorModel, data: Measurements, noise: Noise) -> Hypothesis | None:
    """The mistake that explains the readings many times better than none does, if there is one.

    Args:
        errors: The error model that is to be fitted, before its instruments were placed.
        data: The measurements.
        noise: As stated, or where its estimation starts.
    """
    mistakes = (*mistakes_of_readings(data), *mistakes_of_joints(data, errors.chain.inputs))
    quick = sorted((_trial(errors, data, noise, mistake) for mistake in mistakes), key=lambda trial: trial.untouched)
    fits = [_fitted(trial, noise) for trial in quick[:_BEST]]
    fits = [fit for fit in fits if fit.credible]
    if not fits:
        return None
    least = max(min(fit.scale for fit in fits), 1.0)
    named, *others = sorted((fit for fit in fits if fit.scale <= _ALIKE * least), key=lambda fit: fit.pull)
    as_it_stands = _fitted(_trial(errors, data, noise, Mistake("", lambda data: data)), noise)
    factor = _factor(as_it_stands, named)
    alike = [fit.undone for fit in others if fit.pull < named.pull + _TOLD_APART]
    return Hypothesis(named.undone, factor, named.scale, " or with ".join(alike)) if factor >= _BETTER else None


@dataclass(frozen=True)
class _Trial:
    """The measurements with a mistake undone.

    Attributes:
        undone: What was undone.
        model: Of some of them; None where instruments cannot be placed.
        x: The state at which joints and mount are nominal, (p,).
        untouched: What the nominal robot leaves over.
    """

    undone: str
    model: SpotModel | None
    x: Vector
    untouched: float


@dataclass(frozen=True)
class _Fitted:
    """A robust fit of them.

    Attributes:
        undone: What was undone.
        untouched: What the nominal robot leaves over.
        scale: What the fit leaves over.
        pull: What it asks of the joints' priors, chi-squared.
        credible: Whether no joint is turned farther than any is made wrongly.
    """

    undone: str
    untouched: float
    scale: float
    pull: float
    credible: bool


def _factor(as_it_stands: _Fitted, named: _Fitted) -> float:
    """How many times better the data fit; 1 where something odd, but no mistake, explains them better still."""
    left = max(named.scale, 1.0)
    if as_it_stands.credible:
        return min(as_it_stands.scale, as_it_stands.untouched) / left
    return as_it_stands.untouched / left if left < _ALIKE * max(as_it_stands.scale, 1.0) else 1.0


def _trial(errors: ErrorModel, data: Measurements, noise: Noise, mistake: Mistake) -> _Trial:
    some = _some_poses(mistake.change(data))
    try:
        nominal = nominal_fit(errors, some, noise, _QUICK)
    except FitRejected:  # a camera that no place suits
        return _Trial(mistake.undone, None, errors.mean, np.inf)
    model = model_for(nominal.errors, some, noise)
    return _Trial(mistake.undone, model, nominal.x, _left_over(model, nominal.x, noise))


def _fitted(trial: _Trial, noise: Noise) -> _Fitted:
    model = trial.model
    if model is None:
        return _Fitted(trial.undone, np.inf, np.inf, np.inf, False)
    errors = model.errors
    x = reweighted(observations_of(model), Belief.independent(errors.mean, errors.sigma), noise, start=trial.x).belief.x
    of_joints = np.array([parameter.kind == "joint" for parameter in errors.parameters], dtype=bool)
    moved, turning = np.abs(x - errors.mean)[of_joints], np.array(errors.units)[of_joints] == "rad"
    pull = float(np.sum((moved / errors.sigma[of_joints]) ** 2))
    return _Fitted(trial.undone, trial.untouched, _left_over(model, x, noise), pull, not np.any(moved[turning] > _MOST_JOINT_TURN))


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
