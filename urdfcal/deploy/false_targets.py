"""False targets: what a controller that keeps its nominal geometry is to be told, so that the real tool comes where it was wanted.

A controller that is told T turns the joints to q with K_nominal(q) = T, and the real tool goes to K_real(q). So the positions are sought
at which the real robot has the tool where it was wanted,

    K_real(q) = T_wanted,    q <- q + J^+ e,    e = [R' (p_wanted - p), log(R' R_wanted)],

from those of the nominal robot, so that the configuration (shoulder, elbow, wrist, turns) stays; what the controller is told is then
q itself, or T_false = K_nominal(q). J^+ is damped (Levenberg and Marquardt), and positions stay within the joint limits: near a singular
configuration, at a limit, or where the tool cannot be turned as it was wanted for want of joints, something is left over, and said.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from urdfcal.base.errors import ShapeMismatch, UsageError
from urdfcal.base.geometry import DEG, MM, Array3, Mask, Matrix, Vector
from urdfcal.base.rotations import NOT_RIGID, rigid, rotation_vectors
from urdfcal.calibration.analysis.compensation import Compensation
from urdfcal.robot.robot import Robot
from urdfcal.robot.way import Way

Placements = Callable[[Matrix], Array3]

SWEEPS = 60
LEFT_MM, LEFT_DEG = 1e-3, 1e-4  # more than that left over is said
FAR = 10 * DEG  # a joint that is to turn farther than that to make up for millimetres is near a singular configuration
_DONE = 1e-10  # [m] and [rad]
_ARM = 0.3  # [m] a turn of the tool counts as a shift at this distance
_DAMPING = 1e-4  # of the step, in units of _ARM: singular values far below it are not used
_STEP = 0.3  # [rad] or [m] a sweep
_SEEDS, _ROUNDS = 24, 10  # positions that a placement is sought from at once, and how often, where its configuration is named
_COARSE = 1e-7  # [m] and [rad]: so near, a solution is found


@dataclass(frozen=True, eq=False)
class Reached:
    """Positions at which a robot has its tool where it was wanted, as near as can be.

    Attributes:
        q: Positions, (n, k), [rad] or [m].
        left_mm: What is left over of the tool's place, (n,).
        left_deg: And of its orientation, (n,).
        moved: How far the positions are from those that they began at, (n, k).
        at_limit: Which joints stand at a limit, (n, k).
    """

    q: Matrix
    left_mm: Vector
    left_deg: Vector
    moved: Matrix
    at_limit: Mask

    @property
    def whole(self) -> Mask:
        """Where nothing is left over, (n,)."""
        return (self.left_mm <= LEFT_MM) & (self.left_deg <= LEFT_DEG)


@dataclass(frozen=True, eq=False, repr=False)
class FalseTargets:
    """What a controller is to be told.

    Attributes:
        wanted: Where the tool was wanted in the base, (n, 4, 4), [m].
        placements: Where the controller is to be told to bring it, (n, 4, 4), [m].
        nominal: Positions that the controller would have gone to, (n, k), [rad] or [m].
        reached: Positions at which the real robot has the tool there.
        before_mm, before_deg: How far off the real tool is at the nominal positions, (n,).
    """

    wanted: Array3
    placements: Array3
    nominal: Matrix
    reached: Reached
    before_mm: Vector
    before_deg: Vector

    def __repr__(self) -> str:
        if not len(self.before_mm):
            return "<FalseTargets: none>"
        return (
            f"<FalseTargets: {len(self.before_mm)}, of which {int(self.reached.whole.sum())} are reached; the real tool is "
            f"{self.before_mm.mean():.3g} mm off on average at the wanted ones, {self.reached.left_mm.mean():.3g} mm at these>"
        )


def false_joints(nominal: Way, real: Placements, q: Matrix) -> FalseTargets:
    """What to tell a controller in place of positions, so that the real tool comes where the nominal robot has it at these.

    Args:
        nominal: As the controller has the robot.
        real: Where the real robot has the tool at positions of the same joints, (n, k) -> (n, 4, 4).
        q: Wanted positions, (n, k), [rad] or [m].
    """
    return _false(nominal, real, nominal.placements(q), q)


def false_placements(nominal: Way, real: Placements, wanted: Array3, q: Matrix) -> FalseTargets:
    """What to tell a controller in place of placements of the tool.

    Args:
        nominal: As the controller has the robot.
        real: Where the real robot has the tool at positions of the same joints, (n, k) -> (n, 4, 4).
        wanted: Placements of the tool in the base, (n, 4, 4), [m].
        q: Positions at which the nominal robot has it there, (n, k), [rad] or [m]; `solved` finds them.
    """
    return _false(nominal, real, wanted, q)


def asked_for(
    nominal: Robot, real: Robot, wanted: Array3 | Matrix, near: npt.ArrayLike | None, tool: str, base: str | None = None
) -> FalseTargets:
    """False targets for positions (n, k), or for placements (n, 4, 4) with positions near them, (k,) or (n, k).

    Raises:
        RobotError: no such link, or no joint moves the one in the other.
        ShapeMismatch: the numbers are neither positions nor placements.
        UsageError: one is not a number, or no placement; nothing says in which configuration placements are reached, or the nominal
            robot does not reach them.
    """
    way, there = Way.between(nominal, tool, base), Way.between(real, tool, base).placements
    if wanted.ndim and len(wanted):
        _refuse_first(~np.isfinite(wanted.reshape(len(wanted), -1)).all(axis=1), "holds what is no finite number; leave it out")
    if wanted.ndim == 2 and wanted.shape[1] == len(way.names):
        return false_joints(way, there, wanted)
    if wanted.ndim != 3 or wanted.shape[1:] != (4, 4):
        raise ShapeMismatch(
            f"wanted: expected (n, {len(way.names)}) positions of {', '.join(way.names)}, or (n, 4, 4), found {wanted.shape}"
        )
    _refuse_first(~rigid(wanted), NOT_RIGID)
    if near is None:
        raise UsageError("placements are reached in several configurations; near names positions of the joints, (k,) or (n, k)")
    reached = solved(way, wanted, np.broadcast_to(np.asarray(near, dtype=float), (len(wanted), len(way.names))))
    if not reached.whole.all():
        row = int(np.argmin(reached.whole))
        raise UsageError(f"the nominal robot does not reach placement {row}: {reached.left_mm[row]:.3f} mm are left over")
    return false_placements(way, there, wanted, reached.q)


def _refuse_first(bad: Any, why: str) -> None:
    if bad.any():
        raise UsageError(f"wanted: row {int(bad.argmax())} {why}")


def _false(nominal: Way, real: Placements, wanted: Array3, q: Matrix) -> FalseTargets:
    before = _errors(real(q), wanted)
    reached = reach(nominal, real, wanted, q)
    return FalseTargets(
        wanted,
        nominal.placements(reached.q),
        q,
        reached,
        np.linalg.norm(before[:, :3], axis=1) / MM,
        np.linalg.norm(before[:, 3:], axis=1) / DEG,
    )


def reach(way: Way, real: Placements, wanted: Array3, q: Matrix) -> Reached:
    """Positions at which `real` has the tool where it is wanted, from positions near by.

    Args:
        way: The joints, with a geometry that is nearly the real one: its Jacobian leads.
        real: Placements of the tool at positions, (n, k) -> (n, 4, 4).
        wanted: Placements, (n, 4, 4), [m].
        q: Where to begin, (n, k), [rad] or [m].
    """
    lower, upper = way.limits
    lower, upper = np.minimum(lower, q.min(axis=0, initial=np.inf)), np.maximum(upper, q.max(axis=0, initial=-np.inf))
    best, weights = q.copy(), np.array([1.0] * 3 + [_ARM] * 3)
    left = _errors(real(best), wanted)
    damping = np.full(len(q), _DAMPING)
    for _ in range(SWEEPS):
        open_ = np.flatnonzero((np.abs(left).max(axis=1) > _DONE) & (damping < 1.0))
        if not len(open_):
            break
        _, J = way.jacobians(best[open_])
        tried = np.clip(
            best[open_] + _step(J * weights[:, None], left[open_] * weights, damping[open_], best[open_], lower, upper), lower, upper
        )
        now = _errors(real(tried), wanted[open_])
        nearer = np.linalg.norm(now * weights, axis=1) < np.linalg.norm(left[open_] * weights, axis=1)
        best[open_[nearer]], left[open_[nearer]] = tried[nearer], now[nearer]
        damping[open_] = np.where(nearer, np.maximum(damping[open_] / 4, _DAMPING), damping[open_] * 8)
    at_limit = (best <= lower + _COARSE) | (best >= upper - _COARSE)
    return Reached(best, np.linalg.norm(left[:, :3], axis=1) / MM, np.linalg.norm(left[:, 3:], axis=1) / DEG, best - q, at_limit)


def _step(J: Array3, e: Matrix, damping: Vector, q: Matrix, lower: Vector, upper: Vector) -> Matrix:
    """The damped step; joints that stand at a limit and would be driven over it are held."""
    step = _damped(J, e, damping)
    pushed = ((q <= lower) & (step < 0)) | ((q >= upper) & (step > 0))
    if pushed.any():
        step = _damped(np.where(pushed[:, None, :], 0.0, J), e, damping)
    size = np.abs(step).max(axis=1, keepdims=True)
    return np.asarray(step * np.minimum(1.0, _STEP / np.maximum(size, _STEP)))


def _damped(J: Array3, e: Matrix, damping: Vector) -> Matrix:
    """J' (J J' + (damping * arm)^2)^-1 e for every target."""
    A = J @ J.transpose(0, 2, 1) + (damping * _ARM)[:, None, None] ** 2 * np.eye(6)
    return np.asarray(np.einsum("nij,ni->nj", J, np.linalg.solve(A, e[:, :, None])[:, :, 0]))


def _errors(placed: Array3, wanted: Array3) -> Matrix:
    """What is left to go, in the tool's own axes, (n, 6): shift [m], rotation vector [rad]."""
    R = placed[:, :3, :3].transpose(0, 2, 1)
    return np.hstack([np.einsum("nij,nj->ni", R, wanted[:, :3, 3] - placed[:, :3, 3]), rotation_vectors(R @ wanted[:, :3, :3])])


