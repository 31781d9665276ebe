"""From options to robots, noise, priors and places to write; every refusal here comes before any work is done."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from urdfcal.base.errors import UsageError
from urdfcal.cli.console import asked_quiet, warn

if TYPE_CHECKING:
    from collections.abc import Mapping

    from urdfcal.calibration.rig_file import RigFile
    from urdfcal.fleet.prior_file import FleetsWord
    from urdfcal.model.earlier import EarlierJoints
    from urdfcal.model.error_model import ErrorModel
    from urdfcal.model.options import ModelOptions
    from urdfcal.model.parameters import Kind, PriorScale
    from urdfcal.output.formats import Deployment
    from urdfcal.output.stored import StoredCalibration
    from urdfcal.robot.rig import Grid
    from urdfcal.robot.robot import Robot
    from urdfcal.robot.sheet import ScreenArea
    from urdfcal.robot.xacro_child import XacroLimit
    from urdfcal.sensors.columns import Stations
    from urdfcal.sensors.measurements import Measurements


_LEAST, _MOST = 1e-15, 1e6  # what a tolerance, a noise in mm or a size in m can be
_FAR = 100.0  # [m] a place or a size in a cell that is as large was meant in mm
MOST_DEGREES = 90.0
_XACRO_LIMIT = re.compile(r"(\d+(?:\.\d+)?)s(?:,(\d+(?:\.\d+)?)GB)?")
_LEAST_GB = 0.1  # Python and xacro themselves


def load(
    path: Path,
    xacro_args: list[str] | None,
    package_dirs: list[Path] | None,
    screen: str | None = None,
    lasers: list[str] | None = None,
    rig: RigFile | None = None,
    *,
    xacro_limit: str | None = None,
    quiet: bool = True,
) -> Robot:
    """The robot that a command line names; what is left out of it is said unless it is to be quiet.

    Raises:
        UsageError: a --xacro-arg is no NAME:=VALUE, or --xacro-limit is no limit.
        RobotError: the file is not a robot that can be loaded.
    """
    from urdfcal.robot.robot import load_robot

    arguments = {}
    for argument in xacro_args or ():
        name, mark, value = argument.partition(":=")
        if not mark or not name:
            raise UsageError(f"--xacro-arg {argument}: expected NAME:=VALUE")
        arguments[name] = value
    warn_if_mixed(path)
    robot = load_robot(
        path,
        xacro_args=arguments,
        package_dirs=package_dirs or (),
        screen=screen or (rig.screen if rig else None),
        lasers=lasers or (rig.lasers if rig else None),
        xacro_limit=_xacro_limit(xacro_limit),
    )
    warn([f"{robot.tree.label}: {line}" for line in robot.tree.warnings], quiet)
    return robot


def _xacro_limit(text: str | None) -> XacroLimit:
    """What --xacro-limit allows."""
    from urdfcal.robot.xacro_child import XacroLimit

    if text is None:
        return XacroLimit()
    match = _XACRO_LIMIT.fullmatch("".join(text.split()))
    limit = XacroLimit(float(match[1]), float(match[2] or XacroLimit.gigabytes)) if match else XacroLimit(0, 0)
    if not 0 < limit.seconds <= _MOST or not _LEAST_GB <= limit.gigabytes <= _MOST:
        raise UsageError(f"--xacro-limit {text}: expected a time and a memory of at least {_LEAST_GB:g}GB, such as 60s,4GB")
    return limit


def warn_if_mixed(path: Path) -> None:
    """Name a URDF, or a calibration, that does not belong to what stands beside it."""
    from urdfcal.output.pairs import mixed

    warn(mixed(path), asked_quiet())


def stored_calibration(path: Path) -> StoredCalibration:
    """A calibration read from its file; where the files beside it are not those that it was written with, that is said.

    Raises:
        CalibrationFileError: the file is not one.
        UsageError: it is a robot description.
    """
    from urdfcal.output.stored import read_calibration

    if path.suffix.lower() in (".urdf", ".xacro"):
        raise UsageError(f"{path}: is a robot description; urdfcal import ROBOT {path} -o CALIBRATION.yaml makes a calibration of it")
    stored = read_calibration(path)
    warn_if_mixed(path)
    return stored


def with_calibration(robot: Robot, path: Path, quiet: bool) -> Robot:
    """The robot with a stored calibration put on it; what it lacks of the rig is said unless it is to be quiet.

    Raises:
        CalibrationFileError: the file is none, or not of this robot as it is.
    """
    from urdfcal.output.stored import corrected_robot

    origins, missing = stored_calibration(path).origins_for(robot)
    warn(lacking(robot, missing), quiet)
    return corrected_robot(robot, origins)


def lacking(robot: Robot, missing: Sequence[str]) -> list[str]:
    """A warning of calibrated joints that a robot does not have; only those of the rig may be missing."""
    return [f"{robot.description.path} has no joint {', '.join(missing)} of the measuring rig; the rest was applied"] if missing else []


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


def stated_area(text: str | None) -> ScreenArea | None:
    """A screen's size, `1.5` or `2,1.5` in m; None where none is stated.

    Raises:
        UsageError: the text is none.
    """
    from urdfcal.robot.sheet import ScreenArea

    return None if text is None else ScreenArea(stated_size(text, "the screen's width and height"))


def stated_size(text: str, expected: str) -> tuple[float, float]:
    """Width and height of --screen-size-m, [m]; a single number is both.

    Raises:
        UsageError: the text is none.
    """
    sides = metres_of("--screen-size-m", text, (1, 2), f"{expected} in m, such as 1.5 or 2,1.5")
    for side in sides:
        positive("--screen-size-m", side)
    return sides[0], sides[-1]


def numbers_of(option: str, text: str, counts: tuple[int, ...], expected: str) -> tuple[float, ...]:
    """Numbers with commas between them.

    Raises:
        UsageError: they are none, or not so many.
    """
    from urdfcal.robot.urdf_xml import number_fault

    words = [word.strip() for word in text.split(",")]
    faults = [fault for word in words if (fault := number_fault(word))]
    if faults or len(words) not in counts:
        found = faults[0] if faults else f"found {len(words)} {'number' if len(words) == 1 else 'numbers'}"
        raise UsageError(f"{option} {text}: {found}; expected {expected}")
    return tuple(map(float, words))


def metres_of(option: str, text: str, counts: tuple[int, ...], expected: str) -> tuple[float, ...]:
    """Lengths in m with commas between them, none as long as only millimetres are.

    Raises:
        UsageError: they are none, not so many, or too far.
    """
    lengths = numbers_of(option, text, counts, expected)
    if max(map(abs, lengths)) > _FAR:
        far, metres = max(lengths, key=abs), ",".join(f"{length / 1e3:g}" for length in lengths)
        raise UsageError(f"{option} {text}: {far:g} m is too far for a cell; expected {expected}, and {metres} if these are mm")
    return lengths


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


def parsed_grid(option: str, text: str) -> Grid:
    """The inner corners of a board: `9x6:25mm` of a chessboard, or `10x7:25mm:18mm:DICT` of a ChArUco board; the middles of circles.

    Raises:
        UsageError: the text is no such board.
    """
    from urdfcal.robot.rig import Grid
    from urdfcal.vision.camera.boards import parse_charuco, parse_chessboard
    from urdfcal.vision.camera.circles import parse_circles

    kind, _, rest = text.strip().partition(":")
    if kind == "circles":
        return parse_circles(rest, f"{option} circles:").grid
    if kind == "charuco":
        text = rest
    if text.count(":") > 1:
        squares = parse_charuco(text, option)
        return Grid(squares.columns - 1, squares.rows - 1, squares.square)
    corners = parse_chessboard(text, option)
    return Grid(corners.columns, corners.rows, corners.square)


def earlier_joints(path: Path | None, robot: Robot) -> EarlierJoints | None:
    """What an earlier calibration decided of the joints, whose URDF the robot is.

    Raises:
        CalibrationFileError: the file is no calibration, or does not say.
        RobotError: the robot is not the one that it wrote.
    """
    if path is None:
        return None
    from urdfcal.calibration.known_joints import require_written

    earlier = stored_calibration(path).joints
    require_written(earlier, robot, str(path))
    return earlier


def forgotten_branch(path: Path, robot: Robot) -> tuple[str, ...]:
    """A warning where the calibration beside a URDF decided joints of this way and of another branch, which a fit would spoil."""
    from urdfcal.base.errors import CalibrationFileError, RobotError
    from urdfcal.base.opened import unnoted
    from urdfcal.calibration.known_joints import require_written
    from urdfcal.output.pairs import record_beside
    from urdfcal.output.stored import read_calibration

    beside = record_beside(path)
    if not beside.is_file():
        return ()
    try:
        with unnoted():
            earlier = read_calibration(beside).joints
        require_written(earlier, robot, str(beside))
    except (CalibrationFileError, RobotError):  # of another robot, or of another time: this one owes it nothing
        return ()
    on_way = {step.joint.name for step in robot.chain.moving}
    shared, others = (list(dict.fromkeys(joint for joint in earlier.joints if (joint in on_way) == on)) for on in (True, False))
    if not shared or not others:
        return ()
    return (
        f"{path} was written with {beside}, which calibrated {', '.join(shared)} together with {', '.join(others)}: "
        f"what changes there now makes those worse; --after {beside} keeps what it decided",
    )


def require_ends_for(data: Measurements, **ends: bool) -> None:
    """Refuse options about measuring frames and targets where none is.

    Raises:
        UsageError: naming the option.
    """
    for name, known in ends.items():
        if known and data.only_spots:
            raise UsageError(f"--{name.replace('_', '-')} is about frames and targets, and these measurements are laser spots alone")


def rig_options(rig: RigFile, path: Path | None, robot: Robot) -> ModelOptions:
    """What a rig.yaml wants calibrated.

    Raises:
        RigError: it was made for a robot with other beams.
    """
    if path is not None:
        rig.require_beams(robot, path)
    return rig.options()


def by_the_data(prior: str) -> bool:
    """What `--prior` asks for.

    Raises:
        UsageError: it asks for neither.
    """
    if prior not in ("stated", "auto"):
        raise UsageError(f"--prior {prior}: expected stated or auto")
    return prior == "auto"


def priors_of(joint: str | None, mount: str | None, screen: str | None, beams: str | None) -> dict[Kind, PriorScale]:
    """The priors that were stated, by group."""
    from urdfcal.model.options import parse_prior

    stated: dict[Kind, str | None] = {"joint": joint, "mount": mount, "screen": screen, "beam": beams}
    return {kind: parse_prior(text) for kind, text in stated.items() if text is not None}


def fleets_prior(path: Path, joint: str | None) -> FleetsWord:
    """What a fleet says of its next robot.

    Raises:
        InputError: the file is none.
        UsageError: another one is stated, too.
    """
    from urdfcal.fleet.prior_file import read_prior

    if joint is not None:
        raise UsageError("--prior-from and --prior-joint both state the joints' prior; use one of the two")
    return read_prior(path)


def with_shared(options: ModelOptions, shared: Mapping[str, float], robot: Robot, path: Path, quiet: bool) -> ModelOptions:
    """Options that begin at what all robots of a fleet share, but for what they say of a parameter themselves.

    A parameter that this fit does not estimate is told of in a warning.
    """
    from dataclasses import replace

    from urdfcal.model.gauge import build_error_model
    from urdfcal.model.options import ParameterPrior

    if not shared:
        return options
    names = build_error_model(robot.chain, robot.rig, replace(options, fix=(), only=(), single={})).names
    unknown = [name for name in shared if name not in names]
    warn([f"{path}: {name} is shared by that fleet, and no parameter of this fit: left out" for name in unknown], quiet)
    return replace(options, single={name: ParameterPrior(mean=shared[name]) for name in shared if name in names} | dict(options.single))


def joint_noise(robot: Robot, rig: RigFile, stated_deg: float | None) -> Any:
    """Standard deviation of every joint reading, [rad]."""
    import numpy as np

    from urdfcal.base.errors import RigError, no_such

    if stated_deg is not None and not 0 <= stated_deg <= MOST_DEGREES:
        raise UsageError(f"--joint-sigma-deg {stated_deg:g}: expected a number from 0 to {MOST_DEGREES:g}")
    common = stated_deg if stated_deg is not None else rig.noise.joint_deg or 0.0
    names = robot.chain.input_names
    for name in rig.noise.joints_deg:
        if name not in names:
            raise RigError(f"noise.joints_deg: {no_such('joint', name, names)}")
    own = rig.noise.joints_deg if stated_deg is None else {}
    degrees = [0.0 if joint.prismatic else own.get(joint.name, common) for joint in robot.chain.inputs]
    return np.radians(degrees)


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


def require_priors_used(priors: Mapping[Kind, Any], errors: ErrorModel) -> None:
    """Refuse priors of parameters that are not estimated.

    Raises:
        UsageError: names the first of them.
    """
    estimated = {parameter.kind for parameter in errors.parameters}
    options = {"joint": "--prior-joint", "mount": "--prior-mount", "screen": "--prior-screen", "beam": "--prior-beams"}
    for kind in priors:
        if kind not in estimated:
            raise UsageError(f"{options[kind]} is about parameters that are not estimated; --estimate adds screen, beams or beams4")


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


def positive(option: str, value: float | None) -> float | None:
    """A positive number, or None where none was stated.

    Raises:
        UsageError: it is out of all bounds.
    """
    if value is not None and not _LEAST <= value <= _MOST:
        raise UsageError(f"{option} {value:g}: expected a number between {_LEAST:g} and {_MOST:g}")
    return value


def listed(paths: Iterable[str | Path]) -> str:
    """`a, b and c`."""
    *first, last = map(str, paths)
    return f"{', '.join(first)} and {last}" if first else last


def about(robot: Robot) -> str:
    """A robot in one line."""
    from urdfcal.output.text.instruments import rig_in_words

    return f"{robot.name}: moving joints {', '.join(step.joint.name for step in robot.chain.moving)}; {rig_in_words(robot)}"


def expanded_note(robot: Robot) -> str:
    """A word where the URDF that is written is not the text that was read."""
    return f" (the URDF is the expanded {robot.description.path.name})" if robot.description.expanded else ""


def beside_note(plan: Deployment) -> str:
    """What became of a xacro's sources beside their patch."""
    its = plan.sources
    copies = [f"; {its.folder} has changed copies"] if its.folder is not None else []
    return "".join([*copies, *(["; changed the sources in place, each kept as .orig"] if its.in_place else [])])


def papers_arm(name: str) -> Path:
    """One of the paper's arms, which come along: arm7 of Table I, arm4 of Table IV."""
    from urdfcal.robot.packages import own_package

    return own_package() / "robots" / name / f"{name}.urdf.xacro"
