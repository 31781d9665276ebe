"""Measurements that are in memory already: arrays, dictionaries and DataFrames, on the road that a file takes.

A table in memory has the columns that a file would have: `joint1 [deg]`, `tool0.x [mm]`, `socket`, `set` ... What an array holds of one
sensor may stand under the sensor's name: `tool0.point` (n, 3) for `tool0.x`, `tool0.y`, `tool0.z`.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from urdfcal.base.errors import MeasurementError, ShapeMismatch, UsageError
from urdfcal.base.geometry import Array3, Matrix
from urdfcal.base.rotations import NOT_RIGID, quaternions_of_vectors, rigid, rotation_vectors
from urdfcal.base.tables import Table, table_in_memory
from urdfcal.robot.rig import Grid
from urdfcal.robot.robot import Robot, require_robot
from urdfcal.sensors.columns import NONE, Stations, seen_as
from urdfcal.sensors.measurements import Measurements, spots_measured
from urdfcal.sensors.measurements_csv import ROWS, header_of, measurements_of, named_table
from urdfcal.sensors.registry import SENSORS

Cells = Mapping[str, Sequence[str]]

_LABEL = "measurements"  # what a table in memory is called in messages
_POSE = 7  # numbers of a pose, which may be a matrix as well
_NOTHING = ("", "nan", "none", "nat", "<na>")  # how programs write that there is nothing


def measurements_from(
    robot: Robot,
    q: Any,
    readings: Any = None,
    *,
    sigma: npt.ArrayLike | None = None,
    poses: Sequence[str] | None = None,
    sets: Sequence[str] | None = None,
    sessions: Sequence[str] | None = None,
    reference: str | None = None,
    target: str | None = None,
    camera: Any = None,
    boards: Mapping[str, Grid] | None = None,
    stations: Stations = NONE,
) -> Measurements:
    """Measurements from arrays, a dictionary or a DataFrame, by whatever sensors.

        measurements_from(robot, table)                             # columns as in a file: joint1, tool0.x [mm], set ...
        measurements_from(robot, q, {"tool0.point": p})             # positions, and what sensors read, by target and sensor
        measurements_from(robot, q, spots)                          # positions, and spots of all lasers

    Args:
        robot: Whose joints and links they belong to.
        q: A table: columns by name, (n,) each, as a dictionary or a DataFrame, with the names, units and meanings that they have in
            `measurements.csv`. Or joint positions alone, (n, joints), [rad] or [m], in the order of the robot's `chain.input_names` as
            these readings see it.
        readings: Beside joint positions: columns by name, or by `<target>.<sensor>`: `point` (n, 3) [m], `pose` (n, 7) as x, y, z [m] and
            the quaternion x, y, z, w, or (n, 4, 4) as matrices T_frame_target, `orientation` (n, 4), `distance` (n,) [m], `pixel` (n, 2),
            `inclination` (n, 2) [rad], `plane` and `socket` (n,) labels, `spot` (n, 2) [m] of a laser; nan or an empty label where
            nothing was read. Or spots of all lasers in the order of `robot.rig.lasers`, (n, lasers, 2), [m].
        sigma: With spots of all lasers: their noise, (n, lasers), [m]; nan where nothing is stated.
        poses: Labels; by default the numbers from 1.
        sets: `fit` or `test`; by default all `fit`.
        sessions: Session labels; by default one session.
        reference: Link that the measuring frame stands on; by default `tracker`, or the root.
        target: Link that columns named x, y, z, qx ... alone belong to.
        camera: What pixels were read with.
        boards: Links that are boards, with the grids of their corners.
        stations: Instruments that columns such as `tool0@head.x` name, beside links.

    Raises:
        ShapeMismatch: the arrays do not fit the robot or each other.
        MeasurementError: `measurements:ROW: column NAME: what was found, what was expected`; rows are counted from 1.
        RigError: a link that is needed is not there, or not where it can be.
        UsageError: what is given is none of these.
    """
    require_robot(robot, "measurements_from")
    beside = {"pose": poses, "set": sets, "session": sessions}
    if is_table(q):
        if readings is not None or sigma is not None:
            raise UsageError("measurements_from: a table holds the readings, too; give either a table, or joint positions and readings")
        columns = _columns(q, beside)
    elif is_table(readings):
        if sigma is not None:
            raise UsageError("measurements_from: sigma belongs to spots alone; give noise as columns, such as 'tool0.sigma'")
        columns = _with_positions(robot, q, _columns(readings, beside), reference, target, camera, boards, stations)
    else:
        return spots_measured(robot, q, _required(readings), sigma=sigma, poses=poses, sets=sets, sessions=sessions)
    return measurements_of(_table(columns, robot, target), robot, reference, camera, boards, stations=stations)


def is_table(given: Any) -> bool:
    """Whether something has named columns: a dictionary, a DataFrame of whatever library, or a row of one."""
    return isinstance(given, Mapping) or (hasattr(given, "columns") and hasattr(given, "__getitem__")) or hasattr(given, "to_dict")


def _required(readings: Any) -> npt.ArrayLike:
    if readings is None:
        raise UsageError(
            "measurements_from: there are joint positions and no readings; give a dictionary such as {'tool0.point': p}, the spots of all "
            "lasers, or one table with both"
        )
    spots: npt.ArrayLike = readings
    return spots


def _table(columns: Cells, robot: Robot, target: str | None) -> Table:
    return named_table(table_in_memory(_LABEL, columns, header_of(robot), ROWS), robot, target)


def _columns(given: Any, beside: Mapping[str, Sequence[str] | None]) -> Cells:
    """Cells by column: those of a table, and what is stated beside it.

    Raises:
        ShapeMismatch: they are of several lengths.
    """
    named = [*named_columns(given)] + [(name, own) for name, own in beside.items() if own is not None]
    columns: dict[str, Sequence[str]] = {}
    for name, values in (pair for own in named for pair in _by_ending(*own)):
        if name in columns:
            raise UsageError(f"{_LABEL}: column '{name}' is given twice")
        columns[name] = values
    lengths = {name: len(cells) for name, cells in columns.items()}
    first = next(iter(lengths), "")
    for name, length in lengths.items():
        if length != lengths[first]:
            raise ShapeMismatch(f"{_LABEL}: column '{name}' has {length} rows, expected {lengths[first]} as '{first}' has")
    return columns


def named_columns(given: Any) -> Iterator[tuple[str, Any]]:
    """Columns of whatever has some (`is_table`), with their names."""
    if not isinstance(given, Mapping) and hasattr(given, "columns"):
        yield from ((str(name), given[name]) for name in given.columns)
    else:
        yield from ((str(name), values) for name, values in (given if isinstance(given, Mapping) else given.to_dict()).items())


def _by_ending(name: str, values: Any) -> Iterator[tuple[str, Sequence[str]]]:
    """One column as it stands; what is a sensor's whole reading as the columns of its numbers.

    Raises:
        ShapeMismatch: an array has another shape than such readings.
    """
    target, dot, word = name.rpartition(".")
    sensors = [sensor for sensor in SENSORS.values() if dot and word in (sensor.name, *sensor.simulated)]
    endings = [ending for sensor in sensors for ending in sensor.endings]
    array = np.asarray(values)
    if array.ndim == 0:
        array = array[None]
    if array.ndim == 1 and (not sensors or len(endings) == 1):
        yield (name if not sensors else f"{target}.{endings[0]}"), _cells(array)
        return
    width = max(1, sum(sensor.stored for sensor in sensors))
    array = _as_vectors(name, array) if array.shape[1:] == (4, 4) and width == _POSE else array
    if not sensors or array.ndim != 2 or array.shape[1] != width:
        raise ShapeMismatch(f"{_LABEL}: '{name}' has shape {np.shape(values)}, expected {_shape(width) if sensors else _kinds()}")
    yield from ((f"{target}.{ending}", _cells(column)) for ending, column in zip(endings, array.T, strict=False))


def _shape(width: int) -> str:
    return f"(n, {width})" + (" or (n, 4, 4)" if width == _POSE else "")


def _kinds() -> str:
    """What an array of more than a column may stand under."""
    words = dict.fromkeys(word for sensor in SENSORS.values() for word in (*sensor.simulated, sensor.name))
    return f"(n,) of a column, or a name that ends in one of {', '.join(f'.{word}' for word in words)}"


def _as_vectors(name: str, T: Array3) -> Matrix:
    """Matrices (n, 4, 4) as x, y, z and quaternion x, y, z, w, (n, 7); nan where any number of one is.

    Raises:
        MeasurementError: one is no placement, as where it is transposed.
    """
    T = T.astype(float)
    there = ~np.isnan(T).any(axis=(1, 2))
    for row in np.flatnonzero(there & ~rigid(T)):
        raise MeasurementError(f"'{name}': {NOT_RIGID}", _LABEL, int(row) + 1)
    vectors = np.full((len(T), 7), np.nan)
    vectors[there] = np.hstack([T[there, :3, 3], quaternions_of_vectors(rotation_vectors(T[there, :3, :3]))])
    return vectors


def _cells(values: npt.NDArray[Any]) -> list[str]:
    """A column as a file has it, with every digit; nothing for what is missing. Labels that pandas took for numbers are whole again."""
    if values.dtype.kind == "f":
        return ["" if number != number else repr(number).removesuffix(".0") for number in values.tolist()]
    return ["" if (text := " ".join(str(value).split())).casefold() in _NOTHING else text for value in values.tolist()]


def _with_positions(
    robot: Robot,
    q: npt.ArrayLike,
    read: Cells,
    reference: str | None,
    target: str | None,
    camera: Any,
    boards: Mapping[str, Grid] | None,
    stations: Stations,
) -> Cells:
    """Joint positions as columns beside those of readings, in the order of the joints that these need.

    Raises:
        ShapeMismatch: there are not as many.
    """
    head = _table({name: ["0"] for name in read}, robot, target)
    names = seen_as(head, robot, reference or "", camera, boards or {}, stations).chain.input_names
    positions, n = np.asarray(q, dtype=float), len(next(iter(read.values()), ()))
    if positions.shape != (n, len(names)):
        raise ShapeMismatch(f"measurements: q has shape {positions.shape}, expected {(n, len(names))}, for {', '.join(names)}")
    return {name: _cells(column) for name, column in zip(names, positions.T, strict=True)} | dict(read)
