"""Common mistakes (`mistakes.py`), recognised from how well the data fit with them undone: many times better names one.

Every mistake is looked at quickly and the best ones thoroughly. How is for the readings to say: beams are turned towards their spots
(`spot_hypotheses.py`), measuring frames and targets stand anywhere and are placed anew (`reading_hypotheses.py`). Either way a median
of what is left over decides, so that outliers do not. Mistakes that leave as little over are told apart by what they ask of the priors.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from urdfcal.base.geometry import SE3
from urdfcal.calibration.start.couplings import mistakes_of_couplings
from urdfcal.calibration.start.mistakes import MEND, Mistake, mistakes_of_joints, mistakes_of_readings
from urdfcal.calibration.start.references import mistakes_of_reference
from urdfcal.model.error_model import ErrorModel
from urdfcal.sensors.measurements import Measurements

BETTER = 4.0  # how many times better a mistake must explain the data to be named
ALIKE = 1.5  # mistakes that fit this much worse than the best are as good as it
_BEST = 6  # hypotheses that are tried to the end
_MANY = 1000
_TOLD_APART = 4.0  # what asks hardly more of the priors than the mistake that is named, chi-squared, is named beside it


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
class MistakeFit:
    """How the data fit with a mistake undone, or as they stand.

    Attributes:
        mistake: What was undone.
        scale: What the fit leaves over, in any unit.
        cost: What it asks of the priors and leaves of the data where that is the scale of what is left over, chi-squared.
        credible: Whether it believes nothing of the robot that nobody would.
    """

    mistake: Mistake
    scale: float
    cost: Callable[[float], float]
    credible: bool


class Undone(Protocol):
    """A mistake undone that has been looked at quickly."""

    @property
    def left(self) -> float:
        """What a quick look leaves over: of the data as they stand, what the nominal robot does."""

    def judged(self) -> MistakeFit:
        """A thorough one."""


@dataclass(frozen=True)
class Bounds:
    """What may be left over, in the unit of the trials.

    Attributes:
        least: Of any data.
        most: Without a second look.
    """

    least: float
    most: float


def mistakes_in(errors: ErrorModel, data: Measurements, beams: bool, links: Mapping[str, SE3] | None = None) -> Iterator[Mistake]:
    """Every mistake that could have been made.

    Args:
        errors: The error model that is to be fitted.
        data: The measurements.
        beams: Whether spots were read, or what any other instruments read.
        links: Where links stand that readings may have been told in, `references.links_of_reference`.
    """
    yield from mistakes_of_readings(data, beams)
    yield from mistakes_of_joints(data, errors.chain.inputs)
    yield from mistakes_of_couplings(errors.chain)
    if not beams:
        yield from mistakes_of_reference(errors, links or {})


def named_mistake(trials: Sequence[Undone], stands: Undone, bounds: Bounds) -> Hypothesis | None:
    """The mistake that explains the data many times better than none does, if one does.

    Args:
        trials: Every mistake that could have been made.
        stands: The data as they stand.
        bounds: What may be left over.
    """
    fits = best_of(trials, bounds.least)
    if not fits or fits[0].scale > bounds.most:
        return None
    alike = [fit for fit in fits if fit.cost(bounds.least) < fits[0].cost(bounds.least) + _TOLD_APART]
    alike = [fit for fit in alike if fit.mistake.is_of_setup] or alike  # measurements are not mended that may be right
    named, *others = alike
    times = times_better(stands.judged(), stands.left, named, bounds.least)
    instead = " or with ".join(fit.mistake.undone for fit in others)
    return Hypothesis(named.mistake.undone, times, named.scale, instead, way_out=named.mistake.way_out) if times > 1 else None


def best_of(trials: Sequence[Undone], least: float) -> list[MistakeFit]:
    """The mistakes that leave about as little over as the best one, those that ask least first.

    Args:
        trials: Every mistake that could have been made.
        least: What is left over of any data, as `MistakeFit.scale`.
    """
    fits = [fit for trial in sorted(trials, key=lambda trial: trial.left)[:_BEST] if (fit := trial.judged()).credible]
    least = max(min((fit.scale for fit in fits), default=np.inf), least)
    return sorted((fit for fit in fits if fit.scale <= ALIKE * least), key=lambda fit: fit.cost(least))


def times_better(stands: MistakeFit, untouched: float, named: MistakeFit, least: float) -> float:
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
        factor = untouched / left if left < ALIKE * max(stands.scale, least) else 1.0
    return factor if factor >= BETTER else 1.0
