"""Calibration boards: a chessboard or a ChArUco board, described in a word and found in a picture to a fraction of a pixel.

    --board 9x6:25mm                    9 x 6 INNER corners (10 x 7 squares) of 25 mm
    --charuco 10x7:25mm:18mm:DICT_4X4_50   10 x 7 SQUARES of 25 mm, markers of 18 mm (OpenCV's CharucoBoard; dictionary as shown by default)

Sub-pixel: `cornerSubPix` with a window of its own for every corner, 0.3 of the distance to the nearest of its eight
neighbours (0.25 to 0.35 serve equally well). A window of fixed size reaches the next corners in far and oblique views: on
OpenCV's own chessboard pictures it makes the residual 0.41 and 0.46 px in place of 0.18 px.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Protocol

import cv2
import numpy as np
import numpy.typing as npt

from urdfcal.base.errors import UsageError, did_you_mean
from urdfcal.base.geometry import MM, Array3, Mask, Matrix, Vector
from urdfcal.vision.camera.markers import aruco_dictionary, dictionary_names
from urdfcal.vision.pictures import Grey

Numbers = npt.NDArray[np.intp]  # of a board's corners

_UNITS = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "": 1.0}
LENGTH = r"(\d+(?:\.\d+)?)(mm|cm|m|)"  # a number and its unit
_MOST_CORNERS = 100
LEAST_CORNERS = 3
_NEAR = (-2, -1, 0, 1, 2)  # by how many corners people miscount
LEAST_CHARUCO = 6
_PART = (3, 3)  # corners of the least part of a chessboard that is taken for one
_LEAST_STEP, _LEAST_SQUARES, _MOST_RIGHT = 25.0, 8, 0.85  # grey levels from dark to light; squares; the share that alternates
_WINDOW = 0.3  # of the distance to the next corner
_SHORTEST_PX = 16  # OpenCV fails on less, and no board can be seen in it
_LONGEST_PX = 1600  # larger pictures are shrunk for finding the board, not for measuring it
_HINT_PX = 640  # the same for guessing its size: 26 sizes are tried
LEAST_WINDOW_PX, MOST_WINDOW_PX = 2, 11  # half the side
_QUICK = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_FAST_CHECK  # without the check eight seconds of noise
_SECTORS = cv2.CALIB_CB_NORMALIZE_IMAGE
_SETTLED = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 100, 1e-4)


@dataclass(frozen=True, eq=False)
class BoardView:
    """A board in one picture.

    Attributes:
        name: The picture.
        points: Corners in board axes (x along the columns, y along the rows, z = 0), (n, 3), [m].
        pixels: The same in the picture, (n, 2).
        areas: Of circles, whose centres the points are: (n,), [px^2]; the pixels are the centres of these areas.
    """

    name: str
    points: Matrix
    pixels: Matrix
    areas: Vector | None = None


class Board(Protocol):
    """What can be found in a picture."""

    def find(self, picture: Grey, name: str) -> BoardView | str:
        """Its corners, or why they were not found."""


@dataclass(frozen=True)
class Chessboard:
    """A chessboard by its inner corners.

    Attributes:
        columns: Inner corners in a row.
        rows: Inner corners in a column.
        square: Side of a square, [m].
    """

    columns: int
    rows: int
    square: float

    def __str__(self) -> str:
        return f"chessboard with {self.columns} x {self.rows} inner corners"

    def find(self, picture: Grey, name: str) -> BoardView | str:
        """Its corners, row by row, or why they were not found."""
        grid = self.find_grid(picture)
        if grid is None:
            part = self.part_of(picture)
            if part is None:
                return f"no {self} found"
            return (
                f"no {self} found, but {part[0]} x {part[1]} of them: part of the board is hidden, or they are miscounted; "
                "a chessboard must be seen whole, a ChArUco board (charuco:) need not"
            )
        if self._goes_on(picture, grid):
            return f"the board goes on beyond {self.columns} x {self.rows} inner corners; count all inner corners of the board"
        return BoardView(name, self.points, refined(picture, grid).reshape(-1, 2))

    @cached_property
    def points(self) -> Matrix:
        """Corners in board axes, row by row, (n, 3), [m]."""
        row, column = np.mgrid[0 : self.rows, 0 : self.columns]
        return np.asarray(self.square * np.stack([column, row, np.zeros_like(row)], axis=-1).reshape(-1, 3).astype(float))

    def other_size(self, picture: Grey) -> Chessboard | None:
        """A whole board that has a few corners more or fewer than this one, if there is one: counting goes wrong easily."""
        picture = _shrunk(picture, _HINT_PX)
        shifts = sorted(((across, down) for across in _NEAR for down in _NEAR), key=lambda shift: abs(shift[0]) + abs(shift[1]))
        for across, down in [(-1, -1), *shifts]:
            board = Chessboard(self.columns + across, self.rows + down, self.square)
            grid = board.find_grid(picture, thorough=False) if min(board.columns, board.rows) >= LEAST_CORNERS else None
            if grid is not None and not board._goes_on(picture, grid):
                return board
        return None

    def part_of(self, picture: Grey) -> tuple[int, int] | None:
        """Columns and rows of the largest part of a chessboard that is seen; None where none is, or it has more corners than this one."""
        picture = _shrunk(picture, _HINT_PX)
        if min(picture.shape) < _SHORTEST_PX:
            return None
        found, corners, kinds = cv2.findChessboardCornersSBWithMeta(picture, _PART, flags=_SECTORS | cv2.CALIB_CB_LARGER)
        if (
            not found
            or kinds.size >= self.columns * self.rows
            or not _alternates(picture, np.asarray(corners, dtype=float).reshape(*kinds.shape, 2))
        ):
            return None
        rows, columns = kinds.shape
        return (columns, rows) if (columns > rows) == (self.columns > self.rows) else (rows, columns)

    def find_grid(self, picture: Grey, thorough: bool = True) -> Array3 | None:
        """Rough corners (rows, columns, 2) in pixels; `thorough` takes a second or two where there is no board, else a quarter of one."""
        if min(picture.shape) < _SHORTEST_PX:
            return None
        small = _shrunk(picture, _LONGEST_PX)
        shrink = picture.shape[1] / small.shape[1]
        pattern = (self.columns, self.rows)
        found, corners = cv2.findChessboardCorners(small, pattern, flags=_QUICK) if thorough else (False, None)
        if not found:
            found, corners = cv2.findChessboardCornersSB(small, pattern, flags=_SECTORS | (cv2.CALIB_CB_EXHAUSTIVE if thorough else 0))
        if not found:
            return None
        grid: Array3 = np.asarray(corners, dtype=float).reshape(self.rows, self.columns, 2)
        return np.asarray(shrink * (grid + 0.5) - 0.5)

    def _goes_on(self, picture: Grey, grid: Array3) -> bool:
        """Whether the squares alternate beyond the outermost ones on some side, so that more corners are there than stated.

        OpenCV finds a part of a larger board as readily as a whole one. The outermost squares may be cut narrow, so that those
        beyond them are looked for close to the corners.
        """
        places = _cells(grid)
        levels, even = shades(picture, places)
        inside = np.asarray((places > 1) & (places < np.array(picture.shape[::-1]) - 2)).all(axis=-1)
        board = np.zeros_like(even)
        board[2:-2, 2:-2] = True
        one, other = np.median(levels[board & even]), np.median(levels[board & ~even])
        as_board = np.asarray((levels > (one + other) / 2) == np.where(even, one > other, other > one))
        on = as_board & inside
        return any(bool(side[1:-1].all()) for side in (on[0], on[-1], on[:, 0], on[:, -1]))


def _alternates(picture: Grey, grid: Array3) -> bool:
    """Whether the squares between corners (rows, columns, 2) are dark and light by turns, but for a few at the edge of what hides it."""
    levels, even = shades(picture, (grid[:-1, :-1] + grid[1:, :-1] + grid[:-1, 1:] + grid[1:, 1:]) / 4)
    one, other = float(np.median(levels[even])), float(np.median(levels[~even]))
    as_board = (levels > (one + other) / 2) == np.where(even, one > other, other > one)
    return abs(one - other) > _LEAST_STEP and levels.size >= _LEAST_SQUARES and bool(as_board.mean() > _MOST_RIGHT)


def _shrunk(picture: Grey, longest: int) -> Grey:
    """A picture whose longer side has at most so many pixels."""
    shrink = max(1.0, max(picture.shape) / longest)
    small = picture if shrink == 1 else cv2.resize(picture, None, fx=1 / shrink, fy=1 / shrink, interpolation=cv2.INTER_AREA)
    return np.asarray(small, dtype=np.uint8)


@dataclass(frozen=True)
class CharucoBoard:
    """A ChArUco board by its squares.

    Attributes:
        columns: Squares in a row.
        rows: Squares in a column.
        square: Side of a square, [m].
        marker: Side of a marker, [m].
        dictionary: Name of the ArUco dictionary.
    """

    columns: int
    rows: int
    square: float
    marker: float
    dictionary: str

    def __str__(self) -> str:
        return f"ChArUco board of {self.columns} x {self.rows} squares with {self.dictionary}"

    def find(self, picture: Grey, name: str) -> BoardView | str:
        """Those of its corners that are seen, or why too few are."""
        numbers, pixels = self.numbered(picture)
        points = np.asarray(self.opencv_board().getChessboardCorners(), dtype=float)[numbers]
        count = len(numbers)
        if count < LEAST_CHARUCO or np.linalg.matrix_rank(points[:, :2] - points[0, :2], tol=self.square / 2) < 2:
            return f"no {self} found" if count == 0 else f"only {count} corners of the {self} found, expected {LEAST_CHARUCO} or more"
        return BoardView(name, points, pixels)

    def numbered(self, picture: Grey, first: int = 0) -> tuple[Numbers, Matrix]:
        """Numbers (n,) and pixels (n, 2) of the corners that are seen, the board's first marker having the id `first`."""
        return max(self._by_pattern(picture, first), key=lambda found: len(found[0]))

    def is_legacy(self, picture: Grey, first: int = 0) -> bool:
        """Whether a picture shows the pattern as OpenCV drew it before version 4.6: more of its corners are seen that way."""
        counts = [len(numbers) for numbers, _ in self._by_pattern(picture, first)]
        return len(counts) > 1 and counts[1] > counts[0]

    def _by_pattern(self, picture: Grey, first: int) -> list[tuple[Numbers, Matrix]]:
        """Corners as OpenCV draws the board, and as it did before version 4.6 where the number of rows is even."""
        patterns = [self.opencv_board(legacy, first) for legacy in ((False,) if self.rows % 2 else (False, True))]
        return [_corners_of(pattern, picture) for pattern in patterns]

    def opencv_board(self, legacy: bool = False, first: int = 0) -> Any:
        """OpenCV's own object."""
        ids = np.arange(first, first + self.columns * self.rows // 2)
        board = cv2.aruco.CharucoBoard((self.columns, self.rows), self.square, self.marker, aruco_dictionary(self.dictionary), ids)
        board.setLegacyPattern(legacy)
        return board


def _corners_of(pattern: Any, picture: Grey) -> tuple[Numbers, Matrix]:
    """Numbers and pixels of the corners of OpenCV's board that are seen."""
    corners, ids, _, _ = cv2.aruco.CharucoDetector(pattern).detectBoard(picture)
    if ids is None:
        return np.empty(0, dtype=np.intp), np.empty((0, 2))
    return np.asarray(ids, dtype=np.intp).ravel(), np.asarray(corners, dtype=float).reshape(-1, 2)


def refined(picture: Grey, grid: Array3) -> Array3:
    """Corners (rows, columns, 2) to a fraction of a pixel."""
    rows, columns = grid.shape[:2]
    padded = np.full((rows + 2, columns + 2, 2), np.inf)
    padded[1:-1, 1:-1] = grid
    shifts = [(down, right) for down in range(3) for right in range(3) if (down, right) != (1, 1)]
    nearest = np.min([np.linalg.norm(padded[down : down + rows, right : right + columns] - grid, axis=2) for down, right in shifts], axis=0)
    windows = np.clip((_WINDOW * nearest).astype(int), LEAST_WINDOW_PX, MOST_WINDOW_PX)
    return settled_corners(picture, grid.reshape(-1, 2), windows.ravel()).reshape(grid.shape)


def settled_corners(picture: Grey, pixels: Matrix, windows: Vector) -> Matrix:
    """Corners (n, 2) to a fraction of a pixel, each in a window of so many pixels, (n,), to either side."""
    corners = pixels.astype(np.float32)
    for window in np.unique(windows):
        chosen = windows == window
        corners[chosen] = cv2.cornerSubPix(picture, corners[chosen].reshape(-1, 1, 2), (int(window), int(window)), (-1, -1), _SETTLED)[:, 0]
    return np.asarray(corners, dtype=float)


def shades(picture: Grey, cells: Array3) -> tuple[Grey, Mask]:
    """Brightness of a chessboard's squares at places in them (rows, columns, 2) [px], and which have the colour of the first."""
    across, down = np.moveaxis(cells.astype(np.float32), -1, 0)
    levels = cv2.remap(cv2.blur(picture, (3, 3)), across, down, cv2.INTER_LINEAR)
    return np.asarray(levels, dtype=np.uint8), np.asarray(np.indices(levels.shape).sum(axis=0) % 2 == 0)


def _cells(grid: Array3) -> Array3:
    """Places in the squares of a board and, on every side, in the next two rows of squares, were it to go on, [px]."""
    rows, columns = grid.shape[:2]
    across, down = (np.array([-1.2, -0.2, *np.arange(count - 1) + 0.5, count - 0.8, count + 0.2]) for count in (columns, rows))
    corners = np.stack(np.meshgrid(np.arange(columns), np.arange(rows)), axis=-1).reshape(-1, 2).astype(float)
    homography, _ = cv2.findHomography(corners, grid.reshape(-1, 2))
    cells = np.stack(np.meshgrid(across, down), axis=-1)
    return np.asarray(cv2.perspectiveTransform(cells.reshape(-1, 1, 2), homography), dtype=float).reshape(cells.shape)


def slopes_of(points: Matrix, pixels: Matrix) -> Array3 | None:
    """How pixels (n, 2) of a plane's points (n, 3) with z = 0 move with them, (n, 2, 2), [px/m]; None where no plane is seen."""
    homography, _ = cv2.findHomography(points[:, :2], pixels, cv2.RANSAC, 10.0)
    if homography is None:
        return None
    weight = points[:, :2] @ homography[2, :2] + homography[2, 2]
    return np.asarray((homography[None, :2, :2] - pixels[:, :, None] * homography[None, 2:, :2]) / weight[:, None, None])


def parse_chessboard(text: str, option: str = "--board") -> Chessboard:
    """`9x6:25mm`.

    Raises:
        UsageError: the text is no board.
    """
    match = re.fullmatch(rf"(\d+)x(\d+):{LENGTH}", text.strip())
    if not match:
        raise UsageError(f"{option} {text}: expected COLUMNSxROWS:SQUARE such as 9x6:25mm, counting inner corners")
    columns, rows, square, unit = match.groups()
    require_counts(option, text, int(columns), int(rows), LEAST_CORNERS)
    return Chessboard(int(columns), int(rows), length_of(option, text, square, unit))


def parse_charuco(text: str, option: str = "--charuco") -> CharucoBoard:
    """`10x7:25mm:18mm:DICT_4X4_50`.

    Raises:
        UsageError: the text is no board.
    """
    match = re.fullmatch(rf"(\d+)x(\d+):{LENGTH}:{LENGTH}(?::(\w+))?", text.strip())
    if not match:
        raise UsageError(
            f"{option} {text}: expected COLUMNSxROWS:SQUARE:MARKER[:DICT] such as 10x7:25mm:18mm:DICT_4X4_50, counting squares"
        )
    columns, rows, square, square_unit, marker, marker_unit, dictionary = match.groups()
    require_counts(option, text, int(columns), int(rows), LEAST_CORNERS)
    name, names = dictionary or "DICT_4X4_50", dictionary_names()
    if name not in names:
        raise UsageError(f"{option} {text}: no dictionary '{name}'{did_you_mean(name, names)}")
    sides = length_of(option, text, square, square_unit), length_of(option, text, marker, marker_unit)
    if not sides[1] < sides[0]:
        raise UsageError(f"{option} {text}: a marker is smaller than its square; expected SQUARE before MARKER")
    if int(columns) * int(rows) // 2 > len(aruco_dictionary(name).bytesList):
        raise UsageError(f"{option} {text}: {name} has too few markers for {int(columns) * int(rows) // 2} white squares")
    return CharucoBoard(int(columns), int(rows), *sides, name)


def require_counts(option: str, text: str, columns: int, rows: int, least: int) -> None:
    """Refuse boards that nobody has.

    Raises:
        UsageError: too few columns or rows, or too many.
    """
    if not (least <= columns <= _MOST_CORNERS and least <= rows <= _MOST_CORNERS):
        raise UsageError(f"{option} {text}: expected {least} to {_MOST_CORNERS} columns and rows")


def length_of(option: str, text: str, number: str, unit: str) -> float:
    """A length of a description, [m].

    Raises:
        UsageError: no board has such a one.
    """
    millimetres = float(number) * _UNITS[unit]
    if not 0.01 <= millimetres <= 1e4:
        raise UsageError(f"{option} {text}: a length of {millimetres:g} mm, expected 0.01 to 10000 mm")
    return millimetres * MM
