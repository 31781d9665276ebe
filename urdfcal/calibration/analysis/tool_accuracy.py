"""How far off a link is before and after calibration: in the base frame, and up to a constant placement of base and tool.

With A (3n, p) the motion of the link's origin in the base frame at n configurations per unit of every error of the robot (those that
the fit leaves out included, see `full_posterior.py`), the calibrated robot is off by A (z - x) and the nominal one by A z, where
z ~ N(mean, P) is what the data leave. At each configuration the expected squared distance is

    after   tr(A_i P A_i') + |A_i (mean - x)|^2,        before   tr(A_i P A_i') + |A_i mean|^2

A constant misplacement of the base moves the link by G_b = [I, -[p_i]x], one of the tool by G_t = R_i. What no constant explains is
the same with Q A, Q = I - G G^+, and what the constants may be is G^+ A. A measuring frame, a screen or a target on the link whose
places are estimated say nothing of the constants, so that they stay as uncertain as the robot's first and last placements are.

Whether calibration makes the link better at all needs no ratio of two expectations. The mean squared errors differ by

    |A z|^2 - |A (z - x)|^2 = 2 x' A'A z - x' A'A x,

which is linear in z, so the probability that the calibrated robot is the better one is that of a Gaussian above zero.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from urdfcal.base.geometry import MM, Array3, Matrix, Vector
from urdfcal.base.rotations import skew
from urdfcal.calibration.analysis.full_posterior import FullPosterior
from urdfcal.calibration.analysis.more_poses import FURTHER
from urdfcal.calibration.analysis.prediction import base_link, spread, tool_jacobian
from urdfcal.model.error_model import ErrorModel
from urdfcal.robot.configurations import joint_limits, whole_configurations
from urdfcal.robot.corrections import OriginCorrection, corrected_model
from urdfcal.robot.robot import Robot

_CONFIGURATIONS = 200
_SAME = 1e-6  # share of the largest constant motion under which two constants are one


@dataclass(frozen=True)
class Spread:
    """Quantiles over the workspace of a predicted error, [m].

    Attributes:
        median, p95, worst: Of the configurations.
        rms: Root mean square over them.
    """

    median: float
    p95: float
    worst: float
    rms: float

    @staticmethod
    def of(errors: Vector) -> Spread:
        """Of the errors at some configurations, (n,), [m]."""
        median, most, worst = np.quantile(errors, (0.5, 0.95, 1.0)).tolist() if len(errors) else (0.0, 0.0, 0.0)
        return Spread(median, most, worst, float(np.sqrt(np.mean(errors**2))) if len(errors) else 0.0)

    def entry(self) -> dict[str, float]:
        """For machines, in mm."""
        return {"median": self.median / MM, "p95": self.p95 / MM, "worst": self.worst / MM}


@dataclass(frozen=True)
class Gain:
    """A predicted error before and after calibration.

    Attributes:
        before: With the nominal robot.
        after: With the calibrated one.
        better: Probability that the mean squared error is smaller after calibration.
    """

    before: Spread
    after: Spread
    better: float

    @staticmethod
    def of(A: Array3, posterior: FullPosterior) -> Gain:
        """Of anything that moves by A (n, k, p) per unit of the errors."""
        before, after = (np.hypot(spread(A, posterior.P), np.linalg.norm(A @ off, axis=-1)) for off in _offsets(posterior))
        if posterior.lacking is not None:
            after = np.hypot(after, posterior.lacking.beside(Spread.of(after).rms))
        return Gain(Spread.of(before), Spread.of(after), better(A, posterior))

    @property
    def left(self) -> float:
        """Share of the nominal robot's error that calibration leaves."""
        return self.after.rms / self.before.rms if self.before.rms else 1.0


@dataclass(frozen=True, eq=False)
class ToolAccuracy:
    """Predicted error of a link over random configurations within the joint limits.

    Attributes:
        link: The link.
        base: The link relative to which it is taken: the one on which the first calibrated joint hangs.
        in_base: Of the link itself.
        up_to_constant: What is left of it when a constant placement of the base and one of the tool on the link are taken out.
        turning: The same of the link's orientation, up to a constant turn of base and tool, [rad].
        base_shift, base_turn: What the constant of the base may be: standard deviations of its distance [m] and angle [rad].
        tool_shift: The same of the constant shift of the tool, [m].
        posterior: What the data leave of every error.
        apart: Motion of the link's origin per unit of every error, without what constants explain, (n, 3, p).
    """

    link: str
    base: str
    in_base: Gain
    up_to_constant: Gain
    turning: Gain
    base_shift: float
    base_turn: float
    tool_shift: float
    posterior: FullPosterior
    apart: Array3

    def entry(self) -> dict[str, Any]:
        """For machines."""
        return {
            "link": self.link,
            "base": self.base,
            "up_to_constant_mm": self.up_to_constant.after.entry(),
            "in_base_mm": self.in_base.after.entry(),
            "constant": {"base_mm": self.base_shift / MM, "base_mrad": self.base_turn * 1e3, "tool_mm": self.tool_shift / MM},
            "nominal_up_to_constant_mm": self.up_to_constant.before.entry(),
            "nominal_in_base_mm": self.in_base.before.entry(),
            "better_than_nominal": self.in_base.better,
        }

    def poses_for(self, share: float, poses: int) -> int | None:
        """How many poses of the same kind bring the error up to constants under a share of the nominal robot's; None if none do."""
        for further in FURTHER:
            left = spread(self.apart, self.posterior.with_further(further))
            if np.sqrt(np.mean(left**2)) < share * self.up_to_constant.before.rms:
                return poses + further
        return None


