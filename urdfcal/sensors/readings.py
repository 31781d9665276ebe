"""What one sensor read of one target, pose by pose, and what the robot needs to be seen so: targets, measuring frame, shared places."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from urdfcal.base.errors import ShapeMismatch, UsageError
from urdfcal.base.geometry import DEG, MM, Labels, Mask, Matrix, Vector
from urdfcal.robot.rig import SIX, Grid, Instrument, Instruments, Place, Target
from urdfcal.sensors.registry import SENSORS
from urdfcal.sensors.sensor import Sensor

LENGTH_SIGMA = 0.02 * MM  # of a known length whose accuracy is not stated
LEAST_CAMERA = np.repeat([0.1 * MM, 1e-4], 3)  # [m] and [rad]
USUAL_CAMERA = np.repeat([5 * MM, 0.5 * DEG], 3)


@dataclass(frozen=True)
class Readings:
    """What one sensor read of one target; SI units.

    Attributes:
        sensor: Name of the sensor, a key of `registry.SENSORS`.
        target: The target's name: its link, with `:<label>` behind it where there are several.
        link: The link that it is fixed to.
        values: (n, stored), nan where nothing was read: a spot's y, z [m]; a point's x, y, z [m]; an orientation's unit quaternion
            x, y, z, w; a distance [m]; nothing (0 columns) of touches.
        labels: Which plane or socket was touched, (n,); the empty string for none, and for other sensors.
        sigma: Standard deviation stated with each reading, (n,), nan for none.
        instrument: Name of what it was read with; the empty string where nothing is said.
    """

    sensor: str
    target: str
    link: str
    values: Matrix
    labels: Labels
    sigma: Vector
    instrument: str = ""

    def __post_init__(self) -> None:
        n = len(self.labels)
        if self.values.shape != (n, self.kind.stored) or self.sigma.shape != (n,):
            raise ShapeMismatch(f"readings of {self.target}: values have shape {self.values.shape}, expected ({n}, {self.kind.stored})")
        if np.isinf(self.values).any() or np.isinf(self.sigma).any() or (self.sigma <= 0).any():
            raise ShapeMismatch(f"readings of {self.target} must be finite, and stated standard deviations above zero")

    @property
    def label(self) -> str:
        """What columns and tables call it: the target, with `@<instrument>` behind it where one is named."""
        return f"{self.target}@{self.instrument}" if self.instrument else self.target

    @property
    def kind(self) -> Sensor:
        """How they are read."""
        return SENSORS[self.sensor]

    @property
    def noise(self) -> str:
        """Whose noise they have."""
        return self.kind.noise

    @cached_property
    def seen(self) -> Mask:
        """At which poses there is a reading, (n,)."""
        return self.kind.seen(self.values, self.labels)

    @cached_property
    def measured(self) -> Mask:
        """Which numbers of the residual were read, (n, k)."""
        return self.kind.measured(self.values, self.labels)

    @property
    def numbers(self) -> int:
        """How many numbers were read; an orientation counts as three, and so does the touch of a socket."""
        return int(np.count_nonzero(self.measured))

    def subset(self, rows: Any) -> Readings:
        """Those of some poses."""
        index = np.asarray(rows)
        return replace(self, values=self.values[index], labels=self.labels[index], sigma=self.sigma[index])

    def without(self, poses: Mask) -> Readings:
        """The same as if nothing had been read at some poses, (n,)."""
        if not poses.any():
            return self
        return replace(self, values=np.where(poses[:, None], np.nan, self.values), labels=np.where(poses, "", self.labels))

    @cached_property
    def places(self) -> tuple[Place, ...]:
        """What they have in common over poses and nothing is known of beforehand."""
        return tuple(place for place in self.kind.places(self.target, self.touched) if place.kind == "place")

    @cached_property
    def touched(self) -> tuple[str, ...]:
        """The labels in order of their first pose."""
        return tuple(dict.fromkeys(self.labels[self.labels != ""].tolist()))


def blank_readings(sensor: str, target: str, link: str, poses: int = 0, instrument: str = "") -> Readings:
    """Readings of a sensor that saw nothing at all."""
    values = np.full((poses, SENSORS[sensor].stored), np.nan)
    return Readings(sensor, target, link, values, np.full(poses, ""), np.full(poses, np.nan), instrument)


@dataclass(frozen=True)
class KnownLength:
    """A distance between two places that is known beforehand, [m]."""

    one: str
    other: str
    length: float
    sigma: float = LENGTH_SIGMA


def instruments_of(
    readings: Sequence[Readings],
    reference: str,
    camera: Any = None,
    boards: Mapping[str, Grid] | None = None,
    stations: Mapping[str, str] | None = None,
    lenses: Mapping[str, int] | None = None,
) -> Instruments:
    """Targets, measuring frame and places that some readings need; spots on the screen need none of them.

    Args:
        readings: What was read.
        reference: Link that the measuring frame stands on.
        camera: What pixels were read with.
        boards: Links that are boards, whose targets are labelled by the numbers of corners.
        stations: Links of the instruments that readings name, as far as they are called otherwise; the empty string for the default.
        lenses: Cameras whose lens is refined, with the number of its intrinsics.

    Raises:
        UsageError: a board has no such corner, or a place is met from two instruments.
    """
    beside = [reading for reading in readings if not reading.kind.beam]
    offsets: dict[str, set[str]] = {}
    for reading in beside:
        offsets.setdefault(reading.target, set()).update(reading.kind.offset)
    targets = {reading.target: _target(reading, offsets[reading.target], (boards or {}).get(reading.link)) for reading in beside}
    places = {place.name: place for reading in beside for place in reading.places}
    _require_one_frame(beside)
    names = list(dict.fromkeys(reading.instrument for reading in beside))
    names.sort(key=bool)  # what is seen from the reference link comes first
    links, numbers = stations or {}, {target: number for number, target in enumerate(targets)}
    every = [Instrument(name, links.get(name, name), _placed(beside, name), _aimed(beside, name)) for name in names]
    first, *others = every or [Instrument("", "", False)]
    pairs = dict.fromkeys((numbers[reading.target], names.index(reading.instrument)) for reading in beside)
    before_screen = any(place.kind == "camera" for reading in readings for place in reading.kind.places(reading.target, reading.touched))
    return Instruments(
        tuple(targets.values()),
        (first.link or reference) if first.name else reference,
        first.placed,
        tuple(places.values()),
        _camera_sigma(camera) if before_screen else (),
        name=first.name,
        aimed=first.aimed,
        lenses=tuple((lenses or {}).items()),
        others=tuple(others),
        pairs=tuple(pairs) if others else (),
    )


def _placed(readings: Sequence[Readings], instrument: str) -> bool:
    """Whether any readings are in the frame of an instrument."""
    return any(reading.kind.seen_from == "frame" for reading in readings if reading.instrument == instrument)


def _aimed(readings: Sequence[Readings], instrument: str) -> bool:
    """Whether any lasers are aimed at an instrument."""
    return any(reading.kind.aimed for reading in readings if reading.instrument == instrument)


def _require_one_frame(readings: Sequence[Readings]) -> None:
    """Refuse a place that is met from two instruments, in whose frames it would be two.

    Raises:
        UsageError: names it.
    """
    found: dict[str, Readings] = {}
    for reading in readings:
        for place in reading.places:
            other = found.setdefault(place.name, reading)
            if other.instrument != reading.instrument:
                raise UsageError(
                    f"'{place.name}' is met by {other.label} and by {reading.label}, whose instruments are two; "
                    "give it a label of its own for each"
                )


def _target(readings: Readings, offset: Collection[str], board: Grid | None) -> Target:
    if board is None:
        return Target(readings.target, readings.link, tuple(name for name in SIX if name in offset), aimed=readings.kind.aimed)
    label = readings.target.partition(":")[2]
    if label and not label.isdecimal() and not readings.kind.by_camera:  # a reflector beside the corners
        return Target(readings.target, readings.link, tuple(name for name in SIX if name in offset))
    if not label.isdecimal() or int(label) >= board.corners:
        raise UsageError(
            f"{readings.target}: the board {readings.link} has the corners {readings.link}:0 to {readings.link}:{board.corners - 1}"
            + ("" if readings.kind.by_camera else f"; give something else on its link a label, such as {readings.link}:reflector")
        )
    return Target(readings.target, readings.link, SIX[:3], readings.link, board.at(int(label)))


def _camera_sigma(camera: Any) -> tuple[float, ...]:
    """How well the screen's place in front of a camera is known: by its calibration, but no better than LEAST_CAMERA."""
    covariance = getattr(camera, "screen_covariance", None)
    known = USUAL_CAMERA if covariance is None else np.sqrt(np.diag(covariance))
    return tuple(np.maximum(known, LEAST_CAMERA).tolist())


