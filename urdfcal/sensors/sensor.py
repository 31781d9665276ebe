"""What kinds of readings there are: how each is called, in which unit people read it, and how noisy it is before anything is known."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Protocol

from urdfcal.base.geometry import DEG, MM, Array3, Matrix

UNITS = {"mm": MM, "deg": DEG, "px": 1.0}


@dataclass(frozen=True)
class ReadingKind:
    """One kind of reading.

    Attributes:
        one, several: What it is called.
        noise: What its noise is called.
        unit: In which people read it: a key of UNITS.
        start_sigma: Standard deviation of a number of it before any is known, in that unit.
        most: The same that no instrument exceeds, in that unit.
    """

    one: str
    several: str
    noise: str
    unit: str
    start_sigma: float
    most: float

    @property
    def size(self) -> float:
        """The unit in SI, [m], [rad] or [px]."""
        return UNITS[self.unit]

    def told(self, sigma: float) -> str:
        """A standard deviation in SI as `0.28 mm`."""
        return f"{sigma / self.size:.3g} {self.unit}"


KINDS = {
    "spot": ReadingKind("spot", "spots", "spot noise", "mm", 1.0, float("inf")),  # the screen may be far away
    "point": ReadingKind("point", "points", "point noise", "mm", 0.5, 20.0),
    "orientation": ReadingKind("orientation", "orientations", "orientation noise", "deg", 0.05, 5.0),
    "distance": ReadingKind("distance", "distances", "distance noise", "mm", 0.5, 20.0),
    "plane": ReadingKind("touch of a plane", "touches of planes", "noise across planes", "mm", 0.5, 10.0),
    "socket": ReadingKind("touch of a socket", "touches of sockets", "socket noise", "mm", 0.5, 10.0),
    "pixel": ReadingKind("spot or target in a picture", "spots or targets in pictures", "pixel noise", "px", 0.3, 20.0),
}


def start_sigma_of(kind: str) -> float:
    """Noise of a kind before any is known, [m], [rad] or [px]."""
    return KINDS[kind].start_sigma * KINDS[kind].size


def noun(kind: str, count: int = 2) -> str:
    """What one reading of a kind is called, or several."""
    return KINDS[kind].one if count == 1 else KINDS[kind].several


@dataclass(frozen=True)
class View:
    """A target as a measuring frame sees it.

    Attributes:
        p: Its origin, (n, 3), [m].
        R: Its axes, (n, 3, 3).
        place: Numbers of the place that each pose refers to, (n, a).
        axes: For planes: nominal normal and two tangents of each pose's plane as columns, (n, 3, 3).
    """

    p: Matrix
    R: Array3
    place: Matrix
    axes: Array3


@dataclass(frozen=True)
class Look:
    """What a sensor makes of it.

    Attributes:
        residual: m - h, (n, k).
        jac2: Derivative of h by the target's twist, (n, k, 6).
        by_place: Derivative of h by the place's numbers, (n, k, a).
    """

    residual: Matrix
    jac2: Array3
    by_place: Array3


class TargetSensor(Protocol):
    """What is read of a target: a new kind of measurement is one more of these.

    Attributes:
        numbers: How many numbers a reading has, k.
        unit: In which tables give its errors.
        title: What tables call it behind the target's name.
    """

    numbers: ClassVar[int]
    unit: ClassVar[str]
    title: ClassVar[str]

    def look(self, view: View, values: Matrix) -> Look:
        """Residual and derivatives at one state."""
