"""A fit with some answers in it: its sums, taken of all rows, and few of its rows, as they are asked about again and again."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from urdfcal.base.geometry import Matrix, Vector
from urdfcal.calibration.asking.joint_noise import LEAST, under_noise
from urdfcal.calibration.asking.questions import Answer
from urdfcal.calibration.asking.sheet import Sheet
from urdfcal.calibration.asking.strip import Strip
from urdfcal.estimation.added_noise import volume
from urdfcal.estimation.score import Fitted, Kept

Gears = tuple[tuple[int, int], ...]


class Bare:
    """A fit before any question.

    Attributes:
        sheet: Everything that is asked of it.
        fitted: Its sums.
        few: Of its rows one of so many.
        under: Its sums under the least noise of the joints; none where the few rows are all.
    """

    def __init__(self, sheet: Sheet) -> None:
        """Go once through all rows."""
        self.sheet, self._few, self._known = sheet, list[Strip](), dict[tuple[Gears, float], Matrix]()
        products = np.zeros((sheet.count + 1, sheet.count + 1))
        least = LEAST if self.sheet.stride > 1 and sheet.asks_of_joint_noise else ()
        self.under = under_noise(Kept.first(sheet.p), self._passing(products), least)
        self._known[(), 0.0] = products
        self.few = Strip.joined(self._few)
        self.fitted = Fitted.of(products, sheet.ground.at, sheet.ground.linearisation.count)

    def _passing(self, products: Matrix) -> Iterator[Strip]:
        """All rows, while their products are summed up and few of them kept."""
        for strip in self.sheet.strips():
            products += strip.flat @ strip.flat.T
            self._few.append(strip if self.sheet.stride == 1 else strip.every(self.sheet.stride))
            yield strip

    def products(self, gears: Gears, noise: float) -> Matrix:
        """Of all columns, those of gears, and the residual, with noise of the joints' readings, [rad]."""
        if (gears, noise) not in self._known:
            products = np.zeros((self.sheet.count + 2 * len(gears) + 1,) * 2)
            for strip in self.sheet.strips():
                flat = self.sheet.further(strip, gears, noise).flat
                products += flat @ flat.T
            self._known[gears, noise] = products
        return self._known[gears, noise]


class Beside:
    """A fit with some answers in it.

    Attributes:
        bare: The fit without them.
        gears: Joints and cycles of those that are of gears.
        noise: Noise of the joints' readings among them, [rad].
        fitted: Its sums.
    """

    def __init__(self, bare: Bare, answers: Sequence[Answer]) -> None:
        """Of answers to questions that were put to a fit."""
        self.bare, self.noise = bare, sum(answer.noise for answer in answers)
        self.gears = tuple(answer.gear for answer in answers if answer.gear is not None)
        self.fitted = bare.fitted.put_to(bare.products(self.gears, self.noise))
        for answer in answers:
            self.fitted = self.fitted.beside(self.columns(answer), answer.size)

    def columns(self, answer: Answer) -> npt.NDArray[np.intp]:
        """Which columns an answer is."""
        if answer.gear is None:
            return answer.columns
        first = self.bare.sheet.count + 2 * self.gears.index(answer.gear)
        return np.array([first, first + 1])

    def strips(self) -> Iterator[Strip]:
        """All rows, part by part."""
        return (self.bare.sheet.further(strip, self.gears, self.noise) for strip in self.bare.sheet.strips())

    def combined(self, weights: Vector) -> Vector:
        """Sum of the columns times weights (columns,), row by row, (N,)."""
        found = np.empty((self.bare.sheet.ground.rows, self.bare.few.columns.shape[1]))
        for strip in self.strips():
            found[strip.rows] = np.tensordot(weights, strip.columns[:-1], 1).T
        return found.ravel()

    @property
    def grown(self) -> float:
        """Log of the determinant of what the noise of all rows grows by."""
        return sum(volume(strip.turns, self.noise**2) for strip in self.bare.sheet.strips()) if self.noise else 0.0

    @cached_property
    def few(self) -> Strip:
        """Few of the rows, with no columns but those that are in the fit."""
        few = self.bare.sheet.further(self.bare.few, self.gears, self.noise)
        return replace(few, columns=self.fitted.kept.rows(few.columns))

    @cached_property
    def of_few(self) -> Fitted:
        """The fit of few of the rows."""
        if self.bare.sheet.stride == 1:
            return self.fitted.alone(self.fitted.own)
        return self.fitted.alone(self.few.flat @ self.few.flat.T, len(self.few.rows) / self.bare.sheet.ground.rows)
