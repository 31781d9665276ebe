"""Some whitened rows of a fit and of everything that is asked about beside it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from urdfcal.base.geometry import Array3, Matrix


@dataclass(frozen=True)
class Strip:
    """Some rows.

    Attributes:
        rows: Which they are, (n,).
        turns: What is read more where each turning joint that was read turns by one, whitened, (joints, m, n).
        columns: All columns and the residual, (columns + 1, m, n).
    """

    rows: npt.NDArray[np.intp]
    turns: Array3
    columns: Array3

    @property
    def flat(self) -> Matrix:
        """The columns and the residual, (columns + 1, N)."""
        return self.columns.reshape(len(self.columns), -1)

    @staticmethod
    def joined(strips: Sequence[Strip]) -> Strip:
        """Several as one."""
        if len(strips) == 1:
            return strips[0]
        rows = np.concatenate([strip.rows for strip in strips])
        return Strip(rows, *(np.concatenate([getattr(strip, of) for strip in strips], axis=2) for of in ("turns", "columns")))

    def every(self, stride: int) -> Strip:
        """Of these rows those whose number is a multiple of a stride."""
        which = np.flatnonzero(self.rows % stride == 0)
        return Strip(self.rows[which], self.turns.take(which, axis=2), self.columns.take(which, axis=2))
