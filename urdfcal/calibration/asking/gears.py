"""Harmonics of gears: waves over a joint's angle, looked for at every whole number of cycles a turn."""

from __future__ import annotations

from functools import cached_property

import numpy as np
import numpy.typing as npt

from urdfcal.base.geometry import Mask, Matrix
from urdfcal.calibration.asking.ground import Ground
from urdfcal.calibration.asking.questions import Answer
from urdfcal.estimation.score import Fitted
from urdfcal.model.softness import GEAR

CYCLES = np.arange(3, 201)  # a turn of the joint; one and two are eccentricity
_ROWS = 2000


class Gears:
    """The gears of all turning joints that were read."""

    def __init__(self, ground: Ground) -> None:
        self.ground = ground

    @cached_property
    def _stride(self) -> int:
        """Of the rows that waves are looked for in: as many as there are would take all memory, and tell no more of which it is."""
        return -(-self.ground.rows // _ROWS)

    @cached_property
    def _waves(self) -> list[tuple[Matrix, Matrix]]:
        """Sin and cos of each joint's angle times CYCLES, (rows, cycles): powers of exp(i q)."""
        found = []
        for _, q in self.ground.turning:
            wanted = _powers(np.exp(1j * q[:: self._stride]), int(CYCLES[-1]))[CYCLES[0] - 1 :]
            found.append((np.ascontiguousarray(wanted.imag).T, np.ascontiguousarray(wanted.real).T))
        return found

    def answer(self, fitted: Fitted, cycles: Mask) -> Answer | None:
        """The best harmonic of any joint's gear, of some CYCLES."""
        rows, best, count = self.ground.rows, None, np.count_nonzero(cycles)
        columns = self.ground.own_turns * GEAR
        fitted = fitted.thinned(rows, self._stride) if self._stride > 1 else fitted
        for (joint, q), column, waves in zip(self.ground.turning, columns.T, self._waves if count else (), strict=bool(count)):
            one, other = waves if cycles.all() else (own[:, cycles] for own in waves)
            pairs = fitted.asked_in_pairs(column.reshape(rows, -1)[:: self._stride].ravel(), one, other)
            score, gain = pairs.score(pairs.best), -float(np.log(count * columns.shape[1]))
            if best is None or gain + score.gain > best.gain:
                turns = int(CYCLES[cycles][pairs.best])
                wave = np.stack([np.sin(turns * q), np.cos(turns * q)], axis=1) * score.size
                B = (column.reshape(rows, -1, 1) * wave[:, None]).reshape(-1, 2)
                best = Answer("harmonics", joint, gain + score.gain, B, cycles=turns, share=score.explained)
        return best


def _powers(z: npt.NDArray[np.complex128], count: int) -> npt.NDArray[np.complex128]:
    """z, z^2, z^3 ... of numbers (n,), (count, n): as many again from those that there are, times the last of them."""
    powers, known = np.empty((count, len(z)), dtype=complex), 1
    powers[0] = z
    while known < count:
        more = min(known, count - known)
        np.multiply(powers[:more], powers[known - 1], out=powers[known : known + more])
        known += more
    return powers
