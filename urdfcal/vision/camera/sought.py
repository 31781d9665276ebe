"""Boards that are looked for, described in a word each; several are told apart by their ids.

    9x6:25mm                          chessboard, 9 x 6 INNER corners of 25 mm
    charuco:7x5:40mm:30mm[:DICT]      ChArUco board, 7 x 5 SQUARES of 40 mm, markers of 30 mm
    apriltag:36h11:6x4:30mm[:9mm]     6 x 4 tags of 30 mm (their black square), 9 mm apart; by default 0.3 of the tag
    aruco:4X4_50:1x1:80mm             the same of ArUco markers, here a single one
    circles:4x11:20mm[:14mm]          4 circles in a row, 11 rows 20 mm apart, every second shifted by 20 mm; their diameter, for printing

Before the word may stand the link that carries the board, `hand=`, behind it the id of the board's first marker, `@24`. Tags are numbered
row by row from the top left. Corners are numbered row by row over the whole board, as `rig.yaml` has them: of tags, all four of each.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from urdfcal.base.errors import UsageError, did_you_mean
from urdfcal.base.geometry import MM
from urdfcal.robot.rig import Grid
from urdfcal.vision.camera.boards import LENGTH, CharucoBoard, Chessboard, length_of, parse_charuco, parse_chessboard
from urdfcal.vision.camera.circles import CircleGrid, parse_circles
from urdfcal.vision.camera.markers import aruco_dictionary, dictionary_names

OPTION = "--board"
_TAGS = re.compile(rf"(apriltag|aruco):(\w+):(\d+)x(\d+):{LENGTH}(?::{LENGTH})?")
_USUAL_GAP = 0.3  # of a tag's side
_MOST_TAGS = 100  # in a row
_EXAMPLES = "expected 9x6:25mm, charuco:7x5:40mm:30mm, apriltag:36h11:6x4:30mm, aruco:4X4_50:6x4:30mm or circles:4x11:20mm"


@dataclass(frozen=True)
class TagGrid:
    """Tags in rows and columns; one alone is a grid, too.

    Attributes:
        columns: Tags in a row.
        rows: Rows of them.
        side: Side of a tag's black square, [m].
        gap: Between two of them, [m].
        dictionary: Name of OpenCV's dictionary.
    """

    columns: int
    rows: int
    side: float
    gap: float
    dictionary: str

    def __str__(self) -> str:
        return f"{self.columns} x {self.rows} tags of {self.dictionary}"

    def corners_of(self, tag: int) -> tuple[int, int, int, int]:
        """Numbers on the board of a tag's corners: top left, top right, bottom right, bottom left."""
        row, column = divmod(tag, self.columns)
        first, below = 4 * self.columns * row + 2 * column, 4 * self.columns * row + 2 * column + 2 * self.columns
        return first, first + 1, below + 1, below


AnyBoard = Chessboard | CharucoBoard | TagGrid | CircleGrid


