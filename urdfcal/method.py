"""The estimators by name, one call for all; and the fit of data that may hold outliers."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from urdfcal.ekf import Belief, Estimate, compress, degrees_of_freedom, iterated_schedule, paper_schedule, update
from urdfcal.errors import UsageError
from urdfcal.geometry import MM, Matrix, Vector
from urdfcal.measurements import Mask, Measurements
from urdfcal.noise import Linearisation, Noise
from urdfcal.pixel_spots import PixelSpots
from urdfcal.reading_kinds import UNITS
from urdfcal.robust import Observations, Outlier, beyond_belief, gate, inside, reweighted, swapped_poses
from urdfcal.spot_model import SpotModel

ESTIMATORS = ("ekf", "lse", "robust", "evolution")
SCHEDULES = ("iterated", "paper")
USUAL_Q, USUAL_R = 1e-4, 1e-4
_NEAR = 5.0  # [sigmas] how close to the other's place a spot must lie to have been read for it


@dataclass(frozen=True)
class Method:
    """Which estimator, and how far it goes.

    Attributes:
        estimator: One of ESTIMATORS.
        schedule: Of the EKF: `iterated` or `paper`.
        tolerance: When to stop; the estimator's own default if None.
        max_sweeps: How many sweeps are allowed; the estimator's own default if None.
        q: Q = q I of the `paper` schedule.
        r: R = r I of the `paper` schedule.
        gated: Whether outliers are taken out.
        rng: For `evolution`.
        start: Where to begin, (p,); the prior mean if None.
    """

    estimator: str = "ekf"
    schedule: str = "iterated"
    tolerance: float | None = None
    max_sweeps: int | None = None
    q: float = USUAL_Q
    r: float = USUAL_R
    gated: bool = True
    rng: np.random.Generator | None = None
    start: Vector | None = None

    def __post_init__(self) -> None:
        if self.estimator not in ESTIMATORS:
            raise UsageError(f"no estimator '{self.estimator}'; there are: {', '.join(ESTIMATORS)}")
        if self.schedule not in SCHEDULES:
            raise UsageError(f"no schedule '{self.schedule}'; there are: {', '.join(SCHEDULES)}")
        if self.estimator != "ekf" and self.schedule == "paper":
            raise UsageError(f"the schedule 'paper' is the EKF's; the estimator '{self.estimator}' has none")
        if not self.as_published and (self.q, self.r) != (USUAL_Q, USUAL_R):
            raise UsageError("process and measurement noise (q, r) belong to the schedule 'paper' alone; state spot_sigma elsewhere")
        if self.estimator == "robust" and self.limits():
            raise UsageError("the robust estimator takes no tolerance and no number of sweeps")
        if not (self.q >= 0 and self.r > 0):
            raise UsageError(f"Q must not be negative and R must be above zero, found q = {self.q:g} and r = {self.r:g}")

    @property
    def label(self) -> str:
        """Estimator and, of the EKF, its schedule."""
        return f"ekf, {self.schedule}" if self.estimator == "ekf" else self.estimator

    @property
    def as_published(self) -> bool:
        """Whether the filter sweeps as in the paper, and nothing is done beside it."""
        return self.estimator == "ekf" and self.schedule == "paper"

    @property
    def gates(self) -> bool:
        """Whether outliers are told apart: not in the paper's schedule; always where the estimator itself weighs them down."""
        return self.estimator == "robust" or (self.gated and not self.as_published)

    @property
    def shrinks(self) -> bool:
        """Whether the joints' prior scales may be chosen by evidence: where the noise is Gaussian and the data count once."""
        return self.estimator != "robust" and not self.as_published

    def limits(self) -> dict[str, Any]:
        """Tolerance and sweeps, as far as they are set."""
        return {name: value for name in ("tolerance", "max_sweeps") if (value := getattr(self, name)) is not None}

    def run(self, model: SpotModel, prior: Belief, noise: Noise) -> Estimate:
        """Fit one set of data."""
        if self.estimator == "robust":
            return reweighted(observations_of(model), prior, noise, start=self.start)
        if self.estimator == "evolution":
            from urdfcal.evolution import differential_evolution

            return differential_evolution(model.linearise, prior, noise, self.rng or np.random.default_rng(0), **self.limits())
        if self.estimator == "lse":
            from urdfcal.least_squares import levenberg_marquardt

            return levenberg_marquardt(model.linearise, prior, noise, start=self.start, **self.limits())
        if self.schedule == "paper":
            swept = paper_schedule(model.linearise, prior, noise, q=self.q, r=self.r, **self.limits())
            return with_honest_covariance(model, swept, prior, noise)
        return iterated_schedule(model.linearise, prior, noise, start=self.start, **self.limits())


