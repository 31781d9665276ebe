"""Calibration boards to print, true to scale, one a page: what `urdfcal boards` finds by the same words, which stand on the page's edge."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from urdfcal.base.errors import UsageError
from urdfcal.base.geometry import MM
from urdfcal.vision.camera import sheet
from urdfcal.vision.camera.boards import CharucoBoard, Chessboard
from urdfcal.vision.camera.circles import CircleGrid
from urdfcal.vision.camera.markers import aruco_dictionary, cells_of
from urdfcal.vision.camera.sheet import MARGIN_MM, Size
from urdfcal.vision.camera.sought import OPTION, Sought, TagGrid, parse_board

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_WORDS_MM = 11.0  # above the lower margin: the scale bar and a line of words
_LEAST_WHITE_MM, _MOST_WHITE_MM = 3.0, 20.0  # around a board
_LEAST_WIDE_MM = 140.0  # a page that is cut to its board: the words are to be read


@dataclass(frozen=True)
class BoardPage:
    """A board on its page, all in [mm].

    Attributes:
        text: The board's description.
        sought: What it describes.
        page: Width and height of the page.
        board: Width and height of what is black, from edge to edge.
        corner: Where corner 0 is, from the page's lower left.
    """

    text: str
    sought: Sought
    page: Size
    board: Size
    corner: Size


def board_sheet(pages: Sequence[BoardPage], ending: str, paper: str, dpi: float = 300.0) -> bytes:
    """A file to print.

    Args:
        pages: From `board_pages`.
        ending: `.pdf`, `.svg` or `.png`.
        paper: What the pages were laid out for.
        dpi: Of a PNG.

    Raises:
        UsageError: several boards where the format has one page, or too large a picture.
    """
    sheet.require_file([one.page for one in pages], "sheet of boards", ending, paper, dpi)
    figures = []
    for one in pages:
        figure, axes = sheet.page(one.page)
        _draw(axes, one)
        sheet.draw_scale(axes, one.page)
        figures.append(figure)
    return sheet.saved(figures, f"Boards: {', '.join(one.text for one in pages)}", ending, dpi)


def board_pages(texts: Sequence[str], paper: str) -> list[BoardPage]:
    """How boards are laid out, one a page.

    Args:
        texts: Descriptions of boards.
        paper: A page's size; `full` for pages as large as the boards.

    Raises:
        UsageError: a text is no board, there is no such paper, or a board does not fit on it.
    """
    size = sheet.paper_size(paper)
    return [_laid(text.rpartition("=")[2], parse_board(text), paper, size) for text in texts]


def _laid(text: str, sought: Sought, paper: str, size: Size | None) -> BoardPage:
    left, top, right, bottom = _extent(sought)
    width, height, white = right - left, bottom - top, _white(sought)
    side, below = max(MARGIN_MM, white), white + _WORDS_MM + MARGIN_MM
    needed = width + 2 * side, height + side + below
    if max(needed) > sheet.MOST_MM:
        raise UsageError(f"{OPTION} {text}: {width:g} x {height:g} mm is more than any page has, {sheet.MOST_MM:g} mm")
    page = (max(needed[0], _LEAST_WIDE_MM), needed[1]) if size is None else sheet.turned_for(needed, size)
    if page is None:
        raise UsageError(
            f"{OPTION} {text} does not fit on {paper}: {width:g} x {height:g} mm needs {sheet.paper_for(needed)} (with its margins "
            f"{needed[0]:.0f} x {needed[1]:.0f} mm); take --paper {sheet.paper_for(needed)}"
        )
    up = below + (page[1] - needed[1]) / 2
    return BoardPage(text, sought, page, (width, height), ((page[0] - width) / 2 - left, up + height + top))


def _extent(sought: Sought) -> tuple[float, float, float, float]:
    """From where to where a board is black, [mm] from corner 0: left, top, right, bottom; y down."""
    grid, board = sought.grid, sought.board
    last = grid.points().max(axis=0) / MM
    if isinstance(board, TagGrid):
        rim = 0.0
    else:
        rim = (board.diameter / 2 if isinstance(board, CircleGrid) else board.square) / MM
    return -rim, -rim, float(last[0]) + rim, float(last[1]) + rim


def _white(sought: Sought) -> float:
    """How much white a board needs around it, [mm]."""
    board = sought.board
    if isinstance(board, TagGrid):
        needed = board.side / (int(aruco_dictionary(board.dictionary).markerSize) + 2)
    else:
        needed = 0.5 * board.step if isinstance(board, CircleGrid) else 0.2 * board.square
    return min(max(needed / MM, _LEAST_WHITE_MM), _MOST_WHITE_MM)


def _draw(axes: Axes, one: BoardPage) -> None:
    drawers: dict[type, Callable[[Axes, BoardPage], str]] = {
        Chessboard: _chessboard,
        CharucoBoard: _charuco,
        TagGrid: _tags,
        CircleGrid: _circles,
    }
    own = drawers[type(one.sought.board)](axes, one)
    width, height = one.board
    words = f"{OPTION} {one.text}   {own}, {width:g} x {height:g} mm over all; x to the right, y down"
    sheet.draw_words(axes, one.page, MARGIN_MM + 7.2, words)


def _squares(axes: Axes, one: BoardPage, columns: int, rows: int, side: float) -> list[Size]:
    """Draw the black squares of a chessboard; the middles of the white ones, row by row."""
    white = []
    for row in range(rows):
        for column in range(columns):
            left, bottom = one.corner[0] + (column - 1) * side, one.corner[1] - row * side
            if (row + column) % 2:
                white.append((left + side / 2, bottom + side / 2))
            else:
                sheet.rectangle(axes, left, bottom, side, side, "black")
    return white


def _chessboard(axes: Axes, one: BoardPage) -> str:
    board = one.sought.board
    assert isinstance(board, Chessboard)
    _squares(axes, one, board.columns + 1, board.rows + 1, board.square / MM)
    return f"{board.columns + 1} x {board.rows + 1} squares, corner 0 the inner one at the upper left"


def _charuco(axes: Axes, one: BoardPage) -> str:
    board, first = one.sought.board, one.sought.first
    assert isinstance(board, CharucoBoard)
    for number, place in enumerate(_squares(axes, one, board.columns, board.rows, board.square / MM)):
        sheet.draw_marker(axes, cells_of(board.dictionary, first + number), place, board.marker / MM)
    return f"{board.dictionary}, ids {_ids(one)}, corner 0 the inner one at the upper left"


def _tags(axes: Axes, one: BoardPage) -> str:
    board, first = one.sought.board, one.sought.first
    assert isinstance(board, TagGrid)
    side, step = board.side / MM, (board.side + board.gap) / MM
    for number in range(board.columns * board.rows):
        row, column = divmod(number, board.columns)
        place = one.corner[0] + column * step + side / 2, one.corner[1] - row * step - side / 2
        sheet.draw_marker(axes, cells_of(board.dictionary, first + number), place, side)
    apart = f", {board.gap / MM:g} mm apart" if board.columns * board.rows > 1 else ""
    return f"{board.dictionary}, ids {_ids(one)}{apart}, corner 0 at the upper left"


def _circles(axes: Axes, one: BoardPage) -> str:
    board = one.sought.board
    assert isinstance(board, CircleGrid)
    for x, y in one.sought.grid.points()[:, :2] / MM:
        sheet.circle(axes, (one.corner[0] + x, one.corner[1] - y), board.diameter / MM / 2)
    return f"circles of {board.diameter / MM:g} mm, circle 0 at the upper left"


def _ids(one: BoardPage) -> str:
    ids = one.sought.ids
    return str(ids.start) if len(ids) == 1 else f"{ids.start} to {ids.stop - 1}"
