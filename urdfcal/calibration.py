"""`fit`: a robot and its measurements go in, a frozen `Calibration` comes out."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

import numpy as np

from urdfcal.calibration_file import calibration_yaml
from urdfcal.corrections import Applicable
from urdfcal.error_model import PriorScale
from urdfcal.error_table import error_table
from urdfcal.errors import ShapeMismatch, UsageError, no_such
from urdfcal.evaluation import as_measured, fit_and_test
from urdfcal.files import write_whole
from urdfcal.fit_result import FitResult
from urdfcal.fit_task import FitTask
from urdfcal.formats import Deployed
from urdfcal.gauge import ModelOptions, laid_over
from urdfcal.geometry import Vector
from urdfcal.known_noise import joint_sigmas, stated_noise
from urdfcal.measurements import Measurements
from urdfcal.method import USUAL_Q, USUAL_R, Method
from urdfcal.nominal import with_new_places
from urdfcal.outliers import without_gross_outliers
from urdfcal.pixel_start import corrected_camera, in_pixels, require_screen_of_camera
from urdfcal.report import text_report
from urdfcal.robot import Robot, with_text
from urdfcal.scatter import fitted_beyond_columns, in_words, widened
from urdfcal.slots import Kind
from urdfcal.spot_model import model_for
from urdfcal.urdf_writer import with_origins

if TYPE_CHECKING:
    from urdfcal.viewer import View
    from urdfcal.vision.camera_model import Camera


@dataclass(frozen=True, repr=False)
class Calibration(FitResult, Applicable):
    """What a fit found, and what can be done with it."""

    @classmethod
    def of(cls, found: FitResult) -> Calibration:
        """The same, with what can be done with it."""
        return cls(**{each.name: getattr(found, each.name) for each in fields(found)})

    def report(self, test: Measurements | None = None) -> str:
        """The result as text; with the spot errors of further poses, if given."""
        return text_report(self if test is None else with_test(self, test))

    def urdf(self) -> bytes:
        """The robot's text with corrected origins."""
        return with_origins(self.robot.description, {name: correction.corrected for name, correction in self.corrections.items()})

    def deployed(self, rng: np.random.Generator | None = None) -> Deployed:
        """The calibration in the forms that people deploy: `.content("origins-yaml")` and so on.

        Args:
            rng: For the configurations over which joint offsets alone are judged; seeded by default.
        """
        origins = {name: correction.corrected for name, correction in self.corrections.items()}
        return Deployed(self.robot, origins, rng or np.random.default_rng(0))

    def write_urdf(self, path: str | Path) -> None:
        """Write the calibrated URDF, whole or not at all."""
        write_whole(path, self.urdf())

    def show(self, magnify: float | None = None) -> View:
        """Robot, beams and fitted spots before and after, to look at: at the end of a notebook's cell, or by `serve()` in a browser."""
        from urdfcal.view.target_scene import held_instruments
        from urdfcal.viewer import view_of

        corrected = with_text(self.robot, self.urdf())
        data = replace(self.data, camera=self.corrected_camera()) if in_pixels(self.data) else self.data
        return view_of(self.robot, data, corrected, magnify, held_instruments(self.errors, self.data.instruments.places))

    def corrected_camera(self) -> Camera:
        """The camera that read laser spots as pixels, with the screen where the fit found it: the one for the calibrated robot.

        Raises:
            UsageError: no laser spots were read as pixels.
        """
        camera: Camera = corrected_camera(self.data, self.errors, self.estimate.belief)
        return camera

    def write(self, path: str | Path, command: Sequence[str] = ()) -> None:
        """Write the calibration as YAML: origins, parameters, combinations, provenance."""
        write_whole(path, self.record(command))

    def record(self, command: Sequence[str] = ()) -> bytes:
        """The calibration as YAML."""
        return calibration_yaml(self, command or sys.argv)


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
    sigmas: Mapping[str, float] | None = None,
    joint_sigma: float | Vector = 0.0,
    tolerance: float | None = None,
    max_sweeps: int | None = None,
    q: float = USUAL_Q,
    r: float = USUAL_R,
    gated: bool = True,
    evidence: bool = True,
    sane: bool = True,
    rng: np.random.Generator | None = None,
    test: Measurements | None = None,
) -> Calibration:
    """Calibrate a robot from laser spots, points, poses, distances, touches, pixels, or all of them together.

    Poses marked `test` in the data are not fitted but evaluated.

    Args:
        robot: Nominal robot; left unchanged.
        data: Joint positions, and what was read at them.
        estimator: `ekf`, `lse` (Levenberg-Marquardt), `robust` (Student's t) or `evolution` (differential evolution, polished).
        schedule: Of the EKF: `iterated` (maximum a posteriori, honest covariance) or `paper` (sweeps with Q and R).
        options: What is to be calibrated; the arguments below are laid over it.
        error_model: `auto`, `dh`, `hayati`, `placement` or `offset`.
        estimate: Additions: `screen`, `beams` or `beams4`.
        fix: Patterns of parameters that are held.
        only: Patterns; every other parameter is held.
        priors: Standard deviations by group: `joint`, `mount`, `screen`, `beam`, `reference`, `target`, `place`, `camera`.
        spot_sigma: Noise of a spot coordinate, [m]; estimated from the residual if None.
        sigmas: The same of other readings by kind: `point`, `orientation`, `distance`, `plane`, `socket`, `pixel`; [m], [rad] or [px].
        joint_sigma: Noise of a joint reading, [rad], one number for all turning joints or one a joint, (inputs,).
        tolerance: When to stop: for `iterated` in posterior standard deviations, for `paper` the norm of the change in m and rad.
        max_sweeps: How many sweeps are allowed.
        q: Q = q I of the `paper` schedule, per sweep, [m^2] and [rad^2].
        r: R = r I of the `paper` schedule, [m^2].
        gated: Take out spots that the fit cannot explain, exchange beams that were read for each other, and refit (not for `robust`
            and the `paper` schedule).
        evidence: Choose the scales of the joints' priors, and noise that is not stated, by evidence, where the joints' priors are not
            stated and there are at least 20 poses (not for `robust` and the `paper` schedule).
        sane: Refuse measurements that a common mistake explains far better (swapped lasers, degrees as radians, a sign flipped ...).
        rng: For `evolution`; seeded by default.
        test: Further poses to evaluate.

    Raises:
        UsageError: an option means nothing here.
        ShapeMismatch: the data belong to another robot.
        FitRejected: a common mistake explains the data far better, or a beam that was seen does not meet the screen in the model.
    """
    _require_types(robot, data, priors)
    method = Method(estimator, schedule, tolerance, max_sweeps, q, r, gated, rng)
    robot = as_measured(robot, data)
    _require_same_robot(robot, data)
    require_screen_of_camera(data)
    options = laid_over(options or ModelOptions(), error_model, estimate, fix, only, priors)
    fit_set, test_set = fit_and_test(data, test)
    stated = stated_noise(fit_set, spot_sigma, sigmas)
    sessions = tuple(dict.fromkeys([*fit_set.session_names, *(test_set.session_names if test_set is not None else ())]))
    task = FitTask(as_measured(robot, fit_set), method, options, sessions, stated, joint_sigmas(robot, joint_sigma), evidence, sane)
    found = task.fitted(fit_set) if method.as_published else fitted_beyond_columns(task, fit_set)
    calibration = Calibration.of(replace(found, warnings=(*data.warnings, *found.warnings, *in_words(found.extra_noise))))
    return calibration if test_set is None else with_test(calibration, test_set)


