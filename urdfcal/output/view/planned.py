"""Poses at which nothing was read yet, as they are planned: what the robot as its URDF has it would show there."""

from __future__ import annotations

import itertools
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin

from urdfcal.base.errors import MeasurementError
from urdfcal.base.geometry import Matrix
from urdfcal.base.reading import TABLE, content_of
from urdfcal.base.tables import Table
from urdfcal.calibration.analysis.arrivals import no_spots
from urdfcal.calibration.reach import on_screen, screen_area
from urdfcal.model.gauge import build_error_model
from urdfcal.output.ways_around import read_ways
from urdfcal.robot.configurations import whole_configurations
from urdfcal.robot.rig import TRACKER, Instruments, Target
from urdfcal.robot.robot import Robot
from urdfcal.sensors.joint_columns import JointColumns
from urdfcal.sensors.measurements import Measurements, spots_measured
from urdfcal.sensors.measurements_csv import read_named_table
from urdfcal.sensors.readings import blank_readings
from urdfcal.sensors.spots import beams_at

_BESIDE = {"pose", "set", "session"}  # columns that say nothing of what was read, as `<joint>.approach` does
SAID = "nothing was read at these poses: beams, spots and points are those of the robot as its URDF has it"


def ways_between(path: Path, data: Measurements) -> tuple[dict[int, Matrix], tuple[str, ...]]:
    """Where the tour of planned poses goes by behind some of its rows, as the file's comments have it, and what is to be said of others.

    Args:
        path: The file.
        data: Its poses.

    Returns:
        Positions (k, inputs), [rad] or [m], by the row that they follow; sentences.
    """
    told = read_ways(content_of(path, TABLE, MeasurementError).decode("utf-8", "ignore").splitlines())
    pairs = list(enumerate(itertools.pairwise(data.poses.tolist())))
    missing = [f"{one} to {other}" for _, (one, other) in pairs if (one, other) in told.blocked]
    said = (f"no free way was found from {', '.join(missing)}: there the view goes straight",) if missing else ()
    if set(told.joints) != set(data.joints):
        return {}, said
    order = [told.joints.index(joint) for joint in data.joints]
    return {row: told.stations[pair][:, order] for row, pair in pairs if pair in told.stations}, said


def planned_poses(path: Path, robot: Robot, target: str | None = None, reference: str | None = None) -> Measurements | None:
    """Poses of a file that has joints and no readings, with what would be read: spots, or a point of the links that the joints move.

    Args:
        path: The file.
        robot: Whose joints its columns are.
        target: Link whose way is shown; by default of every branch the first one that all of the file's joints there move.
        reference: Link that it is looked at from; by default the root, or the last link that joints which the file has not move alike.

    Returns:
        None where something was read.

    Raises:
        MeasurementError: the file cannot be read.
        RobotError: there is no such link.
    """
    table = read_named_table(path, robot)
    joints = {name for name in table.names if not name.endswith(".approach")} - _BESIDE
    if not len(table) or not joints or not joints <= {joint.name for joint in robot.tree.joints.values() if joint.moves}:
        return None
    spots = _spots(robot, joints, table) if target is None and reference is None else None
    if spots is not None:
        return _named(spots, table)
    links = (robot.tree.require_link(target),) if target is not None else _behind(robot, joints)
    base = _before(robot, joints, links) if reference is None else robot.tree.require_link(reference)
    points = _points(robot, links, base, table, joints) if links else None
    return None if points is None else _named(_with_its_lines(points, robot, reference), table)


def _with_its_lines(data: Measurements, robot: Robot, reference: str | None) -> Measurements:
    """The same with a word on lines of sight, where nobody said where they begin."""
    if reference is not None or (not data.reference and TRACKER in robot.tree.links):
        return data
    begin = data.reference or robot.tree.root
    said = f"nobody said where the instrument stands: lines of sight begin at '{begin}'; name its link with --reference"
    return replace(data, warnings=(*data.warnings, said))


def _named(data: Measurements, table: Table) -> Measurements:
    poses = np.array(table.columns["pose"], dtype=str) if "pose" in table.names else np.arange(1, len(data) + 1).astype(str)
    return replace(data, poses=poses, warnings=(*data.warnings, SAID))


def _spots(robot: Robot, joints: set[str], table: Table) -> Measurements | None:
    """Spots of lasers; None where the poses are not for them, since beams miss the screen in some."""
    nothing = no_spots(robot)
    if nothing is None or joints != set(robot.chain.input_names):
        return None
    q, errors = JointColumns(table, robot).positions, build_error_model(robot.chain, robot.rig)
    spots = beams_at(errors, errors.mean, q).spots
    return spots_measured(robot, q, spots) if on_screen(errors, errors.mean, screen_area(robot))(q).all() else None


def _behind(robot: Robot, joints: set[str]) -> tuple[str, ...]:
    """At the end of every branch that these joints move the link nearest to the root; none where not all of the joints move one."""
    ways = {link: robot.tree.path_from_root(link) for link in robot.tree.links}
    moved = {link: frozenset(joint.name for joint in way if joint.name in joints) for link, way in ways.items()}
    there = set(moved.values())
    if frozenset().union(*there) != joints:
        return ()
    ends = [own for own in there if own and not any(own < other for other in there)]
    first = [min((link for link in moved if moved[link] == own), key=lambda link: len(ways[link])) for own in ends]
    return tuple(sorted(first))


def _before(robot: Robot, joints: set[str], links: tuple[str, ...]) -> str:
    """Where links are looked at from: the empty string for the default, or behind the joints that the file does not have, as a torso's."""
    ways = [robot.tree.path_from_root(link) for link in links]
    others = [[joint.child for joint in way if joint.moves and joint.name not in joints] for way in ways]
    return others[0][-1] if others and others[0] and all(own == others[0] for own in others) else ""


def _points(robot: Robot, links: tuple[str, ...], reference: str, table: Table, joints: set[str]) -> Measurements | None:
    """The links' origins in the axes of a link; None where other joints than these are between it and them."""
    seen = robot.seen_by(Instruments(tuple(Target(link, link) for link in links), reference), ())
    if set(seen.chain.input_names) != joints:
        return None
    q, base = JointColumns(table, seen).positions, seen.rig.instruments.reference
    model, data = seen.model, seen.model.createData()
    frames, points = [model.getFrameId(link) for link in links], np.empty((len(links), len(q), 3))
    for row, configuration in enumerate(whole_configurations(seen, q)):
        pin.framesForwardKinematics(model, data, configuration)
        T_root_base = data.oMf[model.getFrameId(base)]
        points[:, row] = [T_root_base.actInv(data.oMf[frame].translation) for frame in frames]
    n = len(q)
    read = tuple(replace(blank_readings("point", link, link, n), values=own) for link, own in zip(links, points, strict=True))
    return Measurements(
        seen.chain.input_names,
        q,
        read,
        np.arange(n).astype(str),
        np.full(n, "fit"),
        np.full(n, ""),
        source=str(table.path),
        reference=reference,
    )
