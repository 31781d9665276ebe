"""What instruments beside lasers read, pose by pose: points, orientations, lengths, and touches of places that several poses share."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from urdfcal.base.errors import ShapeMismatch, UsageError
from urdfcal.base.geometry import DEG, MM, Matrix, Vector
from urdfcal.robot.rig import Grid, Instruments, Place, Target

STORED: dict[str, int] = {"point": 3, "orientation": 4, "distance": 1, "plane": 0, "socket": 0, "pixel": 2}
LENGTH_SIGMA = 0.02 * MM  # of a known length whose accuracy is not stated
LEAST_CAMERA = np.repeat([0.1 * MM, 1e-4], 3)  # [m] and [rad]
USUAL_CAMERA = np.repeat([5 * MM, 0.5 * DEG], 3)
SEEN_FROM_FRAME = ("point", "orientation", "pixel")  # what is read in the axes of a measuring frame


@dataclass(frozen=True)
class Readings:
    """What one instrument read of one target; SI units.

    Attributes:
        kind: What is read.
        target: The target's name: its link, with `:<label>` behind it where there are several.
        link: The link that it is fixed to.
        values: (n, k), nan where nothing was read: a point's x, y, z [m]; an orientation's unit quaternion x, y, z, w; a distance [m];
            nothing (k = 0) of touches.
        labels: Which plane or socket was touched, (n,); the empty string for none, and for other kinds.
        sigma: Standard deviation stated with each reading, (n,), nan for none.
    """

    kind: str
    target: str
    link: str
    values: Matrix
    labels: npt.NDArray[np.str_]
    sigma: Vector

    def __post_init__(self) -> None:
        n = len(self.labels)
        if self.values.shape != (n, STORED[self.kind]) or self.sigma.shape != (n,):
            raise ShapeMismatch(f"readings of {self.target}: values have shape {self.values.shape}, expected ({n}, {STORED[self.kind]})")
        if np.isinf(self.values).any() or (self.sigma <= 0).any():
            raise ShapeMismatch(f"readings of {self.target} must be finite, and stated standard deviations above zero")

    @property
    def seen(self) -> npt.NDArray[np.bool_]:
        """At which poses there is a reading, (n,)."""
        touched: npt.NDArray[np.bool_] = np.asarray(self.labels != "", dtype=bool)
        return touched if self.kind in ("plane", "socket") else ~np.asarray(np.isnan(self.values).all(axis=1), dtype=bool)

    @property
    def numbers(self) -> int:
        """How many numbers were read; an orientation counts as three, and so does the touch of a socket."""
        each = {"orientation": 3, "plane": 1, "socket": 3}.get(self.kind)
        return int(np.count_nonzero(~np.isnan(self.values))) if each is None else each * int(self.seen.sum())

    def subset(self, rows: npt.ArrayLike) -> Readings:
        """Those of some poses."""
        index = np.asarray(rows)
        return replace(self, values=self.values[index], labels=self.labels[index], sigma=self.sigma[index])

    def without(self, poses: npt.NDArray[np.bool_]) -> Readings:
        """The same as if nothing had been read at some poses, (n,)."""
        if not poses.any():
            return self
        return replace(self, values=np.where(poses[:, None], np.nan, self.values), labels=np.where(poses, "", self.labels))

    @cached_property
    def places(self) -> tuple[Place, ...]:
        """What this instrument has in common over poses."""
        if self.kind == "distance":
            return (Place(f"{self.target}:wire", ("x", "y", "z"), ("m", "m", "m")),)
        if self.kind == "plane":
            return tuple(Place(f"plane:{label}", ("tilt_1", "tilt_2", "offset"), ("rad", "rad", "m")) for label in self.touched)
        return tuple(Place(f"socket:{label}", ("x", "y", "z"), ("m", "m", "m")) for label in self.touched if self.kind == "socket")

    @cached_property
    def touched(self) -> tuple[str, ...]:
        """The labels in order of their first pose."""
        return tuple(dict.fromkeys(str(label) for label in self.labels if label))


@dataclass(frozen=True)
class KnownLength:
    """A distance between two places that is known beforehand, [m]."""

    one: str
    other: str
    length: float
    sigma: float = LENGTH_SIGMA


def instruments_of(
    readings: Sequence[Readings], reference: str, lasers: Sequence[str] = (), camera: Any = None, boards: Mapping[str, Grid] | None = None
) -> Instruments:
    """Targets, measuring frame and places that some readings need.

    Args:
        readings: What was read.
        reference: Link that the measuring frame stands on.
        lasers: Links whose pixels are those of spots on the screen, and no targets.
        camera: What pixels were read with.
        boards: Links that are boards, whose targets are labelled by the numbers of corners.

    Raises:
        UsageError: a board has no such corner.
    """
    others = [each for each in readings if not (each.kind == "pixel" and each.link in lasers)]
    whole = {each.target for each in others if each.kind == "orientation"}
    targets = {each.target: _target(each, each.target in whole, (boards or {}).get(each.link)) for each in others}
    places = {place.name: place for each in others for place in each.places}
    placed = any(each.kind in SEEN_FROM_FRAME for each in others)
    return Instruments(
        tuple(targets.values()), reference, placed, tuple(places.values()), _camera_sigma(camera) if len(others) < len(readings) else ()
    )


def _target(readings: Readings, whole: bool, board: Grid | None) -> Target:
    if board is None:
        return Target(readings.target, readings.link, whole)
    label = readings.target.partition(":")[2]
    if not label.isdecimal() or int(label) >= board.corners:
        raise UsageError(
            f"{readings.target}: the board {readings.link} has the corners {readings.link}:0 to {readings.link}:{board.corners - 1}"
        )
    return Target(readings.target, readings.link, False, readings.link, board.at(int(label)))


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
    labels = dict.fromkeys(label for each in readings if each.kind == "socket" for label in each.touched)
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
