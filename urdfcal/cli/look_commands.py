"""`urdfcal evaluate`, `check` and `dh`: what is there, without fitting."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from urdfcal.base.errors import UsageError
from urdfcal.cli.console import Working, say, show, warn
from urdfcal.cli.help import EXPERT
from urdfcal.cli.inputs import load, with_calibration
from urdfcal.cli.measured import joint_noise, measured, require_ends_for, require_lasers_for, rig_file_of, rig_options, sensor_noise
from urdfcal.cli.notes import about
from urdfcal.cli.options import (
    CameraOption,
    DataFile,
    Estimate,
    Fix,
    JointSigma,
    Json,
    Lasers,
    Model,
    Only,
    PackageDirs,
    PriorBeams,
    PriorJoint,
    PriorMount,
    PriorScreen,
    Quiet,
    Reference,
    ReferenceKnown,
    RigOption,
    RobotFile,
    Screen,
    Seed,
    Target,
    TargetKnown,
    Verbose,
    XacroArgs,
    XacroLimits,
    chosen,
)
from urdfcal.cli.priors import priors_of, require_priors_used

if TYPE_CHECKING:
    from rich.console import RenderableType


def evaluate(
    robot: RobotFile,
    measurements: DataFile,
    rig: RigOption = None,
    reference: Reference = None,
    reference_known: ReferenceKnown = False,
    target: Target = None,
    target_known: TargetKnown = False,
    camera: CameraOption = None,
    screen: Screen = None,
    laser: Lasers = None,
    xacro_arg: XacroArgs = None,
    xacro_limit: XacroLimits = None,
    package_dir: PackageDirs = None,
    as_json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Print how far what a URDF predicts, calibrated or not, lies from what was measured."""
    from urdfcal.calibration.start.nominal import beams_that_miss
    from urdfcal.calibration.start.nominal import evaluate as run_evaluate
    from urdfcal.output.text.result import spot_table_block, table_json

    rig_file = rig_file_of(rig, reference_known, target_known)
    arm, data = measured(
        load(robot, xacro_arg, package_dir, screen, laser, rig_file, xacro_limit=xacro_limit, quiet=quiet),
        measurements,
        rig_file,
        reference,
        target,
        camera,
    )
    require_ends_for(data, reference_known=reference_known, target_known=target_known)
    say(verbose, about(arm))
    warn((*data.warnings, *beams_that_miss(arm, data)), quiet)
    fit_set, test_set = data.split()
    tables = {name: run_evaluate(arm, rows, rig_file.options()) for name, rows in (("fit", fit_set), ("test", test_set)) if len(rows)}
    whole = run_evaluate(arm, data, rig_file.options())
    machine: dict[str, Any] = dict.fromkeys(("verdict", "converged", "iterations", "rank"))  # no fit was made
    machine |= {"parameters": [], "combinations": []}
    machine |= {"before": table_json(whole), "after": table_json(whole), "test": None}
    if "test" in tables:
        machine["test"] = {"before": table_json(tables["test"]), "after": table_json(tables["test"])}
    rows = [(name, table, None) for name, table in tables.items()]
    show(machine if as_json else None, [spot_table_block(rows, data.only_spots)])


