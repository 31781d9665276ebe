"""Mistakes in spots or joints, from what a quick robust fit of the beams (`aim.py`) leaves over of the spots with each of them undone.

First the priors hold as they stand, then screen and module may be placed only roughly.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from urdfcal.base.progress import each
from urdfcal.calibration.problem import Problem
from urdfcal.calibration.start.aim import AimFit, Wanted, aim_cost, aim_fit
from urdfcal.calibration.start.hypotheses import ALIKE, Bounds, Hypothesis, MistakeFit, mistakes_in, named_mistake
from urdfcal.calibration.start.mistakes import UNTOUCHED, Mistake
from urdfcal.calibration.start.rig_search import credible, far_wanted, near_wanted, plausible_scale, tilted, turned_round
from urdfcal.estimation.noise import Noise

_QUICK, _THOROUGH = 6, 40  # iterations for every hypothesis, and for the best of them


def best_spot_hypothesis(model: Problem, noise: Noise) -> Hypothesis | None:
    """The mistake that explains the spots many times better than none does, if there is one.

    Meant for data that `find_start` finds implausible; on others it gives None after one quick fit.

    Args:
        model: Beams and spots, with the error model that is to be fitted.
        noise: Of the spots.
    """
    errors, most = model.errors, plausible_scale(noise)
    mistakes = list(mistakes_in(errors, model.data, beams=True))
    for wanted in (near_wanted(errors, noise), far_wanted(errors, noise)):
        stands = _undone(UNTOUCHED, model, wanted, iterations=0)
        as_it_is = stands.judged()
        if as_it_is.scale < most and as_it_is.credible:
            return None
        asked = each(mistakes, "common mistake", len(mistakes))
        trials = [_undone(mistake, model.with_data(mistake.change(model.data)), wanted) for mistake in asked]
        named = named_mistake(trials, stands, Bounds(wanted.least, most))
        if named is not None:
            turned = _turned_rig(model, wanted, named.scale)
            return replace(named, instead=" or with ".join(filter(None, (named.instead, turned))))
    return None


def _turned_rig(model: Problem, wanted: Wanted, scale: float) -> str:
    """A rig that is turned round and leaves of the data as they stand as little over as the mistake does, in words."""
    fits = (aim_fit(model, wanted, x, _THOROUGH) for x in tilted(model.errors, np.pi))
    alike = (fit for fit in fits if fit.scale < ALIKE * max(scale, wanted.least))
    return next((words for fit in alike if (words := turned_round(model.errors, fit.x))), "")


def _undone(mistake: Mistake, model: Problem, wanted: Wanted, iterations: int = _QUICK) -> _SpotsUndone:
    return _SpotsUndone(mistake, model, wanted, aim_fit(model, wanted, model.errors.mean, iterations))


@dataclass(frozen=True)
class _SpotsUndone:
    """A mistake in spots or joints undone, and a quick fit."""

    mistake: Mistake
    model: Problem
    wanted: Wanted
    quick: AimFit

    @property
    def left(self) -> float:
        return self.quick.scale

    def judged(self) -> MistakeFit:
        fit = aim_fit(self.model, self.wanted, self.quick.x, _THOROUGH)
        cost = partial(aim_cost, self.model, self.wanted, fit.x)
        return MistakeFit(self.mistake, fit.scale, cost, credible(self.model.errors, fit.x))
