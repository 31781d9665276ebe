"""Mistakes in the measurements, recognised from how well the data fit with them undone.

Each hypothesis undoes one mistake: swapped lasers, mirrored or turned spots, a wrong unit, a joint's sign or zero. What a quick
robust fit (`aim.py`) leaves over is compared; the median decides, so that outliers do not. First the priors hold as they stand, then
screen and module may be placed only roughly. A mistake is named when undoing it makes the data fit many times better.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations

import numpy as np
import numpy.typing as npt

from urdfcal.aim import AimFit, Wanted, aim_cost, aim_fit
from urdfcal.geometry import DEG, MM, Matrix
from urdfcal.measurements import Measurements
from urdfcal.noise import Noise
from urdfcal.spot_model import SpotModel
from urdfcal.start import credible, far_wanted, near_wanted, plausible_scale, tilted, turned_round
from urdfcal.urdf_tree import UrdfJoint

Columns = npt.NDArray[np.intp]

_BETTER = 4.0  # how many times better a mistake must explain the data to be named
_ALIKE = 1.5  # mistakes that fit this much worse than the best are weighed against it, priors included
_QUICK, _THOROUGH = 6, 40  # iterations for every hypothesis, and for the best of them
_BEST = 6
_LEAST_TURN = 0.5  # [rad] joints that turn less than this were not read in degrees
_MOST_TURN = 4 * np.pi  # [rad] no joint is farther from zero
_ON_SCREEN = {
    "y and z of the spots swapped": [[0, 1], [1, 0]],
    "y of the spots mirrored, as if seen from behind the screen": [[-1, 0], [0, 1]],
    "z of the spots mirrored": [[1, 0], [0, -1]],
    "y and z of the spots both mirrored, as by a camera upside down": [[-1, 0], [0, -1]],
    "the spots turned by 90 deg": [[0, -1], [1, 0]],
    "the spots turned by -90 deg": [[0, 1], [-1, 0]],
    "y and z of the spots swapped and mirrored": [[0, -1], [-1, 0]],
    "the spots read as millimetres": [[MM, 0], [0, MM]],
    "the spots read as metres in place of millimetres": [[1 / MM, 0], [0, 1 / MM]],
}


@dataclass(frozen=True)
class Hypothesis:
    """A mistake in the measurements.

    Attributes:
        undone: What undoes it, to be read behind "with".
        change: The same, as a function of the measurements.
        factor: How many times smaller the residual is with it undone.
        scale: That residual: robust standard deviation of a spot coordinate, [m].
        instead: What would explain the data without a mistake, if anything: a rig that is turned round.
    """

    undone: str
    change: Callable[[Measurements], Measurements]
    factor: float = 1.0
    scale: float = np.nan
    instead: str = ""

    @property
    def words(self) -> str:
        """One line: `the data fit 40 times better with laser_1 and laser_2 swapped`."""
        return f"the data fit {self.factor:.0f} times better with {self.undone}" + (f" (or with {self.instead})" if self.instead else "")


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


def hypotheses_of(data: Measurements, joints: Sequence[UrdfJoint]) -> Iterator[Hypothesis]:
    """Every mistake that could have been made with some measurements.

    Args:
        data: The measurements.
        joints: The joints that were measured, in the order of `data.joints`.
    """
    for one, other in combinations(range(len(data.lasers)), 2):
        yield Hypothesis(f"{data.lasers[one]} and {data.lasers[other]} swapped", partial(_swapped, one, other))
    for words, matrix in _ON_SCREEN.items():
        yield Hypothesis(words, partial(_spots_through, np.array(matrix, dtype=float)))
    turning = np.array([index for index, joint in enumerate(joints) if not joint.prismatic], dtype=int)
    if len(turning) > 1:
        yield from _of_unit("all joints", "degrees", "radians", DEG, turning, data)
        yield Hypothesis("the signs of all joints flipped", partial(_moved, turning, -1.0, 0.0))
    for index, joint in enumerate(joints):
        yield from _of_joint(joint, np.array([index]), data)


def _of_joint(joint: UrdfJoint, column: Columns, data: Measurements) -> Iterator[Hypothesis]:
    yield Hypothesis(f"the sign of {joint.name} flipped", partial(_moved, column, -1.0, 0.0))
    if joint.prismatic:
        yield from _of_unit(joint.name, "millimetres", "metres", MM, column, data)
        return
    yield from _of_unit(joint.name, "degrees", "radians", DEG, column, data)
    for angle in (90, -90, 180):
        yield Hypothesis(f"{angle} deg added to {joint.name}", partial(_moved, column, 1.0, angle * DEG))


def _of_unit(name: str, small: str, large: str, factor: float, columns: Columns, data: Measurements) -> Iterator[Hypothesis]:
    """Numbers in a unit that is `factor` times another, taken for that other one; and the other way round."""
    most = float(np.abs(data.q[:, columns]).max())
    if most > _LEAST_TURN:
        yield Hypothesis(f"{name} read as {small}", partial(_moved, columns, factor, 0.0))
    if most / factor < _MOST_TURN:
        yield Hypothesis(f"{name} read as {large} in place of {small}", partial(_moved, columns, 1 / factor, 0.0))


def _swapped(one: int, other: int, data: Measurements) -> Measurements:
    order = list(range(len(data.lasers)))
    order[one], order[other] = other, one
    return replace(data, spots=data.spots[:, order], sigma=data.sigma[:, order])


def _spots_through(matrix: Matrix, data: Measurements) -> Measurements:
    return replace(data, spots=data.spots @ matrix.T)


def _moved(columns: Columns, factor: float, shift: float, data: Measurements) -> Measurements:
    q = data.q.copy()
    q[:, columns] = q[:, columns] * factor + shift
    return replace(data, q=q)


def _best(model: SpotModel, wanted: Wanted) -> Hypothesis | None:
    """The hypothesis that leaves least over; among those that leave about as little, the one that asks least of the priors."""
    errors = model.errors
    trials = [
        _Trial(hypothesis, SpotModel(errors, hypothesis.change(model.data)), wanted)
        for hypothesis in hypotheses_of(model.data, errors.chain.inputs)
    ]
    fits = [(trial, trial.fit(errors.mean, _QUICK)) for trial in trials]
    fits = sorted(fits, key=lambda pair: pair[1].scale)[:_BEST]
    fits = [(trial, fit) for trial, quick in fits if credible(errors, (fit := trial.fit(quick.x, _THOROUGH)).x)]
    if not fits:
        return None
    least = max(min(fit.scale for _, fit in fits), wanted.least)
    alike = [(trial, fit) for trial, fit in fits if fit.scale <= _ALIKE * least]
    trial, fit = min(alike, key=lambda pair: aim_cost(pair[0].model, wanted, pair[1].x, least))
    return replace(trial.hypothesis, scale=fit.scale)


@dataclass(frozen=True)
class _Trial:
    hypothesis: Hypothesis
    model: SpotModel
    wanted: Wanted

    def fit(self, x: Matrix, iterations: int) -> AimFit:
        return aim_fit(self.model, self.wanted, x, iterations)
