"""`measurements.csv`, in and out: one road for every sensor."""

from __future__ import annotations

import csv
import hashlib
import io
import math
import re
from collections.abc import Collection, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from urdfcal.base.errors import MeasurementError, did_you_mean
from urdfcal.base.files import write_whole
from urdfcal.base.geometry import DEG
from urdfcal.robot.rig import Grid, lasers_by_name
from urdfcal.robot.robot import Robot
from urdfcal.robot.urdf_tree import FARTHEST, UrdfJoint
from urdfcal.sensors.columns import ReadingColumn, cells, figaroh_name, lost_column, reading_columns, refusal, written_columns
from urdfcal.sensors.measurements import Measurements
from urdfcal.sensors.readings import Readings, blank_readings, instruments_of
from urdfcal.sensors.registry import SENSORS
from urdfcal.sensors.sensor import QUANTITIES, CellFault, Sensor

_NUMBER = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?")


_SPOTS = tuple(name for name, sensor in SENSORS.items() if sensor.beam)
_OF_PICTURES = ("u", "v", "sigma_px")
_LEAST_SIGMA = 1e-12  # [m]: a spot known better than that is a mistake, and its weight overflows


_TURNS = 4 * math.pi  # a continuous joint is hardly ever farther from zero than this, unless it is in degrees


def read_measurements(
    path: str | Path,
    robot: Robot,
    *,
    reference: str | None = None,
    target: str | None = None,
    camera: Any = None,
    boards: Mapping[str, Grid] | None = None,
) -> Measurements:
    """Read measurements from CSV: one row a pose, one column a joint, and what was measured by the columns' endings.

    Args:
        path: The file.
        robot: Whose joints and links the columns are named after.
        reference: Link that the measuring frame of points and orientations stands on; by default `tracker`, or the root.
        boards: Links that are boards, with the grids of their corners; `<link>:<corner>.u .v` are then one board's.
        camera: What pixels were read with, a `vision.camera_model.Camera`; spots of lasers with pixels are then taken from these.
        target: Link that columns named x1, y1, z1, phix1, phiy1, phiz1 (figaroh's) belong to.

    Raises:
        MeasurementError: `FILE:LINE: column NAME: what was found, what was expected`.
        RigError: a link that is needed is not there, or not where it can be.
    """
    return _Reader(Path(path), robot, reference or "", target or "", camera, boards or {}).read()


def write_measurements(path: str | Path, data: Measurements, comments: Iterable[str] = ()) -> None:
    """Write measurements as CSV in radians and metres, whole or not at all."""
    write_whole(path, measurements_csv(data, comments))


def measurements_csv(data: Measurements, comments: Iterable[str] = ()) -> bytes:
    """Measurements as CSV in radians and metres."""
    columns = [column for each in data.readings for column in written_columns(each)]
    marks = {"set": data.sets} if (data.sets == "test").any() else {}
    marks |= {"session": data.sessions} if (data.sessions != "").any() else {}
    marks |= {"payload": np.array([f"{mass:.12g}" for mass in data.payload])} if data.payload is not None else {}
    text = io.StringIO()
    text.writelines(f"# {' '.join(comment.split())}\n" for comment in comments)
    table = csv.writer(text, lineterminator="\n")
    table.writerow(["pose", *data.joints, *(name for name, _ in columns), *marks])
    for pose, q in enumerate(data.q):
        read = [values[pose] for _, values in columns]
        table.writerow([_label(data.poses[pose]), *cells(q), *read, *(_label(mark[pose]) for mark in marks.values())])
    return text.getvalue().encode(errors="backslashreplace")


def _label(text: str) -> str:
    """A label in one cell; a # at the front of a row would make a comment of it."""
    return " ".join(str(text).split()).lstrip("# ")


