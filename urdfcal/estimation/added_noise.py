"""Whitening where numbers of one row have noise in common, R = I + s E E' beside their own, E (m, k) another one in every row.

Where rows have more numbers than that noise has sources, products need the smaller matrix alone: R^-1 = I - s E (I + s E'E)^-1 E'.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from urdfcal.base.geometry import Array3, Matrix


def whitened(columns: Array3, E: Array3, variance: float) -> Array3:
    """Columns in units of the whole noise, (c, m, n).

    Args:
        columns: In units of the noise that numbers have of their own, (c, m, n).
        E: What one source of the other noise does to every number, in the same units, (k, m, n).
        variance: Of every source.
    """
    return _solved(columns.copy(), _root(variance * _squares(E)))


def volume(E: Array3, variance: float) -> float:
    """Log det R over all rows."""
    return _volume(_root(variance * _squares(E)))


def products(columns: Array3, E: Array3, variances: Iterable[float]) -> Iterator[tuple[Matrix, float]]:
    """For each variance, products of the columns, (c, c), whitened as above, and log det R over all rows."""
    flat, few = columns.reshape(len(columns), -1), len(E) < columns.shape[1]
    plain = flat @ flat.T if few else np.zeros(2 * (len(columns),))
    if few:
        sources = E.transpose(2, 1, 0)
        columns, E = np.ascontiguousarray((columns.transpose(2, 0, 1) @ sources).transpose(1, 2, 0)), E.transpose(1, 0, 2)
    squares, scratch = _squares(E), np.empty_like(columns)
    for variance in variances:
        root = _root(variance * squares)
        scratch[:] = columns
        rows = _solved(scratch, root).reshape(len(columns), -1)
        yield (plain - variance * (rows @ rows.T) if few else rows @ rows.T), _volume(root)


def _squares(E: Array3) -> Array3:
    """E E' of every row, (n, m, m), from (k, m, n)."""
    E = np.ascontiguousarray(E.transpose(2, 1, 0))
    return E @ E.transpose(0, 2, 1)


def _root(added: Array3) -> Array3:
    """L with L L' = I + added, (m, m, n), from (n, m, m)."""
    return np.ascontiguousarray(np.linalg.cholesky(added + np.eye(added.shape[1])).transpose(1, 2, 0))


def _volume(L: Array3) -> float:
    return 2 * float(np.sum(np.log(np.diagonal(L))))


def _solved(columns: Array3, L: Array3) -> Array3:
    """L^-1 times columns, which are overwritten."""
    for number, row in enumerate(L):
        for before in range(number):
            columns[:, number] -= row[before] * columns[:, before]
        columns[:, number] /= row[number]
    return columns
