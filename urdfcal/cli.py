"""The command line: parse, call, print. The only file that prints."""

from __future__ import annotations

import io
import json
import os
import sys
import warnings
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NoReturn

import typer

from urdfcal.errors import FitRejected, UrdfcalError, UsageError

if TYPE_CHECKING:
    from rich.console import RenderableType

    from urdfcal.error_model import PriorScale
    from urdfcal.rig_file import RigFile
    from urdfcal.robot import Robot
    from urdfcal.slots import Kind

app = typer.Typer(
    name="urdfcal",
    help="Find the real geometry of a robot arm from measurements and write it back into its URDF.",
    add_completion=False,
    no_args_is_help=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)

RobotFile = Annotated[Path, typer.Argument(metavar="ROBOT", help="URDF or xacro file. A xacro file is code: it runs.", show_default=False)]
DataFile = Annotated[
    Path, typer.Argument(metavar="MEASUREMENTS", help="CSV: a column a joint, <laser>.y and <laser>.z.", show_default=False)
]
XacroArgs = Annotated[
    list[str] | None, typer.Option("--xacro-arg", metavar="NAME:=VALUE", help="Value of a xacro argument; repeatable.", show_default=False)
]
PackageDirs = Annotated[
    list[Path] | None,
    typer.Option("--package-dir", metavar="DIR", help="Folder in which packages are looked for first; repeatable.", show_default=False),
]
Screen = Annotated[
    str | None,
    typer.Option(metavar="LINK", help="Screen link; its plane x = 0 is the screen. Default: the link 'screen'.", show_default=False),
]
Lasers = Annotated[
    list[str] | None,
    typer.Option(
        "--laser", metavar="LINK", help="Laser link, beam along +z; repeatable. Default: every link 'laser_<digits>'.", show_default=False
    ),
]
RigOption = Annotated[
    Path | None, typer.Option("--rig", metavar="YAML", help="rig.yaml: links, error models, noise, priors.", show_default=False)
]
Model = Annotated[
    str | None,
    typer.Option("--error-model", metavar="MODEL", help="auto, dh, hayati, placement or offset. Default: auto.", show_default=False),
]
Estimate = Annotated[
    list[str] | None,
    typer.Option("--estimate", metavar="WHAT", help="Also estimate: screen, beams or beams4; repeatable.", show_default=False),
]
Fix = Annotated[
    list[str] | None,
    typer.Option("--fix", metavar="PATTERN", help="Hold these parameters, e.g. 'joint3.*'; repeatable.", show_default=False),
]
Only = Annotated[
    list[str] | None, typer.Option("--only", metavar="PATTERN", help="Estimate these parameters alone; repeatable.", show_default=False)
]
JointSigma = Annotated[float | None, typer.Option(metavar="DEG", help="Noise of a joint reading in deg. Default: 0.", show_default=False)]
PriorJoint = Annotated[
    str | None, typer.Option(metavar="MM,DEG", help="Prior sigma of joint errors, or flat. Default: 10mm,1deg.", show_default=False)
]
PriorMount = Annotated[
    str | None, typer.Option(metavar="MM,DEG", help="... of the module's mount. Default: 20mm,2deg.", show_default=False)
]
PriorScreen = Annotated[
    str | None, typer.Option(metavar="MM,DEG", help="... of the screen's placement. Default: 100mm,5deg.", show_default=False)
]
PriorBeams = Annotated[str | None, typer.Option(metavar="MM,DEG", help="... of the beams. Default: 5mm,1deg.", show_default=False)]
Json = Annotated[bool, typer.Option("--json", help="Print the result for machines, in SI units.")]
Quiet = Annotated[bool, typer.Option("-q", "--quiet", help="No warnings and no progress.")]
Verbose = Annotated[bool, typer.Option("-v", "--verbose", help="Say more about what is going on.")]
Seed = Annotated[int, typer.Option(min=0, help="Seed of the random numbers.")]
Output = Annotated[Path | None, typer.Option("-o", "--output", metavar="FILE", help="Where to write.", show_default=False)]

