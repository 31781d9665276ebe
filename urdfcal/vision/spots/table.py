"""From labelled spots to the measurements' CSV: pose, the joint columns of a table of poses, spots, their sigmas, pixels.

A spot's sigma on the screen is sqrt(trace(J C J') / 2) with C its covariance in the picture and J the derivative of the place on the
screen by the pixel: it grows where the camera looks at a slant. The camera's own errors move all spots together and are not in it.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from urdfcal.base.errors import MeasurementError
from urdfcal.base.geometry import Array3, Matrix
from urdfcal.base.tables import ANGLES, LENGTHS, CsvTable
from urdfcal.robot.robot import Robot
from urdfcal.sensors.camera import Camera
from urdfcal.vision.pictures import picture_name
from urdfcal.vision.spots.detector import PixelSpot

_NAMING = ("image", "pose")  # columns that name pictures
_SPOT_ENDINGS = (".y", ".z", ".sigma", ".u", ".v", ".sigma_px")


def joined(groups: Mapping[str, Sequence[Path]], table: CsvTable) -> tuple[list[int], str]:
    """The table's row of every pose, and a warning where nothing but the order says so.

    Rows are found by the column `image` (a file's name, with or without its ending, or the pose's label), or by the column `pose` if
    the other is missing or names none of the pictures; by order if the table has neither column. A cell names what it says, or what
    a picture made of it is named (`home pose`: home_pose.png).

    Raises:
        MeasurementError: a pose has no row, or two; or order is all there is and the numbers differ.
    """
    columns = [name for name in _NAMING if name in table.columns]
    if not columns:
        return _by_order(groups, table)
    found = {name: {label: _rows_of(table.columns[name], label, paths) for label, paths in groups.items()} for name in columns}
    column = next((name for name in columns if any(found[name].values())), columns[0])
    for label, matches in found[column].items():
        if len(matches) != 1:
            none = "" if any(found[column].values()) else "; write a column 'image' with the pictures' names, or have none to join by order"
            raise MeasurementError(
                f"column '{column}': {len(matches) or 'no'} row(s) for the picture {groups[label][0].name}, expected one{none}",
                table.path,
                table.lines[matches[1]] if matches else table.header_line,
            )
    rows = [row for (row,) in found[column].values()]
    for row in rows:
        if rows.count(row) > 1:
            raise table.fail(row, column, f"'{table.columns[column][row]}' names two pictures; write a column 'image' with whole names")
    return rows, ""


def _by_order(groups: Mapping[str, Sequence[Path]], table: CsvTable) -> tuple[list[int], str]:
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


def known_labels(table: CsvTable) -> set[str]:
    """What a table calls its poses, and what their pictures can be named."""
    cells = {cell for column in _NAMING for cell in table.columns.get(column, [])}
    return cells | {picture_name(cell) for cell in cells}


def joint_positions(table: CsvTable, robot: Robot) -> Matrix:
    """Positions of the robot's measured joints, (n, joints), [rad] or [m].

    Raises:
        MeasurementError: a joint's column is missing or holds no numbers.
    """
    columns = []
    for joint in robot.chain.inputs:
        table.require(joint.name, "a column for each joint on the way")
        columns.append(table.numbers(joint.name, LENGTHS if joint.prismatic else ANGLES))
    return np.column_stack(columns)


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
    table: CsvTable | None = None,
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
    copied = [name for name in (table.columns if table else ()) if name not in ("pose", "image") and not name.endswith(_SPOT_ENDINGS)]
    endings = (("y", "z", "sigma") if camera else ()) + (("u", "v", "sigma_px") if pixels else ())
    text = io.StringIO()
    text.writelines(f"# {' '.join(comment.split())}\n" for comment in comments)
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(
        ["pose", *(table.header[name] for name in copied if table), *(f"{laser}.{ending}" for laser in lasers for ending in endings)]
    )
    for pose, label in enumerate(labels):
        cells = [_plain(table, name, table.columns[name][rows[pose]]) for name in copied] if table else []
        for laser in lasers:
            cells += _cells(spots[pose].get(laser), camera, pixels, len(endings))
        own = table.columns["pose"][rows[pose]] if table and "pose" in table.columns else ""
        writer.writerow([(own or label).lstrip("# "), *cells])
    return text.getvalue().encode(errors="backslashreplace")


def _plain(table: CsvTable, name: str, cell: str) -> str:
    """A cell with a decimal point."""
    return cell.replace(",", ".") if table.decimal_comma and name not in ("set", "session") else cell


def _cells(spot: PixelSpot | None, camera: Camera | None, pixels: bool, count: int) -> list[str]:
    if spot is None:
        return [""] * count
    cells = []
    if camera is not None:
        y, z = camera.spots_of_pixels(spot.centre[None])[0]
        cells += [f"{y:.9g}", f"{z:.9g}", f"{sigma_on_screen(camera, spot):.4g}"]
    if pixels:
        cells += [f"{spot.centre[0]:.4f}", f"{spot.centre[1]:.4f}", f"{np.sqrt(np.trace(spot.covariance) / 2):.4f}"]
    return cells


def on_screen(camera: Camera, spots: Sequence[Mapping[str, PixelSpot]], lasers: Sequence[str]) -> Array3:
    """Places (y, z) of labelled spots, (n, lasers, 2), [m]; nan where there is none."""
    places = np.full((len(spots), len(lasers), 2), np.nan)
    for pose, found in enumerate(spots):
        for index, laser in enumerate(lasers):
            if laser in found:
                places[pose, index] = camera.spots_of_pixels(found[laser].centre[None])[0]
    return places
