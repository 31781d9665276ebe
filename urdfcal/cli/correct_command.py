"""`urdfcal correct`: false targets for a controller that keeps its nominal geometry."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from urdfcal.base.errors import UsageError
from urdfcal.cli.console import Working, show, warn
from urdfcal.cli.inputs import load, stored_calibration
from urdfcal.cli.notes import listed
from urdfcal.cli.options import Json, Overwrite, PackageDirs, Quiet, RobotFile, XacroArgs, XacroLimits
from urdfcal.cli.places import deliver, named, page_place, require_no_json, require_places, stated_file, stated_place, told

if TYPE_CHECKING:
    from urdfcal.deploy.false_targets import Placements
    from urdfcal.deploy.targets import TargetFile
    from urdfcal.robot.robot import Robot
    from urdfcal.robot.way import Way


def correct(
    robot: RobotFile,
    targets: Annotated[
        Path,
        typer.Argument(
            metavar="TARGETS",
            help="CSV: columns named after the joints; or x, y, z with qx, qy, qz, qw, roll, pitch, yaw, rx, ry, rz or A, B, C. "
            "Or a program: URScript (.script), RAPID (.mod), KRL (.src, .dat), Fanuc TP (.ls).",
            show_default=False,
        ),
    ],
    calibration: Annotated[Path, typer.Option(metavar="CALIBRATION", help="What fit or import wrote.", show_default=False)],
    output: Annotated[
        Path,
        typer.Option(
            "-o",
            "--output",
            metavar="OUT",
            parser=stated_place,
            help="The same file with other numbers; a folder for <targets>_corrected.<ending> in it, - for stdout.",
            show_default=False,
        ),
    ],
    compensation: Annotated[
        Path | None, typer.Option(metavar="YAML", help="How the arm gives way, as fit --compensation wrote it.", show_default=False)
    ] = None,
    tool: Annotated[
        str | None,
        typer.Option(
            metavar="LINK",
            help="The link that targets are of. Default: the one that was measured; of programs its tool0.",
            show_default=False,
        ),
    ] = None,
    base: Annotated[
        str | None,
        typer.Option(
            metavar="LINK",
            help="The link that placements are told in. Default: the root; of programs the link base beside tool0, if there is one.",
            show_default=False,
        ),
    ] = None,
    near: Annotated[
        str | None,
        typer.Option(
            metavar="POSITIONS",
            help="Positions in deg, mm where a joint slides, such as 0,-90,90,0,90,0: the configuration of the first placement.",
            show_default=False,
        ),
    ] = None,
    frame: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=X,Y,Z,...",
            help="A frame that a program names and has no numbers of, in its language's own, mm and deg: a tool or work object of RAPID's, "
            "TOOL_DATA[1] or BASE_DATA[1] of KRL's, UT1 or UF1 of Fanuc's; tcp of URScript, in m and rad; repeatable.",
            show_default=False,
        ),
    ] = None,
    j23: Annotated[
        float | None,
        typer.Option(
            "--j23",
            metavar="FACTOR",
            help="The controller counts axis 3 from the horizontal: the description's joint 3 is its J3 and FACTOR (1 or -1) times its J2, "
            "as Fanuc's and ABB's parallelogram arms have it. Default: 0.",
            show_default=False,
        ),
    ] = None,
    report: Annotated[
        Path | None,
        typer.Option(
            metavar="HTML",
            parser=stated_file,
            help="Also write a page with before and after over the program, as a page.",
            show_default=False,
        ),
    ] = None,
    overwrite: Overwrite = False,
    xacro_arg: XacroArgs = None,
    xacro_limit: XacroLimits = None,
    package_dir: PackageDirs = None,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Correct targets for a controller that keeps its nominal geometry, so that the real tool comes where it was wanted."""
    from urdfcal.calibration.analysis.comparison import Account, default_tool
    from urdfcal.deploy.programs.languages import is_program, read_program
    from urdfcal.deploy.target_csv import near_from, read_targets
    from urdfcal.deploy.targets import corrected, with_coupled_axes
    from urdfcal.output.accounts import account_of
    from urdfcal.output.replaced import inputs_sha256, require_same
    from urdfcal.output.text.targets import target_blocks, targets_json

    require_no_json(as_json, output)
    place = named(output, f"{targets.stem}_corrected{targets.suffix}")
    require_places(place, inputs=(robot, targets, calibration, compensation))
    made_of = inputs_sha256((robot, targets, calibration, compensation))
    page = page_place(report, f"{targets.stem}_corrected.html", (robot, targets, calibration, compensation), made_of, overwrite, place)
    arm = load(robot, xacro_arg, package_dir, xacro_limit=xacro_limit, quiet=quiet)
    stored = stored_calibration(calibration)
    real = account_of(stored, arm)
    measured = stored.measured if stored.measured in arm.tree.links else ""
    nominal = _way(arm, tool, measured or default_tool(Account(str(robot), arm), real), base, is_program(targets))
    if frame and not is_program(targets):
        raise UsageError(f"--frame {frame[0]}: is about robot programs, and {targets} is a table; --base names the base")
    file = read_program(targets, nominal, frame or ()) if is_program(targets) else read_targets(targets, nominal)
    if j23 is not None:
        file = with_coupled_axes(file, len(nominal.names), j23)
    with Working(f"correcting {len(file.targets)} targets", quiet):
        placements = _placements(nominal, real.robot, compensation, package_dir)
        found = corrected(file, nominal, placements, None if near is None else near_from(near, nominal))
    content = file.with_numbers([each.values for each in found])
    if not overwrite:
        require_same({place: content})
    files: dict[str | Path, bytes] = {place: content}
    if page is not None:
        from urdfcal.output.report.targets_page import targets_page

        sources = {"robot": robot, "targets": targets, "calibration": calibration, "compensation": compensation}
        files[page] = targets_page(found, nominal, targets, file.said, sources.items(), made_of)
    deliver(files)
    warn((*file.said, *_bases(nominal, base, file), *_uncoupled(file, j23)), quiet)
    warn([f"{targets}:{each.target.line}: {each.said}" for each in found if each.said], quiet)
    machine = None
    if as_json:
        machine = targets_json(found) | {"file": str(place), "made_of": made_of} | ({"report": str(page)} if page else {})
    show(machine, [*target_blocks(found, nominal), "", f"wrote {listed(told(files))}"])