@dataclass(frozen=True)
class Sought:
    """A board that is looked for.

    Attributes:
        link: The link that carries it.
        board: What it is.
        first: Id of its first marker.
    """

    link: str
    board: AnyBoard
    first: int = 0

    @property
    def grid(self) -> Grid:
        """Its corners, as `rig.yaml` has them."""
        board = self.board
        if isinstance(board, CircleGrid):
            return board.grid
        if isinstance(board, TagGrid):
            return Grid(2 * board.columns, 2 * board.rows, board.side, board.gap)
        inner = (board.columns, board.rows) if isinstance(board, Chessboard) else (board.columns - 1, board.rows - 1)
        return Grid(*inner, board.square)

    @property
    def ids(self) -> range:
        """Ids of its markers; none of a board without them."""
        board, count = self.board, self.board.columns * self.board.rows
        without = isinstance(board, Chessboard | CircleGrid)
        return range(self.first, self.first + (0 if without else count // 2 if isinstance(board, CharucoBoard) else count))

    def in_rig(self) -> str:
        """What `rig.yaml` says of it."""
        grid = self.grid
        gap, kind = "" if grid.gap is None else f":{grid.gap / MM:.10g}mm", "circles:" if grid.staggered else ""
        return f"{kind}{grid.columns}x{grid.rows}:{grid.square / MM:.10g}mm{gap}"


def parse_boards(texts: Sequence[str], target: str | None) -> tuple[Sought, ...]:
    """Boards by their descriptions.

    Args:
        texts: One a board.
        target: The link that carries one whose description names none.

    Raises:
        UsageError: a text is no board, or two boards cannot be told apart.
    """
    found = tuple(parse_board(text, target) for text in texts)
    if target is not None and all("=" in text for text in texts):
        raise UsageError(f"--target {target}: every {OPTION} names its link; leave --target out")
    for index, one in enumerate(found):
        for other in found[:index]:
            _require_apart(one, other)
    return found


def parse_board(text: str, target: str | None = None) -> Sought:
    """One board by its description.

    Raises:
        UsageError: the text is no board.
    """
    link, equals, rest = text.strip().rpartition("=")
    word, at, first = rest.partition("@")
    if at and not (first.isdecimal() and len(first) < 7):
        raise UsageError(f"{OPTION} {text}: expected the id of the first marker behind @, such as @24")
    if equals and not link:
        raise UsageError(f"{OPTION} {text}: expected a link before =, such as hand={word}")
    sought = Sought(link or target or "board", _board(text, word), int(first or 0))
    _require_ids(text, sought, bool(at))
    return sought


def parse_lens_board(text: str) -> Chessboard | CharucoBoard | CircleGrid:
    """A board that a lens can be found from.

    Raises:
        UsageError: the text is none.
    """
    kind, _, rest = text.strip().partition(":")
    if kind == "charuco":
        return parse_charuco(rest, f"{OPTION} charuco:")
    if kind == "circles":
        return parse_circles(rest, f"{OPTION} circles:")
    if kind in ("apriltag", "aruco"):
        raise UsageError(
            f"{OPTION} {text}: tags are measured with a lens that is known; take 9x6:25mm, charuco:7x5:40mm:30mm or circles:4x11:20mm"
        )
    return parse_chessboard(text)


def _board(text: str, word: str) -> AnyBoard:
    kind, colon, rest = word.partition(":")
    if kind == "charuco" and colon:
        return parse_charuco(rest, f"{OPTION} charuco:")
    if kind == "circles" and colon:
        return parse_circles(rest, f"{OPTION} circles:")
    match = _TAGS.fullmatch(word)
    if match:
        return _tags(text, match)
    if kind in ("apriltag", "aruco") or not re.match(r"\d+x\d+$", kind):
        raise UsageError(f"{OPTION} {text}: no board of this description; {_EXAMPLES}")
    return parse_chessboard(word)


def _tags(text: str, match: re.Match[str]) -> TagGrid:
    family, name, columns, rows, side, unit, gap, gap_unit = match.groups()
    known = {known.removeprefix("DICT_").removeprefix("APRILTAG_"): known for known in dictionary_names()}
    of_family = {short: known for short, known in known.items() if known.startswith("DICT_APRILTAG_") == (family == "apriltag")}
    short = name.removeprefix("DICT_").removeprefix("APRILTAG_")
    if short not in of_family:
        way_out = did_you_mean(short, list(of_family)) or f"; there are {', '.join(of_family)}"
        raise UsageError(f"{OPTION} {text}: no {family} dictionary '{name}'{way_out}")
    if not (1 <= int(columns) <= _MOST_TAGS and 1 <= int(rows) <= _MOST_TAGS):
        raise UsageError(f"{OPTION} {text}: expected 1 to {_MOST_TAGS} columns and rows of tags")
    length = length_of(OPTION, text, side, unit)
    between = _USUAL_GAP * length if gap is None else length_of(OPTION, text, gap, gap_unit)
    return TagGrid(int(columns), int(rows), length, between, of_family[short])


def _require_ids(text: str, sought: Sought, stated: bool) -> None:
    """Refuse ids of what has none, and more of them than the dictionary has."""
    board = sought.board
    if isinstance(board, Chessboard | CircleGrid):
        if stated:
            raise UsageError(
                f"{OPTION} {text}: a {'chessboard' if isinstance(board, Chessboard) else 'grid of circles'} has no ids; leave @ out"
            )
        return
    there = len(aruco_dictionary(board.dictionary).bytesList)
    if sought.ids.stop > there:
        raise UsageError(f"{OPTION} {text}: needs ids to {sought.ids.stop - 1}, and {board.dictionary} has 0 to {there - 1}")


def _require_apart(one: Sought, other: Sought) -> None:
    """Refuse boards that would be taken for each other."""
    if one.link == other.link:
        raise UsageError(f"{OPTION}: two boards on link '{one.link}'; name a link for each, such as hand=... and wall=...")
    mine, its = one.board, other.board
    if isinstance(mine, Chessboard | CircleGrid) or isinstance(its, Chessboard | CircleGrid):
        if type(mine) is type(its) and {mine.columns, mine.rows} == {its.columns, its.rows}:
            kind = "chessboards" if isinstance(mine, Chessboard) else "grids of circles"
            raise UsageError(f"{OPTION}: the {kind} on {other.link} and {one.link} look the same; boards with markers have ids")
        return
    if mine.dictionary != its.dictionary:
        return
    if max(one.ids.start, other.ids.start) < min(one.ids.stop, other.ids.stop):
        first = max(one.ids.stop, other.ids.stop)
        raise UsageError(f"{OPTION}: the boards on {other.link} and {one.link} share ids; let one begin elsewhere, such as @{first}")
