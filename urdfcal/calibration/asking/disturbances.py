"""What a rig may do to the readings of one channel: its instruments, and the frame that it measures in, which drifts.

The measuring frame that moves by a twist [v, w] in its own axes moves what is read by -Jac2 [v, w]; an arm whose lengths all grow by a
share moves the target by that share of its place. Drift goes with time, or with the order of the poses where no time is said; what
wanders without a direction is a sum of waves over that time, each of which is smaller than the one before (a Brownian path's series).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from urdfcal.base.geometry import MM, Array3, Matrix, Vector
from urdfcal.model.rig_terms import Course, Rig, RigTerm
from urdfcal.robot.rig import SIX
from urdfcal.sensors.measurements import Measurements
from urdfcal.sensors.sensor import Look, Sensor, View

WAVES = 6
_FRAME_SIGMA = (1 * MM,) * 3 + (1e-3,) * 3  # [m] and [rad] that a measuring frame goes over a set
_GROWTH = 1e-4  # share by which an arm grows over a set
_PER_FRAME = {"screen": "screen", "frame": "reference", "places": "reference"}


@dataclass(frozen=True)
class Moved:
    """By how much more a channel reads per unit of a term, (n, k), and how that changes with what it would read without, (n, k, k)."""

    term: RigTerm
    column: Matrix
    slope: Array3 | None = None


def courses_of(data: Measurements) -> dict[str, Course]:
    """What goes on while some poses are measured."""
    found = {"time": Course.of(data.clock, "" if data.timed else data.series)}
    found |= {"temperature": None if data.temperature is None else Course.of(data.temperature)}
    return {name: course for name, course in found.items() if course is not None}


def progress(data: Measurements, courses: Mapping[str, Course]) -> dict[str, Vector]:
    """How far each course is at some poses, (n,); in its midst where that is not known of them."""
    values, found = {"time": data.clock, "temperature": data.temperature}, {}
    for name, course in courses.items():
        own = values[name] if name != "time" or _same_clock(course, data) else None
        found[name] = np.zeros(len(data)) if own is None else np.clip(course.at(own), -1.0, 1.0)
    return found


def _same_clock(course: Course, data: Measurements) -> bool:
    """Whether some poses count their time as a course does: in seconds, or in poses of one file."""
    return course.series == data.series if course.series else data.timed


def disturbances(sensor: Sensor, view: View, look: Look, at: Mapping[str, Vector]) -> Iterator[Moved]:
    """Everything that may move what a sensor reads at some poses.

    Args:
        sensor: What reads.
        view: What it looks at.
        look: What it makes of that.
        at: Progress of each course, (n,).
    """
    for own in sensor.disturbances(view):
        for number, (name, sigma) in enumerate(zip(own.names, own.sigma, strict=True)):
            yield Moved(RigTerm(f"{own.what}.{name}", own.unit, sigma), own.columns[:, :, number], own.slopes[:, number])
    frame, twists = _PER_FRAME[sensor.seen_from], _of_frame(view, look)
    for what, wave, along, share in _waves(at):
        for number, (name, sigma) in enumerate(zip((*SIX, "length"), (*_FRAME_SIGMA, _GROWTH), strict=True)):
            unit = "" if name == "length" else "m" if number < 3 else "rad"
            yield Moved(RigTerm(f"{what}.{frame}_{name}{wave}", unit, sigma * share), twists[:, :, number] * along[:, None])


def _of_frame(view: View, look: Look) -> Array3:
    """What is read more where the measuring frame moves by each of six twists, or the arm grows, (n, k, 7)."""
    growth = look.jac2[:, :, :3] @ view.p[:, :, None]
    return np.concatenate([-look.jac2, growth], axis=2)


def _waves(at: Mapping[str, Vector]) -> Iterator[tuple[str, str, Vector, float]]:
    """What does it, an ending of the terms' names, how they go over the poses (n,), and how large they are beside a drift."""
    if "temperature" in at:
        yield "temperature", "", at["temperature"], 1.0
    if "time" in at:
        yield "drift", "", at["time"], 1.0
        for wave in range(1, WAVES + 1):
            yield "wander", f"_{wave}", np.cos(np.pi * wave * (at["time"] + 0.5)), 1.0 / wave


def disturbed(rig: Rig, b: Vector, sensor: Sensor, view: View, look: Look, at: Mapping[str, Vector]) -> tuple[Look, Array3]:
    """What a sensor makes of a target in a rig that disturbs it.

    Where the measuring frame moves, what it does to derivatives is left out: it moves by thousandths.

    Args:
        rig: What the rig does.
        b: By how much, (terms,).
        sensor: What reads.
        view: What it looks at.
        look: What it makes of that in a rig that stands still.
        at: Progress of each course, (n,).

    Returns:
        What it makes of it, and by how much more it reads per unit of each term, (n, k, terms).
    """
    n, k = look.residual.shape
    columns, bent = np.zeros((n, k, len(rig.terms))), np.broadcast_to(np.eye(k), (n, k, k)).copy()
    place = {term.name: number for number, term in enumerate(rig.terms)}
    for moved in disturbances(sensor, view, look, at):
        if (number := place.get(moved.term.name)) is not None:
            columns[:, :, number] = _finite(moved.column)
            bent += 0.0 if moved.slope is None else b[number] * _finite(moved.slope)
    by_place = None if look.by_place is None else bent @ look.by_place
    return replace(look, residual=look.residual - columns @ b, jac2=bent @ look.jac2, by_place=by_place), columns


def _finite(numbers: Matrix | Array3) -> Any:
    """The same; a beam that meets no screen is moved nowhere."""
    return np.where(np.isfinite(numbers), numbers, 0.0)
