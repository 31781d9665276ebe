"""What a fit found, as data: estimate, tables, corrected origins, whether it can be trusted, and what the user ought to know of it."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Self

import numpy as np

from urdfcal.base.errors import FitRejected, UsageError
from urdfcal.base.foreign_text import shown
from urdfcal.base.geometry import DEG, MM, Matrix, Vector
from urdfcal.base.terminal import rounded
from urdfcal.calibration.asking.lacking import Lacking
from urdfcal.calibration.asking.stands_out import StandsOut
from urdfcal.calibration.error_table import SpotTable, main_unit, rms_in_words, rms_of
from urdfcal.calibration.outliers import Outlier
from urdfcal.calibration.problem import Problem
from urdfcal.calibration.start.nominal import NominalFit
from urdfcal.estimation.ekf import STOPS, Belief, Estimate
from urdfcal.estimation.evidence import Evidence
from urdfcal.estimation.identifiability import Identifiability
from urdfcal.estimation.noise import LEAST_FREEDOM, Misfit, Noise
from urdfcal.estimation.residual import Linearisation
from urdfcal.model.error_model import ErrorModel
from urdfcal.model.found_frames import found_frames
from urdfcal.model.parameters import DEFAULT_PRIORS, FLAT, INSTRUMENTS
from urdfcal.robot.corrections import OriginCorrection
from urdfcal.robot.frames import FoundFrame
from urdfcal.robot.rig import SIX
from urdfcal.robot.robot import Robot
from urdfcal.sensors.measurements import Measurements
from urdfcal.sensors.registry import WORDS, start_sigma_of
from urdfcal.sensors.spots import screen_before
from urdfcal.sensors.stated_noise import noise_for, stating_kinds

_MOST_TURN, _MOST_SHIFT = 60 * DEG, 100 * MM  # joint errors beyond are a mistake somewhere
_SURELY = 3.0  # sigmas of a prior that was stated wider than that
_MOST_WANDER = 3 * DEG  # a beam that scatters more is not one of a calibrated arm
CHI_SQUARED_LIMIT = 5.0  # times what was stated

_FRAMES = (*INSTRUMENTS, "lens", "rig")  # what is not of the robot
_NAMED = 2  # parameters that a fit that gives up names
_LARGE = 10.0  # times the usual noise, beyond which it is no noise
_FAR = 3.0  # times the default prior, beyond which a scale that the data chose is no robot's


@dataclass(frozen=True, repr=False)
class CrossValidation:
    """How well poses are predicted that were not fitted, each pose held out once.

    Attributes:
        before, after: Spot distances over all poses, each predicted without it: with the nominal robot, and calibrated.
        fold_rms: RMS distance over the held-out poses of each fold, (folds,), in the main unit of the tables.
        spots: Whether nothing but spots was measured.
        rejected: Why each fold that must not be trusted was rejected; its poses count all the same.
        left_out: Residuals of all poses, each predicted without it: calibrated, and with the nominal robot.
    """

    before: SpotTable
    after: SpotTable
    fold_rms: Vector
    rejected: tuple[str, ...]
    spots: bool = True
    left_out: tuple[Linearisation, Linearisation] | None = None

    @property
    def folds(self) -> int:
        """Number of fits."""
        return len(self.fold_rms)

    def __repr__(self) -> str:
        """In a line."""
        tables = f"{rounded(rms_of(self.before), 3)} -> {rounded(rms_of(self.after), 3)} {main_unit(self.after)}"
        rejected = f", {len(self.rejected)} of them rejected" if self.rejected else ""
        return f"<{type(self).__name__} by {self.folds} fits{rejected}: RMS of poses left out {tables}>"


@dataclass(frozen=True, repr=False)
class FitResult:
    """What a fit found, as data; nothing in it is ever changed.

    Attributes:
        robot: The nominal robot.
        errors: The error model; names, units and priors of the parameters.
        estimate: Belief, stop reason, noise and history of the estimator.
        identifiability: What the data decided.
        before, after: Spot distances of the fitted poses with the nominal and with the calibrated robot.
        test: The same of all readings of the test poses, if there are any: (before, after); beams that do not meet the screen have no
            distance.
        chi_squared: Squared whitened residuals over their degrees of freedom.
        freedom: Those degrees: numbers measured or known beforehand, less the parameters that they decide.
        data: The poses that were fitted.
        test_data: The poses that were only tested.
        estimator: Estimator and schedule.
        error_model: The error model that was asked for.
        warnings: What the user ought to know.
        evidence: Prior scales that the data chose, if they were asked.
        outliers: Spots that were left out of fit and table, and beams that were exchanged.
        test_outliers: Gross outliers among the test poses.
        folds: Distances of poses that were left out in turn; None if it was not asked.
        misfits: Chi-squared by kind of reading.
        extra_noise: What readings scatter beyond what their columns state, by kind, [m], [rad] or [px].
        nominal: The uncalibrated robot, with measuring frames and targets where they suit it best.
        measured: The fitted poses with all that was read, outliers included.
        beyond: What had to be in the model beside geometry, as `sag`, for some readings to be no outliers.
        regained: How many these are.
        together: Where readings that the fit could not explain lie together, in words: scattered bad readings do not.
        test_trimmed: Distances of the test poses without their gross outliers: (before, after); None where there are none.
        stands_out: What the residuals say that geometry lacks, strongest first.
        lacking: What of it is not in the fit, and does something to it; None where nothing is.
        tool: Link whose accuracy is asked for; the empty string for the module or the target.
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
    error_model: str
    nominal: NominalFit
    freedom: float
    misfits: Mapping[str, Misfit]
    warnings: tuple[str, ...] = ()
    outliers: tuple[Outlier, ...] = ()
    evidence: Evidence | None = None
    test_outliers: tuple[Outlier, ...] = ()
    folds: CrossValidation | None = None
    extra_noise: Mapping[str, float] = field(default_factory=dict)
    measured: Measurements | None = None
    beyond: tuple[str, ...] = ()
    regained: int = 0
    together: tuple[str, ...] = ()
    test_trimmed: tuple[SpotTable, SpotTable] | None = None
    stands_out: tuple[StandsOut, ...] = ()
    lacking: Lacking | None = None
    tool: str = ""

    @property
    def read(self) -> Measurements:
        """The fitted poses with all that was read, outliers included."""
        return self.measured or self.data

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
            name: OriginCorrection(joints[name].origin, corrected, joints[name].moves)
            for name, corrected in self.errors.corrected_origins(self.x).items()
        }

    @cached_property
    def frames(self) -> tuple[FoundFrame, ...]:
        """Where instruments and targets were found: what measured, and what was measured, each on its link and with its covariance."""
        return found_frames(self.robot.tree, self.robot.rig, self.errors, self.x, self.covariance, self.determined)

    @property
    def determined(self) -> frozenset[str]:
        """Names of the parameters that the data decided."""
        decided = zip(self.errors.names, self.identifiability.determined, strict=True)
        return frozenset(name for name, known in decided if known)

    @property
    def frames_alone(self) -> bool:
        """Whether nothing of the robot was estimated, but where instruments and targets are, and lenses: hand-eye calibration."""
        return bool(self.errors.parameters) and all(parameter.kind in _FRAMES for parameter in self.errors.parameters)

    @property
    def rejection(self) -> str:
        """Why the result must not be trusted, or the empty string."""
        if not self.converged:
            return f"the fit did not converge: {self.stop_reason}{self._still_moving}"
        if self._moved:
            return f"{self._moved}, and no robot is made so; check the URDF, units and signs of joints and readings, and the axes measured"
        if self._scattered:
            return self._scattered
        if not (self.frames_alone or rms_of(self.after) < rms_of(self.before)):
            return f"the fit made nothing better: {rms_in_words(self.after)} RMS after it, {rms_in_words(self.before)} before"
        for kind, stated in zip(self.kinds, self.estimate.noise.stated, strict=True):
            if (stated or kind in self.stating) and self.misfits[kind].chi_squared > CHI_SQUARED_LIMIT:
                words = misfit_words(self.misfits, kind, stated=True)
                return f"{words}, chi-square is limited to {CHI_SQUARED_LIMIT:g}; look for outliers or state the noise that there is"
        return ""

    def noise_for(self, data: Measurements) -> Noise:
        """The noise that was assumed at the end, for the kinds of readings that another set has."""
        return noise_for(self.estimate.noise, self.kinds, data)

    @property
    def _still_moving(self) -> str:
        """What a fit that gave up on its way was about to move most, and the way out; the empty string for other reasons to stop."""
        if self.estimate.stop not in ("max_sweeps", "stalled"):
            return ""
        history = self.estimate.history
        moved = np.abs(history[-1].x - history[-2].x) / self.sigma if len(history) > 1 else np.zeros(len(self.sigma))
        names = [self.errors.names[index] for index in np.argsort(-moved, kind="stable")[:_NAMED] if moved[index] > 0]
        what = f", {' and '.join(names)} moving most" if names else ""
        return f"{what}; hold what the data cannot tell (--fix), narrow its priors, or measure joints over more of their range" + (
            "; --max-sweeps allows more" if self.estimate.stop == "max_sweeps" else ""
        )

    def noise_of(self, kind: str) -> float | None:
        """Standard deviation that was assumed of a kind of reading at the end, [m], [rad] or [px]; None where there was none of it."""
        return float(self.estimate.noise.sigma[self.kinds.index(kind)]) if kind in self.kinds else None

    @property
    def disagreements(self) -> tuple[str, ...]:
        """Where readings scatter otherwise than the stated noise says, in words; noise that is not stated can only be too large."""
        noise, words = self.estimate.noise, []
        for kind, known in zip(self.kinds, noise.stated.tolist(), strict=True):
            stated = known or kind in self.stating
            if self.misfits[kind].odd and (stated or noise.of_joints):
                words.append(misfit_words(self.misfits, kind, stated))
        return tuple(words)

    @cached_property
    def stating(self) -> frozenset[str]:
        """Kinds of readings of which any state their own noise."""
        return stating_kinds(self.data)

    @property
    def kinds(self) -> tuple[str, ...]:
        """What was measured, in the order of the noise."""
        return self.data.kinds

    @property
    def _moved(self) -> str:
        """A joint that the fit puts where no robot has it and no stated prior allows it; where a slide begins may be anywhere."""
        slides = tuple(f"{joint.name}." for joint in self.robot.chain.inputs if joint.prismatic)
        chosen = self.evidence.groups if self.evidence is not None else ("",) * len(self.x)
        for parameter, value, group in zip(self.errors.parameters, self.x.tolist(), chosen, strict=True):
            turns, off = parameter.unit == "rad", abs(value - parameter.mean)
            if parameter.kind != "joint" or parameter.sigma >= FLAT or (parameter.name.startswith(slides) and not turns):
                continue
            stated = 0.0 if group else _SURELY * parameter.sigma
            if off > max(_MOST_TURN if turns else _MOST_SHIFT, stated):
                by = f"{value / DEG:.0f} deg" if turns else f"{value / MM:.0f} mm"
                return f"the fit {'turns' if turns else 'shifts'} {parameter.name} by {by}"
        return ""

    @property
    def _scattered(self) -> str:
        """A kind of reading that the fit could not explain at all."""
        noise = self.estimate.noise
        estimated = {kind: float(sigma) for kind, sigma, stated in zip(self.kinds, noise.sigma, noise.stated, strict=True) if not stated}
        estimated |= {kind: max(scatter, estimated.get(kind, 0.0)) for kind, scatter in self.extra_noise.items()}
        for name, scatter in estimated.items():
            kind = WORDS[name]
            if scatter > kind.most * kind.size:
                return (
                    f"the {kind.several} scatter by {kind.told(scatter)} after the fit, and no instrument reads so; "
                    "check their order, units and axes, or state the noise if there is so much"
                )
        for name in sorted({reading.noise for reading in self.data.readings if reading.kind.on_screen} & estimated.keys()):
            angle, kind = estimated[name] / self._beam_length, WORDS[name]
            if angle > _MOST_WANDER:
                return (
                    f"the {kind.several} scatter by {kind.told(estimated[name])} after the fit, as if beams were off by "
                    f"{rounded(angle / DEG, 2)} deg; check the joints' units, signs and zeros, and the rig, or state the noise if there is "
                    "so much"
                )
        return ""

    @property
    def _beam_length(self) -> float:
        """Usual distance from a laser to its spot, [m]; infinite where none was seen."""
        model = Problem(self.errors, self.data)
        lasers = [(channel, view) for channel, view in zip(model.channels, model.views(self.x), strict=True) if channel.sensor.beam]
        lengths = [-view.p[seen, 0] / view.R[seen, 0, 2] for channel, view in lasers if (seen := channel.readings.seen).any()]
        return float(np.median(np.concatenate(lengths))) if lengths else np.inf

    def __repr__(self) -> str:
        """In a line: the whole of it holds the URDF and every pose."""
        tables = f"{rounded(rms_of(self.before), 3)} -> {rounded(rms_of(self.after), 3)} {main_unit(self.after)}"
        return (
            f"<{type(self).__name__} of {shown(self.robot.name)}: {len(self.errors.names)} parameters, {self.data.counted}, RMS {tables}>"
        )

    def with_entered(self: Self, names: Collection[str]) -> Self:
        """The same where some of what stands out is known to be in a compensation beside it."""
        out = tuple(replace(own, entered=own.entered or own.what in names) for own in self.stands_out)
        return replace(self, stands_out=out)

    def require_trustworthy(self) -> None:
        """Raise if the result must not be trusted.

        Raises:
            FitRejected: says why.
        """
        if self.rejection:
            raise FitRejected(self.rejection)


