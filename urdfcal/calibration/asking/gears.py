"""Harmonics of gears: waves over a joint's angle, looked for at every whole number of cycles a turn."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from urdfcal.base.geometry import Mask, Matrix
from urdfcal.calibration.asking.ground import Ground
from urdfcal.calibration.asking.questions import Answer
from urdfcal.estimation.score import Fitted
from urdfcal.model.softness import GEAR

CYCLES = np.arange(3, 201)  # a turn of the joint; one and two are eccentricity


class Gears:
    """The gears of all turning joints that were read."""

    def __init__(self, ground: Ground) -> None:
        self.ground = ground

    @cached_property
    def _waves(self) -> list[tuple[Matrix, Matrix]]:
        """Sin and cos of each joint's angle times CYCLES, (rows, cycles): powers of exp(i q)."""
        found = []
        for _, q in self.ground.turning:
            powers = np.cumprod(np.repeat(np.exp(1j * q)[:, None], CYCLES[-1], axis=1), axis=1)[:, CYCLES[0] - 1 :]
            found.append((np.ascontiguousarray(powers.imag), np.ascontiguousarray(powers.real)))
        return found

    def answer(self, fitted: Fitted, cycles: Mask) -> Answer | None:
        """The best harmonic of any joint's gear, of some CYCLES."""
        best: Answer | None = None
        columns, count = self.ground.own_turns * GEAR, np.count_nonzero(cycles)
        for (joint, _), column, waves in zip(self.ground.turning, columns.T, self._waves, strict=True):
            if not count:
                continue
            one, other = waves if cycles.all() else (own[:, cycles] for own in waves)
            pairs = fitted.asked_in_pairs(column, one, other)
            score, gain = pairs.score(pairs.best), -float(np.log(count * columns.shape[1]))
            if best is None or gain + score.gain > best.gain:
                wave = np.stack([one[:, pairs.best], other[:, pairs.best]], axis=1) * score.size
                B = (column.reshape(len(wave), -1, 1) * wave[:, None]).reshape(-1, 2)
                best = Answer("harmonics", joint, gain + score.gain, B, cycles=int(CYCLES[cycles][pairs.best]), share=score.explained)
        return best
