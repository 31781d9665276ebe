"""Does the calibration hold where it was not fitted? Held-out poses, cross-validation, and a warning with its reason.

The warning compares like with like. A fitted pose draws the answer towards itself, so its residual r flatters; with J its whitened
Jacobian and P the covariance of the parameters, the residual that it would have if it had been left out is

    (I - J P J')^-1 r

(exact for a linear model). The mean squares of these over the calibration poses, and of the whitened residuals over the test poses,
are compared by an F test against a ratio that still counts as healthy, with degrees of freedom that come from the scatter of the
poses themselves, so that few test poses do not raise the alarm by chance. What the covariance predicts for the test poses,
J P J' + R, then tells whether a bad result there is only what such calibration poses must give.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from urdfcal.base.errors import UsageError
from urdfcal.base.geometry import DEG, MM, Array3, Matrix, Vector
from urdfcal.base.progress import each
from urdfcal.base.terminal import rounded
from urdfcal.calibration.error_table import SpotTable, error_table, main_unit, rms_of
from urdfcal.calibration.extra_noise import widened
from urdfcal.calibration.fitting import fit
from urdfcal.calibration.problem import Problem, problem_of
from urdfcal.calibration.result import CrossValidation, FitResult
from urdfcal.calibration.start.nominal import with_new_places
from urdfcal.estimation.ekf import Belief, degrees_of_freedom, posterior
from urdfcal.estimation.noise import Noise
from urdfcal.estimation.pose_means import total
from urdfcal.estimation.residual import Linearisation
from urdfcal.robot.robot import Robot
from urdfcal.robot.urdf_tree import UrdfJoint
from urdfcal.sensors.measurements import Measurements, fit_and_test, placed_by_session
from urdfcal.sensors.repeats import first_rows
from urdfcal.sensors.sensor import UNITS
from urdfcal.sensors.stated_noise import noise_for

Rows = npt.NDArray[np.intp]

MUCH_WORSE = 1.5  # times the RMS of the calibration poses: what is surely beyond that is said
_BY_CHANCE = 1e-3  # how often poses that are no worse than that may look so
_UNCOVERED = 0.25  # share of the test poses' range beyond that of the calibration poses that is worth a word
_LEAST_OVERHANG = {True: 5 * MM, False: 1 * DEG}  # by how much at least, for sliding and for turning joints
_SEVERAL = 4  # test poses of which one may be singled out
_NAMED = 3  # joints that are named
_LEAST_ERROR = 1e-6  # [m]; what is smaller is rounding of a noise-free simulation


def holdout(data: Measurements, share: float, rng: np.random.Generator) -> Measurements:
    """Mark poses at random as test poses, the same share of every session; all readings of one pose go together.

    Args:
        data: Measurements, none of them marked yet.
        share: Of the poses, between 0 and 1; every session keeps at least one pose to fit.
        rng: Source of randomness.

    Raises:
        UsageError: the share cannot be taken, or poses are marked already.
    """
    if not 0 < share < 1:
        raise UsageError(f"the share of poses that are held out must lie between 0 and 1, found {share:g}")
    if (data.sets == "test").any():
        raise UsageError("the measurements mark test poses in their 'set' column already; hold out no others, or take the column out")
    sets = data.sets.astype("<U4")  # as wide as "test"
    for rows in _by_session(data):
        poses = rng.permutation(rows[first_rows(data.configuration_of[rows])])
        count = min(round(share * len(poses)), len(poses) - 1)
        held = np.isin(data.configuration_of, data.configuration_of[poses[: max(count, 0)]])
        sets[rows[held[rows]]] = "test"
    if not (sets == "test").any():
        count = len(first_rows(data.configuration_of))
        raise UsageError(f"a share of {share:g} of {count} poses is no pose to hold out; ask for more, or measure more poses")
    return replace(data, sets=sets)


def kfold(robot: Robot, data: Measurements, folds: int, rng: np.random.Generator, **fit_arguments: Any) -> CrossValidation:
    """Fit as often as there are folds, each time without one of them, and predict what was left out.

    Args:
        robot: Nominal robot; left unchanged.
        data: Measurements; poses marked `test` take no part.
        folds: How many, from 2 to the number of poses; 2 are two halves, as many as poses leave out one pose at a time.
        rng: Source of randomness.
        fit_arguments: Passed to `fit`.

    Raises:
        UsageError: the folds cannot be made.
        FitRejected: as `fit`.
    """
    if "test" in fit_arguments:
        raise UsageError("cross-validation has test poses of its own; give it no others")
    data = fit_and_test(data)[0]
    before, after = _Gathered(len(data)), _Gathered(len(data))
    rms, rejected = [], []
    for number, held in enumerate(each(_folds(data, folds, rng), "fold", folds), start=1):
        kept, out = data.subset(np.setdiff1d(np.arange(len(data)), held)), data.subset(held)
        found = fit(robot, kept, **fit_arguments)
        out = widened(out, found.extra_noise)
        errors, x = with_new_places(found.errors, found.x, out, found.noise_for(out))
        predicted = Problem(errors, out).residuals(x)
        before.take(found.nominal.residuals(out), held)
        after.take(predicted, held)
        rms.append(rms_of(error_table(predicted, len(out))))
        rejected += [f"fold {number}: {found.rejection}"] if found.rejection else []
    left_out = None if before.whole is None or after.whole is None else (after.whole, before.whole)
    return CrossValidation(before.table(), after.table(), np.array(rms), tuple(rejected), data.only_spots, left_out)


class _Gathered:
    """Residuals of every pose, each from the fold that did not see it."""

    def __init__(self, poses: int) -> None:
        self.poses = poses
        self.whole: Linearisation | None = None

    def take(self, linearisation: Linearisation, rows: Rows) -> None:
        """Put the residuals of some poses in their places."""
        own = linearisation.of_poses(len(rows))
        if self.whole is None:
            n, m, blocks = self.poses, own.residual.shape[1], len(own.blocks)
            blank, none, lost = np.zeros((n, m)), np.empty((n, m, 0)), np.zeros((n, blocks), dtype=bool)
            self.whole = Linearisation(blank, none, none, blank > 0, np.full((n, m), np.nan), own.blocks, lost)
        whole = self.whole
        whole.residual[rows], whole.measured[rows], whole.stated_sigma[rows] = own.residual, own.measured, own.stated_sigma
        if own.lost is not None and whole.lost is not None:
            whole.lost[rows] = own.lost

    def table(self) -> SpotTable:
        """Distances over all poses."""
        return error_table(self.whole, self.poses) if self.whole is not None else {}


def coverage_warnings(robot: Robot, calibration: FitResult) -> tuple[str, ...]:
    """Say, if the test poses are much worse than the calibration poses, which joints' range the calibration poses do not cover.

    Args:
        robot: The robot whose joints the poses are of.
        calibration: A fit with test poses.

    Returns:
        One line, or none.
    """
    test = calibration.test_data
    if test is None or calibration.test is None or test.empty:
        return ()
    known = {name.rpartition(".")[0] for name in (*calibration.errors.names, *calibration.errors.held)}
    if any(place.name not in known for place in test.instruments.places):  # they were put where the test poses have them best
        return ()
    unit = main_unit(calibration.test[1])
    if all(row.unit != unit for row in calibration.after.values()):  # nothing to compare them with
        return ()
    compared = _compare(calibration, test, unit)
    if not compared.worse:
        return ()
    fitted, tested = rms_of(calibration.after, unit), rms_of(calibration.test[1], unit)
    sizes = f"{rounded(tested, 3)} {unit} RMS against {rounded(fitted, 3)} {unit}"
    expected = compared.predicted > tested / MUCH_WORSE
    head = (
        f"the test poses are {tested / fitted:.1f} times worse than the calibration poses ({sizes}), {'as' if expected else 'more than'} "
        f"the fit's own uncertainty predicts ({rounded(compared.predicted, 3)} {unit}): "
    )
    if compared.alone:
        return (f"{head}{compared.alone} alone is to blame; is it an outlier?",)
    beyond = _uncovered(robot, calibration.data, test)
    if beyond:
        return (f"{head}the calibration poses cover {_listed(beyond)}",)
    reason = (
        "; poses of other combinations of them would help"
        if expected
        else "; look for outliers, a rig that moved, or errors that are not in the model"
    )
    return (f"{head}the joints' ranges do not explain it{reason}",)


@dataclass(frozen=True)
class _Comparison:
    """Whether test poses are much worse, the only pose that is to blame (if it is only one), and what the fit predicts for them."""

    worse: bool
    alone: str
    predicted: float


def _compare(calibration: FitResult, test: Measurements, unit: str) -> _Comparison:
    errors, noise = calibration.errors, calibration.estimate.noise
    linearisation = problem_of(errors, calibration.data, noise).linearise(calibration.x)
    there = problem_of(errors, test, noise).linearise(calibration.x)
    prior = Belief.independent(errors.mean, errors.sigma)
    P = posterior(linearisation, prior, noise)  # every measurement counted once, whatever the estimator's own
    if not noise.settled(linearisation):
        noise = noise.estimated(linearisation, degrees_of_freedom(linearisation, noise, Belief(calibration.x, P)))
        P = posterior(linearisation, prior, noise)
    least = (_LEAST_ERROR / noise.spot_sigma) ** 2
    left_out = _mean_squares(_left_out_residuals(linearisation, noise, P), linearisation, least, calibration.data.pose_count)
    noise = noise_for(noise, calibration.kinds, test)
    tested = _mean_squares(_residuals(there, noise), there, least, test.pose_count)
    worst = int(np.argmax(tested))
    alone = len(tested) >= _SEVERAL and not _much_worse(np.delete(tested, worst), left_out)
    where = test.where(int(_first_readings(test)[worst])) if alone else ""
    return _Comparison(_much_worse(tested, left_out), where, _predicted_rms(there, noise, P, unit) / UNITS[unit])


def _first_readings(data: Measurements) -> Rows:
    """The first row of every pose that saw something."""
    rows = np.flatnonzero(data.observed)
    return np.asarray(rows[first_rows(data.pose_of[rows])])


def _residuals(linearisation: Linearisation, noise: Noise) -> Matrix:
    """Whitened residual of each pose, (poses, m)."""
    return noise.weights(linearisation).of_poses(linearisation.residual[..., None])[..., 0]


def _left_out_residuals(linearisation: Linearisation, noise: Noise, P: Matrix) -> Matrix:
    """Whitened residual of each pose as if it had been left out of the fit, (n, m)."""
    J: Array3 = noise.weights(linearisation).of_poses(linearisation.jacobian)
    kept = np.eye(J.shape[1]) * (1 + 1e-9) - (J @ P) @ J.transpose(0, 2, 1)
    return np.asarray(np.einsum("nij,nj->ni", np.linalg.inv(kept), _residuals(linearisation, noise)))


def _mean_squares(residuals: Matrix, linearisation: Linearisation, least: float, poses: int) -> Vector:
    """Mean of the squared residuals of each pose that saw something, (k,); rows of what is known beforehand are no poses."""
    measured = linearisation.measured if linearisation.poses is None else total(linearisation.poses, linearisation.measured) > 0
    count = measured[:poses].sum(axis=1)
    squares: Vector = np.sum(residuals[:poses][count > 0] ** 2, axis=1) / count[count > 0]
    return np.maximum(squares, least)


def _predicted_rms(linearisation: Linearisation, noise: Noise, P: Matrix, unit: str) -> float:
    """RMS distance that J P J' + R expects of the readings in a unit, [m], [rad] or [px]; nan where there are none."""
    variance = noise.of_numbers(linearisation) ** 2 + np.sum((linearisation.jacobian @ P) * linearisation.jacobian, axis=-1)
    if linearisation.joint_jacobian.shape[-1]:
        variance = variance + np.sum((linearisation.joint_jacobian * noise.joint_sigma) ** 2, axis=-1)
    own = [block.columns for block in linearisation.blocks if block.unit == unit]
    read = [linearisation.read[:, columns] for columns in own]
    readings = sum(int(np.count_nonzero(each.any(axis=1))) for each in read)
    whole = sum(float(np.sum(variance[:, columns][each])) for columns, each in zip(own, read, strict=True))
    return float(np.sqrt(whole / readings)) if readings else np.nan


