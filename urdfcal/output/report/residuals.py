"""How far each spot of a calibration lies from where it was measured, and which spots do not belong to the rest.

The length of a residual is taken in its own standard deviations, d^2 = r' S^-1 r, where S = R for a pose that was fitted and
R + J P J' for one that was not. R is what the noise puts on a spot, joint noise included. For Gaussian noise P(d > t) is
exp(-t^2 / 2), whatever the spot.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from urdfcal.base.geometry import MM, Array3, Array4, Matrix
from urdfcal.calibration.problem import Problem, problem_of
from urdfcal.calibration.result import FitResult
from urdfcal.estimation.residual import Linearisation
from urdfcal.model.error_model import ErrorModel
from urdfcal.sensors.measurements import Measurements

_LEAST_SPREAD = 1e-6  # [m]: residuals below it are rounding
_MEDIAN = math.sqrt(2 * math.log(2))  # of the length of a standard normal pair
_ENOUGH = 20  # spots from which a median says something
_LEAST_LENGTH = 4.0


@dataclass(frozen=True)
class SpotResiduals:
    """Measured and predicted spots of some poses.

    Attributes:
        label: What the poses are for: `fit` or `test`.
        data: The poses.
        before: Spots that the nominal robot predicts, (n, lasers, 2), [m].
        after: Spots that the calibrated robot predicts, (n, lasers, 2), [m].
        sigma: Standard deviation that the noise puts on a spot coordinate, (n, lasers), [m].
        lengths: Length of each residual in its own standard deviations, (n, lasers); nan where nothing was seen.
    """

    label: str
    data: Measurements
    before: Array3
    after: Array3
    sigma: Matrix
    lengths: Matrix

    @cached_property
    def before_mm(self) -> Matrix:
        """Distances with the nominal robot, (n, lasers), [mm]; nan where nothing was seen."""
        return np.asarray(np.linalg.norm(self.before - self.data.spots, axis=-1)) / MM

    @cached_property
    def after_mm(self) -> Matrix:
        """Distances with the calibrated robot, (n, lasers), [mm]; nan where nothing was seen."""
        return np.asarray(np.linalg.norm(self.after - self.data.spots, axis=-1)) / MM


@dataclass(frozen=True)
class Suspect:
    """A spot, or a reading, that does not belong to the rest, though the fit or the test used it.

    Attributes:
        set: `fit` or `test`.
        pose: Label of its pose.
        laser: Name of its laser, or of what was read.
        distance: From measured to predicted, in `unit`.
        length: The same in standard deviations of the usual residual.
        row, column: Its place in the set's arrays.
        unit: `mm`, `deg` or `px`.
    """

    set: str
    pose: str
    laser: str
    distance: float
    length: float
    row: int
    column: int
    unit: str = "mm"


def residuals_of(calibration: FitResult) -> list[SpotResiduals]:
    """Spots of the fitted poses and, if there are any, of the test poses; nothing where none was seen."""
    if not calibration.data.seen.any():
        return []
    found = [_residuals(calibration, "fit", calibration.data, 0.0)]
    if calibration.test_data is not None:
        found.append(_residuals(calibration, "test", calibration.test_data, 1.0))
    return found


def honest_covariance(calibration: FitResult) -> bool:
    """Whether sigmas are statements about accuracy; those of the paper's schedule are the filter's own."""
    return "paper" not in calibration.estimator


def measured_numbers(calibration: FitResult) -> int:
    """How many numbers were fitted."""
    return calibration.data.numbers


def used_numbers(calibration: FitResult) -> float:
    """How many of them the parameters used up: p - tr(P P0^-1)."""
    if not honest_covariance(calibration):
        return float(calibration.identifiability.rank)
    return max(calibration.data.numbers - calibration.freedom, 0.0)


def spread(calibration: FitResult, fitted: SpotResiduals) -> float:
    """How many of its own standard deviations the usual residual is long, by the median: 1 where the noise is stated rightly.

    Stated noise is never made smaller by it.
    """
    seen = fitted.lengths[np.isfinite(fitted.lengths)]
    least = 1.0 if calibration.estimate.noise.all_stated else _LEAST_SPREAD / calibration.estimate.noise.spot_sigma
    if len(seen) < _ENOUGH:
        return max(least, 1.0)
    free = max(2 * len(seen) - used_numbers(calibration), 1.0)
    return max(least, float(np.median(seen)) / _MEDIAN * math.sqrt(2 * len(seen) / free))


def suspect_limit(sets: Iterable[SpotResiduals]) -> float:
    """The length above which a residual is listed: healthy data show one in fewer than one of ten reports."""
    spots = sum(int(np.isfinite(each.lengths).sum()) for each in sets)
    return max(_LEAST_LENGTH, math.sqrt(2 * math.log(10 * max(spots, 1))))


def suspects(calibration: FitResult, sets: list[SpotResiduals]) -> list[Suspect]:
    """Spots whose residual is far longer than usual, the farthest first."""
    if not sets:
        return []
    usual, limit = spread(calibration, sets[0]), suspect_limit(sets)
    found = [_suspect(each, row, column, usual) for each in sets for row, column in np.argwhere(each.lengths / usual > limit).tolist()]
    return sorted(found, key=lambda suspect: -suspect.length)


def _suspect(spots: SpotResiduals, row: int, column: int, usual: float) -> Suspect:
    distance, length = float(spots.after_mm[row, column]), float(spots.lengths[row, column]) / usual
    return Suspect(spots.label, str(spots.data.poses[row]), spots.data.lasers[column], distance, length, row, column)


def _residuals(calibration: FitResult, label: str, data: Measurements, uncertain: float) -> SpotResiduals:
    nominal = ErrorModel(calibration.robot.chain, (), (), sessions=data.session_names or ("",))
    spots = tuple(each for each in data.readings if each.sensor == "spot")  # what other instruments read has residuals of its own
    data = replace(data, readings=spots, lengths=())
    before = np.stack(Problem(nominal, data).read(np.empty(0)), axis=1)
    model = problem_of(calibration.errors, data, calibration.estimate.noise)
    after = np.stack(model.read(calibration.x), axis=1)
    here = model.linearise(calibration.x)
    R = _spot_covariance(calibration, here)
    S = R + uncertain * _prediction_covariance(calibration, here) if honest_covariance(calibration) else R
    sigma = np.sqrt(np.trace(R, axis1=-2, axis2=-1) / 2)
    return SpotResiduals(label, data, before, after, sigma, _lengths(here.residual.reshape(after.shape), S, data))


def _spot_covariance(calibration: FitResult, here: Linearisation) -> Array4:
    """R of each spot alone, (n, lasers, 2, 2)."""
    noise = calibration.estimate.noise
    sigma = np.where(np.isnan(here.stated_sigma), noise.spot_sigma, here.stated_sigma)
    pairs = sigma.reshape(len(sigma), sigma.shape[1] // 2, 2)
    R = np.asarray(pairs[..., None] ** 2 * np.eye(2))
    if here.joint_jacobian.shape[-1]:
        reach = (here.joint_jacobian * noise.joint_sigma).reshape(*pairs.shape, -1)
        R = R + reach @ np.swapaxes(reach, -1, -2)
    return R


def _prediction_covariance(calibration: FitResult, here: Linearisation) -> Array4:
    """J P J' of each spot alone, (n, lasers, 2, 2)."""
    J = here.jacobian.reshape(len(here.jacobian), here.jacobian.shape[1] // 2, 2, here.jacobian.shape[-1])
    return np.asarray(J @ calibration.covariance @ np.swapaxes(J, -1, -2))


def _lengths(residual: Array3, S: Array4, data: Measurements) -> Matrix:
    good = data.seen & np.isfinite(residual).all(axis=-1) & np.isfinite(S).all(axis=(-1, -2))
    lengths = np.full(good.shape, np.nan)
    lengths[good] = np.sqrt(np.sum(residual[good] * np.linalg.solve(S[good], residual[good][..., None])[..., 0], axis=-1))
    return lengths
