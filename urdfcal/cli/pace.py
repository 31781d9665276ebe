"""How fast a long work goes, and how long it will take, as people say it."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable

_WINDOW = 200  # steps over which speed is taken: those of an earlier run come at once, and must not count for long
_FIRST, _EVERY = 10.0, 30.0  # [s] after which a log is told of it, and how often


class Pace:
    """Steps as they are done.

    Attributes:
        total: How many there will be.
        done: How many there were.
    """

    def __init__(self, what: str, total: int, now: Callable[[], float] = time.monotonic) -> None:
        self.what, self.total, self.done, self._now = what, total, 0, now
        self._times = deque([now()], maxlen=_WINDOW + 1)

    def step(self) -> None:
        """One more is done."""
        self.done += 1
        self._times.append(self._now())

    @property
    def a_second(self) -> float:
        """How many; zero before the first."""
        since = self._now() - self._times[0]
        return (len(self._times) - 1) / since if since > 0 else 0.0

    @property
    def rate(self) -> str:
        """`214 a minute`; empty before the first."""
        a_minute = 60 * self.a_second
        return f"{a_minute:.{0 if a_minute >= 10 else 1}f} a minute" if self.done else ""

    @property
    def left(self) -> str:
        """`about 3 min left`; empty where nobody knows, or nothing is left."""
        rest = self.total - self.done
        return f"about {_spoken(rest / self.a_second)} left" if rest and self.a_second else ""

    def words(self) -> str:
        """`robot 120 of 1000, 214 a minute, about 4 min left`."""
        return ", ".join(filter(None, (f"{self.what} {self.done} of {self.total}", self.rate, self.left)))


class Logged:
    """The same for a log: a line now and then of what is counted outermost."""

    def __init__(self, tell: Callable[[str], None], now: Callable[[], float] = time.monotonic) -> None:
        self._tell, self._now, self._inside = tell, now, 0

    def begin(self, what: str, total: int | None) -> Callable[[], None]:
        """Hear that something is counted; what is given back is called after each."""
        pace, due, outermost = Pace(what, total or 0, self._now), self._now() + _FIRST, not self._inside
        self._inside += 1

        def advance() -> None:
            nonlocal due
            pace.step()
            if outermost and self._now() >= due and pace.done < pace.total:
                due = self._now() + _EVERY
                self._tell(pace.words())

        return advance

    def end(self, advance: Callable[[], None]) -> None:
        """Hear that it is done."""
        self._inside -= 1


def _spoken(seconds: float) -> str:
    if seconds < 55:
        return f"{max(5, 5 * round(seconds / 5))} s"
    minutes = max(1, round(seconds / 60))
    return f"{minutes} min" if minutes < 60 else f"{minutes // 60} h {minutes % 60} min"
