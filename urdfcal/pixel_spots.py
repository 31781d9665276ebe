"""Laser spots as a camera's picture has them: pixels in place of metres on the screen.

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

from urdfcal.error_model import ErrorModel, Placements
from urdfcal.frame_jacobian import LaserMotion
from urdfcal.geometry import SE3, Array3, Matrix, Vector, six_screws
from urdfcal.measurements import Mask
from urdfcal.noise import Block
from urdfcal.readings import Readings
from urdfcal.sensors import spot_jacobian, spots_on_screen
from urdfcal.slots import SIX

Rows = slice | npt.NDArray[np.intp]


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
