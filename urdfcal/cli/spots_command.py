"""`urdfcal spots`: from pictures to measurements.csv."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from urdfcal.base.errors import UsageError, did_you_mean
from urdfcal.cli.console import ProgressBar, finish, say, warn
from urdfcal.cli.inputs import load
from urdfcal.cli.notes import listed
from urdfcal.cli.options import Json, Lasers, Overwrite, PackageDirs, Quiet, Screen, Verbose, XacroArgs, XacroLimits
from urdfcal.cli.places import MEASUREMENTS, deliver, named, require_ending, require_no_json, require_places, stated_place
from urdfcal.cli.stated import positive

if TYPE_CHECKING:
    from urdfcal.base.geometry import Array3
    from urdfcal.base.tables import Table
    from urdfcal.robot.robot import Robot


_COLOURS = ("red", "green", "blue")


def spots(
    images: Annotated[
        list[Path], typer.Argument(metavar="IMAGES", help="Pictures or folders; a folder in a folder is one pose.", show_default=False)
    ],
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="CSV", parser=stated_place, help="Measurements; - is stdout.", show_default=False)
    ],
    camera: Annotated[
        Path | None,
        typer.Option(metavar="YAML", help="Lens and screen, from urdfcal camera: spots in m on the screen.", show_default=False),
    ] = None,
    pixels: Annotated[bool, typer.Option("--pixels", help="Also write <laser>.u .v .sigma_px, as the picture has them.")] = False,
    poses: Annotated[
        Path | None,
        typer.Option(metavar="CSV", help="Joint columns; rows by the column image or pose, by order without both.", show_default=False),
    ] = None,
    robot: Annotated[
        Path | None,
        typer.Option(metavar="ROBOT", help="URDF or xacro: laser names; with --poses it tells which spot is whose.", show_default=False),
    ] = None,
    lasers: Annotated[
        int | None, typer.Option(min=1, max=9, help="How many lasers there are, without --robot. Default: 2.", show_default=False)
    ] = None,
    colours: Annotated[
        str | None,
        typer.Option(metavar="red|green|blue,...", help="Each laser's colour. Default: found out.", show_default=False),
    ] = None,
    order: Annotated[
        str | None,
        typer.Option(
            help="Which laser is the first where nothing else says so, seen from the front: left-right or right-left. Default: left-right.",
            show_default=False,
        ),
    ] = None,
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
    """Find the laser spots in pictures, to sub-pixel, and write them as measurements."""
    from urdfcal.base.tables import read_table
    from urdfcal.base.terminal import many
    from urdfcal.base.whole_files import folder_whole
    from urdfcal.output.replaced import inputs_sha256, require_marked
    from urdfcal.vision.camera.camera_file import read_camera
    from urdfcal.vision.pictures import by_pose, image_files, read_picture
    from urdfcal.vision.spots.detector import SpotLimits
    from urdfcal.vision.spots.run import SpotSearch, drawing_places, spots_of
    from urdfcal.vision.spots.table import joined, known_labels, spots_csv

    if camera is None and not pixels:
        raise UsageError("spots need --camera CAMERA.yaml to be in metres on the screen, or --pixels")
    if frames not in ("auto", "one", "named"):
        raise UsageError(f"--frames {frames}: expected auto, one or named")
    if order not in (None, "left-right", "right-left"):
        raise UsageError(f"--order {order}: expected left-right or right-left")
    if robot is None and (screen or xacro_arg or package_dir):
        raise UsageError("--screen, --xacro-arg and --package-dir are about a robot: name it with --robot, or leave them out")
    if camera is None and screen_size_m is not None:
        raise UsageError("--screen-size-m needs --camera: pixels alone do not say where on the screen a spot lies")
    arm = load(robot, xacro_arg, package_dir, screen, laser, xacro_limit=xacro_limit, quiet=quiet) if robot else None
    names = _lasers(arm, laser, lasers)
    files = image_files(images, [dark] if dark else [])
    require_no_json(as_json, output)
    output = named(output, "measurements.csv")
    require_ending("-o", output, MEASUREMENTS, "a file of measurements")
    require_places(output, inputs=(camera, poses, robot, dark, *files))
    made_of = inputs_sha256((*files, camera, poses, robot, dark))
    if not overwrite:
        require_marked(output, (made_of,), "result of urdfcal spots from the same files")
    table = read_table(poses, "a column a joint", "one row a pose") if poses else None
    groups = by_pose(files, images, frames, known_labels(table) if table else ())  # type: ignore[arg-type]
    if debug is not None:
        require_debug(debug, images, files, list(drawing_places(groups, debug).values()), (output, camera, poses, robot, dark))
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
        order != "right-left",
        half / 2 if half else None,
        still,
    )
    predicted, odd = _predicted(arm, table, rows) if arm and table and view else (None, ())
    with ProgressBar("looking", len(files), quiet or as_json) as advance:
        found = spots_of(search, groups, predicted, advance)
    if arm and view is None and order is None and found.labelled.ordered and any(found.labelled.spots):
        raise UsageError(
            f"--robot without --camera: pixels and one colour do not say which spot is whose of {listed(names)}; give --camera CAMERA.yaml "
            "with --poses, their --colours if they differ, or --order if you know it"
        )
    content = spots_csv(
        list(groups),
        found.labelled.spots,
        names,
        camera=view,
        pixels=pixels,
        table=table,
        rows=rows,
        comments=[
            "laser spots found in pictures by urdfcal spots; y, z, sigma in m on the screen; u, v in px, (0, 0) the first pixel's centre; "
            f"sha256 of what they were found in: {made_of}"
        ],
    )
    if debug is not None:
        with folder_whole(debug) as folder:
            for place, drawing in found.drawings(groups, folder).items():
                Path(place).write_bytes(drawing)
    deliver({output: content})
    warn([*odd, *([by_order] if by_order else []), *found.warnings], quiet)
    counts = {name: sum(name in seen for seen in found.labelled.spots) for name in names}
    say(
        verbose,
        f"{many(len(files), 'picture')} of {many(len(groups), 'pose')}; "
        f"labelled by {'the nominal robot' if predicted is not None else 'colour or order'}",
    )
    finish(
        {"measurements": str(output), "poses": len(groups), "pictures": len(files), "spots": counts, "warnings": found.warnings}
        if as_json
        else None,
        f"wrote {output}: {', '.join(f'{name} seen in {count}' for name, count in counts.items())} of {many(len(groups), 'pose')}",
        quiet,
    )


def _lasers(arm: Robot | None, laser: list[str] | None, count: int | None) -> tuple[str, ...]:
    """Names of the lasers: the robot's, else those that were named, else numbered.

    Raises:
        UsageError: another number of lasers was stated.
    """
    names = arm.rig.lasers if arm else tuple(laser or ())
    if names and count is not None and count != len(names):
        raise UsageError(f"--lasers {count}: {'the robot has' if arm else '--laser names'} {len(names)}: {listed(names)}")
    return names or tuple(f"laser_{number}" for number in range(1, (count or 2) + 1))


def _nowhere() -> Any:
    import numpy as np

    return np.zeros((1, 2))


def require_debug(debug: Path, images: list[Path], files: list[Path], drawings: list[Path], others: tuple[Path | None, ...]) -> None:
    """Refuse a folder for drawings that cannot be new, and one where a drawing would fall on another file or be taken for a picture."""
    from urdfcal.base.whole_files import require_new_folder

    folder, above = debug.resolve(), {place.resolve() for place in images if place.is_dir()}
    if folder in {path.parent.resolve() for path in files} | above or folder.parent in above:
        raise UsageError(f"--debug {debug}: pictures are looked for there; name another folder, so that no drawing replaces or joins them")
    taken = {path.resolve() for path in (*files, *others) if path is not None}
    for place in drawings:
        if place.resolve() in taken or drawings.count(place) > 1:
            what = "another file of this command" if place.resolve() in taken else "another drawing"
            raise UsageError(f"--debug {debug}: a drawing would fall on {place}, {what}; name another folder, or the pictures otherwise")
    require_new_folder(debug)


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


def _predicted(arm: Robot, table: Table, rows: list[int]) -> tuple[Array3, tuple[str, ...]]:
    """Spots of the nominal robot in the poses' order, and what is odd about the joints' positions."""
    from urdfcal.sensors.column_names import as_people_write
    from urdfcal.sensors.joint_columns import JointColumns
    from urdfcal.vision.render.pictures import nominal_spots

    named = as_people_write(table, arm)
    joints = JointColumns(named, arm)
    odd = (*named.notes, *joints.warnings())
    return nominal_spots(arm, joints.positions[rows]).spots, odd
