"""`fit`: a robot and its measurements go in, a frozen `Calibration` comes out."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from urdfcal.corrections import OriginCorrection, corrected_model
from urdfcal.ekf import STOPS, Belief, Estimate, iterated_schedule, paper_schedule
from urdfcal.error_model import ErrorModel, Kind, PriorScale
from urdfcal.errors import FitRejected, ShapeMismatch, UsageError
from urdfcal.gauge import ModelOptions, build_error_model
from urdfcal.geometry import MM, Matrix, Vector
from urdfcal.identifiability import Identifiability, identify
from urdfcal.measurements import Measurements
from urdfcal.noise import START_SPOT_SIGMA, Noise
from urdfcal.robot import Robot
from urdfcal.spot_model import SpotModel

ESTIMATORS = ("ekf", "lse")
SCHEDULES = ("iterated", "paper")
CHI_SQUARED_LIMIT = 5.0  # times what was stated
_NEAR_AXIS = 10 * MM


@dataclass(frozen=True)
class SpotErrors:
    """Distances between measured and predicted spots of one laser, [mm]."""

    mean_mm: float
    std_mm: float
    max_mm: float
    n: int


SpotTable = dict[str, SpotErrors]


@dataclass(frozen=True)
class Calibration:
    """What a fit found; nothing in it is ever changed.

    Attributes:
        robot: The nominal robot.
        errors: The error model; names, units and priors of the parameters.
        estimate: Belief, stop reason, noise and history of the estimator.
        identifiability: What the data decided.
        before, after: Spot distances of the fitted poses with the nominal and with the calibrated robot.
        test: The same of the test poses, if there are any: (before, after).
        chi_squared: Squared whitened residuals over their degrees of freedom.
        data: The poses that were fitted.
        test_data: The poses that were only tested.
        estimator: Estimator and schedule.
        warnings: What the user ought to know.
    """

    robot: Robot
    errors: ErrorModel
    estimate: Estimate
    identifiability: Identifiability
    before: SpotTable
    after: SpotTable
    test: tuple[SpotTable, SpotTable] | None
    chi_squared: float
    data: Measurements
    test_data: Measurements | None
    estimator: str
    warnings: tuple[str, ...] = ()

    @property
    def x(self) -> Vector:
        """Estimated parameters, (p,), [m] and [rad]."""
        return self.estimate.belief.x

    @property
    def covariance(self) -> Matrix:
        """Their covariance, (p, p)."""
        return self.estimate.belief.P

    @cached_property
    def sigma(self) -> Vector:
        """Their standard deviations, (p,), [m] and [rad]."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def converged(self) -> bool:
        """Whether the estimator came to rest."""
        return self.estimate.converged

    @property
    def stop_reason(self) -> str:
        """Why the estimator stopped, in words."""
        return STOPS[self.estimate.stop]

    @cached_property
    def corrections(self) -> dict[str, OriginCorrection]:
        """Nominal and corrected origin of every joint that was calibrated."""
        joints = self.robot.tree.joints
        return {
            name: OriginCorrection(joints[name].origin, corrected, joints[name].moves) for name, corrected in self.errors.corrected_origins(self.x).items()
        }

    @property
    def rejection(self) -> str:
        """Why the result must not be trusted, or the empty string."""
        if not self.converged:
            return f"the fit did not converge: {self.stop_reason}"
        before, after = rms_mm(self.before), rms_mm(self.after)
        if not after < before:
            return f"the fit made nothing better: {after:.4g} mm RMS after it, {before:.4g} mm before"
        if self.estimate.noise.stated and self.chi_squared > CHI_SQUARED_LIMIT:
            return (
                f"chi-square is {self.chi_squared:.3g} times what the stated noise of {self.estimate.noise.spot_sigma / MM:.3g} mm explains "
                f"(limit {CHI_SQUARED_LIMIT:g}); look for outliers or state the noise that there is"
            )
        return ""

    def require_trustworthy(self) -> None:
        """Raise if the result must not be trusted.

        Raises:
            FitRejected: says why.
        """
        if self.rejection:
            raise FitRejected(self.rejection)

    def apply_to(self, model: Any) -> Any:
        """A corrected copy of a Pinocchio model of this robot, with or without the rig; for a controller.

        Raises:
            RobotError: the model lacks a joint that was calibrated.
        """
        return corrected_model(model, self.corrections)

    def report(self, test: Measurements | None = None) -> str:
        """The result as text; with the spot errors of further poses, if given."""
        from urdfcal.report import text_report

        return text_report(self if test is None else with_test(self, test))

    def urdf(self) -> bytes:
        """The robot's text with corrected origins."""
        from urdfcal.urdf_writer import with_origins

        return with_origins(self.robot.description, {name: correction.corrected for name, correction in self.corrections.items()})

    def write_urdf(self, path: str | Path) -> None:
        """Write the calibrated URDF, whole or not at all."""
        from urdfcal.files import write_whole

        write_whole(path, self.urdf())

    def write(self, path: str | Path, command: Sequence[str] = ()) -> None:
        """Write the calibration as YAML: origins, parameters, combinations, provenance."""
        from urdfcal.calibration_file import write_calibration

        write_calibration(path, self, command or sys.argv)