def _much_worse(tested: Vector, fitted: Vector) -> bool:
    """Whether the mean of the first sample of squares is more than MUCH_WORSE^2 times that of the second, beyond chance."""
    ratio = float(tested.mean() / fitted.mean()) / MUCH_WORSE**2
    if not ratio > 1 or len(tested) < 2 or len(fitted) < 2:
        return False
    from scipy.special import fdtrc

    return bool(fdtrc(_freedom(tested), _freedom(fitted), ratio) < _BY_CHANCE)


def _freedom(squares: Vector) -> float:
    """Degrees of freedom of a mean of squares from its own scatter (Satterthwaite), at most four numbers a pose."""
    n, scatter = len(squares), float(squares.var(ddof=1))
    largest = 4.0 * n
    return largest if scatter == 0 else min(2 * n * float(squares.mean()) ** 2 / scatter, largest)


@dataclass(frozen=True)
class _Beyond:
    """A joint whose range in the test poses goes beyond that in the calibration poses."""

    joint: UrdfJoint
    fitted: tuple[float, float]
    tested: tuple[float, float]
    share: float

    def words(self) -> str:
        size, unit = (MM, "mm") if self.joint.prismatic else (DEG, "deg")
        a, b, c, d = (round(end / size) for end in (*self.fitted, *self.tested))
        return f"{self.joint.name} {a} to {b} {unit}, the test poses {c} to {d} {unit}"


