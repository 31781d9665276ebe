"""`urdfcal fit`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from urdfcal.base.errors import FitRejected, UsageError
from urdfcal.cli.console import Working, say, show, warn
from urdfcal.cli.help import EXPERT
from urdfcal.cli.inputs import earlier_joints, forgotten_branch, load
from urdfcal.cli.measured import joint_noise, measured, require_ends_for, require_lasers_for, rig_file_of, rig_options, sensor_noise
from urdfcal.cli.notes import about, beside_note, expanded_note, listed
from urdfcal.cli.options import (
    OUTPUT,
    AddFrames,
    After,
    Beside,
    CameraOption,
    DataFile,
    Estimate,
    EstimatorName,
    Fix,
    Formats,
    FrameNames,
    InPlace,
    JointSigma,
    Json,
    Lasers,
    Model,
    Only,
    Overwrite,
    PackageDirs,
    Payloads,
    PriorBeams,
    PriorJoint,
    PriorMount,
    PriorScales,
    PriorScreen,
    Quiet,
    Reference,
    ReferenceKnown,
    RigOption,
    RobotFile,
    Schedule,
    Screen,
    Seed,
    Split,
    Target,
    TargetKnown,
    UrHash,
    Verbose,
    WriteFrames,
    XacroArgs,
    XacroFolder,
    XacroLimits,
    chosen,
)
from urdfcal.cli.places import deliver, require_no_json, require_places, stated_file, stated_place, told
from urdfcal.cli.priors import by_the_data, fleets_prior, priors_of, require_priors_used, with_shared
from urdfcal.cli.stated import positive

if TYPE_CHECKING:
    import numpy as np

    from urdfcal.api import Calibration


def refused(calibration: Calibration, beside: tuple[str, ...], as_json: bool) -> None:
    """Stop where a calibration must not be used; what is for machines goes out all the same.

    Raises:
        FitRejected: says why.
    """
    from urdfcal.output.text.result import calibration_json

    verdict = calibration.verdict
    if verdict.use == "no" and as_json:
        show(calibration_json(calibration) | {"files": {}}, [])
    verdict.require_usable(beside)


def fit(
    robot: RobotFile,
    measurements: DataFile,
    output: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--output",
            metavar="OUT",
            parser=stated_place,
            help="Main output; a folder for the default name in it, - for stdout alone. Default: <stem>_calibrated.urdf here.",
            show_default=False,
        ),
    ] = None,
    output_format: Formats = None,
    ur_hash_from: UrHash = None,
    split: Split = False,
    in_place: InPlace = False,
    xacro_folder: XacroFolder = None,
    rig: RigOption = None,
    error_model: Model = None,
    estimate: Estimate = None,
    fix: Fix = None,
    only: Only = None,
    estimator: Annotated[
        EstimatorName, typer.Option(help="lse is Levenberg-Marquardt, robust has Student's t.", rich_help_panel=EXPERT)
    ] = EstimatorName.EKF,
    schedule: Annotated[
        Schedule, typer.Option(help="Of the EKF: maximum a posteriori, or sweeps with Q and R as in the paper.", rich_help_panel=EXPERT)
    ] = Schedule.ITERATED,
    spot_sigma_mm: Annotated[
        float | None,
        typer.Option(
            metavar="MM",
            help="Noise of a spot coordinate in mm. Default: estimated from the residual.",
            show_default=False,
            rich_help_panel=EXPERT,
        ),
    ] = None,
    joint_sigma_deg: JointSigma = None,
    prior: Annotated[
        PriorScales,
        typer.Option(
            help="auto: the data choose the joints' prior scales, if none is stated and there are 20 poses; stated: as below.",
            rich_help_panel=EXPERT,
        ),
    ] = PriorScales.AUTO,
    prior_joint: PriorJoint = None,
    prior_from: Annotated[
        Path | None,
        typer.Option(
            metavar="YAML", help="The joints' prior of a fleet: prior.yaml of urdfcal fleet.", show_default=False, rich_help_panel=EXPERT
        ),
    ] = None,
    prior_mount: PriorMount = None,
    prior_screen: PriorScreen = None,
    prior_beams: PriorBeams = None,
    tolerance: Annotated[
        float | None,
        typer.Option(
            help="Stop under this step: in sigmas (iterated) or m and rad (paper). Default: 1e-7.",
            show_default=False,
            rich_help_panel=EXPERT,
        ),
    ] = None,
    max_sweeps: Annotated[
        int | None,
        typer.Option(min=1, help="Sweeps allowed. Default: 100 (iterated), 5000 (paper).", show_default=False, rich_help_panel=EXPERT),
    ] = None,
    q: Annotated[
        float, typer.Option("--process-noise", help="Q = q I of the paper schedule, m^2 and rad^2.", rich_help_panel=EXPERT)
    ] = 1e-4,
    r: Annotated[float, typer.Option("--measurement-noise", help="R = r I of the paper schedule, m^2.", rich_help_panel=EXPERT)] = 1e-4,
    gate: Annotated[bool, typer.Option(help="Take out spots that the fit cannot explain, and name them.", rich_help_panel=EXPERT)] = True,
    ask: Annotated[
        bool,
        typer.Option(
            help="Ask the residuals what the model lacks, and fit what the rig does (drift, a bowed screen ...).", rich_help_panel=EXPERT
        ),
    ] = True,
    sanity: Annotated[
        bool, typer.Option(help="Refuse measurements that a common mistake explains far better, and name it.", rich_help_panel=EXPERT)
    ] = True,
    test: Annotated[Path | None, typer.Option(metavar="CSV", help="Further poses, evaluated and not fitted.", show_default=False)] = None,
    holdout: Annotated[
        float | None,
        typer.Option(metavar="SHARE", help="Share of the poses, drawn at random, to test and not to fit, e.g. 0.3.", show_default=False),
    ] = None,
    kfold: Annotated[
        int | None,
        typer.Option(
            min=2,
            metavar="N",
            help="Also fit N times with an Nth of the poses held out in turn.",
            show_default=False,
            rich_help_panel=EXPERT,
        ),
    ] = None,
    tool: Annotated[
        str | None,
        typer.Option(
            metavar="LINK", help="Judge by this link, and predict its error in the base frame and up to a constant.", show_default=False
        ),
    ] = None,
    report: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="FILE",
            parser=stated_file,
            help="Also write a report: .html (one page), .md or .json; repeatable.",
            show_default=False,
            rich_help_panel=OUTPUT,
        ),
    ] = None,
    write_frames: WriteFrames = False,
    add_frames: AddFrames = False,
    frame: FrameNames = None,
    sag: Annotated[
        bool,
        typer.Option(
            help="Also fit the joints' sag under gravity, and say what it gains; the URDF stays without it.", rich_help_panel=EXPERT
        ),
    ] = True,
    gravity: Annotated[
        str | None,
        typer.Option(
            metavar="X,Y,Z",
            help="Direction of gravity's pull in the root link, or estimate. Default: 0,0,-1.",
            show_default=False,
            rich_help_panel=EXPERT,
        ),
    ] = None,
    payload: Payloads = None,
    also: Annotated[
        list[Beside] | None,
        typer.Option(
            help="With sag, try scales of encoders and slides, or the others; repeatable. Default: what stands out.",
            show_default=False,
            rich_help_panel=EXPERT,
        ),
    ] = None,
    compensation: Annotated[
        Path | None,
        typer.Option(
            metavar="YAML",
            help="Write the sag for control code, and beside it the URDF of the joint fit, as a pair.",
            show_default=False,
            rich_help_panel=EXPERT,
        ),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Write also what must not be trusted (exit code 3).")] = False,
    overwrite: Overwrite = False,
    reference: Reference = None,
    reference_known: ReferenceKnown = False,
    target_known: TargetKnown = False,
    after: After = None,
    target: Target = None,
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
    """Calibrate: write a corrected URDF, next to it <stem>_calibration.yaml and, of pixels, <stem>_camera.yaml; print the errors."""
    from dataclasses import replace

    import numpy as np

    from urdfcal.api import fit as run_fit
    from urdfcal.calibration.analysis.prediction import base_link, predicted_spots
    from urdfcal.calibration.analysis.validation import coverage_warnings
    from urdfcal.calibration.analysis.validation import holdout as hold_out
    from urdfcal.calibration.analysis.validation import kfold as cross_validate
    from urdfcal.cli.fit_outputs import looked_at, planned, require_frames, sag_wish, with_sources
    from urdfcal.model.options import laid_over
    from urdfcal.output.text.frames import frame_lines
    from urdfcal.output.text.result import Extras, calibration_blocks, calibration_json
    from urdfcal.output.text.sag import asked_for, in_compensation, pair_words, sag_blocks, sag_json
    from urdfcal.robot.placed_frames import frames_wish

    def rng() -> np.random.Generator:
        return np.random.default_rng(seed)

    require_no_json(as_json, output)
    frames = frames_wish(write_frames, add_frames, frame or ())
    rig_file = rig_file_of(rig, reference_known, target_known)
    unmeasured = load(robot, xacro_arg, package_dir, screen, laser, rig_file, xacro_limit=xacro_limit, quiet=quiet)
    outputs = planned(chosen(output_format), output, unmeasured.description.stem, ur_hash_from, report or (), compensation)
    wanted = with_sources(outputs.plan, split=split, folder=xacro_folder, in_place=in_place, overwrite=overwrite)
    outputs = replace(outputs, plan=wanted)
    inputs = (robot, measurements, rig, test, ur_hash_from, camera, after, prior_from, *rig_file.cameras())
    require_places(*outputs.places.values(), inputs=inputs)
    if compensation is not None and not sag:
        raise UsageError("--compensation writes the sag that --no-sag leaves out; use one of the two")
    wish = sag_wish(sag, gravity, payload, chosen(also))
    wish.require_links(unmeasured)
    arm, data = measured(unmeasured, measurements, rig_file, reference, target, camera)
    refine = "lens" in (*chosen(estimate), *rig_file.estimate)
    outputs = replace(outputs, camera=data.corrects_camera, lenses=tuple(data.seeing) if refine else ())
    require_places(*outputs.places.values(), inputs=inputs)
    if not overwrite:
        outputs.require_free(arm, data)
    outputs.plan.require_holding(frames)
    outputs.plan.require_fit_for(arm, [step.joint.name for step in arm.chain.moving])
    further = measured(unmeasured, test, rig_file, reference, target, camera)[1] if test else None
    if holdout is not None:
        data = hold_out(data, holdout, rng())
    outputs.require_sag(data)
    require_lasers_for(data, chosen(estimate), screen=screen, laser=laser)
    require_ends_for(data, reference_known=reference_known, target_known=target_known)
    priors = priors_of(prior_joint, prior_mount, prior_screen, prior_beams)
    fleets = fleets_prior(prior_from, prior_joint) if prior_from is not None else None
    priors |= {"joint": fleets.scale} if fleets is not None else {}
    options = laid_over(rig_options(rig_file, rig, arm), error_model and error_model.value, chosen(estimate), fix or (), only or (), priors)
    if prior_from is not None and fleets is not None:
        options = with_shared(options, fleets.mean, arm, prior_from, quiet)
    how: dict[str, Any] = {
        "estimator": estimator.value,
        "schedule": schedule.value,
        "options": options,
        "sigmas": sensor_noise(data, rig_file, spot_sigma_mm),
        "joint_sigma": joint_noise(arm, rig_file, joint_sigma_deg),
        "tolerance": positive("--tolerance", tolerance),
        "max_sweeps": max_sweeps,
        "q": q,
        "r": r,
        "gated": gate,
        "evidence": by_the_data(prior.value),
        "sane": sanity,
        "asking": ask,
        "after": earlier_joints(after, unmeasured),
        "gravity": wish.stated,
    }
    require_frames(frames, arm, data, options)
    if tool is not None:
        base_link(arm, tool)  # refuse a link that does not move before any work is done
    outputs = replace(outputs, tree=looked_at(arm, options, data, outputs.plan, quiet))
    say(verbose, f"{about(arm)}; {data.counted}")
    with Working(f"fitting {np.count_nonzero(data.sets == 'fit')} rows ({estimator.value})", quiet):
        calibration = run_fit(arm, data, test=further, rng=rng(), **how)
    require_priors_used(priors, calibration.errors)
    warned = (
        *calibration.warnings,
        *(forgotten_branch(robot, arm) if after is None else ()),
        *wish.cautions(calibration),
        *(further.warnings if further else ()),
        *coverage_warnings(arm, calibration),
    )
    calibration = replace(calibration, warnings=warned, tool=tool or "")
    with Working("trying what the joint fit lacks (sag)", quiet):
        bent = wish.of(calibration)
    calibration = replace(calibration, beyond=tuple(dict.fromkeys((*calibration.beyond, *asked_for(bent)))))
    calibration = calibration.with_entered(in_compensation(bent))
    warn((*calibration.warnings, *(bent.warnings if bent else ())), quiet)
    with Working("judging whether it can be used", quiet):
        _ = calibration.verdict
    if not force:
        refused(calibration, pair_words(bent), as_json)  # no folds for what is of no use anyway
    if kfold is not None:
        with Working(f"fitting {kfold} times with some poses held out", quiet):
            calibration = replace(calibration, folds=cross_validate(arm, data, kfold, rng(), **how))
    verdict = calibration.verdict
    if force:
        warn([f"--force: {reason}" for reason in verdict.reasons if verdict.use == "no"], quiet)
    else:
        refused(calibration, pair_words(bent), as_json)
    with Working("predicting errors and writing results", quiet):
        extra = Extras(calibration.folds, predicted_spots(arm, calibration, rng()))
        files, cautions = outputs.contents(calibration, bent, extra, rng(), frames)
    warn(cautions, quiet)
    deliver(files, [place for place in files if place not in outputs.places.values()])
    if as_json:
        bending_told = sag_json(bent, outputs.compensation in files) if bent else None
        placed = frames.chosen(calibration.frames, arm.tree).entry()
        written = {"files": {name: str(place) for name, place in outputs.places.items()}, "sag": bending_told, "frames_in_urdf": placed}
        show(calibration_json(calibration) | extra.machine() | written, [])
    else:
        record = outputs.places.get("calibration")
        bending = sag_blocks(bent, str(compensation or "")) if bent else []
        more = [*extra.blocks(), *bending, *frame_lines(calibration, frames, record)]
        show(None, [*calibration_blocks(calibration, extra.accuracy()), *more])
    say(
        not as_json,
        f"\nwrote {listed(told(place for place in outputs.places.values() if place in files))}"
        + (expanded_note(arm) if "urdf" in outputs.plan.places else "")
        + beside_note(outputs.plan),
        sys.stdout,
    )
    if outputs.compensation in files:
        say(not as_json, outputs.pair_words, sys.stdout)
    if verdict.use == "no":
        raise typer.Exit(FitRejected.exit_code)