def _way(robot: Robot, tool: str | None, measured: str, base: str | None, program: bool) -> Way:
    """From the base to the tool: as stated, of a program the controller's own, else from the root to what was measured."""
    from urdfcal.deploy.ends import base_of, flange_of
    from urdfcal.robot.way import Way

    if program:
        tool = tool or flange_of(robot.tree, measured)
        base = base or base_of(robot.tree, flange_of(robot.tree, tool or measured)) or None
    return Way.between(robot, tool or measured, base)


def _bases(way: Way, stated: str | None, file: TargetFile) -> list[str]:
    """That a table's placements may be told in another base than was taken, where the controller has one of its own."""
    from urdfcal.deploy.ends import base_of, flange_of
    from urdfcal.deploy.programs.languages import is_program

    own = base_of(way.robot.tree, flange_of(way.robot.tree, way.tool))
    jointed = all(target.orientation is None for target in file.targets)
    if stated or jointed or is_program(file.path) or own in ("", way.base):
        return []
    return [f"placements are taken to be told in '{way.base}'; if they are the controller's own numbers, --base {own}"]


def _uncoupled(file: TargetFile, j23: float | None) -> list[str]:
    """That a Fanuc's joint positions were taken as the description counts them."""
    jointed = [target.line for target in file.targets if target.orientation is None]
    if j23 is not None or not jointed or file.path.suffix.lower() != ".ls":
        return []
    return [
        f"{file.path}:{jointed[0]}: J3 is taken as the description's third joint; Fanuc's controllers count it from the horizontal: "
        "--j23 1 (or -1) says so, --j23 0 that the description does, too"
    ]


def _placements(nominal: Way, real: Robot, compensation: Path | None, package_dirs: list[Path] | None) -> Placements:
    """Where the real robot has the tool."""
    from urdfcal.deploy.false_targets import sagging
    from urdfcal.robot.way import Way

    way = Way.between(real, nominal.tool, nominal.base)
    if compensation is None:
        return way.placements
    from urdfcal.calibration.analysis.compensation import load_compensation

    found = load_compensation(compensation, package_dirs or ())
    lacking = [name for name in found.joints if name not in way.names]
    if lacking:
        raise UsageError(f"--compensation {compensation}: is of joints that do not move '{nominal.tool}': {', '.join(lacking)}")
    return sagging(found, way)
