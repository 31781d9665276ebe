"""Sensors of points and frames on links: trackers, mocap, draw wires, probes on planes, balls in sockets."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import ClassVar

import numpy as np
import pinocchio as pin

from urdfcal.base.closed_form import common_point, plane_through, wire_end
from urdfcal.base.geometry import SE3, Array3, Labels, Mask, Matrix, Vector
from urdfcal.base.rotations import inverse_right_jacobian, matrices, product_of_quaternions, quaternions_of, rotation_vectors
from urdfcal.robot.rig import SIX, Place
from urdfcal.sensors.conventions import CONJUGATE, orientation_mistakes
from urdfcal.sensors.sensor import (
    CellFault,
    Change,
    Disturbance,
    Draw,
    Draws,
    FoundPlace,
    Look,
    PlaceFault,
    Quantity,
    Sensor,
    Sight,
    View,
    Words,
    leaning,
    point_jacobian,
    wrong_lengths,
    wrong_scale,
)

QUATERNION = ("qx", "qy", "qz", "qw")
ROLL_PITCH_YAW = ("roll", "pitch", "yaw")
_WIRE_FAR = 1.0  # [m] how far the end of a simulated wire is from the target, a standard deviation
_LEAST_TOUCHES = 3
_UNIT_WITHIN = 1e-3  # how far a quaternion's length may be from one: rounding of the file
_LEAST_DISTANCE = 1e-9  # [m]; nearer to the end of a wire there is no direction to speak of


class PointSensor(Sensor):
    """A tracker or a mocap system: the target's origin in the measuring frame, h = p."""

    name = noise = "point"
    words = Words("point", "points", "point noise", "mm", 0.5, 20.0)
    stored = numbers = 3
    components = "xyz"
    drawn = "measured points"
    endings: ClassVar[Mapping[str, Quantity]] = {"x": "length", "y": "length", "z": "length"}
    anywhere = True
    simulated = ("point", "pose")
    told_more_by = "orientation"
    mark = "point, measured"
    line = "line of sight"

    def look(self, view: View, values: Matrix) -> Look:
        """See the base class."""
        return Look(values - view.p, point_jacobian(view.p))

    def read(self, view: View) -> Matrix:
        """See the base class."""
        return view.p

    def shown(self, view: View, values: Matrix) -> Matrix:
        """See the base class; any of the three may be missing."""
        return np.where(np.isnan(values), view.p, values)

    def points(self, values: Matrix) -> Matrix:
        """See the base class."""
        return values

    def inverted(self, values: Matrix, R: Array3) -> Matrix:
        """See the base class; p = -R' p'."""
        return np.asarray(-np.einsum("nij,ni->nj", R, values))

    def looks_from(self, view: View) -> Matrix:
        """The tracker."""
        return np.zeros_like(view.p)

    def unseen(self, view: View, sight: Sight) -> Mapping[str, Mask]:
        """See the base class: within the instrument's range, and a reflector opens along its own z, as far as these are said."""
        far, found = np.linalg.norm(view.p, axis=1), {}
        if sight.nearest > 0:
            found[f"are nearer to the instrument than {sight.nearest:g} m"] = far < sight.nearest
        if sight.farthest < np.inf:
            found[f"are farther from the instrument than {sight.farthest:g} m"] = far > sight.farthest
        if sight.opening is not None:
            with np.errstate(invalid="ignore"):
                away = ~(leaning(-view.p, view.R[:, :, 2]) <= sight.opening)
            found[f"turn the target's z over {np.degrees(sight.opening):.0f} deg away from the instrument"] = away
        return found

    def measured(self, values: Matrix, labels: Labels) -> Mask:
        """Any of the three may be missing."""
        return ~np.isnan(values)

    def disturbances(self, view: View) -> tuple[Disturbance, ...]:
        """See the base class."""
        return (wrong_scale(self.read(view)),)

    def mistakes(self) -> Mapping[str, Change]:
        """See the base class; the frame stands anywhere, so that swapped axes are the same as one that was mirrored."""
        mirrored = "one axis of the points mirrored, or two of them swapped (a left-handed frame)"
        return {**wrong_lengths("points"), mirrored: lambda values: values * [1, 1, -1]}

    def moved(self, values: Matrix, T_new_old: SE3) -> Matrix:
        """See the base class."""
        return np.asarray(values @ T_new_old.rotation.T + T_new_old.translation)

    def kept(self, columns: Mapping[str, Vector]) -> Matrix:
        """See the base class; any of the three columns may be missing."""
        missing = np.full(len(next(iter(columns.values()))), np.nan)
        return np.column_stack([columns.get(axis, missing) for axis in self.endings])

    def written(self, values: Matrix) -> dict[str, Vector]:
        """See the base class; what was never read has no column."""
        return {axis: column for axis, column in super().written(values).items() if not np.isnan(column).all()}

    def drawn_at(self, view: View, values: Matrix) -> Matrix:
        """See the base class."""
        return values