def with_honest_covariance(model: SpotModel, swept: Estimate, prior: Belief, noise: Noise) -> Estimate:
    """The paper's estimate with the covariance that the data used once give it; the filter's own counts them in every sweep.

    Spot noise that is not stated is estimated from the residual, as elsewhere.
    """
    here = model.linearise(swept.belief.x)
    if not here.usable:
        return swept
    P = posterior(here, prior, noise)
    if not noise.all_stated:
        H = noise.weights(here).jacobian(here)
        noise = noise.estimated(here, degrees_of_freedom(here, H, Belief(swept.belief.x, P)))
        P = posterior(here, prior, noise)
    return replace(swept, belief=Belief(swept.belief.x, P), noise=noise)


def posterior(here: Linearisation, prior: Belief, noise: Noise) -> Matrix:
    """Covariance of the parameters, (p, p), once the data of one linearisation have been counted once."""
    rows, _ = compress(noise.weights(here).jacobian(here), np.zeros(here.measured.size), np.sqrt(np.diag(prior.P)))
    return update(prior, np.zeros(len(rows)), rows, np.eye(len(rows)))[0].P


@dataclass(frozen=True)
class CleanFit:
    """A fit without outliers.

    Attributes:
        model: Of the data that were kept.
        estimate: The fit of those.
        outliers: What was left out or mended.
    """

    model: SpotModel
    estimate: Estimate
    outliers: tuple[Outlier, ...] = ()


def fit_without_outliers(method: Method, model: SpotModel, prior: Belief, noise: Noise, first: Estimate) -> CleanFit:
    """Take out what the fit cannot explain and refit; beams that were read for each other are exchanged before.

    The robust estimator has weighed outliers down already: its estimate stands, and they are named and left out of the tables.

    Args:
        method: How to fit again.
        model: Of all the data.
        prior: Before the data.
        noise: As stated, or where to start.
        first: Fit of all the data.
    """
    clean, kept = _told_apart(method, model, prior, noise, first)
    if kept is None:
        return CleanFit(model, clean)
    mended, swaps = _unswapped(model, clean)
    if swaps:
        model = SpotModel(model.errors, mended, model.joints)
        first = method.run(model, prior, noise)
        clean, kept = _told_apart(method, model, prior, noise, first)
    if kept is None:
        return CleanFit(model, clean, swaps)
    history = clean.history if clean is first else [*first.history, *clean.history[1:]]
    return CleanFit(_of_kept(model, kept), replace(clean, history=history), (*swaps, *_left_out(model, clean, kept)))


def without_gross_outliers(model: SpotModel, found: Estimate) -> tuple[SpotModel, tuple[Outlier, ...]]:
    """Poses that were not fitted, without the spots that are far beyond what the fit makes them expect; and which those are.

    A fit that is bad on all of these poses keeps them all: see `robust.beyond_belief`.

    Args:
        model: Of poses that were not fitted.
        found: The fit.
    """
    if len(found.belief.x) != len(model.errors.names):
        return model, ()
    out = beyond_belief(observations_of(model), found)
    return (_of_kept(model, ~out), _left_out(model, found, ~out)) if out.any() else (model, ())


