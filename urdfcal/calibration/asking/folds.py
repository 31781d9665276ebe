"""Clusters of neighbouring poses, to be left out in turn: random folds see no more than how well a fit interpolates."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from urdfcal.base.geometry import Matrix
from urdfcal.sensors.repeats import first_rows

Rows = npt.NDArray[np.intp]

_FOLDS = 8


def clustered(q: Matrix, configuration_of: Rows) -> list[Rows]:
    """Rows in clusters of neighbouring poses of about equal size: halved where they are spread most, in units of the whole spread.

    Args:
        q: Joint positions, (n, joints).
        configuration_of: Index of the configuration of each row; rows of one stay together.
    """
    spread = np.ptp(q, axis=0)
    scaled = q / np.where(spread > 0, spread, 1.0)
    first = first_rows(configuration_of)
    parts = [np.arange(len(first))]
    while len(parts) < _FOLDS:
        largest = max(range(len(parts)), key=lambda number: len(parts[number]))
        part = parts.pop(largest)
        if len(part) < 2:
            return []
        joint = int(np.argmax(np.ptp(scaled[first[part]], axis=0)))
        order = part[np.argsort(scaled[first[part], joint], kind="stable")]
        parts += [order[: len(order) // 2], order[len(order) // 2 :]]
    return [np.flatnonzero(np.isin(configuration_of, part)) for part in parts]
