"""One fit, step by step: a start, the fit without outliers, prior scales chosen by the data, and what all of it says."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from urdfcal.arm_scale import with_scale
from urdfcal.ekf import Belief, Estimate
from urdfcal.error_model import ErrorModel, matching
from urdfcal.error_table import error_table
from urdfcal.evidence import LEAST_POSES, Evidence, by_evidence, with_unsure_scales
from urdfcal.fit_result import FitResult
from urdfcal.fit_start import begin, explains, require_beams_on_screen, require_sane_readings
from urdfcal.fit_warnings import disagreement, few_spots, large_noise, large_scales
from urdfcal.gauge import ModelOptions, build_error_model
from urdfcal.geometry import Matrix, Vector
from urdfcal.identifiability import Identifiability, identify, with_sigmas
from urdfcal.known_noise import noise_of
from urdfcal.measurements import Measurements
from urdfcal.method import Method, posterior
from urdfcal.misfit import Misfit, misfits
from urdfcal.model_warnings import model_warnings
from urdfcal.noise import Linearisation, Noise
from urdfcal.nominal import NominalFit, nominal_fit
from urdfcal.outliers import CleanFit, fit_without_outliers
from urdfcal.pixel_start import in_pixels, start_of_pixels
from urdfcal.robot import Robot
from urdfcal.robust import degrees, kind_scales, robust_scale, squared_distances
from urdfcal.spot_model import SpotModel, kinds_of, model_for


@dataclass(frozen=True)
class FitTask:
    """What is to be fitted, and how: the arguments of `calibration.fit` once they were looked at.

    Attributes:
        robot: The nominal robot, as it was measured.
        method: Which estimator, and how far it goes.
        options: What is to be calibrated.
        sessions: Of all poses, those included that are only tested.
        stated: Noise that is stated by kind of reading, [m], [rad] or [px].
        joint_sigma: Noise of every joint reading, (inputs,), [rad] or [m].
        evidence: Whether the data may choose the scales of the joints' priors.
        sane: Whether data with a common mistake in them are refused.
    """

    robot: Robot
    method: Method
    options: ModelOptions
    sessions: tuple[str, ...]
    stated: Mapping[str, float]
    joint_sigma: Vector
    evidence: bool
    sane: bool

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
            require_sane_readings(errors, first.model, first.found, noise)
        clean = first.without_outliers(noise)
        scaled = self._scaled(first, clean, noise)
        return self._result(nominal, first, clean, scaled, tuple(filter(None, (no_scale, first.message))))

    def _first(self, nominal: NominalFit, data: Measurements, noise: Noise) -> _First:
        """A fit of all that was measured, from where the priors have it or, if need be, from where it is found to be."""
        errors = nominal.errors
        start = start_of_pixels(data, errors, noise, self.sane) if in_pixels(data) else nominal.x
        first = _first_fit(replace(self.method, start=start), model_for(errors, data, noise), nominal.x, noise)
        if not data.seen.any() or self.method.as_published or explains(first.model, first.found, noise):
            return first
        begun = begin(first.model, noise, self.sane)
        return _first_fit(replace(self.method, start=begun.x), model_for(begun.errors, data, noise), begun.x, noise, begun.message)

    def _scaled(self, first: _First, clean: CleanFit, noise: Noise) -> _Scaled:
        """Refit with the joints' prior scales chosen by evidence; priors that were stated, also for single parameters, stay."""
        errors, found, method = first.model.errors, clean.estimate, first.method
        wanted = self.evidence and method.shrinks and "joint" not in self.options.priors and found.converged
        if not wanted or len(clean.model.data) < LEAST_POSES or not any(parameter.kind == "joint" for parameter in errors.parameters):
            return _Scaled(errors, found)
        single = self.options.single.items()
        stated = [name for pattern, said in single if said.sigma is not None for name in matching(errors.parameters, pattern)]
        errors, refitted, chosen = by_evidence(clean.model.linearise, errors, noise, found, stated)
        if method.estimator != "ekf":
            again = replace(method, start=refitted.belief.x)
            refitted = again.run(clean.model, Belief.independent(errors.mean, errors.sigma), replace(refitted.noise, stated=True))
            belief = Belief(refitted.belief.x, with_unsure_scales(errors, chosen.groups, refitted.belief))
            refitted = replace(refitted, belief=belief, noise=replace(refitted.noise, stated=noise.stated))
        return _Scaled(errors, replace(refitted, history=[*found.history, *refitted.history[1:]]), chosen)

    def _result(self, nominal: NominalFit, first: _First, clean: CleanFit, scaled: _Scaled, said: tuple[str, ...]) -> FitResult:
        errors, found, data = scaled.errors, scaled.found, clean.model.data
        here = clean.model.linearise(found.belief.x)
        plain = posterior(here, Belief.independent(errors.mean, errors.sigma), found.noise)  # without what is unsure of the scales
        freedom = here.count - len(errors.names) + float(np.sum(np.diag(plain) / errors.sigma**2))
        result = FitResult(
            robot=self.robot,
            errors=errors,
            estimate=found,
            identifiability=_decided(here, found, first.model.errors, scaled.evidence),
            before=nominal.table(data),
            nominal=nominal,
            freedom=freedom,
            outliers=clean.outliers,
            evidence=scaled.evidence,
            after=error_table(here, len(data)),
            test=None,
            chi_squared=_misfit(self.method, found.noise, here, freedom),
            data=data,
            test_data=None,
            estimator=self.method.label,
            error_model=self.options.error_model,
            warnings=(
                *model_warnings(self.robot, errors, self.options),
                *said,
                *few_spots(data, found.noise, freedom),
                *large_scales(scaled.evidence),
            ),
            misfits=dict(zip(kinds_of(data), _misfits(self.method, found.noise, here, plain), strict=True)),
        )
        return replace(result, warnings=(*result.warnings, *disagreement(result), *large_noise(result)))


