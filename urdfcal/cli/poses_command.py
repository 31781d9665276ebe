"""`urdfcal poses`: which poses to measure, and in which order to drive there."""

from __future__ import annotations

import re
from collections.abc import Sequence
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from urdfcal.base.errors import UsageError
from urdfcal.cli.cells import Cells, toured_in
from urdfcal.cli.console import Working, finish, say, warn
from urdfcal.cli.help import EXPERT
from urdfcal.cli.inputs import load
from urdfcal.cli.measured import camera_of, measured, require_boards, rig_file_of, rig_options, stations_of, with_board
from urdfcal.cli.notes import about, listed
from urdfcal.cli.options import (
    RIG,
    BoardLink,
    Json,
    Lasers,
    Overwrite,
    PackageDirs,
    Quiet,
    Reference,
    RigOption,
    RobotFile,
    Screen,
    Seed,
    Verbose,
    XacroArgs,
    XacroLimits,
)
from urdfcal.cli.places import (
    MEASUREMENTS,
    deliver,
    named,
    page_place,
    require_ending,
    require_no_json,
    require_places,
    stated_file,
    stated_place,
    told,
)
from urdfcal.cli.stated import metres_of, positive, stated_area

if TYPE_CHECKING:
    from urdfcal.base.geometry import Matrix
    from urdfcal.calibration.rig_file import RigFile
    from urdfcal.planning.measuring import Asked
    from urdfcal.planning.plan import PosePlan
    from urdfcal.planning.tour import Tour
    from urdfcal.robot.robot import Robot
    from urdfcal.sensors.sensor import Sight

_TEST = 5  # every such pose is to test on
_MOST = 200  # poses that --until tries
_SHORT = "interrupted: these are the best poses so far"
_CUT = "interrupted: legs that were not looked at by then count as legs without a free way"
_CHECK = (6, 10)  # poses that tell a later change
_LENGTH = re.compile(r"(\d+(?:\.\d+)?|\.\d+)\s*(mm|m|um)")
_SIZES = {"m": 1e3, "mm": 1.0, "um": 1e-3}  # [mm]


class CriterionName(StrEnum):
    """The criteria, as `planning.criteria.NAMES` has them."""

    I = "I"  # noqa: E741  # the field's own name
    D = "D"
    A = "A"
    E = "E"
    O1 = "O1"
    O2 = "O2"
    O3 = "O3"
    O4 = "O4"
    O5 = "O5"


class Approach(StrEnum):
    """From where poses are visited."""

    ANY = "any"
    BOTH = "both"


