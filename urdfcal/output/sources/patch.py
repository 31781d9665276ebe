"""A calibration as changed sources of a xacro, proven by expanding them again."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from urdfcal.base.errors import RobotError
from urdfcal.base.geometry import SE3
from urdfcal.base.reading import DESCRIPTION, content_of
from urdfcal.output.sources.choice import Choice
from urdfcal.output.sources.layout import Layout
from urdfcal.output.sources.numbers import Expansion, Wanted
from urdfcal.output.sources.own import OwnPlaces
from urdfcal.output.sources.slots import Edit
from urdfcal.output.sources.tree import SourceTree
from urdfcal.output.sources.unified import patch_text
from urdfcal.output.sources.wishes import PROOF, SAME, apart, wishes
from urdfcal.robot.description import Description

_CHOICES = 4  # rounds in which a place can turn out to feed more
_STEPS = 4  # of Newton's, for expressions that are not linear
_STRAYED = 1e-11  # change of a number that is none of the calibrated ones
_NAMED = 3  # faults in a message
SPLIT = "--split gives the macro a parameter of its own for each, 0 by default, and sets it at the call"


@dataclass(frozen=True)
class SourcePatch:
    """Sources before and after.

    Attributes:
        description: What was calibrated.
        before: All files that it is expanded from, by real path.
        after: Those that changed.
        tree: The sources, with what was found of them.
    """

    description: Description
    before: Mapping[Path, bytes]
    after: Mapping[Path, bytes]
    tree: SourceTree

    @cached_property
    def layout(self) -> Layout:
        """Where the files belong."""
        return Layout(self.description.path, tuple(self.before), tuple(self.after))

    @property
    def unified(self) -> bytes:
        """All changes as a unified diff, which `git apply` takes at `layout.root`; of installed files it adds changed copies."""
        return patch_text(self.before, self.after, self.layout)

    @property
    def warnings(self) -> tuple[str, ...]:
        """What a user must know of installed files."""
        return tuple(
            f"{file} is installed, and not yours: a changed copy is {self.layout.way(file)}; have your description read that one"
            for file in self.layout.installed
        )

    def copies(self, folder: Path) -> dict[str | Path, bytes]:
        """All that the changed description is expanded from, in a folder of its own that `--package-dir` takes."""
        found: dict[str | Path, bytes] = {
            folder / self.layout.way_in_folder(file): content_of(file, DESCRIPTION) for file in self.layout.manifests
        }
        found |= {folder / self.layout.way_in_folder(file): self.after.get(file, text) for file, text in self.before.items()}
        return found

    @property
    def in_place(self) -> dict[str | Path, bytes]:
        """The changed files in their places, and beside each what it was, as `.orig`.

        Raises:
            RobotError: one of them is installed, and not the user's own.
        """
        if self.layout.installed:
            raise RobotError(
                "belongs to an installed package, which is not changed in place; leave --in-place out and use --xacro-folder, "
                "or a copy of the package in your own workspace",
                self.layout.installed[0],
            )
        found: dict[str | Path, bytes] = {}
        for file, text in self.after.items():
            found |= {original(file): self.before[file], file: text}
        return found


def original(file: Path) -> Path:
    """Where a file's content is kept that is changed in place."""
    return file.with_name(f"{file.name}.orig")