def check(
    robot: RobotFile,
    measurements: DataFile,
    rig: RigOption = None,
    error_model: Model = None,
    estimate: Estimate = None,
    fix: Fix = None,
    only: Only = None,
    spot_sigma_mm: Annotated[
        float | None,
        typer.Option(metavar="MM", help="Noise of a spot coordinate in mm. Default: 1.", show_default=False, rich_help_panel=EXPERT),
    ] = None,
    joint_sigma_deg: JointSigma = None,
    prior_joint: PriorJoint = None,
    prior_mount: PriorMount = None,
    prior_screen: PriorScreen = None,
    prior_beams: PriorBeams = None,
    reference: Reference = None,
    reference_known: ReferenceKnown = False,
    target: Target = None,
    target_known: TargetKnown = False,
    camera: CameraOption = None,
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
    """Tell what these measurements can and cannot determine, without fitting, and which others would help."""
    import numpy as np

    from urdfcal.calibration.analysis.check import check as run_check
    from urdfcal.model.options import laid_over
    from urdfcal.output.text.check import check_blocks, check_json

    rig_file = rig_file_of(rig, reference_known, target_known)
    arm, data = measured(
        load(robot, xacro_arg, package_dir, screen, laser, rig_file, xacro_limit=xacro_limit, quiet=quiet),
        measurements,
        rig_file,
        reference,
        target,
        camera,
    )
    require_ends_for(data, reference_known=reference_known, target_known=target_known)
    say(verbose, about(arm))
    require_lasers_for(data, chosen(estimate), screen=screen, laser=laser)
    priors = priors_of(prior_joint, prior_mount, prior_screen, prior_beams)
    options = laid_over(rig_options(rig_file, rig, arm), error_model and error_model.value, chosen(estimate), fix or (), only or (), priors)
    with Working(f"checking {len(data)} rows", quiet):
        result = run_check(
            arm,
            data,
            options=options,
            sigmas=sensor_noise(data, rig_file, spot_sigma_mm),
            joint_sigma=joint_noise(arm, rig_file, joint_sigma_deg),
            rng=np.random.default_rng(seed),
        )
    require_priors_used(priors, result.errors)
    warn(result.warnings, quiet)
    show(check_json(result) if as_json else None, check_blocks(result))


def dh(
    robot: RobotFile,
    hayati: Annotated[bool, typer.Option("--hayati", help="Hayati's transform, with beta, where axes are nearly parallel.")] = False,
    calibration: Annotated[
        Path | None, typer.Option(metavar="YAML", help="Also show the table of the corrected robot.", show_default=False)
    ] = None,
    tip: Annotated[
        str | None, typer.Option(metavar="LINK", help="The table of the joints up to this link; no lasers are needed.", show_default=False)
    ] = None,
    reference: Reference = None,
    screen: Screen = None,
    laser: Lasers = None,
    xacro_arg: XacroArgs = None,
    xacro_limit: XacroLimits = None,
    package_dir: PackageDirs = None,
    as_json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Print the D-H table derived from the URDF, and what is carried by screen and mount."""
    from urdfcal.model.dh import table_with_slides
    from urdfcal.model.gauge import build_error_model
    from urdfcal.output.text.dh import carried_lines, dh_block, dh_json
    from urdfcal.robot.rig import SIX, Instruments
    from urdfcal.robot.rig import Target as InstrumentTarget

    if reference is not None and tip is None:
        raise UsageError("--reference names where the chain to --tip LINK begins; without --tip it means nothing")
    arm = load(robot, xacro_arg, package_dir, screen, laser, xacro_limit=xacro_limit, quiet=quiet)
    if tip is not None:
        label = f"{tip}:tip" if tip in arm.tree.joints else tip  # a joint of that name has parameters of its own
        arm = arm.seen_by(Instruments((InstrumentTarget(label, tip, SIX),), reference or "", True), ())
    say(verbose, about(arm))
    rows, corrected = table_with_slides(arm.chain, hayati), None
    if calibration is not None:
        corrected = table_with_slides(with_calibration(arm, calibration, quiet).chain, hayati)
    carried = build_error_model(arm.chain, arm.rig).carried
    machine: dict[str, Any] = {"nominal": dh_json(rows), "corrected": dh_json(corrected) if corrected else None, "carried": dict(carried)}
    heading = "left out of the automatic error model, since no measurement could tell them from others:"
    lines: list[RenderableType] = ["", heading, *(f"  {line}" for line in carried_lines(carried))]
    show(machine if as_json else None, [dh_block(rows, corrected), *(lines if carried else [])])