@dataclass(frozen=True)
class _First:
    """A fit of everything that was measured.

    Attributes:
        method: Which estimator, and where it begins.
        model: Of all measurements.
        x: Where beams are looked at if the fit cannot take a step, (p,).
        prior: Before the data.
        found: The fit.
        message: What had to be done for it, in words.
    """

    method: Method
    model: SpotModel
    x: Vector
    prior: Belief
    found: Estimate
    message: str = ""

    def without_outliers(self, noise: Noise) -> CleanFit:
        """The same without what it cannot explain, if the method tells outliers apart.

        Raises:
            FitRejected: a beam that was seen does not meet the screen in the model.
        """
        if self.method.gates:
            clean = fit_without_outliers(self.method, self.model, self.prior, noise, self.found)
        else:
            clean = CleanFit(self.model, self.found)
        if len(clean.estimate.history) == 1:
            require_beams_on_screen(self.model, self.x)
        return clean


def _first_fit(method: Method, model: SpotModel, x: Vector, noise: Noise, message: str = "") -> _First:
    prior = Belief.independent(model.errors.mean, model.errors.sigma)
    return _First(method, model, x, prior, method.run(model, prior, noise), message)


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


def _decided(here: Linearisation, found: Estimate, stated: ErrorModel, chosen: Evidence | None) -> Identifiability:
    """What the data decided, judged against the priors that were stated: scales that the data chose hold more still.

    Sigmas of combinations are those of the estimate.
    """
    belief = found.belief
    if chosen is None:
        return identify(stated.names, belief.x, belief.P, stated.sigma)
    P = posterior(here, Belief.independent(stated.mean, stated.sigma), found.noise)
    return with_sigmas(identify(stated.names, belief.x, P, stated.sigma), belief.P, stated.names)


def _misfit(method: Method, noise: Noise, here: Linearisation, freedom: float) -> float:
    """Chi-squared per degree of freedom; of the bulk alone where the estimator weighs outliers down and keeps them."""
    if method.estimator == "robust":
        return robust_scale(squared_distances(here, noise), degrees(here)) ** 2 * here.count / max(freedom, 1.0)
    return noise.chi_squared(here) / max(freedom, 1.0)


def _misfits(method: Method, noise: Noise, here: Linearisation, P: Matrix) -> tuple[Misfit, ...]:
    """The same of every kind of reading."""
    found = misfits(here, noise, P)
    if method.estimator != "robust":
        return found
    scales = kind_scales(here, squared_distances(here, noise)).tolist()
    return tuple(
        replace(own, chi_squared=scale**2 * count / max(own.freedom, 1.0))
        for own, scale, count in zip(found, scales, here.counts.tolist(), strict=True)
    )
