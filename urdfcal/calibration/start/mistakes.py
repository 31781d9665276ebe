"""Common mistakes in measurements, each as what undoes it: swapped columns, wrong units, mirrored axes, a joint's sign or zero."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations

import numpy as np
import numpy.typing as npt

from urdfcal.base.geometry import DEG, MM, Array3
from urdfcal.robot.urdf_tree import UrdfJoint
from urdfcal.sensors.measurements import Measurements
from urdfcal.sensors.readings import Readings
from urdfcal.sensors.sensor import Change

Columns = npt.NDArray[np.intp]

MEND = "mend the measurements"
_LEAST_READ = 0.5  # [rad] or [m] joints that move less than this were not read in degrees or millimetres
_MOST_READ = 4 * np.pi  # [rad] or [m] no joint is farther from zero


@dataclass(frozen=True)
class Mistake:
    """A mistake that could have been made.

    Attributes:
        undone: What undoes it, to be read behind "with".
        change: The same, as a function of the measurements.
        way_out: What the user can do; nothing more where `undone` says it.
    """

    undone: str
    change: Callable[[Measurements], Measurements]
    way_out: str = MEND

    @property
    def is_of_setup(self) -> bool:
        """Whether the measurements are right, and what was said of them is not."""
        return self.way_out != MEND


UNTOUCHED = Mistake("", lambda data: data)


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


def mistakes_of_readings(data: Measurements, beams: bool) -> Iterator[Mistake]:
    """Mistakes in how spots were read off the screen, if beams are meant, or in what any other instruments read."""
    meant = [reading for reading in data.readings if reading.kind.beam == beams]
    for name, sensor in {reading.sensor: data.sensor_of(reading) for reading in meant}.items():
        for words, change in sensor.mistakes().items():
            yield Mistake(words, partial(_values_through, name, change))
    axes = _axes_of_targets(data)
    if any(reading.label in axes and reading.kind.points(reading.values) is not None for reading in meant):
        yield Mistake("the poses inverted (the measuring frame as seen from the target)", _poses_inverted)
    yield from _of_targets(data, meant)


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


def _of_targets(data: Measurements, meant: Sequence[Readings]) -> Iterator[Mistake]:
    """Targets, or beams, on different links that were read for each other."""
    links = {reading.target: reading.link for reading in meant if reading.link not in data.boards}
    sensors = {target: {reading.sensor for reading in meant if reading.target == target} for target in links}
    for one, other in combinations(links, 2):
        if links[one] != links[other] and sensors[one] == sensors[other]:
            yield Mistake(f"{one} and {other} swapped", partial(_targets_swapped, one, other))


def _joints_swapped(one: int, other: int, data: Measurements) -> Measurements:
    return replace(data, q=data.q[:, _swapped(len(data.joints), one, other)])


def _swapped(count: int, one: int, other: int) -> list[int]:
    order = list(range(count))
    order[one], order[other] = other, one
    return order


def _moved(columns: Columns, factor: float, shift: float, data: Measurements) -> Measurements:
    q = data.q.copy()
    q[:, columns] = q[:, columns] * factor + shift
    return replace(data, q=q)


def _rows_shifted(shift: int, data: Measurements) -> Measurements:
    return replace(data, q=np.roll(data.q, shift, axis=0))


def _values_through(sensor: str, change: Change, data: Measurements) -> Measurements:
    """All readings of a sensor changed."""
    return replace(
        data,
        readings=tuple(
            replace(reading, values=np.asarray(change(reading.values))) if reading.sensor == sensor else reading
            for reading in data.readings
        ),
    )


def _axes_of_targets(data: Measurements) -> dict[str, Array3]:
    """The targets whose axes were read, with those, (n, 3, 3)."""
    read = ((reading.label, reading.kind.axes(reading.values)) for reading in data.readings)
    return {target: axes for target, axes in read if axes is not None}


def _poses_inverted(data: Measurements) -> Measurements:
    axes = _axes_of_targets(data)
    inverted = (
        replace(each, values=each.kind.inverted(each.values, axes[each.label])) if each.label in axes else each for each in data.readings
    )
    return replace(data, readings=tuple(inverted))


def _targets_swapped(one: str, other: str, data: Measurements) -> Measurements:
    own = {(reading.sensor, reading.target, reading.instrument): reading for reading in data.readings}
    partner = {one: other, other: one}

    def swapped(each: Readings) -> Readings:
        read = own.get((each.sensor, partner.get(each.target, each.target), each.instrument), each)
        return replace(each, values=read.values, labels=read.labels, sigma=read.sigma)

    return replace(data, readings=tuple(swapped(reading) for reading in data.readings))