def _uncovered(robot: Robot, fitted: Measurements, tested: Measurements) -> list[_Beyond]:
    """Joints whose range is not covered, worst first."""
    found = []
    for joint, column in zip(robot.chain.inputs, range(fitted.q.shape[1]), strict=True):
        (a, b), (c, d) = (_range(data.q[data.observed, column]) for data in (fitted, tested))
        overhang = max(a - c, 0.0) + max(d - b, 0.0)
        if overhang > max(_UNCOVERED * (d - c), _LEAST_OVERHANG[joint.prismatic]):
            found.append(_Beyond(joint, (a, b), (c, d), overhang / (d - c) if d > c else 1.0))
    return sorted(found, key=lambda beyond: -beyond.share)


def _range(values: Vector) -> tuple[float, float]:
    return float(values.min()), float(values.max())


def _listed(beyond: list[_Beyond]) -> str:
    text = "; ".join(one.words() for one in beyond[:_NAMED])
    rest = [one.joint.name for one in beyond[_NAMED:]]
    return f"{text}; likewise {', '.join(rest)}" if rest else text


def _by_session(data: Measurements) -> Iterator[Rows]:
    """The poses of each session that saw something; those that did not are never test poses."""
    for session in data.session_names:
        yield np.flatnonzero((data.sessions == session) & data.observed)


def _folds(data: Measurements, folds: int, rng: np.random.Generator) -> list[Rows]:
    """The rows that each fold holds out: poses dealt at random, session by session, so that every fold has its share of each."""
    where, first = data.configuration_of, first_rows(data.configuration_of)
    if not 2 <= folds <= len(first):
        raise UsageError(f"the number of folds must lie between 2 and the number of poses, {len(first)}; found {folds}")
    lone = [session for session in data.session_names if np.count_nonzero(data.sessions[first] == session) < 2]
    if lone:
        raise UsageError(
            f"session '{lone[0]}' has a single pose, so its {placed_by_session(data)} is unknown when that pose is held out; "
            "leave the session out"
        )
    order = np.concatenate([rng.permutation(first[data.sessions[first] == session]) for session in data.session_names])
    return [np.flatnonzero(np.isin(where, where[order[fold::folds]])) for fold in range(folds)]
