"""Frames, points, planes and wire ends in closed form, or nearly so: what measurements of poses, points and lengths say of them.

With B_i the placement of a target's link, Y that of the measuring frame, X the target's offset on its link and A_i what was measured,
every pose says Y A_i = B_i X.

- Whole poses: rotations first, R_Y R_Ai = R_Bi R_X, linear in the 18 numbers of both matrices (the null vector, projected to SO(3));
  then R_Y a_i + y = R_Bi x + b_i, linear in y and x (robot-world and hand-eye calibration: Shah, J. Mechanisms Robotics 5, 2013).
- Points: R_Y and y by Umeyama (PAMI 13, 1991) for a given x, then y and x linear for a given R_Y, in turn, from several x.
- Pixels: the camera's pose from the rays of points (SQPnP: Terzakis and Lourakis, ECCV 2020).
- Sockets: R_i x + b_i = s, linear in x and every s.
- Planes: the plane of least squares through the points.
- Wires: |b_i - c|^2 = L_i^2, linear in c and |c|^2.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from urdfcal.base.errors import FitRejected
from urdfcal.base.geometry import SE3, Array3, Matrix, Vector

Rows = npt.NDArray[np.intp]

_OFFSETS = 0.3 * np.vstack([np.zeros(3), np.eye(3), -np.eye(3)])  # [m] where a point may sit on its link, to begin with
_FIRST_ROUNDS, _ROUNDS = 10, 60  # from each of them, and from where the best of them led
_STILL = 1e-9  # [m]


def robot_world_hand_eye(R_B: Array3, b: Matrix, R_A: Array3, a: Matrix) -> tuple[SE3, SE3]:
    """Y and X of Y A_i = B_i X, least squares in closed form.

    Args:
        R_B: Rotations of B_i, (n, 3, 3).
        b: Translations of B_i, (n, 3), [m].
        R_A: Rotations of A_i, (n, 3, 3).
        a: Translations of A_i, (n, 3), [m]; nan where they were not read.
    """
    n, unit = len(b), np.eye(3)
    by_y = np.einsum("jk,nlm->njmkl", unit, R_A).reshape(n * 9, 9)  # (R_Y R_A)_jm = R_Y,jl R_A,lm
    by_x = np.einsum("njk,ml->njmkl", R_B, unit).reshape(n * 9, 9)  # (R_B R_X)_jm = R_B,jk R_X,km
    _, _, rows = np.linalg.svd(np.linalg.qr(np.hstack([by_y, -by_x]), mode="r"))
    Y, X = rows[-1].reshape(2, 3, 3)
    sign = np.sign(np.linalg.det(Y) + np.linalg.det(X))
    R_Y, R_X = nearest_rotation(sign * Y), nearest_rotation(sign * X)
    y, x = _translations(R_B, b, a, R_Y)
    return pin.SE3(R_Y, y), pin.SE3(R_X, x)


def point_and_frame(R: Array3, b: Matrix, a: Matrix) -> tuple[SE3, Vector]:
    """Y and the offset x of a point, R_Y a_i + y = R_i x + b_i, from the best of several starts.

    Args:
        R: Axes of the link, (n, 3, 3).
        b: Its origins, (n, 3), [m].
        a: Measured points, (n, 3), [m].
    """
    in_turn = _InTurn(R, b, a)
    best = min(zip(*in_turn.from_offsets(_OFFSETS, _FIRST_ROUNDS), strict=True), key=in_turn.left)
    (R_Y,), (y,), (x,) = in_turn.from_offsets(best[2][None], _ROUNDS)
    return pin.SE3(R_Y, y), x


class _InTurn:
    """Rotation for a given offset, offset for a given rotation, and so on: sums over the poses once, for all rounds.

    What Umeyama projects is linear in x. So are y and x in R_Y: of (R_Y a_i + y) - (R_i x + b_i) the left side's matrix is constant.
    """

    def __init__(self, R: Array3, b: Matrix, a: Matrix) -> None:
        self.R, self.b, self.a = R, b, a
        apart = a - a.mean(axis=0)
        self.still = (b - b.mean(axis=0)).T @ apart
        self.by_offset = np.einsum("nij,nk->ikj", R - R.mean(axis=0), apart)  # (3, 3, 3): per number of x on the right
        inverse = np.linalg.pinv(np.concatenate([np.broadcast_to(np.eye(3), R.shape), -R], axis=2).reshape(-1, 6), rcond=1e-9)
        self.without = inverse @ b.ravel()
        self.by_rotation = np.einsum("cnj,nl->cjl", inverse.reshape(6, -1, 3), a).reshape(6, 9)

    def from_offsets(self, x: Matrix, rounds: int) -> tuple[Array3, Matrix, Matrix]:
        """R_Y (k, 3, 3), y and x (k, 3) after some rounds that begin at offsets x (k, 3)."""
        for _ in range(rounds):
            R_Y, last = nearest_rotation(self.still + (self.by_offset @ x.T).transpose(2, 0, 1)), x
            y, x = np.split(self.without - R_Y.reshape(-1, 9) @ self.by_rotation.T, 2, axis=1)
            if np.max(np.abs(x - last)) < _STILL:
                break
        return R_Y, y, x

    def left(self, found: tuple[Matrix, Vector, Vector]) -> float:
        """What is left over, squared, [m^2]."""
        R_Y, y, x = found
        return float(np.sum((self.a @ R_Y.T + y - (self.b + self.R @ x)) ** 2))


def _translations(R: Array3, b: Matrix, a: Matrix, R_Y: Matrix) -> tuple[Vector, Vector]:
    """Y and x of R_Y a_i + y = R_i x + b_i by least squares in the measuring frame's axes; the shortest where the poses do not tell."""
    left = (R_Y.T @ np.concatenate([np.broadcast_to(np.eye(3), R.shape), -R], axis=2)).reshape(-1, 6)
    right = (b @ R_Y - a).ravel()
    read = ~np.isnan(right)
    both = np.linalg.lstsq(left[read], right[read], rcond=1e-9)[0]
    return both[:3], both[3:]