def patched_sources(
    description: Description, origins: Mapping[str, SE3], *, split: bool = False, tree: SourceTree | None = None
) -> SourcePatch:
    """Put origins into the sources that a description was expanded from; every other byte stays.

    Args:
        description: As `read_description` expanded it.
        origins: New placement by joint name.
        split: Whether a number that feeds several joints may become one for each, by a new parameter of its macro.
        tree: Its sources, as they were looked at before; what was found of them is not sought again.

    Raises:
        RobotError: a number cannot be corrected where it stands, with file and line; or the changed sources do not expand to the placements
            that are wanted, within 1e-9 m and of rotation matrices, and to the same in all else.
    """
    tree = SourceTree.of(description) if tree is None or tree.description.text != description.text else tree
    tree.require_unchanged()
    by = wishes(tree.base, origins)
    choice = Choice(tree, {wanted: (slot, 1.0) for wanted, slot in OwnPlaces(tree, by).literals().items()})
    for _ in range(_CHOICES):
        edits = _edits(tree, choice, by, split)
        if tree.expand([edits]) == [None]:
            choice.text = True  # which numbers may be, and then cannot be added to as they are
            edits = _edits(tree, choice, by, split)
        found, edits = _newton(tree, choice, by, _expanded(tree, edits), edits, split)
        stubborn, strayed = choice.bar_stubborn(_left(tree, found, by)), _strayed(tree.base, found, by)
        if not stubborn and not strayed:
            break
        if not stubborn and not choice.bar_culprits():
            raise RobotError(f"its changed sources would also change {strayed}; nothing was written", description.path)
    _require_proof(description, found, origins)
    after = {file: text for file, text in tree.contents(edits).items() if text != tree.files[file]}
    return SourcePatch(description, tree.files, after, tree)


def _edits(tree: SourceTree, choice: Choice, by: Mapping[Wanted, float], split: bool) -> list[Edit]:
    """All edits that bring the numbers where they are wanted, to first order."""
    stated = [each for each in by if each.name in tree.base.stated[each.joint]]
    choice.find(stated)
    places = OwnPlaces(tree, {each: value for each, value in by.items() if each not in choice.taken}, choice.text)
    shared = [] if split else [each for each in places.by if places.shared(each.joint)]
    faults = [
        choice.why_not(each) if each in stated else f"{each}: its origin, which does not state it, is shared with other joints"
        for each in shared
    ]
    if faults:
        kinds = list(dict.fromkeys(faults))
        more = f"; and {len(kinds) - _NAMED} more such" if len(kinds) > _NAMED else ""
        raise RobotError(f"cannot be calibrated in its sources: {'; '.join(kinds[:_NAMED])}{more}; {SPLIT}", tree.description.path)
    return [*choice.edits(by), *(places.edits() if places.by else ())]


def _newton(
    tree: SourceTree, choice: Choice, by: Mapping[Wanted, float], found: Expansion, edits: list[Edit], split: bool
) -> tuple[Expansion, list[Edit]]:
    """Corrections of corrections, where what is written there does not act in proportion."""
    wanted = dict(by)
    for _ in range(_STEPS):
        left = _left(tree, found, by)
        if max(map(abs, left.values()), default=0.0) <= SAME:
            break
        wanted = {each: value + left[each] for each, value in wanted.items()}
        edits = _edits(tree, choice, wanted, split)
        found = _expanded(tree, edits)
    return found, edits


def _left(tree: SourceTree, found: Expansion, by: Mapping[Wanted, float]) -> dict[Wanted, float]:
    """What each number is still to change by."""
    return {
        each: value - float(found.values[tree.base.index(each)] - tree.base.values[tree.base.index(each)]) for each, value in by.items()
    }


def _expanded(tree: SourceTree, edits: Sequence[Edit]) -> Expansion:
    (found,) = tree.expand([edits])
    if found is None or not found.alike(tree.base):
        raise RobotError("its changed sources do not expand to the same robot; nothing was written", tree.description.path)
    return found


def _strayed(base: Expansion, found: Expansion, by: Mapping[Wanted, float]) -> str:
    """What changed and must not have; the empty string for nothing."""
    changed = np.abs(found.values - base.values) > _STRAYED
    changed[[base.index(each) for each in by]] = False
    return ", ".join(dict.fromkeys(base.owners[number] for number in np.flatnonzero(changed)[:_NAMED]))


def _require_proof(description: Description, found: Expansion, origins: Mapping[str, SE3]) -> None:
    """Refuse changed sources that do not give the placements."""
    off = {joint: apart(found, joint, origin) for joint, origin in origins.items()}
    worst = max(off, key=lambda joint: off[joint], default="")
    if worst and not off[worst] <= PROOF:
        raise RobotError(
            f"its changed sources put joint '{worst}' {off[worst]:.1e} (m, or of the rotation matrix) from where it was calibrated to be, "
            f"expected at most {PROOF:g}; nothing was written",
            description.path,
        )
