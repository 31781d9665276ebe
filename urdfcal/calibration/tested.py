"""What poses that were not fitted say of a calibration: the distances of their readings to it, with and without gross outliers."""

from __future__ import annotations

from dataclasses import replace
from typing import TypeVar

from urdfcal.base.errors import UsageError
from urdfcal.calibration.error_table import SpotTable, error_table
from urdfcal.calibration.extra_noise import widened
from urdfcal.calibration.outliers import within_reach, without_gross_outliers
from urdfcal.calibration.problem import Problem, problem_of
from urdfcal.calibration.result import FitResult
from urdfcal.calibration.start.nominal import with_new_places
from urdfcal.robot.rig import SIX
from urdfcal.sensors.measurements import Measurements, fitted_poses_warning, placed_by_session
from urdfcal.sensors.registry import noun

Result = TypeVar("Result", bound=FitResult)


def with_test(calibration: Result, test: Measurements) -> Result:
    """The same calibration with the distances of test poses: of all their readings, and beside it without gross outliers.

    Raises:
        UsageError: a test pose belongs to a session that was not fitted, so that the placement of its screen or measuring frame is
            unknown, or was measured with other instruments.
    """
    unknown = set(test.session_names) - set(calibration.errors.sessions)
    if unknown:
        raise UsageError(
            f"test poses of session {', '.join(sorted(unknown))}: no pose of it was fitted, so where its {placed_by_session(test)} stands "
            "is unknown"
        )
    _require_same_instruments(calibration, test)
    test = widened(test, calibration.extra_noise)
    noise = calibration.noise_for(test)
    test_errors, x = with_new_places(calibration.errors, calibration.x, test, noise)
    whole = problem_of(test_errors, test, noise)
    trimmed, outliers = without_gross_outliers(whole, replace(calibration.estimate, noise=noise))
    measured = within_reach(whole, x) if outliers else whole

    def tables(model: Problem) -> tuple[SpotTable, SpotTable]:
        return calibration.nominal.table(model.data), error_table(model.residuals(x), len(test))

    return replace(
        calibration,
        test=tables(measured),
        test_data=measured.data,
        test_outliers=outliers,
        test_trimmed=tables(trimmed) if outliers else None,
        warnings=(*calibration.warnings, *fitted_poses_warning(calibration.data, test)),
    )


def _require_same_instruments(calibration: FitResult, test: Measurements) -> None:
    """Refuse test poses that were measured with something that the fit knows nothing of.

    Raises:
        UsageError: names it.
    """
    known = {frame.name for frame in calibration.errors.chain.frames if frame.role == "target"}
    strange = [target.name for target in test.instruments.targets if target.name not in known]
    sees = {reading.instrument for reading in calibration.data.readings}
    strange += sorted({reading.instrument for reading in test.readings} - sees)
    fitted = calibration.data
    other_camera = test.corrects_camera and not fitted.corrects_camera
    if test.joints != fitted.joints or test.lasers != fitted.lasers or other_camera:
        strange = strange or ["other joints or lasers"]
    if strange:
        raise UsageError(f"the test poses were measured with other instruments than the fitted ones: {', '.join(strange)}")
    _require_placed(calibration, test)


def _require_placed(calibration: FitResult, test: Measurements) -> None:
    """Refuse readings that depend on a placement of which the fitted ones say nothing: orientations of what was a point.

    Raises:
        UsageError: names them.
    """
    told = {slot.label: set(slot.names) for slot in calibration.errors.slots if slot.kind == "target"}
    labels = {target.name: target.placed_by for target in test.instruments.targets}
    placed = {own.name for own in calibration.data.instruments.every if own.placed}
    no_frame = {own.name for own in test.instruments.every if own.placed} - placed
    for reading in (reading for reading in test.readings if not reading.kind.beam and reading.seen.any()):
        what = ""
        if not set(reading.kind.offset) <= told.get(labels[reading.target], set(SIX)):
            what = f"how {reading.target} is turned on its link"
        elif reading.kind.seen_from == "frame" and (reading.instrument or test.instruments.every[0].name) in no_frame:
            what = "where the measuring frame stands"
        if what:
            raise UsageError(
                f"the test poses have {noun(reading.noise)} of {reading.target}, but the fitted ones do not tell {what}; leave them out, "
                "or let some of their poses be fitted, too"
            )
