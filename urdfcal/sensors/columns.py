"""Columns of a measurements file: which sensor and which target each name means, and the robot as these measurements see it."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from urdfcal.base.errors import did_you_mean, nearest_of, no_such
from urdfcal.base.tables import Table
from urdfcal.robot.rig import Grid, lasers_by_name
from urdfcal.robot.robot import Robot
from urdfcal.sensors.column_names import ENDINGS, OF_POSES, misspelt
from urdfcal.sensors.joint_columns import require_joints
from urdfcal.sensors.pose_columns import APPROACH
from urdfcal.sensors.readings import blank_readings, instruments_of
from urdfcal.sensors.registry import SENSORS
from urdfcal.sensors.sensor import Sensor
from urdfcal.sensors.targets import QUATERNION

_OF_TARGETS = {ending: sensor.name for sensor in SENSORS.values() if not sensor.beam and not sensor.aimed for ending in sensor.endings}
_OF_LASERS = {ending: sensor.name for sensor in SENSORS.values() if sensor.beam for ending in sensor.endings}
_OF_AIMED = _OF_LASERS | {ending: sensor.name for sensor in SENSORS.values() if sensor.aimed for ending in sensor.endings}
_OF_NOISE = {sensor.sigma_ending for sensor in SENSORS.values() if sensor.sigma_ending}
_OF_PICTURES = ("u", "v", "sigma_px")
_LIKE_READING = re.compile(r"(.+)[._/ -](x|qx|roll)(_[a-z]+)?", re.IGNORECASE)
_FIGAROH = re.compile(r"(x|y|z|phix|phiy|phiz)(\d+)")
_FIGAROH_WORDS = {"phix": "roll", "phiy": "pitch", "phiz": "yaw"}


@dataclass(frozen=True)
class ReadingColumn:
    """A column of readings.

    Attributes:
        name: As in the header, without its unit.
        target: The target's name.
        link: The link that it is on.
        ending: What stands behind the target's name.
        sensor: Name of the sensor that reads it; the empty string where it states the noise of the others.
        instrument: What it is read with; the empty string where nothing is said.
    """

    name: str
    target: str
    link: str
    ending: str
    sensor: str
    instrument: str = ""

    @property
    def label(self) -> str:
        """What stands before its ending: target and instrument."""
        return self.name.rpartition(".")[0]

    @property
    def kind(self) -> Sensor:
        """How it is read."""
        return SENSORS[self.sensor]


@dataclass(frozen=True)
class Stations:
    """Instruments that readings may name, beside links.

    Attributes:
        links: Link of each; the empty string for the default: `tracker`, or the root.
        cameras: Of those that see in pixels, a `sensors.camera.Camera` each.
    """

    links: Mapping[str, str] = field(default_factory=dict)
    cameras: Mapping[str, Any] = field(default_factory=dict)


NONE = Stations()
Group = Mapping[str, ReadingColumn]  # the columns of one sensor and one target, by their endings


@dataclass(frozen=True)
class Columns:
    """What the columns of a file mean.

    Attributes:
        robot: The robot as these measurements see it: with lasers if there are spots, or nothing else; with the targets that are named.
        read: What was read of each target, with its instrument if one is named, by each sensor: of lasers first, in their order, and
            pixels before metres.
        warnings: Columns that mean nothing, and lasers that have none.
    """

    robot: Robot
    read: Mapping[tuple[str, str], Group]
    warnings: tuple[str, ...]


def columns_of(table: Table, robot: Robot, reference: str, camera: Any, boards: Mapping[str, Grid], stations: Stations = NONE) -> Columns:
    """What the columns of a table of measurements mean.

    Raises:
        MeasurementError: a column is missing, or cannot be taken as it is.
        RigError: a link that is needed is not there, or not where it can be.
    """
    lasers = _laser_candidates(table, robot)
    others = () if robot.lasers is None else set(lasers) - set(robot.lasers)
    named = [column for column in reading_columns(table.names, robot, lasers) if column.target not in others]
    by_camera = {*stations.cameras, *([""] if camera is not None else [])}
    if camera is not None:
        by_camera |= {column.instrument for column in named}
    columns = [column for column in named if column.instrument in by_camera or column.ending not in _OF_PICTURES]
    _refuse(table, robot, columns, [column for column in named if column not in columns], stations)
    seen = _as_seen(robot, columns, reference, camera, boards, stations)
    require_joints(table, seen)
    _require_whole_spots(table, seen, seen.rig.lasers)
    read = _by_target(table, seen, columns)
    warnings = (*_never_seen(table, seen, read), *_unused(table, seen, {column.name for column in named}))
    return Columns(seen, read, warnings)


def seen_as(table: Table, robot: Robot, reference: str, camera: Any, boards: Mapping[str, Grid], stations: Stations = NONE) -> Robot:
    """The robot as the readings in a table see it, whatever else the table holds.

    Raises:
        MeasurementError: none of its columns is a reading, as where a link has another name.
    """
    columns = reading_columns(table.names, robot, _laser_candidates(table, robot))
    _refuse(table, robot, columns, (), stations)
    return _as_seen(robot, columns, reference, camera, boards, stations)


def _laser_candidates(table: Table, robot: Robot) -> tuple[str, ...]:
    """Links that are lasers by what was asked for or by their name; one with an x has a point, and no spot."""
    named = (*(robot.lasers or ()), *lasers_by_name(robot.tree))
    return tuple(dict.fromkeys(laser for laser in named if f"{laser}.x" not in table.names))


def _refuse(table: Table, robot: Robot, columns: Sequence[ReadingColumn], in_pictures: Sequence[ReadingColumn], stations: Stations) -> None:
    """Refuse columns that cannot be taken as they are; where nothing at all is measured, say what comes nearest to it."""
    fault = refusal(columns, table.units) or _strange_instrument([*columns, *in_pictures], robot, stations) or _half_named(columns, robot)
    named = next((column for column in in_pictures if column.instrument and column.sensor), None)
    if fault is None and named is not None:
        entry = f"instruments: {{{named.instrument}: {{camera: CAMERA.yaml}}}}"
        fault = named.name, f"pixels need the camera that they were read with; name it in rig.yaml ({entry}) or with --camera CAMERA.yaml"
    if fault is None and in_pictures and not any(column.sensor for column in columns):
        fault = in_pictures[0].name, "pixels need the camera that they were read with; give it with --camera CAMERA.yaml"
    if fault is None and not in_pictures and not columns:
        fault = without_link(table.names) or lost_column(table.names, robot) or nothing_read(table.names, robot)
    if fault is not None:
        raise table.fail(None, *fault)


def _strange_instrument(columns: Sequence[ReadingColumn], robot: Robot, stations: Stations) -> tuple[str, str] | None:
    """The first column whose instrument is neither named nor a link, or is named for what needs none, and what is wrong."""
    for column in (column for column in columns if column.instrument or "@" in column.label):
        known = (*stations.links, *robot.tree.links)
        if column.instrument not in known:
            way_out = f"name it in rig.yaml, instruments: {{{column.instrument or 'NAME'}: {{link: LINK}}}}"
            return column.name, f"{no_such('instrument', column.instrument, known)}; expected a link, or {way_out}"
        if column.sensor and column.kind.beam:
            way_out = f"write '{column.target}.{column.ending}', with --screen LINK"
            return column.name, f"a camera reads spots on the screen in front of it alone; {way_out}"
    return None


def _half_named(columns: Sequence[ReadingColumn], robot: Robot) -> tuple[str, str] | None:
    """The first column of a laser that names no screen where others do: it would have two mounts, or be one of several modules."""
    read = [column for column in columns if column.sensor]
    plain = next((column for column in read if column.kind.beam), None)
    if plain is None or not any(column.kind.aimed for column in read):
        return None
    screen = robot.screen or "screen"
    return plain.name, f"other spots name the screen that they are on; name it here, too: '{plain.target}@{screen}.{plain.ending}'"


def _as_seen(
    robot: Robot, columns: Sequence[ReadingColumn], reference: str, camera: Any, boards: Mapping[str, Grid], stations: Stations
) -> Robot:
    read = dict.fromkeys((column.sensor, column.target, column.link, column.instrument) for column in columns if column.sensor)
    blank = [blank_readings(sensor, target, link, instrument=instrument) for sensor, target, link, instrument in read]
    instruments = instruments_of(blank, reference, camera, boards, stations.links)
    spots = any(SENSORS[sensor].beam for sensor, *_ in read)
    return robot.seen_by(instruments, robot.lasers if spots else ()) if instruments.needed else robot


def _require_whole_spots(table: Table, robot: Robot, lasers: Sequence[str]) -> None:
    """Refuse one coordinate of a spot without the other, also where an x beside it makes a point of it."""
    for laser in lasers:
        given = [ending for ending in SENSORS["spot"].endings if f"{laser}.{ending}" in table.names]
        if given:
            _require_whole(table, robot, "spot", laser, given)


def _require_whole(table: Table, robot: Robot, sensor: str, target: str, given: Collection[str]) -> None:
    lacking = SENSORS[sensor].lacking(target, given)
    if lacking is not None:
        raise table.fail(None, f"{target}.{lacking[0]}", f"{lacking[1]}{misspelt(f'{target}.{lacking[0]}', table, robot)}")


def _by_target(table: Table, robot: Robot, columns: Sequence[ReadingColumn]) -> Mapping[tuple[str, str], Group]:
    """Columns by target and sensor; those of lasers first.

    Raises:
        MeasurementError: a column is missing beside others.
    """
    groups: dict[tuple[str, str], dict[str, ReadingColumn]] = {}
    for column in (column for column in columns if column.sensor):
        groups.setdefault((column.label, column.sensor), {})[column.ending] = column
    for (target, sensor), group in groups.items():
        _require_whole(table, robot, sensor, target, group)
    chosen = [key for laser in robot.rig.lasers if (key := _chosen(laser, groups)) is not None]
    return {key: groups[key] for key in chosen} | {key: group for key, group in groups.items() if not SENSORS[key[1]].beam}


def _chosen(laser: str, groups: Collection[tuple[str, str]]) -> tuple[str, str] | None:
    """What is read of a laser: pixels before metres, None for nothing."""
    spots = [(target, sensor) for target, sensor in groups if target == laser and SENSORS[sensor].beam]
    return min(spots, key=lambda key: key[1] == "spot", default=None)


def _never_seen(table: Table, robot: Robot, read: Collection[tuple[str, str]]) -> Iterator[str]:
    """A warning for each laser that has no columns.

    Raises:
        MeasurementError: there are no others.
    """
    targets = {target for target, _ in read}
    unseen = [laser for laser in robot.rig.lasers if laser not in targets]
    if unseen and unseen == list(robot.rig.lasers):
        expected = "is missing, and no other laser has columns; expected <laser>.y and <laser>.z"
        raise table.fail(None, f"{unseen[0]}.y", f"{expected}{misspelt(f'{unseen[0]}.y', table, robot)}")
    for laser in unseen:
        yield f"{table.path}: laser '{laser}' of the robot has no columns; it is taken as never seen"


def _unused(table: Table, robot: Robot, meant: Collection[str]) -> Iterator[str]:
    """A warning for each column that means nothing."""
    known = {
        *meant,
        *OF_POSES,
        *(f"{joint.name}.{APPROACH}" for joint in robot.chain.inputs),
        *(f"{laser}.{ending}" for laser in robot.rig.lasers for ending in (*SENSORS["spot"].endings, "sigma")),
        *(joint.name for joint in robot.tree.joints.values() if not joint.rigid),
    }
    nearest = sorted(known - set(table.names))
    readings = {f"{name.rpartition('.')[0]}.{ending}" for name in meant for ending in ENDINGS}
    for name in table.names:
        if name not in known:
            where = f"{table.header}: column '{name}'"
            hint = nearest_of(name, {*nearest, *readings} - set(table.names)) or did_you_mean(name, nearest)
            yield f"{where} means nothing here and is not used{hint}"


def reading_columns(names: Iterable[str], robot: Robot, lasers: Sequence[str]) -> tuple[ReadingColumn, ...]:
    """The columns that mean a target on a link of this robot, or the spots of one of these lasers."""
    found, every = [], tuple(names)
    for name in every:
        label, dot, ending = name.rpartition(".")
        target, _, instrument = label.partition("@")
        link = target if target in robot.tree.links else target.rpartition(":")[0]
        of_laser = target in lasers and not (instrument and f"{label}.x" in every)
        known = _OF_TARGETS if not of_laser else _OF_AIMED if instrument else _OF_LASERS
        if dot and link in robot.tree.links and (ending in known or ending in _OF_NOISE):
            found.append(ReadingColumn(name, target, link, ending, known.get(ending, ""), instrument))
    read = {column.label for column in found if column.sensor}
    return tuple(column for column in found if column.label in read)


def refusal(columns: Sequence[ReadingColumn], units: Mapping[str, str]) -> tuple[str, str] | None:
    """The first column that cannot be taken as it is, and why: a unit that means nothing, half a name, two orientations."""
    turned: dict[str, ReadingColumn] = {}
    for column in columns:
        if column.target.endswith(":"):
            return column.name, f"the label behind '{column.target}' is empty; expected {column.link}.{column.ending}, or a label"
        if column.sensor and column.kind.touches and column.name in units:
            return column.name, f"the unit '{units[column.name]}' of a label means nothing; expected '{column.name}' alone"
        if column.sensor == "orientation":
            first = turned.setdefault(column.label, column)
            if (first.ending in QUATERNION) != (column.ending in QUATERNION):
                return column.name, f"the orientation is in '{first.name}', too; leave one of the two out"
    return None


def lost_column(names: Collection[str], robot: Robot) -> tuple[str, str] | None:
    """Where a header means nothing at all: the first column that looks like a target's, and what is wrong with its link or its ending."""
    known, links = set(names), robot.tree.links
    for name in names:
        target, dot, ending = name.rpartition(".")
        link = target if target in links else target.partition(":")[0]
        spot = ending in ("y", "z") and f"{target}.x" not in known  # which has reasons of its own to be lost
        if dot and ending in _OF_TARGETS and link not in links and not spot:
            return name, f"{no_such('link', link, links)}{_put_on(link)}"
        if dot and link in links and ending not in _OF_TARGETS and ending not in _OF_NOISE:
            return name, f"the ending '.{ending}' means nothing; expected one of {', '.join(f'.{own}' for own in _OF_TARGETS)}"
    return None


