"""Positions of every joint of a robot from those of some: mimic joints follow, the rest stays at neutral."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from urdfcal.base.errors import ShapeMismatch, UsageError
from urdfcal.base.geometry import Matrix, Vector
from urdfcal.robot.chain import leader_of
from urdfcal.robot.robot import Robot
from urdfcal.robot.urdf_tree import UrdfJoint

_FREE = {"continuous": np.pi, "revolute": np.pi, "prismatic": 1.0}  # how far a joint without limits is moved either way, [rad] or [m]
_ENDLESS = 1e3  # [rad] or [m]: limits beyond are none; simulators' files write 1e16
_ROOM = 1e-6  # [rad] or [m]: limits nearer to each other hold a joint


def measured_positions(robot: Robot, q: npt.ArrayLike, what: str) -> Matrix:
    """Positions of the measured joints, (m, inputs), [rad] or [m].

    Args:
        robot: The robot.
        q: What is taken for them.
        what: What they are, for the message.

    Raises:
        ShapeMismatch: they do not fit the robot.
    """
    names = robot.chain.input_names
    expected = f"expected finite (m, {len(names)}), for {', '.join(names)}"
    try:
        found = np.asarray(q, dtype=float)
    except (TypeError, ValueError):
        raise ShapeMismatch(f"{what} are no table of numbers, {expected}") from None
    if found.ndim != 2 or found.shape[1] != len(names) or not np.isfinite(found).all():
        raise ShapeMismatch(f"{what} have shape {found.shape}, {expected}")
    return found


def joint_limits(robot: Robot, measured: Matrix | None = None) -> Matrix:
    """Lower and upper limits of the measured joints, (2, inputs); a joint without gets half a turn, or a metre, either way.

    Args:
        robot: The robot.
        measured: Positions of these joints, (n, inputs), [rad] or [m]; their range stands for limits that leave a joint no room.
    """
    limits = np.array([_span(joint) for joint in robot.chain.inputs]).T
    if measured is None or not len(measured):
        return limits
    return np.where([not has_room(joint) for joint in robot.chain.inputs], [measured.min(axis=0), measured.max(axis=0)], limits)


def _span(joint: UrdfJoint) -> tuple[float, float]:
    """Between which positions a joint is drawn, [rad] or [m]."""
    free = _FREE[joint.type]
    return (-free, free) if joint.upper - joint.lower > _ENDLESS else (joint.lower, joint.upper)


def has_room(joint: UrdfJoint) -> bool:
    """Whether a joint's limits let it move; CAD exporters write limits of 0 and 0."""
    return joint.upper - joint.lower > _ROOM


def without_room(robot: Robot) -> str:
    """`lower and upper limit of j1, j2 are the same` for the measured joints that have no room; the empty string for none."""
    names = [joint.name for joint in robot.chain.inputs if not has_room(joint)]
    return f"lower and upper limit of {', '.join(names)} are the same" if names else ""


def require_room(robot: Robot) -> None:
    """Refuse to draw positions within limits that leave no measured joint any room.

    Raises:
        UsageError: says how to get some.
    """
    if not any(has_room(joint) for joint in robot.chain.inputs):
        raise UsageError(
            f"{robot.description.label}: {without_room(robot)}, which leaves no workspace to draw positions from; "
            "write the joints' real limits, or make turning joints continuous"
        )


def random_positions(robot: Robot, count: int, rng: np.random.Generator) -> Matrix:
    """Positions of the measured joints anywhere within the limits, (count, inputs), [rad] or [m].

    Raises:
        UsageError: the limits leave no room.
    """
    require_room(robot)
    lower, upper = joint_limits(robot)
    return rng.uniform(lower, upper, (count, len(lower)))


class WholeRobot:
    """Configurations of a whole Pinocchio model; what depends on no pose is worked out once."""

    def __init__(self, robot: Robot, joints: Sequence[str]) -> None:
        """Prepare for positions of some joints.

        Args:
            robot: The robot.
            joints: Names, in the order in which positions come; a mimic joint among them says nothing.
        """
        model, column = robot.model, {name: index for index, name in enumerate(joints)}
        self.neutral = pin.neutral(model)
        plain: list[tuple[int, int]] = []
        turning: list[tuple[int, int]] = []
        gains: list[Vector] = []
        shifts: list[float] = []
        self.joints: list[int] = []  # those that move, by index, in the order of the gains
        for joint in (joint for joint in robot.tree.joints.values() if joint.moves and model.existJointName(joint.name)):
            leader, factor, shift = leader_of(robot.tree, joint)
            if leader.name not in column:
                continue
            index = model.getJointId(joint.name)
            (plain if model.nqs[index] == 1 else turning).append((len(gains), model.idx_qs[index]))
            self.joints.append(index)
            gains.append(np.eye(len(joints))[column[leader.name]] * factor)
            shifts.append(shift)
        self.gain, self.shift = np.array(gains).reshape(-1, len(joints)).T, np.array(shifts)
        self.plain, self.turning = _pairs(plain), _pairs(turning)

    def configurations(self, q: Matrix) -> Matrix:
        """Configurations of the whole model.

        Args:
            q: Positions of the joints, (n, joints), [rad] or [m].

        Returns:
            (n, nq); a continuous joint has its cosine and sine.
        """
        whole, positions = np.repeat(self.neutral[None], len(q), axis=0), q @ self.gain + self.shift
        whole[:, self.plain[1]] = positions[:, self.plain[0]]
        if self.turning.size:
            angles = positions[:, self.turning[0]]
            whole[:, self.turning[1]], whole[:, self.turning[1] + 1] = np.cos(angles), np.sin(angles)
        return whole


def whole_configurations(robot: Robot, q: Matrix) -> Matrix:
    """Configurations of the whole Pinocchio model, (n, nq), from positions of the measured joints, (n, inputs), [rad] or [m]."""
    return WholeRobot(robot, robot.chain.input_names).configurations(q)


def random_configurations(robot: Robot, rng: np.random.Generator, count: int) -> Matrix:
    """Random positions of every joint that moves, (n, nq); mimic joints follow their leaders, the rest stays at neutral."""
    drawn = {name: rng.uniform(*_span(joint), count) for name, joint in robot.tree.joints.items() if joint.moves}
    return WholeRobot(robot, list(drawn)).configurations(np.column_stack(list(drawn.values())))


def _pairs(pairs: Sequence[tuple[int, int]]) -> npt.NDArray[np.intp]:
    """Columns and places in a configuration, (2, joints)."""
    return np.array(pairs, dtype=np.intp).reshape(-1, 2).T
