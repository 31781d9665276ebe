"""Which of many mistakes is named, however they are looked at."""

from __future__ import annotations

from dataclasses import dataclass

import pytest

from urdfcal.calibration.start.hypotheses import Bounds, MistakeFit, named_mistake
from urdfcal.calibration.start.mistakes import MEND, UNTOUCHED, Mistake

BOUNDS = Bounds(least=1.0, most=10.0)


@dataclass(frozen=True)
class Looked:
    """What looks at a mistake have found."""

    undone: str
    left: float
    scale: float
    pull: float = 0.0
    credible: bool = True
    way_out: str = MEND

    def judged(self) -> MistakeFit:
        mistake = Mistake(self.undone, UNTOUCHED.change, self.way_out)
        return MistakeFit(mistake, self.scale, lambda _: self.pull, self.credible)


STANDS = Looked("", left=100.0, scale=60.0)


def test_the_one_that_asks_least_is_named_with_what_is_no_worse() -> None:
    """Of mistakes that leave about as little over the cheapest is named, those hardly dearer beside it, others not at all."""
    dear, cheap, near = Looked("dear", 1, 1.0, pull=9.0), Looked("cheap", 2, 1.3, pull=2.0), Looked("near", 3, 1.2, pull=5.0)
    found = named_mistake([dear, cheap, near, Looked("poor", 4, 7.0)], STANDS, BOUNDS)
    assert found is not None
    assert (found.undone, found.instead, found.factor) == ("cheap", "near", pytest.approx(60 / 1.3))


def test_what_was_said_of_a_set_up_goes_before_what_was_measured() -> None:
    """Measurements are not mended where what was said of the set-up explains them as well."""
    found = named_mistake([Looked("mended", 1, 1.0), Looked("set-up", 1, 1.1, pull=1.0, way_out="say so")], STANDS, BOUNDS)
    assert found is not None
    assert (found.undone, found.instead, found.way_out) == ("set-up", "", "say so")


@pytest.mark.parametrize(
    ("tried", "stands"),
    [
        (Looked("far", 1, 11.0), STANDS),
        (Looked("mad", 1, 1.0, credible=False), STANDS),
        (Looked("little", 1, 2.0), Looked("", 7.9, 7.9)),
        (Looked("no better than what is odd", 1, 2.0), Looked("", 90.0, 1.0, credible=False)),
    ],
    ids=lambda each: each.undone or "as it stands",
)
def test_nothing_is_named_that_explains_too_little(tried: Looked, stands: Looked) -> None:
    """What leaves too much over, believes what nobody would, is hardly better, or worse than something odd that is no mistake."""
    assert named_mistake([tried], stands, BOUNDS) is None