def poses(
    robot: RobotFile,
    output: Annotated[
        Path,
        typer.Option(
            "-o", "--output", metavar="CSV", parser=stated_place, help="Poses as fit reads them; - is stdout.", show_default=False
        ),
    ],
    n: Annotated[int | None, typer.Option("-n", "--poses", min=2, max=_MOST, help="How many. Default: 30.", show_default=False)] = None,
    until: Annotated[
        str | None,
        typer.Option(metavar="0.1mm", help="As few as bring the tool's predicted error (RMS) down to this.", show_default=False),
    ] = None,
    sensor: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KIND:LINK",
            help="What will measure: laser (the robot's), or point, pose, pixels, distance or inclination of a target on LINK, by "
            "LINK@INSTRUMENT where there are several; repeatable. Default: the boards of --board and --rig, else laser.",
            show_default=False,
        ),
    ] = None,
    tool: Annotated[
        str | None, typer.Option(metavar="LINK", help="The link that is to be known. Default: what is measured.", show_default=False)
    ] = None,
    criterion: Annotated[
        CriterionName | None,
        typer.Option(
            help="What is to be best: I the tool over the workspace, D, A, E, O1 to O5 the parameters. Default: I.", show_default=False
        ),
    ] = None,
    region: Annotated[
        Path | None,
        typer.Option(
            metavar="CSV", help="Poses over which the tool is to be known. Default: all that joint limits allow.", show_default=False
        ),
    ] = None,
    check: Annotated[
        bool, typer.Option("--check", help="Choose 6 to 10 poses, by default 8, that best tell whether the robot has changed since.")
    ] = False,
    have: Annotated[
        Path | None, typer.Option(metavar="CSV", help="What was measured already: the plan completes it.", show_default=False)
    ] = None,
    limits: Annotated[
        Path | None, typer.Option(metavar="YAML|CSV", help="Narrower limits of some joints, in deg or rad, mm or m.", show_default=False)
    ] = None,
    approach: Annotated[Approach, typer.Option(help="Visit each pose from any side, or from both, which tells backlash.")] = Approach.ANY,
    scene: Annotated[
        Path | None, typer.Option(metavar="YAML", help="What stands around: boxes, cylinders, planes, meshes.", show_default=False)
    ] = None,
    srdf: Annotated[
        Path | None,
        typer.Option(metavar="SRDF", help="Pairs of links that need no look. Default: the one beside the robot.", show_default=False),
    ] = None,
    clearance_mm: Annotated[float, typer.Option(help="How far all stay apart, in mm.")] = 5.0,
    collisions: Annotated[bool, typer.Option(help="Look for collisions of the robot with itself and the scene.")] = True,
    trajectory: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="YAML|SCRIPT|CSV",
            parser=stated_file,
            help="Also all poses and the ways around to drive: a ROS 2 JointTrajectory (.yaml), URScript (.script) or a table in degrees "
            "(.csv); repeatable.",
            show_default=False,
        ),
    ] = None,
    report: Annotated[
        Path | None,
        typer.Option(metavar="HTML", parser=stated_file, help="Also a page of what the poses are worth, to be read.", show_default=False),
    ] = None,
    speed: Annotated[float, typer.Option(help="Of the joints' full speed, in the trajectory.", rich_help_panel=EXPERT)] = 0.2,
    pause: Annotated[
        float, typer.Option("--pause-s", min=0.0, help="To stand still at each pose, in the trajectory, in s.", rich_help_panel=EXPERT)
    ] = 0.0,
    rig: RigOption = None,
    camera: Annotated[
        Path | None,
        typer.Option(metavar="YAML", help="Lens that pixels will be read with.", show_default=False, rich_help_panel=RIG),
    ] = None,
    board: BoardLink = None,
    acceptance_deg: Annotated[
        float | None,
        typer.Option(
            min=1.0,
            max=180.0,
            help="Angle about the target's +z within which a tracker sees it, such as 30. Default: it is seen from all sides.",
            show_default=False,
            rich_help_panel=RIG,
        ),
    ] = None,
    range_m: Annotated[
        str | None,
        typer.Option(
            metavar="NEAR,FAR",
            help="How near and how far a tracker sees a target, in m, such as 1.5,20. Default: at any distance.",
            show_default=False,
            rich_help_panel=RIG,
        ),
    ] = None,
    screen_size_m: Annotated[
        str | None,
        typer.Option(
            metavar="W[,H]",
            help="Size of the screen along y and z in m. Default: as the URDF draws it, else 3.",
            show_default=False,
            rich_help_panel=RIG,
        ),
    ] = None,
    candidates: Annotated[int, typer.Option(min=10, max=20_000, help="Random poses to choose from.", rich_help_panel=EXPERT)] = 1500,
    reference: Reference = None,
    overwrite: Overwrite = False,
    screen: Screen = None,
    laser: Lasers = None,
    xacro_arg: XacroArgs = None,
    xacro_limit: XacroLimits = None,
    package_dir: PackageDirs = None,
    seed: Seed = 0,
    as_json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Choose poses to measure: those that tell most of the tool, free of collisions and seen, in a short order."""
    from urdfcal.base.interrupts import until_interrupted
    from urdfcal.output.drives import FORMS, drive_of
    from urdfcal.output.replaced import inputs_sha256, require_marked
    from urdfcal.output.text.poses import plan_csv, plan_json, plan_lines

    require_no_json(as_json, output)
    positive("--speed", speed)
    until_mm = _length_mm("--until", until)
    _require_sense(n, until_mm, scene if not collisions else None, srdf if not collisions else None, check, criterion)
    sight = _sight(acceptance_deg, range_m)
    rig_file = with_board(rig_file_of(rig), board)
    arm = load(robot, xacro_arg, package_dir, screen, laser, rig_file, xacro_limit=xacro_limit, quiet=quiet)
    output = named(output, f"{arm.description.stem}_poses.csv")
    require_ending("-o", output, MEASUREMENTS, "a file of poses")
    asked = _asked(arm, sensor, rig_file, reference, camera, screen_size_m)
    seen, drives = _seen(arm, asked, trajectory or []), trajectory or []
    inputs = {
        "robot": robot,
        "measured": have,
        "scene": scene,
        "srdf": srdf,
        "region": region,
        "limits": limits,
        "rig": rig,
        "camera": camera,
    }
    places, read = [output, *drives], tuple(inputs.values())
    require_places(*places, inputs=read)
    made_of = inputs_sha256(read)
    if not overwrite:
        for place in places:
            require_marked(place, (made_of,), "result of urdfcal poses from the same files")
    page = page_place(report, f"{arm.description.stem}_poses.html", read, made_of, overwrite, *places)
    earlier = measured(arm, have, rig_file, reference, camera=camera)[1] if have else None
    cells = Cells(scene, srdf, clearance_mm, seed) if collisions else None
    wanted: dict[str, Any] = {
        "candidates": candidates,
        "n": n if until_mm is None else min(candidates, _MOST),
        "until_mm": until_mm,
        "criterion": (criterion or CriterionName.I).value,
        "check": check,
        "both_sides": approach is Approach.BOTH,
        "tool": tool,
        "workspace": _region(region, seen, quiet),
        "limits": _limits(limits, seen),
        "options": rig_options(rig_file, rig, seen),
        "sigmas": rig_file.noise.by_kind(),
        "have": earlier,
        "seed": seed,
    }
    with Working("choosing poses", quiet), until_interrupted() as short:
        plan = _plan(arm, asked, wanted, cells, sight)
    with Working("looking at the ways between them", quiet), until_interrupted() as cut:
        tour = toured_in(plan, cells)
    say(verbose, about(plan.robot))
    said = [_SHORT] if short() else []
    said += [_CUT] if cut() else []
    said += [*(cells.warnings if cells else ()), *plan.assumed, *_not_driven(tour, drives)]
    if until_mm is not None and plan.tool_sigma_mm[-1] > until_mm:
        said.append(_not_reached(plan, until_mm))
    warn(said, quiet)
    files: dict[str | Path, bytes] = {output: plan_csv(plan, tour, _TEST, made_of, approach is Approach.BOTH)}
    drive = drive_of(plan, tour, both_sides=approach is Approach.BOTH, speed=speed, pause=pause, made_of=made_of)
    files |= {place: FORMS[place.suffix.lower()](drive) for place in drives}
    if page is not None:
        from urdfcal.output.report.poses_page import poses_page

        files[page] = poses_page(plan, tour, _TEST, said, inputs.items(), made_of)
    deliver(files)
    lines = [*plan_lines(plan, tour, earlier is not None), f"wrote {listed(told(files))}"]
    finish(plan_json(plan, tour, told(files)) if as_json else None, "\n".join(lines), quiet)
    if short() or cut():
        raise KeyboardInterrupt


def _length_mm(option: str, text: str | None) -> float | None:
    """A length with its unit, [mm].

    Raises:
        UsageError: the text is none.
    """
    if text is None:
        return None
    match = _LENGTH.fullmatch(text.strip())
    if match is None:
        raise UsageError(f"{option} {text}: expected a length with its unit, such as 0.1mm")
    return positive(option, float(match[1]) * _SIZES[match[2]])


def _asked(arm: Robot, sensor: list[str] | None, rig: RigFile, reference: str | None, camera: Path | None, size: str | None) -> Asked:
    """What will measure, as options and rig.yaml say it: every board by every camera, where no sensor is named."""
    from urdfcal.planning.measuring import Asked

    require_boards(arm, rig)
    stations, boards = stations_of(arm, rig), rig.grids()
    by = ["", *(f"@{name}" for name in stations.cameras)] if camera or not stations.cameras else [f"@{name}" for name in stations.cameras]
    words = sensor or [f"pixels:{link}{name}" for link in boards for name in by] or ["laser"]
    return Asked(tuple(words), reference or rig.reference or "", camera_of(camera), boards, stations, stated_area(size))


def _seen(arm: Robot, asked: Asked, drives: list[Path]) -> Robot:
    """The robot as what is asked for sees it; refuses files that cannot drive it."""
    from urdfcal.output.drives import require_form
    from urdfcal.planning.measuring import seen_with

    seen = seen_with(arm, asked)
    for place in drives:
        require_form(place, seen)
    return seen


def _sight(acceptance_deg: float | None, range_m: str | None) -> Sight:
    """What trackers see, as options say it.

    Raises:
        UsageError: the range is none.
    """
    from urdfcal.base.geometry import DEG
    from urdfcal.sensors.sensor import Sight

    opening = None if acceptance_deg is None else acceptance_deg * DEG
    if range_m is None:
        return Sight(opening=opening)
    nearest, farthest = metres_of("--range-m", range_m, (2,), "the least and the largest distance in m, such as 1.5,20")
    if not 0 <= nearest < farthest:
        raise UsageError(f"--range-m {range_m}: expected the least distance, from 0, and behind it the larger one, such as 1.5,20")
    return Sight(opening=opening, nearest=nearest, farthest=farthest)


def _limits(path: Path | None, seen: Robot) -> Matrix | None:
    from urdfcal.planning.limits import read_limits

    return None if path is None else read_limits(path, seen)


def _region(path: Path | None, seen: Robot, quiet: bool) -> Matrix | None:
    """Positions of the joints over which the tool is to be known, (c, inputs)."""
    if path is None:
        return None
    from urdfcal.base.tables import read_table
    from urdfcal.sensors.column_names import as_people_write
    from urdfcal.sensors.joint_columns import JointColumns, require_joints

    table = as_people_write(read_table(path, "a column a joint", "one row a pose"), seen)
    require_joints(table, seen)
    joints = JointColumns(table, seen)
    positions = joints.positions
    warn([*table.notes, *joints.warnings()], quiet)
    return positions


def _require_sense(
    n: int | None, until: float | None, scene: Path | None, srdf: Path | None, check: bool, criterion: CriterionName | None
) -> None:
    """Refuse options that contradict each other.

    Raises:
        UsageError: names them.
    """
    if n is not None and until is not None:
        raise UsageError("-n and --until both say how many poses; use one of the two")
    if check and (until is not None or criterion is not None):
        raise UsageError(f"--check has a criterion and a number of its own; leave out {'--until' if until is not None else '--criterion'}")
    if check and n is not None and not _CHECK[0] <= n <= _CHECK[1]:
        raise UsageError(f"-n {n}: a check has {_CHECK[0]} to {_CHECK[1]} poses")
    for option, path in (("--scene", scene), ("--srdf", srdf)):
        if path is not None:
            raise UsageError(f"{option} is for collisions, which --no-collisions leaves out; use one of the two")


def _plan(arm: Robot, asked: Asked, wanted: dict[str, Any], cells: Cells | None, sight: Sight) -> PosePlan:
    from urdfcal.planning.plan import plan_poses

    return plan_poses(
        arm,
        sensors=asked.sensors,
        reference=asked.reference,
        camera=asked.camera,
        boards=asked.boards,
        stations=asked.stations,
        screen_size=asked.area.size if asked.area else None,
        sight=sight,
        allowed=cells.free if cells is not None else None,
        hidden=cells.hidden if cells is not None else None,
        **wanted,
    )


def _not_reached(plan: PosePlan, until_mm: float) -> str:
    way = "more --candidates might do" if len(plan) < _MOST else "no more are tried"
    off = f"{plan.tool_sigma_mm[-1]:.3g} mm off, not {until_mm:g} mm"
    return f"--until is not reached: after {len(plan)} poses the tool is predicted to be {off}; {way}"


def _not_driven(tour: Tour, drives: Sequence[Path]) -> list[str]:
    """Legs without a way, and what a drive leaves out for them."""
    legs = [f"{leg + 1} to {leg + 2}" for leg in tour.blocked]
    if not legs:
        return []
    part = tour.drivable
    alone = f"pose {part.start + 1} alone" if len(part) == 1 else f"poses {part.start + 1} to {part.stop} alone"
    return [
        f"no free way was found from pose {', '.join(legs)}: drive there by hand, or by a planner",
        *([f"{listed([str(drive) for drive in drives])}: to {alone}, since no way leads on to the others"] if drives else []),
    ]
