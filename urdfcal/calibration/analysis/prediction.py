"""How sure a fit is of what a user sees: the predicted sigma of the spots, and of a tool relative to the robot's base.

Both are linear propagations of the parameters' covariance,

    Sigma = J P J',    sigma^2 = trace of its position (or rotation, or spot) block,

with J from the same screws as Jac1. A sigma so defined is the root of the expected squared *distance* from the truth, all directions
taken together.

The tool's error is relative to the *base link*: the link on which the first calibrated joint on the tool's own way from the root
hangs. Screen and lasers are instruments, so their placements do not enter, unless the tool is itself mounted behind them (the module
is: its mount counts for it). Mind the gauge: under the error model `auto`, parameters of the first joints that no measurement could
tell from the screen's placement are carried by it, and the last joint's zero by the mount. They have no sigma of their own here;
`tool_accuracy.py` takes them in.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from urdfcal.base.errors import RobotError, ShapeMismatch
from urdfcal.base.geometry import SE3, Array3, Array4, Matrix, Vector, product
from urdfcal.calibration.problem import Problem
from urdfcal.calibration.reach import poses_in_view
from urdfcal.calibration.result import FitResult
from urdfcal.model.error_model import ErrorModel
from urdfcal.model.jacobian import ArmMotion, motion_at
from urdfcal.model.kinematics import ArmKinematics
from urdfcal.robot.robot import Robot
from urdfcal.robot.urdf_tree import UrdfJoint
from urdfcal.sensors.measurements import Measurements, spot_readings
from urdfcal.sensors.spots import beams_at


def predicted_spots(robot: Robot, calibration: FitResult, rng: np.random.Generator) -> SpotAccuracy | None:
    """How far off the spots still are over the workspace, by the fit's covariance; None where no laser was seen."""
    if not calibration.data.has_spots:
        return None
    errors, x = calibration.errors, calibration.x
    q = poses_in_view(robot, errors, x, calibration.data, rng)
    return spot_accuracy(errors, calibration.covariance, x, q if len(q) else calibration.data.q)


def spot_sigma(errors: ErrorModel, covariance: Matrix, x: Vector, q: Matrix) -> Matrix:
    """Predicted error of the spots that come of the parameters' uncertainty alone, without the noise of seeing them.

    Args:
        errors: Names, order and units of the parameters.
        covariance: Of the parameters, (p, p).
        x: Error parameters, (p,), [m] and [rad].
        q: Measured joint positions, (n, inputs), [rad] or [m].

    Returns:
        (n, lasers), [m]: root of the expected squared distance; nan where the beam does not meet the screen.

    Raises:
        ShapeMismatch: covariance, x or q does not fit.
    """
    return spread(spot_jacobians(errors, x, q), covariance)


@dataclass(frozen=True)
class SpotAccuracy:
    """How far off the spots of some poses still are by the parameters' uncertainty alone: quantiles of `spot_sigma` over them.

    Attributes:
        lasers: Laser links.
        poses: At how many of the poses each laser's beam meets the screen, (lasers,).
        median: Of the predicted error of a spot, (lasers,), [m]; nan for a laser that never meets the screen, as below.
        most: What 95 % of the poses stay under, (lasers,), [m].
        worst: Of the worst pose, (lasers,), [m].
    """

    lasers: tuple[str, ...]
    poses: tuple[int, ...]
    median: Vector
    most: Vector
    worst: Vector


def spot_accuracy(errors: ErrorModel, covariance: Matrix, x: Vector, q: Matrix) -> SpotAccuracy:
    """How far off the spots still are at some poses: those that were measured, or `poses_in_view`.

    Args:
        errors: Names, order and units of the parameters.
        covariance: Of the parameters, (p, p).
        x: Error parameters, (p,), [m] and [rad].
        q: Measured joint positions, (n, inputs), [rad] or [m].

    Raises:
        ShapeMismatch: covariance, x or q does not fit.
    """
    sigma = spot_sigma(errors, covariance, x, q)
    own = [column[np.isfinite(column)] for column in sigma.T]
    levels = np.array([np.quantile(column, (0.5, 0.95, 1.0)) if len(column) else np.full(3, np.nan) for column in own])
    return SpotAccuracy(errors.chain.laser_names, tuple(len(column) for column in own), *levels.T)


def spread(jacobian: Array3 | Array4, covariance: Matrix) -> Matrix:
    """Root of the trace of J P J' for a stack of Jacobians (..., k, p), (...)."""
    p = jacobian.shape[-1]
    if covariance.shape != (p, p):
        raise ShapeMismatch(f"the error model has {p} parameters, their covariance has shape {covariance.shape}")
    variance = np.sum((jacobian @ covariance) * jacobian, axis=(-2, -1))
    return np.asarray(np.sqrt(np.maximum(variance, 0.0)))


def spot_jacobians(errors: ErrorModel, x: Vector, q: Matrix) -> Array4:
    """Derivative of every spot by the parameters, (n, lasers, 2, p); nan where a beam does not meet the screen."""
    q = np.asarray(q, dtype=float)
    n, lasers = len(q), errors.chain.laser_names
    seen = Problem(errors, _all_seen(errors, q)).linearise(errors.check(x)).of_poses(n)
    jacobian = seen.jacobian.reshape(n, len(lasers), 2, len(errors.names))
    return np.where(beams_at(errors, x, q).meets[..., None, None], jacobian, np.nan)


