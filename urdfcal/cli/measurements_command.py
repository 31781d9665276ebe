"""`urdfcal measurements`: what was understood of a file, before anything is fitted."""

from __future__ import annotations

from urdfcal.cli.console import say, show, warn
from urdfcal.cli.inputs import load
from urdfcal.cli.measured import measured, rig_file_of
from urdfcal.cli.notes import about
from urdfcal.cli.options import (
    CameraOption,
    DataFile,
    Json,
    Lasers,
    PackageDirs,
    Quiet,
    Reference,
    RigOption,
    RobotFile,
    Screen,
    Target,
    Verbose,
    XacroArgs,
)


def measurements(
    robot: RobotFile,
    measurements: DataFile,
    rig: RigOption = None,
    target: Target = None,
    reference: Reference = None,
    camera: CameraOption = None,
    screen: Screen = None,
    laser: Lasers = None,
    xacro_arg: XacroArgs = None,
    package_dir: PackageDirs = None,
    as_json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Say what is understood of a file of measurements: joints, ranges, units, sensors, poses, repeats, and what is missing."""
    from urdfcal.output.text.measurements import overview_blocks, overview_json
    from urdfcal.sensors.measurements_csv import read_named_table
    from urdfcal.sensors.overview import overview

    rig_file = rig_file_of(rig)
    nominal = load(robot, xacro_arg, package_dir, screen, laser, rig_file)
    arm, data = measured(nominal, measurements, rig_file, reference, target, camera)
    say(verbose, about(arm))
    warn(data.warnings, quiet)
    found = overview(read_named_table(measurements, nominal, target or rig_file.target), arm, data)
    show(overview_json(found) if as_json else None, overview_blocks(found))
