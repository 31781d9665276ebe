"""Measurements with the rig, the camera and the noise that a command line states for them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from urdfcal.base.errors import UsageError
from urdfcal.cli.inputs import warn_if_mixed
from urdfcal.cli.stated import parsed_grid, positive

if TYPE_CHECKING:
    from urdfcal.calibration.rig_file import RigFile
    from urdfcal.model.options import ModelOptions
    from urdfcal.robot.robot import Robot
    from urdfcal.sensors.columns import Stations
    from urdfcal.sensors.measurements import Measurements


_MOST_DEGREES = 90.0


def measured(
    robot: Robot,
    path: Path,
    rig: RigFile | None = None,
    reference: str | None = None,
    target: str | None = None,
    camera: Path | None = None,
) -> tuple[Robot, Measurements]:
    """Measurements, and the robot with the instruments that they were made with.

    Raises:
        MeasurementError: the file cannot be read.
        RigError: a link that is needed is not there, or not where it can be.
        UsageError: known distances belong to no sockets.
    """
    from dataclasses import replace

    from urdfcal.sensors.measurements import as_measured
    from urdfcal.sensors.measurements_csv import read_measurements
    from urdfcal.sensors.readings import known_lengths

    reference, target = reference or (rig.reference if rig else None), target or (rig.target if rig else None)
    if target is not None:
        robot.tree.require_link(target)
    require_boards(robot, rig)
    seen_by, stations = camera_of(camera), stations_of(robot, rig)
    boards = rig.grids() if rig else {}
    data = read_measurements(path, robot, reference=reference, target=target, camera=seen_by, boards=boards, stations=stations)
    if rig is not None:
        data = replace(data, lengths=known_lengths(rig.lengths(), data.readings))
    if target is not None and not (rig and rig.target) and target not in {reading.link for reading in data.readings}:
        raise UsageError(f"--target {target}: {path} has no columns such as x, y, z or x1, y1, z1 that need it")
    if reference is not None and not (rig and rig.reference) and data.only_spots:
        raise UsageError(f"--reference {reference}: laser spots are measured on the screen; {path} has nothing else that it could be for")
    if camera is not None and not any(reading.kind.by_camera for reading in data.readings):
        raise UsageError(f"--camera {camera}: {path} has no columns in pixels (.u .v) that it could be for")
    return as_measured(robot, data), data


def stations_of(robot: Robot, rig: RigFile | None) -> Stations:
    """The instruments of a rig.yaml with their cameras; a name that is a link's stands on that unless another one is stated.

    Raises:
        RobotError: an instrument stands on no link of the robot.
        CameraError: a camera's file cannot be read.
    """
    from urdfcal.sensors.columns import Stations

    entries = rig.instruments if rig is not None else {}
    links = {name: entry.link or (name if name in robot.tree.links else "") for name, entry in entries.items()}
    for link in filter(None, links.values()):
        robot.tree.require_link(link)
    return Stations(links, {name: camera_of(Path(entry.camera)) for name, entry in entries.items() if entry.camera})


def require_boards(robot: Robot, rig: RigFile | None) -> None:
    """Refuse boards that are no links of the robot.

    Raises:
        RobotError: names the nearest.
    """
    for link in rig.grids() if rig is not None else ():
        robot.tree.require_link(link)


def camera_of(path: Path | None) -> Any:
    """The camera in a file; None without one."""
    if path is None:
        return None
    from urdfcal.vision.camera.camera_file import read_camera

    found = read_camera(path)
    warn_if_mixed(path)
    return found


def rig_file_of(path: Path | None, reference_known: bool = False, target_known: bool = False) -> RigFile:
    """The rig.yaml that was given, or an empty one, with what the command line says of both ends."""
    from urdfcal.calibration.rig_file import RigFile, read_rig_file

    rig = RigFile.model_construct() if path is None else read_rig_file(path)
    ends = {"reference_known": rig.reference_known or reference_known, "target_known": rig.target_known or target_known}
    return rig.model_copy(update=ends)


def rig_options(rig: RigFile, path: Path | None, robot: Robot) -> ModelOptions:
    """What a rig.yaml wants calibrated.

    Raises:
        RigError: it was made for a robot with other beams.
    """
    if path is not None:
        rig.require_beams(robot, path)
    return rig.options()


def with_board(rig: RigFile, board: str | None) -> RigFile:
    """The rig with one more board, `LINK=COLSxROWS:SQUARE`.

    Raises:
        UsageError: the text is none.
    """
    if board is None:
        return rig
    link, _, grid = board.rpartition("=")
    corners = parsed_grid("--board", grid)
    if not link:
        raise UsageError(f"--board {board}: expected the link that it is, too, such as board={grid}")
    return rig.model_copy(update={"boards": {**rig.boards, link: str(corners)}})


def joint_noise(robot: Robot, rig: RigFile, stated_deg: float | None) -> Any:
    """Standard deviation of every joint reading, [rad]."""
    import numpy as np

    from urdfcal.base.errors import RigError, no_such

    if stated_deg is not None and not 0 <= stated_deg <= _MOST_DEGREES:
        raise UsageError(f"--joint-sigma-deg {stated_deg:g}: expected a number from 0 to {_MOST_DEGREES:g}")
    common = stated_deg if stated_deg is not None else rig.noise.joint_deg or 0.0
    names = robot.chain.input_names
    for name in rig.noise.joints_deg:
        if name not in names:
            raise RigError(f"noise.joints_deg: {no_such('joint', name, names)}")
    own = rig.noise.joints_deg if stated_deg is None else {}
    degrees = [0.0 if joint.prismatic else own.get(joint.name, common) for joint in robot.chain.inputs]
    return np.radians(degrees)


def sensor_noise(data: Measurements, rig: RigFile, spot_mm: float | None) -> dict[str, float]:
    """Noise by kind of reading, [m], [rad] or [px], as far as it is stated; a rig.yaml may tell more than these measurements need.

    Raises:
        UsageError: noise of spots is asked for where there are none.
    """
    from urdfcal.sensors.stated_noise import states_all

    if spot_mm is not None and "spot" not in data.kinds:
        raise UsageError("--spot-sigma-mm: no laser spots are measured in mm; state other noise in rig.yaml (noise: {point_mm: 0.1})")
    stated = rig.noise.by_kind()
    if spot_mm is not None:
        positive("--spot-sigma-mm", spot_mm)
        stated["spot"] = spot_mm * 1e-3
    asked = {"spot"} if spot_mm is not None else set()
    return {kind: sigma for kind, sigma in stated.items() if kind in asked or (kind in data.kinds and not states_all(data, kind))}


def require_ends_for(data: Measurements, **ends: bool) -> None:
    """Refuse options about measuring frames and targets where none is.

    Raises:
        UsageError: naming the option.
    """
    for name, known in ends.items():
        if known and data.only_spots:
            raise UsageError(f"--{name.replace('_', '-')} is about frames and targets, and these measurements are laser spots alone")


def require_lasers_for(data: Measurements, estimate: Sequence[str] | None, **options: Any) -> None:
    """Refuse options about laser spots where none are measured.

    Args:
        data: The measurements.
        estimate: What is to be estimated beside the joints.
        options: What else was given, by the option's name with _ for -; None, or nothing in it, for what was not.

    Raises:
        UsageError: names the first of them.
    """
    of_lasers = [f"--estimate {each}" for each in estimate or () if each in ("screen", "beams", "beams4")]
    given = [*of_lasers, *(f"--{name.replace('_', '-')}" for name, value in options.items() if value)]
    if given and not data.lasers:
        raise UsageError(f"{given[0]} is about laser spots, and these measurements have none")
