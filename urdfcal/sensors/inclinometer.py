"""A two-axis inclinometer: how a link is tilted against gravity, whichever way the robot stands.

Up, seen in the instrument's own axes, is u = R' g, with g the direction of up in the measuring frame's axes. What is read are

    incl_x = atan2(u_y, u_z),    incl_y = atan2(-u_x, sqrt(u_y^2 + u_z^2)),

roll and pitch as URDF has them. Roll means less the more the instrument is pitched, so that the residual is

    e = ((incl_x - roll) cos(incl_y), incl_y - pitch),

which is how far u is off along two directions across it. A twist turns the instrument by w, so that du = R' (g x w). The robot need not
stand upright: g = (z + t1 x + t2 y) / |...| about the axes in which it was found, its two tilts shared by all poses.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from itertools import product
from typing import ClassVar

import numpy as np
import pinocchio as pin

from urdfcal.base.closed_form import nearest_rotation
from urdfcal.base.geometry import DEG, SE3, Array3, Labels, Matrix, Vector
from urdfcal.base.rotations import skew
from urdfcal.robot.rig import SIX, Place
from urdfcal.sensors.sensor import Change, Draws, FoundPlace, Look, Quantity, Sensor, View, Words, require_pair

GRAVITY = "gravity"
_ROUNDS = 30  # of mount and up in turn, from every start


class InclinometerSensor(Sensor):
    """Roll and pitch of a link against gravity."""

    name = noise = title = "inclination"
    words = Words("inclination", "inclinations", "inclination noise", "deg", 0.02, 5.0, "a measured rotation")
    stored = numbers = 2
    components = "xy"
    endings: ClassVar[Mapping[str, Quantity]] = {"incl_x": "angle", "incl_y": "angle"}
    offset = SIX[3:]
    seen_from = "places"
    anywhere = True
    simulated = ("inclination",)

    def look(self, view: View, values: Matrix) -> Look:
        """See the base class."""
        g, by_tilt = _up(view)
        up = np.einsum("nij,ni->nj", view.R, g)
        back, across = view.R.transpose(0, 2, 1), np.maximum(np.hypot(up[:, 1], up[:, 2]), 1e-9)
        by_up = np.zeros((len(up), 2, 3))
        by_up[:, 0, 1], by_up[:, 0, 2] = up[:, 2] / across**2, -up[:, 1] / across**2
        by_up[:, 1] = np.column_stack([-across, up[:, 0] * up[:, 1] / across, up[:, 0] * up[:, 2] / across])
        by_up[:, 0] *= np.cos(values[:, 1])[:, None]
        off = values - self.read(view)
        off[:, 0] = np.arctan2(np.sin(off[:, 0]), np.cos(off[:, 0])) * np.cos(values[:, 1])
        jac2 = np.concatenate([np.zeros((len(up), 2, 3)), by_up @ back @ skew(g)], axis=2)
        return Look(off, jac2, by_up @ back @ by_tilt)

    def read(self, view: View) -> Matrix:
        """See the base class."""
        up = np.einsum("nij,ni->nj", view.R, _up(view)[0])
        return np.column_stack([np.arctan2(up[:, 1], up[:, 2]), np.arctan2(-up[:, 0], np.hypot(up[:, 1], up[:, 2]))])

    def places(self, target: str, labels: Sequence[str]) -> tuple[Place, ...]:
        """Which way is up, of all inclinometers alike."""
        return (Place(GRAVITY, ("tilt_1", "tilt_2"), ("rad", "rad"), words="the direction of gravity"),)

    def find_offset(self, R: Array3, b: Matrix, values: Matrix, labels: Labels) -> SE3:
        """How the instrument sits on its link: the turn under which all poses see the same direction up, from the best of 24 starts."""
        seen = _directions(values)
        turns = [_in_turn(R, seen, start) for start in _CUBE]
        return pin.SE3(max(turns, key=lambda turn: float(np.linalg.norm(_mean_up(R, seen, turn)))), np.zeros(3))

    def find_places(self, target: str, p: Matrix, R: Array3, values: Matrix, labels: Labels) -> Mapping[str, FoundPlace]:
        """Up is where the readings have it on average."""
        up = _mean_up(R, _directions(values), np.eye(3))
        _, _, rows = np.linalg.svd(up[None])
        rows[0] = up / np.linalg.norm(up)
        return {GRAVITY: FoundPlace(np.zeros(2), rows.T)}

    def simulated_places(self, target: str, labels: Sequence[str], points: Matrix, draw: Draws) -> Mapping[str, FoundPlace]:
        """A robot that hangs anywhere."""
        return {GRAVITY: FoundPlace(np.zeros(2), draw.axes())}

    def lacking(self, target: str, given: Collection[str]) -> tuple[str, str] | None:
        """See the base class."""
        missing = [ending for ending in self.endings if ending not in given]
        return (missing[0], "is missing; an inclination needs .incl_x and .incl_y") if missing else None

    def kept(self, columns: Mapping[str, Vector]) -> Matrix:
        """See the base class."""
        require_pair(columns, "and its other one is not; leave both empty if it was not read")
        return super().kept(columns)

    def mistakes(self) -> Mapping[str, Change]:
        """See the base class."""
        return {
            "incl_x and incl_y swapped": lambda values: values[:, ::-1],
            "the inclinations read as radians in place of degrees": lambda values: values / DEG,
            "one of the inclinations with its sign flipped": lambda values: values * [1, -1],
        }


_CUBE = [
    np.column_stack([one * np.eye(3)[i], other * np.eye(3)[j], np.cross(one * np.eye(3)[i], other * np.eye(3)[j])])
    for i, j in product(range(3), range(3))
    if i != j
    for one, other in product((1.0, -1.0), (1.0, -1.0))
]


def _up(view: View) -> tuple[Matrix, Array3]:
    """The direction of up in the measuring frame, (n, 3), and its derivative by the two tilts, (n, 3, 2)."""
    lean = np.concatenate([np.ones((len(view.place), 1)), view.place], axis=1)
    long = np.linalg.norm(lean, axis=1)[:, None]
    g = np.einsum("nij,nj->ni", view.axes, lean / long)
    return g, (view.axes[:, :, 1:] - g[:, :, None] * (lean / long)[:, None, 1:]) / long[:, None]


def _directions(values: Matrix) -> Matrix:
    """Up in the instrument's axes as the readings have it, (n, 3)."""
    roll, pitch = values.T
    return np.column_stack([-np.sin(pitch), np.cos(pitch) * np.sin(roll), np.cos(pitch) * np.cos(roll)])


def _mean_up(R: Array3, seen: Matrix, turn: Matrix) -> Vector:
    return np.asarray(np.einsum("nij,nj->ni", R, seen @ turn.T).mean(axis=0))


def _in_turn(R: Array3, seen: Matrix, turn: Matrix) -> Matrix:
    """Up for a given mount, the mount for a given up (Wahba's problem), and so on."""
    for _ in range(_ROUNDS):
        up = _mean_up(R, seen, turn)
        on_link = np.einsum("nji,j->ni", R, up)
        turn = nearest_rotation(on_link.T @ seen)
    return turn
