"""Poses at which a simulated robot touches a socket or a plane, by Newton's method on the true robot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from urdfcal.errors import UsageError
from urdfcal.frame_jacobian import CHUNK
from urdfcal.geometry import Matrix, Vector
from urdfcal.measurements import Mask
from urdfcal.simulated_setup import SimulatedSetup
from urdfcal.simulation import joint_limits
from urdfcal.target_sensors import point_jacobian

_ROUNDS, _LONGEST_STEP, _DAMPING = 40, 0.5, 1e-9  # of Newton's method; steps in [rad] and [m]
_REACHED = 1e-11  # [m] how near a touch must come to its place
_MOST_DRAWS = 400_000


def _touching(
    setup: SimulatedSetup, session: str, touched: Sequence[tuple[str, str, str]], rng: np.random.Generator, noise: ReadingNoise
) -> Matrix:
    """True joint positions at which each pose's target is where it touches, but for the noise.

    Raises:
        UsageError: such positions are too rare.
    """
    wanted = [_Touch.of(setup, *one, rng.normal(0, 1, 3) * noise.length) for one in touched]
    q, open_, drawn = np.empty((len(wanted), len(setup.robot.chain.inputs))), np.arange(len(wanted)), 0
    while len(open_) and drawn < max(_MOST_DRAWS, 20 * len(wanted)):
        rows = open_[:CHUNK]
        rows = np.resize(rows, max(len(rows), min(CHUNK, 64)))
        found, there = _newton(setup, session, [wanted[row] for row in rows], _random(setup, len(rows), rng))
        q[rows[there]] = found[there]
        open_, drawn = np.setdiff1d(open_, rows[there]), drawn + len(rows)
    if len(open_):
        kind, target, label = touched[open_[0]]
        raise UsageError(
            f"only {len(wanted) - len(open_)} of {len(wanted)} poses within the joints' limits touch what they should; {kind} {label} is "
            f"out of reach of {target}: choose another --seed or fewer --places"
        )
    return q


@dataclass(frozen=True)
class _Touch:
    """Where a target shall be: across `across`, a projection (3, 3), it must come to `point`."""

    target: str
    point: Vector
    across: Matrix

    @staticmethod
    def of(setup: SimulatedSetup, kind: str, target: str, label: str, off: Vector) -> _Touch:
        place = setup.place(f"{kind}:{label}")
        if kind == "socket":
            return _Touch(target, place + off, np.eye(3))
        normal = setup.errors.planes[f"plane:{label}"][:, 0]
        return _Touch(target, normal * (place[2] + off[0]), np.outer(normal, normal))


def _newton(setup: SimulatedSetup, session: str, wanted: Sequence[_Touch], q: Matrix) -> tuple[Matrix, Mask]:
    """Joint positions after Newton's method, kept within their limits, and whether each is where it should be."""
    lower, upper = joint_limits(setup.robot)
    targets = list(dict.fromkeys(touch.target for touch in wanted))
    own, pick = np.array([targets.index(touch.target) for touch in wanted]), np.arange(len(wanted))
    across, points = np.array([touch.across for touch in wanted]), np.array([touch.point for touch in wanted])
    short = np.full((len(wanted), 3), np.inf)
    for _ in range(_ROUNDS):
        seen = setup.motion(q, session)[1]
        p, by_joint = (np.stack([seen[target][part] for target in targets])[own, pick] for part in (0, 2))
        short = (across @ (points - p)[..., None])[..., 0]
        if np.abs(short).max() < _REACHED:
            break
        J = across @ point_jacobian(p) @ by_joint
        step = (J.transpose(0, 2, 1) @ np.linalg.solve(J @ J.transpose(0, 2, 1) + _DAMPING * np.eye(3), short[..., None]))[..., 0]
        q = np.clip(q + step * np.minimum(1.0, _LONGEST_STEP / np.maximum(np.linalg.norm(step, axis=1), _DAMPING))[:, None], lower, upper)
    return q, np.asarray(np.abs(short).max(axis=1) < _REACHED)