def solved(way: Way, wanted: Array3, near: Matrix, fits: Callable[[Matrix], Mask] | None = None) -> Reached:
    """Positions at which the nominal robot has its tool where it is wanted, each in the configuration of positions near it.

    Targets that are not reached from there are tried from others within the limits, and the nearest of those that reach them counts.

    Args:
        way: The joints.
        wanted: Placements, (n, 4, 4), [m].
        near: Positions, (n, k), [rad] or [m].
        fits: Whether positions (n, k) are in a configuration that was named, (n,); others do not count.
    """
    found = reach(way, way.placements, wanted, near)
    rng = np.random.default_rng(0)
    for row in np.flatnonzero(~(found.whole & (True if fits is None else fits(found.q)))):
        tries, good = _tried(way, wanted[row], fits, rng)
        if not good.any():
            continue
        far = np.abs(tries.q - near[row]).max(axis=1)
        chosen = int(np.argmin(np.where(good, far, np.inf)))
        for name in ("q", "left_mm", "left_deg", "at_limit"):
            getattr(found, name)[row] = getattr(tries, name)[chosen]
        found.moved[row] = found.q[row] - near[row]
    return found


def _tried(way: Way, wanted: Matrix, fits: Callable[[Matrix], Mask] | None, rng: np.random.Generator) -> tuple[Reached, Mask]:
    """One placement from positions all over the limits, and which tries count: until one does, or none reaches it at all."""
    lower, upper = np.maximum(way.limits[0], -np.pi), np.minimum(way.limits[1], np.pi)
    for _ in range(_ROUNDS):
        seeds = rng.uniform(lower, upper, (_SEEDS, len(lower)))
        tries = reach(way, way.placements, np.repeat(wanted[None], _SEEDS, axis=0), seeds)
        good = tries.whole if fits is None else tries.whole & fits(tries.q)
        if good.any() or not tries.whole.any():
            break
    return tries, good