def disagreement_warnings(found: FitResult) -> tuple[str, ...]:
    """Chi-squared far from its degrees of freedom: the noise that was stated is not the noise that is seen."""
    return tuple(f"{words}; leave the noise out to have it estimated" for words in found.disagreements)


def large_noise_warning(found: FitResult) -> tuple[str, ...]:
    """Noise that was estimated far beyond what is usual: something is wrong with the data, or the model cannot follow."""
    warnings = []
    for kind, sigma, stated in zip(found.kinds, found.estimate.noise.sigma.tolist(), found.estimate.noise.stated, strict=True):
        if not stated and sigma > _LARGE * start_sigma_of(kind):
            warnings.append(
                f"the {WORDS[kind].several} scatter by {WORDS[kind].told(sigma)} after the fit, far more than is usual; look for rows, "
                "columns or units that do not belong together, and for what the URDF lacks"
            )
    return tuple(warnings)


def too_few_warning(data: Measurements, noise: Noise, freedom: float) -> tuple[str, ...]:
    """Noise that is assumed, since there are too few measurements to estimate it."""
    if noise.all_stated or freedom >= LEAST_FREEDOM:
        return ()
    if not data.only_spots:
        return (
            f"too few measurements to estimate their noise ({freedom:.0f} degrees of freedom, {LEAST_FREEDOM:.0f} are needed): usual "
            "figures are assumed; measure more poses or state it in .sigma columns",
        )
    return (
        f"too few spots to estimate their noise ({freedom:.0f} degrees of freedom, {LEAST_FREEDOM:.0f} are needed): "
        f"{noise.spot_sigma / MM:g} mm is assumed; measure more poses or state it with --spot-sigma-mm",
    )