_LEAST, _MOST = 1e-15, 1e6  # what a tolerance, a noise in mm or a size in m can be
_MOST_DEGREES = 90.0


@app.command()
def fit(
    robot: RobotFile,
    measurements: DataFile,
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", metavar="URDF", help="Calibrated URDF. Default: <stem>_calibrated.urdf here.", show_default=False),
    ] = None,
    rig: RigOption = None,
    error_model: Model = None,
    estimate: Estimate = None,
    fix: Fix = None,
    only: Only = None,
    estimator: Annotated[str, typer.Option(help="ekf, lse (Levenberg-Marquardt), robust (Student's t) or evolution.")] = "ekf",
    schedule: Annotated[str, typer.Option(help="Of the EKF: iterated (maximum a posteriori) or paper (sweeps with Q and R).")] = "iterated",
    spot_sigma_mm: Annotated[
        float | None,
        typer.Option(metavar="MM", help="Noise of a spot coordinate in mm. Default: estimated from the residual.", show_default=False),
    ] = None,
    joint_sigma_deg: JointSigma = None,
    prior: Annotated[
        str, typer.Option(help="stated: the priors below; auto: the data choose the joints' prior scales (at least 20 poses).")
    ] = "stated",
    prior_joint: PriorJoint = None,
    prior_mount: PriorMount = None,
    prior_screen: PriorScreen = None,
    prior_beams: PriorBeams = None,
    tolerance: Annotated[
        float | None,
        typer.Option(help="Stop under this step: in sigmas (iterated) or m and rad (paper). Default: 1e-7.", show_default=False),
    ] = None,
    max_sweeps: Annotated[
        int | None, typer.Option(min=1, help="Sweeps allowed. Default: 100 (iterated), 5000 (paper).", show_default=False)
    ] = None,
    q: Annotated[float, typer.Option("--process-noise", help="Q = q I of the paper schedule, m^2 and rad^2.")] = 1e-4,
    r: Annotated[float, typer.Option("--measurement-noise", help="R = r I of the paper schedule, m^2.")] = 1e-4,
    gate: Annotated[bool, typer.Option(help="Take out spots that the fit cannot explain, and name them.")] = True,
    sanity: Annotated[bool, typer.Option(help="Refuse measurements that a common mistake explains far better, and name it.")] = True,
    test: Annotated[Path | None, typer.Option(metavar="CSV", help="Further poses, evaluated and not fitted.", show_default=False)] = None,
    holdout: Annotated[
        float | None,
        typer.Option(metavar="SHARE", help="Share of the poses, drawn at random, to test and not to fit, e.g. 0.3.", show_default=False),
    ] = None,
    kfold: Annotated[
        int | None, typer.Option(min=2, metavar="N", help="Also fit N times with an Nth of the poses held out in turn.", show_default=False)
    ] = None,
    tool: Annotated[
        str | None, typer.Option(metavar="LINK", help="Predict how far off this link still is, over the workspace.", show_default=False)
    ] = None,
    report: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Also write a report: .html (one page), .md or .json.", show_default=False)
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Write also what must not be trusted (exit code 3).")] = False,
    screen: Screen = None,
    laser: Lasers = None,
    xacro_arg: XacroArgs = None,
    package_dir: PackageDirs = None,
    seed: Seed = 0,
    as_json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Calibrate: write a corrected URDF and <stem>_calibration.yaml next to it, print the before/after table."""
    from dataclasses import replace

    import numpy as np

    from urdfcal.calibration import fit as run_fit
    from urdfcal.calibration import laid_over
    from urdfcal.extras import Extras, workspace_accuracy
    from urdfcal.files import write_together
    from urdfcal.measurements import read_measurements
    from urdfcal.prediction import base_link
    from urdfcal.report import calibration_blocks, calibration_json
    from urdfcal.report_files import report_bytes, require_report_ending
    from urdfcal.validation import coverage_warnings
    from urdfcal.validation import holdout as hold_out
    from urdfcal.validation import kfold as cross_validate

    rig_file = _rig_file(rig)
    arm = _robot(robot, xacro_arg, package_dir, screen, laser, rig_file)
    urdf = output or Path(f"{arm.description.stem}_calibrated.urdf")
    record = urdf.parent / f"{_stem_of(urdf)}_calibration.yaml"
    if report is not None:
        require_report_ending(report)
    _require_places(urdf, record, *([report] if report else []), inputs=(robot, measurements, rig, test))
    data = read_measurements(measurements, arm)
    further = read_measurements(test, arm) if test else None
    if holdout is not None:
        data = hold_out(data, holdout, np.random.default_rng(seed))
    options = laid_over(
        rig_file.options(),
        error_model,
        estimate or (),
        fix or (),
        only or (),
        _priors(prior_joint, prior_mount, prior_screen, prior_beams),
    )
    how: dict[str, Any] = {
        "estimator": estimator,
        "schedule": schedule,
        "options": options,
        "spot_sigma": _spot_noise(rig_file, spot_sigma_mm),
        "joint_sigma": _joint_noise(arm, rig_file, joint_sigma_deg),
        "tolerance": _positive("--tolerance", tolerance),
        "max_sweeps": max_sweeps,
        "q": q,
        "r": r,
        "gated": gate,
        "evidence": _chosen(prior),
        "sane": sanity,
    }
    if tool is not None:
        base_link(arm, tool)  # refuse a link that does not move before any work is done
    _say(verbose, f"{_about(arm)}; {len(data)} poses")
    calibration = run_fit(arm, data, test=further, rng=np.random.default_rng(seed), **how)
    warned = (*calibration.warnings, *(further.warnings if further else ()), *coverage_warnings(arm, calibration))
    calibration = replace(calibration, warnings=warned)
    extra = Extras(
        workspace_accuracy(arm, calibration, tool, np.random.default_rng(seed)) if tool is not None else None,
        cross_validate(arm, data, kfold, np.random.default_rng(seed), **how) if kfold is not None else None,
    )
    _warn(calibration.warnings, quiet)
    if force:
        _warn([f"--force: {calibration.rejection}"] if calibration.rejection else [], quiet)
    else:
        calibration.require_trustworthy()
    files: dict[str | Path, bytes] = {urdf: calibration.urdf(), record: calibration.record(sys.argv)}
    if report is not None:
        files[report] = report_bytes(report, calibration, sys.argv)
    write_together(files)
    machine = calibration_json(calibration) | extra.machine() if as_json else None
    _result(machine, [*calibration_blocks(calibration), *extra.blocks()])
    _say(not as_json, f"\nwrote {_listed(files)}" + _expanded_note(arm), sys.stdout)
    if calibration.rejection:
        raise typer.Exit(FitRejected.exit_code)


@app.command()
def evaluate(
    robot: RobotFile,
    measurements: DataFile,
    screen: Screen = None,
    laser: Lasers = None,
    xacro_arg: XacroArgs = None,
    package_dir: PackageDirs = None,
    as_json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Print how far the spots of a URDF, calibrated or not, lie from the measured ones."""
    from urdfcal.calibration import beams_that_miss
    from urdfcal.calibration import evaluate as run_evaluate
    from urdfcal.measurements import read_measurements
    from urdfcal.report import spot_table_block, table_json

    arm = _robot(robot, xacro_arg, package_dir, screen, laser)
    _say(verbose, _about(arm))
    data = read_measurements(measurements, arm)
    _warn((*data.warnings, *beams_that_miss(arm, data)), quiet)
    fit_set, test_set = data.split()
    tables = {name: run_evaluate(arm, rows) for name, rows in (("fit", fit_set), ("test", test_set)) if len(rows)}
    whole = run_evaluate(arm, data)
    machine = {"converged": True, "iterations": 0, "rank": 0, "parameters": [], "combinations": []}
    machine |= {"before": table_json(whole), "after": table_json(whole), "test": None}
    if "test" in tables:
        machine["test"] = {"before": table_json(tables["test"]), "after": table_json(tables["test"])}
    _result(machine if as_json else None, [spot_table_block((name, table, None) for name, table in tables.items())])