class OrientationSensor(Sensor):
    """The target's axes: e = log(R_measured R'), in the measuring frame's axes; kept as unit quaternions x, y, z, w.

    With R -> exp(w) R it changes by de = -Jr^-1(e) w, where Jr^-1(e) = I + [e]x / 2 + (1/t^2 - (1 + cos t) / (2 t sin t)) [e]x^2 is the
    inverse right Jacobian of SO(3) and t = |e| (Chirikjian, Stochastic Models, Information Theory, and Lie Groups, vol. 2, 10.86).
    """

    name = noise = title = "orientation"
    words = Words("orientation", "orientations", "orientation noise", "deg", 0.05, 5.0, "a measured rotation")
    stored, numbers = 4, 3
    components = "xyz"
    offset = SIX
    anywhere = True
    simulated = ("pose",)
    endings: ClassVar[Mapping[str, Quantity]] = {**dict.fromkeys(QUATERNION, "ratio"), **dict.fromkeys(ROLL_PITCH_YAW, "angle")}
    sigma_ending = ""
    blank = (0.0, 0.0, 0.0, 1.0)

    def look(self, view: View, values: Matrix) -> Look:
        """See the base class."""
        e = rotation_vectors(matrices(values) @ view.R.transpose(0, 2, 1))
        return Look(e, np.concatenate([np.zeros((len(e), 3, 3)), inverse_right_jacobian(e)], axis=2))

    def read(self, view: View) -> Matrix:
        """See the base class."""
        return _quaternions(view.R)

    def axes(self, values: Matrix) -> Array3:
        """See the base class."""
        return matrices(values)

    def inverted(self, values: Matrix, R: Array3) -> Matrix:
        """See the base class; the conjugates."""
        return np.asarray(values * CONJUGATE)

    def disturbed(self, values: Matrix, draw: Draw) -> Matrix:
        """See the base class; the target is turned about each of the measuring frame's axes."""
        turns = draw((len(values), 3))
        return _quaternions(np.array([pin.exp3(turn) @ own for turn, own in zip(turns, matrices(values), strict=True)]).reshape(-1, 3, 3))

    def mistakes(self) -> Mapping[str, Change]:
        """See the base class."""
        return orientation_mistakes()

    def moved(self, values: Matrix, T_new_old: SE3) -> Matrix:
        """See the base class."""
        return product_of_quaternions(np.broadcast_to(pin.Quaternion(T_new_old.rotation).coeffs(), values.shape), values)

    def lacking(self, target: str, given: Collection[str]) -> tuple[str, str] | None:
        """See the base class."""
        for words in (QUATERNION, ROLL_PITCH_YAW):
            missing = [word for word in words if word not in given]
            if 0 < len(missing) < len(words):
                return missing[0], f"is missing; an orientation needs {', '.join(words)}"
        return None

    def kept(self, columns: Mapping[str, Vector]) -> Matrix:
        """See the base class; angles become unit quaternions."""
        words = QUATERNION if QUATERNION[0] in columns else ROLL_PITCH_YAW
        table = np.column_stack([columns[word] for word in words])
        partly = np.isnan(table).any(axis=1) & ~np.isnan(table).all(axis=1)
        if partly.any():
            row = int(np.argmax(partly))
            message = "and others of this orientation are not; leave all of them empty, or none"
            raise CellFault(row, words[int(np.argmax(np.isnan(table[row])))], message, lone=True)
        if words == ROLL_PITCH_YAW:
            return quaternions_of(table)
        length = np.linalg.norm(table, axis=1)
        wrong = np.abs(length - 1) > _UNIT_WITHIN
        if wrong.any():
            row = int(np.argmax(wrong))
            raise CellFault(row, words[0], f"the quaternion has length {length[row]:.4g}, expected 1 (x, y, z, w)")
        return np.asarray(table / length[:, None])

    def written(self, values: Matrix) -> dict[str, Vector]:
        """See the base class; as quaternions."""
        return dict(zip(QUATERNION, values.T, strict=True))


def _quaternions(R: Array3) -> Matrix:
    return np.array([pin.Quaternion(axes).coeffs() for axes in R]).reshape(-1, 4)


