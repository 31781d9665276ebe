"""`urdfcal compare`: two calibrations, or descriptions, of one robot."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from urdfcal.cli.console import show, warn
from urdfcal.cli.inputs import load, stored_calibration
from urdfcal.cli.options import Json, Overwrite, PackageDirs, Quiet, Seed, XacroArgs, XacroLimits
from urdfcal.cli.places import deliver, page_place, stated_file

if TYPE_CHECKING:
    from urdfcal.calibration.analysis.comparison import Account
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

    from urdfcal.calibration.analysis.comparison import compare as run_compare
    from urdfcal.calibration.analysis.comparison import default_tool
    from urdfcal.output.replaced import inputs_sha256
    from urdfcal.output.text.comparison import comparison_blocks, comparison_json

    def loaded(path: Path) -> Robot:
        return load(path, xacro_arg, package_dir, xacro_limit=xacro_limit, quiet=quiet)

    made_of = inputs_sha256((one, other, robot))
    place = page_place(report, "comparison.html", (one, other, robot), made_of, overwrite)
    ours, theirs = _accounts((one, other), robot, loaded, quiet)
    found = run_compare(ours, theirs, tool or default_tool(ours, theirs), np.random.default_rng(seed))
    blocks, files = comparison_blocks(found), {"one": one, "other": other, "robot": robot}
    if place is not None:
        from urdfcal.output.report.comparison_page import comparison_page

        deliver({place: comparison_page(found, files.items(), made_of)})
        blocks += ["", f"wrote {place}"]
    show(comparison_json(found) | ({"report": str(place)} if place else {}) if as_json else None, blocks)


def _accounts(paths: tuple[Path, Path], named: Path | None, loaded: Callable[[Path], Robot], quiet: bool) -> tuple[Account, Account]:
    """What the two files say; a calibration is put on the description beside it, or on the one that it names."""
    from urdfcal.base.files import is_yaml
    from urdfcal.calibration.analysis.comparison import Account
    from urdfcal.output.accounts import account_of, described_in, silent_joints

    stored = {path: stored_calibration(path) for path in paths if is_yaml(path)}
    described = {path: loaded(path) for path in paths if path not in stored}
    base = loaded(named) if named else next(iter(described.values()), None) or loaded(described_in(stored[paths[0]]))

    def account(path: Path) -> Account:
        return account_of(stored[path], base) if path in stored else Account(str(path), described[path])

    accounts = account(paths[0]), account(paths[1])
    for path, other in zip(paths, accounts[::-1], strict=True):
        if path in stored and (silent := silent_joints(stored[path], base, other.robot)):
            warn([f"{path} says nothing of {', '.join(silent)}: taken as {base.description.label} has them"], quiet)
    return accounts
