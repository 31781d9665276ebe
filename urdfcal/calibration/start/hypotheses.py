"""Common mistakes, recognised from how well the data fit with them undone (`mistakes.py`); a mistake is named when they then fit many times
better.

Spots: what a quick robust fit of the beams (`aim.py`) leaves over is compared; the median decides, so that outliers do not. First the
priors hold as they stand, then screen and module may be placed only roughly.

Other readings: measuring frames and targets stand anywhere, so each hypothesis has them placed anew. All are tried with the joints as
the URDF has them, the best ones with a robust fit of everything. What is left over is compared in units of the usual noise, by the
median of each kind of reading and the worst of the kinds.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Protocol

import numpy as np

from urdfcal.base.errors import FitRejected
from urdfcal.base.geometry import SE3, Mask, Matrix, Vector
from urdfcal.calibration.problem import Problem, problem_of
from urdfcal.calibration.start.aim import AimFit, Wanted, aim_cost, aim_fit
from urdfcal.calibration.start.couplings import mistakes_of_couplings
from urdfcal.calibration.start.mistakes import MEND, UNTOUCHED, Mistake, mistakes_of_joints, mistakes_of_readings
from urdfcal.calibration.start.nominal import nominal_fit
from urdfcal.calibration.start.references import mistakes_of_reference
from urdfcal.calibration.start.rig_search import (
    INCREDIBLE,
    MOST_JOINT_TURN,
    credible,
    far_wanted,
    near_wanted,
    plausible_scale,
    tilted,
    turned_round,
)
from urdfcal.estimation.ekf import Belief, Estimate
from urdfcal.estimation.noise import LEAST_FREEDOM, Noise
from urdfcal.estimation.residual import Linearisation
from urdfcal.estimation.robust import Observations, degrees, iteratively_reweighted, kind_scales, mahalanobis_squared
from urdfcal.model.error_model import ErrorModel
from urdfcal.sensors.measurements import Measurements, start_sigma

_BETTER = 4.0  # how many times better a mistake must explain the data to be named
_ALIKE = 1.5  # mistakes that fit this much worse than the best are as good as it
_QUICK, _THOROUGH = 6, 40  # iterations for every hypothesis, and for the best of them
_BEST = 6  # hypotheses that are tried to the end
_MANY = 1000

_TOLD_APART = 4.0  # what asks hardly more of the joints' priors than the mistake that is named, chi-squared, is named beside it
_PLAUSIBLE = 10.0  # [times the usual noise] what may be left over without a second look
_LEAST_ODD, _ODD_SHARE = 3, 0.05  # poses that do not fit, at least, for a look at whether a mistake explains them
_PROMISING = 2.0  # how many times better a quick look must be there for a thorough one
_STILL = 1e-6  # of a circle
_QUICK_READINGS = 4  # sweeps that place the instruments for every hypothesis
_POSES = 200  # enough to tell a mistake from none


@dataclass(frozen=True)
class Hypothesis:
    """A mistake that explains the measurements.

    Attributes:
        undone: What undoes it, to be read behind "with".
        factor: How many times smaller the residual is with it undone.
        scale: That residual: robust standard deviation, of a spot coordinate [m] or in units of the usual noise.
        what: What fits better: the data, or some of the poses.
        way_out: What the user can do.
        instead: What else would explain the data as well, if anything: a rig that is turned round, another mistake.
    """

    undone: str
    factor: float = 1.0
    scale: float = np.nan
    instead: str = ""
    what: str = "the data fit"
    way_out: str = MEND

    @property
    def words(self) -> str:
        """One line: `the data fit 40 times better with laser_1 and laser_2 swapped`."""
        times = f"{self.factor:.0f}" if self.factor < _MANY else f"over {_MANY}"
        return f"{self.what} {times} times better with {self.undone}" + (f" (or with {self.instead})" if self.instead else "")


@dataclass(frozen=True)
class Judged:
    """How the data fit with a mistake undone, or as they stand.

    Attributes:
        mistake: What was undone.
        scale: What the fit leaves over, in any unit.
        cost: What it asks of the priors and leaves of the data where that is the scale of what is left over.
        credible: Whether it believes nothing of the robot that nobody would.
    """

    mistake: Mistake
    scale: float
    cost: Callable[[float], float]
    credible: bool


class Trial(Protocol):
    """A mistake undone that has been looked at quickly."""

    @property
    def left(self) -> float:
        """What a quick look leaves over."""

    def judged(self) -> Judged:
        """A thorough one."""


def best_of(trials: Sequence[Trial], least: float) -> list[Judged]:
    """The mistakes that leave about as little over as the best one, those that ask least first.

    Args:
        trials: Every mistake that could have been made.
        least: What is left over of any data, as `Judged.scale`.
    """
    fits = [fit for trial in sorted(trials, key=lambda trial: trial.left)[:_BEST] if (fit := trial.judged()).credible]
    least = max(min((fit.scale for fit in fits), default=np.inf), least)
    return sorted((fit for fit in fits if fit.scale <= _ALIKE * least), key=lambda fit: fit.cost(least))


def times_better(stands: Judged, untouched: float, named: Judged, least: float) -> float:
    """How many times better the data fit; 1 where it is too little, or something odd, but no mistake, explains them better still.

    Args:
        stands: A fit of the data as they stand.
        untouched: What the nominal robot leaves over of them.
        named: With the mistake undone.
        least: What is left over of any data.
    """
    left = max(named.scale, least)
    if stands.credible:
        factor = min(stands.scale, untouched) / left
    else:
        factor = untouched / left if left < _ALIKE * max(stands.scale, least) else 1.0
    return factor if factor >= _BETTER else 1.0


def best_hypothesis(model: Problem, noise: Noise) -> Hypothesis | None:
    """The mistake that explains the data many times better than none does, if there is one.

    Meant for data that `find_start` finds implausible; on others it gives None after one quick fit.

    Args:
        model: Beams and spots, with the error model that is to be fitted.
        noise: Of the spots.
    """
    errors = model.errors
    mistakes = (
        *mistakes_of_readings(model.data, beams=True),
        *mistakes_of_joints(model.data, errors.chain.inputs),
        *mistakes_of_couplings(errors.chain),
    )
    for wanted in (near_wanted(errors, noise), far_wanted(errors, noise)):
        stands = _SpotTrial(UNTOUCHED, model, wanted, AimFit(errors.mean, np.inf)).judged()
        if stands.scale < plausible_scale(noise) and stands.credible:
            return None
        trials = [_spot_trial(mistake, Problem(errors, mistake.change(model.data)), wanted) for mistake in mistakes]
        untouched = aim_fit(model, wanted, errors.mean, iterations=0).scale
        for named in best_of(trials, wanted.least)[:1]:
            times = times_better(stands, untouched, named, wanted.least)
            if times > 1 and named.scale < plausible_scale(noise):
                return Hypothesis(named.mistake.undone, times, named.scale, _instead(model, wanted, named))
    return None


def _instead(model: Problem, wanted: Wanted, best: Judged) -> str:
    """A rig that is turned round and explains the data as they stand as well as the mistake does, in words."""
    fits = (aim_fit(model, wanted, x, _THOROUGH) for x in tilted(model.errors, np.pi))
    alike = (fit for fit in fits if fit.scale < _ALIKE * max(best.scale, wanted.least))
    return next((words for fit in alike if (words := turned_round(model.errors, fit.x))), "")


def _spot_trial(mistake: Mistake, model: Problem, wanted: Wanted) -> _SpotTrial:
    return _SpotTrial(mistake, model, wanted, aim_fit(model, wanted, model.errors.mean, _QUICK))


@dataclass(frozen=True)
class _SpotTrial:
    """A mistake in spots or joints undone, and a quick fit."""

    mistake: Mistake
    model: Problem
    wanted: Wanted
    quick: AimFit

    @property
    def left(self) -> float:
        return self.quick.scale

    def judged(self) -> Judged:
        fit = aim_fit(self.model, self.wanted, self.quick.x, _THOROUGH)
        cost = partial(aim_cost, self.model, self.wanted, fit.x)
        return Judged(self.mistake, fit.scale, cost, credible(self.model.errors, fit.x))


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
    odd = [_unexplained(model, x, noise) for x in (found.belief.x, _robust(model, found.belief.x, noise))]
    return not all(_enough(own) for own in odd)


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
    mistakes = (
        *mistakes_of_readings(data, beams=False),
        *mistakes_of_joints(data, errors.chain.inputs),
        *mistakes_of_couplings(errors.chain),
        *mistakes_of_reference(errors, links or {}),
    )
    stands = _trial(errors, data, noise, UNTOUCHED)
    trials = [_trial(errors, data, noise, mistake) for mistake in mistakes]
    return _named_by(trials, stands) or _named_by_some(trials, stands)


def _named_by(trials: Sequence[_Trial], stands: _Trial) -> Hypothesis | None:
    """The mistake that explains the poses by which the trials are judged, if one does."""
    fits = best_of(trials, 1.0)
    if not fits or fits[0].scale > _PLAUSIBLE:
        return None
    alike = [fit for fit in fits if fit.cost(1.0) < fits[0].cost(1.0) + _TOLD_APART]
    alike = [fit for fit in alike if fit.mistake.is_of_setup] or alike  # measurements are not mended that may be right
    named, *others = alike
    times = times_better(stands.judged(), stands.left, named, 1.0)
    instead = " or with ".join(fit.mistake.undone for fit in others)
    return Hypothesis(named.mistake.undone, times, named.scale, instead, way_out=named.mistake.way_out) if times > 1 else None


def _named_by_some(trials: Sequence[_Trial], stands: _Trial) -> Hypothesis | None:
    """The same where a mistake spoils too few poses to move a median: judged by the poses that do not fit as they stand.

    So it is where joints were moved one at a time: all poses but those that move the joint that is read wrongly are right.
    """
    odd = stands.unexplained()
    if not _enough(odd):
        return None
    judged, stands = [replace(trial, judges=odd) for trial in trials], replace(stands, judges=odd)
    found = _named_by([trial for trial in judged if _PROMISING * trial.left < stands.left], stands)
    return found and replace(found, what=f"{np.count_nonzero(odd)} of {len(odd)} poses fit")


def _enough(odd: Mask) -> bool:
    """Whether poses that do not fit, (n,), are more than a stray reading or two."""
    return int(np.count_nonzero(odd)) >= max(_LEAST_ODD, _ODD_SHARE * len(odd))


@dataclass(frozen=True)
class _Trial:
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

    def judged(self) -> Judged:
        """A robust fit; `cost` is what it asks of the joints' priors, chi-squared."""
        if self.model is None:
            return Judged(self.mistake, np.inf, lambda _: np.inf, False)
        errors, x = self.model.errors, self._fitted
        of_joints = _of_joints(errors)
        pull = float(np.sum(((x - errors.mean)[of_joints] / errors.sigma[of_joints]) ** 2))
        turns = np.abs(x - errors.mean)[of_joints & (np.array(errors.units) == "rad")]
        sane = not np.any(turns > MOST_JOINT_TURN) and self._spoils_none()
        return Judged(self.mistake, self.shrunk * self._left_over(x), lambda _: pull, sane)

    def _spoils_none(self) -> bool:
        """Whether poses that judge are explained, and no others are lost for it."""
        return self.judges is None or bool(np.count_nonzero(self.unexplained()) * _BETTER <= np.count_nonzero(self.judges))


def _trial(errors: ErrorModel, data: Measurements, noise: Noise, mistake: Mistake) -> _Trial:
    before, some = _some_poses(data), _some_poses(mistake.change(data))
    shrunk = max(_turning(errors, before) / max(_turning(errors, some), _STILL), 1.0)
    try:
        nominal = nominal_fit(errors, some, noise, _QUICK_READINGS)
    except FitRejected:  # a camera that no place suits
        return _Trial(mistake, None, errors.mean, noise, shrunk)
    return _Trial(mistake, problem_of(nominal.errors, some, noise), nominal.x, noise, shrunk)


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