def umeyama(a: Matrix, b: Matrix) -> SE3:
    """The rigid motion that brings points a (n, 3) nearest to points b (n, 3)."""
    middle_a, middle_b = a.mean(axis=0), b.mean(axis=0)
    R = nearest_rotation((b - middle_b).T @ (a - middle_a))
    return pin.SE3(R, middle_b - R @ middle_a)


def nearest_rotation(M: Matrix) -> Matrix:
    """The rotation nearest to a matrix (3, 3), or to each of some (..., 3, 3)."""
    U, _, Vt = np.linalg.svd(M)
    U[..., 2] *= np.sign(np.linalg.det(U @ Vt))[..., None]
    return np.asarray(U @ Vt)


def camera_before(points: Matrix, rays: Matrix) -> SE3:
    """Placement of a camera that sees points (n, 3), [m], along unit rays (n, 3) in its own axes, z ahead; in the points' frame.

    Raises:
        FitRejected: there is no such place.
    """
    import cv2

    good = rays[:, 2] > 0
    seen, ahead = np.ascontiguousarray(points[good]), np.ascontiguousarray(rays[good, :2] / rays[good, 2:])
    try:
        found, turn, shift = cv2.solvePnP(seen, ahead, np.eye(3), None, flags=cv2.SOLVEPNP_SQPNP)
    except cv2.error:  # too few points, or all of them at one place
        found = False
    if not found:
        raise FitRejected("no place of the camera explains where its targets were seen; check the joints and the camera", forceable=False)
    return pin.SE3(pin.exp3(turn.ravel()), shift.ravel()).inverse()


def common_point(R: Array3, b: Matrix, group: Rows) -> Vector:
    """The point x on a link that lies at one place in all poses of a group: R_i x + b_i = s_group.

    Args:
        R: Axes of the link, (n, 3, 3).
        b: Its origins, (n, 3), [m].
        group: Index of each pose's place, (n,).
    """
    count = int(group.max()) + 1
    mean_R = np.array([R[group == number].mean(axis=0) for number in range(count)])
    mean_b = np.array([b[group == number].mean(axis=0) for number in range(count)])
    left, right = (R - mean_R[group]).reshape(-1, 3), -(b - mean_b[group]).ravel()
    return np.asarray(np.linalg.lstsq(left, right, rcond=1e-9)[0])


def plane_through(points: Matrix) -> tuple[Matrix, float]:
    """Normal and two tangents of the plane of least squares through points (n, 3), as columns, and its offset n . p, [m]."""
    middle = points.mean(axis=0)
    _, _, rows = np.linalg.svd(points - middle)
    return np.asarray(rows[[2, 0, 1]].T), float(rows[2] @ middle)


def wire_end(points: Matrix, lengths: Vector) -> Vector:
    """The point whose distances from points (n, 3) are the lengths (n,): |p|^2 - L^2 = 2 p . c - |c|^2, linear in c and |c|^2."""
    left = np.column_stack([2 * points, -np.ones(len(points))])
    return np.asarray(np.linalg.lstsq(left, np.sum(points**2, axis=1) - lengths**2, rcond=1e-9)[0][:3])
