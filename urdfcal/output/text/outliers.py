"""Outliers as a short table with a count: what was left out or mended, of which laser or target, and how far it was; --json names each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from urdfcal.base.terminal import figures_table, rounded, titled
from urdfcal.calibration.outliers import Outlier
from urdfcal.calibration.result import FitResult
from urdfcal.sensors.measurements import Measurements

if TYPE_CHECKING:
    from rich.console import RenderableType

COLUMNS = ("why", "number", "median mm", "farthest mm", "farthest pose")
_WHY = {"far": "far off", "missed": "misses the screen", "exchanged": "exchanged"}


@dataclass(frozen=True)
class OutlierGroup:
    """Outliers of one laser or target, for one reason.

    Attributes:
        name: Laser link, or target.
        why: In two words.
        number: How many there are.
        median, farthest: Distance from where the calibrated robot has them, [mm]; None where they have none, or it is no length.
        pose: Where the farthest is, or the first.
    """

    name: str
    why: str
    number: int
    median: float | None
    farthest: float | None
    pose: str

    def cells(self) -> tuple[str, ...]:
        """Its row of the table."""
        lengths = ("" if length is None else f"{rounded(length, 3)}" for length in (self.median, self.farthest))
        return (self.name, self.why, str(self.number), *lengths, self.pose)


def outlier_groups(outliers: Sequence[Outlier]) -> list[OutlierGroup]:
    """Outliers by laser or target and by reason, in the order in which they come."""
    groups: dict[tuple[str, str], list[Outlier]] = {}
    for outlier in outliers:
        groups.setdefault((outlier.laser, outlier.kind), []).append(outlier)
    return [_group(name, kind, own) for (name, kind), own in groups.items()]


def _group(name: str, kind: str, own: Sequence[Outlier]) -> OutlierGroup:
    far = max(own, key=lambda outlier: outlier.distance_mm or 0.0)
    lengths = [outlier.distance_mm for outlier in own if outlier.distance_mm is not None]
    median, farthest = (float(np.median(lengths)), max(lengths)) if lengths else (None, None)
    return OutlierGroup(name, _WHY[kind], len(own), median, farthest, far.pose)


def outlier_blocks(calibration: FitResult) -> list[RenderableType]:
    """For people: both tables, and where readings that the fit could not explain lie together."""
    measured = calibration.read
    blocks = _table(fit_heading(calibration), calibration.outliers, measured.source)
    if calibration.together:
        blocks += ["", together_words(calibration)]
    if calibration.test_outliers:
        tested = calibration.test_data or measured
        blocks += _table(test_heading(calibration), calibration.test_outliers, tested.source)
    return blocks


def fit_heading(calibration: FitResult) -> str:
    """What was left out of the fit, and of how many."""
    read = readings_of(calibration.read)
    return f"Left out of the fit and of its figures, or mended, as outliers: {len(calibration.outliers)} of {read} readings"


def test_heading(calibration: FitResult) -> str:
    """Which test readings are gross outliers, and what is made of them."""
    lost = sum(outlier.kind == "missed" for outlier in calibration.test_outliers)
    missing = f", {lost} of them without a distance" if lost else ""
    return (
        f"Gross outliers among the test readings: {len(calibration.test_outliers)}{missing}; they are in the figures of the test poses, "
        "and left out of the trimmed ones"
    )


def together_words(calibration: FitResult) -> str:
    """Where readings that the fit cannot explain lie together."""
    return (
        f"Readings that the fit cannot explain lie together ({'; '.join(calibration.together)}), as bad readings do not: look for a wrong "
        "model, or for a rig that moved"
    )


def readings_of(data: Measurements) -> int:
    """How many readings were made."""
    return sum(int(np.count_nonzero(reading.measured.any(axis=1))) for reading in data.readings)


def short_pose(pose: str, source: str) -> str:
    """The pose without the folder of its file."""
    return pose.removeprefix(source.removesuffix(source.replace("\\", "/").rpartition("/")[2]))


def _table(heading: str, outliers: Sequence[Outlier], source: str) -> list[RenderableType]:
    if not outliers:
        return []
    table = figures_table("laser or target")
    for column, name in enumerate(COLUMNS):
        table.add_column(name, justify="right" if 0 < column < len(COLUMNS) - 1 else "left")
    for group in outlier_groups(outliers):
        *cells, pose = group.cells()
        table.add_row(*cells, short_pose(pose, source))
    return ["", titled(heading, table)]