def fit(
    robot: Robot,
    data: Measurements,
    *,
    estimator: str = "ekf",
    schedule: str = "iterated",
    options: ModelOptions | None = None,
    error_model: str | None = None,
    estimate: Sequence[str] = (),
    fix: Sequence[str] = (),
    only: Sequence[str] = (),
    priors: Mapping[Kind, PriorScale] | None = None,
    spot_sigma: float | None = None,
    joint_sigma: float | Vector = 0.0,
    tolerance: float | None = None,
    max_sweeps: int | None = None,
    q: float = 1e-4,
    r: float = 1e-4,
    test: Measurements | None = None,
) -> Calibration:
    """Calibrate a robot from laser spots.

    Poses marked `test` in the data are not fitted but evaluated.

    Args:
        robot: Nominal robot; left unchanged.
        data: Joint positions and spots.
        estimator: `ekf` or `lse`.
        schedule: Of the EKF: `iterated` (maximum a posteriori, honest covariance) or `paper` (sweeps with Q and R).
        options: What is to be calibrated; the arguments below are laid over it.
        error_model: `auto`, `dh`, `hayati`, `placement` or `offset`.
        estimate: Additions: `screen`, `beams` or `beams4`.
        fix: Patterns of parameters that are held.
        only: Patterns; every other parameter is held.
        priors: Standard deviations by group: `joint`, `mount`, `screen`, `beam`.
        spot_sigma: Noise of a spot coordinate, [m]; estimated from the residual if None.
        joint_sigma: Noise of a joint reading, [rad], one number for all turning joints or one a joint, (inputs,).
        tolerance: When to stop: for `iterated` in posterior standard deviations, for `paper` the norm of the change in m and rad.
        max_sweeps: How many sweeps are allowed.
        q: Q = q I of the `paper` schedule, per sweep, [m^2] and [rad^2].
        r: R = r I of the `paper` schedule, [m^2].
        test: Further poses to evaluate.

    Raises:
        UsageError: an option means nothing here.
        ShapeMismatch: the data belong to another robot.
    """
    _check(robot, data, estimator, schedule, spot_sigma, q, r)
    options = laid_over(options or ModelOptions(), error_model, estimate, fix, only, priors)
    fit_set, test_set = _sets(data, test)
    sessions = tuple(dict.fromkeys([*fit_set.session_names, *(test_set.session_names if test_set is not None else ())]))
    errors = build_error_model(robot.chain, robot.rig, options, sessions)
    noise = Noise(spot_sigma or START_SPOT_SIGMA, _joint_sigmas(robot, joint_sigma), stated=spot_sigma is not None or _all_stated(fit_set))
    model = SpotModel(errors, fit_set, joints=bool(np.any(noise.joint_sigma)))
    _require_beams_on_screen(model, errors.mean)
    found = _run(estimator, schedule, model, Belief(errors.mean, np.diag(errors.sigma**2)), noise, tolerance, max_sweeps, q, r)
    here = model.linearise(found.belief.x)
    seen = identify(errors.names, found.belief.x, found.belief.P, errors.sigma)
    freedom = here.count - len(errors.names) + float(np.sum(np.diag(found.belief.P) / errors.sigma**2))
    nominal = SpotModel(replace(errors, held={}), fit_set)
    calibration = Calibration(
        robot=robot,
        errors=errors,
        estimate=found,
        identifiability=seen,
        before=spot_table(nominal, np.zeros_like(errors.mean)),
        after=spot_table(model, found.belief.x),
        test=None,
        chi_squared=found.noise.chi_squared(here) / max(freedom, 1.0),
        data=fit_set,
        test_data=None,
        estimator=f"{estimator}, {schedule}" if estimator == "ekf" else estimator,
        warnings=(*data.warnings, *_mount_warning(robot, options)),
    )
    return calibration if test_set is None else with_test(calibration, test_set)


def evaluate(robot: Robot, data: Measurements) -> SpotTable:
    """Spot distances of a robot as its URDF has it."""
    errors = ErrorModel(robot.chain, (), (), sessions=data.session_names or ("",))
    return spot_table(SpotModel(errors, data), np.empty(0))


def with_test(calibration: Calibration, test: Measurements) -> Calibration:
    """The same calibration with the spot distances of test poses."""
    errors = calibration.errors
    nominal = spot_table(SpotModel(replace(errors, held={}), test), np.zeros_like(errors.mean))
    return replace(calibration, test=(nominal, spot_table(SpotModel(errors, test), calibration.x)), test_data=test)


def spot_table(model: SpotModel, x: Vector) -> SpotTable:
    """Distances between measured and predicted spots per laser; a laser that was never seen is left out."""
    distance = np.linalg.norm(model.predict(x)[0] - model.data.spots, axis=-1) / MM
    table = {}
    for index, laser in enumerate(model.data.lasers):
        own = distance[model.data.seen[:, index], index]
        if len(own):
            table[laser] = SpotErrors(float(own.mean()), float(own.std()), float(own.max()), len(own))
    return table


