"""`urdfcal compare`: two calibrations, or descriptions, of one robot."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from urdfcal.cli.console import show, warn
from urdfcal.cli.inputs import load, stored_calibration
from urdfcal.cli.options import Json, Overwrite, PackageDirs, Quiet, Seed, XacroArgs, XacroLimits
from urdfcal.cli.places import deliver, page_place, stated_file

if TYPE_CHECKING:
    from urdfcal.robot.robot import Robot

_WHAT = "A calibration that fit wrote, or a URDF or xacro file."


def compare(
    one: Annotated[Path, typer.Argument(metavar="A", help=_WHAT, show_default=False)],
    other: Annotated[Path, typer.Argument(metavar="B", help="Another, of the same robot.", show_default=False)],
    tool: Annotated[
        str | None,
        typer.Option(metavar="LINK", help="Compare at this link. Default: behind the joints that differ.", show_default=False),
    ] = None,
    robot: Annotated[
        Path | None,
        typer.Option(metavar="ROBOT", help="The robot that was calibrated. Default: as the calibration names it.", show_default=False),
    ] = None,
    report: Annotated[
        Path | None,
        typer.Option(
            metavar="HTML",
            parser=stated_file,
            help="Also write the comparison, with pictures, as a page.",
            show_default=False,
        ),
    ] = None,
    overwrite: Overwrite = False,
    xacro_arg: XacroArgs = None,
    xacro_limit: XacroLimits = None,
    package_dir: PackageDirs = None,
    seed: Seed = 0,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Compare two calibrations or descriptions of one robot: joint by joint, and at the tool, over what either is unsure of."""
    import numpy as np

    from urdfcal.base.files import is_yaml
    from urdfcal.calibration.analysis.comparison import compare as run_compare
    from urdfcal.calibration.analysis.comparison import default_tool
    from urdfcal.output.accounts import accounts_of
    from urdfcal.output.replaced import inputs_sha256
    from urdfcal.output.text.comparison import comparison_blocks, comparison_json

    def loaded(path: Path) -> Robot:
        return load(path, xacro_arg, package_dir, xacro_limit=xacro_limit, quiet=quiet)

    made_of = inputs_sha256((one, other, robot))
    place = page_place(report, "comparison.html", (one, other, robot), made_of, overwrite)
    under = loaded(robot) if robot else None
    said = [stored_calibration(path) if is_yaml(path) else loaded(path) for path in (one, other)]
    ours, theirs, words = accounts_of(said[0], said[1], under, loaded)
    warn(words, quiet)
    found = run_compare(ours, theirs, tool or default_tool(ours, theirs), np.random.default_rng(seed))
    blocks, files = comparison_blocks(found), {"one": one, "other": other, "robot": robot}
    if place is not None:
        from urdfcal.output.report.comparison_page import comparison_page

        deliver({place: comparison_page(found, files.items(), made_of)})
        blocks += ["", f"wrote {place}"]
    show(comparison_json(found) | ({"report": str(place)} if place else {}) if as_json else None, blocks)
