"""What measures beside lasers: targets on links, the frame they are seen in, and unknown places that they touch.

A *target* is a point or a whole frame that is fixed to a link, at an offset that is not known. It is seen from a *measuring frame*
(a tracker, a camera, a board) that stands on the reference link, at a placement that is not known either. *Places* are points and
planes in the room that several poses have in common.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Target:
    """Something on a link that is seen, or that touches.

    Attributes:
        name: Link, with `:<label>` behind it where one link has several targets.
        link: The link.
        whole: Whether its orientation matters, so that its offset has six numbers; a point has three.
        board: Name of the board that it is a corner of, and whose six numbers place it; the empty string for none.
        at: Where it is on that board, [m].
    """

    name: str
    link: str
    whole: bool = False
    board: str = ""
    at: tuple[float, float, float] = (0.0, 0.0, 0.0)

    @property
    def placed_by(self) -> str:
        """First half of the names of the parameters that place it on its link."""
        return self.board or self.name


@dataclass(frozen=True)
class Grid:
    """The inner corners of a chessboard, numbered row by row from the first one; x along a row, y down the columns.

    Attributes:
        columns: Corners in a row.
        rows: Rows of them.
        square: Side of a square, [m].
    """

    columns: int
    rows: int
    square: float

    def at(self, corner: int) -> tuple[float, float, float]:
        """Where a corner is on the board, [m]."""
        row, column = divmod(corner, self.columns)
        return column * self.square, row * self.square, 0.0

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
    """

    name: str
    names: tuple[str, ...]
    units: tuple[str, ...]


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
    """

    targets: tuple[Target, ...] = ()
    reference: str = ""
    placed: bool = False
    places: tuple[Place, ...] = ()
    camera_sigma: tuple[float, ...] = ()


NONE = Instruments()
