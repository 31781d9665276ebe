"""Readings that do not belong to the rest, though the fit or the test used them."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from urdfcal.calibration.analysis.verdict import used_share
from urdfcal.calibration.result import FitResult
from urdfcal.estimation.chi_squared import medians, quantile
from urdfcal.output.report.residuals import Residuals

_LEAST_SPREAD = 1e-6  # [m], [rad] or [px]: residuals below it are rounding
_ENOUGH = 20  # readings from which a median says something
_REPORTS = 10  # healthy data show a suspect in fewer than one of so many reports
_LEAST_LENGTH = 4.0  # [sigmas] of a pair of numbers: nothing shorter is ever suspected
_MOST_USED = 0.9  # share of the numbers that the parameters used up; what is left of more says nothing


@dataclass(frozen=True)
class Suspect:
    """A reading that does not belong to the rest.

    Attributes:
        set: `fit` or `test`.
        pose: Label of its pose.
        name: Its laser or target, as tables call it.
        distance: From measured to predicted, in `unit`.
        length: The same in standard deviations of the usual residual.
        row: Its row among its residuals.
        unit: `mm`, `deg` or `px`.
    """

    set: str
    pose: str
    name: str
    distance: float
    length: float
    row: int
    unit: str


def suspects(calibration: FitResult, sets: Sequence[Residuals]) -> list[Suspect]:
    """Readings whose residual is far longer than is usual for their kind, the longest first."""
    usual = spreads(calibration, sets)
    found = [suspect for each in sets for suspect in _of_residuals(each, usual.get(each.sensor.noise, 1.0), sets)]
    return sorted(found, key=lambda suspect: -suspect.length)


def _of_residuals(each: Residuals, usual: float, sets: Sequence[Residuals]) -> Iterator[Suspect]:
    limits = np.array([suspect_limit(sets, numbers) for numbers in range(each.sensor.numbers + 1)])
    lengths = each.lengths / usual
    for row in np.flatnonzero(lengths > limits[each.numbers]).tolist():
        yield Suspect(each.label, str(each.poses[row]), each.name, float(each.after_size[row]), float(lengths[row]), row, each.unit)


def suspect_limit(sets: Sequence[Residuals], numbers: int) -> float:
    """The length above which a residual of so many numbers is listed."""
    readings = sum(int(np.isfinite(each.lengths).sum()) for each in sets)
    chance = min(math.exp(-(_LEAST_LENGTH**2) / 2), 1 / (_REPORTS * max(readings, 1)))
    return math.sqrt(quantile(1 - chance, numbers)) if numbers else math.inf


def spreads(calibration: FitResult, sets: Sequence[Residuals]) -> Mapping[str, float]:
    """How many of its own standard deviations the usual residual of each kind is long, by the median of the fitted ones.

    It is 1 where the noise is stated rightly; stated noise is never made smaller by it.
    """
    fitted = [each for each in sets if each.label == "fit"]
    kinds = dict.fromkeys(each.sensor.noise for each in fitted)
    return {kind: _spread(calibration, kind, [each for each in fitted if each.sensor.noise == kind]) for kind in kinds}


def _spread(calibration: FitResult, kind: str, fitted: Sequence[Residuals]) -> float:
    noise, index = calibration.estimate.noise, calibration.kinds.index(kind)
    least = 1.0 if noise.stated[index] else _LEAST_SPREAD / float(noise.sigma[index])
    ratios = np.concatenate([each.lengths / np.sqrt(medians(each.numbers)) for each in fitted])
    ratios = ratios[np.isfinite(ratios)]
    if len(ratios) < _ENOUGH:
        return max(least, 1.0)
    return max(least, float(np.median(ratios)) / math.sqrt(1 - min(used_share(calibration), _MOST_USED)))
