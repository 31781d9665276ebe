"""From labelled spots to the measurements' CSV: pose, the joint columns of a table of poses, spots, their sigmas, pixels.

A spot's sigma on the screen is sqrt(trace(J C J') / 2) with C its covariance in the picture and J the derivative of the place on the
screen by the pixel: it grows where the camera looks at a slant. The camera's own errors move all spots together and are not in it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from urdfcal.base.errors import MeasurementError
from urdfcal.base.geometry import Array3
from urdfcal.base.tables import Table, csv_text
from urdfcal.sensors.camera import Camera
from urdfcal.vision.pictures import picture_name
from urdfcal.vision.spots.detector import PixelSpot

_NAMING = ("image", "pose")  # columns that name pictures
_SPOT_ENDINGS = (".y", ".z", ".sigma", ".u", ".v", ".sigma_px")


def joined(groups: Mapping[str, Sequence[Path]], table: Table) -> tuple[list[int], str]:
    """The table's row of every pose, and a warning where nothing but the order says so.

    Rows are found by the column `image` (a file's name, with or without its ending, or the pose's label), or by the column `pose` if
    the other is missing or names none of the pictures; by order if the table has neither column. A cell names what it says, or what
    a picture made of it is named (`home pose`: home_pose.png).

    Raises:
        MeasurementError: a pose has no row, or two; or order is all there is and the numbers differ.
    """
    columns = [name for name in _NAMING if name in table.names]
    if not columns:
        return _by_order(groups, table)
    found = {name: {label: _rows_of(table.columns[name], label, paths) for label, paths in groups.items()} for name in columns}
    column = next((name for name in columns if any(found[name].values())), columns[0])
    for label, matches in found[column].items():
        if len(matches) != 1:
            none = "" if any(found[column].values()) else "; write a column 'image' with the pictures' names, or have none to join by order"
            found_rows = f"{len(matches) or 'no'} row(s) for the picture {groups[label][0].name}"
            raise table.fail(matches[1] if matches else None, column, f"{found_rows}, expected one{none}")
    rows = [row for (row,) in found[column].values()]
    for row in rows:
        if rows.count(row) > 1:
            raise table.fail(row, column, f"'{table.columns[column][row]}' names two pictures; write a column 'image' with whole names")
    return rows, ""


def _by_order(groups: Mapping[str, Sequence[Path]], table: Table) -> tuple[list[int], str]:
    if len(table) != len(groups):
        raise MeasurementError(
            f"has {len(table)} rows for {len(groups)} poses with pictures, and no column 'image' or 'pose' that names the pictures",
            table.path,
        )
    return list(range(len(table))), f"{table.path}: has no column 'image' or 'pose'; joined by order, the first is {next(iter(groups))}"


def _rows_of(cells: Sequence[str], label: str, paths: Sequence[Path]) -> list[int]:
    """The rows that name a pose: to the letter, else as a file is named after them."""
    names = {label, *(path.name for path in paths), *(path.stem for path in paths)}
    rows = [row for row, cell in enumerate(cells) if cell in names]
    return rows or [row for row, cell in enumerate(cells) if picture_name(cell) in names]


def known_labels(table: Table) -> set[str]:
    """What a table calls its poses, and what their pictures can be named."""
    cells = {cell for column in _NAMING for cell in table.columns.get(column, [])}
    return cells | {picture_name(cell) for cell in cells}


def sigma_on_screen(camera: Camera, spot: PixelSpot) -> float:
    """Standard deviation of a spot's coordinates on the screen, [m]."""
    jacobian = camera.spot_jacobian(spot.centre[None])[0]
    return float(np.sqrt(np.trace(jacobian @ spot.covariance @ jacobian.T) / 2))


