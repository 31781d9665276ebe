"""Sensors of targets: what they read of a target's pose in a measuring frame, and Jac2 of that reading.

A sensor knows nothing of joints. It sees the target's origin p and axes R in the measuring frame, and gives the residual m - h and the
derivative of h by the target's twist [v, w] in that frame's axes, taken at that frame's origin: the point p then moves by v + w x p.
Numbers of a place that several poses share (a socket's point, a plane, the end of a wire) are parameters of the sensor's own.
"""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from urdfcal.base.geometry import Array3, Matrix
from urdfcal.base.rotations import inverse_right_jacobian, matrices, rotation_vectors, skew
from urdfcal.sensors.sensor import Look, TargetSensor, View

_LEAST_DISTANCE = 1e-9  # [m]; nearer to the end of a wire there is no direction to speak of


def point_jacobian(p: Matrix) -> Array3:
    """Motion of points per twist at the origin, [I, -[p]x], (n, 3, 6)."""
    return np.concatenate([np.broadcast_to(np.eye(3), (len(p), 3, 3)), -skew(p)], axis=2)


def _nothing(look: Array3) -> Array3:
    return np.zeros((*look.shape[:2], 0))


class PointSensor:
    """A tracker or a mocap system: the target's origin in the measuring frame, h = p."""

    numbers: ClassVar[int] = 3
    unit: ClassVar[str] = "mm"
    title: ClassVar[str] = ""

    def look(self, view: View, values: Matrix) -> Look:
        """See the protocol."""
        jac2 = point_jacobian(view.p)
        return Look(values - view.p, jac2, _nothing(jac2))


class OrientationSensor:
    """The target's axes: e = log(R_measured R'), in the measuring frame's axes.

    With R -> exp(w) R it changes by de = -Jr^-1(e) w, where Jr^-1(e) = I + [e]x / 2 + (1/t^2 - (1 + cos t) / (2 t sin t)) [e]x^2 is the
    inverse right Jacobian of SO(3) and t = |e| (Chirikjian, Stochastic Models, Information Theory, and Lie Groups, vol. 2, 10.86).
    """

    numbers: ClassVar[int] = 3
    unit: ClassVar[str] = "deg"
    title: ClassVar[str] = "orientation"

    def look(self, view: View, values: Matrix) -> Look:
        """See the protocol."""
        e = rotation_vectors(matrices(values) @ view.R.transpose(0, 2, 1))
        jac2 = np.concatenate([np.zeros((len(e), 3, 3)), inverse_right_jacobian(e)], axis=2)
        return Look(e, jac2, _nothing(jac2))


class DistanceSensor:
    """A ball bar or a draw wire: the distance from the target to a fixed point c, h = |p - c|."""

    numbers: ClassVar[int] = 1
    unit: ClassVar[str] = "mm"
    title: ClassVar[str] = "distance"

    def look(self, view: View, values: Matrix) -> Look:
        """See the protocol."""
        apart = view.p - view.place
        length = np.maximum(np.linalg.norm(apart, axis=1), _LEAST_DISTANCE)[:, None]
        along = (apart / length)[:, None]
        return Look(values - length, along @ point_jacobian(view.p), -along)


class PlaneSensor:
    """A probe's tip on a plane n . p = d: 0 = h = n . p - d, with n = (n0 + t1 tilt_1 + t2 tilt_2) / |...|."""

    numbers: ClassVar[int] = 1
    unit: ClassVar[str] = "mm"
    title: ClassVar[str] = "plane"

    def look(self, view: View, values: Matrix) -> Look:
        """See the protocol."""
        lean = np.concatenate([np.ones((len(view.p), 1)), view.place[:, :2]], axis=1)
        long = np.linalg.norm(lean, axis=1)[:, None]
        n = np.einsum("nij,nj->ni", view.axes, lean / long)
        height = np.sum(n * view.p, axis=1, keepdims=True)
        tilted = (view.axes[:, :, 1:] - n[:, :, None] * (lean / long)[:, None, 1:]) / long[:, None]
        by_tilt = np.einsum("ni,nij->nj", view.p, tilted)
        by_place = np.concatenate([by_tilt, -np.ones_like(height)], axis=1)[:, None]
        return Look(view.place[:, 2:] - height, n[:, None] @ point_jacobian(view.p), by_place)


class SocketSensor:
    """A ball in a socket s: 0 = h = p - s."""

    numbers: ClassVar[int] = 3
    unit: ClassVar[str] = "mm"
    title: ClassVar[str] = "socket"

    def look(self, view: View, values: Matrix) -> Look:
        """See the protocol."""
        jac2 = point_jacobian(view.p)
        return Look(view.place - view.p, jac2, np.broadcast_to(-np.eye(3), (len(view.p), 3, 3)))


class PixelSensor:
    """A target in a picture, h = project(p); the measuring frame is the camera's: x right, y down, z ahead."""

    numbers: ClassVar[int] = 2
    unit: ClassVar[str] = "px"
    title: ClassVar[str] = "pixels"

    def __init__(self, camera: Any) -> None:
        self.camera = camera

    def look(self, view: View, values: Matrix) -> Look:
        """See the protocol."""
        jac2 = self.camera.project_jacobian(view.p) @ point_jacobian(view.p)
        return Look(values - self.camera.project(view.p), jac2, _nothing(jac2))


SENSORS: dict[str, TargetSensor] = {
    "point": PointSensor(),
    "orientation": OrientationSensor(),
    "distance": DistanceSensor(),
    "plane": PlaneSensor(),
    "socket": SocketSensor(),
}