class DistanceSensor(Sensor):
    """A ball bar or a draw wire: the distance from the target to a fixed point c, h = |p - c|."""

    name = noise = title = "distance"
    words = Words("distance", "distances", "distance noise", "mm", 0.5, 20.0)
    stored = numbers = 1
    endings: ClassVar[Mapping[str, Quantity]] = {"distance": "length"}
    anywhere = True
    simulated = ("distance",)
    seen_from = "places"
    mark = "target, at the measured distance"
    line = "wire"

    def look(self, view: View, values: Matrix) -> Look:
        """See the base class."""
        along, length = _from_place(view)
        return Look(values - length, along[:, None] @ point_jacobian(view.p), -along[:, None])

    def read(self, view: View) -> Matrix:
        """See the base class."""
        return np.asarray(np.linalg.norm(view.p - view.place, axis=1)[:, None])

    def disturbances(self, view: View) -> tuple[Disturbance, ...]:
        """See the base class."""
        return (wrong_scale(self.read(view)),)

    def mistakes(self) -> Mapping[str, Change]:
        """See the base class."""
        return wrong_lengths("distances")

    def shown(self, view: View, values: Matrix) -> Matrix:
        """See the base class; as far from the end of the wire as was read."""
        along, length = _from_place(view)
        return np.asarray(view.p + along * (values - length))

    def looks_from(self, view: View) -> Matrix:
        """The end of the wire."""
        return view.place

    def sight_lines(self, view: View) -> None:
        """None: where the end of the wire will be is not known before it was measured."""

    def kept(self, columns: Mapping[str, Vector]) -> Matrix:
        """See the base class."""
        below = columns["distance"] < 0
        if below.any():
            row = int(np.argmax(below))
            raise CellFault(row, "distance", f"{columns['distance'][row]:g} m is below zero; expected a distance, or nothing")
        return super().kept(columns)

    def find_places(self, target: str, p: Matrix, R: Array3, values: Matrix, labels: Labels) -> Mapping[str, FoundPlace]:
        """See the base class."""
        return {f"{target}:wire": FoundPlace(wire_end(p, values[:, 0]))}

    def simulated_places(self, target: str, labels: Sequence[str], points: Matrix, draw: Draws) -> Mapping[str, FoundPlace]:
        """See the base class."""
        return {f"{target}:wire": FoundPlace(points[0] + draw.point(_WIRE_FAR))}

    def places(self, target: str, labels: Sequence[str]) -> tuple[Place, ...]:
        """The fixed end of the wire."""
        return (Place(f"{target}:wire", ("x", "y", "z"), ("m", "m", "m")),)


def _from_place(view: View) -> tuple[Matrix, Matrix]:
    """Unit vectors (n, 3) from a wire's end to its target, and how long the wire is, (n, 1), [m]."""
    apart = view.p - view.place
    length = np.maximum(np.linalg.norm(apart, axis=1), _LEAST_DISTANCE)[:, None]
    return apart / length, length


