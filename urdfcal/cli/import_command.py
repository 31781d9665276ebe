"""`urdfcal import`: a calibration that somebody else made, as one of ours."""

from __future__ import annotations

import sys
from collections.abc import Callable
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from urdfcal.base.errors import UsageError
from urdfcal.base.files import YAML_ENDINGS, is_yaml
from urdfcal.cli.console import finish
from urdfcal.cli.inputs import load
from urdfcal.cli.options import Json, Overwrite, PackageDirs, Quiet, RobotFile, XacroArgs, XacroLimits
from urdfcal.cli.places import deliver, named, require_ending, require_no_json, require_places, stated_place, told

if TYPE_CHECKING:
    from urdfcal.base.geometry import SE3
    from urdfcal.robot.robot import Robot

_TABLES = (".csv", ".tsv", ".txt", ".xlsx")


class DhConvention(StrEnum):
    """The conventions of D-H tables, as `output.imported` has them."""

    STANDARD = "standard"
    MODIFIED = "modified"
    PAPER = "paper"


def import_(
    robot: RobotFile,
    file: Annotated[
        Path,
        typer.Argument(
            metavar="FILE",
            help="A kinematics file of UR, xArm, Franka or Flexiv, a tesseract calibration, origins as --format origins-yaml writes "
            "them, another URDF of the robot, or a CSV of D-H errors: joint and some of d_a, d_d, d_alpha, d_theta.",
            show_default=False,
        ),
    ],
    output: Annotated[
        Path,
        typer.Option(
            "-o",
            "--output",
            metavar="CALIBRATION",
            parser=stated_place,
            help="The calibration; a folder for <robot>_calibration.yaml in it, - for stdout.",
            show_default=False,
        ),
    ],
    convention: Annotated[
        DhConvention | None, typer.Option(help="Convention of the D-H errors. Needed for them alone.", show_default=False)
    ] = None,
    tip: Annotated[
        str | None, typer.Option(metavar="LINK", help="The link that the D-H table leads to. Needed for them alone.", show_default=False)
    ] = None,
    sigma: Annotated[
        str,
        typer.Option(metavar="LENGTH,ANGLE", help="How sure a later fit --after is to be of each number of a joint's placement."),
    ] = "0.3mm,0.02deg",
    overwrite: Overwrite = False,
    xacro_arg: XacroArgs = None,
    xacro_limit: XacroLimits = None,
    package_dir: PackageDirs = None,
    as_json: Json = False,
    quiet: Quiet = False,
) -> None:
    """Take a calibration that somebody else made, such as the maker's own, in as one of ours: for apply, compare and fit --after."""
    from urdfcal.base.files import sha256
    from urdfcal.base.geometry import distance_mm_mrad
    from urdfcal.base.terminal import many, rounded
    from urdfcal.model.options import parse_prior
    from urdfcal.output.calibration_yaml import imported_yaml
    from urdfcal.output.imported import assumed_joints, corrections_to
    from urdfcal.output.replaced import require_marked

    def loaded(path: Path) -> Robot:
        return load(path, xacro_arg, package_dir, xacro_limit=xacro_limit, quiet=quiet)

    require_no_json(as_json, output)
    sure = parse_prior(sigma)
    nominal = loaded(robot)
    place = named(output, f"{nominal.description.stem}_calibration.yaml")
    require_ending("-o", place, YAML_ENDINGS, "a calibration")
    require_places(place, inputs=(robot, file))
    corrections = corrections_to(nominal, _origins(file, nominal, loaded, convention, tip))
    if not corrections:
        raise UsageError(f"{file}: has every joint where {robot} has it; there is nothing to import")
    origins = {name: own.corrected for name, own in corrections.items()}
    content = imported_yaml(nominal, corrections, assumed_joints(nominal, origins, sure), file, sys.argv)
    if not overwrite:
        marks = sha256(nominal.description.text), sha256(file.read_bytes())
        require_marked(place, marks, "calibration that was imported from the same files")
    deliver({place: content})
    far = [distance_mm_mrad(own.nominal, own.corrected) for own in corrections.values()]
    mm, mrad = (max(each[part] for each in far) for part in (0, 1))
    finish(
        {"calibration": str(place), "joints": list(corrections), "most_mm": mm, "most_mrad": mrad} if as_json else None,
        f"wrote {told([place])[0]} with {many(len(corrections), 'origin')}, "
        f"up to {rounded(mm, 3)} mm and {rounded(mrad, 3)} mrad from nominal",
        quiet,
    )


def _origins(file: Path, robot: Robot, loaded: Callable[[Path], Robot], convention: DhConvention | None, tip: str | None) -> dict[str, SE3]:
    """Origins by joint name, by the road that the file's name stands for.

    Raises:
        UsageError: options are missing that a D-H table needs, or are given without one.
    """
    from urdfcal.output.imported import dh_origins, origins_of, read_origins

    if file.suffix.lower() in _TABLES:
        if convention is None or tip is None:
            lacking = ["--convention standard, modified or paper"] * (convention is None) + ["--tip LINK"] * (tip is None)
            raise UsageError(f"{file}: is taken for a table of D-H errors, which needs {' and '.join(lacking)}")
        return dh_origins(file, robot, tip, convention.value)
    if convention is not None or tip is not None:
        raise UsageError(f"--{'tip' if convention is None else 'convention'} is about tables of D-H errors (.csv), and {file} is none")
    return read_origins(file, robot) if is_yaml(file) else origins_of(loaded(file), robot)
