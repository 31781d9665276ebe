"""Mistakes in spots and joints, recognised from how well the spots fit with them undone.

Each hypothesis undoes one mistake (`mistakes.py`). What a quick robust fit (`aim.py`) leaves over is compared; the median decides, so
that outliers do not. First the priors hold as they stand, then screen and module may be placed only roughly. A mistake is named when
undoing it makes the data fit many times better.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Protocol

import numpy as np

from urdfcal.aim import AimFit, Wanted, aim_cost, aim_fit
from urdfcal.mistakes import mistakes_of_joints, mistakes_of_spots
from urdfcal.noise import Noise
from urdfcal.spot_model import SpotModel
from urdfcal.start import credible, far_wanted, near_wanted, plausible_scale, tilted, turned_round

_BETTER = 4.0  # how many times better a mistake must explain the data to be named
_ALIKE = 1.5  # mistakes that fit this much worse than the best are as good as it
_QUICK, _THOROUGH = 6, 40  # iterations for every hypothesis, and for the best of them
_BEST = 6  # hypotheses that are tried to the end
_MANY = 1000


@dataclass(frozen=True)
class Hypothesis:
    """A mistake that explains the measurements.

    Attributes:
        undone: What undoes it, to be read behind "with".
        factor: How many times smaller the residual is with it undone.
        scale: That residual: robust standard deviation, of a spot coordinate [m] or in units of the usual noise.
        instead: What else would explain the data as well, if anything: a rig that is turned round, another mistake.
    """

    undone: str
    factor: float = 1.0
    scale: float = np.nan
    instead: str = ""

    @property
    def words(self) -> str:
        """One line: `the data fit 40 times better with laser_1 and laser_2 swapped`."""
        times = f"{self.factor:.0f}" if self.factor < _MANY else f"over {_MANY}"
        return f"the data fit {times} times better with {self.undone}" + (f" (or with {self.instead})" if self.instead else "")


@dataclass(frozen=True)
class Judged:
    """How the data fit with a mistake undone, or as they stand.

    Attributes:
        undone: What was undone.
        scale: What the fit leaves over, in any unit.
        cost: What it asks of the priors and leaves of the data where that is the scale of what is left over.
        credible: Whether it believes nothing of the robot that nobody would.
    """

    undone: str
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


def best_hypothesis(model: SpotModel, noise: Noise) -> Hypothesis | None:
    """The mistake that explains the data many times better than none does, if there is one.

    Meant for data that `find_start` finds implausible; on others it gives None after one quick fit.

    Args:
        model: Beams and spots, with the error model that is to be fitted.
        noise: Of the spots.
    """
    errors = model.errors
    mistakes = (*mistakes_of_spots(model.data), *mistakes_of_joints(model.data, errors.chain.inputs))
    for wanted in (near_wanted(errors, noise), far_wanted(errors, noise)):
        stands = _SpotTrial("", model, wanted, AimFit(errors.mean, np.inf)).judged()
        if stands.scale < plausible_scale(noise) and stands.credible:
            return None
        trials = [_spot_trial(mistake.undone, SpotModel(errors, mistake.change(model.data)), wanted) for mistake in mistakes]
        untouched = aim_fit(model, wanted, errors.mean, iterations=0).scale
        for named in best_of(trials, wanted.least)[:1]:
            times = times_better(stands, untouched, named, wanted.least)
            if times > 1 and named.scale < plausible_scale(noise):
                return Hypothesis(named.undone, times, named.scale, _instead(model, wanted, named))
    return None


def _instead(model: SpotModel, wanted: Wanted, best: Judged) -> str:
    """A rig that is turned round and explains the data as they stand as well as the mistake does, in words."""
    fits = (aim_fit(model, wanted, x, _THOROUGH) for x in tilted(model.errors, np.pi))
    alike = (fit for fit in fits if fit.scale < _ALIKE * max(best.scale, wanted.least))
    return next((words for fit in alike if (words := turned_round(model.errors, fit.x))), "")


def _spot_trial(undone: str, model: SpotModel, wanted: Wanted) -> _SpotTrial:
    return _SpotTrial(undone, model, wanted, aim_fit(model, wanted, model.errors.mean, _QUICK))


@dataclass(frozen=True)
class _SpotTrial:
    """A mistake in spots or joints undone, and a quick fit."""

    undone: str
    model: SpotModel
    wanted: Wanted
    quick: AimFit

    @property
    def left(self) -> float:
        return self.quick.scale

    def judged(self) -> Judged:
        fit = aim_fit(self.model, self.wanted, self.quick.x, _THOROUGH)
        cost = partial(aim_cost, self.model, self.wanted, fit.x)
        return Judged(self.undone, fit.scale, cost, credible(self.model.errors, fit.x))
