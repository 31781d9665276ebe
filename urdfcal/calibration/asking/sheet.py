"""Whitened rows of a fit and of everything that is asked about beside it, part by part of the poses.

All that questions need of most rows is their products, so that no more than a strip of them is there at a time; few rows are kept, since
they are asked for again and again. Columns lie along the first axis: those of the fit, those of what the arm and the rig may do, waves of
gears that were found, and behind all the residual.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import cached_property

import numpy as np
import numpy.typing as npt

from urdfcal.base.geometry import Array3, Matrix
from urdfcal.calibration.asking.arm import ArmColumns
from urdfcal.calibration.asking.gears import columns_of
from urdfcal.calibration.asking.ground import Ground
from urdfcal.calibration.asking.questions import Question
from urdfcal.calibration.asking.rig import RigColumns, rig_questions
from urdfcal.calibration.asking.strip import Strip
from urdfcal.estimation.added_noise import whitened
from urdfcal.model.rig_terms import RigTerm

_KEPT = 8_000_000  # numbers that are kept from the second time on, 64 MB
_FEW = 2000  # rows that are kept from the first time on: more take all memory, and tell no more of which gear, and how much noise, it is


class Sheet:
    """Everything that is asked of a fit.

    Attributes:
        ground: The fit.
        questions: About columns.
        terms: Which columns are the rig's.
    """

    def __init__(self, ground: Ground) -> None:
        """Of a fit before any question."""
        self.ground, self.p = ground, len(ground.at)
        self._arm = ArmColumns(ground, self.p)
        self._rig = RigColumns(ground.model, ground.estimate.belief.x)
        first = self.p + self._arm.count
        self.count = first + len(self._rig.terms)
        self.questions: list[Question] = [*self._arm.questions, *rig_questions(self._rig.terms, first)]
        self.terms: dict[int, RigTerm] = dict(enumerate(self._rig.terms, start=first))
        self._joints = np.array([number for number, _ in ground.joints.values()], dtype=np.intp)
        self._strips, self._keeps, self._asked, self._scratch = list[Strip](), False, False, np.empty((0, 0, 0))

    @cached_property
    def angles(self) -> Matrix:
        """Positions of the turning joints that were read, (joints, rows)."""
        return np.array([q for _, q in self.ground.joints.values()]).reshape(len(self._joints), self.ground.rows)

    @property
    def asks_of_joint_noise(self) -> bool:
        """Whether joints turn whose readings may be noisy, and are not known to be."""
        return bool(len(self._joints)) and not self.ground.estimate.noise.of_joints

    @cached_property
    def stride(self) -> int:
        """Which of the rows are few enough to be asked again and again: one of so many."""
        return -(-self.ground.rows // _FEW)

    def strips(self) -> Iterator[Strip]:
        """All rows, part by part; a strip is good until the next one comes, but for few rows, which are kept, or who asks again."""
        if self._strips:
            yield from self._strips
            return
        size = self.ground.linearisation.residual.size * (len(self._joints) + self.count + 1)
        self._keeps, self._asked = self.stride == 1 or (self._asked and size <= _KEPT), True
        for strip in self._made():
            if self._keeps:
                self._strips.append(strip)
            yield strip

    def _room(self, m: int, n: int) -> Array3:
        """Where the next strip goes, (joints + columns + 1, m, n)."""
        shape = len(self._joints) + self.count + 1, m, n
        if self._keeps or self._scratch.shape != shape:
            self._scratch = np.empty(shape)
        return self._scratch

    def further(self, strip: Strip, gears: Sequence[tuple[int, int]], noise: float) -> Strip:
        """Some rows with waves of gears, joints and cycles a turn, before the residual, and whitened for noise of the joints, [rad]."""
        turns, columns = strip.turns, strip.columns
        if gears:
            waves = [columns_of(cycles, self.angles[joint, strip.rows], turns[joint]) for joint, cycles in gears]
            columns = np.concatenate([columns[:-1], *waves, columns[-1:]])
        if noise:
            every = whitened(np.concatenate([turns, columns]), turns, noise**2)
            turns, columns = every[: len(turns)], every[len(turns) :]
        return Strip(strip.rows, turns, columns)

    def _made(self) -> Iterator[Strip]:
        """The strips, worked out."""
        J, means, factor = len(self._joints), self.ground.weights.means, self.ground.weights.factor
        if means is None and factor.ndim < 3:  # what the columns are made of is whitened
            yield from (Strip(rows, columns[:J], columns[J:]) for rows, columns in self._parts(factor))
        elif means is None:
            for rows, columns in self._parts(np.ones(())):
                whitened = (factor[rows] @ columns.transpose(2, 1, 0)).transpose(2, 1, 0).copy()
                yield Strip(rows, whitened[:J], whitened[J:])
        else:
            yield self._of_poses()

    def _of_poses(self) -> Strip:
        """All rows where some are readings of one pose, which may be anywhere."""
        J, whole = len(self._joints), np.zeros((len(self._joints) + self.count + 1, *self.ground.linearisation.residual.T.shape))
        for rows, columns in self._parts(np.ones(())):
            whole[:, :, rows] = columns
        whitened = self.ground.weights.of_poses(whole.transpose(2, 1, 0)).transpose(2, 1, 0).copy()
        return Strip(np.arange(self.ground.rows), whitened[:J], whitened[J:])

    def _parts(self, factor: Array3) -> Iterator[tuple[npt.NDArray[np.intp], Array3]]:
        """Which readings, and their columns with the turns before them times a factor, (joints + columns + 1, m, n)."""
        linearisation, sigma, x = self.ground.linearisation, self.ground.model.errors.sigma[:, None, None], self.ground.estimate.belief.x
        every, J, H = np.arange(len(linearisation.residual)), len(self._joints), len(self._joints) + self.p
        for part, motion, derivatives, turned in self.ground.model.by_parts(x):
            out, rows = self._room(*derivatives.shape[1:]), every[: len(self.ground.model.data)][part.rows]
            weights = _of_rows(factor, rows)
            turned *= weights
            out[:J] = turned[self._joints]
            np.multiply(derivatives, weights * sigma, out=out[J:H])
            self._arm.fill(out[H : H + self._arm.count], turned, part.rows)
            self._rig.fill(out[H + self._arm.count : -1], motion, part.rows, weights)
            np.multiply(linearisation.residual[rows].T, weights, out=out[-1])
            yield rows, out
        if linearisation.known:
            rows = every[-linearisation.known :]
            out = self._room(linearisation.residual.shape[1], len(rows))
            out[:] = 0.0
            out[J:H] = self.ground.model.known_beforehand(x).transpose(2, 1, 0) * sigma
            out[-1] = linearisation.residual[rows].T
            out *= _of_rows(factor, rows)
            yield rows, out


def _of_rows(factor: Matrix, rows: npt.NDArray[np.intp]) -> Matrix:
    """What some rows are multiplied by, (m, n), (m, 1) or (), from that of all, (n, m), (m,) or ()."""
    return factor[rows].T if factor.ndim == 2 else factor[:, None] if factor.ndim else factor
