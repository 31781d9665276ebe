"""Which place in the sources feeds which number of the expanded document: perturbation tracing.

All places are moved a little at once, each by a random step of its own, and the document is expanded; K such trials (K well below the
number of places) tell for each number y_j the few slopes s_ji with

    dy_j = sum_i s_ji e_i,

which orthogonal matching pursuit finds: with few places behind a number, as there are, it is exact where nothing is left over, and
where something is, more trials are made, up to one for each place. Steps are in proportion to what is written (`Slot.step`), so that
in a product, 333 times 0.001, neither hides the other. A place that changes more than numbers (a count, a name, a
condition) is found by halving, and is none.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from urdfcal.base.geometry import Matrix, Vector
from urdfcal.output.sources.numbers import Expansion
from urdfcal.output.sources.slots import Edit, Slot

_TRIALS = 28  # at first; and how many are added
_MOST_BEHIND = 12  # places behind one number
_LEFT = 1e-4  # of a number's change, that slopes must explain
_DUST = 1e-13  # change of a number that is none
_ROUNDS = 400  # of halving

Expand = Callable[[Sequence[Sequence[Edit]]], list[Expansion | None]]


@dataclass(frozen=True)
class Traced:
    """What the places feed.

    Attributes:
        slots: The places, without those that change more than numbers.
        slopes: For each number that any place moves: the place's index and its slope.
        unresolved: Numbers whose places were not found.
    """

    slots: tuple[Slot, ...]
    slopes: dict[int, dict[int, float]]
    unresolved: frozenset[int]

    def fed_by(self, slot: int) -> dict[int, float]:
        """The numbers that a place feeds, and the slopes."""
        return {number: its[slot] for number, its in self.slopes.items() if slot in its}


def trace(slots: Sequence[Slot], base: Expansion, wanted: Iterable[int], expand: Expand, rng: np.random.Generator) -> Traced:
    """Find what places feed.

    Args:
        slots: The places.
        base: The document as it is.
        wanted: The numbers whose places must be found.
        expand: Expands the sources with edits, several times; None where it fails.
        rng: For the steps.
    """
    usable = usable_slots(slots, base, expand, rng)
    steps, changes = np.empty((0, len(usable))), np.empty((0, len(base.values)))
    needed, trials = set(wanted), min(_TRIALS, len(usable))
    while trials:
        more = _steps(trials, usable, rng) if len(steps) + trials < len(usable) else np.diag([slot.step for slot in usable])
        if len(more) == len(usable):
            steps, changes = steps[:0], changes[:0]
        found = expand([_moved(usable, step) for step in more])
        kept = [index for index, each in enumerate(found) if each is not None and each.alike(base)]
        steps = np.vstack([steps, more[kept]])
        changes = np.vstack([changes, *([found[index].values - base.values] for index in kept)])  # type: ignore[union-attr]
        slopes, unresolved = _sparse(steps, changes)
        if not needed & unresolved or len(more) == len(usable):
            return Traced(tuple(usable), slopes, frozenset(unresolved))
    return Traced(tuple(usable), {}, frozenset())


def usable_slots(slots: Sequence[Slot], base: Expansion, expand: Expand, rng: np.random.Generator) -> list[Slot]:
    """Those places that can be moved without changing more than numbers."""
    groups, good = [list(slots)] if slots else [], list[Slot]()
    for _ in range(_ROUNDS):
        if not groups:
            break
        found = expand([_moved(group, _steps(1, group, rng)[0]) for group in groups])
        halves: list[list[Slot]] = []
        for group, each in zip(groups, found, strict=True):
            if each is not None and each.alike(base):
                good += group
            elif len(group) > 1:
                middle = len(group) // 2
                halves += [group[:middle], group[middle:]]
        groups = halves
    return sorted(good, key=lambda slot: (str(slot.file), slot.start, -slot.end))


def _steps(trials: int, slots: Sequence[Slot], rng: np.random.Generator) -> Matrix:
    return np.asarray(rng.standard_normal((trials, len(slots))) * [slot.step for slot in slots])


def _moved(slots: Sequence[Slot], step: Vector) -> list[Edit]:
    return [edit for slot, by in zip(slots, step, strict=True) if by for edit in slot.moved(float(by))]


def _sparse(steps: Matrix, changes: Matrix) -> tuple[dict[int, dict[int, float]], set[int]]:
    moved = np.flatnonzero(np.abs(changes).max(axis=0, initial=0.0) > _DUST)
    slopes, unresolved = dict[int, dict[int, float]](), set[int]()
    for number in moved:
        its = _pursuit(steps, changes[:, number])
        if its is None:
            unresolved.add(int(number))
        else:
            slopes[int(number)] = its
    return slopes, unresolved


def _pursuit(steps: Matrix, change: Vector) -> dict[int, float] | None:
    """The few steps that make up a change; None where they are not few."""
    lengths = np.linalg.norm(steps, axis=0)
    enough = max(_LEFT * float(np.linalg.norm(change)), _DUST)
    left: Any = change
    values: Any = np.empty(0)
    chosen: list[int] = []
    while float(np.linalg.norm(left)) > enough:
        if len(chosen) >= (min(_MOST_BEHIND, len(steps) - 4) if len(steps) < steps.shape[1] else len(steps)):
            return None
        chosen.append(int(np.argmax(np.abs(steps.T @ left) / np.where(lengths > 0, lengths, np.inf))))
        values = np.linalg.lstsq(steps[:, chosen], change, rcond=None)[0]
        left = change - steps[:, chosen] @ values
    return {slot: float(value) for slot, value in zip(chosen, values, strict=True) if abs(value) * lengths[slot] > enough}