def _put_on(link: str) -> str:
    """The way out for a link that is called as `urdfcal rig` calls what it puts on a robot."""
    option = {"board": "--board COLSxROWS:SQUARE", "target": "--tracker"}.get(link)
    return f"; urdfcal rig {option} puts one on the robot" if option else ""


def without_link(names: Collection[str]) -> tuple[str, str] | None:
    """Where a header means nothing at all: the first column that is a reading but for the link, and how to name it."""
    known = [name for name in names if name.casefold() in ENDINGS]
    what = SENSORS[(_OF_TARGETS | _OF_LASERS)[known[0].casefold()]].words.several if known else ""
    if not known:
        return None
    return known[0], f"the file looks like {what} ({', '.join(known)}); which link are they of? name it with --target LINK"


def nothing_read(names: Collection[str], robot: Robot) -> tuple[str, str] | None:
    """Where a header means nothing at all, and no laser with a screen that it may be about: what columns of readings look like."""
    if (fault := _of_no_link(names, robot)) is not None:
        return fault
    lasers, screen = robot.lasers or lasers_by_name(robot.tree), robot.screen or "screen"
    if lasers and (screen in robot.tree.links or any(name.rpartition(".")[0] in lasers for name in names)):
        return None
    spots = [name for name in names if name.endswith((".y", ".z"))]
    if spots:
        link = spots[0].rpartition(".")[0]
        return spots[0], (
            f"the file looks like laser spots (.y and .z), and the robot has {'no link' if link not in robot.tree.links else 'a link'} "
            f"'{link}'; name the lasers with --laser LINK and the screen with --screen LINK, put them on the robot with urdfcal rig "
            "--screen, or give a point its .x too"
        )
    if not any(joint in names for joint in robot.tree.joints):
        return None
    link = max(robot.tree.links, key=lambda name: sum(joint.moves for joint in robot.tree.path_from_root(name)))
    return f"{link}.x", (
        f"is missing, and so is every other reading: the file has joints alone; expected for example {link}.x, {link}.y, {link}.z "
        "(points), or x, y, z with --target LINK"
    )


