"""The sentence that stands behind the verdict, in the terminal and in every report alike: how far off readings were, and are."""

from __future__ import annotations

import math

from urdfcal.base.terminal import rounded
from urdfcal.calibration.error_table import SpotTable
from urdfcal.calibration.result import FitResult
from urdfcal.output.text.wording import wording_of


def headline(calibration: FitResult) -> str:
    """Say how far off readings were on average, and are: `The spots lay 99 mm off on average; after calibration 1.3 mm.`."""
    before, after = means(calibration.before), means(calibration.after)
    tested = calibration.test[1] if calibration.test else {}
    test = f" ({means(tested)} on test poses, which were not fitted)" if tested else ""
    return f"The {wording_of(calibration.data).one}s lay {before} off on average; after calibration {after}{test}."


def rough(value: float) -> str:
    """A figure for a sentence: two digits that count."""
    return "an unknown number of" if not math.isfinite(value) else f"{value:.0f}" if abs(value) >= 9.95 else rounded(value, 2)


def means(table: SpotTable) -> str:
    """Mean distance over all lasers or targets, for each unit: `1.3 mm`, `0.45 mm and 0.06 deg`."""
    words = []
    for unit in dict.fromkeys(row.unit for row in table.values()):
        rows = [row for row in table.values() if row.unit == unit]
        words.append(f"{rough(sum(row.n * row.mean for row in rows) / max(sum(row.n for row in rows), 1))} {unit}")
    return " and ".join(words) or "0 mm"
