"""Log density of rows that are left out in turn, each fold predicted by a fit of all others, from products of their columns."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
import numpy.typing as npt

from urdfcal.base.geometry import Array3
from urdfcal.estimation.score import Fitted

Rows = npt.NDArray[np.intp]
Strips = Callable[[], Iterator[tuple[Array3, Rows]]]


def predicted(fitted: Fitted, strips: Strips, folds: int, rows: int) -> float:
    """Log density of the numbers of some rows, each fold predicted by a fit of all others, the noise included that they tell.

    What the poses of a fold have in common beyond the parameters' mean is left out.

    Args:
        fitted: A fit of all rows.
        strips: The rows part by part, whenever it is called: [H e], (p + 1, m, n), and the fold of each, (n,), -1 for none.
        folds: How many there are.
        rows: How many rows there are in all.
    """
    held, sizes = np.zeros((folds, len(fitted.at) + 1, len(fitted.at) + 1)), np.zeros(folds)
    for fold, part in _by_fold(strips()):
        flat = part.reshape(len(part), -1)
        held[fold] += flat @ flat.T
        sizes[fold] += part.shape[2]
    shares = (rows - sizes) / rows
    others = [fitted.alone(fitted.own - own, share) for own, share in zip(held, shares.tolist(), strict=True)]
    return sum(_density(others[fold], part) for fold, part in _by_fold(strips()))


def _by_fold(strips: Iterator[tuple[Array3, Rows]]) -> Iterator[tuple[int, Array3]]:
    for part, fold_of in strips:
        for fold in np.unique(fold_of[fold_of >= 0]).tolist():
            yield fold, part[:, :, fold_of == fold]


def _density(others: Fitted, part: Array3) -> float:
    """Log density of rows [H e], (p + 1, m, n), by a fit that does not know of them."""
    H, step = part[:-1].transpose(2, 1, 0), others.step
    scale = others.total / max(others.numbers, 1.0)
    seen = np.abs(H).sum(axis=2) > 0
    spread = H @ others.P @ H.transpose(0, 2, 1) + np.eye(H.shape[1])
    off = np.where(seen, part[-1].T - H @ step, 0.0)
    squares = float(np.sum(off * np.linalg.solve(spread, off[..., None])[..., 0]))
    return -0.5 * (squares / scale + float(np.sum(np.linalg.slogdet(spread)[1])) + np.count_nonzero(seen) * float(np.log(scale)))