def with_test(calibration: Calibration, test: Measurements) -> Calibration:
    """The same calibration with the distances of test poses.

    Raises:
        UsageError: a test pose belongs to a session that was not fitted, so that its screen's placement is unknown, or was measured with
            other instruments.
    """
    unknown = set(test.session_names) - set(calibration.errors.sessions)
    if unknown:
        raise UsageError(
            f"test poses of session {', '.join(sorted(unknown))}: no pose of it was fitted, so its screen's placement is unknown"
        )
    _require_same_instruments(calibration, test)
    test = widened(test, calibration.extra_noise)
    noise = calibration.estimate.noise
    test_errors, x = with_new_places(calibration.errors, calibration.x, test, noise)
    model, outliers = without_gross_outliers(model_for(test_errors, test, noise), calibration.estimate)
    tables = calibration.nominal.table(model.data), error_table(model.linearise(x), len(test))
    return replace(calibration, test=tables, test_data=model.data, test_outliers=outliers)


def _require_types(robot: Any, data: Any, priors: Mapping[Any, Any] | None) -> None:
    """Refuse what is easily taken for another, before it fails somewhere deep.

    Raises:
        UsageError: says what was expected.
    """
    if not isinstance(robot, Robot):
        raise UsageError(f"fit: expected a Robot, as load_robot gives it, found {type(robot).__name__}")
    if not isinstance(data, Measurements):
        raise UsageError(f"fit: expected Measurements, as read_measurements gives them, found {type(data).__name__}")
    for group, scale in (priors or {}).items():
        if group not in get_args(Kind):
            raise UsageError(f"priors: {no_such('group', str(group), get_args(Kind))}")
        if not isinstance(scale, PriorScale):
            raise UsageError(f"priors: expected a PriorScale for '{group}', found {type(scale).__name__}")


def _require_same_robot(robot: Robot, data: Measurements) -> None:
    if data.joints != robot.chain.input_names or data.lasers != robot.rig.lasers:
        raise ShapeMismatch(
            f"the measurements are of joints {', '.join(data.joints)} and lasers {', '.join(data.lasers)}, "
            f"the robot has {', '.join(robot.chain.input_names)} and {', '.join(robot.rig.lasers)}"
        )


def _require_same_instruments(calibration: Calibration, test: Measurements) -> None:
    """Refuse test poses that were measured with something that the fit knows nothing of.

    Raises:
        UsageError: names it.
    """
    known = {frame.name for frame in calibration.errors.chain.frames}
    strange = [target.name for target in test.instruments.targets if target.name not in known]
    fitted = calibration.data
    pixels = [any(data.of_laser(each) for each in data.readings) for data in (test, fitted)]
    if test.joints != fitted.joints or test.lasers != fitted.lasers or pixels == [True, False]:
        strange = strange or ["other joints or lasers"]
    if strange:
        raise UsageError(f"the test poses were measured with other instruments than the fitted ones: {', '.join(strange)}")
