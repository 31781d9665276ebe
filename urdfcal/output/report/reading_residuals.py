"""How far each reading of a calibration lies from what the robot predicts, and which readings do not belong to the rest.

Readings are those of instruments beside lasers. Residuals are taken as in `residuals.py`, d^2 = r' S^-1 r, of as many numbers as were
read: d^2 is chi-squared with k degrees of freedom, whose upper tail has a closed form (Abramowitz and Stegun, 26.4.4 and 26.4.5).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from urdfcal.base.geometry import MM, Labels, Mask, Matrix, Vector
from urdfcal.calibration.problem import problem_of
from urdfcal.calibration.result import FitResult
from urdfcal.calibration.start.nominal import with_new_places
from urdfcal.estimation.chi_squared import chance_beyond, chi_squared_median
from urdfcal.estimation.noise import Noise
from urdfcal.estimation.residual import Block, Linearisation
from urdfcal.model.error_model import ErrorModel
from urdfcal.output.report.residuals import Suspect, honest_covariance, measured_numbers, used_numbers
from urdfcal.sensors.measurements import Measurements, start_sigma
from urdfcal.sensors.readings import Readings
from urdfcal.sensors.sensor import UNITS

Rows = npt.NDArray[np.intp]
AT_PLACES = ("point", "socket")  # what can be drawn where it was measured
_ENOUGH = 20  # readings from which a median says something
_REPORTS = 10  # healthy data show a suspect in fewer than one of so many reports
_LEAST_LENGTH = 4.0  # [sigmas] of a pair of numbers: nothing shorter is ever suspected


@dataclass(frozen=True)
class ReadingResiduals:
    """What one instrument read of one target, put to the nominal and to the calibrated robot; only poses at which it read.

    Attributes:
        label: What the poses are for: `fit` or `test`.
        name: What tables call it.
        kind: What is read: `point`, `orientation` ...
        unit: Of everything here: `mm`, `deg` or `px`.
        rows: Which of the set's poses these are, (n,).
        poses: Their labels, (n,).
        touched: Which plane or socket was touched, (n,); the empty string for other kinds.
        before: Measured less predicted by the nominal robot, (n, k); nan for a number that was not read.
        after: The same with the calibrated robot.
        sigma: Standard deviation that the noise puts on each number, (n, k).
        lengths: Length of each residual in its own standard deviations, (n,).
        places: Where the target was measured before and after calibration, (2, n, 3), [mm] in the measuring frame; nan for kinds that
            say nothing of it.
    """

    label: str
    name: str
    kind: str
    unit: str
    rows: Rows
    poses: Labels
    touched: Labels
    before: Matrix
    after: Matrix
    sigma: Matrix
    lengths: Vector
    places: Matrix

    @cached_property
    def numbers(self) -> Vector:
        """How many numbers each reading has, (n,)."""
        return np.asarray(np.isfinite(self.sigma).sum(axis=1))

    @property
    def before_size(self) -> Vector:
        """Length of each residual with the nominal robot, (n,), in `unit`."""
        return _size(self.before)

    @property
    def after_size(self) -> Vector:
        """Length of each residual with the calibrated robot, (n,), in `unit`."""
        return _size(self.after)


def reading_residuals(calibration: FitResult) -> list[ReadingResiduals]:
    """Every instrument's readings of the fitted poses and, if there are any, of the test poses."""
    found = list(_of_set(calibration, "fit", calibration.data))
    return found + (list(_of_set(calibration, "test", calibration.test_data)) if calibration.test_data is not None else [])


def reading_suspects(calibration: FitResult, sets: Sequence[ReadingResiduals]) -> list[Suspect]:
    """Readings whose residual is far longer than is usual for their kind, the farthest first."""
    usual = {each.name: reading_spread(calibration, each) for each in sets if each.label == "fit"}
    limit = min(math.exp(-(_LEAST_LENGTH**2) / 2), 1 / (_REPORTS * max(sum(len(each.rows) for each in sets), 1)))
    found = []
    for each in sets:
        lengths = each.lengths / usual.get(each.name, 1.0)
        for row in np.flatnonzero(lengths > _LEAST_LENGTH - 1).tolist():
            if chance_beyond(float(lengths[row]) ** 2, int(each.numbers[row])) < limit:
                size = float(each.after_size[row])
                found.append(Suspect(each.label, str(each.poses[row]), each.name, size, float(lengths[row]), row, 0, each.unit))
    return sorted(found, key=lambda suspect: -suspect.length)


