"""Which place feeds which number, where the answer is known."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from urdfcal.base.geometry import Matrix
from urdfcal.output.sources.numbers import Expansion
from urdfcal.output.sources.slots import LITERAL, Edit, Slot
from urdfcal.output.sources.tracing import trace

COUNTS = 2  # a place that changes more than numbers


def expansion(values: Matrix, rest: str = "same") -> Expansion:
    return Expansion(values, (rest,), (), {}, {}, {})


@pytest.mark.parametrize("places", [5, 300])
def test_slopes_are_found_whatever_the_number_of_places(places: int) -> None:
    """A random sparse map is found again, from far fewer trials than places; who changes the structure is none of them."""
    rng = np.random.default_rng(0)
    slopes = np.zeros((40, places))
    for number in range(40):
        behind = rng.choice([place for place in range(places) if place != COUNTS], size=rng.integers(0, 4), replace=False)
        slopes[number, behind] = rng.uniform(0.2, 2.0, len(behind))
    slots = [Slot(Path("a"), 10 * place, 10 * place + 1, b"1", LITERAL) for place in range(places)]
    trials = []

    def expand(several: Sequence[Sequence[Edit]]) -> list[Expansion | None]:
        trials.append(len(several))
        found: list[Expansion | None] = []
        for edits in several:
            moved = np.zeros(places)
            for edit in edits:
                moved[edit.start // 10] = float(edit.new) - 1.0
            found.append(expansion(slopes @ moved, "other" if moved[COUNTS] else "same"))
        return found

    traced = trace(slots, expansion(np.zeros(40)), range(40), expand, rng)
    found = np.zeros((40, places))
    for number, its in traced.slopes.items():
        for slot, slope in its.items():
            found[number, traced.slots[slot].start // 10] = slope
    np.testing.assert_allclose(found, slopes, atol=1e-6)
    assert slots[COUNTS] not in traced.slots
    assert sum(trials) < max(places, 20)
