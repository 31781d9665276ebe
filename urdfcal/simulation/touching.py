"""Poses at which a simulated robot touches a socket or a plane, by Newton's method on the true robot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from urdfcal.base.errors import UsageError
from urdfcal.base.geometry import Mask, Matrix, Vector
from urdfcal.robot.configurations import joint_limits, random_positions
from urdfcal.sensors.registry import SENSORS
from urdfcal.sensors.sensor import point_jacobian
from urdfcal.simulation.setup import Pair, SimulatedSensor, SimulatedSetup, place_labels

_ROUNDS, _LONGEST_STEP, _DAMPING = 40, 0.5, 1e-9  # of Newton's method; steps in [rad] and [m]
_REACHED = 1e-11  # [m] how near a touch must come to its place
_MOST_DRAWS = 400_000
_AT_ONCE = 1024  # touches that are looked for at once


@dataclass(frozen=True)
class Touch:
    """One place that a target touches.

    Attributes:
        kind: `plane` or `socket`.
        pair: What touches, and what it is seen from.
        label: Of the place.
    """

    kind: str
    pair: Pair
    label: str


def turns_of(sensors: Sequence[SimulatedSensor]) -> list[Touch]:
    """Every touch that some sensors make; a simulation's poses take turns with them."""
    return [
        Touch(sensor.kind, sensor.pair, label) for sensor, labels in zip(sensors, place_labels(sensors), strict=True) for label in labels
    ]


def touching(setup: SimulatedSetup, session: str, touches: Sequence[Touch], off: Matrix, rng: np.random.Generator) -> Matrix:
    """True joint positions at which each pose's target is where it touches, or that far off.

    Args:
        setup: Robot, truth and instruments.
        session: Whose measuring frame stands.
        touches: One a pose.
        off: How far the target is off its place, (poses, 3), [m].
        rng: Source of randomness.

    Returns:
        (poses, inputs), [rad] or [m].

    Raises:
        UsageError: such positions are too rare.
    """
    wanted = [_goal(setup, touch, apart) for touch, apart in zip(touches, off, strict=True)]
    q, open_, drawn = np.empty((len(wanted), len(setup.robot.chain.inputs))), np.arange(len(wanted)), 0
    while len(open_) and drawn < max(_MOST_DRAWS, 20 * len(wanted)):
        rows = open_[:_AT_ONCE]
        rows = np.resize(rows, max(len(rows), min(_AT_ONCE, 64)))
        found, there = _newton(setup, session, [wanted[row] for row in rows], random_positions(setup.robot, len(rows), rng))
        q[rows[there]] = found[there]
        open_, drawn = np.setdiff1d(open_, rows[there]), drawn + len(rows)
    if len(open_):
        lost = touches[open_[0]]
        raise UsageError(
            f"only {len(wanted) - len(open_)} of {len(wanted)} poses within the joints' limits touch what they should: "
            f"{lost.pair[0]} does not reach {lost.kind} {lost.label}; try another seed"
        )
    return q


@dataclass(frozen=True)
class _Goal:
    """Where a target shall be: across `across`, a projection (3, 3), it must come to `point`."""

    pair: Pair
    point: Vector
    across: Matrix


def _goal(setup: SimulatedSetup, touch: Touch, off: Vector) -> _Goal:
    name = f"{touch.kind}:{touch.label}"
    return _Goal(touch.pair, *SENSORS[touch.kind].touched_from(setup.place(name), setup.errors.planes.get(name, np.eye(3)), off))


def _newton(setup: SimulatedSetup, session: str, wanted: Sequence[_Goal], q: Matrix) -> tuple[Matrix, Mask]:
    """Joint positions after Newton's method, kept within their limits, and whether each is where it should be."""
    lower, upper = joint_limits(setup.robot)
    pairs = list(dict.fromkeys(goal.pair for goal in wanted))
    own, pick = np.array([pairs.index(goal.pair) for goal in wanted]), np.arange(len(wanted))
    across, points = np.array([goal.across for goal in wanted]), np.array([goal.point for goal in wanted])
    short = np.full((len(wanted), 3), np.inf)
    for _ in range(_ROUNDS):
        motion, seen = setup.motion(q, session)
        p = np.stack([seen[pair][0] for pair in pairs])[own, pick]
        short = (across @ (points - p)[..., None])[..., 0]
        if np.abs(short).max() < _REACHED:
            break
        by_joint = np.stack([setup.twists(motion, pair) for pair in pairs])[own, pick]
        J = across @ point_jacobian(p) @ by_joint
        step = (J.transpose(0, 2, 1) @ np.linalg.solve(J @ J.transpose(0, 2, 1) + _DAMPING * np.eye(3), short[..., None]))[..., 0]
        q = np.clip(q + step * np.minimum(1.0, _LONGEST_STEP / np.maximum(np.linalg.norm(step, axis=1), _DAMPING))[:, None], lower, upper)
    return q, np.asarray(np.abs(short).max(axis=1) < _REACHED)