def reading_spread(calibration: FitResult, fitted: ReadingResiduals) -> float:
    """How many of its own standard deviations the usual residual is long, by the median; never under 1 for noise that was stated."""
    good = np.isfinite(fitted.lengths)
    least = 1.0 if calibration.estimate.noise.all_stated else 1e-3
    if good.sum() < _ENOUGH:
        return max(least, 1.0)
    expected = math.sqrt(chi_squared_median(max(round(float(fitted.numbers[good].mean())), 1)))
    share = min(used_numbers(calibration) / max(measured_numbers(calibration), 1), 0.9)
    median = float(np.median(fitted.lengths[good])) * (1 + 1 / math.sqrt(good.sum()))  # a median of few is not sure of itself
    return max(least, median / expected / math.sqrt(1 - share))


def _of_set(calibration: FitResult, label: str, data: Measurements) -> Iterator[ReadingResiduals]:
    if not any(each.sensor != "spot" for each in data.readings):
        return
    noise, before = _noise_for(calibration, data), calibration.nominal.linearise(data)
    errors, x = (calibration.errors, calibration.x) if label == "fit" else with_new_places(calibration.errors, calibration.x, data, noise)
    model = problem_of(errors, data, noise)
    here = model.linearise(x)
    S = R = noise.pose_covariance(here)
    if label == "test" and honest_covariance(calibration) and errors is calibration.errors:
        S = R + here.jacobian @ calibration.covariance @ here.jacobian.transpose(0, 2, 1)
    sigma = np.sqrt(np.diagonal(R, axis1=1, axis2=2))
    nominal = calibration.nominal
    states = [_values(*with_new_places(nominal.alone, nominal.instruments, data, noise)), _values(errors, x)]
    for block, own in zip(here.blocks, data.readings, strict=True):
        if own.sensor == "spot":
            continue
        rows = np.flatnonzero(own.seen)
        read, size = here.measured[rows, block.columns], UNITS[block.unit]
        residuals = [_in_unit(each, rows, block, read, size) for each in (before, here)]
        yield ReadingResiduals(
            label=label,
            name=block.name,
            kind=own.sensor,
            unit=block.unit,
            rows=rows,
            poses=data.poses[rows],
            touched=own.labels[rows],
            before=residuals[0],
            after=residuals[1],
            sigma=np.where(read, sigma[rows, block.columns], np.nan) / size,
            lengths=_lengths(here.residual[rows, block.columns], S[rows, block.columns, block.columns]),
            places=np.array([_places(own, rows, state) for state in states]) / MM,
        )


def _in_unit(here: Linearisation, rows: Rows, block: Block, read: Mask, size: float) -> Matrix:
    return np.where(read, here.residual[rows, block.columns], np.nan) / size


def _lengths(residual: Matrix, S: Matrix) -> Vector:
    """Lengths (n,) of residuals (n, k) under their covariances (n, k, k); nan where there is none."""
    good = np.isfinite(residual).all(axis=1) & np.isfinite(S).all(axis=(1, 2))
    lengths = np.full(len(residual), np.nan)
    lengths[good] = np.sqrt(np.sum(residual[good] * np.linalg.solve(S[good], residual[good][..., None])[..., 0], axis=-1))
    return lengths


def _noise_for(calibration: FitResult, data: Measurements) -> Noise:
    """The fit's noise for the kinds that a set has."""
    noise = calibration.estimate.noise
    known = dict(zip(calibration.data.kinds, noise.sigma.tolist(), strict=True))
    start = zip(data.kinds, start_sigma(data).tolist(), strict=True)
    return replace(noise, sigma=np.array([known.get(kind, sigma) for kind, sigma in start]), stated=True)


def _values(errors: ErrorModel, x: Vector) -> Mapping[str, float]:
    return {**errors.held, **dict(zip(errors.names, x.tolist(), strict=True))}


def _places(own: Readings, rows: Rows, state: Mapping[str, float]) -> Matrix:
    """Where each reading lies: at the measured point, or in its socket, (n, 3), [m]."""
    if own.sensor == "point":
        return np.asarray(own.values[rows])
    if own.sensor != "socket":
        return np.full((len(rows), 3), np.nan)
    sockets = {label: [state.get(f"socket:{label}.{axis}", np.nan) for axis in "xyz"] for label in own.touched}
    return np.array([sockets[str(label)] for label in own.labels[rows]]).reshape(len(rows), 3)


def _size(residual: Matrix) -> Vector:
    return np.asarray(np.sqrt(np.nansum(residual**2, axis=1)))
