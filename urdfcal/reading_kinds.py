"""What kinds of readings there are: how each is called, in which unit people read it, and how noisy it is before anything is known."""

from __future__ import annotations

from dataclasses import dataclass

from urdfcal.geometry import DEG, MM

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