def tool_accuracy(robot: Robot, posterior: FullPosterior, link: str, rng: np.random.Generator, far: bool = False) -> ToolAccuracy:
    """Predict how far off a link is before and after calibration.

    Args:
        robot: Nominal robot, as it was measured.
        posterior: What the data leave of its errors.
        link: A link that calibrated joints move.
        rng: For the configurations.
        far: Take it relative to the other end of the way, on another branch.

    Raises:
        RobotError: no such link, or no calibrated joint moves it.
    """
    moved = _moved(robot, posterior.errors, posterior.x, link, posterior.q, rng, far)
    constant = moved.constant
    return ToolAccuracy(
        link=link,
        base=base_link(robot, link, far),
        in_base=Gain.of(moved.whole, posterior),
        up_to_constant=Gain.of(moved.apart, posterior),
        turning=Gain.of(moved.turned_apart, posterior),
        base_shift=_size(constant[:3], posterior),
        base_turn=_size(constant[3:6], posterior),
        tool_shift=_size(constant[6:], posterior),
        posterior=posterior,
        apart=moved.apart,
    )


def motion_up_to_constants(
    robot: Robot, errors: ErrorModel, x: Vector, link: str, measured: Matrix, rng: np.random.Generator, far: bool = False
) -> Array3:
    """Motion of a link's origin per unit of every error at random configurations, without what constants explain, (n, 3, p).

    Raises:
        RobotError: no such link, or no calibrated joint moves it.
    """
    return _moved(robot, errors, x, link, measured, rng, far).apart


@dataclass(frozen=True, eq=False)
class _Moved:
    """Motion of a link per unit of every error, whole and without what constants explain (n, 3, p), and the constants (9, p).

    `turned_apart` is its rotation without what constant turns explain.
    """

    whole: Array3
    apart: Array3
    constant: Matrix
    turned_apart: Array3


def _moved(robot: Robot, errors: ErrorModel, x: Vector, link: str, measured: Matrix, rng: np.random.Generator, far: bool) -> _Moved:
    base, (lower, upper) = base_link(robot, link, far), joint_limits(robot, measured)
    q = rng.uniform(lower, upper, (_CONFIGURATIONS, len(lower)))
    turned, placed, axes = _places(_corrected(robot, errors, x), robot, base, link, q)
    jacobian = tool_jacobian(robot, errors, x, link, q, far)
    still = np.broadcast_to(np.eye(3), axes.shape)
    whole, turning = turned @ jacobian[:, :3], turned @ jacobian[:, 3:]
    apart, constant = without_constants(whole, np.concatenate([still, -skew(placed), axes], axis=2))
    return _Moved(whole, apart, constant, without_constants(turning, np.concatenate([still, axes], axis=2))[0])


def without_constants(A: Array3, G: Array3) -> tuple[Array3, Matrix]:
    """Motion A (n, 3, p) without what constants that move by G (n, 3, k) explain of it, and what those constants are (k, p)."""
    constant = np.linalg.pinv(G.reshape(-1, G.shape[2]), rcond=_SAME) @ A.reshape(-1, A.shape[2])
    return A - G @ constant, constant


def _size(rows: Matrix, posterior: FullPosterior) -> float:
    """Root of the expected square of what moves by rows (3, p), calibrated."""
    return float(np.hypot(spread(rows, posterior.P), np.linalg.norm(rows @ (posterior.mean - posterior.x))))


def better(A: Array3, posterior: FullPosterior) -> float:
    """Probability that what moves by A (n, k, p) is nearer to the truth after calibration, in the mean square; 0.5 where nothing moves."""
    x = posterior.x
    pull = np.einsum("nkp,nk->p", A, A @ x)  # A'A x
    surplus, sigma = float(pull @ (2 * posterior.mean - x)), 2 * math.sqrt(max(float(pull @ posterior.P @ pull), 0.0))
    return 0.5 * (1 + math.erf(surplus / sigma / math.sqrt(2))) if sigma else 0.5 + 0.5 * float(np.sign(surplus))


def _offsets(posterior: FullPosterior) -> tuple[Vector, Vector]:
    """How far the nominal and the calibrated robot are expected to be off, (p,) each."""
    return posterior.mean, posterior.mean - posterior.x


def _corrected(robot: Robot, errors: ErrorModel, x: Vector) -> Any:
    """The whole robot's model with the errors x."""
    joints, origins = robot.tree.joints, errors.corrected_origins(x)
    return corrected_model(
        robot.model, {name: OriginCorrection(joints[name].origin, own, joints[name].moves) for name, own in origins.items()}
    )


def _places(model: Any, robot: Robot, base: str, link: str, q: Matrix) -> tuple[Array3, Matrix, Array3]:
    """Axes of the chain's own base in the base link (n, 3, 3), origin (n, 3) and axes (n, 3, 3) of the link in it."""
    data = model.createData()
    root, own, tool = (model.getFrameId(name, pin.BODY) for name in (base, robot.rig.base, link))
    turned, placed, axes = np.empty((len(q), 3, 3)), np.empty((len(q), 3)), np.empty((len(q), 3, 3))
    for pose, configuration in enumerate(whole_configurations(robot, q)):
        pin.framesForwardKinematics(model, data, configuration)
        turned[pose] = data.oMf[root].rotation.T @ data.oMf[own].rotation
        T_base_link = data.oMf[root].actInv(data.oMf[tool])
        placed[pose], axes[pose] = T_base_link.translation, T_base_link.rotation
    return turned, placed, axes
