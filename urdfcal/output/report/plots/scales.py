"""Scales of a picture's axes: where a value stands between the two ends, and where the ticks are."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from urdfcal.base.geometry import Vector
from urdfcal.base.minus import with_minus

Kind = Literal["linear", "log", "symlog"]

_STEPS = (1, 2, 5, 10)
_FEW_DECADES = 3  # with ticks between the powers of ten


@dataclass(frozen=True)
class Scale:
    """One axis.

    Attributes:
        low, high: Its ends.
        kind: `linear`; `log`; `symlog`, which is linear from -1 to 1 and logarithmic beyond.
        whole: Whether ticks stand at whole numbers alone.
    """

    low: float
    high: float
    kind: Kind = "linear"
    whole: bool = False

    def share(self, values: Vector) -> Vector:
        """Where values (n,) stand: 0 at the low end, 1 at the high one."""
        low, high, found = (_forward(np.asarray(each, dtype=float), self.kind) for each in (self.low, self.high, values))
        return np.asarray((found - low) / (high - low))

    def ticks(self, most: int) -> dict[float, str]:
        """What stands at which value; on a linear scale at most so many."""
        values, digits = _linear(self.low, self.high, most, self.whole) if self.kind == "linear" else (self._powers(), 0)
        return {value: with_minus(f"{value:.{digits}f}" if self.kind == "linear" else f"{value:g}") for value in values}

    def _powers(self) -> list[float]:
        low = 1.0 if self.kind == "symlog" else self.low
        first, last = math.floor(math.log10(low)), math.ceil(math.log10(self.high))
        steps = (1, 2, 5) if self.kind == "log" and self.high <= 10**_FEW_DECADES * self.low else (1,)
        every = range(first, last + 1, max((last - first) // 6, 1))
        found = [step * 10.0**power for power in every for step in steps if self.low <= step * 10.0**power <= self.high]
        return [0.0, *found] if self.kind == "symlog" else found


def _forward(values: Vector, kind: Kind) -> Vector:
    if kind == "linear":
        return values
    if kind == "log":
        return np.asarray(np.log10(np.where(values > 0, values, np.nan)))
    return np.asarray(np.sign(values) * np.where(np.abs(values) < 1, np.abs(values), 1 + np.log10(np.maximum(np.abs(values), 1))))


def _linear(low: float, high: float, most: int, whole: bool) -> tuple[list[float], int]:
    """Round values between two ends, and how many decimals they have."""
    rough = (high - low) / max(most - 1, 1)
    decade = 10.0 ** math.floor(math.log10(rough))
    step = next(step * decade for step in _STEPS if step * decade >= rough * (1 - 1e-9))
    step = max(step, 1.0) if whole else step
    first, last = math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9)
    return [number * step for number in range(first, last + 1)], max(0, -math.floor(math.log10(step) + 1e-9))


def around(values: Vector, room: float = 0.05) -> tuple[float, float]:
    """Ends that hold all finite values, with some room on either side; 0 and 1 where there are none."""
    seen = np.asarray(values)[np.isfinite(values)]
    if not seen.size:
        return 0.0, 1.0
    low, high = float(seen.min()), float(seen.max())
    room = room * (high - low) or 0.05 * abs(high) or 1.0
    return low - room, high + room
