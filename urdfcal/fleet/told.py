"""What is said of a fleet as a whole: the same words in the terminal and on the page."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from urdfcal.base.terminal import displayed, many, rounded, value_and_sigma
from urdfcal.fleet.outcome import USES, Outcome, units_of
from urdfcal.fleet.prior import FleetPrior


def counted(outcomes: Sequence[Outcome], among: Sequence[str] = tuple(USES)) -> str:
    """How many of each verdict: `3 can be used, 1 failed`."""
    counts = {use: sum(own.use == use for own in outcomes) for use in among}
    return ", ".join(f"{count} {USES[use]}" for use, count in counts.items() if count)


def opening(outcomes: Sequence[Outcome]) -> list[str]:
    """Verdicts, and how far off predictions are before and after."""
    said, good = [f"{many(len(outcomes), 'robot')}: {counted(outcomes)}"], [own for own in outcomes if own.result]
    for unit in units_of(good) if good else ():
        before, after = (np.array([own.mean(when, unit) for own in good]) for when in ("before", "after"))
        said.append(
            f"mean distance from measured to predicted, over robots: median {_number(np.nanmedian(before))} {unit} before and "
            f"{_number(np.nanmedian(after))} {unit} after; the worst {_number(np.nanmax(before))} and {_number(np.nanmax(after))} {unit}"
        )
    return said


def _number(value: float) -> str:
    return rounded(float(value), 3)


def shared_words(priors: Sequence[FleetPrior]) -> list[str]:
    """What all robots of a model share, and what is to be done about it."""
    return [f"{said}: the description is off there, and not each of them; mend it" for prior in priors for said in shared_of(prior)]


def shared_of(prior: FleetPrior) -> list[str]:
    """`all 12 robots share elbow_joint.d_a +1.02 ± 0.03 mm`, for each."""
    of = f" of {prior.model}" if prior.model else ""
    found = []
    for own in prior.shared:
        unit, size = displayed(own.unit)
        found.append(f"all {len(prior.gains)} robots{of} share {own.name} {value_and_sigma(own.value / size, own.sigma / size)} {unit}")
    return found
