"""One fit, step by step: a start, the fit without outliers, prior scales chosen by the data, and what all of it says."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar, get_args

import numpy as np

from urdfcal.base.errors import FitRejected, ShapeMismatch, UsageError, no_such
from urdfcal.base.geometry import Matrix, Vector
from urdfcal.calibration.asking.disturbances import courses_of
from urdfcal.calibration.asking.ground import Ground
from urdfcal.calibration.asking.interview import Interview
from urdfcal.calibration.asking.lacking import Lacking
from urdfcal.calibration.asking.questions import HEARD, NAMED, Answer
from urdfcal.calibration.asking.stands_out import StandsOut
from urdfcal.calibration.error_table import SpotTable, error_table
from urdfcal.calibration.extra_noise import MORE, extra_noise, in_words, widened, without_stated_noise
from urdfcal.calibration.known_joints import joints_of, require_written
from urdfcal.calibration.outliers import CleanFit, Judge, fit_without_outliers, within_reach, without_gross_outliers
from urdfcal.calibration.problem import Problem, problem_of
from urdfcal.calibration.result import FitResult, disagreement_warnings, large_noise_warning, large_scales_warning, too_few_warning
from urdfcal.calibration.start.begin import (
    is_credible,
    require_beams_on_screen,
    require_sane_readings,
    searched_start,
    start_of,
    with_scale,
)
from urdfcal.calibration.start.nominal import NominalFit, nominal_fit, with_new_places
from urdfcal.estimation.ekf import Belief, Estimate, posterior
from urdfcal.estimation.estimators import USUAL_Q, USUAL_R, Method
from urdfcal.estimation.evidence import LEAST_POSES, Evidence, by_evidence, covariance_of_uncertain_scales
from urdfcal.estimation.identifiability import Identifiability, identify, with_sigmas
from urdfcal.estimation.noise import Misfit, Noise, misfits
from urdfcal.estimation.residual import Linearisation
from urdfcal.estimation.robust import degrees, kind_scales, mahalanobis_squared, robust_scale
from urdfcal.model.earlier import EarlierJoints
from urdfcal.model.error_model import ErrorModel, with_rig
from urdfcal.model.gauge import build_error_model, model_warnings
from urdfcal.model.gravity import Gravity
from urdfcal.model.options import LENS, ModelOptions, laid_over
from urdfcal.model.parameters import Kind, PriorScale, matching
from urdfcal.robot.rig import SIX
from urdfcal.robot.robot import Robot
from urdfcal.sensors.measurements import (
    Measurements,
    as_measured,
    copies_warning,
    fit_and_test,
    fitted_poses_warning,
    placed_by_session,
    refining,
    require_measured,
    require_screen_of_camera,
)
from urdfcal.sensors.registry import noun
from urdfcal.sensors.stated_noise import joint_sigmas, noise_of, stated_noise, stating_kinds

Result = TypeVar("Result", bound=FitResult)
_MOST_ENTERED = 3  # things that a rig may do at once
_ANY = 3.0  # degrees of freedom that tell at least whether there is more


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
    asking: bool = True,
    after: EarlierJoints | FitResult | None = None,
    rng: np.random.Generator | None = None,
    test: Measurements | None = None,
    gravity: Gravity | None = None,
) -> FitResult:
    """Calibrate a robot from laser spots, points, poses, distances, touches, pixels, or all of them together.

    Poses marked `test` in the data are not fitted but evaluated.

    Args:
        robot: Nominal robot; left unchanged.
        data: Joint positions, and what was read at them.
        estimator: `ekf`, `lse` (Levenberg-Marquardt), `robust` (Student's t) or `evolution` (differential evolution, polished).
        schedule: Of the EKF: `iterated` (maximum a posteriori, honest covariance) or `paper` (sweeps with Q and R).
        options: What is to be calibrated; the arguments below are laid over it.
        error_model: `auto`, `dh`, `hayati`, `placement` or `offset`.
        estimate: Additions: `screen`, `beams`, `beams4` or `lens`.
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
        asking: Ask the residuals what the model lacks, from 20 poses on; what the rig does, and noise of the joints' readings, enters the
            fit where the data pay for it, the rest widens what is predicted (not for `robust` and the `paper` schedule).
        sane: Refuse measurements that a common mistake explains far better (swapped lasers, degrees as radians, a sign flipped ...).
        after: An earlier calibration, that of another branch, whose URDF the robot is; what it decided is the prior of joints that both
            have, and the joints that it alone has follow what is learned of those.
        rng: For `evolution`; seeded by default.
        test: Further poses to evaluate.
        gravity: Where down is, and what is carried, for outliers to be judged with sag; along an axis of the root link if None.

    Raises:
        UsageError: an option means nothing here.
        ShapeMismatch: the data belong to another robot.
        FitRejected: a common mistake explains the data far better, or a beam that was seen does not meet the screen in the model.
    """
    _require_types(robot, data, priors)
    options = laid_over(options or ModelOptions(), error_model, estimate, fix, only, priors)
    data = refining(data, LENS in options.estimate)
    test = refining(test, LENS in options.estimate) if test is not None else None
    method = Method(estimator, schedule, tolerance, max_sweeps, q, r, gated, rng)
    robot = as_measured(robot, data)
    _require_same_robot(robot, data)
    require_screen_of_camera(data)
    if after is not None:
        earlier = joints_of(after) if isinstance(after, FitResult) else after
        require_written(earlier, robot, "the earlier calibration")
        options = replace(options, earlier=earlier)
    fit_set, test_set = fit_and_test(data, test)
    stated = stated_noise(fit_set, spot_sigma, sigmas)
    sessions = tuple(dict.fromkeys([*fit_set.session_names, *(test_set.session_names if test_set is not None else ())]))
    task = FitTask(
        as_measured(robot, fit_set), method, options, sessions, stated, joint_sigmas(robot, joint_sigma), evidence, sane, gravity, asking
    )
    found = task.fitted(fit_set) if method.as_published else fitted_with_extra_noise(task, fit_set)
    found = replace(found, warnings=(*data.warnings, *copies_warning(data, fit_set), *found.warnings, *in_words(found.extra_noise)))
    return found if test_set is None else with_test(found, test_set)


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


def _require_types(robot: Any, data: Any, priors: Mapping[Any, Any] | None) -> None:
    """Refuse what is easily taken for another, before it fails somewhere deep.

    Raises:
        UsageError: says what was expected.
    """
    require_measured(robot, data, "fit")
    for group, scale in (priors or {}).items():
        if group not in get_args(Kind):
            raise UsageError(f"priors: {no_such('group', str(group), get_args(Kind))}")
        if not isinstance(scale, PriorScale):
            raise UsageError(f"priors: expected a PriorScale for '{group}', found {type(scale).__name__}")


def _require_same_robot(robot: Robot, data: Measurements) -> None:
    if data.joints != robot.chain.input_names or data.lasers != robot.rig.lasers:
        raise ShapeMismatch(
            f"the measurements are of {_joints_and_lasers(data.joints, data.lasers)}, "
            f"the robot has {_joints_and_lasers(robot.chain.input_names, robot.rig.lasers)}"
        )


def _joints_and_lasers(joints: Sequence[str], lasers: Sequence[str]) -> str:
    return f"joints {', '.join(joints)}" + (f" and lasers {', '.join(lasers)}" if lasers else "")


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


@dataclass(frozen=True)
class FitTask:
    """What is to be fitted, and how: the arguments of `fit` once they were looked at.

    Attributes:
        robot: The nominal robot, as it was measured.
        method: Which estimator, and how far it goes.
        options: What is to be calibrated.
        sessions: Of all poses, those included that are only tested.
        stated: Noise that is stated by kind of reading, [m], [rad] or [px].
        joint_sigma: Noise of every joint reading, (inputs,), [rad] or [m].
        evidence: Whether the data may choose the scales of the joints' priors.
        sane: Whether data with a common mistake in them are refused.
        gravity: Where down is, and what is carried, for outliers to be judged with sag; None where nothing was said.
        asking: Whether the residuals are asked what the model lacks.
    """

    robot: Robot
    method: Method
    options: ModelOptions
    sessions: tuple[str, ...]
    stated: Mapping[str, float]
    joint_sigma: Vector
    evidence: bool
    sane: bool
    gravity: Gravity | None = None
    asking: bool = True

    def fitted(self, data: Measurements) -> FitResult:
        """What some measurements say.

        Raises:
            FitRejected: a common mistake explains them far better, or a beam that was seen does not meet the screen in the model.
        """
        errors, no_scale = with_scale(build_error_model(self.robot.chain, self.robot.rig, self.options, self.sessions), data)
        noise = noise_of(data, self.stated, self.joint_sigma)
        nominal = nominal_fit(errors, data, noise)
        first = self._first(nominal, data, noise)
        if self.sane and not self.method.as_published:
            require_sane_readings(self.robot, errors, first.model, first.found, noise)
        clean = first.without_outliers(noise, Judge(self.robot, nominal, self.gravity))
        fitted = _Asked(first, clean, self._scaled(first, clean, noise), noise)
        if self._asks(fitted.scaled.found, clean.model.data):
            fitted = self._with_what_pays(fitted, nominal)
        return self._result(nominal, fitted, tuple(filter(None, (no_scale, first.message))))

    def _asks(self, found: Estimate, data: Measurements) -> bool:
        """Whether the residuals may be asked what the model lacks."""
        return self.asking and self.method.shrinks and found.converged and data.pose_count >= LEAST_POSES

    def _with_what_pays(self, fitted: _Asked, nominal: NominalFit) -> _Asked:
        """The same with what the rig does, or noise of the joints' readings, in the fit, one after the other while the data pay for it."""
        tried = set[str]()
        while True:
            interview = Interview(Ground(self.robot, fitted.scaled_model, fitted.scaled.found, self.gravity))
            fitted = replace(fitted, interview=interview, answers=tuple(interview.answers(HEARD)))
            richer = self._richer(fitted, interview, nominal, tried)
            if richer is None:
                return fitted
            fitted = richer

    def _richer(self, fitted: _Asked, interview: Interview, nominal: NominalFit, tried: set[str]) -> _Asked | None:
        """The fit with the first of its answers for which the data pay; None if they do for none that was not `tried`, which grows."""
        answers = fitted.answers if len(fitted.entered) < _MOST_ENTERED else ()
        for number, own in enumerate(answers):
            before = answers[:number]
            if own.name in tried or not own.enters(before):
                continue
            tried.add(own.name)
            if not interview.pays(own, before):
                continue
            try:
                richer = self._entering(fitted, own, nominal)
            except FitRejected:  # with it in the model beams miss the screen: the fit goes on without
                continue
            if richer.scaled.found.converged:
                return replace(richer, entered=(*fitted.entered, replace(own.told, entered=True)))
        return None

    def _entering(self, fitted: _Asked, answer: Answer, nominal: NominalFit) -> _Asked:
        """The fit from its start with an answer in it: outliers are told apart once more."""
        noise, found = fitted.noise, fitted.scaled.found
        if answer.joint_sigma:
            turning = [not joint.prismatic for joint in self.robot.chain.inputs]
            sigma = np.where(noise.stated, noise.sigma, found.noise.sigma * answer.left)
            noise = replace(noise, joint_sigma=np.where(turning, answer.joint_sigma, 0.0), sigma=sigma)
        data = fitted.first.model.data
        errors = with_rig(fitted.first.model.errors, answer.rig, courses_of(data) if answer.rig else {})
        start = np.concatenate([found.belief.x, np.zeros(len(answer.rig))])
        first = _first_fit(replace(fitted.first.method, start=start), problem_of(errors, data, noise), start, noise, fitted.first.message)
        clean = first.without_outliers(noise, Judge(self.robot, nominal, self.gravity))
        return replace(fitted, first=first, clean=clean, scaled=self._scaled(first, clean, noise), noise=noise)

    def _first(self, nominal: NominalFit, data: Measurements, noise: Noise) -> _First:
        """A fit of all that was measured, from where the priors have it or, if need be, from where it is found to be."""
        errors = nominal.errors
        start = start_of(data, errors, noise, nominal.x, self.sane)
        first = _first_fit(replace(self.method, start=start), problem_of(errors, data, noise), nominal.x, noise)
        if not data.has_spots or self.method.as_published or is_credible(first.model, first.found, noise):
            return first
        begun = searched_start(first.model, noise, self.sane)
        return _first_fit(replace(self.method, start=begun.x), problem_of(begun.errors, data, noise), begun.x, noise, begun.message)

    def _scaled(self, first: _First, clean: CleanFit, noise: Noise) -> _Scaled:
        """Refit with the joints' prior scales chosen by evidence; priors that were stated, also for single parameters, stay."""
        errors, found, method = first.model.errors, clean.estimate, first.method
        wanted = self.evidence and method.shrinks and "joint" not in self.options.priors and found.converged
        if not wanted or clean.model.data.pose_count < LEAST_POSES or not any(parameter.kind == "joint" for parameter in errors.parameters):
            return _Scaled(errors, found)
        single = self.options.single.items()
        stated = [name for pattern, said in single if said.sigma is not None for name in matching(errors.parameters, pattern)]
        prior, refitted, chosen = by_evidence(clean.model.linearise, errors.prior(keep=stated), noise, found)
        errors = errors.with_prior(prior)
        if method.estimator != "ekf":
            again = replace(method, start=refitted.belief.x)
            refitted = again.run(clean.model.linearise, Belief.independent(errors.mean, errors.sigma), refitted.noise.hold())
            belief = Belief(refitted.belief.x, covariance_of_uncertain_scales(prior, refitted.belief))
            refitted = replace(refitted, belief=belief, noise=refitted.noise.released(noise))
        return _Scaled(errors, replace(refitted, history=[*found.history, *refitted.history[1:]]), chosen)

    def _result(self, nominal: NominalFit, fitted: _Asked, said: tuple[str, ...]) -> FitResult:
        first, clean, scaled = fitted.first, fitted.clean, fitted.scaled
        errors, found, data, lacking = scaled.errors, scaled.found, clean.model.data, fitted.lacking
        linearisation = clean.model.linearise(found.belief.x)
        plain = posterior(linearisation, Belief.independent(errors.mean, errors.sigma), found.noise)  # without what is unsure of the scales
        if lacking is not None:
            found = lacking.widening(found, linearisation, plain)
        freedom = linearisation.count - len(errors.names) + float(np.sum(np.diag(plain) / errors.sigma**2))
        result = FitResult(
            robot=self.robot,
            errors=errors,
            estimate=found,
            identifiability=_decided(linearisation, found, first.model.errors, scaled.evidence),
            before=nominal.table(data),
            nominal=nominal,
            freedom=freedom,
            outliers=clean.outliers,
            measured=clean.measured,
            beyond=clean.beyond,
            regained=clean.regained,
            together=clean.together,
            evidence=scaled.evidence,
            after=error_table(linearisation, len(data)),
            test=None,
            chi_squared=_misfit(self.method, found.noise, linearisation, freedom),
            data=data,
            test_data=None,
            estimator=self.method.label,
            error_model=self.options.error_model,
            warnings=(
                *model_warnings(self.robot, self.options),
                *said,
                *too_few_warning(data, found.noise, freedom),
                *large_scales_warning(scaled.evidence),
            ),
            stands_out=fitted.stands_out,
            lacking=lacking,
            misfits=dict(zip(data.kinds, _misfits(self.method, found.noise, linearisation, plain), strict=True)),
        )
        return replace(result, warnings=(*result.warnings, *disagreement_warnings(result), *large_noise_warning(result)))


@dataclass(frozen=True)
class _First:
    """A fit of everything that was measured.

    Attributes:
        method: How fits that follow are made, and where they begin.
        model: Of all measurements.
        x: Where beams are looked at if the fit cannot take a step, or none that is any better, (p,).
        prior: Before the data.
        found: The fit.
        message: What had to be done for it, in words.
    """

    method: Method
    model: Problem
    x: Vector
    prior: Belief
    found: Estimate
    message: str = ""

    def without_outliers(self, noise: Noise, judge: Judge) -> CleanFit:
        """The same without what it cannot explain, if the method tells outliers apart.

        Raises:
            FitRejected: a beam that was seen does not meet the screen in the model.
        """
        if self.method.gates:
            clean = fit_without_outliers(self.method, self.model, self.prior, noise, self.found, judge)
        else:
            clean = CleanFit(self.model, self.found, self.model.data)
        if len(clean.estimate.history) == 1 or clean.estimate.stop == "stalled":
            require_beams_on_screen(self.model, self.x)
        return clean


def _first_fit(method: Method, model: Problem, x: Vector, noise: Noise, message: str = "") -> _First:
    prior = Belief.independent(model.errors.mean, model.errors.sigma)
    return _First(method.refit, model, x, prior, method.run(model.linearise, prior, noise), message)


@dataclass(frozen=True)
class _Scaled:
    """The last fit.

    Attributes:
        errors: The error model, with the priors that the data chose.
        found: The fit.
        evidence: What the data chose; None if they were not asked.
    """

    errors: ErrorModel
    found: Estimate
    evidence: Evidence | None = None


@dataclass(frozen=True)
class _Asked:
    """A fit, and what its residuals answered.

    Attributes:
        first: Of everything that was measured.
        clean: Without outliers.
        scaled: With the prior scales that the data chose.
        noise: As stated, or where to start.
        interview: With its residuals; None where they were not asked.
        answers: What stands out, and is not in the fit.
        entered: What is.
    """

    first: _First
    clean: CleanFit
    scaled: _Scaled
    noise: Noise
    interview: Interview | None = None
    answers: tuple[Answer, ...] = ()
    entered: tuple[StandsOut, ...] = ()

    @property
    def scaled_model(self) -> Problem:
        """The problem of the last fit."""
        return self.clean.model.with_prior(self.scaled.errors)

    @property
    def stands_out(self) -> tuple[StandsOut, ...]:
        """Everything, strongest first."""
        named = [own for own in self.answers if own.gain >= NAMED]
        return tuple(sorted((*self.entered, *(own.told for own in named)), key=lambda own: -own.gain))

    @property
    def lacking(self) -> Lacking | None:
        """What is not in the fit, and does something to it."""
        return self.interview.lacking(self.answers) if self.interview is not None else None


def _decided(linearisation: Linearisation, found: Estimate, stated: ErrorModel, chosen: Evidence | None) -> Identifiability:
    """What the data decided, judged against the priors that were stated: scales that the data chose hold more still.

    Sigmas of combinations are those of the estimate.
    """
    belief = found.belief
    if chosen is None:
        return identify(stated.names, belief.x, belief.P, stated.sigma)
    P = posterior(linearisation, Belief.independent(stated.mean, stated.sigma), found.noise)
    return with_sigmas(identify(stated.names, belief.x, P, stated.sigma), belief.P, stated.names)


def _misfit(method: Method, noise: Noise, linearisation: Linearisation, freedom: float) -> float:
    """Chi-squared per degree of freedom; of the bulk alone where the estimator weighs outliers down and keeps them."""
    if method.estimator == "robust":
        return (
            robust_scale(mahalanobis_squared(linearisation, noise), degrees(linearisation)) ** 2 * linearisation.count / max(freedom, 1.0)
        )
    return noise.chi_squared(linearisation) / max(freedom, 1.0)


def _misfits(method: Method, noise: Noise, linearisation: Linearisation, P: Matrix) -> tuple[Misfit, ...]:
    """The same of every kind of reading."""
    found = misfits(linearisation, noise, P)
    if method.estimator != "robust":
        return found
    scales = kind_scales(linearisation, mahalanobis_squared(linearisation, noise)).tolist()
    return tuple(
        replace(own, chi_squared=scale**2 * count / max(own.freedom, 1.0))
        for own, scale, count in zip(found, scales, linearisation.counts.tolist(), strict=True)
    )


def fitted_with_extra_noise(task: FitTask, data: Measurements) -> FitResult:
    """A fit of measurements of which some may state their noise; where they scatter more, what is beyond is estimated and added.

    That is found out with the filter, whatever the estimator, from a fit that knows nothing of the columns: it looks for mistakes, too.
    """
    if not stating_kinds(data):
        return task.fitted(data)
    quick = replace(task, method=Method(gated=task.method.gates), evidence=False, asking=False)
    loosely = quick.fitted(without_stated_noise(data))
    task, quick = replace(task, sane=False), replace(quick, sane=False)
    kinds = _scattering(quick.fitted(data))
    extra = _extra_at(loosely, data, kinds)
    if extra:  # once more where outliers are told apart by the right noise
        extra = _extra_at(quick.fitted(widened(data, extra)), data, kinds) or extra
    return replace(task.fitted(widened(data, extra)), extra_noise=extra)


def _scattering(found: FitResult) -> list[str]:
    """Kinds of readings that seem to scatter more than they state."""
    return [
        kind for kind in found.kinds if kind in found.stating and found.misfits[kind].sigmas > MORE and found.misfits[kind].freedom > _ANY
    ]


def _extra_at(found: FitResult, data: Measurements, kinds: Sequence[str]) -> dict[str, float]:
    noise = found.estimate.noise
    if not kinds or not found.converged:
        return {}
    return extra_noise(problem_of(found.errors, found.data, noise), found.x, noise, data, kinds)
