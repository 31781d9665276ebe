"""Readings of the joints that are noisy: a covariance of each pose's numbers in place of columns.

All turning joints' readings are off by one standard deviation, R_i = R + sigma^2 J_q J_q' of the numbers of a pose. Which of a few sizes is
the best is looked for in few of the rows, and in all of them from there uphill.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from urdfcal.base.geometry import DEG, Matrix
from urdfcal.calibration.asking.questions import Answer
from urdfcal.calibration.asking.strip import Strip
from urdfcal.estimation.added_noise import products
from urdfcal.estimation.score import Fitted, Kept, log_evidences

SIGMAS = 0.005 * DEG * np.sqrt(2.0) ** np.arange(9)  # [rad]
EVERY = range(len(SIGMAS))
LEAST = (0,)  # of them, which mostly suffices: joints have no such noise
_SURE = 10.0  # [nats] by which few rows must tell a size from the best one for it not to be tried in all of them
Under = dict[int, tuple[Matrix, float]]


def under_noise(kept: Kept, strips: Iterable[Strip], which: Collection[int]) -> Under:
    """Under some of SIGMAS, products of a fit's columns and the residual, (p + 1, p + 1), and log det of what its noise grows by."""
    p = len(kept.own)
    found: Under = {number: (np.zeros((p + 1, p + 1)), 0.0) for number in which}
    for strip in strips:
        more = products(kept.rows(strip.columns), strip.turns, [float(SIGMAS[number] ** 2) for number in found])
        found = {number: (own[0] + new[0], own[1] + new[1]) for (number, own), new in zip(found.items(), more, strict=True)}
    return found


@dataclass(frozen=True)
class JointNoise:
    """Joint noise beside a fit.

    Attributes:
        fitted: The fit.
        under: Its sums under those of SIGMAS that were tried.
    """

    fitted: Fitted
    under: Under

    def uphill(self, few: JointNoise, strips: Callable[[], Iterable[Strip]]) -> JointNoise:
        """The same with further sizes tried in all strips, from the best of few rows on until no neighbour can be better."""
        known, best, gains = dict(self.under), few.best, few._gains
        likely = {number for number, gain in gains.items() if gain > gains[best] - _SURE}
        while wanted := likely.intersection((best - 1, best, best + 1)) - known.keys():
            known |= under_noise(self.fitted.kept, strips(), wanted)
            best = replace(self, under=known).best
        return replace(self, under=known)

    @property
    def best(self) -> int:
        """Which of SIGMAS has the greatest gain, of those that were tried."""
        return max(sorted(self._gains), key=lambda number: self._gains[number])

    @cached_property
    def _gains(self) -> dict[int, float]:
        """Log evidence under each noise, less that without it."""
        products, volumes = (np.array(own) for own in zip(*self.under.values(), strict=True))
        evidence = log_evidences(products, self.fitted.at, self.fitted.numbers) - 0.5 * volumes - self.fitted.log_evidence
        return dict(zip(self.under, evidence.tolist(), strict=True))

    @property
    def answer(self) -> Answer:
        """That the joints' readings have the best of these."""
        best = self.best
        total = self.fitted.alone(self.under[best][0]).total
        left = float(np.sqrt(total / self.fitted.numbers))  # of the sensor's own noise
        sigma, gain = float(SIGMAS[best]), self._gains[best] - float(np.log(len(SIGMAS)))
        return Answer("joint_noise", "", gain, share=1 - total / self.fitted.total, noise=sigma, joint_sigma=sigma * left, left=left)