class PlaneSensor(Sensor):
    """A probe's tip on a plane n . p = d: 0 = h = n . p - d, with n = (n0 + t1 tilt_1 + t2 tilt_2) / |...|."""

    name = noise = title = "plane"
    words = Words("touch of a plane", "touches of planes", "noise across planes", "mm", 0.5, 10.0)
    stored, numbers = 0, 1
    endings: ClassVar[Mapping[str, Quantity]] = {"plane": "label"}
    touches = True
    simulated = ("plane",)
    seen_from = "places"
    mark = "touch, on its plane"

    def look(self, view: View, values: Matrix) -> Look:
        """See the base class."""
        lean = np.concatenate([np.ones((len(view.p), 1)), view.place[:, :2]], axis=1)
        long = np.linalg.norm(lean, axis=1)[:, None]
        n = self.normals(view)
        height = np.sum(n * view.p, axis=1, keepdims=True)
        tilted = (view.axes[:, :, 1:] - n[:, :, None] * (lean / long)[:, None, 1:]) / long[:, None]
        by_tilt = np.einsum("ni,nij->nj", view.p, tilted)
        by_place = np.concatenate([by_tilt, -np.ones_like(height)], axis=1)[:, None]
        return Look(view.place[:, 2:] - height, n[:, None] @ point_jacobian(view.p), by_place)

    def read(self, view: View) -> Matrix:
        """See the base class."""
        return np.empty((len(view.p), 0))

    def find_places(self, target: str, p: Matrix, R: Array3, values: Matrix, labels: Labels) -> Mapping[str, FoundPlace]:
        """See the base class; a plane that was touched less than three times fits any probe."""
        found = {}
        for label in dict.fromkeys(labels.tolist()):
            rows = np.flatnonzero(labels == label)
            if len(rows) < _LEAST_TOUCHES:
                count = "once" if len(rows) == 1 else "twice"
                message = (
                    f"plane '{label}' is touched {count}, expected three times or more; touch it at more poses, or leave its cells empty"
                )
                raise PlaceFault(int(rows[0]), message)
            axes, offset = plane_through(p[rows])
            found[f"plane:{label}"] = FoundPlace(np.array([0.0, 0.0, offset]), axes)
        return found

    def simulated_places(self, target: str, labels: Sequence[str], points: Matrix, draw: Draws) -> Mapping[str, FoundPlace]:
        """See the base class."""
        found = {}
        for label, point in zip(labels, points, strict=False):
            axes = draw.axes()
            found[f"plane:{label}"] = FoundPlace(np.array([0.0, 0.0, float(axes[:, 0] @ point)]), axes)
        return found

    def touched_from(self, place: Vector, axes: Matrix, off: Vector) -> tuple[Vector, Matrix]:
        """See the base class; across the plane alone. A simulated plane is not tilted against its axes."""
        return axes[:, 0] * (place[2] + off[0]), np.outer(axes[:, 0], axes[:, 0])

    def shown(self, view: View, values: Matrix) -> Matrix:
        """See the base class; the foot on the plane."""
        n = self.normals(view)
        return np.asarray(view.p + n * (view.place[:, 2:] - np.sum(n * view.p, axis=1, keepdims=True)))

    def normals(self, view: View) -> Matrix:
        """See the base class."""
        lean = np.concatenate([np.ones((len(view.p), 1)), view.place[:, :2]], axis=1)
        return np.asarray(np.einsum("nij,nj->ni", view.axes, lean / np.linalg.norm(lean, axis=1)[:, None]))

    def places(self, target: str, labels: Sequence[str]) -> tuple[Place, ...]:
        """The planes."""
        return tuple(Place(f"plane:{label}", ("tilt_1", "tilt_2", "offset"), ("rad", "rad", "m")) for label in labels)


class SocketSensor(Sensor):
    """A ball in a socket s: 0 = h = p - s."""

    name = noise = title = "socket"
    words = Words("touch of a socket", "touches of sockets", "socket noise", "mm", 0.5, 10.0)
    stored, numbers = 0, 3
    components = "xyz"
    drawn = "sockets"
    endings: ClassVar[Mapping[str, Quantity]] = {"socket": "label"}
    touches = in_pairs = True
    simulated = ("socket",)
    seen_from = "places"
    mark = "socket, where its touches meet"

    def look(self, view: View, values: Matrix) -> Look:
        """See the base class."""
        return Look(view.place - view.p, point_jacobian(view.p), np.broadcast_to(-np.eye(3), (len(view.p), 3, 3)))

    def read(self, view: View) -> Matrix:
        """See the base class."""
        return np.empty((len(view.p), 0))

    def find_offset(self, R: Array3, b: Matrix, values: Matrix, labels: Labels) -> SE3:
        """See the base class; R_i x + b_i - s = 0 of all poses and sockets at once."""
        _, index = np.unique(labels, return_inverse=True)
        return pin.SE3(np.eye(3), common_point(R, b, index))

    def find_places(self, target: str, p: Matrix, R: Array3, values: Matrix, labels: Labels) -> Mapping[str, FoundPlace]:
        """See the base class."""
        return {f"socket:{label}": FoundPlace(p[labels == label].mean(axis=0)) for label in dict.fromkeys(labels.tolist())}

    def simulated_places(self, target: str, labels: Sequence[str], points: Matrix, draw: Draws) -> Mapping[str, FoundPlace]:
        """See the base class."""
        return {f"socket:{label}": FoundPlace(point) for label, point in zip(labels, points, strict=False)}

    def touched_from(self, place: Vector, axes: Matrix, off: Vector) -> tuple[Vector, Matrix]:
        """See the base class; the point itself."""
        return place + off, np.eye(3)

    def shown(self, view: View, values: Matrix) -> Matrix:
        """See the base class; the socket itself."""
        return view.place

    def places(self, target: str, labels: Sequence[str]) -> tuple[Place, ...]:
        """The sockets' points."""
        return tuple(Place(f"socket:{label}", ("x", "y", "z"), ("m", "m", "m")) for label in labels)

    def drawn_at(self, view: View, values: Matrix) -> Matrix:
        """See the base class; where the touched socket was found."""
        return view.place
