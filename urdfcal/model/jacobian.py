"""Jac1: how the frames of a chain move against the screen with every error parameter, equations (5) and (6).

Forward kinematics is Pinocchio's, one call a pose; what follows is algebra over all poses at once. A parameter moves the arm along
a screw that is constant in the frame of the joint before it, so its twist in screen axes, taken at the screen's origin, is

    w = R_j w_k,    v = R_j v_k + p_j x w

with (R_j, p_j) the placement of that joint and (v_k, w_k) the constant screw: the same columns that Pinocchio's frame kinematic
regressor has, times the basis of the error model (the tests compare the two). At the screen's origin the twist is the same for
everything that a parameter moves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pinocchio as pin

from urdfcal.base.errors import ShapeMismatch
from urdfcal.base.geometry import SE3, Array3, Array4, Matrix, Vector
from urdfcal.model.error_model import ErrorModel, Placements
from urdfcal.model.softness import Yielding
from urdfcal.robot.chain import Bend, Chain

CHUNK = 1024  # poses worked on at once, so that the temporaries stay in the processor's cache


@dataclass(frozen=True)
class ArmMotion:
    """Where the frames of a chain are at each pose, and how they move; all in the axes of its base (the screen), at its origin.

    Attributes:
        frames: The chain's frames, [R | p], (frames, n, 3, 4).
        jac1: Twist [v, w] of what lies behind each parameter, per unit of it, (n, 6, p).
        axis_twists: The same of each moving joint, (n, 6, moving); no columns where they were not asked for.
    """

    frames: Array4
    jac1: Array3
    axis_twists: Array3


class ArmKinematics:
    """Pinocchio's forward kinematics of a chain for many poses; holds a model of its own and never the caller's."""

    def __init__(self, chain: Chain, bends: Sequence[Bend] = ()) -> None:
        self.chain, self.bends = chain, tuple(bends)
        self.model, self.layout = chain.new_model(self.bends)
        self.data = self.model.createData()
        self.joints = self.model.njoints
        self.place([pin.SE3.Identity()] * len(self.layout.first))
        self._last: tuple[Matrix, Matrix, Array3] | None = None  # placements, positions, frames

    @cached_property
    def axis_screws(self) -> Matrix:
        """Each moving joint's own motion as a screw in its own frame, (6, moving)."""
        columns = np.zeros((6, len(self.chain.moving)))
        for column, step in enumerate(self.chain.moving):
            columns[0 if step.joint.prismatic else 3 :, column][:3] = step.joint.axis
        return columns

    def chain_positions(self, q: Matrix) -> Matrix:
        """Positions of the moving joints from those that were measured: mimic joints, and joints that carry the screen.

        Raises:
            ShapeMismatch: q has not one column a measured joint.
        """
        q = np.asarray(q, dtype=float)
        if q.ndim != 2 or q.shape[1] != len(self.chain.inputs):
            raise ShapeMismatch(f"expected joint positions of shape (poses, {len(self.chain.inputs)}), found {q.shape}")
        return q @ self.chain.coupling + self.chain.offset

    def place(self, placements: list[SE3]) -> None:
        """Put the moving joints where the error model has them."""
        self.placements = np.array([placement.homogeneous for placement in placements])
        for joint, placement in zip(self.layout.first, placements, strict=True):
            self.model.jointPlacements[joint] = placement

    def bodies(self, frames: Array3) -> Array3:
        """Of the frames of all joints, those that the bodies of the way follow: the screen's, and the last of each moving joint."""
        if not self.bends:
            return frames
        n = frames.shape[1]
        return np.ascontiguousarray(frames.reshape(3, n, -1, 4)[:, :, [0, *self.layout.last]]).reshape(3, n, -1)

    def frames(self, positions: Matrix) -> Array3:
        """Frames of all joints on the screen, (3, n, 4 joints): columns x, y, z, p of the screen, then of each joint.

        What was asked last is known: where the joints are taken for right, sweep after sweep asks the same.
        """
        last = self._last
        if last is None or not np.array_equal(last[0], self.placements) or not np.array_equal(last[1], positions):
            self._last = last = self.placements, positions.copy(), self._frames(positions)
        return last[2]

    def _frames(self, positions: Matrix) -> Array3:
        columns = np.empty((len(positions), self.joints, 4, 3))
        view, model, data = self._data_view, self.model, self.data
        for pose, q in zip(columns, positions, strict=True):
            pin.forwardKinematics(model, data, q)
            pose[:] = view
        return np.ascontiguousarray(columns.transpose(3, 0, 1, 2)).reshape(3, len(positions), 4 * self.joints)

    @cached_property
    def _data_view(self) -> Array3:
        """The placements in `data.oMi` without a copy, (joints, 4, 3).

        Each lies in memory as a column-major 3 x 4 matrix behind the one before it; checked against Pinocchio's own accessors.
        """
        pin.forwardKinematics(self.model, self.data, np.linspace(0.1, 0.9, self.model.nq))
        self.data.oMi[0] = pin.SE3.Identity()
        start = self.data.oMi[0].rotation
        view = np.lib.stride_tricks.as_strided(start, (self.joints, 4, 3), (96, 24, 8), writeable=False)
        expected = [np.vstack([frame.rotation.T, frame.translation]) for frame in self.data.oMi]
        if not np.array_equal(view, expected):
            raise RuntimeError("this build of Pinocchio keeps data.oMi in another layout; please report it with the output of `pip list`")
        return view


