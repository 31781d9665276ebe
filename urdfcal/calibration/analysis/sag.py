"""Gravity sag beside geometry: a joint fit of both, and what it gains on poses that it did not see.

The joint fit starts from a geometry-only calibration, of the same poses without the same outliers. Each joint yields to its own
gravity moment (`softness.py`); the joints' prior scales and the noise are chosen by evidence again, since part of what geometry had to
stand for is explained now. Further terms are those that the residuals ask for (`asking/`), or that are asked for; each stays only
where it raises the log evidence (`richer.py`) by enough, and clusters of poses that are left out in turn are the more likely for it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from urdfcal.base.foreign_text import shown
from urdfcal.base.geometry import Vector
from urdfcal.base.minus import with_minus
from urdfcal.base.progress import each
from urdfcal.base.terminal import rounded
from urdfcal.calibration.analysis.compensation import Compensation, compensation_files, in_memory
from urdfcal.calibration.analysis.left_out import LeftOut
from urdfcal.calibration.asking.ground import Ground
from urdfcal.calibration.asking.interview import Interview
from urdfcal.calibration.asking.questions import HEARD
from urdfcal.calibration.error_table import error_table, main_unit
from urdfcal.calibration.problem import Problem, problem_of
from urdfcal.calibration.result import FitResult
from urdfcal.calibration.richer import LEAST_GAIN, log_evidence, usual_range
from urdfcal.estimation.ekf import Belief, Estimate, iterated_schedule, posterior
from urdfcal.estimation.evidence import by_evidence
from urdfcal.estimation.noise import Noise
from urdfcal.estimation.residual import Linearisation, Linearise
from urdfcal.model.error_model import ErrorModel, with_softness
from urdfcal.model.found_frames import found_frames
from urdfcal.model.gravity import Gravity, WeighedRobot
from urdfcal.model.softness import EXTRAS, Softness, Term, extra_terms, gear_terms, gravity_terms
from urdfcal.robot.frames import FoundFrame
from urdfcal.robot.placed_frames import NO_FRAMES, FramesWish, frame_origins, with_frames
from urdfcal.robot.urdf_writer import with_origins
from urdfcal.sensors.repeats import first_rows

FOLDS = 5
_LEAST_GAINS = {"scale": 5.0, "eccentricity": 5.0, "harmonics": 5.0, "approach": 3.0}  # of log evidence, for which a term stays
_AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
_UPWARD = -5.0  # [sigmas] joints that bend upward by more than this, all in all, say that gravity pulls the other way
_COARSE = [(x, y, z) for x in (-1, 0, 1) for y in (-1, 0, 1) for z in (-1, 0, 1) if (z, y, x) > (0, 0, 0)]  # half of the sphere

Rows = npt.NDArray[np.intp]


@dataclass(frozen=True)
class HeldOut:
    """Root mean square distances of poses that were not fitted, by cross-validation.

    Attributes:
        geometry: With geometry alone, in `unit`.
        sag: With geometry and sag.
        folds: How many there were.
        unit: `mm`, or `deg` or `px` where no length was read.
        weighed: What is left with sag of the residuals of all kinds of readings, each in units of its own noise.
    """

    geometry: float
    sag: float
    folds: int
    unit: str
    weighed: float

    @property
    def ratio(self) -> float:
        """What is left of the error with sag."""
        return self.sag / self.geometry if self.geometry else 1.0


@dataclass(frozen=True, repr=False)
class SagFit:
    """A joint fit of geometry and sag.

    Attributes:
        calibration: The geometry-only calibration that it started from.
        errors: The error model with the joints' softness.
        estimate: Of all parameters.
        gravity: Where down is, and what is carried.
        gain: Of log evidence over geometry alone.
        held_out: What it gains on poses that were not fitted; None if that was not asked for.
        kept: Terms on request that earned their place.
        dropped: Those that did not.
        warnings: What the user ought to know.
    """

    calibration: FitResult
    errors: ErrorModel
    estimate: Estimate
    gravity: Gravity
    gain: float
    held_out: HeldOut | None
    kept: tuple[str, ...] = ()
    dropped: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()

    def __repr__(self) -> str:
        """In a line."""
        terms = f"{len(self.softness.terms)} ways to give way" if self.errors.soft is not None else "rigid"
        return f"<{type(self).__name__} of {shown(self.calibration.robot.name)}: {terms}, {rounded(self.gain, 3)} nats over geometry alone>"

    @property
    def softness(self) -> Softness:
        """How the joints give way."""
        assert self.errors.soft is not None
        return self.errors.soft

    @property
    def soft_values(self) -> dict[str, tuple[float, float]]:
        """Value and standard deviation of every soft parameter, by name."""
        sigma, column = np.sqrt(np.diag(self.estimate.belief.P)), self.errors.column
        return {
            term.name: (float(self.estimate.belief.x[column[term.name]]), float(sigma[column[term.name]])) for term in self.softness.terms
        }

    @cached_property
    def frames(self) -> tuple[FoundFrame, ...]:
        """Where the joint fit found instruments and targets."""
        robot, belief, decided = self.calibration.robot, self.estimate.belief, self.calibration.determined
        return found_frames(robot.tree, robot.rig, self.errors, belief.x, belief.P, decided)

    def urdf(self, frames: FramesWish = NO_FRAMES) -> bytes:
        """The calibrated URDF of the joint fit, with frames of it as far as they are wished for; of use with its compensation alone."""
        robot = self.calibration.robot
        chosen, origins = frames.chosen(self.frames, robot.tree), self.errors.corrected_origins(self.estimate.belief.x)
        links = {name: own.corrected for name, own in frame_origins(chosen.written).items()}
        return with_frames(replace(robot.description, text=with_origins(robot.description, {**origins, **links})), chosen.added)

    def compensation(self) -> Compensation:
        """The deflections, with the calibrated robot that they belong to."""
        return in_memory(self.calibration.robot, self.urdf(), self.softness, self.soft_values)

    def files(self, urdf_name: str, frames: FramesWish = NO_FRAMES) -> tuple[bytes, bytes]:
        """URDF and compensation to write, each with the hash of the other; the URDF stands beside the compensation under this name."""
        return compensation_files(self.urdf(frames), urdf_name, self.calibration.robot, self.softness, self.gravity, self.soft_values)


def fit_sag(
    calibration: FitResult,
    gravity: Gravity | None = None,
    *,
    extras: Sequence[str] | None = None,
    folds: int = FOLDS,
    compare_directions: bool = True,
    rng: np.random.Generator | None = None,
) -> SagFit | None:
    """Fit geometry and sag together, from a geometry-only calibration.

    Args:
        calibration: Geometry alone; its poses are fitted again.
        gravity: Where down is, and what is carried; by default -z of the root link, and nothing.
        extras: Further terms, of `softness.EXTRAS`; by default those that stand out in the calibration's residuals.
        folds: For the gain on held-out poses; 0 for none.
        compare_directions: Also try gravity along the root link's other axes, and warn if the data prefer one of them.
        rng: Draws the folds, and configurations within the joints' range; seeded by default.

    Returns:
        None where gravity bends nothing, and nothing else is asked for.
    """
    rng, gravity = rng or np.random.default_rng(0), gravity or Gravity()
    setup = _Setup(calibration, rng)
    terms, further = setup.gravity_terms(gravity), setup.further(extras)
    if not terms and not further:
        return None
    whole = setup.fit(terms, gravity)
    kept: list[str] = []
    for extra, more in further.items():
        tried = setup.fit((*whole.terms, *more), gravity, whole)
        if tried.log_evidence > whole.log_evidence + _LEAST_GAINS[extra] and setup.foretells(tried) > setup.foretells(whole):
            whole = tried
            kept.append(extra)
    alone = setup.alone()
    held_out = setup.held_out(alone, whole, folds, rng) if folds else None
    warnings = tuple(setup.better_directions(gravity, whole, held_out, rng)) if compare_directions and not extras else ()
    gain = whole.log_evidence - alone.log_evidence
    dropped = tuple(extra for extra in further if extra not in kept)
    return SagFit(calibration, whole.errors, setup.widened(whole, gravity), gravity, gain, held_out, tuple(kept), dropped, warnings)


@dataclass(frozen=True)
class _Fitted:
    """One fit of the poses."""

    errors: ErrorModel
    estimate: Estimate
    model: Problem
    terms: tuple[Term, ...] = ()

    @property
    def log_evidence(self) -> float:
        return log_evidence(self.model.linearise(self.estimate.belief.x), self.estimate, self.errors)

    @property
    def bends(self) -> float:
        """How surely the joints bend the way that gravity pulls them: weighted sum of deflections over its standard deviation, [sigmas]."""
        own = [self.errors.column[term.name] for term in self.terms if term.largest]
        P = self.estimate.belief.P[np.ix_(own, own)]
        weights = 1 / np.diag(P)
        return float(weights @ self.estimate.belief.x[own] / np.sqrt(weights @ P @ weights)) if own else 0.0


class _Setup:
    """What all the fits of one calibration share."""

    def __init__(self, calibration: FitResult, rng: np.random.Generator) -> None:
        self.calibration, self.chain = calibration, calibration.robot.chain
        self.data, self.noise = calibration.data, calibration.estimate.noise
        self.range = usual_range(calibration.robot, calibration.data, rng)

    def further(self, extras: Sequence[str] | None) -> dict[str, tuple[Term, ...]]:
        """Terms to try beside gravity's, by what they are: those that are wanted, or that the residuals ask for."""
        out = self.calibration.stands_out
        wanted = [own.what for own in out] if extras is None else extras
        found = {extra: extra_terms(self.chain, [extra]) for extra in EXTRAS if extra in wanted}
        turning = [joint.name for joint in self.chain.inputs if not joint.prismatic]
        cycles = dict.fromkeys(own.cycles for own in out if own.cycles) if extras is None else {}
        gears = [(joint, number) for number in cycles for joint in turning]  # what one joint has, its likes may have
        return found | ({"harmonics": gear_terms(self.chain, gears)} if gears else {})

    def foretells(self, fitted: _Fitted) -> float:
        """Log density of clusters of poses that are left out in turn."""
        return Interview(Ground(self.calibration.robot, fitted.model, fitted.estimate)).foretold()

    def widened(self, whole: _Fitted, gravity: Gravity) -> Estimate:
        """The joint fit, whose covariance knows of what is not in it either."""
        found, errors = whole.estimate, whole.errors
        interview = Interview(Ground(self.calibration.robot, whole.model, found, gravity))
        lacking = interview.lacking(interview.answers(HEARD)) if found.converged else None
        if lacking is None:
            return found
        linearisation = whole.model.linearise(found.belief.x)
        plain = posterior(linearisation, Belief.independent(errors.mean, errors.sigma), found.noise)
        return lacking.widening(found, linearisation, plain)

    def gravity_terms(self, gravity: Gravity) -> tuple[Term, ...]:
        """Gravity's terms over the joints' range."""
        return gravity_terms(self.chain, self.weighed(gravity).moments(self.range))

    def weighed(self, gravity: Gravity) -> WeighedRobot:
        return WeighedRobot(self.calibration.robot, gravity)

    def alone(self) -> _Fitted:
        """The geometry-only calibration, as if it had been made here."""
        errors = self.calibration.errors
        return _Fitted(errors, self.calibration.estimate, problem_of(errors, self.data, self.noise))

    def fit(self, terms: tuple[Term, ...], gravity: Gravity, start: _Fitted | None = None) -> _Fitted:
        """Geometry and some terms together."""
        errors = with_softness(self.calibration.errors, terms, self.weighed(gravity), self.calibration.robot.rig.tip)
        known = dict(zip(start.errors.names, start.estimate.belief.x, strict=True)) if start is not None else {}
        known = dict(zip(self.calibration.errors.names, self.calibration.x, strict=True)) | known
        x = np.array([known.get(name, 0.0) for name in errors.names])
        model = problem_of(errors, self.data, self.noise)
        first = _run(model.linearise, errors, self.noise, x)
        chosen = self.calibration.evidence
        if chosen is not None and first.converged:
            keep = [name for name, group in zip(self.calibration.errors.names, chosen.groups, strict=True) if not group]
            prior, first, _ = by_evidence(model.linearise, errors.prior(keep), self.noise, first)
            errors = errors.with_prior(prior)
            model = model.with_prior(errors)
        return _Fitted(errors, first, model, terms)

    def held_out(self, alone: _Fitted, whole: _Fitted, folds: int, rng: np.random.Generator) -> HeldOut | None:
        """Each pose predicted by fits that did not see it, nor another reading at the same joint positions."""
        where = self.data.configuration_of
        poses = first_rows(where)
        folds = min(folds, len(poses))
        if folds < 2:
            return None
        noise, unit = alone.estimate.noise, main_unit(error_table(alone.model.linearise(alone.estimate.belief.x), len(self.data)))
        sums, both = np.zeros((2, 3)), [LeftOut(fitted.model, fitted.estimate) for fitted in (alone, whole)]
        for held in each(np.array_split(rng.permutation(len(poses)), folds), "part of the poses left out", folds):
            rows = held if len(poses) == len(where) else np.flatnonzero(np.isin(where, held))
            sums += [_sizes(own.of(rows), noise, len(rows), unit) for own in both]
        geometry, sag = np.sqrt(sums[:, 0] / np.maximum(sums[:, 1], 1)).tolist()
        return HeldOut(geometry, sag, folds, unit, float(np.sqrt(sums[1, 2] / sums[0, 2])) if sums[0, 2] else 1.0)

    def better_directions(self, gravity: Gravity, whole: _Fitted, held_out: HeldOut | None, rng: np.random.Generator) -> Iterator[str]:
        """A warning if the data, and poses that were not fitted, too, prefer another direction of gravity.

        One and its opposite differ in the signs of all deflections, and are told apart by those alone, where sag gains anything.
        """
        root = self.calibration.robot.tree.root
        others: dict[str, _Fitted] = {}
        for axis, direction in each(_AXES.items(), "direction of gravity", len(_AXES)):
            other = replace(gravity, direction=direction)
            if abs(np.dot(direction, gravity.direction)) < 0.9 and (terms := self.gravity_terms(other)):
                others[axis] = self.fit(terms, other, whole)
        best = max(others, key=lambda axis: others[axis].log_evidence, default="")
        gain = others[best].log_evidence - whole.log_evidence if best else 0.0
        if gain > LEAST_GAIN:
            left = self.held_out(whole, others[best], FOLDS, rng)
            if left is not None and left.ratio < 1:
                change = with_minus(f"{100 * (left.ratio - 1):+.0f} %")
                yield (
                    f"the data prefer gravity along {best} of '{root}' to the direction that was used (log evidence {gain:+.0f}, "
                    f"held-out poses {change}); "
                    "if the robot is mounted so, say --gravity X,Y,Z, or --gravity estimate"
                )
        elif whole.bends < _UPWARD and (held_out is None or held_out.ratio < 1):
            yield f"the joints bend against gravity; does the robot hang from its root link '{root}'? say --gravity X,Y,Z if it does"


