"""`urdfcal module`: beam directions from a bench."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from urdfcal.base.errors import UsageError
from urdfcal.base.files import YAML_ENDINGS
from urdfcal.cli.console import finish, say, warn
from urdfcal.cli.inputs import load
from urdfcal.cli.options import Json, Lasers, Overwrite, PackageDirs, Quiet, Screen, Verbose, XacroArgs, XacroLimits
from urdfcal.cli.places import deliver, named, require_ending, require_no_json, require_places, stated_place
from urdfcal.cli.stated import positive


def module(
    bench: Annotated[
        Path,
        typer.Argument(
            metavar="BENCH", help="CSV: distance, <laser>.x, <laser>.y in module axes (z toward the plane).", show_default=False
        ),
    ],
    output: Annotated[
        Path,
        typer.Option(
            "-o", "--output", metavar="YAML", parser=stated_place, help="Rig file with the beams' priors; - is stdout.", show_default=False
        ),
    ],
    robot: Annotated[
        Path | None,
        typer.Option(
            metavar="ROBOT",
            help="The priors are relative to this URDF's beams. Default: to a URDF that holds the bench's angles.",
            show_default=False,
        ),
    ] = None,
    squareness_deg: Annotated[float, typer.Option(help="Sigma of each of the bench plane's two tilts in deg.")] = 0.2,
    reading_sigma_mm: Annotated[
        float | None, typer.Option(help="Noise of a reading in mm. Default: estimated from the residual.", show_default=False)
    ] = None,
    overwrite: Overwrite = False,
    screen: Screen = None,
    laser: Lasers = None,
    xacro_arg: XacroArgs = None,
    xacro_limit: XacroLimits = None,
    package_dir: PackageDirs = None,
    as_json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Find the module's true beam directions from spots on a plane at known distances (Fig. 6 of the paper)."""
    import numpy as np

    from urdfcal.base.tables import read_table
    from urdfcal.output.replaced import inputs_sha256, require_marked
    from urdfcal.vision.bench.beams import readings_from
    from urdfcal.vision.bench.misreadings import beams_without_misreadings
    from urdfcal.vision.bench.module_file import beam_priors, described, misreadings, module_yaml, xacro_arguments

    if not 0 <= squareness_deg <= 45:
        raise UsageError(f"--squareness-deg {squareness_deg:g}: expected a number from 0 to 45")
    noise = positive("--reading-sigma-mm", reading_sigma_mm)
    require_no_json(as_json, output)
    output = named(output, "module.yaml")
    require_ending("-o", output, YAML_ENDINGS, "a rig file")
    require_places(output, inputs=(bench, robot))
    made_of = inputs_sha256((bench, robot))
    if not overwrite:
        require_marked(output, (made_of,), "module that was found from the same files")
    arm = load(robot, xacro_arg, package_dir, screen, laser, xacro_limit=xacro_limit, quiet=quiet) if robot else None
    table = read_table(bench, "distance, <laser>.x, <laser>.y", "one row a distance")
    readings = readings_from(table)
    result, left_out, doubtful = beams_without_misreadings(readings, np.radians(squareness_deg), None if noise is None else noise * 1e-3)
    warnings = misreadings(result, left_out, doubtful, table)
    priors = beam_priors(result, arm)
    notes = [*warnings, f"sha256 of what it was found from: {made_of}"]
    deliver({output: module_yaml(result, np.radians(squareness_deg), arm, notes)})
    warn(warnings, quiet)
    say(verbose, f"{len(readings.distance)} distances; noise of a reading {result.noise * 1e3:.3f} mm")
    relative = f"the beams of {robot}" if robot else "a URDF that holds these angles"
    angles = {name: {"a": a, "b": b} for name, (a, b) in zip(result.lasers, result.angles.tolist(), strict=True)}
    finish(
        {
            "module": str(output),
            "angles": angles,
            "origins": dict(zip(result.lasers, result.origins.tolist(), strict=True)),
            "covariance": result.covariance.tolist(),
            "apex": None if result.apex is None else result.apex.tolist(),
            "reading_noise": result.noise,
            "residual_rms": result.rms,
            "left_out": [{"line": table.lines[wrong.row], "lasers": list(wrong.lasers), "off": wrong.off} for wrong in left_out],
            "warnings": warnings,
            "priors": {name: {"value": value, "sigma": sigma} for name, (value, sigma) in priors.items()},
        }
        if as_json
        else None,
        "\n".join(
            [*described(result), *xacro_arguments(result), f"wrote {output}: priors relative to {relative}, for fit --rig {output.name}"]
        ),
        quiet,
    )