def spots_csv(
    labels: Sequence[str],
    spots: Sequence[Mapping[str, PixelSpot]],
    lasers: Sequence[str],
    *,
    camera: Camera | None = None,
    pixels: bool = False,
    table: Table | None = None,
    rows: Sequence[int] = (),
    comments: Sequence[str] = (),
) -> bytes:
    """The CSV.

    Args:
        labels: Label of each pose; the table's own goes before it.
        spots: The spot of each laser in each pose.
        lasers: Names of the lasers.
        camera: Makes the columns `.y .z .sigma` [m].
        pixels: Whether `.u .v .sigma_px` are written, as seen through the lens.
        table: The poses; its columns are copied.
        rows: The table's row of each pose.
        comments: Lines for the head of the file.
    """
    columns: dict[str, Sequence[str | float]] = {**pose_columns(labels, table, rows)}
    for laser in lasers:
        seen = [found.get(laser) for found in spots]
        columns |= _in_metres(laser, seen, camera) if camera else {}
        columns |= _in_pixels(laser, seen) if pixels else {}
    return csv_text(list(columns), zip(*columns.values(), strict=True), comments)


def pose_columns(labels: Sequence[str], table: Table | None, rows: Sequence[int]) -> dict[str, list[str]]:
    """What is known of the poses before pictures are looked at: their names and the table's own columns.

    Args:
        labels: Label of each pose; the table's own goes before it.
        table: The poses; None for none.
        rows: The table's row of each pose.
    """
    return {"pose": _poses(labels, table, rows), **({} if table is None else _copied(table, rows))}


def _poses(labels: Sequence[str], table: Table | None, rows: Sequence[int]) -> list[str]:
    """What the table calls the poses, or else what the pictures are called."""
    if table is None or "pose" not in table.names:
        return list(labels)
    return [table.columns["pose"][row] or label for row, label in zip(rows, labels, strict=True)]


def _copied(table: Table, rows: Sequence[int]) -> dict[str, list[str]]:
    """The table's own columns but for names of pictures and spots, with decimal points."""
    names = [name for name in table.names if name not in _NAMING and not name.endswith(_SPOT_ENDINGS)]
    return {table.title(name): [_plain(table, name, row) for row in rows] for name in names}


def _plain(table: Table, name: str, row: int) -> str:
    cell = table.columns[name][row]
    return cell if name in ("set", "session") else table.with_point(cell)


def _in_metres(laser: str, seen: Sequence[PixelSpot | None], camera: Camera) -> dict[str, list[str]]:
    """A laser's spots on the screen, to a nanometre."""
    spots = [(*camera.spots_of_pixels(spot.centre[None])[0], sigma_on_screen(camera, spot)) if spot else None for spot in seen]
    return _columns(laser, {"y": ".9g", "z": ".9g", "sigma": ".4g"}, spots)


def _in_pixels(laser: str, seen: Sequence[PixelSpot | None]) -> dict[str, list[str]]:
    """A laser's spots in the picture."""
    spots = [(*spot.centre, np.sqrt(np.trace(spot.covariance) / 2)) if spot else None for spot in seen]
    return _columns(laser, {"u": ".4f", "v": ".4f", "sigma_px": ".4f"}, spots)


def _columns(laser: str, digits: Mapping[str, str], spots: Sequence[tuple[float, ...] | None]) -> dict[str, list[str]]:
    """Columns by name, with so many digits; empty where there is no spot."""
    return {
        f"{laser}.{ending}": [format(spot[index], digits[ending]) if spot else "" for spot in spots] for index, ending in enumerate(digits)
    }


def on_screen(camera: Camera, spots: Sequence[Mapping[str, PixelSpot]], lasers: Sequence[str]) -> Array3:
    """Places (y, z) of labelled spots, (n, lasers, 2), [m]; nan where there is none."""
    places = np.full((len(spots), len(lasers), 2), np.nan)
    for pose, found in enumerate(spots):
        for index, laser in enumerate(lasers):
            if laser in found:
                places[pose, index] = camera.spots_of_pixels(found[laser].centre[None])[0]
    return places
