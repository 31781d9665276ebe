"""What the data ask for beyond geometry, before a reading is called an outlier.

A gate under a model that is too poor takes good readings for bad ones: an arm that sags, seen upright in a few poses, is off there by
many times the scatter of all others. So what geometry cannot explain is judged again under models that have more in them, one after
the other: the joints' sag under gravity, the scale and the eccentricity of their encoders, the direction from which they came. A model
is believed if the log evidence

    log p(y) = -1/2 [chi^2 + (x - x0)' P0^-1 (x - x0) + sum log sigma_i^2 + log det(1 + P0^1/2 J'R^-1 J P0^1/2)] + constant   (Laplace)

is larger by more than LEAST_GAIN than the poorer model's of the same readings: of all that it keeps, or of those that both keep where
it keeps fewer, since what it explains leaves less noise for bad readings to hide in. Scattered bad readings no such model explains.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from urdfcal.base.geometry import Mask, Vector
from urdfcal.calibration.problem import Problem
from urdfcal.estimation.ekf import Belief, Estimate, iterated_schedule
from urdfcal.estimation.evidence import LEAST_POSES
from urdfcal.estimation.noise import Noise
from urdfcal.estimation.residual import Linearisation
from urdfcal.estimation.robust import Observations, conceivable, gate
from urdfcal.model.error_model import ErrorModel, with_softness
from urdfcal.model.gravity import Gravity, WeighedRobot
from urdfcal.model.softness import EXTRAS, Term, extra_terms, gravity_terms
from urdfcal.robot.configurations import joint_limits
from urdfcal.robot.robot import Robot
from urdfcal.sensors.measurements import Measurements

LEAST_GAIN = 10.0  # of log evidence, for which a richer model is believed
_CONFIGURATIONS = 400
DOWN = ((0.0, 0.0, -1.0), (-1.0, 0.0, 0.0), (0.0, -1.0, 0.0))  # opposite ones differ in the signs of all deflections alone


@dataclass(frozen=True)
class Explained:
    """What a model keeps of the readings.

    Attributes:
        model: Of all readings.
        estimate: The fit of those that it keeps.
        kept: Which these are, (n, blocks).
        names: What it has beyond geometry.
    """

    model: Problem
    estimate: Estimate
    kept: Mask
    names: tuple[str, ...] = ()

    def evidence_of(self, kept: Mask, noise: Noise) -> float:
        """Log evidence of this model, fitted to some readings."""
        observed, prior = Observations.of(self.model.linearise, self.estimate.belief.x), _prior(self.model)
        found = iterated_schedule(lambda x: observed.at(x, kept), prior, noise, start=self.estimate.belief.x)
        return log_evidence(observed.at(found.belief.x, kept), found, self.model.errors) if found.converged else -np.inf


def judged_by_more(geometry: Explained, robot: Robot, noise: Noise, gravity: Gravity | None = None) -> Explained:
    """What the richest model that the data ask for keeps of the readings; geometry's own judgement where they ask for none.

    Args:
        geometry: What geometry alone keeps.
        robot: The nominal robot, as it was measured.
        noise: As stated, or where to start.
        gravity: Where down is, and what is carried; down or along another axis of the root link if None.
    """
    best, data = geometry, geometry.model.data
    if data.pose_count < LEAST_POSES:
        return best
    pulls = [gravity] if gravity is not None else [Gravity(direction) for direction in DOWN]
    for pull in pulls:
        best = _better(best, _with_sag(geometry, robot, pull, noise), noise)
        if best is not geometry:
            break
    for extra in (name for name in EXTRAS if name != "approach" or data.approach is not None):
        if not best.kept.all():
            best = _better(best, _with_terms(best, robot, extra_terms(robot.chain, [extra]), extra, noise), noise)
    return best


def _better(best: Explained, other: Explained | None, noise: Noise) -> Explained:
    """The other if the data ask for it."""
    if other is None:
        return best
    more = np.count_nonzero(other.kept) > np.count_nonzero(best.kept)
    kept = other.kept if more else other.kept & best.kept
    return other if other.evidence_of(kept, noise) > best.evidence_of(kept, noise) + LEAST_GAIN else best


def _with_sag(geometry: Explained, robot: Robot, pull: Gravity, noise: Noise) -> Explained | None:
    weighed = WeighedRobot(robot, pull)
    terms = gravity_terms(robot.chain, weighed.moments(usual_range(robot, geometry.model.data)))
    return _judged(geometry, with_softness(geometry.model.errors, terms, weighed, robot.rig.tip), "sag", noise) if terms else None


def _with_terms(poorer: Explained, robot: Robot, more: Sequence[Term], name: str, noise: Noise) -> Explained | None:
    soft = poorer.model.errors.soft
    weighed = soft.weighed if soft is not None else WeighedRobot(robot, Gravity())
    terms = (*(soft.terms if soft is not None else ()), *more)
    return _judged(poorer, with_softness(poorer.model.errors, terms, weighed, robot.rig.tip), name, noise) if more else None


def _judged(poorer: Explained, errors: ErrorModel, name: str, noise: Noise) -> Explained | None:
    """What a richer model keeps, begun where the poorer one ended; None where it finds no rest, or cannot explain any more than that."""
    known = dict(zip(poorer.model.errors.names, poorer.estimate.belief.x.tolist(), strict=True))
    start = np.array([known.get(own, 0.0) for own in errors.names])
    model = Problem(errors, poorer.model.data, poorer.model.joints)
    observed, prior = Observations.of(model.linearise, start), _prior(model)
    glance = iterated_schedule(lambda x: observed.at(x, poorer.kept), prior, noise, start=start)
    if not (conceivable(observed, glance) & ~poorer.kept).any():
        return None
    first = iterated_schedule(model.linearise, prior, noise, start=start)
    estimate, kept = gate(observed, prior, noise, first, begin=start)
    if not estimate.converged:
        return None
    return Explained(model, estimate, np.ones_like(observed.made) if kept is None else kept, (*poorer.names, name))


def _prior(model: Problem) -> Belief:
    return Belief.independent(model.errors.mean, model.errors.sigma)


def usual_range(robot: Robot, data: Measurements, rng: np.random.Generator | None = None) -> Vector:
    """Configurations within the joints' range, and those that were measured, (n, inputs): where moments are looked at."""
    lower, upper = joint_limits(robot, data.q)
    drawn = (rng or np.random.default_rng(0)).uniform(lower, upper, (_CONFIGURATIONS, len(lower)))
    return np.vstack([drawn, data.q])


def log_evidence(linearisation: Linearisation, estimate: Estimate, errors: ErrorModel) -> float:
    """Laplace's approximation of the log evidence, less a constant that the data alone decide."""
    noise, sigma = estimate.noise, errors.sigma
    spread = noise.log_determinant(linearisation)
    pull = float(np.sum(((estimate.belief.x - errors.mean) / sigma) ** 2))
    J = (
        noise.weights(linearisation).jacobian(linearisation) * sigma
    )  # not the estimate's covariance: that also knows of unsure prior scales
    volume = float(np.linalg.slogdet(J.T @ J + np.eye(len(sigma)))[1])
    return -0.5 * (noise.chi_squared(linearisation) + pull + spread + volume)
