"""Numbers, sizes and boards that an option states, refused before any work is done."""

from __future__ import annotations

from typing import TYPE_CHECKING

from urdfcal.base.errors import UsageError

if TYPE_CHECKING:
    from urdfcal.robot.rig import Grid
    from urdfcal.robot.sheet import ScreenArea


_LEAST, _MOST = 1e-15, 1e6  # what a tolerance, a noise in mm or a size in m can be
_FAR = 100.0  # [m] a place or a size in a cell that is as large was meant in mm


def numbers_of(option: str, text: str, counts: tuple[int, ...], expected: str) -> tuple[float, ...]:
    """Numbers with commas between them.

    Raises:
        UsageError: they are none, or not so many.
    """
    from urdfcal.robot.urdf_xml import number_fault

    words = [word.strip() for word in text.split(",")]
    faults = [fault for word in words if (fault := number_fault(word))]
    if faults or len(words) not in counts:
        found = faults[0] if faults else f"found {len(words)} {'number' if len(words) == 1 else 'numbers'}"
        raise UsageError(f"{option} {text}: {found}; expected {expected}")
    return tuple(map(float, words))


def metres_of(option: str, text: str, counts: tuple[int, ...], expected: str) -> tuple[float, ...]:
    """Lengths in m with commas between them, none as long as only millimetres are.

    Raises:
        UsageError: they are none, not so many, or too far.
    """
    lengths = numbers_of(option, text, counts, expected)
    if max(map(abs, lengths)) > _FAR:
        far, metres = max(lengths, key=abs), ",".join(f"{length / 1e3:g}" for length in lengths)
        raise UsageError(f"{option} {text}: {far:g} m is too far for a cell; expected {expected}, and {metres} if these are mm")
    return lengths


def positive(option: str, value: float | None) -> float | None:
    """A positive number, or None where none was stated.

    Raises:
        UsageError: it is out of all bounds.
    """
    if value is not None and not _LEAST <= value <= _MOST:
        raise UsageError(f"{option} {value:g}: expected a number between {_LEAST:g} and {_MOST:g}")
    return value


def stated_area(text: str | None) -> ScreenArea | None:
    """A screen's size, `1.5` or `2,1.5` in m; None where none is stated.

    Raises:
        UsageError: the text is none.
    """
    from urdfcal.robot.sheet import ScreenArea

    return None if text is None else ScreenArea(stated_size(text, "the screen's width and height"))


def stated_size(text: str, expected: str) -> tuple[float, float]:
    """Width and height of --screen-size-m, [m]; a single number is both.

    Raises:
        UsageError: the text is none.
    """
    sides = metres_of("--screen-size-m", text, (1, 2), f"{expected} in m, such as 1.5 or 2,1.5")
    for side in sides:
        positive("--screen-size-m", side)
    return sides[0], sides[-1]


def parsed_grid(option: str, text: str) -> Grid:
    """The inner corners of a board: `9x6:25mm` of a chessboard, or `10x7:25mm:18mm:DICT` of a ChArUco board; the middles of circles.

    Raises:
        UsageError: the text is no such board.
    """
    from urdfcal.robot.rig import Grid
    from urdfcal.vision.camera.boards import parse_charuco, parse_chessboard
    from urdfcal.vision.camera.circles import parse_circles

    kind, _, rest = text.strip().partition(":")
    if kind == "circles":
        return parse_circles(rest, f"{option} circles:").grid
    if kind == "charuco":
        text = rest
    if text.count(":") > 1:
        squares = parse_charuco(text, option)
        return Grid(squares.columns - 1, squares.rows - 1, squares.square)
    corners = parse_chessboard(text, option)
    return Grid(corners.columns, corners.rows, corners.square)
