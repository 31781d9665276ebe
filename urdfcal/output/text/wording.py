"""What people are told things are called: laser spots on a screen have words of their own."""

from __future__ import annotations

from dataclasses import dataclass

from urdfcal.sensors.measurements import Measurements


@dataclass(frozen=True)
class Wording:
    """Words for what was measured.

    Attributes:
        one: A reading, as the verdict calls it.
        several: Readings, where there are combinations to tell apart.
        used: Readings that were used.
        title: Of the section about them.
        intro: What its table gives.
        note: What else there is to know of it.
        source: Heading of the column of lasers or targets.
        count: Heading of the column of numbers.
        units: Whether that heading has to state the unit.
        limit: What makes a reading a suspect, with room for the limit, the spread and what else the latter covers.
    """

    one: str
    several: str
    used: str
    title: str
    intro: str
    note: str
    source: str
    count: str
    units: bool
    limit: str


_SPOTS = Wording(
    one="spot",
    several="spots",
    used="spots",
    title="Spots on the screen",
    intro="Distance from measured to predicted spot, in mm",
    note="",
    source="laser",
    count="spots",
    units=False,
    limit="residual is more than {limit:.2g} standard deviations long, where one standard deviation is {spread:.2f} times what "
    "noise{uncertain} would do.",
)
_READINGS = Wording(
    one="measurement",
    several="measurements",
    used="readings",
    title="What was measured",
    intro="Distance from measured to predicted",
    note=" Before, too, frames and targets stand where they suit that robot best.",
    source="what",
    count="number",
    units=True,
    limit="residual is longer than chance makes one in ten reports, judged by how long the residuals of its kind usually are.",
)


def wording_of(data: Measurements) -> Wording:
    """The words for some measurements."""
    return _SPOTS if data.only_spots else _READINGS
