"""Observations that a fit cannot explain: told apart, left out or mended, and named.

`robust.py` says which they are for a model, `richer.py` under which model that is asked, and `nominal_explains.py` which of them the
nominal robot has where they were read, so that the fit is to blame. Here they become words, and the measurements are fitted again
without them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from urdfcal.base.geometry import MM, Mask, Vector
from urdfcal.base.terminal import rounded
from urdfcal.calibration.nominal_explains import explained_by_nominal
from urdfcal.calibration.problem import Problem
from urdfcal.calibration.richer import Explained, judged_by_more
from urdfcal.calibration.start.nominal import NominalFit
from urdfcal.calibration.together import lie_together
from urdfcal.estimation.ekf import Belief, Estimate, iterated_schedule
from urdfcal.estimation.estimators import Method
from urdfcal.estimation.noise import Noise
from urdfcal.estimation.robust import Observations, gate, gross_outliers, inliers
from urdfcal.model.gravity import Gravity
from urdfcal.robot.robot import Robot
from urdfcal.sensors.measurements import Measurements
from urdfcal.sensors.registry import WORDS
from urdfcal.sensors.sensor import MAIN_UNIT, UNITS

_MOST_GIVEN = 100.0  # times the usual noise that no joint gives way by
_NEAR = 5.0  # [sigmas] how close to the other's place a spot must lie to have been read for it


@dataclass(frozen=True)
class Outlier:
    """An observation that was left out.

    Attributes:
        pose: Label of the pose, with the file's line where there is one.
        laser: Laser link, or target.
        distance_mm: Distance from where the calibrated robot has it; None where it has none, since the beam does not meet the screen,
            or where it is no length.
        reason: Why it was left out, in words.
        kind: `far` off, `missed` the screen in the model, or `exchanged` with another beam.
    """

    pose: str
    laser: str
    distance_mm: float | None
    reason: str
    kind: Literal["far", "missed", "exchanged"] = "far"


@dataclass(frozen=True)
class CleanFit:
    """A fit without outliers.

    Attributes:
        model: Of the data that were kept.
        estimate: The fit of those.
        outliers: What was left out or mended.
        measured: All that was measured, beams that were read for each other exchanged.
        beyond: What had to be in the model beside geometry for some readings to be no outliers.
        regained: How many these are.
        together: Where readings that the fit could not explain lie together, in words.
    """

    model: Problem
    estimate: Estimate
    measured: Measurements
    outliers: tuple[Outlier, ...] = ()
    beyond: tuple[str, ...] = ()
    regained: int = 0
    together: tuple[str, ...] = ()


@dataclass(frozen=True)
class Judge:
    """What outliers are judged by beside the fit itself.

    Attributes:
        robot: The nominal robot, as it was measured.
        nominal: The same with its instruments placed.
        gravity: Where down is, and what is carried; None where nothing was said.
    """

    robot: Robot
    nominal: NominalFit
    gravity: Gravity | None = None


@dataclass(frozen=True)
class _Apart:
    """Outliers told apart.

    Attributes:
        estimate: The fit without them.
        kept: What is none, (n, blocks).
        beyond, regained, together: As of a `CleanFit`.
    """

    estimate: Estimate
    kept: Mask
    beyond: tuple[str, ...] = ()
    regained: int = 0
    together: tuple[str, ...] = ()


def fit_without_outliers(
    method: Method, model: Problem, prior: Belief, noise: Noise, first: Estimate, judge: Judge | None = None
) -> CleanFit:
    """Take out what the fit cannot explain and refit; beams that were read for each other are exchanged before.

    The robust estimator has weighed outliers down already: its estimate stands, and they are named and left out of the tables.
    It does not stand where readings that it weighed down are none.

    Args:
        method: How to fit again.
        model: Of all the data.
        prior: Before the data.
        noise: As stated, or where to start.
        first: Fit of all the data.
        judge: What else outliers are judged by; the fit alone if None.
    """
    clean, kept = _told_apart(method, model, prior, noise, first)
    if kept is None:
        return CleanFit(model, clean, model.data)
    mended, swaps = _with_swaps_undone(model, clean)
    if swaps:
        model = model.with_data(mended)
        first = method.run(model.linearise, prior, noise)
        clean, kept = _told_apart(method, model, prior, noise, first)
    if kept is None:
        return CleanFit(model, clean, model.data, swaps)
    apart = _Apart(clean, kept)
    if judge is not None:
        apart = _judged_by_nominal(judge, _judged_by_more(judge, apart, model, prior, noise), model, prior, noise)
    clean, kept = apart.estimate, apart.kept
    history = clean.history if clean is first else [*first.history, *clean.history[1:]]
    outliers = (*swaps, *_left_out(model, clean, kept))
    clean = replace(clean, history=history)
    return CleanFit(_of_kept(model, kept), clean, model.data, outliers, apart.beyond, apart.regained, apart.together)


def _judged_by_more(judge: Judge, apart: _Apart, model: Problem, prior: Belief, noise: Noise) -> _Apart:
    """The same once models were asked that have more in them than geometry.

    None is asked where the fit found no rest, or readings scatter as no joint gives way: that is a mistake somewhere, and is refused.
    """
    found = apart.estimate.noise
    scatter = np.where(found.stated, 0.0, found.sigma) / [
        WORDS[kind].size * min(WORDS[kind].most, _MOST_GIVEN) for kind in model.data.kinds
    ]
    if not apart.estimate.converged or np.any(scatter > 1):
        return apart
    judged = judged_by_more(Explained(model, apart.estimate, apart.kept), judge.robot, noise, judge.gravity)
    if not judged.names:
        return apart
    regained = int(np.count_nonzero((judged.kept & ~apart.kept)[: len(model.data)]))
    return _keeping(judged.kept, replace(apart, beyond=judged.names, regained=regained), model, prior, noise)


def _judged_by_nominal(judge: Judge, apart: _Apart, model: Problem, prior: Belief, noise: Noise) -> _Apart:
    """The same without readings that the nominal robot explains better than the calibrated one."""
    data, n = model.data, len(model.data)
    here = model.linearise(apart.estimate.belief.x).of_poses(n)
    out = here.made & ~apart.kept[:n]
    if not out.any():
        return apart
    together = lie_together(model.errors.chain, data, np.asarray(out.any(axis=1)))
    back = explained_by_nominal(here, judge.nominal.residuals(data).of_poses(n), apart.estimate.noise, out, bool(together))
    apart, kept = replace(apart, together=together), apart.kept.copy()
    kept[:n] |= back
    return _keeping(kept, apart, model, prior, noise) if back.any() else apart


def _keeping(kept: Mask, apart: _Apart, model: Problem, prior: Belief, noise: Noise) -> _Apart:
    """The same with a fit of what is kept now, and that is by least squares: weights that the poorer judgement gave were wrong."""
    observed = Observations.of(model.linearise, apart.estimate.belief.x)
    found = iterated_schedule(lambda x: observed.at(x, kept), prior, noise, start=apart.estimate.belief.x)
    return replace(apart, estimate=found, kept=kept) if found.converged else apart


def without_gross_outliers(model: Problem, found: Estimate) -> tuple[Problem, tuple[Outlier, ...]]:
    """Poses that were not fitted, without the spots that are far beyond what the fit makes them expect; and which those are.

    A fit that is bad on all of these poses keeps them all: see `robust.gross_outliers`.

    Args:
        model: Of poses that were not fitted.
        found: The fit.
    """
    out = gross_mask(model, found)
    return (_of_kept(model, ~out), _left_out(model, found, ~out)) if out.any() else (model, ())


def gross_mask(model: Problem, found: Estimate) -> Mask:
    """Which readings these are, (n, blocks); none where the model is not that of the fit, since places in it were new."""
    if len(found.belief.x) != len(model.errors.names):
        return np.zeros((len(model.data), len(model.blocks)), dtype=bool)
    return gross_outliers(Observations.of(model.linearise, found.belief.x), found)


def within_reach(model: Problem, x: Vector) -> Problem:
    """The model without beams that do not meet the screen at x, which have no distance."""
    lost = model.linearise(x).lost
    return model if lost is None or not lost.any() else _of_kept(model, ~lost)


def _of_kept(model: Problem, kept: Mask) -> Problem:
    """The model as if the others, (n, blocks), had not been measured."""
    return model.with_data(model.data.without(~kept[: len(model.data)]))


def _told_apart(method: Method, model: Problem, prior: Belief, noise: Noise, first: Estimate) -> tuple[Estimate, Mask | None]:
    """A fit without outliers, and which observations are none, (n, blocks); None if none is."""
    spots = Observations.of(model.linearise, first.belief.x)
    if method.estimator != "robust":
        return gate(spots, prior, noise, first, begin=method.start, **method.limits())
    if not first.converged:
        return first, None
    kept = inliers(spots, prior, first)
    return first, None if kept.all() or spots.too_few(kept) else kept


def _with_swaps_undone(model: Problem, clean: Estimate) -> tuple[Measurements, tuple[Outlier, ...]]:
    """The measurements with beams exchanged that were read for each other."""
    beams = [channel for channel in model.channels if channel.sensor.on_screen]
    if len(beams) < 2:
        return model.data, ()
    data, linearisation = model.data, model.linearise(clean.belief.x)
    spots, sigma, swaps = data.spots.copy(), data.sigma.copy(), []
    predicted = spots - np.stack([linearisation.residual[: len(data), channel.block.columns] for channel in beams], axis=1)
    for pose, one, other in swapped_poses(data, predicted, _NEAR * clean.noise.spot_sigma / MM):
        for each in (spots, sigma):
            each[pose, [one, other]] = each[pose, [other, one]]
        words = f"{data.lasers[one]} and {data.lasers[other]} were read for each other; they were exchanged"
        swaps.append(Outlier(data.where(pose), data.lasers[one], _distance_mm(data, predicted, pose, one), words, "exchanged"))
    return data.with_spots(spots, sigma), tuple(swaps)


def _left_out(model: Problem, clean: Estimate, kept: Mask) -> tuple[Outlier, ...]:
    data, linearisation, outliers = model.data, model.linearise(clean.belief.x), []
    lost = linearisation.lost if linearisation.lost is not None else np.zeros_like(kept)
    for pose, index in np.argwhere((linearisation.made & ~kept)[: len(data)]).tolist():
        block = model.blocks[index]
        words, away = "its beam does not meet the screen in the model; is a joint's reading wrong?", None
        if not lost[pose, index]:
            size = UNITS[block.unit]
            away = float(np.linalg.norm(linearisation.residual[pose, block.columns])) / size
            others = model.channels[index].sensor.others
            noise = rounded(clean.noise.sigma[block.kind] / size, 3)
            words = f"{rounded(away, 3)} {block.unit} from where {others} put it, noise {noise} {block.unit}"
        kind: Literal["far", "missed"] = "missed" if lost[pose, index] else "far"
        outliers.append(Outlier(data.where(pose), block.name, away if block.unit == MAIN_UNIT else None, words, kind))
    return tuple(outliers)


def _distance_mm(data: Measurements, predicted: Vector, pose: int, laser: int) -> float:
    return float(np.linalg.norm(predicted[pose, laser] - data.spots[pose, laser]) / MM)


def swapped_poses(data: Measurements, spots: Any, inside_mm: float) -> list[tuple[int, int, int]]:
    """Poses at which two beams were read for each other: each measured spot lies at the other's predicted place.

    Args:
        data: Measurements.
        spots: Predicted spots, (n, lasers, 2), [m].
        inside_mm: How near counts as at the place, [mm].

    Returns:
        (pose, laser, laser) for each.
    """
    found = []
    lasers = len(data.lasers)
    for one in range(lasers):
        for other in range(one + 1, lasers):
            own = [np.linalg.norm(data.spots[:, k] - spots[:, k], axis=-1) / MM for k in (one, other)]
            crossed = [np.linalg.norm(data.spots[:, k] - spots[:, j], axis=-1) / MM for k, j in ((one, other), (other, one))]
            with np.errstate(invalid="ignore"):
                swapped = (np.minimum(*own) > inside_mm) & (np.maximum(*crossed) < inside_mm)
            found += [(int(pose), one, other) for pose in np.flatnonzero(swapped)]
    return found