def spoken(way: Way, targets: FalseTargets) -> list[str]:
    """What is to be said of each target; the empty string where the real tool comes where it was wanted."""
    reached = targets.reached
    return [
        _spoken(way.names, reached.left_mm[row], reached.left_deg[row], reached.at_limit[row], reached.moved[row], bool(reached.whole[row]))
        for row in range(len(reached.q))
    ]


def _spoken(names: tuple[str, ...], mm: float, deg: float, at_limit: Vector, moved: Vector, whole: bool) -> str:
    far = [f"{name} by {abs(by) / DEG:.1f} deg" for name, by in zip(names, moved, strict=True) if abs(by) > FAR]
    if whole:
        return f"near a singular configuration: would turn {', '.join(far)}" if far else ""
    stopped = [name for name, at in zip(names, at_limit, strict=True) if at]
    why = f"{', '.join(stopped)} at the limit" if stopped else "near a singular configuration, or out of reach"
    return f"{why}: {mm:.3f} mm and {deg:.4f} deg are left over"


def sagging(compensation: Compensation, way: Way) -> Placements:
    """Where an arm that gives way has its tool.

    Args:
        compensation: How it gives way; of the same calibrated robot as the way.
        way: From the base to the tool.
    """
    order = [way.names.index(name) for name in compensation.joints]

    def placements(q: Matrix) -> Array3:
        root, tool = (compensation.placement(q[:, order], link) for link in (way.base, way.tool))
        return np.asarray(np.linalg.solve(root, tool))

    return placements
