"""Scales and their ticks."""

from __future__ import annotations

import numpy as np
import pytest

from urdfcal.output.report.plots.scales import Scale, around

SCALES = [Scale(-0.31, 0.27), Scale(0, 1e6), Scale(-3e-9, 1e-9), Scale(0.8, 120, "log"), Scale(1e-4, 1e7, "log"), Scale(0, 5000, "symlog")]


@pytest.mark.parametrize("scale", SCALES)
def test_ticks_are_inside_and_say_where_they_are(scale: Scale) -> None:
    """Between three and twelve or so, each at the value that stands at it."""
    ticks = scale.ticks(6)
    assert 3 <= len(ticks) <= 12
    for value, words in ticks.items():
        assert scale.low - 1e-9 * abs(scale.low) <= value <= scale.high * (1 + 1e-9)
        assert float(words.replace("\u2212", "-")) == pytest.approx(value, rel=1e-6, abs=1e-12)
    assert len(set(ticks.values())) == len(ticks)


@pytest.mark.parametrize("scale", SCALES)
def test_ends_and_order_are_kept(scale: Scale) -> None:
    """The low end is at 0, the high one at 1, and what is larger is farther."""
    shares = scale.share(np.linspace(scale.low, scale.high, 40))
    assert shares[[0, -1]] == pytest.approx([0, 1], abs=1e-12)
    assert (np.diff(shares) > 0).all()


def test_a_decade_is_as_long_as_the_next() -> None:
    """On both logarithmic scales."""
    for kind in ("log", "symlog"):
        lengths = np.diff(Scale(1, 1e4, kind).share(np.array([1.0, 10.0, 100.0])))
        assert lengths[0] == pytest.approx(lengths[1])


def test_sweeps_are_whole() -> None:
    """Whole numbers alone stand at an axis of counts, however short it is."""
    assert list(Scale(-0.3, 2.06, whole=True).ticks(9).values()) == ["0", "1", "2"]


def test_ends_hold_the_finite_values() -> None:
    """With room at both ends; also of one value, and of none."""
    low, high = around(np.array([np.nan, 3.0, -2.0, np.inf]))
    assert low < -2 < 3 < high < 4
    assert around(np.array([5.0]))[0] < 5 < around(np.array([5.0]))[1]
    assert around(np.array([np.nan])) == (0.0, 1.0)