def observations_of(model: SpotModel) -> Observations:
    """What was measured of a model, of which any may be left out; rows of what is known beforehand never are."""
    seen = np.column_stack([model.measured[:, block.columns].any(axis=1) for block in model.blocks])
    known = np.zeros((len(model.data.lengths) + bool(model.errors.held_sum), len(model.blocks)), dtype=bool)
    known[:, 0] = True
    lasers = len(model.data.lasers)
    everything = np.vstack([seen, known])

    def missed(x: Vector) -> Mask:
        lost = np.zeros_like(everything)
        if lasers:
            lengths = model.predict(x)[1]
            with np.errstate(invalid="ignore"):
                away = ~((lengths > 0) & np.isfinite(lengths))
            lost[: len(seen), :lasers] = model.data.seen & away
            for column, each in enumerate(model.readings, start=lasers):
                if isinstance(each, PixelSpots):
                    lost[: len(seen), column] = each.data.seen & away[:, each.laser]
        return lost

    block_of = np.repeat(np.arange(len(model.blocks)), [block.columns.stop - block.columns.start for block in model.blocks])
    return Observations(model.linearise, missed, everything, block_of)


def _of_kept(model: SpotModel, kept: Mask) -> SpotModel:
    """The model as if the others, (n, blocks), had not been measured."""
    data, lasers = model.data, len(model.data.lasers)
    kept = kept[: len(data)]
    spots = np.where(kept[:, :lasers, None], data.spots, np.nan)
    columns = {(each.data.kind, each.data.target): own for each, own in zip(model.readings, kept[:, lasers:].T, strict=True)}
    readings = tuple(each.without(~columns[each.kind, each.target]) for each in data.readings)
    return SpotModel(model.errors, replace(data, spots=spots, readings=readings), model.joints)


def _told_apart(method: Method, model: SpotModel, prior: Belief, noise: Noise, first: Estimate) -> tuple[Estimate, Mask | None]:
    """A fit without outliers, and which spots are none, (n, lasers); None if none is."""
    spots = observations_of(model)
    if method.estimator != "robust":
        return gate(spots, prior, noise, first, begin=method.start, **method.limits())
    if not first.converged:
        return first, None
    kept = inside(spots, prior, first)
    return first, None if kept.all() or spots.too_few(kept) else kept


def _unswapped(model: SpotModel, clean: Estimate) -> tuple[Measurements, tuple[Outlier, ...]]:
    """The measurements with beams exchanged that were read for each other."""
    data, predicted = model.data, model.predict(clean.belief.x)[0]
    spots, sigma, swaps = data.spots.copy(), data.sigma.copy(), []
    for pose, one, other in swapped_poses(data, predicted, _NEAR * clean.noise.spot_sigma / MM):
        for each in (spots, sigma):
            each[pose, [one, other]] = each[pose, [other, one]]
        words = f"{data.lasers[one]} and {data.lasers[other]} were read for each other; they were exchanged"
        swaps.append(Outlier(data.where(pose), data.lasers[one], _distance_mm(data, predicted, pose, one), words))
    return replace(data, spots=spots, sigma=sigma), tuple(swaps)


def _left_out(model: SpotModel, clean: Estimate, kept: Mask) -> tuple[Outlier, ...]:
    data, observed = model.data, observations_of(model)
    lost, here, outliers = observed.missed(clean.belief.x), model.linearise(clean.belief.x), []
    for pose, index in np.argwhere(observed.seen & ~kept).tolist():
        if pose >= len(data):
            continue
        block = model.blocks[index]
        words, away = "its beam does not meet the screen in the model; is a joint's reading wrong?", None
        if not lost[pose, index]:
            size = UNITS[block.unit]
            away = float(np.linalg.norm(here.residual[pose, block.columns])) / size
            others = "the other spots" if index < len(data.lasers) else "the other readings"
            words = f"{away:.3g} {block.unit} from where {others} put it, noise {clean.noise.sigma[block.kind] / size:.3g} {block.unit}"
        outliers.append(Outlier(data.where(pose), block.name, away if block.unit == "mm" else None, words))
    return tuple(outliers)


def _distance_mm(data: Measurements, predicted: Vector, pose: int, laser: int) -> float:
    return float(np.linalg.norm(predicted[pose, laser] - data.spots[pose, laser]) / MM)
