"""Readings as data: what was seen, what poses share, known lengths by pattern."""

from __future__ import annotations

import re

import numpy as np
import pytest

from urdfcal.base.errors import ShapeMismatch, UsageError
from urdfcal.robot.rig import SIX, Place, Target
from urdfcal.sensors.readings import KnownLength, Readings, instruments_of, known_lengths
from urdfcal.sensors.registry import SENSORS


def reading(kind: str, values: object = None, labels: object = None, target: str = "tool", sigma: object = None) -> Readings:
    table = np.empty((len(labels), 0)) if values is None else np.array(values, dtype=float)  # type: ignore[arg-type]
    n = len(table)
    names = np.full(n, "") if labels is None else np.array(labels, dtype=str)
    return Readings(kind, target, target.partition(":")[0], table, names, np.full(n, np.nan) if sigma is None else np.array(sigma))


NAN = np.nan
POINTS = reading("point", [[1, 2, 3], [NAN, NAN, NAN], [1, NAN, 3]])
TURNS = reading("orientation", [[0, 0, 0, 1], [NAN] * 4, [0, 0, 1, 0]])
WIRE = reading("distance", [[1.0], [NAN], [2.0]], target="tool:bar")
PLANES = reading("plane", labels=["a", "", "b"])
SOCKETS = reading("socket", labels=["2", "1", "2"], target="tool:ball")


@pytest.mark.parametrize(
    ("own", "seen", "numbers"),
    [(POINTS, [1, 0, 1], 5), (TURNS, [1, 0, 1], 6), (WIRE, [1, 0, 1], 2), (PLANES, [1, 0, 1], 2), (SOCKETS, [1, 1, 1], 9)],
    ids=lambda own: own.sensor if isinstance(own, Readings) else "",
)
def test_what_was_seen_is_counted(own: Readings, seen: list[int], numbers: int) -> None:
    """A pose counts if anything of it was read; an orientation has three numbers, a plane one, a socket three."""
    assert own.seen.tolist() == [bool(one) for one in seen]
    assert own.numbers == numbers
    assert own.subset([2]).seen.tolist() == [True]
    assert own.subset(np.array([False, True, False])).numbers in (0, 3)


def test_places_are_named_in_the_order_in_which_they_are_touched() -> None:
    """A wire has an end, a plane two tilts and an offset, a socket a point; a point has none."""
    assert POINTS.places == TURNS.places == ()
    assert WIRE.places == (Place("tool:bar:wire", ("x", "y", "z"), ("m", "m", "m")),)
    assert [place.name for place in PLANES.places] == ["plane:a", "plane:b"]
    assert PLANES.places[0].names == ("tilt_1", "tilt_2", "offset")
    assert PLANES.places[0].units == ("rad", "rad", "m")
    assert [place.name for place in SOCKETS.places] == ["socket:2", "socket:1"]


def test_instruments_follow_from_the_readings() -> None:
    """Targets are whole where an orientation was read; a measuring frame is there where something is seen from it."""
    found = instruments_of([POINTS, TURNS, WIRE, PLANES, SOCKETS], "base")
    assert found.targets == (Target("tool", "tool", SIX), Target("tool:bar", "tool"), Target("tool:ball", "tool"))
    assert (found.reference, found.placed) == ("base", True)
    assert [place.name for place in found.places] == ["tool:bar:wire", "plane:a", "plane:b", "socket:2", "socket:1"]
    assert not instruments_of([WIRE, PLANES, SOCKETS], "").placed


@pytest.mark.parametrize("kind", sorted(SENSORS))
def test_shapes_that_do_not_fit_are_refused(kind: str) -> None:
    """Every kind has its own number of columns; infinite values and sigmas that are not above zero are refused."""
    n, k = 2, SENSORS[kind].stored
    with pytest.raises(ShapeMismatch, match=rf"readings of tool: values have shape \(2, {k + 1}\), expected \(2, {k}\)"):
        Readings(kind, "tool", "tool", np.ones((n, k + 1)), np.full(n, "a"), np.full(n, NAN))
    for values, sigma in ((np.full((n, k), np.inf), [1.0, 1.0]), (np.ones((n, k)), [1.0, 0.0]), (np.ones((n, k)), [1.0, -1.0])):
        if k or sigma != [1.0, 1.0]:
            with pytest.raises(ShapeMismatch, match="must be finite, and stated standard deviations above zero"):
                Readings(kind, "tool", "tool", values, np.full(n, "a"), np.array(sigma))


LABELS = ["left/0", "left/1", "right/0", "right/1", "a.b", "x"]


@pytest.mark.parametrize(
    ("pattern", "pairs"),
    [
        ("left/0 - left/1", [("left/0", "left/1")]),
        ("*/0 - */1", [("left/0", "left/1"), ("right/0", "right/1")]),
        ("left/* - right/*", [("left/0", "right/0"), ("left/1", "right/1")]),
        ("a.b - x", [("a.b", "x")]),
        ("  x  -  left/0  ", [("x", "left/0")]),
    ],
)
def test_known_lengths_are_taken_by_pattern(pattern: str, pairs: list[tuple[str, str]]) -> None:
    """A star stands for the same text on both sides, anything else for itself."""
    found = known_lengths([(pattern, 0.05)], [reading("socket", labels=LABELS)])
    assert found == tuple(KnownLength(f"socket:{one}", f"socket:{other}", 0.05) for one, other in pairs)


@pytest.mark.parametrize(
    ("pattern", "message"),
    [
        ("left/0", "'left/0' is not two sockets, such as 'left/0 - left/1' or '*/0 - */1'"),
        ("*/0 - left/1", "'*/0 - left/1' is not two sockets"),
        ("up/0 - up/1", "'up/0 - up/1' means no two of the sockets left/0, left/1, right/0, right/1, a.b, x"),
        ("*/2 - */3", "means no two of the sockets"),
        ("aXb - x", "means no two of the sockets"),
    ],
)
def test_patterns_that_mean_nothing_are_refused(pattern: str, message: str) -> None:
    """The message has the pattern, and what there is."""
    with pytest.raises(UsageError, match=f"^sockets.distances_mm: .*{re.escape(message)}"):
        known_lengths([(pattern, 0.05)], [reading("socket", labels=LABELS)])
    with pytest.raises(UsageError, match=r"(means no two of the sockets \(none\)|is not two sockets)"):
        known_lengths([(pattern, 0.05)], [POINTS])