def large_scales_warning(chosen: Evidence | None) -> tuple[str, ...]:
    """Joint errors that are far larger than a robot's usually are."""
    usual = DEFAULT_PRIORS["joint"]
    scales = chosen.scales if chosen is not None else {}
    large = [name for name, scale in scales.items() if scale > _FAR * usual.sigma("m" if name == "translation" else "rad")]
    if not large:
        return ()
    sizes = ", ".join(f"{name} {scales[name] / MM:.3g} {'mm' if name == 'translation' else 'mrad'}" for name in large)
    return (f"the data ask for joint errors far larger than robots have ({sizes}); check the URDF, the joints' units, zeros and signs",)


def misfit_words(found: Mapping[str, Misfit], kind: str, stated: bool) -> str:
    """`the spots scatter 2 times as much as the stated noise explains (chi-square 4 per degree of freedom)`."""
    own = found[kind]
    noise = "stated noise" if stated else "stated noise of the joints"
    return (
        f"the {WORDS[kind].several} scatter {np.sqrt(own.chi_squared):.2g} times as much as the {noise} explains "
        f"(chi-square {own.chi_squared:.3g} per degree of freedom)"
    )


def refined_cameras(data: Measurements, errors: ErrorModel, belief: Belief) -> dict[str, Any]:
    """The cameras whose lenses a fit refined, by name, each with the lens that it found and the covariance that it has for that.

    Args:
        data: What was fitted; its cameras stay as they are.
        errors: The error model of the fit.
        belief: What came out.
    """
    found = {}
    for name, camera in data.seeing.items() if data.refines else ():
        names = [f"{name}.lens_{number}" for number in range(1, len(camera.intrinsics) + 1)]
        P = np.zeros((len(names), len(names)))
        free = [row for row, own in enumerate(names) if own in errors.column]
        columns = [errors.column[names[row]] for row in free]
        P[np.ix_(free, free)] = belief.P[np.ix_(columns, columns)]
        found[name] = camera.refined(np.array([errors.value(own, belief.x) for own in names]), P)
    return found


def corrected_camera(data: Measurements, errors: ErrorModel, belief: Belief) -> Any:
    """The camera that read spots as pixels, with the screen where a fit found it, and the covariance that the fit has for that.

    Args:
        data: What was fitted; its camera stays as it is.
        errors: The error model of the fit; where it holds all of the screen's place, the covariance is the camera's own.
        belief: What came out.

    Raises:
        UsageError: no spots were read as pixels.
    """
    if not data.corrects_camera:
        raise UsageError("no laser spots were read as pixels, so the fit corrects no camera")
    camera: Any = data.camera
    names = [f"camera.{name}" for name in SIX]
    values = [errors.value(name, belief.x) for name in names]
    T_camera_screen, twists = screen_before(camera.T_camera_screen, np.array(values))
    free = [name for name in names if name in errors.column]
    columns = [errors.column[name] for name in free]
    in_screen = T_camera_screen.toActionMatrixInverse() @ twists[:, [names.index(name) for name in free]]
    covariance = in_screen @ belief.P[np.ix_(columns, columns)] @ in_screen.T if columns else camera.screen_covariance
    return replace(camera, T_camera_screen=T_camera_screen, screen_rms=None, screen_covariance=covariance)