def tool_jacobian(robot: Robot, errors: ErrorModel, x: Vector, link: str, q: Matrix, far: bool = False) -> Array3:
    """Motion [v, w] of a link relative to the base link per parameter, in screen axes at the link's origin, up to a common sign.

    Args:
        robot: Nominal robot.
        errors: Names, order and units of the parameters.
        x: Error parameters, (p,), [m] and [rad].
        link: A link that the calibrated joints move.
        q: Measured joint positions, (n, inputs), [rad] or [m].
        far: Take it relative to the other end of the way, on another branch, and not to the base link.

    Returns:
        (n, 6, p); zero for parameters that do not stand between base and link.

    Raises:
        RobotError: no such link, or no calibrated joint moves it.
    """
    way = tool_way(robot, link, far)
    placed, arm = errors.placements(x, errors.sessions[0]), ArmKinematics(robot.chain)
    positions = arm.chain_positions(q)
    motion = motion_at(arm, placed, positions)
    twists = motion.jac1  # at the screen's origin
    points = way.points(motion, errors.corrected_origins(x))
    columns = way.columns(errors)
    jacobian = np.zeros_like(twists)
    v, w = twists[:, :3, columns], twists[:, 3:, columns]
    signs = way.signs(errors, columns)
    jacobian[:, :3, columns] = signs * (v + np.cross(w, points[:, :, None], axis=1))
    jacobian[:, 3:, columns] = signs * w
    return jacobian


def default_tool(robot: Robot) -> str:
    """The module, or where the lasers stand still and the screen is carried, the screen."""
    return robot.rig.tip if _first_calibrated(robot, robot.rig.tip) is not None else robot.rig.base


def default_far(robot: Robot) -> bool:
    """Whether what is measured is one end against another on a different branch, so that this is what there is to know of it."""
    return len(robot.chain.branches()) == 2 and not robot.chain.shoots


def base_link(robot: Robot, link: str, far: bool = False) -> str:
    """The link relative to which the errors of `link` are taken.

    Raises:
        RobotError: no such link, or no calibrated joint moves it.
    """
    return robot.rig.base if far else tool_way(robot, link).joints[0].parent


@dataclass(frozen=True)
class ToolWay:
    """The way from the base link to a tool.

    Attributes:
        joints: URDF joints between them, base first; the first one is calibrated.
        beyond: Those of the other branch, where the way is from its end.
        last: How many joints of the chain are passed, counted from the screen, when the last calibrated joint has been walked; for
            a joint walked backward, before it is.
        forward: Whether the calibrated joints are walked from parent to child.
        behind: The joints behind the last one that is calibrated.
    """

    joints: tuple[UrdfJoint, ...]
    last: int
    forward: bool
    behind: tuple[UrdfJoint, ...]
    beyond: tuple[UrdfJoint, ...] = ()

    def columns(self, errors: ErrorModel) -> list[int]:
        """The parameters that move the tool against the base."""
        passed = {joint.name for joint in (*self.beyond, *self.joints)}
        slots = [slot for slot in errors.slots if slot.kind != "screen" or not slot.before]
        moving = {f"{slot.label}.{name}" for slot in slots if passed.intersection(slot.joints) for name in slot.names}
        return [column for column, name in enumerate(errors.names) if name in moving]

    def signs(self, errors: ErrorModel, columns: Sequence[int]) -> Vector:
        """1 or, where a joint of the way from the base is walked backward among others that are not, -1, for each of these columns."""
        mixed = bool(errors.chain.shoots) and not self.beyond
        backward = {step.joint.name for step in errors.chain.moving if mixed and not step.forward}
        return np.array([-1.0 if errors.names[column].rpartition(".")[0] in backward else 1.0 for column in columns])

    def points(self, motion: ArmMotion, corrected: dict[str, SE3]) -> Matrix:
        """Origins of the tool in screen axes, (n, 3)."""
        behind = product([corrected.get(joint.name, joint.origin) for joint in self.behind]).homogeneous
        if self.forward:
            return motion.points(self.last, behind[:3, 3])
        local = motion.placed.placed.joints[self.last] @ behind
        return motion.points(motion.placed.arm.chain.parents[self.last], local[:3, 3])


def tool_way(robot: Robot, link: str, far: bool = False) -> ToolWay:
    """The way from the base link to a tool, or from the far end of the other branch.

    Raises:
        RobotError: no such link, or no calibrated joint moves it.
    """
    path = robot.tree.path_from_root(robot.tree.require_link(link))
    first = _first_calibrated(robot, link)
    if first is None:
        names = [step.joint.name for step in robot.chain.moving]
        raise RobotError(
            f"none of the calibrated joints ({', '.join(names)}) moves link '{link}'; choose a link that one of them moves",
            robot.tree.label,
        )
    places = {step.joint.name: place for place, step in enumerate(robot.chain.moving)}
    deepest = max(index for index, joint in enumerate(path) if joint.name in places)
    place = places[path[deepest].name]
    forward = robot.chain.moving[place].forward
    beyond = tuple(step.joint for step in robot.chain.steps if not step.forward) if far else ()
    return ToolWay(tuple(path[first:]), place + 1 if forward else place, forward, tuple(path[deepest + 1 :]), beyond)


def _first_calibrated(robot: Robot, link: str) -> int | None:
    """Where the first calibrated joint stands on the way from the root to a link."""
    calibrated = {step.joint.name for step in robot.chain.moving}
    return next((index for index, joint in enumerate(robot.tree.path_from_root(link)) if joint.name in calibrated), None)


def _all_seen(errors: ErrorModel, q: Matrix) -> Measurements:
    """Poses at which every beam counts, wherever it falls."""
    n = len(q)
    return Measurements(
        joints=errors.chain.input_names,
        q=q,
        readings=spot_readings(errors.chain.laser_names, np.zeros((n, len(errors.chain.laser_names), 2))),
        poses=np.arange(n).astype(str),
        sets=np.full(n, "fit"),
        sessions=np.full(n, errors.sessions[0]),
    )