def _of_no_link(names: Collection[str], robot: Robot) -> tuple[str, str] | None:
    """The first column that looks like a reading of a link that there is not, as `marker_x` does."""
    for name in names:
        match = None if name in robot.tree.joints else _LIKE_READING.fullmatch(name)
        if match is not None:
            what = SENSORS[_OF_TARGETS[match[2].lower()]].words.several
            found = f"the file looks like {what} of '{match[1]}', and there is {no_such('link', match[1], robot.tree.links)}"
            return name, f"{found}; or name the columns x, y, z ... and use --target LINK"
    return None


def with_our_names(table: Table, target: str) -> Table:
    """A table with figaroh's columns x1, y1 ... in our own names.

    Raises:
        MeasurementError: it has such columns, and no link is named that they belong to.
    """
    ours = {name: own for name in table.names if (own := figaroh_name(name, target))}
    if ours and not target:
        raise table.fail(None, next(iter(ours)), "which link is it measured on? name it with --target LINK")
    return table.renamed(ours)


def figaroh_name(cell: str, target: str) -> str:
    """Our name of figaroh's column x1, phiz2 ...; the empty string for any other."""
    match = _FIGAROH.fullmatch(cell.strip())
    if match is None:
        return ""
    label = "" if match[2] == "1" else f":{match[2]}"
    return f"{target}{label}.{_FIGAROH_WORDS.get(match[1], match[1])}"