def rms_mm(table: SpotTable) -> float:
    """Root mean square distance over all lasers, [mm]."""
    count = sum(row.n for row in table.values())
    return float(np.sqrt(sum(row.n * (row.mean_mm**2 + row.std_mm**2) for row in table.values()) / max(count, 1)))


def laid_over(
    options: ModelOptions,
    error_model: str | None = None,
    estimate: Sequence[str] = (),
    fix: Sequence[str] = (),
    only: Sequence[str] = (),
    priors: Mapping[Kind, PriorScale] | None = None,
) -> ModelOptions:
    """Options with others laid over them."""
    return replace(
        options,
        error_model=error_model or options.error_model,
        estimate=(*options.estimate, *estimate),
        fix=(*options.fix, *fix),
        only=(*options.only, *only),
        priors={**options.priors, **(priors or {})},
    )


def _run(
    estimator: str, schedule: str, model: SpotModel, prior: Belief, noise: Noise, tolerance: float | None, max_sweeps: int | None, q: float, r: float
) -> Estimate:
    wanted: dict[str, Any] = {"max_sweeps": max_sweeps} if tolerance is None else {"max_sweeps": max_sweeps, "tolerance": tolerance}
    if estimator == "lse":
        from urdfcal.least_squares import levenberg_marquardt

        return levenberg_marquardt(model.linearise, prior, noise, **wanted)
    if schedule == "paper":
        return paper_schedule(model.linearise, prior, noise, q=q, r=r, **wanted)
    return iterated_schedule(model.linearise, prior, noise, **wanted)


def _check(robot: Robot, data: Measurements, estimator: str, schedule: str, spot_sigma: float | None, q: float, r: float) -> None:
    if estimator not in ESTIMATORS:
        raise UsageError(f"no estimator '{estimator}'; there are: {', '.join(ESTIMATORS)}")
    if schedule not in SCHEDULES:
        raise UsageError(f"no schedule '{schedule}'; there are: {', '.join(SCHEDULES)}")
    if spot_sigma is not None and not spot_sigma > 0:
        raise UsageError(f"the spot noise must be above zero, found {spot_sigma:g} m")
    if not (q >= 0 and r > 0):
        raise UsageError(f"Q must not be negative and R must be above zero, found q = {q:g} and r = {r:g}")
    if data.joints != robot.chain.input_names or data.lasers != robot.rig.lasers:
        raise ShapeMismatch(
            f"the measurements are of joints {', '.join(data.joints)} and lasers {', '.join(data.lasers)}, "
            f"the robot has {', '.join(robot.chain.input_names)} and {', '.join(robot.rig.lasers)}"
        )


def _sets(data: Measurements, test: Measurements | None) -> tuple[Measurements, Measurements | None]:
    fit_set, marked = data.split()
    if not fit_set.seen.any():
        raise UsageError("no pose is left to fit: every row with a spot is marked as test")
    if test is not None and len(marked):
        raise UsageError("the measurements mark test poses in their 'set' column, and other test poses were given; use one of the two")
    return fit_set, test if test is not None else marked if len(marked) else None


def _all_stated(data: Measurements) -> bool:
    return bool(np.isfinite(data.sigma[data.seen]).all())


def _joint_sigmas(robot: Robot, joint_sigma: float | Vector) -> Vector:
    turning = np.array([0.0 if joint.prismatic else 1.0 for joint in robot.chain.inputs])
    sigmas = np.asarray(joint_sigma, dtype=float)
    if sigmas.ndim and sigmas.shape != turning.shape:
        raise ShapeMismatch(f"the joint noise is one number, or {len(turning)}; found shape {sigmas.shape}")
    if not (np.isfinite(sigmas).all() and (sigmas >= 0).all()):
        raise UsageError("the joint noise must be finite and not negative")
    return sigmas * turning if sigmas.ndim == 0 else sigmas


def _require_beams_on_screen(model: SpotModel, x: Vector) -> None:
    missing = model.unreached(x)
    if missing is not None:
        pose, laser = missing
        raise FitRejected(
            f"{model.data.where(pose)}: {model.data.lasers[laser]} was seen, but in the nominal robot its beam does not meet the screen; "
            "check the mount of the module, the screen's placement and the joints' units and signs"
        )


def _mount_warning(robot: Robot, options: ModelOptions) -> tuple[str, ...]:
    """Under `dh` the mount has no translation along y; on the last axis that one is visible, and another not."""
    if options.error_model != "dh":
        return ()
    errors = ErrorModel(robot.chain, (), ())
    module = errors.placements(np.empty(0)).module
    last = robot.chain.moving[-1]
    off = float(np.linalg.norm(np.cross(np.array(last.joint.axis), module.translation)))
    if last.joint.prismatic or not last.forward or off >= _NEAR_AXIS:
        return ()
    return (
        f"the module '{robot.rig.module}' lies {off / MM:.1f} mm from the axis of '{last.joint.name}': the five mount parameters of the dh model "
        "leave out trans_y, which such a mount shows; use --error-model auto or hayati",
    )
