"""Jac1 of one pose at a time, as it comes while measuring, with everything that no pose changes worked out once.

What `kinematics.py` and `jacobian.py` do axis by axis for many poses costs a call an axis; for a single one all axes go together. Each
step of the way is linear in cosine, sine and slide of its motion,

    T_e = step_e (A + c C + s S + q D)

so that one product makes all of them, and a product of small matrices an element the way. A derivative g = [f, n] of what is read by a
twist in the base then is brought into all frames at once, [R' f, R' (n + f x p)], and meets all screws in one product.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from urdfcal.base.geometry import Array3, Matrix, Vector
from urdfcal.model.kinematics import PlacedArm

Index = npt.NDArray[np.intp]

_KEPT, _TURNED = np.diag([0.0, 0, 1, 1]), np.diag([1.0, 1, 0, 0])
_CROSSED, _SLID = np.zeros((2, 4, 4))
_CROSSED[1, 0], _CROSSED[0, 1], _SLID[2, 3] = 1.0, -1.0, 1.0
_TURN, _SLIDE = np.array([_KEPT, _TURNED, _CROSSED, 0 * _SLID]), np.array([np.eye(4), 0 * _KEPT, 0 * _KEPT, _SLID])
_CROSS = np.zeros((3, 3, 3))  # f _CROSS is the K with p K = f x p
for _i, _j, _k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
    _CROSS[_j, _k, _i], _CROSS[_k, _j, _i] = 1.0, -1.0


def cross_matrices(f: Matrix) -> Array3:
    """Of vectors (m, 3) the matrices K with p K = f x p, (m, 3, 3)."""
    return (f @ _CROSS.reshape(3, 9)).reshape(-1, 3, 3)


class SinglePoses:
    """An arm with its constants, one pose at a time; not for several threads at once, since numbers of a pose lie where the last ones lay.

    Attributes:
        arm: Its motions.
    """

    def __init__(self, placed: PlacedArm) -> None:
        self._placed, self.arm, elements = placed, placed.arm, len(placed.steps)
        ways = np.array([_SLIDE if element.slides else _TURN for element in placed.arm.elements])
        self._linear = (placed.steps[:, None] @ ways).reshape(elements, 4, 16)
        self._motions = np.ones((elements, 1, 4))
        self._bodies, self._steps = np.tile(np.eye(4), (elements + 1, 1, 1)), np.empty((elements, 4, 4))
        self._walk = [
            (self._bodies[before + 1], step, body)
            for before, step, body in zip(self.arm.before, self._steps, self._bodies[1:], strict=True)
        ]
        self._carriers = np.array([self.arm.last[frame.depth] + 1 for frame in self.arm.chain.frames], dtype=np.intp)
        self._locals, self._met = placed.locals, self._meeting(placed)
        self._frames = np.tile(np.eye(4), (len(self._locals) + 1, 1, 1))

    def __reduce__(self) -> tuple[type[SinglePoses], tuple[PlacedArm]]:
        """Copies are made anew: the way's matrices are views of what is kept here, which copied one by one would part."""
        return SinglePoses, (self._placed,)

    def _meeting(self, placed: PlacedArm) -> Matrix:
        """Screws of the parameters and, behind them, of the joints' own motions, each in the rows of its frame, (6 frames, p + moving)."""
        p, moving = placed.screws.shape[1], len(self.arm.own)
        met = np.zeros((len(self._bodies), 6, p + moving))
        frames = np.array(self.arm.last)[placed.placed.anchors] + 1
        met[frames, :, np.arange(p)] = placed.screws.T
        for joint, number in enumerate(self.arm.own.tolist()):
            met[number + 1, 2 if self.arm.elements[number].slides else 5, p + joint] = 1.0
        return met.reshape(-1, p + moving)

    def move(self, positions: Vector) -> Array3:
        """Take up a pose.

        Args:
            positions: Of the moving joints, (moving,), [rad] and [m]; none gives way.

        Returns:
            The chain's frames and, last, the base itself, (frames + 1, 4, 4); good until the next pose.
        """
        motions, own = self._motions[:, 0], self.arm.own
        motions[own, 1], motions[own, 2], motions[own, 3] = np.cos(positions), np.sin(positions), positions
        np.matmul(self._motions, self._linear, out=self._steps.reshape(-1, 1, 16))
        for before, step, body in self._walk:
            np.dot(before, step, out=body)
        np.matmul(self._bodies[self._carriers], self._locals, out=self._frames[:-1])
        return self._frames

    def derivatives(self, g: Matrix) -> Matrix:
        """By every parameter and, behind them, every moving joint, (m, p + moving), of numbers at the pose that was taken up.

        Args:
            g: Derivatives of the numbers by a twist [v, w] in the base, (m, 6).
        """
        m, bodies = len(g), self._bodies
        halves = np.empty((len(bodies), 2, m, 3))
        halves[:, 0] = g[:, :3]
        halves[:, 1] = (g[:, None, 3:] + bodies[:, :3, 3] @ cross_matrices(g[:, :3])).transpose(1, 0, 2)
        local = halves.reshape(len(bodies), 2 * m, 3) @ bodies[:, :3, :3]
        return np.asarray(local.reshape(len(bodies), 2, m, 3).transpose(2, 0, 1, 3).reshape(m, -1) @ self._met)


def seen_from(targets: Array3, there: Array3) -> tuple[Matrix, Array3]:
    """Origins (k, 3) and axes (k, 3, 3) of frames (k, 4, 4) in others, each in its own."""
    back = there[:, :3, :3].transpose(0, 2, 1)
    return (back @ (targets[:, :3, 3] - there[:, :3, 3])[..., None])[..., 0], back @ targets[:, :3, :3]


def brought_to_base(g: Array3, there: Array3) -> Array3:
    """Derivatives (k, m, 6) by twists in frames (k, 4, 4), each in its own, as those by twists in the base."""
    back = there[:, :3, :3].transpose(0, 2, 1)
    f, n = g[:, :, :3] @ back, g[:, :, 3:] @ back
    across = cross_matrices(f.reshape(-1, 3)).reshape(*f.shape, 3)
    return np.concatenate([f, n - (there[:, None, None, :3, 3] @ across)[:, :, 0]], axis=2)
