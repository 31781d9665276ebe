"""The constants of a chain at any value of its parameters: compiled once, then worked out all at once.

Between two motions the way is a product of constants and exponentials, M_0 exp(s_1 x_1) M_1 exp(s_2 x_2) ... With every screw carried
to where that begins it is a *stretch*,

    exp(a_1 x_1) exp(a_2 x_2) ... M,    a_k = Ad(M_0 ... M_k-1) s_k,    M = M_0 M_1 ...

so that a value of x takes one batch of exponentials and, of all stretches together, one product a factor. What lies behind a stretch moves
with x_k along Ad(exp(a_1 x_1) ... exp(a_k-1 x_k-1)) a_k, which is constant in the frame where it begins.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from urdfcal.base.geometry import SE3, Array3, Array4, Mask, Matrix, Vector

Rows = npt.NDArray[np.intp]
_UNIT = np.eye(4)
_ROUND = [0, 1, 2, 0, 1]  # components, so that those of a cross product follow each other


class Stretch:
    """A product of constants and exponentials that is being put together.

    Attributes:
        anchor: Index of the moving joint (0: the screen) in whose frame it begins.
        factors: Column of x, and screw (6,) in the frame where the stretch begins, of every exponential.
        end: The product of all constants.
    """

    def __init__(self, anchor: int) -> None:
        self.anchor = anchor
        self.factors: list[tuple[int, Vector]] = []
        self.end = pin.SE3.Identity()

    def pass_constant(self, placement: SE3) -> None:
        """Go on by a placement that is known."""
        self.end = self.end * placement

    def pass_factor(self, screw: Any, column: int) -> None:
        """Go on by the exponential of a screw, a Pinocchio motion, times a parameter."""
        self.factors.append((column, self.end.act(screw).vector))

    @property
    def columns(self) -> list[int]:
        """Its parameters."""
        return [column for column, _ in self.factors]


@dataclass(frozen=True, eq=False)
class Placements:
    """The chain's constants at one value of the parameters, and how they move with it.

    Attributes:
        walk: What does not depend on that value.
        joints: Placement of each moving joint behind the one before it, (moving, 4, 4).
        frames: Each of the chain's frames behind the moving joint that carries it, (frames, 4, 4).
        screws: (6, p) screw of every parameter in the frame that it is anchored to, signed for the motion of what lies behind it against
            the screen.
    """

    walk: Walk
    joints: Array3
    frames: Array3
    screws: Matrix

    @property
    def moves(self) -> Mask:
        """Which parameters move each of the frames against the screen, (frames, p): of those on its way all."""
        return self.walk.moves

    @property
    def anchors(self) -> Rows:
        """(p,) index of the moving joint (0: the screen) in whose frame each parameter's screw is constant."""
        return self.walk.anchors


