"""Poses at which nothing was read yet, as they are planned: what the robot as its URDF has it would show there."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin

from urdfcal.base.tables import Table
from urdfcal.calibration.analysis.arrivals import no_spots
from urdfcal.calibration.reach import on_screen, screen_area
from urdfcal.model.gauge import build_error_model
from urdfcal.robot.configurations import whole_configurations
from urdfcal.robot.rig import Instruments, Target
from urdfcal.robot.robot import Robot
from urdfcal.sensors.joint_columns import JointColumns
from urdfcal.sensors.measurements import Measurements, spots_measured
from urdfcal.sensors.measurements_csv import read_named_table
from urdfcal.sensors.readings import blank_readings
from urdfcal.sensors.spots import beams_at

_BESIDE = {"pose", "set", "session"}  # columns that say nothing of what was read, as `<joint>.approach` does
SAID = "nothing was read at these poses: beams, spots and points are those of the robot as its URDF has it"


def planned_poses(path: Path, robot: Robot, target: str | None = None) -> Measurements | None:
    """Poses of a file that has joints and no readings, with what would be read: spots, or a point of the links that the joints move.

    Args:
        path: The file.
        robot: Whose joints its columns are.
        target: Link whose way is shown; by default of every branch the first one that all of the file's joints there move.

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
    spots = _spots(robot, joints, table) if target is None else None
    if spots is not None:
        return _named(spots, table)
    links = (robot.tree.require_link(target),) if target is not None else _behind(robot, joints)
    return _named(_points(robot, links, table), table) if links else None


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
    moved = {link: frozenset(joint.name for joint in way if joint.moves) for link, way in ways.items()}
    there = {own for own in moved.values() if own and own <= joints}
    if frozenset().union(*there) != joints:
        return ()
    ends = [own for own in there if not any(own < other for other in there)]
    first = [min((link for link in moved if moved[link] == own), key=lambda link: len(ways[link])) for own in ends]
    return tuple(sorted(first))


def _points(robot: Robot, links: tuple[str, ...], table: Table) -> Measurements:
    """The links' origins in the root's axes."""
    seen = robot.seen_by(Instruments(tuple(Target(link, link) for link in links)), ())
    q = JointColumns(table, seen).positions
    model, data = seen.model, seen.model.createData()
    frames, points = [model.getFrameId(link) for link in links], np.empty((len(links), len(q), 3))
    for row, configuration in enumerate(whole_configurations(seen, q)):
        pin.framesForwardKinematics(model, data, configuration)
        points[:, row] = [data.oMf[frame].translation for frame in frames]
    n = len(q)
    read = tuple(replace(blank_readings("point", link, link, n), values=own) for link, own in zip(links, points, strict=True))
    return Measurements(
        seen.chain.input_names, q, read, np.arange(n).astype(str), np.full(n, "fit"), np.full(n, ""), source=str(table.path)
    )
