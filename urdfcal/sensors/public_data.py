"""Files of public data sets as measurements.csv: laser tracker series, folders of joint readings by socket, and poses from anywhere.

Each function gives the text of a measurements.csv; `robots/README.md` says where the files come from.

- Tracker series, such as `Series_C/measurements_random_poses.csv` of christianlandgraf/ipa-robot-accuracy: separator `;`, decimal
  comma, joints in radians under their URDF names; of the target in the tracker's frame `measurement_x` .. `_z` in mm and
  `measurement_rx` .. `_rz` in deg, of which its `dataset.py` makes Rx(rx) Ry(ry) Rz(rz).
- Socket folders of platonics-delft/kinematics_calibration (MUKCa): `<place>/hole_<k>.csv` without a header, one row a pose, one column a
  joint from the base on, in radians; the ball is in socket k of the tool that stands at that place.
"""

from __future__ import annotations

import csv
import io
import math
import re
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt

from urdfcal.base.errors import MeasurementError, ShapeMismatch
from urdfcal.base.geometry import DEG, MM, Matrix
from urdfcal.base.reading import TABLE, content_of

_POSITION = ("measurement_x", "measurement_y", "measurement_z")
_ANGLES = ("measurement_rx", "measurement_ry", "measurement_rz")
_POSE_WORDS = ("x", "y", "z", "qx", "qy", "qz", "qw")
_HOLE = re.compile(r"hole_(\d+)\.csv")
_SMALL = 1e-6  # by how much a rotation matrix may miss being one


def tracker_series(path: str | Path, link: str = "tool0") -> str:
    """A tracker series as measurements.csv.

    Args:
        path: The file.
        link: Link that the target is fixed to.

    Raises:
        MeasurementError: names file, line and column of what is not as described above.
    """
    rows = _rows(Path(path), ";")
    line, header = next(rows, (1, []))
    missing = [name for name in (*_POSITION, *_ANGLES) if name not in header]
    joints = [name for name in header if name.endswith("_joint")]
    if missing or not joints:
        lacking = f"no column {', '.join(missing)}" if missing else "no column whose name ends in _joint"
        raise MeasurementError(f"{lacking}; expected the header of a tracker series, separated by ';'", path, line)
    columns = [header.index(name) for name in (*joints, *_POSITION, *_ANGLES)]
    table = _table(rows, columns, Path(path), header)
    q, p, angles = table[:, : len(joints)], table[:, -6:-3] * MM, table[:, -3:] * DEG
    return pose_table(joints, q, link, p, _intrinsic(angles))


def socket_folder(folder: str | Path, joints: Sequence[str], link: str) -> str:
    """A folder of places with their sockets as measurements.csv, with labels `<place>/<k>`.

    Args:
        folder: Of one robot, such as `data/panda_3`.
        joints: Names of the URDF's joints, in the order of the columns.
        link: Link that the ball is fixed to.

    Raises:
        MeasurementError: names the file and line of what is not as described above.
    """
    files = sorted(
        (path.parent.name, int(match[1]), path) for path in Path(folder).glob("*/*.csv") if (match := _HOLE.fullmatch(path.name))
    )
    if not files:
        raise MeasurementError("there is no <place>/hole_<k>.csv in this folder", folder)
    lines = [",".join([*joints, f"{link}.socket"])]
    for place, hole, path in files:
        for row in _table(_rows(path, ","), range(len(joints)), path, joints):
            lines.append(",".join([*_cells(row), f"{place}/{hole}"]))
    return "\n".join(lines) + "\n"


def pose_table(joints: Sequence[str], q: npt.ArrayLike, link: str, p: npt.ArrayLike, R: npt.ArrayLike) -> str:
    """Poses that some program holds in arrays as measurements.csv.

    Args:
        joints: Names of the URDF's joints.
        q: Joint positions, (n, joints), [rad] or [m].
        link: Link that the target is fixed to.
        p: The target's origins in the measuring frame, (n, 3), [m].
        R: Its axes there, (n, 3, 3).

    Raises:
        ShapeMismatch: the arrays do not fit together, or the axes are no rotations.
    """
    positions, origins, axes = (np.asarray(array, dtype=float) for array in (q, p, R))
    n = len(positions)
    if positions.shape != (n, len(joints)) or origins.shape != (n, 3) or axes.shape != (n, 3, 3):
        raise ShapeMismatch(
            f"joint positions {positions.shape}, points {origins.shape} and axes {axes.shape} do not fit together; "
            f"expected (n, {len(joints)}), (n, 3) and (n, 3, 3)"
        )
    if n and not (np.abs(axes @ axes.transpose(0, 2, 1) - np.eye(3)).max() < _SMALL and (np.linalg.det(axes) > 0).all()):
        raise ShapeMismatch("the axes are no rotations: their columns must be orthonormal and right-handed")
    lines = [",".join([*joints, *(f"{link}.{word}" for word in _POSE_WORDS)])]
    lines += [",".join(_cells(row)) for row in np.hstack([positions, origins, _quaternions(axes)])]
    return "\n".join(lines) + "\n"


def _rows(path: Path, separator: str) -> Iterator[tuple[int, list[str]]]:
    try:
        text = content_of(path, TABLE, MeasurementError).decode("utf-8-sig")
    except UnicodeDecodeError:
        raise MeasurementError("is not UTF-8 text; expected CSV", path) from None
    for number, row in enumerate(csv.reader(io.StringIO(text), delimiter=separator), start=1):
        if any(cell.strip() for cell in row):
            yield number, [cell.strip() for cell in row]


def _table(rows: Iterable[tuple[int, list[str]]], columns: Sequence[int], path: Path, names: Sequence[str]) -> Matrix:
    """The numbers of some columns of every row, (n, columns)."""
    table = [[_number(row, column, path, line, names) for column in columns] for line, row in rows]
    if not table:
        raise MeasurementError("there is no row with a pose", path)
    return np.array(table)


def _number(row: Sequence[str], column: int, path: Path, line: int, names: Sequence[str]) -> float:
    cell = row[column] if column < len(row) else ""
    try:
        number = float(cell.replace(",", "."))
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise MeasurementError(f"column '{names[column]}': '{cell}' is not a number", path, line)
    return number


def _intrinsic(angles: Matrix) -> npt.NDArray[np.float64]:
    """Rx(a) Ry(b) Rz(c) of each row, (n, 3, 3)."""
    (sa, sb, sc), (ca, cb, cc) = np.sin(angles.T), np.cos(angles.T)
    rows = [
        [cb * cc, -cb * sc, sb],
        [ca * sc + sa * sb * cc, ca * cc - sa * sb * sc, -sa * cb],
        [sa * sc - ca * sb * cc, sa * cc + ca * sb * sc, ca * cb],
    ]
    return np.asarray(np.array(rows).transpose(2, 0, 1))


def _quaternions(R: npt.NDArray[np.float64]) -> Matrix:
    """Unit quaternions x, y, z, w of rotations, (n, 4)."""
    import pinocchio as pin

    return np.array([pin.Quaternion(rotation).coeffs() for rotation in R]).reshape(-1, 4)


def _cells(numbers: Iterable[float]) -> list[str]:
    return [f"{number:.12g}" for number in numbers]
