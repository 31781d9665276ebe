"""The links that measure: screen, lasers and module, or a reference and targets, found among the links of a URDF.

A *target* is a point or a whole frame that is fixed to a link, at an offset that is not known. It is seen from a *measuring frame*
(a tracker, a camera, a board) that stands on the reference link, at a placement that is not known either. *Places* are points and
planes in the room that several poses have in common.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from urdfcal.base.errors import RigError, no_such
from urdfcal.base.geometry import Matrix
from urdfcal.robot.urdf_tree import UrdfTree

SIX = ("trans_x", "trans_y", "trans_z", "rot_x", "rot_y", "rot_z")
TRACKER = "tracker"  # the link that targets are seen from, if there is one of that name
_LASER = re.compile(r"laser_(\d+)$")


@dataclass(frozen=True)
class Target:
    """Something on a link that is seen, or that touches.

    Attributes:
        name: Link, with `:<label>` behind it where one link has several targets.
        link: The link.
        offset: Which numbers of its offset on the link matter, of SIX: of a point its translation.
        board: Name of the board that it is a corner of, and whose six numbers place it; the empty string for none.
        at: Where it is on that board, [m].
        aimed: Whether it is a laser that is aimed at a screen, and stands about where the URDF has it.
    """

    name: str
    link: str
    offset: tuple[str, ...] = SIX[:3]
    board: str = ""
    at: tuple[float, float, float] = (0.0, 0.0, 0.0)
    aimed: bool = False

    @property
    def placed_by(self) -> str:
        """First half of the names of the parameters that place it on its link."""
        return self.board or self.name


@dataclass(frozen=True)
class Grid:
    """The corners of a board, numbered row by row from the first one; x along a row, y down the columns.

    Attributes:
        columns: Corners in a row.
        rows: Rows of them.
        square: Side of a square, [m].
        gap: Where squares stand apart, as tags do, how far, [m]; None where they touch, as on a chessboard.
        staggered: Middles of circles instead of corners: rows are `square` apart, in a row they are twice as far, and every second
            row begins one `square` farther in (OpenCV's asymmetric grid of circles).
    """

    columns: int
    rows: int
    square: float
    gap: float | None = None
    staggered: bool = False

    def at(self, corner: int) -> tuple[float, float, float]:
        """Where a corner is on the board, [m]."""
        row, column = divmod(corner, self.columns)
        if self.staggered:
            return (2 * column + row % 2) * self.square, row * self.square, 0.0
        return self._along(column), self._along(row), 0.0

    def _along(self, count: int) -> float:
        """How far a row or column is from the first; with a gap, each second step crosses it."""
        if self.gap is None:
            return count * self.square
        tags, odd = divmod(count, 2)
        return tags * (self.square + self.gap) + odd * self.square

    def __str__(self) -> str:
        gap, kind = "" if self.gap is None else f":{self.gap * 1e3:g}mm", "circles:" if self.staggered else ""
        return f"{kind}{self.columns}x{self.rows}:{self.square * 1e3:g}mm{gap}"

    def points(self) -> Matrix:
        """All corners in the axes of the board, (corners, 3), [m]."""
        return np.array([self.at(corner) for corner in range(self.corners)])

    @property
    def corners(self) -> int:
        """How many there are."""
        return self.columns * self.rows


@dataclass(frozen=True)
class Place:
    """Numbers in the room that several poses share: a socket's point, a plane, the fixed end of a wire.

    Attributes:
        name: First half of the parameters' names.
        names: Second halves.
        units: Unit of each: m or rad.
        kind: `place`, of which nothing is known before; `camera`, the screen's place before a calibrated camera; or `lens`, its intrinsics.
        words: What it is called where it carries something.
    """

    name: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    kind: Literal["place", "camera", "lens"] = "place"
    words: str = "the places that are touched"


@dataclass(frozen=True)
class Instrument:
    """Something with a frame of its own that targets are seen in.

    Attributes:
        name: First half of the names of the parameters that place it.
        link: Link that it stands on; the empty string for the default: `tracker`, or the root.
        placed: Whether readings are in its frame, so that its placement matters.
        aimed: Whether it is a screen that lasers are aimed at, and stands about where the URDF has it.
    """

    name: str
    link: str
    placed: bool
    aimed: bool = False


@dataclass(frozen=True)
class Instruments:
    """Everything that measures beside lasers.

    Attributes:
        targets: What is seen, and what touches.
        reference: Link that the measuring frame stands on; the empty string for the default: `tracker`, or the root.
        placed: Whether targets are seen from a measuring frame, so that its placement matters.
        places: What several poses have in common.
        camera_sigma: Standard deviations of the six errors of the screen's place in front of a camera that reads laser spots as pixels,
            [m] and [rad]; empty without such a camera.
        name: Of the first instrument, where it has one beside the link's.
        aimed: Whether that is a screen that lasers are aimed at.
        lenses: Cameras whose lens is refined, with the number of its intrinsics.
        others: Further instruments.
        pairs: Which target is seen from which instrument, by their numbers; all from the first where there are no others.
    """

    targets: tuple[Target, ...] = ()
    reference: str = ""
    placed: bool = False
    places: tuple[Place, ...] = ()
    camera_sigma: tuple[float, ...] = ()
    name: str = ""
    aimed: bool = False
    lenses: tuple[tuple[str, int], ...] = ()
    others: tuple[Instrument, ...] = ()
    pairs: tuple[tuple[int, int], ...] = ()

    @property
    def every(self) -> tuple[Instrument, ...]:
        """All instruments, first the one that stands on the reference link."""
        return (Instrument(self.name or self.reference, self.reference, self.placed, self.aimed), *self.others)

    @property
    def needed(self) -> bool:
        """Whether there are any: spots in metres on the screen need none."""
        return bool(self.targets or self.camera_sigma)


NONE = Instruments()


@dataclass(frozen=True)
class Rig:
    """The links that measure.

    Attributes:
        base: Where the way between the two ends begins: the screen, the plane x = 0 of this link in which a spot is (y, z); without
            lasers the reference.
        lasers: Each beam leaves the origin of its link along +z.
        tip: Where it ends: the module, which is the lasers' nearest common fixed ancestor, with one laser its parent; without lasers the
            link of the target that most joints move.
        instruments: What measures beside lasers, with the reference link named.
    """

    base: str
    lasers: tuple[str, ...]
    tip: str
    instruments: Instruments = NONE


def find_rig(tree: UrdfTree, screen: str | None = None, lasers: Sequence[str] | None = None, instruments: Instruments | None = None) -> Rig:
    """Find screen, lasers and module; without lasers (an empty sequence) the way leads from the reference to the farthest target.

    Raises:
        RigError: a link is missing, the lasers sit on several moving links, or nothing moves between lasers and screen.
    """
    seen = _with_reference(tree, instruments or Instruments())
    if seen.targets and lasers is not None and not lasers:
        return Rig(seen.reference, (), _farthest(tree, seen), seen)
    return replace(_laser_rig(tree, screen, lasers), instruments=seen)


def _with_reference(tree: UrdfTree, instruments: Instruments) -> Instruments:
    """The instruments with their reference link named, all links known to be there."""
    if not instruments.targets:
        return replace(instruments, reference="")
    for target in instruments.targets:
        tree.require_link(target.link)
    default = TRACKER if TRACKER in tree.links else tree.root
    reference = _link(tree, instruments.reference, "--reference") if instruments.reference else default
    others = tuple(replace(other, link=tree.require_link(other.link or default)) for other in instruments.others)
    return replace(instruments, reference=reference, others=others)


def _farthest(tree: UrdfTree, instruments: Instruments) -> str:
    """The link of the target that most joints move against the reference."""

    def moved_by(link: str) -> int:
        away, back = tree.path_from_root(link), tree.path_from_root(instruments.reference)
        return sum(joint.moves for joint in away if joint not in back) + sum(joint.moves for joint in back if joint not in away)

    link = max((target.link for target in instruments.targets), key=moved_by)
    if not moved_by(link):
        raise RigError(f"no moving joint between the reference '{instruments.reference}' and the target '{link}'", tree.label)
    return link


def _laser_rig(tree: UrdfTree, screen: str | None, lasers: Sequence[str] | None) -> Rig:
    if screen is None and not lasers and "screen" not in tree.links and not lasers_by_name(tree):
        raise RigError(_no_instrument(tree), tree.label)
    screen_link = _link(tree, "screen" if screen is None else screen, "--screen")
    laser_links = tuple(_link(tree, laser, "--laser") for laser in lasers) if lasers else _required_lasers(tree)
    if len(set(laser_links)) < len(laser_links):
        raise RigError(f"a laser is named twice: {', '.join(laser_links)}", tree.label)
    carriers = {laser: tree.moving_link(laser) for laser in laser_links}
    if len(set(carriers.values())) > 1:
        where = ", ".join(f"{laser} on {carrier}" for laser, carrier in carriers.items())
        way_out = f"choose with --laser, or name the screen of each in its columns, {laser_links[0]}@{screen_link}.y"
        raise RigError(f"all lasers must sit on one moving link, found {where}; {way_out}", tree.label)
    carrier = carriers[laser_links[0]]
    if tree.moving_link(screen_link) == carrier:
        raise RigError(f"no moving joint between the screen '{screen_link}' and the laser '{laser_links[0]}'", tree.label)
    for laser in laser_links:
        if laser == carrier:
            raise RigError(
                f"laser '{laser}' hangs on no fixed joint; give it one of its own, so that its mount can be corrected", tree.label
            )
    return Rig(screen_link, laser_links, _common_fixed_ancestor(tree, laser_links))


def _link(tree: UrdfTree, name: str, option: str) -> str:
    if name not in tree.links:
        raise RigError(
            f"{no_such('link', name, tree.links)} (choose with {option} LINK; urdfcal rig puts module and screen on a robot)",
            tree.label,
        )
    return name


def _no_instrument(tree: UrdfTree) -> str:
    """What to say of a robot that has neither screen nor lasers, where nothing else measures it either."""
    link = tree.last_link
    return (
        f"no laser, no screen, and nothing else that measures: name a link in the columns ({link}.x, {link}.y, {link}.z) or options "
        f"(dh --tip {link}, simulate --sensor point:{link}), or lasers and screen with --laser and --screen; "
        f"urdfcal rig {tree.label.removesuffix(' (expanded)')} --tip {link} --screen 1.3,0,0.5 -o cell.urdf puts these on the robot"
    )


def lasers_by_name(tree: UrdfTree) -> tuple[str, ...]:
    """Every link named `laser_<digits>`, in numeric order."""
    numbered = [(int(match[1]), link) for link in tree.links if (match := _LASER.match(link))]
    return tuple(link for _, link in sorted(numbered))


def _required_lasers(tree: UrdfTree) -> tuple[str, ...]:
    lasers = lasers_by_name(tree)
    if not lasers:
        raise RigError(
            "no link named laser_<digits>; name the lasers with --laser LINK, or put module and screen on the robot with urdfcal rig",
            tree.label,
        )
    return lasers


def _common_fixed_ancestor(tree: UrdfTree, lasers: Sequence[str]) -> str:
    ancestries = [_fixed_ancestors(tree, laser) for laser in lasers]
    return next(link for link in ancestries[0] if all(link in ancestry for ancestry in ancestries))


def _fixed_ancestors(tree: UrdfTree, link: str) -> list[str]:
    """The links above this one that are rigidly joined to it, nearest first."""
    ancestors: list[str] = []
    while link in tree.by_child and tree.by_child[link].rigid:
        link = tree.by_child[link].parent
        ancestors.append(link)
    return ancestors
