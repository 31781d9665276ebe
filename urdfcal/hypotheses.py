"""Mistakes in spots and joints, recognised from how well the spots fit with them undone.

Each hypothesis undoes one mistake (`mistakes.py`). What a quick robust fit (`aim.py`) leaves over is compared; the median decides, so
that outliers do not. First the priors hold as they stand, then screen and module may be placed only roughly. A mistake is named when
undoing it makes the data fit many times better.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from urdfcal.aim import AimFit, Wanted, aim_cost, aim_fit
from urdfcal.geometry import Vector
from urdfcal.mistakes import mistakes_of_joints, mistakes_of_spots
from urdfcal.noise import Noise
from urdfcal.spot_model import SpotModel
from urdfcal.start import credible, far_wanted, near_wanted, plausible_scale, tilted, turned_round

_BETTER = 4.0  # how many times better a mistake must explain the data to be named
_ALIKE = 1.5  # mistakes that fit this much worse than the best are weighed against it, priors included
_QUICK, _THOROUGH = 6, 40  # iterations for every hypothesis, and for the best of them
_BEST = 6
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


def best_hypothesis(model: SpotModel, noise: Noise) -> Hypothesis | None:
    """The mistake that explains the data many times better than none does, if there is one.

    Meant for data that `find_start` finds implausible; on others it gives None after one quick fit.

    Args:
        model: Beams and spots, with the error model that is to be fitted.
        noise: Of the spots.
    """
    errors = model.errors
    for wanted in (near_wanted(errors, noise), far_wanted(errors, noise)):
        as_it_stands = aim_fit(model, wanted, errors.mean, _THOROUGH)
        if as_it_stands.scale < plausible_scale(noise) and credible(errors, as_it_stands.x):
            return None
        best = _best(model, wanted)
        if best is not None and (factor := _factor(model, wanted, as_it_stands, best)) >= _BETTER:
            return replace(best, factor=factor, instead=_instead(model, wanted, best))
    return None


def _factor(model: SpotModel, wanted: Wanted, as_it_stands: AimFit, best: Hypothesis) -> float:
    """How many times better the data fit; 1 where something odd, but no mistake, explains them better still."""
    left, untouched = max(best.scale, wanted.least), aim_fit(model, wanted, model.errors.mean, iterations=0).scale
    if credible(model.errors, as_it_stands.x):
        return min(as_it_stands.scale, untouched) / left
    return untouched / left if left < _ALIKE * max(as_it_stands.scale, wanted.least) else 1.0


def _instead(model: SpotModel, wanted: Wanted, best: Hypothesis) -> str:
    """A rig that is turned round and explains the data as they stand as well as the mistake does, in words."""
    fits = (aim_fit(model, wanted, x, _THOROUGH) for x in tilted(model.errors, np.pi))
    alike = (fit for fit in fits if fit.scale < _ALIKE * max(best.scale, wanted.least))
    return next((words for fit in alike if (words := turned_round(model.errors, fit.x))), "")


def _best(model: SpotModel, wanted: Wanted) -> Hypothesis | None:
    """The hypothesis that leaves least over; among those that leave about as little, the one that asks least of the priors."""
    errors = model.errors
    trials = [
        _Trial(mistake.undone, SpotModel(errors, mistake.change(model.data)), wanted)
        for mistake in (*mistakes_of_spots(model.data), *mistakes_of_joints(model.data, errors.chain.inputs))
    ]
    fits = [(trial, trial.fit(errors.mean, _QUICK)) for trial in trials]
    fits = sorted(fits, key=lambda pair: pair[1].scale)[:_BEST]
    fits = [(trial, fit) for trial, quick in fits if credible(errors, (fit := trial.fit(quick.x, _THOROUGH)).x)]
    if not fits:
        return None
    least = max(min(fit.scale for _, fit in fits), wanted.least)
    alike = [(trial, fit) for trial, fit in fits if fit.scale <= _ALIKE * least]
    trial, fit = min(alike, key=lambda pair: aim_cost(pair[0].model, wanted, pair[1].x, least))
    return Hypothesis(trial.undone, scale=fit.scale)


@dataclass(frozen=True)
class _Trial:
    undone: str
    model: SpotModel
    wanted: Wanted

    def fit(self, x: Vector, iterations: int) -> AimFit:
        return aim_fit(self.model, self.wanted, x, iterations)
