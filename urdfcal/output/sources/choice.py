"""Which place in the sources takes which correction: one that feeds this number and no other of the whole document."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from urdfcal.output.sources.layout import is_installed
from urdfcal.output.sources.numbers import Wanted
from urdfcal.output.sources.slots import EXPRESSION, LITERAL, PART, Edit, Slot
from urdfcal.output.sources.tracing import Traced
from urdfcal.output.sources.tree import SourceTree

_STUBBORN = 1e-11  # [m] and [rad]
_STILL = 1e-4  # of what its own number moves: another one that moves less stands still
_NAMED = 4  # numbers that a place feeds, in messages


@dataclass
class Choice:
    """Places by the number that they are to correct, and what else was seen of places.

    Attributes:
        tree: The sources.
        taken: The place and its slope for each number that has one.
        shared: Places that feed a number and others, too, by the number.
        barred: Places that were found to feed more than they seemed to.
        text: Whether some expressions give numbers as text.
    """

    tree: SourceTree
    taken: dict[Wanted, tuple[Slot, float]] = field(default_factory=dict)
    shared: dict[Wanted, tuple[Slot, tuple[int, ...]]] = field(default_factory=dict)
    barred: set[Slot] = field(default_factory=set)
    text: bool = False
    _sought: set[Wanted] = field(default_factory=set)

    def find(self, wanted: Iterable[Wanted]) -> None:
        """Look for a place for each number: among the numbers that are written, then among expressions."""
        missing = [each for each in wanted if each not in self.taken and each not in self._sought]
        self._sought.update(missing)
        for kinds in ((LITERAL,), (EXPRESSION, PART)):
            traced = self.tree.traced(kinds, frozenset(self.barred), map(self.tree.base.index, missing)) if missing else None
            if traced is not None:
                self._take(traced, missing)
                missing = [each for each in missing if each not in self.taken]

    def _take(self, traced: Traced, wanted: Sequence[Wanted]) -> None:
        fed = _by_slot(traced)
        for each in wanted:
            number = self.tree.base.index(each)
            its = traced.slopes.get(number, {})
            alone = [slot for slot in its if len(fed[slot]) == 1]
            if alone:
                best = min(alone, key=lambda slot: _preference(traced.slots[slot], its[slot]))
                self.taken[each] = traced.slots[best], its[best]
            elif its and each not in self.shared:
                worst = min(its, key=lambda slot: _preference(traced.slots[slot], its[slot]))
                self.shared[each] = traced.slots[worst], tuple(sorted(fed[worst]))

    def edits(self, by: Mapping[Wanted, float]) -> Iterator[Edit]:
        """The corrections, each in its place and its unit."""
        for wanted, (slot, slope) in self.taken.items():
            yield from slot.corrected(by[wanted] / slope)

    def bar_culprits(self) -> bool:
        """Look at each place alone, and let go of those that feed more than their own number; whether there are any."""
        base, own = self.tree.base, list(self.taken.items())
        found = self.tree.expand([slot.moved(slot.step) for _, (slot, _) in own])
        for (wanted, (slot, slope)), each in zip(own, found, strict=True):
            if each is None or not each.alike(base):
                moved: tuple[int, ...] = ()
            else:
                moved = tuple(map(int, np.flatnonzero(np.abs(each.values - base.values) > _STILL * slot.step * abs(slope))))
            if moved != (base.index(wanted),):
                self.barred.add(slot)
                self._sought.discard(wanted)
                self.shared.setdefault(wanted, (slot, moved))
                del self.taken[wanted]
        return len(self.taken) < len(own)

    def bar_stubborn(self, left: Mapping[Wanted, float]) -> bool:
        """Let go of places that do not bring their number where it is wanted; whether there are any."""
        stubborn = [each for each in self.taken if abs(left[each]) > _STUBBORN]
        for each in stubborn:
            self.barred.add(self.taken.pop(each)[0])
            self._sought.discard(each)
        return bool(stubborn)

    def why_not(self, wanted: Wanted) -> str:
        """What keeps a number from being corrected, in words that name the place."""
        if wanted not in self.shared:
            return f"{wanted}: no number that could be corrected feeds it"
        slot, fed = self.shared[wanted]
        owners = list(dict.fromkeys(self.tree.base.owners[number] for number in fed))
        more = f" and {len(owners) - _NAMED} more" if len(owners) > _NAMED else ""
        return f"{self.tree.where(slot)}: '{slot.shown}' feeds {', '.join(owners[:_NAMED])}{more}"


def _by_slot(traced: Traced) -> dict[int, set[int]]:
    fed: dict[int, set[int]] = {}
    for number, its in traced.slopes.items():
        for slot in its:
            fed.setdefault(slot, set()).add(number)
    return fed


def _preference(slot: Slot, slope: float) -> tuple[bool, int, int, float, str, int]:
    """The user's own files first; then numbers, those nearest to metres and radians; of expressions those nearest to the origin."""
    rank = 0 if slot.kind == LITERAL else slot.rank
    return is_installed(slot.file), slot.kind, rank, abs(np.log(abs(slope))), str(slot.file), slot.start
