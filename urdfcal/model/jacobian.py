"""Jac1: how the frames of a chain move against the screen with every error parameter, equations (5) and (6).

A parameter moves the arm along a screw that is constant in the frame of the joint before it, so its twist in screen axes, taken at the
screen's origin, is Ad(T_j) (v_k, w_k) with T_j the placement of that joint: the same columns that Pinocchio's frame kinematic regressor
has, times the basis of the error model (the tests compare the two). At the screen's origin the twist is the same for everything that a
parameter moves.

Few numbers are read of many columns. So it is not the columns that are brought to what is read, but the derivative g of what is read by
a twist is brought from joint to joint on its way out, as a wrench would be, and meets each screw in the frame where that is constant:

    g_0 = g,    g_j = Ad(T_j-1,j)' g_j-1,    dh / dx_k = g_j . (v_k, w_k)

On the way it goes in pairs, by v_x and w_x, v_y and w_y, v_z and w_z, so that a turn about z is one of the first two pairs.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from urdfcal.base.geometry import Array3, Array4, Matrix, Vector
from urdfcal.model.error_model import ErrorModel
from urdfcal.model.kinematics import ArmKinematics, PlacedArm, Posture, inverse_actions, turn
from urdfcal.model.softness import Yielding
from urdfcal.model.walk import Placements

CHUNK = 2048  # poses worked on at once, so that the temporaries stay in the processor's cache


@dataclass(frozen=True, eq=False)
class ArmMotion:
    """Where the frames of a chain are at each pose, and how they move; all in the axes of its base (the screen), at its origin.

    Attributes:
        placed: The arm with its constants.
        posture: Where its elements are.
        yielding: How joints give way; None if they do not.
    """

    placed: PlacedArm
    posture: Posture
    yielding: Yielding | None = None

    @cached_property
    def _bodies(self) -> Array4:
        return self.posture.frames(self.placed)

    @cached_property
    def frames(self) -> Array4:
        """The chain's frames, [R | p], (frames, n, 3, 4)."""
        arm, bodies = self.placed.arm, self._bodies
        n = bodies.shape[-1]
        frames = np.empty((len(arm.chain.frames), n, 3, 4))
        for own, frame, local in zip(frames, arm.chain.frames, self.placed.locals, strict=True):
            own[:] = local[:3] if frame.depth == 0 else _from(bodies[arm.last[frame.depth] + 1], local)
        return frames

    def points(self, depth: int, local: Vector) -> Matrix:
        """Where a point (3,) of the frame behind a moving joint is, (n, 3), [m]; of the screen at depth 0."""
        arm, n = self.placed.arm, self.posture.q.shape[1]
        column = np.append(arm.turned[depth] @ local, 1.0)
        return np.asarray((column @ self._bodies[arm.last[depth] + 1].reshape(4, 3 * n)).reshape(3, n).T)

    def seen(self, target: int, frame: int | None) -> tuple[Matrix, Array3]:
        """Origin (n, 3) and axes (n, 3, 3) of one of the chain's frames, in another one or in the chain's base."""
        p, R = self.frames[target][:, :, 3], self.frames[target][:, :, :3]
        if frame is None:
            return p, R
        if (stands := self.placed.standing(frame)) is not None:
            back, origin, _ = stands
            return (p - origin) @ back.T, back @ R
        there = self.frames[frame]
        back = there[:, :, :3].transpose(0, 2, 1)
        return (back @ (p - there[:, :, 3])[..., None])[..., 0], back @ R

    def from_base(self, jac2: Array3, frame: int | None) -> Array3:
        """Derivatives (n, m, 6) by twists in one of the chain's frames as those by twists in the base: times Ad(T^-1)."""
        if frame is None:
            return jac2
        if (stands := self.placed.standing(frame)) is not None:
            return np.asarray((jac2.reshape(-1, 6) @ stands[2]).reshape(jac2.shape))
        return np.asarray(jac2 @ inverse_actions(self.frames[frame]))

    def derivatives(self, g: Array3, axes: bool = True, more: int = 0, behind: Array4 | None = None) -> tuple[Array3, Array3]:
        """Derivatives by what lies behind each parameter (p + more, m, n), and behind each moving joint (moving, m, n), of numbers.

        Args:
            g: Derivatives of the numbers by a twist [v, w] in the base, (n, m, 6).
            axes: Whether those by the joints are wanted, too; else there are none of them.
            more: How many rows of zeros to leave behind those of the parameters.
            behind: Gets those by turns of what lies behind each moving joint and its bends, about that element's axes, (moving, 3, m, n).
        """
        arm, posture, walk = self.placed.arm, self.posture, self.placed.placed.walk
        n, m, _ = g.shape
        by_parameter, by_element = np.zeros((len(walk.anchors) + more, m, n)), np.empty((len(arm.elements), m, n))
        here = np.ascontiguousarray(g.reshape(n, m, 2, 3).transpose(3, 2, 1, 0)).reshape(6, m * n)
        self._meet(by_parameter, here, 0)
        kept = {-1: here} if arm.forks else {}
        for number, (element, action) in enumerate(zip(arm.elements, self.placed.actions, strict=True)):
            here = action @ (here if arm.before[number] == number - 1 else kept[arm.before[number]])
            pairs = here.reshape(3, 2, m, n)
            if behind is not None and number in arm.backward:
                behind[element.joint] = pairs[:, 1]
            if element.slides:
                slide = posture.q[number]
                pairs[0, 1] += slide * pairs[1, 0]
                pairs[1, 1] -= slide * pairs[0, 0]
            else:
                turn(here[:4].reshape(2, 2 * m, n), posture.c[number], posture.s[number])
            if axes or self.yielding is not None:
                by_element[number] = pairs[2, 0 if element.slides else 1]
            if arm.last[element.joint + 1] == number:
                self._meet(by_parameter, here, element.joint + 1)
                if behind is not None and arm.signs[element.joint] > 0:
                    behind[element.joint] = pairs[:, 1]
            if number in arm.forks:
                kept[number] = here
        if self.yielding is not None:
            self._yield(by_parameter, by_element, self.yielding)
        return by_parameter, by_element[arm.own] if axes else by_element[:0]

    def unit_turns(self, by_axis: Array3, behind: Array4) -> None:
        """Derivatives by `softness.unit_terms`, (moving, 3, m, n), in place of those by turns behind the joints, `behind` above."""
        for own, turned, way, sign in zip(by_axis, behind, self.placed.arm.ways_across, self.placed.arm.signs, strict=True):
            turned[1:] = np.tensordot(way, turned, 1)
            np.multiply(own, sign, out=turned[0])

    def _meet(self, by_parameter: Array3, here: Matrix, anchor: int) -> None:
        """The parameters whose screws are constant in the frame that was reached."""
        columns = self.placed.placed.walk.anchored[anchor]
        if isinstance(columns, slice):
            own = by_parameter[columns]
            np.matmul(self.placed.screws_in_pairs[:, columns].T, here, out=own.reshape(len(own), here.shape[1]))
        elif len(columns):
            by_parameter[columns] = (self.placed.screws_in_pairs[:, columns].T @ here).reshape(len(columns), *by_parameter.shape[1:])

    def _yield(self, by_parameter: Array3, by_element: Array3, yielding: Yielding) -> None:
        """What joints yield by, per unit of its parameters; terms that are held come behind those that are estimated."""
        arm = self.placed.arm
        for column, joint, bend, basis in zip(yielding.columns, yielding.joints, yielding.bends, yielding.basis.T, strict=False):
            by_parameter[column] = by_element[arm.element_of(joint, bend)] * (arm.signs[joint] * basis)

    def axis_derivatives(self, g: Array3, target: int, frame: int) -> Array3:
        """Derivatives by every measured joint, (n, m, inputs), of numbers that one of the chain's frames has in another; g as above."""
        chain, by_axis = self.placed.arm.chain, self.derivatives(g)[1]
        there, here = (chain.passed[chain.frames[index].depth].astype(float) for index in (target, frame))
        return self.by_inputs(by_axis * (there - here)[:, None, None])

    def by_inputs(self, by_axis: Array3) -> Array3:
        """Derivatives by every measured joint, (n, m, inputs), from those by the moving joints, (moving, m, n)."""
        coupling = self.placed.arm.chain.coupling
        return np.tensordot(coupling, by_axis, 1).transpose(2, 1, 0)

    @cached_property
    def _of_twists(self) -> tuple[Array3, Array3]:
        return self.derivatives(np.broadcast_to(np.eye(6), (self.posture.q.shape[1], 6, 6)))

    @property
    def jac1(self) -> Array3:
        """Twist [v, w] of what lies behind each parameter, per unit of it, (n, 6, p)."""
        return self._of_twists[0].transpose(2, 1, 0)

    @property
    def axis_twists(self) -> Array3:
        """The same of each moving joint, (n, 6, moving)."""
        return self._of_twists[1].transpose(2, 1, 0)


