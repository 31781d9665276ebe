"""Boards in the pictures of all poses as `measurements.csv`, and what `rig.yaml` says of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from urdfcal.base.tables import Table, csv_text
from urdfcal.vision.camera.board_search import BoardSeen
from urdfcal.vision.camera.sought import Sought
from urdfcal.vision.spots.table import pose_columns


def boards_csv(
    views: Mapping[str, Sequence[BoardSeen | str]],
    boards: Sequence[Sought],
    table: Table | None = None,
    rows: Sequence[int] = (),
    comments: Sequence[str] = (),
) -> bytes:
    """The CSV: a row a picture in which a board is seen, columns `<link>:<corner>.u .v .sigma_px` of corners that are seen in any.

    Args:
        views: Each board as each picture shows it, by the picture's label.
        boards: What was looked for, in the order of the views.
        table: The poses; its columns are copied.
        rows: The table's row of each picture.
        comments: Lines for the head of the file.
    """
    kept = [index for index, seen in enumerate(views.values()) if any(isinstance(board, BoardSeen) for board in seen)]
    labels = list(views)
    columns = pose_columns([labels[index] for index in kept], table, [rows[index] for index in kept] if table is not None else [])
    for number, sought in enumerate(boards):
        columns |= _columns(sought, [list(views.values())[index][number] for index in kept])
    return csv_text(list(columns), zip(*columns.values(), strict=True), comments)


def _columns(sought: Sought, seen: Sequence[BoardSeen | str]) -> dict[str, list[str]]:
    numbers = np.full((len(seen), sought.grid.corners, 3), np.nan)
    for row, view in enumerate(seen):
        if isinstance(view, BoardSeen):
            numbers[row, view.corners] = np.column_stack([view.pixels, view.sigmas])
    return {
        f"{sought.link}:{corner}.{ending}": ["" if np.isnan(value) else f"{value:.4f}" for value in numbers[:, corner, column]]
        for corner in np.flatnonzero(~np.isnan(numbers[:, :, 0]).all(axis=0)).tolist()
        for column, ending in enumerate(("u", "v", "sigma_px"))
    }


def rig_yaml(boards: Sequence[Sought], camera_link: str | None) -> bytes:
    """What `rig.yaml` says of the boards, and of the camera where its link is known."""
    lines = ["# the boards' part of a rig.yaml, by urdfcal boards"]
    lines += [] if camera_link is None else [f"reference: {_quoted(camera_link)}  # the link that the camera sits on"]
    lines += ["boards:", *(f"  {_quoted(sought.link)}: '{sought.in_rig()}'" for sought in boards)]
    return ("\n".join(lines) + "\n").encode()


def _quoted(name: str) -> str:
    return "'" + name.replace("'", "''") + "'"
