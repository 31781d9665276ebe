"""`urdfcal apply`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from urdfcal.commands.console import finish, say, warn
from urdfcal.commands.inputs import expanded_note, load, require_places
from urdfcal.commands.options import Json, PackageDirs, Quiet, RobotFile, Verbose, XacroArgs

if TYPE_CHECKING:
    pass


def apply(
    robot: RobotFile,
    calibration: Annotated[
        Path, typer.Argument(metavar="CALIBRATION", help="Written by fit, or the truth of a simulation.", show_default=False)
    ],
    output: Annotated[Path, typer.Option("-o", "--output", metavar="OUT", help="Calibrated URDF.", show_default=False)],
    force: Annotated[
        bool, typer.Option("--force", help="Put the correction on top of an origin that is neither nominal nor corrected.")
    ] = False,
    xacro_arg: XacroArgs = None,
    package_dir: PackageDirs = None,
    as_json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Put a stored calibration on a robot description (again)."""
    from urdfcal.calibration_file import read_calibration
    from urdfcal.files import write_whole
    from urdfcal.urdf_writer import with_origins

    arm = load(robot, xacro_arg, package_dir, None, None)
    require_places(output, inputs=(robot, calibration))
    origins, missing = read_calibration(calibration).origins_for(arm, force)
    write_whole(output, with_origins(arm.description, origins))
    if missing:
        warn([f"{robot} has no joint {', '.join(missing)} of the measuring rig; the rest was applied"], quiet)
    say(verbose, f"corrected: {', '.join(origins)}")
    finish(
        {"urdf": str(output), "corrected": list(origins), "missing": missing} if as_json else None,
        f"wrote {output} with {len(origins)} corrected origins" + expanded_note(arm),
        quiet,
    )
