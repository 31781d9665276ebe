"""Where a plane with known points is in the camera: least squares over all pixels, with the covariance of the pose.

Minimises sum |pixel - projected|^2 / sigma^2 + sum |shift|^2 / placement^2 over the pose T_camera_plane = T_start exp(xi) and,
where the points sit on several pieces that were put up by hand, over a shift (y, z) and a turn of every piece. So that a piece
put up half a millimetre off counts as what it is, once and not once a corner, and is in the covariance. sigma, the noise
of a pixel, is estimated from the residual.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt
import pinocchio as pin

from urdfcal.base.geometry import SE3, Matrix, Vector
from urdfcal.sensors.camera import Camera

T_SCREEN_SHEET = pin.SE3(np.array([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]), np.zeros(3))
LEAST_SIGMA_PX = 0.05  # no corner is known better: the lens bends a marker's edges by a few hundredths of a pixel
_FAR_PX = 1e4  # in place of nan where a trial pose puts a point behind the camera
_ROUNDS = 5
Pieces = npt.NDArray[np.intp]
"""A sheet's axes (x right, y down, z away from who looks at the front) in screen axes."""


@dataclass(frozen=True, eq=False)
class PlanePoints:
    """Points of a plane and where they are seen.

    Attributes:
        points: (n, 3) in the screen frame (x = 0), [m].
        pixels: (n, 2).
        pieces: Which rigid piece a point sits on, (n,), from 0.
        placement: Sigma of y and z of a piece, [m]; 0 where pieces are exactly where they are said to be.
    """

    points: Matrix
    pixels: Matrix
    pieces: Pieces
    placement: float = 0.0

    def of(self, chosen: npt.NDArray[np.bool_]) -> PlanePoints:
        """Those of the chosen pieces, numbered anew."""
        kept = chosen[self.pieces]
        return PlanePoints(self.points[kept], self.pixels[kept], (np.cumsum(chosen) - 1)[self.pieces[kept]], self.placement)


@dataclass(frozen=True, eq=False)
class PlaneFit:
    """A plane's pose.

    Attributes:
        T_camera_plane: The pose.
        covariance: Of xi in T_camera_plane exp(xi), (6, 6), [m] and [rad].
        residual: Measured minus predicted pixels, (n, 2), the pieces shifted as fitted.
        cost: The minimum of the sum above.
        sigma: Noise of a pixel coordinate that the weights have, [px].
    """

    T_camera_plane: SE3
    covariance: Matrix
    residual: Matrix
    cost: float
    sigma: float

    @property
    def rms(self) -> float:
        """RMS distance of the points, [px]."""
        return float(np.sqrt((self.residual**2).sum(axis=1).mean()))


def fit_plane(camera: Camera, seen: PlanePoints, sigma: float | None = None) -> PlaneFit | None:
    """The pose of a plane from at least four of its points; None where none is found.

    Args:
        camera: The lens.
        seen: The points.
        sigma: Noise of a pixel coordinate, [px]; None: estimated.
    """
    fits = [_fit_from(camera, T_start, seen, sigma) for T_start in start_poses(camera, seen)]
    return min((fit for fit in fits if np.isfinite(fit.cost)), key=lambda fit: fit.cost * fit.sigma**2, default=None)


def start_poses(camera: Camera, seen: PlanePoints) -> list[SE3]:
    """The two poses that a plane can have for its homography (Collins and Bartoli's IPPE, in OpenCV)."""
    rays = camera.rays(seen.pixels)
    usable = np.isfinite(rays).all(axis=1)
    if usable.sum() < 4:
        return []
    sheet = seen.points[usable] @ T_SCREEN_SHEET.rotation
    flat = (rays[usable, :2] / rays[usable, 2:])[:, None]
    try:
        _, turns, shifts, _ = cv2.solvePnPGeneric(sheet[:, None], flat, np.eye(3), np.zeros(5), flags=cv2.SOLVEPNP_IPPE)
    except cv2.error:  # points on a line
        return []
    poses = [pin.SE3(pin.exp3(turn.ravel()), shift.ravel()) * T_SCREEN_SHEET.inverse() for turn, shift in zip(turns, shifts, strict=True)]
    return [pose for pose in poses if np.isfinite(pose.homogeneous).all()]


def _fit_from(camera: Camera, T_start: SE3, seen: PlanePoints, sigma: float | None) -> PlaneFit:
    """The fit from one start; where sigma is not given, with weights that follow the residual."""
    fit = _solve(camera, T_start, seen, sigma or 0.3)
    for _ in range(0 if sigma else _ROUNDS):
        freedom = 2 * len(seen.points) - _used(camera, fit, seen)
        found = max(LEAST_SIGMA_PX, float(np.sqrt((fit.residual**2).sum() / max(freedom, 1.0))))
        if abs(found - fit.sigma) < 1e-3 * fit.sigma:
            break
        fit = _solve(camera, fit.T_camera_plane, seen, found)
    return fit