@dataclass(frozen=True)
class Shares:
    """How what moves parts of an arm moves numbers: a factor for each, mostly 1.

    Attributes:
        rows: Of what is not 1 for all numbers.
        factors: Of these, (k, m, 1).
    """

    rows: npt.NDArray[np.intp]
    factors: Array3

    @staticmethod
    def of(shares: Matrix) -> Shares:
        """Those of each number, (k, m)."""
        rows = np.flatnonzero((shares != 1.0).any(axis=1)) if shares.size else np.empty(0, dtype=np.intp)
        return Shares(rows, shares[rows, :, None] if shares.size else np.empty((0, 0, 1)))

    def apply(self, derivatives: Array3 | Array4) -> None:
        """Multiply derivatives (k, m, n), or several kinds of them (k, kinds, m, n)."""
        if len(self.rows):
            derivatives[self.rows] *= self.factors if derivatives.ndim == 3 else self.factors[:, None]


def arm_motion(errors: ErrorModel, q: Matrix, x: Vector, session: str = "") -> ArmMotion:
    """Where the chain's frames are, and how they move with the error parameters (Jac1, equation 6); joints may give way.

    Args:
        errors: Names, order and units of the parameters.
        q: Measured joint positions, (n, inputs), [rad] or [m].
        x: Error parameters, (p,), [m] and [rad] in the order of `errors.names`.
        session: Whose screen placement to use.

    Raises:
        ShapeMismatch: q or x does not fit this chain and error model.
    """
    return motion_at(errors.arm, errors.placements(x, session), errors.arm.chain_positions(q), errors.yielding_at(x, q))


def motion_at(arm: ArmKinematics, placed: Placements, positions: Matrix, yielding: Yielding | None = None) -> ArmMotion:
    """The same at chain positions (n, moving), with the chain's constants given.

    Args:
        arm: Kinematics of the chain; with bends where joints yield about axes across their own.
        placed: The chain's constants.
        positions: Of the moving joints, (n, moving).
        yielding: How joints give way at these poses.
    """
    return ArmMotion(PlacedArm(arm, placed), arm.posture(positions, yielding), yielding)


def _from(body: Array3, local: Matrix) -> Array3:
    """[R | p] of a frame, (n, 3, 4), from the columns of its body (4, 3, n)."""
    n = body.shape[-1]
    return np.asarray((local.T @ body.reshape(4, 3 * n)).reshape(4, 3, n).transpose(2, 1, 0))
