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

from urdfcal.errors import MeasurementError
from urdfcal.geometry import Array3, Matrix
from urdfcal.robot import Robot
from urdfcal.vision.camera_model import Camera
from urdfcal.vision.csv_table import ANGLES, LENGTHS, CsvTable
from urdfcal.vision.spot_detector import PixelSpot

_SPOT_ENDINGS = (".y", ".z", ".sigma", ".u", ".v", ".sigma_px")


def joined(groups: Mapping[str, Sequence[Path]], table: CsvTable) -> tuple[list[int], str]:
    """The table's row of every pose, and a warning where nothing but the order says so.

    Rows are found by the column `image` (a file's name, with or without its ending, or the pose's label), else by the column `pose`
    if it holds any of the labels, else by order.

    Raises:
        MeasurementError: a pose has no row, or two; or order is all there is and the numbers differ.
    """
    column = "image" if "image" in table.columns else "pose"
    cells = table.columns.get(column, [])
    rows = {label: [row for row, cell in enumerate(cells) if cell in _names(label, paths)] for label, paths in groups.items()}
    if column == "image" or any(rows.values()):
        for label, found in rows.items():
            if len(found) != 1:
                raise MeasurementError(
                    f"column '{column}': {len(found) or 'no'} row(s) for the picture {groups[label][0].name}, expected one",
                    table.path,
                    table.lines[found[1]] if found else table.header_line,
                )
        return [found[0] for found in rows.values()], ""
    if len(table) != len(groups):
        raise MeasurementError(
            f"has {len(table)} rows for {len(groups)} poses with pictures, and no column 'image' or 'pose' that names the pictures",
            table.path,
        )
    first = next(iter(groups))
    return list(range(len(table))), f"{table.path}: no column 'image' or 'pose' names the pictures; joined by order, the first is {first}"


def _names(label: str, paths: Sequence[Path]) -> set[str]:
    return {label, *(path.name for path in paths), *(path.stem for path in paths)}


def known_labels(table: CsvTable) -> set[str]:
    """What a table calls its poses."""
    return {cell for column in ("image", "pose") for cell in table.columns.get(column, [])}


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
        labels: Label of each pose.
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
        writer.writerow([label.lstrip("# "), *cells])
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