@dataclass(frozen=True, eq=False)
class Walk:
    """Stretches of a way: those before each motion, in order, then those to each of the frames.

    Attributes:
        stretches: All of them.
        moving: How many motions there are.
        anchors: (p,) as of `Placements`.
        moves: (frames, p) as of `Placements`.
    """

    stretches: Sequence[Stretch]
    moving: int
    anchors: Rows
    moves: Mask

    @property
    def rigid(self) -> bool:
        """Whether the joints stand where they stand whatever the parameters are."""
        return not any(stretch.factors for stretch in self.stretches[: self.moving])

    @cached_property
    def anchored(self) -> tuple[slice | Rows, ...]:
        """The parameters whose screws are constant in the frame of each anchor, (moving + 1,): a slice where they follow each other."""
        found: list[set[int]] = [set() for _ in range(self.moving + 1)]
        for stretch in self.stretches:
            found[stretch.anchor].update(stretch.columns)
        return tuple(_as_slice(np.array(sorted(own), dtype=np.intp)) for own in found)

    def at(self, x: Vector) -> Placements:
        """The constants at one value of the parameters, (p,)."""
        rows, places, columns, screws, basis, ends = self._compiled
        screw_of_column, reached = np.zeros((6, len(x))), self._unmoved.copy()
        if len(columns):
            factors = self._unmoved[1:].copy()
            factors[places, rows] = _exponentials(basis, x[columns])
            for place, factor in enumerate(factors):
                np.matmul(reached[place], factor, out=reached[place + 1])
            screw_of_column[:, columns] = _carried(reached[places, rows], screws)
        placed = reached[-1] @ ends
        return Placements(self, placed[: self.moving], placed[self.moving :], screw_of_column)

    @cached_property
    def _unmoved(self) -> Array4:
        """Identities before each factor of every stretch, and behind the last, (factors of the longest stretch + 1, stretches, 4, 4)."""
        longest = max(len(stretch.factors) for stretch in self.stretches)
        return np.tile(_UNIT, (longest + 1, len(self.stretches), 1, 1))

    @cached_property
    def _compiled(self) -> tuple[Rows, Rows, Rows, Matrix, Array3, Array3]:
        """Of every exponential its stretch, its place there, its column and its screw (k, 6), powers of that; the stretches' ends."""
        every = [(row, place, *own) for row, stretch in enumerate(self.stretches) for place, own in enumerate(stretch.factors)]
        rows, places, columns = (np.array([own[index] for own in every], dtype=np.intp) for index in range(3))
        screws = np.array([own[3] for own in every]).reshape(-1, 6)
        return rows, places, columns, screws, _powers(screws), np.array([stretch.end.homogeneous for stretch in self.stretches])


def _as_slice(columns: Rows) -> slice | Rows:
    together = len(columns) and columns[-1] - columns[0] + 1 == len(columns)
    return slice(int(columns[0]), int(columns[-1]) + 1) if together else columns


def _powers(screws: Matrix) -> Array3:
    """X, X^2 / |w|^2 and X^3 / |w|^3 of the matrix X of every screw (k, 6), and |w| behind them, (k, 3, 17)."""
    turn = np.linalg.norm(screws[:, 3:], axis=1)
    X = np.zeros((len(screws), 4, 4))
    X[:, :3, 3] = screws[:, :3]
    for row, (i, j) in enumerate(((2, 1), (0, 2), (1, 0))):
        X[:, i, j], X[:, j, i] = screws[:, 3 + row], -screws[:, 3 + row]
    unit = X / np.where(turn > 0, turn, np.inf)[:, None, None]
    powers = np.stack([X, unit @ unit, unit @ unit @ unit], axis=1).reshape(-1, 3, 16)
    return np.concatenate([powers, np.repeat(turn[:, None, None], 3, axis=1)], axis=2)


def _exponentials(powers: Array3, x: Vector) -> Array3:
    """exp(X x) = I + x X + (1 - cos a) X^2 / |w|^2 + (a - sin a) X^3 / |w|^3 with a = |w| x, of every screw, (k, 4, 4)."""
    angle = powers[:, 0, 16] * x
    shares = np.empty((len(x), 3))
    shares[:, 0], shares[:, 1], shares[:, 2] = x, 1 - np.cos(angle), angle - np.sin(angle)
    return np.asarray((shares[:, None] @ powers[:, :, :16]).reshape(-1, 4, 4) + _UNIT)


def _carried(placements: Array3, screws: Matrix) -> Matrix:
    """Ad(T) s of every screw (k, 6) and its placement (k, 4, 4), as columns, (6, k)."""
    turned = placements[:, :3, :3] @ screws.reshape(-1, 2, 3).transpose(0, 2, 1)
    p, w = placements[:, _ROUND, 3], turned[:, _ROUND, 1]
    return np.concatenate([turned[:, :, 0] + p[:, 1:4] * w[:, 2:] - p[:, 2:] * w[:, 1:4], w[:, :3]], axis=1).T