class _Reader:
    """Reads one file; keeps what every message needs."""

    def __init__(self, path: Path, robot: Robot, reference: str, target: str, camera: Any, boards: Mapping[str, Grid]) -> None:
        self.path, self.robot, self.reference, self.target = path, robot, reference, target
        self.camera, self.boards = camera, boards
        self.warnings: list[str] = []

    def fail(self, line: int | None, column: str, message: str) -> MeasurementError:
        return MeasurementError(f"column '{column}': {message}" if column else message, self.path, line)

    def read(self) -> Measurements:
        rows = self.rows()
        first = next(rows, None)
        if first is None:
            raise self.fail(None, "", "the file has no header line; expected the joint names and <laser>.y, <laser>.z")
        header_line, header = first
        self.parse_header(header_line, header)
        table = [(line, self.full_row(line, row)) for line, row in rows]
        if not table:
            raise self.fail(header_line, "", "there is a header and no row; expected one row a pose")
        lines = [line for line, _ in table]
        columns = {name: [row[index] for _, row in table] for name, index in self.index.items()}
        return self.build(lines, columns)

    def rows(self) -> Iterator[tuple[int, list[str]]]:
        try:
            content = self.path.read_bytes()
            self.sha256 = hashlib.sha256(content).hexdigest()
            text = content.decode("utf-8-sig")
        except OSError as error:
            raise self.fail(None, "", f"cannot be read: {error.strerror or error}") from None
        except UnicodeDecodeError as error:
            raise self.fail(error.object[: error.start].count(b"\n") + 1, "", "is not UTF-8 text; save it as CSV in UTF-8") from None
        lines = re.split(r"\r\n|\n|\r", text)
        kept = [(number, line) for number, line in enumerate(lines, start=1) if line.strip() and not line.lstrip().startswith("#")]
        first = kept[0][1] if kept else ""
        self.separator = max(";\t,", key=first.count)
        for number, line in kept:
            try:
                cells = next(csv.reader([line], delimiter=self.separator, skipinitialspace=True))
            except csv.Error as error:
                raise self.fail(number, "", f"cannot be split into cells: {error}") from None
            yield number, [cell.strip() for cell in cells]

    def parse_header(self, line: int, header: list[str]) -> None:
        while header and not header[-1]:
            header.pop()
        self.index: dict[str, int] = {}
        self.units: dict[str, str] = {}
        for position, cell in enumerate(self.translated(line, header)):
            name, mark, unit = (word.strip() for word in (cell[:-1] if cell.endswith("]") else cell).partition("["))
            if mark and not cell.endswith("]"):
                raise self.fail(line, cell, "the unit has no closing bracket, expected for example 'joint1 [deg]'")
            if not name:
                raise self.fail(line, cell, f"cell {position + 1} of the header is empty, expected a name")
            if name in self.index:
                raise self.fail(line, name, f"stands twice, in cells {self.index[name] + 1} and {position + 1}")
            self.index[name] = position
            if mark:
                self.units[name] = unit
        self.width = len(header)
        self.header_line = line
        self.candidates = self.laser_candidates()
        asked = self.candidates if self.robot.lasers is None else [laser for laser in self.candidates if laser in self.robot.lasers]
        columns = reading_columns(self.index, self.robot, self.candidates)
        columns = tuple(column for column in columns if column.target in asked or column.target not in self.candidates)
        in_pictures = [column for column in columns if column.ending in _OF_PICTURES]
        self.unused_pixels = tuple(column.name for column in in_pictures) if self.camera is None else ()
        self.columns = tuple(column for column in columns if column.name not in self.unused_pixels)
        self.refuse_header(line)
        self.choose_instruments()
        self.check_columns()

    def refuse_header(self, line: int) -> None:
        """Refuse columns of targets that cannot be taken as they are; where nothing at all is measured, say what comes nearest to it."""
        refused = refusal(self.columns, self.units)
        if refused is None and not self.columns and not self.unused_pixels:
            refused = lost_column(self.index, self.robot)
        if refused is not None:
            raise self.fail(line, *refused)

    def translated(self, line: int, header: list[str]) -> list[str]:
        """The header with figaroh's x1, y1 ... in our own names."""
        own = [figaroh_name(cell, self.target) for cell in header]
        if any(own) and not self.target:
            cell = next(cell for cell, name in zip(header, own, strict=True) if name)
            raise self.fail(line, cell, "which link is it measured on? name it with --target LINK")
        return [name or cell for cell, name in zip(header, own, strict=True)]

    def laser_candidates(self) -> tuple[str, ...]:
        """Links that are lasers by what was asked for or by their name; one with an x has a point, and no spot."""
        named = (*(self.robot.lasers or ()), *lasers_by_name(self.robot.tree))
        return tuple(dict.fromkeys(laser for laser in named if f"{laser}.x" not in self.index))

    def choose_instruments(self) -> None:
        """The robot as these measurements see it: with lasers if there are spots, or nothing else; with the targets that are named."""
        read = dict.fromkeys((column.sensor, column.target, column.link) for column in self.columns if column.sensor)
        if not read and self.unused_pixels:
            way_out = "pixels need the camera that they were read with; give it with --camera CAMERA.yaml"
            raise self.fail(self.header_line, self.unused_pixels[0], way_out)
        seen = instruments_of([blank_readings(*own) for own in read], self.reference, self.camera, self.boards)
        spots = any(SENSORS[sensor].beam for sensor, _, _ in read)
        if seen.needed:
            self.robot = self.robot.seen_by(seen, self.robot.lasers if spots else ())
        self.joints, self.lasers = self.robot.chain.inputs, self.robot.rig.lasers

    def check_columns(self) -> None:
        for joint in self.joints:
            if joint.name not in self.index:
                raise self.fail(
                    self.header_line,
                    joint.name,
                    f"is missing; expected a column for each joint on the way{did_you_mean(joint.name, self.index)}",
                )
        known = {
            *self.unused_pixels,
            "set",
            "session",
            "pose",
            "payload",
            *(column.name for column in self.columns),
            *(f"{laser}.{ending}" for laser in self.lasers for ending in (*SENSORS["spot"].endings, "sigma")),
            *(joint.name for joint in self.robot.tree.joints.values() if not joint.rigid),
        }
        for laser in self.lasers:
            given = [ending for ending in SENSORS["spot"].endings if f"{laser}.{ending}" in self.index]
            self.require_whole(SENSORS["spot"], laser, given)
        self.read_columns = self.chosen_columns()
        unseen = [laser for laser in self.lasers if not any(target == laser for target, _ in self.read_columns)]
        if self.lasers and unseen == list(self.lasers):
            raise self.fail(
                self.header_line, f"{self.lasers[0]}.y", "is missing, and no other laser has columns; expected <laser>.y and <laser>.z"
            )
        for laser in unseen:
            self.warnings.append(f"{self.path}: laser '{laser}' of the robot has no columns; it is taken as never seen")
        for name in self.index:
            if name not in known:
                unused = sorted(known - set(self.index))
                self.warnings.append(
                    f"{self.path}:{self.header_line}: column '{name}' means nothing here and is not used{did_you_mean(name, unused)}"
                )

    def full_row(self, line: int, row: list[str]) -> list[str]:
        extra = row[self.width :]
        if len(row) < self.width or any(extra):
            way_out = "; a decimal comma needs ; between the cells" if len(row) > self.width and self.separator == "," else ""
            raise self.fail(line, "", f"the row has {len(row)} cells, expected {self.width} as in the header{way_out}")
        return row

    def build(self, lines: list[int], columns: dict[str, list[str]]) -> Measurements:
        n = len(lines)
        q = np.column_stack([self.joint_column(joint, lines, columns[joint.name]) for joint in self.joints])
        readings = tuple(self.readings(lines, columns))
        if not any(each.seen.any() for each in readings):
            first = next(iter(next(iter(self.read_columns.values())).values()))
            what = "spot" if first.kind.beam else "reading"
            raise self.fail(lines[0], first.name, f"every {what} is empty; expected at least one that was seen")
        numbers = [str(number) for number in range(1, n + 1)]
        poses = [label or number for label, number in zip(columns.get("pose", numbers), numbers, strict=True)]
        return Measurements(
            joints=tuple(joint.name for joint in self.joints),
            q=q,
            readings=readings,
            poses=np.array(poses, dtype=str),
            sets=np.array(self.set_column(lines, columns.get("set", [])) or ["fit"] * n, dtype=str),
            sessions=np.array(columns.get("session", [""] * n), dtype=str),
            source=str(self.path),
            sha256=self.sha256,
            lines=np.array(lines),
            warnings=tuple(self.warnings),
            reference=self.reference,
            camera=self.camera,
            boards=self.boards,
            payload=self.payload_column(lines, columns["payload"]) if "payload" in columns else None,
            approach=np.sign(np.diff(q, axis=0, prepend=q[:1])),
        )

    def payload_column(self, lines: list[int], cells: list[str]) -> Any:
        """Masses in kg; an empty cell is none."""
        kilograms = np.nan_to_num(
            self.numbers("payload", lines, cells, self.unit("payload", {"kg": 1.0}), "expected a mass in kg, or nothing", empty=True)
        )
        if (kilograms < 0).any():
            row = int(np.argmax(kilograms < 0))
            raise self.fail(lines[row], "payload", f"'{cells[row]}' is below zero; expected a mass in kg, or nothing")
        return kilograms

    def chosen_columns(self) -> dict[tuple[str, str], dict[str, ReadingColumn]]:
        """The columns of readings by target and sensor, then by ending: those of lasers first, in their order; pixels before metres.

        Raises:
            MeasurementError: a column is missing beside others.
        """
        groups: dict[tuple[str, str], dict[str, ReadingColumn]] = {}
        for column in (column for column in self.columns if column.sensor):
            groups.setdefault((column.target, column.sensor), {})[column.ending] = column
        for (target, sensor), own in groups.items():
            self.require_whole(SENSORS[sensor], target, own)
        spots = {(laser, sensor): groups.pop((laser, sensor)) for laser in self.lasers for sensor in _SPOTS if (laser, sensor) in groups}
        in_pixels = {target for target, sensor in spots if sensor != "spot"}
        return {key: own for key, own in spots.items() if key[1] != "spot" or key[0] not in in_pixels} | groups

    def require_whole(self, how: Sensor, target: str, given: Collection[str]) -> None:
        """Refuse a header that has some of a target's columns and lacks others.

        Raises:
            MeasurementError: naming the first that is missing.
        """
        lacking = how.lacking(target, given) if given else None
        if lacking is not None:
            raise self.fail(self.header_line, f"{target}.{lacking[0]}", lacking[1])

    def readings(self, lines: list[int], columns: dict[str, list[str]]) -> Iterator[Readings]:
        """What was read; of lasers that have no columns, nothing."""
        read = {key[0]: key for key in self.read_columns if SENSORS[key[1]].beam}
        for laser in self.lasers:
            if laser in read:
                yield self.reading(*read[laser], lines, columns)
            else:
                yield blank_readings("spot", laser, laser, len(lines))
        for target, sensor in self.read_columns:
            if not SENSORS[sensor].beam:
                yield self.reading(target, sensor, lines, columns)

    def reading(self, target: str, sensor: str, lines: list[int], columns: dict[str, list[str]]) -> Readings:
        """What one sensor read of one target."""
        own, how, n = self.read_columns[target, sensor], SENSORS[sensor], len(lines)
        link, labels, values = next(iter(own.values())).link, np.full(n, ""), np.empty((n, 0))
        if how.touches:
            labels = np.array(columns[next(iter(own.values())).name], dtype=str)
        else:
            numbers = {ending: self.column_numbers(column, how, lines, columns[column.name]) for ending, column in own.items()}
            try:
                values = how.kept({ending: numbers[ending] for ending in how.endings if ending in numbers})
            except CellFault as fault:
                raise self.fail(lines[fault.row], own[fault.ending].name, fault.message) from None
        stated = f"{target}.{how.sigma_ending}"
        units = QUANTITIES["pixel" if how.words.unit == "px" else "length"]
        sigma = self.sigma_column(stated, lines, columns[stated], units) if how.sigma_ending and stated in columns else np.full(n, np.nan)
        return Readings(sensor, target, link, values, labels, sigma)

    def column_numbers(self, column: ReadingColumn, how: Sensor, lines: list[int], cells: list[str]) -> Any:
        factor = self.unit(column.name, QUANTITIES[how.endings[column.ending]])
        return self.numbers(column.name, lines, cells, factor, how.empty, empty=True)

    def unit(self, name: str, allowed: Mapping[str, float]) -> float:
        unit = self.units.get(name, next(iter(allowed)))
        if unit not in allowed:
            raise self.fail(self.header_line, name, f"unit '{unit}' is not understood, expected {' or '.join(allowed)}")
        return allowed[unit]

    def numbers(self, name: str, lines: list[int], cells: list[str], factor: float, way_out: str, empty: bool = False) -> Any:
        values = np.empty(len(cells))
        comma = self.separator == ";"
        for row, cell in enumerate(cells):
            text = cell.replace(",", ".") if comma and "." not in cell else cell
            if not text and empty:
                values[row] = np.nan
            elif _NUMBER.fullmatch(text) and math.isfinite(float(text)):
                values[row] = float(text)
            else:
                found = f"'{cell}' is not a number" if not _looks_infinite(cell) else f"'{cell}' is not finite"
                raise self.fail(lines[row], name, f"{found if cell else 'the cell is empty'}; {way_out}")
            if abs(values[row]) > FARTHEST:
                raise self.fail(lines[row], name, f"'{cell}' is beyond {FARTHEST:g}; {way_out}")
        return values * factor

    def joint_column(self, joint: UrdfJoint, lines: list[int], cells: list[str]) -> Any:
        allowed = QUANTITIES["length" if joint.prismatic else "angle"]
        factor = self.unit(joint.name, allowed)
        values = self.numbers(
            joint.name, lines, cells, factor, f"expected the joint's position in {next(iter(allowed))} (or say [deg], [mm] in the header)"
        )
        self.check_limits(joint, lines, values)
        return values

    def check_limits(self, joint: UrdfJoint, lines: list[int], values: Any) -> None:
        lower, upper = (-_TURNS, _TURNS) if joint.type == "continuous" else (joint.lower, joint.upper)
        outside = (values < lower - 1e-6) | (values > upper + 1e-6)
        if not outside.any():
            return
        first = lines[int(np.argmax(outside))]
        unit = "m" if joint.prismatic else "rad"
        limits = f"{lower:.4g} to {upper:.4g} {unit}"
        degrees = values * DEG
        as_degrees = outside & (degrees >= lower - 1e-6) & (degrees <= upper + 1e-6)
        if not joint.prismatic and 2 * as_degrees.sum() > len(values):
            found = f"{as_degrees.sum()} of {len(values)} cells lie outside the limits {limits} and inside them as degrees"
            raise self.fail(first, joint.name, f"{found}; write '{joint.name} [deg]' in the header")
        many = f"{outside.sum()} of {len(values)} cells lie" if outside.sum() > 1 else "a cell lies"
        self.warnings.append(f"{self.path}:{first}: column '{joint.name}': {many} outside the joint's limits {limits}")

    def sigma_column(self, name: str, lines: list[int], cells: list[str], units: Mapping[str, float]) -> Any:
        values = self.numbers(name, lines, cells, self.unit(name, units), "expected a standard deviation, or nothing", empty=True)
        wrong = values < _LEAST_SIGMA
        if wrong.any():
            row = int(np.argmax(wrong))
            raise self.fail(lines[row], name, f"'{cells[row]}' is not above {_LEAST_SIGMA:g} m; expected a standard deviation, or nothing")
        return values

    def set_column(self, lines: list[int], cells: list[str]) -> list[str]:
        for line, cell in zip(lines, cells, strict=False):
            if cell not in ("", "fit", "test"):
                raise self.fail(line, "set", f"'{cell}' is neither fit nor test")
        return [cell or "fit" for cell in cells]


def _looks_infinite(cell: str) -> bool:
    try:
        return not math.isfinite(float(cell))
    except ValueError:
        return False
