"""Common mistakes in measurements, each as what undoes it: swapped columns, wrong units, mirrored axes, a joint's sign or zero."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations

import numpy as np
import numpy.typing as npt

from urdfcal.base.geometry import DEG, MM, Matrix
from urdfcal.base.rotations import matrices, quaternions_of
from urdfcal.robot.urdf_tree import UrdfJoint
from urdfcal.sensors.measurements import Measurements
from urdfcal.sensors.readings import Readings

Columns = npt.NDArray[np.intp]
Change = Callable[[Measurements], Measurements]
Values = Callable[[Matrix], Matrix]  # of values (n, k)

_LEAST_READ = 0.5  # [rad] or [m] joints that move less than this were not read in degrees or millimetres
_CONJUGATE = np.array([-1.0, -1.0, -1.0, 1.0])  # of a quaternion x, y, z, w
_MOST_READ = 4 * np.pi  # [rad] or [m] no joint is farther from zero
_ON_SCREEN = {
    "y and z of the spots swapped": [[0, 1], [1, 0]],
    "y of the spots mirrored, as if seen from behind the screen": [[-1, 0], [0, 1]],
    "z of the spots mirrored": [[1, 0], [0, -1]],
    "y and z of the spots both mirrored, as by a camera upside down": [[-1, 0], [0, -1]],
    "the spots turned by 90 deg": [[0, -1], [1, 0]],
    "the spots turned by -90 deg": [[0, 1], [-1, 0]],
    "y and z of the spots swapped and mirrored": [[0, -1], [-1, 0]],
}


@dataclass(frozen=True)
class Mistake:
    """A mistake that could have been made.

    Attributes:
        undone: What undoes it, to be read behind "with".
        change: The same, as a function of the measurements.
    """

    undone: str
    change: Change


def mistakes_of_joints(data: Measurements, joints: Sequence[UrdfJoint]) -> Iterator[Mistake]:
    """Mistakes in how joints were read.

    Args:
        data: The measurements.
        joints: The joints that were measured, in the order of `data.joints`.
    """
    turning = np.array([index for index, joint in enumerate(joints) if not joint.prismatic], dtype=int)
    if len(turning) > 1:
        yield from _of_unit("all joints", "degrees", "radians", DEG, turning, data)
        yield Mistake("the signs of all joints flipped", partial(_moved, turning, -1.0, 0.0))
    for index, joint in enumerate(joints):
        yield from _of_joint(joint, np.array([index]), data)
    for one, other in combinations(turning.tolist(), 2):
        yield Mistake(f"{joints[one].name} and {joints[other].name} swapped", partial(_joints_swapped, one, other))
    for shift, where in ((1, "before"), (-1, "behind")):
        yield Mistake(f"the joints taken from the row {where}", partial(_rows_shifted, shift))


def mistakes_of_spots(data: Measurements) -> Iterator[Mistake]:
    """Mistakes in how spots were read off the screen."""
    for one, other in combinations(range(len(data.lasers)), 2):
        yield Mistake(f"{data.lasers[one]} and {data.lasers[other]} swapped", partial(_lasers_swapped, one, other))
    for words, matrix in _ON_SCREEN.items():
        yield Mistake(words, partial(_spots_changed, partial(_turned, np.array(matrix, dtype=float))))
    for words, change in _of_lengths("spots").items():
        yield Mistake(words, partial(_spots_changed, change))


def mistakes_of_readings(data: Measurements) -> Iterator[Mistake]:
    """Mistakes in what instruments beside lasers read.

    The measuring frame stands anywhere, so that axes that were swapped are the same as one that was mirrored: a left-handed frame.
    """
    kinds = {each.sensor for each in data.readings}
    for kind, changes in (("point", _of_points()), ("distance", _of_lengths("distances")), ("orientation", _of_orientations())):
        if kind in kinds:
            yield from _undone_by(kind, changes)
    if "pixel" in kinds:
        yield from _undone_by("pixel", _of_pixels(*data.camera.size))
    if "orientation" in kinds and any(each.sensor == "point" and _has_axes(each, data) for each in data.readings):
        yield Mistake("the poses inverted (the measuring frame as seen from the target)", _poses_inverted)
    yield from _of_targets(data)


def _of_joint(joint: UrdfJoint, column: Columns, data: Measurements) -> Iterator[Mistake]:
    yield Mistake(f"the sign of {joint.name} flipped", partial(_moved, column, -1.0, 0.0))
    if joint.prismatic:
        yield from _of_unit(joint.name, "millimetres", "metres", MM, column, data)
        return
    yield from _of_unit(joint.name, "degrees", "radians", DEG, column, data)
    for angle in (90, -90, 180):
        yield Mistake(f"{angle} deg added to {joint.name}", partial(_moved, column, 1.0, angle * DEG))


def _of_unit(name: str, small: str, large: str, factor: float, columns: Columns, data: Measurements) -> Iterator[Mistake]:
    """Numbers in a unit that is `factor` times another, taken for that other one; and the other way round."""
    most = float(np.abs(data.q[:, columns]).max())
    if most > _LEAST_READ:
        yield Mistake(f"{name} read as {small}", partial(_moved, columns, factor, 0.0))
    if most / factor < _MOST_READ:
        yield Mistake(f"{name} read as {large} in place of {small}", partial(_moved, columns, 1 / factor, 0.0))


def _undone_by(kind: str, changes: Mapping[str, Values]) -> Iterator[Mistake]:
    for words, change in changes.items():
        yield Mistake(words, partial(_values_through, kind, change))


def _of_lengths(what: str) -> dict[str, Values]:
    units = {"millimetres": MM, "centimetres": 10 * MM, "inches": 25.4 * MM}
    read_as = {f"the {what} read as {unit}": partial(np.multiply, size) for unit, size in units.items()}
    return read_as | {f"the {what} read as metres in place of {unit}": partial(np.multiply, 1 / size) for unit, size in units.items()}


def _of_points() -> dict[str, Values]:
    mirrored = "one axis of the points mirrored, or two of them swapped (a left-handed frame)"
    return {**_of_lengths("points"), mirrored: lambda values: values * [1, 1, -1]}


def _of_orientations() -> dict[str, Values]:
    return {
        "the quaternions read as w, x, y, z": lambda values: values[:, [1, 2, 3, 0]],
        "the orientations inverted": lambda values: values * _CONJUGATE,
        "roll, pitch and yaw taken about axes that turn along": lambda values: quaternions_of(-_angles_of(values)) * _CONJUGATE,
        "roll, pitch and yaw read as radians in place of degrees": lambda values: quaternions_of(_angles_of(values) / DEG),
    }


def _of_pixels(width: int, height: int) -> dict[str, Values]:
    return {
        "u and v of the pixels swapped": lambda values: values[:, ::-1],
        "u of the pixels mirrored": lambda values: [width - 1, 0] + values * [-1, 1],
        "v of the pixels counted from below": lambda values: [0, height - 1] + values * [1, -1],
    }


def _of_targets(data: Measurements) -> Iterator[Mistake]:
    """Targets on different links that were read for each other."""
    links = {each.target: each.link for each in data.readings if not each.kind.beam and each.link not in data.boards}
    kinds = {target: {each.sensor for each in data.readings if each.target == target} for target in links}
    for one, other in combinations(links, 2):
        if links[one] != links[other] and kinds[one] == kinds[other]:
            yield Mistake(f"{one} and {other} swapped", partial(_targets_swapped, one, other))


def _lasers_swapped(one: int, other: int, data: Measurements) -> Measurements:
    order = _swapped(len(data.lasers), one, other)
    return data.with_spots(data.spots[:, order], data.sigma[:, order])


def _joints_swapped(one: int, other: int, data: Measurements) -> Measurements:
    return replace(data, q=data.q[:, _swapped(len(data.joints), one, other)])


def _swapped(count: int, one: int, other: int) -> list[int]:
    order = list(range(count))
    order[one], order[other] = other, one
    return order


def _turned(matrix: Matrix, spots: Matrix) -> Matrix:
    return spots @ matrix.T


def _spots_changed(change: Values, data: Measurements) -> Measurements:
    return data.with_spots(change(data.spots))


def _moved(columns: Columns, factor: float, shift: float, data: Measurements) -> Measurements:
    q = data.q.copy()
    q[:, columns] = q[:, columns] * factor + shift
    return replace(data, q=q)


def _rows_shifted(shift: int, data: Measurements) -> Measurements:
    return replace(data, q=np.roll(data.q, shift, axis=0))


def _values_through(kind: str, change: Values, data: Measurements) -> Measurements:
    """All readings of a sensor changed."""
    return replace(
        data,
        readings=tuple(replace(each, values=np.asarray(change(each.values))) if each.sensor == kind else each for each in data.readings),
    )


def _angles_of(quaternions: Matrix) -> Matrix:
    """Roll, pitch and yaw about fixed axes, (n, 3); nan where there are none."""
    R = matrices(quaternions)
    roll, yaw = np.arctan2(R[:, 2, 1], R[:, 2, 2]), np.arctan2(R[:, 1, 0], R[:, 0, 0])
    return np.column_stack([roll, np.arctan2(-R[:, 2, 0], np.hypot(R[:, 0, 0], R[:, 1, 0])), yaw])


def _has_axes(point: Readings, data: Measurements) -> bool:
    return any(each.sensor == "orientation" and each.target == point.target for each in data.readings)


def _poses_inverted(data: Measurements) -> Measurements:
    axes = {each.target: each for each in data.readings if each.sensor == "orientation"}

    def inverted(each: Readings) -> Readings:
        if each.sensor == "orientation":
            return replace(each, values=each.values * _CONJUGATE)
        if each.sensor != "point" or each.target not in axes:
            return each
        return replace(each, values=-np.einsum("nij,ni->nj", matrices(axes[each.target].values), each.values))

    return replace(data, readings=tuple(inverted(each) for each in data.readings))


def _targets_swapped(one: str, other: str, data: Measurements) -> Measurements:
    own = {(each.sensor, each.target): each for each in data.readings}
    partner = {one: other, other: one}

    def swapped(each: Readings) -> Readings:
        read = own[each.sensor, partner.get(each.target, each.target)]
        return replace(each, values=read.values, labels=read.labels, sigma=read.sigma)

    return replace(data, readings=tuple(swapped(each) for each in data.readings))
