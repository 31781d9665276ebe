"""What a rig may do to the readings of one channel: its instruments, and the frame that it measures in, which drifts.

The measuring frame that moves by a twist [v, w] in its own axes moves what is read by -Jac2 [v, w]; an arm whose lengths all grow by a
share moves the target by that share of its place. Drift goes with time, or with the order of the poses where no time is said; what
wanders without a direction is a sum of waves over that time, each of which is smaller than the one before (a Brownian path's series).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from urdfcal.base.geometry import MM, Array3, Matrix, Vector
from urdfcal.model.rig_terms import Course, Rig, RigTerm
from urdfcal.robot.rig import SIX
from urdfcal.sensors.measurements import Measurements
from urdfcal.sensors.sensor import Disturbance, Look, Sensor, View

WAVES = 6
_FRAME_SIGMA = (1 * MM,) * 3 + (1e-3,) * 3  # [m] and [rad] that a measuring frame goes over a set
_GROWTH = 1e-4  # share by which an arm grows over a set
_NAMES, FRAME_SIGMAS, _UNITS = (*SIX, "length"), (*_FRAME_SIGMA, _GROWTH), ("m",) * 3 + ("rad",) * 3 + ("",)
_WAYS = len(_NAMES)
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
        for number, term in enumerate(terms_of(own)):
            yield Moved(term, own.columns[:, :, number], own.slopes[:, number])
    twists, waves = of_frame(view, look), waves_of(at)
    for number, term in enumerate(frame_terms(sensor, waves)):
        yield Moved(term, twists[:, :, number % _WAYS] * waves[number // _WAYS].along[:, None])


def terms_of(own: Disturbance) -> list[RigTerm]:
    """The numbers of what an instrument may do."""
    return [RigTerm(f"{own.what}.{name}", own.unit, sigma) for name, sigma in zip(own.names, own.sigma, strict=True)]


def frame_terms(sensor: Sensor, waves: Sequence[Wave]) -> list[RigTerm]:
    """The numbers of the frame that a sensor measures in: for every wave six twists, and how far the arm grows."""
    frame, ways = _PER_FRAME[sensor.seen_from], [*zip(_NAMES, FRAME_SIGMAS, _UNITS, strict=True)]
    return [RigTerm(f"{wave.what}.{frame}_{name}{wave.ending}", unit, sigma * wave.share) for wave in waves for name, sigma, unit in ways]


def of_frame(view: View, look: Look) -> Array3:
    """What is read more where the measuring frame moves by each of six twists, or the arm grows, (n, k, 7)."""
    growth = look.jac2[:, :, :3] @ view.p[:, :, None]
    return np.concatenate([-look.jac2, growth], axis=2)


@dataclass(frozen=True)
class Wave:
    """How something goes over the poses.

    Attributes:
        what: What does it.
        ending: Of the terms' names.
        along: By how much it is there, (n,).
        share: How large it is beside a drift.
    """

    what: str
    ending: str
    along: Vector
    share: float = 1.0


def waves_of(at: Mapping[str, Vector]) -> list[Wave]:
    """What goes on while some poses are measured, and how."""
    found = [Wave("temperature", "", at["temperature"])] if "temperature" in at else []
    if "time" in at:
        found.append(Wave("drift", "", at["time"]))
        along = np.cos(np.pi * np.arange(1, WAVES + 1)[:, None] * (at["time"] + 0.5))
        found += [Wave("wander", f"_{number}", own, 1.0 / number) for number, own in enumerate(along, start=1)]
    return found


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