def arm_motion(arm: ArmKinematics, errors: ErrorModel, q: Matrix, x: Vector, session: str = "", joints: bool = False) -> ArmMotion:
    """Differentiate the poses of the chain's frames with respect to the error parameters (Jac1, equation 6).

    Args:
        arm: Kinematics of the chain that the error model lies over.
        errors: Names, order and units of the parameters.
        q: Measured joint positions, (n, inputs), [rad] or [m].
        x: Error parameters, (p,), [m] and [rad] in the order of `errors.names`.
        session: Whose screen placement to use.
        joints: Also differentiate by the moving joints.

    Raises:
        ShapeMismatch: q or x does not fit this chain and error model.
    """
    placed = errors.placements(x, session)
    return motion_at(arm, placed, arm.chain_positions(q), joints)


def motion_at(
    arm: ArmKinematics, placed: Placements, positions: Matrix, joints: bool = False, yielding: Yielding | None = None
) -> ArmMotion:
    """Frames and twists at chain positions (n, moving), with the chain's constants given; joint twists on request.

    Args:
        arm: Kinematics of the chain; with bends where joints yield about axes across their own.
        placed: The chain's constants.
        positions: Of the moving joints, (n, moving).
        joints: Also give the twists by the moving joints.
        yielding: How joints give way at these poses.
    """
    arm.place(placed.joints)
    every = arm.frames(positions if yielding is None else _given_way(arm, positions, yielding))
    frames = arm.bodies(every)
    jac1 = _twists(frames, placed.anchors, placed.screws).transpose(1, 0, 2)
    axis_twists = np.empty((len(positions), 6, 0))
    if joints or yielding is not None:
        axis_twists = _twists(every, np.array(arm.layout.motion), arm.axis_screws).transpose(1, 0, 2)
    if yielding is not None and placed.screws.shape[1]:
        jac1[:, :, yielding.columns] = _yielding_twists(arm, every, axis_twists, yielding)
    return ArmMotion(
        frames=_placed_frames(arm.chain, frames, placed.frames),
        jac1=jac1,
        axis_twists=axis_twists if joints else axis_twists[:, :, :0],
    )


def _given_way(arm: ArmKinematics, positions: Matrix, yielding: Yielding) -> Matrix:
    """Positions of all joints of the arm's model, bends included, (n, joints - 1)."""
    signs = _signs(arm)
    every = np.zeros((len(positions), arm.joints - 1))
    every[:, np.array(arm.layout.motion) - 1] = positions
    for angle, joint, bend in zip((yielding.basis * yielding.x).T, yielding.joints, yielding.bends, strict=True):
        own = arm.layout.motion[joint] if bend < 0 else arm.layout.bends[bend]
        every[:, own - 1] += signs[joint] * angle
    return every


def _yielding_twists(arm: ArmKinematics, every: Array3, axis_twists: Array3, yielding: Yielding) -> Array3:
    """Twists of all that lies behind a joint, per unit of what it yields by, (n, 6, terms)."""
    screws = np.zeros((6, len(arm.bends)))
    for column, bend in enumerate(arm.bends):
        screws[3:, column] = bend.axis
    bent = _twists(every, np.array(arm.layout.bends, dtype=int), screws).transpose(1, 0, 2)
    signs = _signs(arm)
    free = len(yielding.columns)  # terms that are held come behind those that are estimated
    columns = [
        signs[joint] * (axis_twists[:, :, joint] if bend < 0 else bent[:, :, bend])
        for joint, bend in zip(yielding.joints[:free], yielding.bends[:free], strict=True)
    ]
    return np.stack(columns, axis=2) * yielding.basis[:, None, :free] if columns else np.empty((*axis_twists.shape[:2], 0))


def _signs(arm: ArmKinematics) -> list[float]:
    return [1.0 if step.forward else -1.0 for step in arm.chain.moving]


def _placed_frames(chain: Chain, frames: Array3, local: list[SE3]) -> Array4:
    """The chain's frames [R | p], (frames, n, 3, 4), from those of the joints."""
    placed = np.empty((len(local), frames.shape[1], 3, 4))
    for own, frame, placement in zip(placed, chain.frames, local, strict=True):
        body = frames[:, :, 4 * frame.depth : 4 * frame.depth + 4]
        own[:] = (body @ placement.homogeneous).transpose(1, 0, 2)
    return placed


def _twists(frames: Array3, anchors: Vector, screws: Matrix) -> Array3:
    """Twists [R v + p x R w, R w] of constant screws in the frames that they are anchored to, (6, n, columns)."""
    _, n, width = frames.shape
    flat, pick = frames.reshape(3 * n, width), np.arange(screws.shape[1])

    def turned(vectors: Matrix) -> Array3:
        basis = np.zeros((width // 4, 4, len(pick)))
        basis[anchors, :3, pick] = vectors.T
        return (flat @ basis.reshape(width, len(pick))).reshape(3, n, len(pick))

    twists = np.empty((6, n, len(pick)))
    twists[:3], w, p = turned(screws[:3]), turned(screws[3:]), frames[:, :, 4 * np.asarray(anchors) + 3]
    for axis, (i, j) in enumerate(((1, 2), (2, 0), (0, 1))):
        twists[axis] += p[i] * w[j]
        twists[axis] -= p[j] * w[i]
    twists[3:] = w
    return twists
