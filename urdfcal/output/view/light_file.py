"""What files that are made lighter have in common: their parts, and numbers in text.

A file of a form that is not looked for stays as it is: `OfAnotherForm`.
"""

from __future__ import annotations

import warnings
from abc import ABC, abstractmethod
from typing import Any

import numpy as np

from urdfcal.base.geometry import Matrix
from urdfcal.output.view.thinning import Faces, Part

_DIGITS = 5  # significant ones of the largest number of a list


class MeshFile(ABC):
    """A mesh file that can be made lighter.

    Attributes:
        parts: Its triangles.
    """

    parts: list[Part]

    @abstractmethod
    def lighter(self, cells: float) -> bytes:
        """The file on a grid of so many cells along its longest side; to be asked for once."""


class OfAnotherForm(Exception):
    """Nothing is wrong with the file; it is not one that is made lighter here."""


def fans(corners: Faces, counts: Faces) -> Faces:
    """Polygons of so many corners each, (c, k), cut into triangles about their first corners, (t, 3, k)."""
    if counts.sum() != len(corners) or (len(counts) and counts.min() < 3):
        raise OfAnotherForm
    first = np.cumsum(counts) - counts
    cut = np.repeat(first, counts - 2)
    within = np.arange(len(cut)) - np.repeat(np.cumsum(counts - 2) - (counts - 2), counts - 2)
    return np.asarray(corners[np.stack([cut, cut + within + 1, cut + within + 2], axis=-1)])


def numbers_in(text: bytes) -> Matrix:
    """Numbers with white space between them, (n,)."""
    return np.asarray(_read(text, np.float64))


def whole_numbers_in(text: bytes) -> Faces:
    """Whole numbers with white space between them, (n,)."""
    return np.asarray(_read(text, np.int64), dtype=np.intp)


def _read(text: bytes, kind: Any) -> Any:
    with warnings.catch_warnings():
        warnings.simplefilter("error", DeprecationWarning)  # how numpy says that it found something else
        try:
            return np.fromstring(text, dtype=kind, sep=" ")
        except (DeprecationWarning, ValueError):
            raise OfAnotherForm from None


def in_words(rows: Matrix) -> str:
    """Numbers as they are written, to a share of the largest that cannot be seen."""
    largest = float(np.abs(rows).max()) if rows.size else 0.0
    digits = _DIGITS - 1 - int(np.floor(np.log10(largest))) if largest > 0 else 0
    return " ".join(map(repr, (np.round(rows, digits) + 0.0).ravel().tolist()))
