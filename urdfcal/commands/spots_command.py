"""`urdfcal spots`: from pictures to measurements.csv."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from urdfcal.commands.console import ProgressBar, finish, say, warn
from urdfcal.commands.inputs import load, positive, require_places
from urdfcal.commands.options import Json, Lasers, PackageDirs, Quiet, Screen, Verbose, XacroArgs
from urdfcal.errors import UsageError, did_you_mean

if TYPE_CHECKING:
    from urdfcal.geometry import Array3
    from urdfcal.robot import Robot
    from urdfcal.vision.csv_table import CsvTable

_COLOURS = ("red", "green", "blue")


def spots(
    images: Annotated[
        list[Path], typer.Argument(metavar="IMAGES", help="Pictures or folders; a folder in a folder is one pose.", show_default=False)
    ],
    output: Annotated[Path, typer.Option("-o", "--output", metavar="CSV", help="Measurements.", show_default=False)],
    camera: Annotated[
        Path | None,
        typer.Option(metavar="YAML", help="Lens and screen, from urdfcal camera: spots in m on the screen.", show_default=False),
    ] = None,
    pixels: Annotated[bool, typer.Option("--pixels", help="Also write <laser>.u .v .sigma_px, as the picture has them.")] = False,
    poses: Annotated[
        Path | None,
        typer.Option(metavar="CSV", help="Joint columns; rows found by the column image or pose, else by order.", show_default=False),
    ] = None,
    robot: Annotated[
        Path | None,
        typer.Option(metavar="ROBOT", help="URDF or xacro: laser names; with --poses it tells which spot is whose.", show_default=False),
    ] = None,
    lasers: Annotated[int, typer.Option(min=1, max=9, help="How many lasers there are, without --robot.")] = 2,
    colours: Annotated[
        str | None,
        typer.Option(metavar="RED,GREEN", help="Each laser's colour: red, green or blue. Default: found out.", show_default=False),
    ] = None,
    order: Annotated[
        str, typer.Option(help="Which laser is the first where nothing else says so, seen from the front: left-right or right-left.")
    ] = "left-right",
    dark: Annotated[
        Path | None, typer.Option(metavar="IMAGE", help="Picture with the lasers off; needed for grey pictures.", show_default=False)
    ] = None,
    frames: Annotated[
        str, typer.Option(help="one (each picture a pose), named (<pose>_<n>) or auto (named where two poses or more are named so).")
    ] = "auto",
    largest_px: Annotated[
        float, typer.Option(help="Greatest standard width of a spot in px; a third of it where its core is not clipped.")
    ] = 15.0,
    screen_size_m: Annotated[
        float | None,
        typer.Option(help="Side in m of the square around the screen's origin that spots lie in. Default: any.", show_default=False),
    ] = None,
    still: Annotated[bool, typer.Option(help="Leave out what shines from one place in half of the poses (a lamp).")] = True,
    debug: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Also write each picture with what was found and refused.", show_default=False)
    ] = None,
    screen: Screen = None,
    laser: Lasers = None,
    xacro_arg: XacroArgs = None,
    package_dir: PackageDirs = None,
    as_json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Find the laser spots in pictures, to sub-pixel, and write them as measurements."""
    from urdfcal.files import write_together
    from urdfcal.vision.camera_file import read_camera
    from urdfcal.vision.csv_table import read_csv_table
    from urdfcal.vision.spot_detector import SpotLimits
    from urdfcal.vision.spot_images import by_pose, image_files, read_picture
    from urdfcal.vision.spot_run import SpotSearch, spots_of
    from urdfcal.vision.spot_table import joined, known_labels, spots_csv

    if camera is None and not pixels:
        raise UsageError("spots need --camera CAMERA.yaml to be in metres on the screen, or --pixels")
    if frames not in ("auto", "one", "named"):
        raise UsageError(f"--frames {frames}: expected auto, one or named")
    if order not in ("left-right", "right-left"):
        raise UsageError(f"--order {order}: expected left-right or right-left")
    arm = load(robot, xacro_arg, package_dir, screen, laser) if robot else None
    names = arm.rig.lasers if arm else tuple(laser) if laser else tuple(f"laser_{number}" for number in range(1, lasers + 1))
    files = image_files(images, [dark] if dark else [])
    require_places(output, inputs=(camera, poses, robot, dark, *files))
    _require_folder(debug)
    table = read_csv_table(poses, "one row a pose") if poses else None
    groups = by_pose(files, images, frames, known_labels(table) if table else ())  # type: ignore[arg-type]
    rows, by_order = joined(groups, table) if table else ([], "")
    view = read_camera(camera) if camera else None
    if view is not None:
        view.spots_of_pixels(_nowhere())  # refuses a camera without a screen before any picture is read
    half = positive("--screen-size-m", screen_size_m)
    search = SpotSearch(
        names,
        _colours_of(colours, len(names)),
        view,
        read_picture(dark, view.size if view else None) if dark else None,
        SpotLimits(largest=positive("--largest-px", largest_px) or 15.0),
        order == "left-right",
        half / 2 if half else None,
        still,
    )
    predicted = _predicted(arm, table, rows) if arm and table and view else None
    with ProgressBar("looking", len(files), quiet or as_json) as advance:
        found = spots_of(search, groups, predicted, advance)
    content = spots_csv(
        list(groups),
        found.labelled.spots,
        names,
        camera=view,
        pixels=pixels,
        table=table,
        rows=rows,
        comments=[
            "laser spots found in pictures by urdfcal spots; y, z, sigma in m on the screen; u, v in px, (0, 0) the first pixel's centre"
        ],
    )
    written: dict[str | Path, bytes] = {output: content}
    if debug is not None:
        debug.mkdir(exist_ok=True)
        written |= found.drawings(groups, debug)
    write_together(written)
    warn([*([by_order] if by_order else []), *found.warnings], quiet)
    counts = {name: sum(name in seen for seen in found.labelled.spots) for name in names}
    say(
        verbose,
        f"{len(files)} pictures of {len(groups)} poses; labelled by {'the nominal robot' if predicted is not None else 'colour or order'}",
    )
    finish(
        {"measurements": str(output), "poses": len(groups), "pictures": len(files), "spots": counts, "warnings": found.warnings}
        if as_json
        else None,
        f"wrote {output}: {', '.join(f'{name} seen in {count}' for name, count in counts.items())} of {len(groups)} poses",
        quiet,
    )


def _nowhere() -> Any:
    import numpy as np

    return np.zeros((1, 2))


def _require_folder(debug: Path | None) -> None:
    if debug is not None and (not debug.parent.is_dir() or (debug.exists() and not debug.is_dir())):
        raise UsageError(f"{debug}: cannot be made a folder for the drawings of --debug")


def _colours_of(colours: str | None, count: int) -> tuple[str, ...] | None:
    if colours is None:
        return None
    words = tuple(word.strip() for word in colours.split(","))
    words = words * count if len(words) == 1 else words
    for word in words:
        if word not in _COLOURS:
            raise UsageError(f"--colours {colours}: no laser colour '{word}'{did_you_mean(word, _COLOURS)}")
    if len(words) != count:
        raise UsageError(f"--colours {colours}: {len(words)} colours for {count} lasers")
    return words


def _predicted(arm: Robot, table: CsvTable, rows: list[int]) -> Array3:
    """Spots of the nominal robot in the poses' order."""
    from urdfcal.vision.rendering import nominal_beams
    from urdfcal.vision.spot_table import joint_positions

    return nominal_beams(arm, joint_positions(table, arm)[rows]).spots