def known_lengths(stated: Iterable[tuple[str, float]], readings: Sequence[Readings]) -> tuple[KnownLength, ...]:
    """Known distances between sockets from patterns such as `*/0 - */1`: each * stands for the same text on both sides.

    Args:
        stated: Pattern and length [m].
        readings: Whose sockets they are.

    Raises:
        UsageError: a pattern is none, or means no two sockets.
    """
    labels = dict.fromkeys(label for reading in readings if reading.sensor == "socket" for label in reading.touched)
    found = []
    for pattern, length in stated:
        one, dash, other = (part.strip() for part in pattern.partition(" - "))
        if not dash or one.count("*") != other.count("*"):
            raise UsageError(f"sockets.distances_mm: '{pattern}' is not two sockets, such as 'left/0 - left/1' or '*/0 - */1'")
        pairs = [(label, partner) for label in labels if (partner := _partner(label, one, other)) in labels]
        if not pairs:
            raise UsageError(f"sockets.distances_mm: '{pattern}' means no two of the sockets {', '.join(list(labels)[:8]) or '(none)'}")
        found += [KnownLength(f"socket:{label}", f"socket:{partner}", length) for label, partner in pairs]
    return tuple(found)


def _partner(label: str, one: str, other: str) -> str:
    """The label that `other` means where `one` means this label; the empty string where it does not."""
    match = re.fullmatch("(.*)".join(re.escape(part) for part in one.split("*")), label)
    if match is None:
        return ""
    texts = iter(match.groups())
    return "".join(next(texts) if part == "*" else part for part in re.split(r"(\*)", other))
