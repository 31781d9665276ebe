"""`urdfcal simulate` and `paper`: measurements of robots whose errors are known."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from urdfcal.commands.console import ProgressBar, finish, say, show
from urdfcal.commands.inputs import about, arm7_file, load, positive, require_places
from urdfcal.commands.options import Json, Lasers, PackageDirs, Quiet, RobotFile, Screen, Seed, Verbose, XacroArgs

if TYPE_CHECKING:
    pass


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

    arm = load(robot, xacro_arg, package_dir, screen, laser)
    say(verbose, about(arm))
    truth_file = output.parent / f"{output.stem}_truth.yaml"
    require_places(output, truth_file, inputs=(robot,))
    rng = np.random.default_rng(seed)
    model, x = truth_of(arm, errors, rng)
    simulated = noise_from(spot_noise_mm, joint_noise_deg, noise)
    q = draw_poses(arm, model, x, poses + test_poses, rng, area=ScreenArea(positive("--screen-size-m", screen_size_m) or 3.0))
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
    finish(
        {"measurements": str(output), "truth": str(truth_file), "poses": len(data)} if as_json else None,
        f"wrote {output} ({len(data)} simulated poses) and {truth_file}",
        quiet,
    )


def paper(
    robot: Annotated[
        Path | None,
        typer.Argument(metavar="ROBOT", help="The arm of Table I. Default: the one that comes with urdfcal.", show_default=False),
    ] = None,
    runs: Annotated[int, typer.Option(min=1, help="Draws of poses and noise that are averaged.")] = 5,
    screen: Screen = None,
    laser: Lasers = None,
    xacro_arg: XacroArgs = None,
    package_dir: PackageDirs = None,
    seed: Seed = 0,
    as_json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Repeat the paper's simulation: Tables II and III beside the published values."""
    from urdfcal.paper import paper_tables
    from urdfcal.paper_report import paper_blocks, paper_json

    arm = load(robot or arm7_file(), xacro_arg, package_dir, screen, laser)
    say(verbose, about(arm))
    with ProgressBar("simulating", runs, quiet or as_json) as advance:
        lines = paper_tables(arm, runs, seed, advance)
    show(paper_json(lines) if as_json else None, paper_blocks(lines, runs))
