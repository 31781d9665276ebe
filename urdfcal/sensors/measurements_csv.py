"""`measurements.csv`, in and out."""

from __future__ import annotations

import csv
import hashlib
import io
import math
import re
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from urdfcal.base.errors import MeasurementError, did_you_mean
from urdfcal.base.files import write_whole
from urdfcal.base.geometry import DEG, MM
from urdfcal.base.rotations import quaternions_of
from urdfcal.robot.rig import Grid, lasers_by_name
from urdfcal.robot.robot import Robot
from urdfcal.robot.urdf_tree import FARTHEST, UrdfJoint
from urdfcal.sensors.columns import (
    ANGLE_WORDS,
    LENGTH_WORDS,
    QUATERNION,
    ROLL_PITCH_YAW,
    TargetColumn,
    blank_readings,
    figaroh_name,
    lost_column,
    refusal,
    target_columns,
    written_columns,
)
from urdfcal.sensors.measurements import Measurements
from urdfcal.sensors.readings import Readings, instruments_of

_LENGTHS = {"m": 1.0, "mm": MM}


_ANGLES = {"rad": 1.0, "deg": DEG}


_NUMBER = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]+)?")


_LEAST_SIGMA = 1e-12  # [m]: a spot known better than that is a mistake, and its weight overflows


