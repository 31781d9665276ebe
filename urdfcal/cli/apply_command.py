"""`urdfcal apply`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from urdfcal.base.errors import CalibrationFileError, UsageError
from urdfcal.cli.console import finish, say, warn
from urdfcal.cli.inputs import lacking, load, stored_calibration
from urdfcal.cli.notes import about, beside_note, expanded_note, listed
from urdfcal.cli.onto_other import put_onto
from urdfcal.cli.options import (
    AddFrames,
    Formats,
    FrameNames,
    InPlace,
    Json,
    Lasers,
    Overwrite,
    PackageDirs,
    Quiet,
    RobotFile,
    Screen,
    Seed,
    Split,
    UrHash,
    Verbose,
    WriteFrames,
    XacroArgs,
    XacroFolder,
    XacroLimits,
    chosen,
)
from urdfcal.cli.places import deliver, require_no_json, require_places, stated_place, told


def apply(
    robot: RobotFile,
    calibration: Annotated[
        Path, typer.Argument(metavar="CALIBRATION", help="Written by fit, or the truth of a simulation.", show_default=False)
    ],
    output: Annotated[
        Path,
        typer.Option(
            "-o",
            "--output",
            metavar="OUT",
            parser=stated_place,
            help="Main output, by default the calibrated URDF; a folder for <stem>_calibrated.urdf in it, - for stdout.",
            show_default=False,
        ),
    ],
    output_format: Formats = None,
    onto: Annotated[
        Path | None,
        typer.Option(
            metavar="MODEL",
            help="Another model of the same robot, MJCF or SDF: it is written with the calibration in it, in place of a URDF. Joints are "
            "matched by name.",
            show_default=False,
        ),
    ] = None,
    ur_hash_from: UrHash = None,
    write_frames: WriteFrames = False,
    add_frames: AddFrames = False,
    frame: FrameNames = None,
    split: Split = False,
    in_place: InPlace = False,
    xacro_folder: XacroFolder = None,
    force: Annotated[
        bool, typer.Option("--force", help="Put the correction on top of an origin that is neither nominal nor corrected.")
    ] = False,
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
    """Put a stored calibration on a robot description (again)."""
    import numpy as np

    from urdfcal.base.terminal import many
    from urdfcal.cli.fit_outputs import planned_formats, with_sources
    from urdfcal.output.formats import Deployed
    from urdfcal.output.replaced import require_same
    from urdfcal.output.text.frames import added, undetermined, written
    from urdfcal.robot.placed_frames import frames_wish

    require_no_json(as_json, output)
    wish = frames_wish(write_frames, add_frames, frame or ())
    arm = load(robot, xacro_arg, package_dir, screen, laser, xacro_limit=xacro_limit, quiet=quiet)
    if screen or laser:  # links that are not there are refused; without the options the rig may have been taken off
        say(verbose, about(arm))
    if onto is not None:
        if output_format or ur_hash_from:
            raise UsageError(f"--onto {onto}: writes that model alone; leave --format and --ur-hash-from out")
        if wish:
            raise UsageError(f"--onto {onto}: frames go into descriptions in URDF; leave --write-frames and --add-frames out")
        put_onto(
            onto,
            arm,
            output,
            (robot, calibration),
            lambda: stored_calibration(calibration).origins_for(arm, force),
            force=force,
            overwrite=overwrite,
            seed=seed,
            as_json=as_json,
            quiet=quiet,
            verbose=verbose,
        )
        return
    plan = planned_formats(chosen(output_format), output, arm.description.stem, ur_hash_from)
    plan = with_sources(plan, split=split, folder=xacro_folder, in_place=in_place, overwrite=overwrite)
    require_places(*plan.places.values(), inputs=(robot, calibration, ur_hash_from))
    plan.require_holding(wish)
    stored = stored_calibration(calibration)
    plan.require_fit_for(arm, stored.corrections)
    if wish and not stored.frames:
        raise CalibrationFileError("holds no frames; expected what urdfcal fit writes of targets and instruments: fit again", stored.path)
    frames = wish.chosen(stored.frames, arm.tree)
    origins, missing = stored.origins_for(arm, force, frames)
    links = {own.joint: origins.pop(own.joint) for own in frames.written if own.joint in origins}
    deployed = Deployed(arm, origins, np.random.default_rng(seed), links, frames.added)
    files = deployed.files(plan)
    if not overwrite:
        require_same(files)
    warn([*deployed.warnings(plan), *plan.without_frames(wish), *undetermined((*frames.written, *frames.added))], quiet)
    files |= (beside := deployed.beside(plan))
    deliver(files, beside)
    warn(lacking(arm, missing), quiet)
    say(verbose, f"corrected: {', '.join(origins)}")
    told_of = [*map(written, frames.written), *map(added, frames.added)]
    outputs = told(place for place in files if place not in beside)
    places = {name: str(place) for name, place in plan.places.items()}
    machine: dict[str, Any] = {"urdf": places.get("urdf"), "files": places, "corrected": list(origins), "missing": missing}
    if wish:
        machine["frames_in_urdf"] = frames.entry()
    finish(
        machine if as_json else None,
        "\n".join([*told_of, f"wrote {listed(outputs)} with {many(len(origins), 'corrected origin')}{beside_note(plan)}"])
        + (expanded_note(arm) if "urdf" in plan.places else ""),
        quiet,
    )
