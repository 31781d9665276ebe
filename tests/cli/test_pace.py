"""How fast a long work goes, and how long it will take."""

from __future__ import annotations

import pytest

from urdfcal.base.progress import counted, listening
from urdfcal.cli.pace import Logged, Pace


class Clock:
    """A time that stands still."""

    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        """What time it is, [s]."""
        return self.now


@pytest.mark.parametrize(
    ("total", "each", "steps", "said"),
    [
        (1000, 0.25, 40, "robot 40 of 1000, 240 a minute, about 4 min left"),
        (100, 0.25, 40, "robot 40 of 100, 240 a minute, about 15 s left"),
        (1000, 12.0, 2, "robot 2 of 1000, 5.0 a minute, about 3 h 20 min left"),
        (3, 1.0, 3, "robot 3 of 3, 60 a minute"),
        (3, 1.0, 0, "robot 0 of 3"),
    ],
)
def test_rate_and_time_to_go_are_those_of_the_steps(total: int, each: float, steps: int, said: str) -> None:
    """A minute's steps, and what is left at that speed, as people say it."""
    clock = Clock()
    pace = Pace("robot", total, clock)
    for _ in range(steps):
        clock.now += each
        pace.step()
    assert pace.words() == said


def test_what_was_done_before_does_not_count_for_long() -> None:
    """After 500 robots of an earlier run, which come at once, the rate is soon that of those that are fitted."""
    clock = Clock()
    pace = Pace("robot", 1000, clock)
    for robot in range(750):
        clock.now += 0.0 if robot < 500 else 2.0
        pace.step()
    assert pace.words() == "robot 750 of 1000, 30 a minute, about 8 min left"


def test_a_log_has_a_line_now_and_then_of_the_outermost() -> None:
    """After ten seconds, then every half minute, not at the end; of what is counted inside nothing."""
    clock, heard = Clock(), list[str]()
    with listening(Logged(heard.append, clock)), counted("robot", 80) as advance:
        for _ in range(80):
            with counted("sweep", 10) as inside:
                clock.now += 1.0
                inside()
            advance()
    assert heard == [f"robot {done} of 80, 60 a minute, about {left} left" for done, left in ((10, "1 min"), (40, "40 s"), (70, "10 s"))]
