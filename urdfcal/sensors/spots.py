"""What is measured, and Jac2: how a measurement moves with the twist of the body that carries its target.

A laser leaves its source p along z and meets the screen x = 0 at distance k = -p_x / z_x (8); the spot is the (y, z) of p + k z (7).

Laser spots as a camera's picture has them: pixels in place of metres on the screen.

The spot s = (0, y, z) of the screen frame is seen at

    u = project(T_camera_screen E_1 ... E_6 s)

where `project` is the calibrated lens, T_camera_screen the calibrated place of the screen in front of the camera and E_k the
exponentials of its six errors `camera.trans_x ... camera.rot_z` in screen axes. These are parameters with the calibration's own
covariance for a prior, so that a slightly wrong screen calibration does not become a joint error.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from urdfcal.base.geometry import SE3, Array3, Array4, Mask, Matrix, Vector, six_screws
from urdfcal.estimation.residual import Block
from urdfcal.model.error_model import ErrorModel, Placements
from urdfcal.model.jacobian import LaserMotion
from urdfcal.model.slots import SIX
from urdfcal.sensors.readings import Readings

LEAST_ZX = 0.3  # beams that graze the screen more flatly than this make no spot

Rows = slice | npt.NDArray[np.intp]


def spots_on_screen(source: Array3, direction: Array3) -> tuple[Array3, Matrix]:
    """Where beams meet the screen: equations (7) and (8).

    Args:
        source: (n, lasers, 3) in screen axes, [m].
        direction: (n, lasers, 3) unit vectors in screen axes.

    Returns:
        Spots (y, z), (n, lasers, 2), [m]; and beam lengths k, (n, lasers), [m], negative where the screen lies behind the laser
        and infinite or nan where the beam is parallel to it.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        length = -source[..., 0] / direction[..., 0]
        return source[..., 1:] + length[..., None] * direction[..., 1:], length


def makes_spot(length: Matrix, direction: Array3, nearest: float = 0.0, farthest: float = np.inf) -> npt.NDArray[np.bool_]:
    """Which beams make a spot that can be measured: they meet the screen, at no grazing angle, within a range of lengths.

    Args:
        length: Beam lengths k, (n, lasers), [m].
        direction: (n, lasers, 3) unit vectors in screen axes.
        nearest: Least length, [m].
        farthest: Greatest length, [m].

    Returns:
        (n, lasers).
    """
    with np.errstate(invalid="ignore"):
        return (length > nearest) & (length < farthest) & (np.abs(direction[..., 0]) > LEAST_ZX)


def spot_jacobian(spots: Array3, direction: Array3) -> Array4:
    """Jac2: motion of the spots per twist [v, w] of their lasers' carrier, in screen axes, taken at the screen's origin.

    The point of the beam that stands on the spot s moves with v + w x s; its motion along x is given back along the beam, so
    dy = v_y - (z_y / z_x) v_x and dz = v_z - (z_z / z_x) v_x of that point. Written for the twist at the source p, with
    s - p = k z, these are the two rows of equation (11).

    Args:
        spots: (n, lasers, 2), [m].
        direction: (n, lasers, 3).

    Returns:
        (n, lasers, 2, 6); rows are y and z of the spot.
    """
    y, z = spots[..., 0], spots[..., 1]
    jac2 = np.zeros((*y.shape, 2, 6))
    with np.errstate(divide="ignore", invalid="ignore"):
        lean = direction[..., 1:] / -direction[..., :1]
        jac2[..., 0] = lean
        jac2[..., 0, 1] = jac2[..., 1, 2] = 1.0
        jac2[..., 0, 3], jac2[..., 1, 3] = -z, y
        jac2[..., 4] = z[..., None] * lean
        jac2[..., 5] = -y[..., None] * lean
    return jac2


class ScreenCamera(Protocol):
    """A camera that looks at the screen: see `vision.camera_model.Camera`."""

    T_camera_screen: SE3 | None

    def project(self, points: Matrix) -> Matrix:
        """Pixels (n, 2) of points (n, 3) in camera axes."""

    def project_jacobian(self, points: Matrix) -> Array3:
        """Their derivative by the points, (n, 2, 3)."""


@dataclass(frozen=True)
class PixelSpots:
    """The pixels of one laser's spots, put to the robot.

    Attributes:
        data: What was read.
        laser: Index of the laser.
        camera: What it was read with.
        errors: The error model.
        first: Index of its first number among those of a pose.
    """

    data: Readings
    laser: int
    camera: ScreenCamera
    errors: ErrorModel
    first: int

    @property
    def columns(self) -> slice:
        """Its numbers among those of a pose."""
        return slice(self.first, self.first + 2)

    def block(self, kind: int) -> Block:
        """What tables and gates take it for."""
        return Block(f"{self.data.target} pixels", self.columns, kind, "px")

    @cached_property
    def measured(self) -> Mask:
        """Which numbers were read, (n, 2)."""
        return np.repeat(self.data.seen[:, None], 2, axis=1)

    def look(self, motion: LaserMotion, placed: Placements, rows: Rows, x: Vector) -> tuple[Matrix, Array3, Array3]:
        """Residual (n, 2), Jacobian (n, 2, p) and joint Jacobian (n, 2, inputs) of some poses at x."""
        source, direction = motion.source[:, self.laser], motion.direction[:, self.laser]
        spots, _ = spots_on_screen(source[:, None], direction[:, None])
        spots = np.where(np.isfinite(spots), spots, 0.0)
        T_camera_pose, columns, twists = screen_before(self.camera.T_camera_screen, self.errors, x)
        on_screen = np.concatenate([np.zeros((len(spots), 1)), spots[:, 0]], axis=1)
        points = on_screen @ T_camera_pose.rotation.T + T_camera_pose.translation
        by_point = self.camera.project_jacobian(points)
        by_spot = by_point @ T_camera_pose.rotation[:, 1:]
        jac2 = by_spot @ spot_jacobian(spots, direction[:, None])[:, 0]
        measured = self.measured[rows]
        jac2 = np.where(measured[..., None], jac2, 0.0)
        jacobian = jac2 @ (motion.jac1 * self.errors.moves_laser[self.laser])
        v, w = twists[:3], twists[3:]
        moved = v.T[None] + np.cross(w.T[None], points[:, None])  # (n, k, 3) in camera axes
        jacobian[:, :, columns] += np.where(measured[..., None], by_point @ moved.transpose(0, 2, 1), 0.0)
        residual = np.where(measured, self.data.values[rows] - self.camera.project(points), 0.0)
        return residual, jacobian, jac2 @ motion.joint_jacobian


def screen_before(T_camera_screen: SE3, errors: ErrorModel, x: Vector) -> tuple[SE3, list[int], Matrix]:
    """T_camera_screen with the camera's errors at x, and their twists in camera axes at the camera, (6, k), by column of x."""
    column = {name: index for index, name in enumerate(errors.names)}
    placement: Any = T_camera_screen
    columns, twists = [], []
    for name, screw in zip(SIX, six_screws().T, strict=True):
        motion, full = pin.Motion(screw), f"camera.{name}"
        value = x[column[full]] if full in column else errors.held.get(full, 0.0)
        if full in column:
            columns.append(column[full])
            twists.append(placement.act(motion).vector)
        placement = placement * pin.exp6(motion * float(value))
    return placement, columns, np.array(twists).reshape(-1, 6).T
