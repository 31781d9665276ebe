"""How far measurements and predictions are apart, in the units that people read."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from urdfcal.base.geometry import Vector
from urdfcal.base.terminal import rounded
from urdfcal.estimation.residual import Linearisation
from urdfcal.sensors.sensor import MAIN_UNIT, UNITS


@dataclass(frozen=True)
class SpotErrors:
    """How far measurements and predictions of one laser, or one target, are apart.

    Attributes:
        mean, std, max: Of the distances, in `unit`.
        n: How many there are.
        unit: `mm`, `deg` or `px`.
    """

    mean: float
    std: float
    max: float
    n: int
    unit: str = "mm"

    def entry(self) -> dict[str, float | int]:
        """For machines: mean_mm, std_mm, max_mm and n."""
        return {f"mean_{self.unit}": self.mean, f"std_{self.unit}": self.std, f"max_{self.unit}": self.max, "n": self.n}


SpotTable = dict[str, SpotErrors]


def error_table(linearisation: Linearisation, poses: int) -> SpotTable:
    """Distances between measured and predicted spots, points and orientations; what was never measured is left out.

    Args:
        linearisation: Residual of the poses at some state.
        poses: How many there are; rows behind them (known lengths) are no measurements.
    """
    distances: dict[tuple[str, str], list[Vector]] = {}
    for block in linearisation.blocks:
        measured = linearisation.measured[:poses, block.columns]
        distance = np.linalg.norm(linearisation.residual[:poses, block.columns], axis=1)[measured.any(axis=1)] / UNITS[block.unit]
        distances.setdefault((block.name, block.unit), []).append(distance)
    whole = {key: np.concatenate(each) for key, each in distances.items()}
    return {
        name: SpotErrors(float(own.mean()), float(own.std()), float(own.max()), len(own), unit)
        for (name, unit), own in whole.items()
        if len(own)
    }


def main_unit(table: SpotTable) -> str:
    """`mm`, or the first row's unit where nothing is in mm."""
    units = [row.unit for row in table.values()]
    return units[0] if units and MAIN_UNIT not in units else MAIN_UNIT


def rms_in_words(table: SpotTable) -> str:
    """The same with its unit: `0.31 mm`."""
    return f"{rounded(rms_of(table), 4)} {main_unit(table)}"


def rms_of(table: SpotTable, unit: str = "") -> float:
    """Root mean square of the distances over all lasers or targets, in the main unit unless another is named."""
    unit = unit or main_unit(table)
    rows = [row for row in table.values() if row.unit == unit]
    count = sum(row.n for row in rows)
    return float(np.sqrt(sum(row.n * (row.mean**2 + row.std**2) for row in rows) / max(count, 1)))