@app.command()
def check(
    robot: RobotFile,
    measurements: DataFile,
    rig: RigOption = None,
    error_model: Model = None,
    estimate: Estimate = None,
    fix: Fix = None,
    only: Only = None,
    spot_sigma_mm: Annotated[
        float | None, typer.Option(metavar="MM", help="Noise of a spot coordinate in mm. Default: 1.", show_default=False)
    ] = None,
    joint_sigma_deg: JointSigma = None,
    prior_joint: PriorJoint = None,
    prior_mount: PriorMount = None,
    prior_screen: PriorScreen = None,
    prior_beams: PriorBeams = None,
    screen: Screen = None,
    laser: Lasers = None,
    xacro_arg: XacroArgs = None,
    package_dir: PackageDirs = None,
    seed: Seed = 0,
    as_json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Tell what these measurements can and cannot determine, without fitting, and which others would help."""
    import numpy as np

    from urdfcal.calibration import laid_over
    from urdfcal.check import check as run_check
    from urdfcal.check_report import check_blocks, check_json
    from urdfcal.measurements import read_measurements

    rig_file = _rig_file(rig)
    arm = _robot(robot, xacro_arg, package_dir, screen, laser, rig_file)
    _say(verbose, _about(arm))
    data = read_measurements(measurements, arm)
    priors = _priors(prior_joint, prior_mount, prior_screen, prior_beams)
    options = laid_over(rig_file.options(), error_model, estimate or (), fix or (), only or (), priors)
    result = run_check(
        arm,
        data,
        options=options,
        spot_sigma=_spot_noise(rig_file, spot_sigma_mm),
        joint_sigma=_joint_noise(arm, rig_file, joint_sigma_deg),
        rng=np.random.default_rng(seed),
    )
    _warn(result.warnings, quiet)
    _result(check_json(result) if as_json else None, check_blocks(result))


@app.command()
def dh(
    robot: RobotFile,
    hayati: Annotated[bool, typer.Option("--hayati", help="Hayati's transform, with beta, where axes are nearly parallel.")] = False,
    calibration: Annotated[
        Path | None, typer.Option(metavar="YAML", help="Also show the table of the corrected robot.", show_default=False)
    ] = None,
    screen: Screen = None,
    laser: Lasers = None,
    xacro_arg: XacroArgs = None,
    package_dir: PackageDirs = None,
    as_json: Json = False,
    verbose: Verbose = False,
) -> None:
    """Print the D-H table derived from the URDF, and what is carried by screen and mount."""
    from dataclasses import replace

    from urdfcal.calibration_file import read_calibration
    from urdfcal.dh import dh_table
    from urdfcal.gauge import build_error_model
    from urdfcal.report import carried_lines, dh_block, dh_json
    from urdfcal.robot import robot_from
    from urdfcal.urdf_writer import with_origins

    arm = _robot(robot, xacro_arg, package_dir, screen, laser)
    _say(verbose, _about(arm))
    rows, corrected = dh_table(arm.chain, hayati), None
    if calibration is not None:
        origins, _ = read_calibration(calibration).origins_for(arm)
        description = replace(arm.description, text=with_origins(arm.description, origins))
        corrected = dh_table(robot_from(description, screen=arm.screen, lasers=arm.lasers).chain, hayati)
    carried = build_error_model(arm.chain, arm.rig).carried
    machine: dict[str, Any] = {"nominal": dh_json(rows), "corrected": dh_json(corrected) if corrected else None, "carried": dict(carried)}
    heading = "left out of the automatic error model, since no measurement could tell them from others:"
    lines: list[RenderableType] = ["", heading, *(f"  {line}" for line in carried_lines(carried))]
    _result(machine if as_json else None, [dh_block(rows, corrected), *(lines if carried else [])])


@app.command()
def simulate(
    robot: RobotFile,
    output: Annotated[
        Path,
        typer.Option(
            "-o", "--output", metavar="CSV", help="Measurements; the truth goes to <stem>_truth.yaml beside them.", show_default=False
        ),
    ],
    poses: Annotated[int, typer.Option(min=1, help="How many poses.")] = 60,
    test_poses: Annotated[int, typer.Option(min=0, help="Further poses, marked as test in a 'set' column.")] = 0,
    seed: Seed = 0,
    spot_noise_mm: Annotated[float, typer.Option(help="Noise of a spot coordinate in mm.")] = 1.0,
    joint_noise_deg: Annotated[float, typer.Option(help="Noise of a joint reading in deg.")] = 0.0,
    noise: Annotated[str, typer.Option(help="gaussian (the noise is a standard deviation) or uniform (half the width).")] = "gaussian",
    errors: Annotated[
        str,
        typer.Option(
            metavar="MM,DEG|YAML",
            help="Sigma of random errors in six directions of every joint, mount and screen, or a file with stated errors.",
        ),
    ] = "2mm,0.2deg",
    screen_size_m: Annotated[float, typer.Option(help="Side of the screen in m, centred on its link.")] = 3.0,
    screen: Screen = None,
    laser: Lasers = None,
    xacro_arg: XacroArgs = None,
    package_dir: PackageDirs = None,
    as_json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Simulate measurements of a robot with stated or random errors."""
    from dataclasses import replace

    import numpy as np

    from urdfcal.calibration_file import truth_yaml
    from urdfcal.corrections import OriginCorrection
    from urdfcal.files import write_together
    from urdfcal.measurements import measurements_csv
    from urdfcal.simulation import ScreenArea, draw_poses, noise_from
    from urdfcal.simulation import simulate as run_simulate
    from urdfcal.truth import truth_of

    arm = _robot(robot, xacro_arg, package_dir, screen, laser)
    _say(verbose, _about(arm))
    truth_file = output.parent / f"{output.stem}_truth.yaml"
    _require_places(output, truth_file, inputs=(robot,))
    rng = np.random.default_rng(seed)
    model, x = truth_of(arm, errors, rng)
    simulated = noise_from(spot_noise_mm, joint_noise_deg, noise)
    q = draw_poses(arm, model, x, poses + test_poses, rng, area=ScreenArea(_positive("--screen-size-m", screen_size_m) or 3.0))
    data = run_simulate(arm, model, x, q, rng, simulated)
    data = replace(data, sets=np.array(["fit"] * poses + ["test"] * test_poses))
    joints = arm.tree.joints
    corrections = {
        name: OriginCorrection(joints[name].origin, origin, joints[name].moves) for name, origin in model.corrected_origins(x).items()
    }
    stated = {"distribution": noise, "spot_mm": spot_noise_mm, "joint_deg": joint_noise_deg, "seed": seed}
    comments = [
        f"SIMULATED measurements of {arm.name}, made by urdfcal simulate; no robot has been measured.",
        f"seed {seed}, {noise} noise: spots {spot_noise_mm:g} mm, joints {joint_noise_deg:g} deg; errors: {Path(errors).name}",
        "joints in rad (m where they slide), spots (y, z) on the screen in m",
    ]
    truth = truth_yaml(arm, corrections, dict(zip(model.names, x, strict=True)), sys.argv, stated)
    write_together({truth_file: truth, output: measurements_csv(data, comments)})
    _done(
        {"measurements": str(output), "truth": str(truth_file), "poses": len(data)} if as_json else None,
        f"wrote {output} ({len(data)} simulated poses) and {truth_file}",
        quiet,
    )


@app.command()
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

    arm = _robot(robot, xacro_arg, package_dir, None, None)
    _require_places(output, inputs=(robot, calibration))
    origins, missing = read_calibration(calibration).origins_for(arm, force)
    write_whole(output, with_origins(arm.description, origins))
    if missing:
        _warn([f"{robot} has no joint {', '.join(missing)} of the measuring rig; the rest was applied"], quiet)
    _say(verbose, f"corrected: {', '.join(origins)}")
    _done(
        {"urdf": str(output), "corrected": list(origins), "missing": missing} if as_json else None,
        f"wrote {output} with {len(origins)} corrected origins" + _expanded_note(arm),
        quiet,
    )


@app.command()
def paper(
    robot: Annotated[
        Path | None,
        typer.Argument(metavar="ROBOT", help="The arm of Table I. Default: the one that comes with urdfcal.", show_default=False),
    ] = None,
    runs: Annotated[int, typer.Option(min=1, help="Draws of poses and noise that are averaged.")] = 5,
    seed: Seed = 0,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Repeat the paper's simulation: Tables II and III beside the published values."""
    from urdfcal.paper import paper_tables
    from urdfcal.paper_report import paper_blocks, paper_json
    from urdfcal.robot import load_robot

    arm = load_robot(robot or _arm7())
    with _progress("simulating", runs, quiet or as_json) as advance:
        lines = paper_tables(arm, runs, seed, advance)
    _result(paper_json(lines) if as_json else None, paper_blocks(lines, runs))


@app.command()
def version() -> None:
    """Print the version."""
    from urdfcal import __version__

    print(__version__)


def main() -> NoReturn:
    """Run the command line; every error of the user's is one line on stderr and exit code 2."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # our matrices are small: on a busy machine threads cost far more than they bring
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # a terminal that lacks a letter is no reason to fail
    try:
        code = app(standalone_mode=False, prog_name="urdfcal")
    except FitRejected as error:
        way_out = " (--force writes it anyway)" if error.forceable else ""
        _fail(f"rejected: {error}; nothing written{way_out}", error.exit_code)
    except UrdfcalError as error:
        _fail(str(error), error.exit_code)
    except typer.Abort:
        _fail("interrupted", 130)
    except KeyboardInterrupt:
        _fail("interrupted", 130)
    except BrokenPipeError:
        sys.stderr.close()
        sys.exit(0)
    except Exception as error:
        if hasattr(error, "format_message"):  # typer's own usage errors
            _fail(" ".join(error.format_message().split()), 2)
        raise
    sys.exit(code if isinstance(code, int) else 0)


def _fail(message: str, code: int) -> NoReturn:
    print(f"urdfcal: {message}", file=sys.stderr)
    sys.exit(code)


def _robot(
    path: Path,
    xacro_args: list[str] | None,
    package_dirs: list[Path] | None,
    screen: str | None,
    lasers: list[str] | None,
    rig: RigFile | None = None,
) -> Robot:
    from urdfcal.robot import load_robot

    arguments = {}
    for argument in xacro_args or ():
        name, mark, value = argument.partition(":=")
        if not mark or not name:
            raise UsageError(f"--xacro-arg {argument}: expected NAME:=VALUE")
        arguments[name] = value
    return load_robot(
        path,
        xacro_args=arguments,
        package_dirs=package_dirs or (),
        screen=screen or (rig.screen if rig else None),
        lasers=lasers or (rig.lasers if rig else None),
    )


def _rig_file(path: Path | None) -> RigFile:
    from urdfcal.rig_file import RigFile, read_rig_file

    return RigFile() if path is None else read_rig_file(path)


def _chosen(prior: str) -> bool:
    if prior not in ("stated", "auto"):
        raise UsageError(f"--prior {prior}: expected stated or auto")
    return prior == "auto"


def _priors(joint: str | None, mount: str | None, screen: str | None, beams: str | None) -> dict[Kind, PriorScale]:
    from urdfcal.gauge import parse_prior

    stated: dict[Kind, str | None] = {"joint": joint, "mount": mount, "screen": screen, "beam": beams}
    return {kind: parse_prior(text) for kind, text in stated.items() if text is not None}


def _joint_noise(robot: Robot, rig: RigFile, stated_deg: float | None) -> Any:
    """Standard deviation of every joint reading, [rad]."""
    import numpy as np

    from urdfcal.errors import RigError, no_such

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


def _spot_noise(rig: RigFile, stated_mm: float | None) -> float | None:
    """Standard deviation of a spot coordinate, [m], if it is stated anywhere."""
    millimetres = _positive("--spot-sigma-mm", stated_mm) or rig.noise.spot_mm
    return None if millimetres is None else millimetres * 1e-3


def _positive(option: str, value: float | None) -> float | None:
    if value is not None and not _LEAST <= value <= _MOST:
        raise UsageError(f"{option} {value:g}: expected a number between {_LEAST:g} and {_MOST:g}")
    return value


def _require_places(*outputs: Path, inputs: Iterable[Path | None]) -> None:
    """Refuse outputs that cannot be written or would fall on an input, before any work is done."""
    from urdfcal.files import require_writable

    used = {path.resolve() for path in inputs if path is not None}
    for output in outputs:
        require_writable(output)
        if output.resolve() in used:
            raise UsageError(f"{output}: is an input of this command; name another output with -o")


def _stem_of(urdf: Path) -> str:
    return urdf.name.removesuffix(".urdf").removesuffix("_calibrated") or urdf.stem


def _listed(paths: Iterable[str | Path]) -> str:
    *first, last = map(str, paths)
    return f"{', '.join(first)} and {last}" if first else last


def _about(robot: Robot) -> str:
    names = ", ".join(step.joint.name for step in robot.chain.moving)
    return f"{robot.name}: moving joints {names} between '{robot.rig.screen}' and '{robot.rig.module}' with {', '.join(robot.rig.lasers)}"


def _expanded_note(robot: Robot) -> str:
    return f" (the URDF is the expanded {robot.description.path.name})" if robot.description.expanded else ""


def _arm7() -> Path:
    """The arm of Table I, in a checkout or installed."""
    for folder in (Path(__file__).parent / "robots", Path(__file__).parents[1] / "robots"):
        if (folder / "arm7" / "arm7.urdf.xacro").exists():
            return folder / "arm7" / "arm7.urdf.xacro"
    raise UsageError("robots/arm7/arm7.urdf.xacro was not found; name the arm's file")


def _result(machine: Mapping[str, Any] | None, blocks: Iterable[RenderableType]) -> None:
    if machine is not None:
        print(json.dumps(machine, indent=2))
        return
    from urdfcal.report import as_text

    print(as_text(blocks), end="")


def _done(machine: Mapping[str, Any] | None, text: str, quiet: bool) -> None:
    """What a command that prints no table says at its end."""
    if machine is not None:
        print(json.dumps(machine, indent=2))
    else:
        _say(not quiet, text, sys.stdout)


def _say(wanted: bool, text: str, stream: Any = None) -> None:
    if wanted:
        print(text, file=stream or sys.stderr)


def _warn(lines: Iterable[str], quiet: bool) -> None:
    for line in lines:
        _say(not quiet, f"urdfcal: warning: {line}")


class _progress:
    """A progress bar on stderr, where somebody looks at it."""

    def __init__(self, what: str, total: int, quiet: bool) -> None:
        self.what, self.total, self.quiet = what, total, quiet or not sys.stderr.isatty()

    def __enter__(self) -> Callable[[], None]:
        if self.quiet:
            return lambda: None
        from rich.console import Console
        from rich.progress import Progress

        self.bar = Progress(console=Console(stderr=True), transient=True)
        self.bar.start()
        task = self.bar.add_task(self.what, total=self.total)
        return lambda: self.bar.advance(task)

    def __exit__(self, *_: object) -> None:
        if not self.quiet:
            self.bar.stop()


if __name__ == "__main__":
    warnings.simplefilter("default")
    main()
