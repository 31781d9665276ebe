"""`urdfcal render`: the pictures that a camera would have taken."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from urdfcal.base.errors import UsageError, did_you_mean
from urdfcal.cli.console import ProgressBar, finish, say, warn
from urdfcal.cli.inputs import load, with_calibration
from urdfcal.cli.notes import about
from urdfcal.cli.options import Json, Lasers, Overwrite, PackageDirs, Quiet, RobotFile, Screen, Seed, Verbose, XacroArgs, XacroLimits
from urdfcal.cli.places import deliver, require_places
from urdfcal.cli.stated import positive, stated_area

if TYPE_CHECKING:
    from urdfcal.base.geometry import Matrix
    from urdfcal.base.tables import Table
    from urdfcal.robot.robot import Robot
    from urdfcal.sensors.camera import Camera
    from urdfcal.vision.camera.markers import ScreenMarkers
    from urdfcal.vision.render.pictures import LitSpots


_COLOURS = ("red", "green", "blue")
_SMALL_PX = 1.0


def render(
    robot: RobotFile,
    poses: Annotated[
        Path, typer.Argument(metavar="POSES", help="CSV of joint columns; spots in it are shown, else the robot's own.", show_default=False)
    ],
    output: Annotated[
        Path, typer.Option("-o", "--output", metavar="DIR", help="Folder for the pictures and truth.csv.", show_default=False)
    ],
    camera: Annotated[
        Path | None,
        typer.Option(
            metavar="YAML",
            help="Lens and screen, from urdfcal camera. Default: one that sees spots and --markers; DIR/camera.yaml says which.",
            show_default=False,
        ),
    ] = None,
    calibrated: Annotated[
        Path | None,
        typer.Option(
            metavar="YAML", help="Show the spots of the robot with this calibration, or truth of a simulation.", show_default=False
        ),
    ] = None,
    markers: Annotated[Path | None, typer.Option(metavar="YAML", help="screen.yaml: markers on the screen.", show_default=False)] = None,
    colours: Annotated[str, typer.Option(metavar="red|green|blue,...", help="Each laser's colour; one word for all.")] = "red",
    spot_mm: Annotated[float, typer.Option(help="Diameter of a beam at 1/e^2 in mm.")] = 4.0,
    brightness: Annotated[float, typer.Option(help="Of a spot's peak, of the sensor's full scale; above 1 it clips.")] = 0.9,
    halo: Annotated[float, typer.Option(help="Height of the glow around a spot, of its brightness, 0 to 1.")] = 0.02,
    light: Annotated[float, typer.Option(help="Room light on the screen, of full scale, 0 to 1.")] = 0.25,
    gradient: Annotated[float, typer.Option(help="Change of the room light from the screen's middle to its edge, 0 to 1.")] = 0.3,
    glare: Annotated[int, typer.Option(min=0, max=100, help="Lamps, glints, streaks and lens reflections a picture.")] = 0,
    missing: Annotated[float, typer.Option(help="Share of the spots left out, 0 to 1.")] = 0.0,
    frames: Annotated[int, typer.Option(min=1, max=100, help="Pictures a pose, named <pose>_<n>.")] = 1,
    tone: Annotated[bool, typer.Option("--tone", help="Apply the sRGB curve, as in pictures for people.")] = False,
    mosaic: Annotated[bool, typer.Option("--mosaic", help="One colour a pixel, the rest interpolated, as in most cameras.")] = False,
    dark: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Also write a picture with the lasers off (.png).", show_default=False)
    ] = None,
    screen_size_m: Annotated[
        str | None,
        typer.Option(
            metavar="W[,H]",
            help="Size of the screen along y and z in m; beams beside it make no spot. Default: as the URDF draws it, else 3, and they do.",
            show_default=False,
        ),
    ] = None,
    overwrite: Overwrite = False,
    seed: Seed = 0,
    screen: Screen = None,
    laser: Lasers = None,
    xacro_arg: XacroArgs = None,
    xacro_limit: XacroLimits = None,
    package_dir: PackageDirs = None,
    as_json: Json = False,
    quiet: Quiet = False,
    verbose: Verbose = False,
) -> None:
    """Make the pictures that a camera would have taken of the spots; simulated, for trying the whole line without hardware."""
    import numpy as np

    from urdfcal.base.tables import read_table
    from urdfcal.base.terminal import many
    from urdfcal.base.whole_files import folder_whole, require_new_folder
    from urdfcal.output.replaced import require_same
    from urdfcal.robot.sheet import ScreenArea, stated_sheet
    from urdfcal.sensors.column_names import as_people_write
    from urdfcal.vision.camera.camera_file import camera_yaml, read_camera
    from urdfcal.vision.camera.markers import read_screen_markers
    from urdfcal.vision.render.image_sensor import ImageSensor
    from urdfcal.vision.render.light import Beam, Lighting
    from urdfcal.vision.render.pictures import Studio, pictures, png, truth_csv
    from urdfcal.vision.render.usual_camera import usual_camera

    arm = load(robot, xacro_arg, package_dir, screen, laser, xacro_limit=xacro_limit, quiet=quiet)
    say(verbose, about(arm))
    words = [word.strip() for word in colours.split(",")]
    for word in words:
        if word not in _COLOURS:
            raise UsageError(f"--colours {colours}: no laser colour '{word}'{did_you_mean(word, _COLOURS)}")
    words = words * len(arm.rig.lasers) if len(words) == 1 else words
    if len(words) != len(arm.rig.lasers):
        raise UsageError(f"--colours {colours}: {len(words)} colours for {len(arm.rig.lasers)} lasers")
    if dark is not None and dark.suffix.lower() != ".png":
        raise UsageError(f"--dark {dark}: ends in '{dark.suffix}', expected .png")
    for name, share in {"--halo": halo, "--light": light, "--gradient": gradient, "--missing": missing}.items():
        if not 0 <= share <= 1:
            raise UsageError(f"{name} {share:g}: expected a number from 0 to 1")
    diameter = (positive("--spot-mm", spot_mm) or 4.0) * 1e-3
    look = Beam(words[0], diameter / 4, positive("--brightness", brightness) or 0.9, halo)
    table = as_people_write(read_table(poses, "a column a joint", "one row a pose"), arm)
    (meant, odd), area = _beams(arm, poses, table, calibrated), stated_area(screen_size_m) or stated_sheet(arm)
    beams = meant.within(area) if area else meant
    layout = read_screen_markers(markers) if markers else None
    view = usual_camera(beams.spots.reshape(-1, 2), _corners(layout)) if camera is None else read_camera(camera)
    if layout is not None and layout.side != view.side:
        raise UsageError(f"{markers}: side {layout.side}, but {camera or 'the camera without --camera'} looks from the {view.side}")
    studio = Studio(
        view,
        [Beam(word, look.width, look.brightness, look.halo) for word in words],
        Lighting(light, gradient, screen=area or ScreenArea()),
        ImageSensor(tone=tone, mosaic=mosaic),
        layout,
        glare,
        missing,
        frames,
    )
    view.spots_of_pixels(np.zeros((1, 2)))  # refuses a camera without a screen
    require_new_folder(output)
    require_places(*([dark] if dark else []), inputs=(robot, poses, camera, calibrated, markers))
    names = _names(table.columns.get("pose", [str(number) for number in range(1, len(table) + 1)]))
    shown: list[np.ndarray[tuple[int], np.dtype[np.bool_]]] = []
    unlit: dict[str | Path, bytes] = {}
    with folder_whole(output) as folder, ProgressBar("rendering", len(names) * frames, quiet or as_json) as advance:
        if camera is None:
            made_by = {"made_by": "urdfcal render: a camera that sees the spots; none was calibrated"}
            (folder / "camera.yaml").write_bytes(camera_yaml(view, made_by))
        for shot in pictures(studio, beams, np.random.default_rng(seed), dark is not None):
            if shot.pose < 0 and dark is not None:
                unlit = {dark: png(shot.pixels)}
                if not overwrite:
                    require_same(unlit)
                continue
            name = f"{names[shot.pose]}_{shot.frame}.png" if frames > 1 else f"{names[shot.pose]}.png"
            (folder / name).write_bytes(png(shot.pixels))
            if shot.frame == 1:
                shown.append(shot.shown)
            advance()
        (folder / "truth.csv").write_bytes(truth_csv(names, arm.rig.lasers, view, beams, shown))
        deliver(unlit)
    count = int(np.sum(shown))
    warn([*odd, *_unshown(meant, beams, view, count), *_too_small(beams, view, diameter)], quiet)
    beside = "truth.csv" if camera is not None else "truth.csv and camera.yaml"
    finish(
        {"folder": str(output), "pictures": len(names) * frames, "spots": count} if as_json else None,
        f"wrote {many(len(names) * frames, 'simulated picture')} with {many(count, 'spot')}, and {beside}, to {output}",
        quiet,
    )


def _beams(arm: Robot, poses: Path, table: Table, calibrated: Path | None) -> tuple[LitSpots, tuple[str, ...]]:
    """Spots and directions: those of the file where it has any, else the robot's; and what is odd about the joints' positions."""
    from urdfcal.sensors.joint_columns import JointColumns
    from urdfcal.sensors.measurements_csv import read_measurements
    from urdfcal.vision.render.pictures import LitSpots, nominal_spots

    joints = JointColumns(table, arm)
    odd = (*table.notes, *joints.warnings())
    shown = with_calibration(arm, calibrated, quiet=True) if calibrated else arm
    if calibrated is None and any(f"{laser}.y" in table.names for laser in arm.rig.lasers):
        data = read_measurements(poses, arm)
        return LitSpots(data.spots, nominal_spots(arm, data.q).direction), odd
    return nominal_spots(shown, joints.positions), odd


def _corners(layout: ScreenMarkers | None) -> Matrix | None:
    """Corners (k, 2) of all the markers, [m]."""
    import numpy as np

    return None if layout is None else np.vstack([layout.corners_of(marker)[:, 1:] for marker in layout.centres])


def _unshown(meant: LitSpots, beams: LitSpots, view: Camera, count: int) -> list[str]:
    """A warning about spots that no picture shows: the robot's, those on the screen, and how many are shown."""
    from urdfcal.vision.render.pictures import in_picture

    inside = int(in_picture(view, beams.spots.reshape(-1, 2)).sum())
    lost = {"beside the screen": meant.count - beams.count, "outside of the picture": beams.count - inside, "left out": inside - count}
    told = [f"{number} {where}" for where, number in lost.items() if number]
    return [f"not shown of {meant.count} spots: {', '.join(told)}"] if told else []


def _too_small(beams: LitSpots, view: Camera, diameter: float) -> list[str]:
    """A warning about spots that hardly a pixel shows."""
    import numpy as np

    from urdfcal.vision.render.pictures import in_picture, widths_px

    spots = beams.spots.reshape(-1, 2)
    widths = widths_px(view, spots[in_picture(view, spots)], diameter)
    small = widths[np.isfinite(widths) & (widths < _SMALL_PX)]
    if not len(small):
        return []
    return [
        f"{len(small)} of {len(widths)} spots are under {_SMALL_PX:g} px wide (down to {small.min():.2g} px) and will hardly be found; "
        "the camera is far away; look from nearer with --camera, or widen the beam with --spot-mm"
    ]


def _names(labels: list[str]) -> list[str]:
    """Names of pictures, one a pose."""
    from urdfcal.vision.pictures import picture_name

    names = [picture_name(label) for label in labels]
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise UsageError(f"two poses would both be the picture '{twice}.png'; give them different labels in the column 'pose'")
    return names