def _solve(camera: Camera, T_start: SE3, seen: PlanePoints, sigma: float) -> PlaneFit:
    from scipy.optimize import least_squares

    weights = _weights(seen, sigma)
    zero = np.zeros(6 + len(weights) - 2 * len(seen.points))

    def residual(x: Vector) -> Vector:
        off = _pixels(camera, T_start, seen, x) - seen.pixels
        return np.asarray(weights * np.concatenate([np.nan_to_num(off, nan=_FAR_PX).ravel(), x[6:]]))

    def jacobian(x: Vector) -> Matrix:
        return np.asarray(weights[:, None] * np.nan_to_num(_jacobian(camera, T_start, seen, x)))

    found = least_squares(residual, zero, jacobian, method="lm", x_scale="jac", xtol=1e-12, ftol=1e-12, max_nfev=60)
    T = T_start * pin.exp6(found.x[:6])
    still = np.concatenate([np.zeros(6), found.x[6:]])
    weighted = weights[:, None] * np.nan_to_num(_jacobian(camera, T, seen, still))
    left = seen.pixels - _pixels(camera, T, seen, still)
    cost = float(found.fun @ found.fun) if np.isfinite(left).all() else np.inf
    covariance: Matrix = np.asarray(np.linalg.pinv(weighted.T @ weighted), dtype=float)
    return PlaneFit(T, covariance[:6, :6], np.nan_to_num(left, nan=_FAR_PX), cost, sigma)


def _used(camera: Camera, fit: PlaneFit, seen: PlanePoints) -> float:
    """How many degrees of freedom of the pixels the fit has used up: the trace of its hat matrix."""
    weights = _weights(seen, fit.sigma)
    weighted = weights[:, None] * _jacobian(camera, fit.T_camera_plane, seen, np.zeros(6 + len(weights) - 2 * len(seen.points)))
    pixels = weighted[: 2 * len(seen.points)]
    return float(np.trace(np.linalg.pinv(weighted.T @ weighted) @ (pixels.T @ pixels)))


def _weights(seen: PlanePoints, sigma: float) -> Vector:
    """One over the sigma of every pixel coordinate and of every shift and turn of a piece."""
    pixels = np.full(2 * len(seen.points), 1 / sigma)
    if not seen.placement:
        return pixels
    sides = [np.ptp(seen.points[seen.pieces == piece][:, 1:], axis=0).max() for piece in range(seen.pieces.max() + 1)]
    return np.concatenate([pixels, *([1 / seen.placement, 1 / seen.placement, side / 2 / seen.placement] for side in sides)])


def _shifted(seen: PlanePoints, x: Vector) -> tuple[Matrix, Matrix]:
    """Points (n, 3) with their pieces shifted and turned, and the way (n, 3) that a turn of its piece moves each."""
    turn = np.zeros_like(seen.points)
    if not seen.placement:
        return seen.points, turn
    centres = np.array([seen.points[seen.pieces == piece].mean(axis=0) for piece in range(seen.pieces.max() + 1)])
    y, z = (seen.points - centres[seen.pieces])[:, 1:].T
    turn[:, 1], turn[:, 2] = -z, y
    shift = x[6:].reshape(-1, 3)[seen.pieces]
    moved = seen.points + turn * shift[:, 2:]
    moved[:, 1:] += shift[:, :2]
    return moved, turn


def _pixels(camera: Camera, T_start: SE3, seen: PlanePoints, x: Vector) -> Matrix:
    T = T_start * pin.exp6(x[:6])
    return camera.project(_shifted(seen, x)[0] @ T.rotation.T + T.translation)


def _jacobian(camera: Camera, T_start: SE3, seen: PlanePoints, x: Vector) -> Matrix:
    """Derivative of pixels and shifts by x, (2 n + 3 pieces, 6 + 3 pieces)."""
    T = T_start * pin.exp6(x[:6])
    points, turn = _shifted(seen, x)
    by_point = camera.project_jacobian(points @ T.rotation.T + T.translation) @ T.rotation  # by the point in screen axes
    twist = np.concatenate([np.broadcast_to(np.eye(3), (len(points), 3, 3)), -np.array([pin.skew(point) for point in points])], axis=2)
    by_pose = (by_point @ twist).reshape(-1, 6) @ pin.Jexp6(x[:6])
    if not seen.placement:
        return np.asarray(by_pose)
    by_piece = np.zeros((len(points), 2, len(x) - 6))
    rows = np.arange(len(points))
    for column, derivative in enumerate((by_point[:, :, 1], by_point[:, :, 2], np.einsum("nij,nj->ni", by_point, turn))):
        by_piece[rows, :, 3 * seen.pieces + column] = derivative
    return np.block([[by_pose, by_piece.reshape(2 * len(points), -1)], [np.zeros((len(x) - 6, 6)), np.eye(len(x) - 6)]])