def estimated_gravity(calibration: FitResult, rng: np.random.Generator | None = None) -> Gravity:
    """The direction of gravity that makes the data most probable, from a coarse look all round and then downhill.

    Its sign is the one with which most joints bend the way that they are pulled.

    Args:
        calibration: Geometry alone.
        rng: Draws configurations within the joints' range; seeded by default.
    """
    from scipy.optimize import minimize

    setup = _Setup(calibration, rng or np.random.default_rng(0))

    def fitted(vector: Vector) -> _Fitted | None:
        gravity = Gravity(_unit(vector))
        terms = setup.gravity_terms(gravity)
        return setup.fit(terms, gravity) if terms else None

    def loss(vector: Vector) -> float:
        found = fitted(vector)
        return -found.log_evidence if found is not None else np.inf

    start = np.array(min(_COARSE, key=lambda vector: loss(np.array(vector, dtype=float))), dtype=float)
    best = minimize(loss, start / np.linalg.norm(start), method="Nelder-Mead", options={"xatol": 5e-3, "fatol": 0.1, "maxfev": 80}).x
    found = fitted(best)
    return Gravity(_unit(-best if found is not None and found.bends < 0 else best))


def _unit(vector: Vector) -> tuple[float, float, float]:
    x, y, z = (np.asarray(vector) / np.linalg.norm(vector)).tolist()
    return x, y, z


def _run(linearise: Linearise, errors: ErrorModel, noise: Noise, start: Vector) -> Estimate:
    return iterated_schedule(linearise, Belief.independent(errors.mean, errors.sigma), noise, start=start)


def _sizes(linearisation: Linearisation, usual: Noise, count: int, unit: str) -> tuple[float, float, float]:
    """Sum of the squared distances in a unit, how many there are, and the sum of all squared residuals in units of the usual noise."""
    own = [row for row in error_table(linearisation, count).values() if row.unit == unit]
    weighed = (linearisation.residual / usual.of_numbers(linearisation))[:count][linearisation.measured[:count]]
    return sum(row.n * (row.mean**2 + row.std**2) for row in own), sum(row.n for row in own), float(weighed @ weighed)