_UNIT_WITHIN = 1e-3  # how far a quaternion's length may be from one: rounding of the file


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
    header = ["pose", *data.joints, *(f"{laser}.{axis}" for laser in data.lasers for axis in "yz")]
    stated = [index for index in range(len(data.lasers)) if not np.isnan(data.sigma[:, index]).all()]
    header += [f"{data.lasers[index]}.sigma" for index in stated]
    others = [column for each in data.readings for column in written_columns(each)]
    marks = {"set": data.sets} if (data.sets == "test").any() else {}
    marks |= {"session": data.sessions} if (data.sessions != "").any() else {}
    marks |= {"payload": np.array([f"{mass:.12g}" for mass in data.payload])} if data.payload is not None else {}
    text = io.StringIO()
    text.writelines(f"# {' '.join(comment.split())}\n" for comment in comments)
    table = csv.writer(text, lineterminator="\n")
    table.writerow([*header, *(name for name, _ in others), *marks])
    numbers = np.hstack([data.q, data.spots.reshape(len(data), -1), data.sigma[:, stated]])
    for pose, row in enumerate(numbers):
        cells = ["" if math.isnan(number) else f"{number:.12g}" for number in row]
        cells += [values[pose] for _, values in others]
        table.writerow([_label(data.poses[pose]), *cells, *(_label(mark[pose]) for mark in marks.values())])
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
        spots_only = (laser for laser in (*self.laser_candidates(), *lasers_by_name(self.robot.tree)) if f"{laser}.x" not in self.index)
        columns = target_columns(self.index, self.robot, tuple(spots_only))
        pixels = ("pixel", "sigma_px")
        self.columns = columns if self.camera is not None else tuple(column for column in columns if column.kind not in pixels)
        self.unused_pixels = tuple(column.name for column in columns if column not in self.columns)
        self.refuse_header(line)
        self.choose_instruments()
        self.check_columns()

    def refuse_header(self, line: int) -> None:
        """Refuse columns of targets that cannot be taken as they are; where nothing at all is measured, say what comes nearest to it."""
        spots = any(f"{laser}.{axis}" in self.index for laser in self.laser_candidates() for axis in "yz")
        refused = refusal(self.columns, self.units)
        if refused is None and not self.columns and not spots and not self.unused_pixels:
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
        """Links that are lasers by what was asked for or by their name, and have spots here: y and z without x."""
        named = self.robot.lasers if self.robot.lasers is not None else lasers_by_name(self.robot.tree)
        return tuple(laser for laser in named if f"{laser}.x" not in self.index)

    def choose_instruments(self) -> None:
        """The robot as these measurements see it: with lasers if there are spots, or nothing else; with the targets that are named."""
        kinds = tuple(dict.fromkeys((column.target, column.kind) for column in self.columns))
        pixels = {column.target for column in self.columns if column.kind == "pixel"}
        spots = any(f"{laser}.{axis}" in self.index for laser in self.laser_candidates() for axis in "yz")
        spots |= any(laser in pixels for laser in self.laser_candidates())
        if not kinds and not spots and self.unused_pixels:
            way_out = "pixels need the camera that they were read with; give it with --camera CAMERA.yaml"
            raise self.fail(self.header_line, self.unused_pixels[0], way_out)
        blank = tuple(blank_readings(column, target, kind) for target, kind in kinds for column in self.columns if column.target == target)
        if kinds:
            lasers = self.laser_candidates() if spots else ()
            self.robot = self.robot.seen_by(
                instruments_of(blank, self.reference, lasers, self.camera, self.boards), self.robot.lasers if spots else ()
            )
        self.joints, self.lasers = self.robot.chain.inputs, self.robot.rig.lasers

    def check_columns(self) -> None:
        for joint in self.joints:
            if joint.name not in self.index:
                raise self.fail(
                    self.header_line,
                    joint.name,
                    f"is missing; expected a column for each joint on the way{did_you_mean(joint.name, self.index)}",
                )
        pixels = {column.target for column in self.columns if column.kind == "pixel"}
        known = {
            *self.unused_pixels,
            "set",
            "session",
            "pose",
            "payload",
            *(column.name for column in self.columns),
            *(joint.name for joint in self.robot.tree.joints.values() if not joint.rigid),
        }
        for laser in self.lasers:
            y, z = f"{laser}.y", f"{laser}.z"
            known |= {y, z, f"{laser}.sigma"}
            if (y in self.index) != (z in self.index):
                raise self.fail(self.header_line, z if y in self.index else y, f"is missing; a spot of {laser} needs {y} and {z}")
        self.seen_lasers = [laser for laser in self.lasers if f"{laser}.y" in self.index and laser not in pixels]
        if self.lasers and not self.seen_lasers and not pixels:
            raise self.fail(
                self.header_line, f"{self.lasers[0]}.y", "is missing, and no other laser has columns; expected <laser>.y and <laser>.z"
            )
        for laser in self.lasers:
            if laser not in self.seen_lasers and laser not in pixels:
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
        spots, sigma = np.full((n, len(self.lasers), 2), np.nan), np.full((n, len(self.lasers)), np.nan)
        for index, laser in enumerate(self.lasers):
            if laser in self.seen_lasers:
                spots[:, index] = self.spot_columns(laser, lines, columns)
            if f"{laser}.sigma" in columns:
                sigma[:, index] = self.sigma_column(f"{laser}.sigma", lines, columns[f"{laser}.sigma"])
        readings = tuple(self.readings(lines, columns))
        if np.isnan(spots).all() and not any(each.seen.any() for each in readings):
            first = f"{self.seen_lasers[0]}.y" if self.seen_lasers else self.columns[0].name
            what = "spot" if self.seen_lasers else "reading"
            raise self.fail(lines[0], first, f"every {what} is empty; expected at least one that was seen")
        numbers = [str(number) for number in range(1, n + 1)]
        poses = [label or number for label, number in zip(columns.get("pose", numbers), numbers, strict=True)]
        return Measurements(
            joints=tuple(joint.name for joint in self.joints),
            lasers=self.lasers,
            q=q,
            spots=spots,
            sigma=sigma,
            poses=np.array(poses, dtype=str),
            sets=np.array(self.set_column(lines, columns.get("set", [])) or ["fit"] * n, dtype=str),
            sessions=np.array(columns.get("session", [""] * n), dtype=str),
            source=str(self.path),
            sha256=self.sha256,
            lines=np.array(lines),
            warnings=tuple(self.warnings),
            readings=readings,
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

    def readings(self, lines: list[int], columns: dict[str, list[str]]) -> Iterator[Readings]:
        """What instruments beside lasers read."""
        by_target: dict[tuple[str, str], dict[str, TargetColumn]] = {}
        for column in self.columns:
            if not column.kind.startswith("sigma"):
                by_target.setdefault((column.target, column.kind), {})[column.what] = column
        for (target, kind), own in by_target.items():
            self.require_whole(kind, own)
            wanted = "sigma_px" if kind == "pixel" else "sigma"
            stated = next((column.name for column in self.columns if (column.target, column.kind) == (target, wanted)), None)
            n, link = len(lines), next(iter(own.values())).link
            sigma = np.full(n, np.nan)
            if stated is not None and kind != "orientation":
                units = _LENGTHS if kind != "pixel" else {"": 1.0, "px": 1.0}
                sigma = self.sigma_column(stated, lines, columns[stated], units)
            if kind in ("plane", "socket"):
                labels = np.array(columns[own[kind].name], dtype=str)
                yield Readings(kind, target, link, np.empty((n, 0)), labels, sigma)
                continue
            numbers = {what: self.target_numbers(column, lines, columns[column.name]) for what, column in own.items()}
            values = self.stored(kind, numbers, own, lines)
            yield Readings(kind, target, link, values, np.full(n, ""), sigma)

    def target_numbers(self, column: TargetColumn, lines: list[int], cells: list[str]) -> Any:
        allowed = _LENGTHS if column.what in LENGTH_WORDS else _ANGLES if column.what in ANGLE_WORDS else {"": 1.0, "px": 1.0}
        factor = self.unit(column.name, allowed)
        return self.numbers(column.name, lines, cells, factor, "leave the cell empty if it was not read", empty=True)

    def require_whole(self, kind: str, own: dict[str, TargetColumn]) -> None:
        for words in (QUATERNION, ROLL_PITCH_YAW):
            if kind == "orientation" and (missing := [word for word in words if word not in own]) and len(missing) < len(words):
                name = next(iter(own.values())).target
                raise self.fail(self.header_line, f"{name}.{missing[0]}", f"is missing; an orientation needs {', '.join(words)}")

    def stored(self, kind: str, numbers: dict[str, Any], own: dict[str, TargetColumn], lines: list[int]) -> Any:
        """Columns as readings keep them; an orientation as a unit quaternion."""
        if kind == "point":
            return np.column_stack([numbers.get(axis, np.full(len(lines), np.nan)) for axis in "xyz"])
        if kind == "distance":
            below = numbers["distance"] < 0
            if below.any():
                found = f"{numbers['distance'][below][0]:g} m is below zero; expected a distance, or nothing"
                raise self.fail(lines[int(np.argmax(below))], own["distance"].name, found)
            return numbers["distance"][:, None]
        if kind == "pixel":
            return self.pixel_pair(numbers, own, lines)
        words = QUATERNION if QUATERNION[0] in numbers else ROLL_PITCH_YAW
        table = np.column_stack([numbers[word] for word in words])
        partly = np.isnan(table).any(axis=1) & ~np.isnan(table).all(axis=1)
        if partly.any():
            row = int(np.argmax(partly))
            name = own[words[int(np.argmax(np.isnan(table[row])))]].name
            raise self.fail(lines[row], name, "the cell is empty and others of this orientation are not; leave all of them empty, or none")
        if words == ROLL_PITCH_YAW:
            return quaternions_of(table)
        length = np.linalg.norm(table, axis=1)
        wrong = np.abs(length - 1) > _UNIT_WITHIN
        if wrong.any():
            row = int(np.argmax(wrong))
            found = f"the quaternion has length {length[row]:.4g}, expected 1 (x, y, z, w)"
            raise self.fail(lines[row], own[words[0]].name, found)
        return table / length[:, None]

    def pixel_pair(self, numbers: dict[str, Any], own: dict[str, TargetColumn], lines: list[int]) -> Any:
        for word in "uv":
            if word not in numbers:
                name = next(iter(own.values())).target
                raise self.fail(self.header_line, f"{name}.{word}", "is missing; a spot or target in a picture needs .u and .v")
        lone = np.isnan(numbers["u"]) != np.isnan(numbers["v"])
        if lone.any():
            row = int(np.argmax(lone))
            word = "u" if np.isnan(numbers["u"][row]) else "v"
            raise self.fail(lines[row], own[word].name, "the cell is empty and its other one is not; leave both empty if it was not seen")
        return np.column_stack([numbers["u"], numbers["v"]])

    def unit(self, name: str, allowed: dict[str, float]) -> float:
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
        allowed = _LENGTHS if joint.prismatic else _ANGLES
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

    def spot_columns(self, laser: str, lines: list[int], columns: dict[str, list[str]]) -> Any:
        way_out = "leave both cells of a beam empty if it was not seen"
        pair = []
        for axis in "yz":
            name = f"{laser}.{axis}"
            pair.append(self.numbers(name, lines, columns[name], self.unit(name, _LENGTHS), way_out, empty=True))
        lone = np.isnan(pair[0]) != np.isnan(pair[1])
        if lone.any():
            row = int(np.argmax(lone))
            axis = "y" if np.isnan(pair[0][row]) else "z"
            raise self.fail(lines[row], f"{laser}.{axis}", f"the cell is empty and the beam's other one is not; {way_out}")
        return np.column_stack(pair)

    def sigma_column(self, name: str, lines: list[int], cells: list[str], units: dict[str, float] = _LENGTHS) -> Any:
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
