"""`measurements.csv`, in and out: one road for every sensor."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any
from uuid import uuid4

import numpy as np

from urdfcal.base.files import write_whole
from urdfcal.base.geometry import Labels, Matrix, Vector
from urdfcal.base.tables import Table, csv_text, read_table
from urdfcal.robot.rig import Grid
from urdfcal.robot.robot import Robot, require_robot
from urdfcal.robot.urdf_xml import FARTHEST
from urdfcal.sensors.column_names import as_people_write
from urdfcal.sensors.columns import NONE, Columns, Group, Stations, columns_of, with_our_names
from urdfcal.sensors.joint_columns import JointColumns
from urdfcal.sensors.measurements import Measurements
from urdfcal.sensors.off_screen import beyond_the_screen
from urdfcal.sensors.pose_columns import pose_facts
from urdfcal.sensors.readings import Readings, blank_readings
from urdfcal.sensors.registry import SENSORS
from urdfcal.sensors.sensor import QUANTITIES, CellFault, Quantity, Sensor

_LEAST_SIGMA = 1e-12  # [m] or [px]: a spot known better than that is a mistake, and its weight overflows
_A_SIGMA = "expected a standard deviation, or nothing"
_SOME = 3  # joints that are named as examples
_WHOLE_TURN = 2 * np.pi + 1e-6  # [rad] farther from zero no angle is written, but in degrees

ROWS = "one row a pose"

Column = tuple[str, Sequence[str | float]]  # its name and its cells


def read_measurements(
    path: str | Path,
    robot: Robot,
    *,
    reference: str | None = None,
    target: str | None = None,
    camera: Any = None,
    boards: Mapping[str, Grid] | None = None,
    stations: Stations = NONE,
) -> Measurements:
    """Read measurements from CSV: one row a pose, one column a joint, and what was measured by the columns' endings.

    Args:
        path: The file.
        robot: Whose joints and links the columns are named after.
        reference: Link that the measuring frame of points and orientations stands on; by default `tracker`, or the root.
        boards: Links that are boards, with the grids of their corners; `<link>:<corner>.u .v` are then one board's.
        camera: What pixels were read with, a `sensors.camera.Camera`; spots of lasers with pixels are then taken from these.
        stations: Instruments that columns such as `tool0@head.x` name, beside links.
        target: Link that columns named x, y, z, qx ... alone, or x1, y1, z1, phix1, phiy1, phiz1 (figaroh's), belong to.

    Raises:
        MeasurementError: `FILE:LINE: column NAME: what was found, what was expected`.
        RigError: a link that is needed is not there, or not where it can be.
    """
    require_robot(robot, "read_measurements")
    table = read_named_table(path, robot, target)
    return measurements_of(table, robot, reference, camera, boards, source=str(path), stations=stations)


def measurements_of(
    table: Table,
    robot: Robot,
    reference: str | None = None,
    camera: Any = None,
    boards: Mapping[str, Grid] | None = None,
    source: str = "",
    stations: Stations = NONE,
) -> Measurements:
    """Measurements from a table with our names for its columns, wherever it comes from; arguments as for `read_measurements`.

    The source is the file that it stands in, if it does, by whose lines poses are named.

    Raises:
        MeasurementError: `FILE:LINE: column NAME: what was found, what was expected`.
        RigError: a link that is needed is not there, or not where it can be.
    """
    columns = columns_of(table, robot, reference or "", camera, boards or {}, stations)
    joints = JointColumns(table, columns.robot)
    q, names = joints.positions, tuple(joint.name for joint in columns.robot.chain.inputs)
    facts = pose_facts(table, names, q)
    data = Measurements(
        joints=names,
        q=q,
        readings=_all_readings(table, columns),
        poses=_poses(table),
        sets=_sets(table),
        sessions=_labels(table, "session"),
        sha256=table.sha256,
        warnings=(*table.notes, *columns.warnings, *joints.warnings(), *facts.warnings),
        reference=reference or "",
        camera=camera,
        boards=boards or {},
        stations=stations.links,
        cameras=stations.cameras,
        payload=facts.payload,
        approach=facts.approach,
        time=facts.time,
        temperature=facts.temperature,
        series=f"{table.path} {table.sha256}" if table.sha256 else uuid4().hex,
        source=source,
        lines=np.array(table.lines) if source else None,
    )
    return replace(data, warnings=(*data.warnings, *beyond_the_screen(columns.robot, data)))


def read_named_table(path: str | Path, robot: Robot, target: str | None = None) -> Table:
    """A file of measurements as a table with our names for its columns, whoever wrote them.

    Raises:
        MeasurementError: it cannot be read as a table, or a column may mean two things.
    """
    return named_table(read_table(path, header_of(robot), ROWS), robot, target)


def named_table(table: Table, robot: Robot, target: str | None = None) -> Table:
    """A table with our names for its columns, whoever wrote them.

    Raises:
        MeasurementError: a column may mean two things.
    """
    return as_people_write(with_our_names(table, target or ""), robot, target or "")


def header_of(robot: Robot) -> str:
    """What the header of its measurements must hold."""
    joints = [joint.name for joint in robot.tree.joints.values() if joint.moves]
    more = ", ..." if len(joints) > _SOME else ""
    return f"the names of the joints ({', '.join(joints[:_SOME])}{more}) and of what was measured (<link>.x, <link>.y, <laser>.z, ...)"


def _all_readings(table: Table, columns: Columns) -> tuple[Readings, ...]:
    """What was read, of lasers first.

    Raises:
        MeasurementError: nothing was.
    """
    readings = (*_of_lasers(table, columns), *_of_targets(table, columns))
    if not any(each.seen.any() for each in readings):
        first = next(column for group in columns.read.values() for column in group.values())
        what = "spot" if first.kind.beam else "reading"
        raise table.fail(0, first.name, f"every {what} is empty; expected at least one that was seen")
    return readings


def _of_lasers(table: Table, columns: Columns) -> Iterator[Readings]:
    """The spots of each laser; of those that have no columns, none."""
    sensors = {target: sensor for target, sensor in columns.read if SENSORS[sensor].beam}
    for laser in columns.robot.rig.lasers:
        if laser in sensors:
            yield _readings(table, laser, sensors[laser], columns.read[laser, sensors[laser]])
        else:
            yield blank_readings("spot", laser, laser, len(table))


def _of_targets(table: Table, columns: Columns) -> Iterator[Readings]:
    for (target, sensor), group in columns.read.items():
        if not SENSORS[sensor].beam:
            yield _readings(table, target, sensor, group)


def _readings(table: Table, target: str, sensor: str, group: Group) -> Readings:
    """What one sensor read of one target, named as its columns are."""
    how, first = SENSORS[sensor], next(iter(group.values()))
    values = np.empty((len(table), 0)) if how.touches else _values(table, how, group)
    labels = _labels(table, first.name if how.touches else "")
    return Readings(sensor, first.target, first.link, values, labels, _sigma(table, target, how), first.instrument)


def _values(table: Table, how: Sensor, group: Group) -> Matrix:
    """Numbers as readings keep them, (n, stored), nan where nothing was read."""
    numbers = {
        ending: _numbers(table, group[ending].name, quantity, how.empty) for ending, quantity in how.endings.items() if ending in group
    }
    try:
        return how.kept(numbers)
    except CellFault as fault:
        name = group[fault.ending].name
        found = f"{table.nothing(fault.row, name)} " if fault.lone else ""
        raise table.fail(fault.row, name, f"{found}{fault.message}") from None


def _numbers(table: Table, name: str, quantity: Quantity, empty: str) -> Vector:
    """One column in SI units, (n,).

    Raises:
        MeasurementError: a cell is no number, or angles are degrees and the header does not say so.
    """
    numbers = table.numbers(name, QUANTITIES[quantity], empty, empty=True, most=FARTHEST)
    if quantity == "angle" and table.units.get(name) != "deg":
        beyond = np.abs(numbers) > _WHOLE_TURN
        found = f"lies beyond 2 pi rad ({beyond.sum()} of {len(table)} cells do), expected radians"
        table.refuse(name, beyond, f"{found}; write '{name} [deg]' in the header if they are degrees, else take whole turns off")
    return numbers


def _sigma(table: Table, target: str, how: Sensor) -> Vector:
    """Standard deviations that are stated with the readings, (n,); nan for none."""
    name = f"{target}.{how.sigma_ending}"
    if not how.sigma_ending or name not in table.names:
        return np.full(len(table), np.nan)
    units, unit = (QUANTITIES["pixel"], "px") if how.words.unit == "px" else (QUANTITIES["length"], "m")
    sigma = table.numbers(name, units, _A_SIGMA, empty=True, most=FARTHEST)
    table.refuse(name, sigma < _LEAST_SIGMA, f"is not above {_LEAST_SIGMA:g} {unit}; {_A_SIGMA}")
    return sigma


def _sets(table: Table) -> Labels:
    sets = np.char.lower(_labels(table, "set"))
    table.refuse("set", ~np.isin(sets, ["", "fit", "train", "test"]), "is neither fit (or train) nor test")
    return np.where(np.isin(sets, ["", "train"]), "fit", sets)


def _poses(table: Table) -> Labels:
    labels = _labels(table, "pose")
    return np.where(labels == "", np.arange(1, len(table) + 1).astype(str), labels)


def _labels(table: Table, name: str) -> Labels:
    """A column of text, (n,); empty if there is no such column."""
    return np.array(table.columns.get(name, [""] * len(table)), dtype=str)


def write_measurements(path: str | Path, data: Measurements, comments: Iterable[str] = ()) -> None:
    """Write measurements as CSV in radians and metres, whole or not at all."""
    write_whole(path, measurements_csv(data, comments))


def measurements_csv(data: Measurements, comments: Iterable[str] = ()) -> bytes:
    """Measurements as CSV in radians and metres."""
    columns: list[Column] = [("pose", data.poses.tolist()), *zip(data.joints, data.q.T.tolist(), strict=True)]
    columns += [column for each in data.readings for column in _written(each)]
    columns += _written_of_poses(data)
    return csv_text([name for name, _ in columns], zip(*(cells for _, cells in columns), strict=True), comments)


def _written(readings: Readings) -> Iterator[Column]:
    """Columns of some readings."""
    how, target = readings.kind, readings.label
    numbers = {ending: readings.labels for ending in how.endings} if how.touches else how.written(readings.values)
    yield from ((f"{target}.{ending}", column.tolist()) for ending, column in numbers.items())
    if how.sigma_ending and np.isfinite(readings.sigma).any():
        yield f"{target}.{how.sigma_ending}", readings.sigma.tolist()


def _written_of_poses(data: Measurements) -> Iterator[Column]:
    """Columns of what else is known of the poses; those that say nothing are left out."""
    if (data.sets == "test").any():
        yield "set", data.sets.tolist()
    if (data.sessions != "").any():
        yield "session", data.sessions.tolist()
    for name in ("payload", "time", "temperature"):
        if (values := getattr(data, name)) is not None:
            yield name, values.tolist()
