"""`urdfcal simulate`: measurements of robots whose errors are known."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Annotated, Any

import typer

from urdfcal.base.errors import UsageError
from urdfcal.cli.console import finish, say, warn
from urdfcal.cli.help import EXPERT, OurCommand
from urdfcal.cli.inputs import load
from urdfcal.cli.measured import camera_of, require_boards, rig_file_of, stations_of, with_board
from urdfcal.cli.notes import about, listed
from urdfcal.cli.options import (
    RIG,
    BoardLink,
    Json,
    Lasers,
    NoiseShape,
    Overwrite,
    PackageDirs,
    Payloads,
    Quiet,
    Reference,
    RobotFile,
    Screen,
    Seed,
    Verbose,
    XacroArgs,
    XacroLimits,
)
from urdfcal.cli.places import (
    MEASUREMENTS,
    STDOUT,
    beside,
    deliver,
    folder_of,
    named,
    require_ending,
    require_no_json,
    require_places,
    stated_place,
)
from urdfcal.cli.stated import stated_area

if TYPE_CHECKING:
    from urdfcal.calibration.rig_file import RigFile
    from urdfcal.cli.simulated_files import Simulator
    from urdfcal.robot.robot import Robot
    from urdfcal.sensors.columns import Stations

_MOST_POSES, _MOST_PLACES, _MOST_ROBOTS = 100_000, 1000, 10_000  # more take all memory, and nobody measures so many


class SimulateCommand(OurCommand):
    """A command whose help lists the sensors that there are; they are looked up when it is asked for, since that takes its time."""

    def format_help(self, *given: Any) -> None:
        """Write the help."""
        from urdfcal.simulation.setup import SENSOR_KINDS

        *most, last = (kind for kind in SENSOR_KINDS if kind != "laser")
        for option in self.params:
            if (words := getattr(option, "help", None)) is not None:
                option.help = words.replace("{sensors}", f"{', '.join(most)} or {last}")  # type: ignore[attr-defined]
        super().format_help(*given)


def simulate(
    robot: RobotFile,
    output: Annotated[
        Path,
        typer.Option(
            "-o",
            "--output",
            metavar="CSV",
            parser=stated_place,
            help="Measurements; the truth goes to <stem>_truth.yaml beside them. A folder for <robot>_simulated.csv in it, - for stdout, "
            "without the truth. With --robots a new folder.",
            show_default=False,
        ),
    ],
    poses: Annotated[int, typer.Option(min=1, max=_MOST_POSES, help="How many poses.")] = 60,
    test_poses: Annotated[int, typer.Option(min=0, max=_MOST_POSES, help="Further poses, marked as test in a 'set' column.")] = 0,
    robots: Annotated[
        int | None,
        typer.Option(
            min=1,
            max=_MOST_ROBOTS,
            help="A fleet: so many robots with errors of their own, seeds counted on from --seed. -o is then a new folder, and its "
            "manifest.csv is one for urdfcal fleet.",
            show_default=False,
        ),
    ] = None,
    seed: Seed = 0,
    spot_noise_mm: Annotated[float, typer.Option(help="Noise of a spot coordinate in mm.")] = 1.0,
    joint_noise_deg: Annotated[float, typer.Option(help="Noise of a joint reading in deg.")] = 0.0,
    noise: Annotated[
        NoiseShape,
        typer.Option(help="What a noise is: a standard deviation (gaussian), or half the width (uniform).", rich_help_panel=EXPERT),
    ] = NoiseShape.GAUSSIAN,
    errors: Annotated[
        str,
        typer.Option(
            metavar="MM,DEG|YAML",
            help="Sigma of random errors in six directions of every joint, mount and screen, or a file with stated errors.",
        ),
    ] = "2mm,0.2deg",
    sag_mrad: Annotated[
        float,
        typer.Option(
            help="Sigma of each joint's sag about its own axis, in mrad at its largest gravity moment, the way that it is pulled.",
            rich_help_panel=EXPERT,
        ),
    ] = 0.0,
    sag_across_mrad: Annotated[float, typer.Option(help="The same about the two axes across it, in mrad.", rich_help_panel=EXPERT)] = 0.0,
    eccentricity_mrad: Annotated[
        float, typer.Option(help="Sigma of sin q, cos q, sin 2q and cos 2q in each joint's reading, in mrad.", rich_help_panel=EXPERT)
    ] = 0.0,
    gravity: Annotated[
        str | None,
        typer.Option(
            metavar="X,Y,Z",
            help="Direction of gravity's pull in the root link. Default: 0,0,-1.",
            show_default=False,
            rich_help_panel=EXPERT,
        ),
    ] = None,
    payload: Payloads = None,
    screen_size_m: Annotated[
        str | None,
        typer.Option(
            metavar="W[,H]",
            help="Size of the screen along y and z in m, centred on its link. Default: as the URDF draws it, else 3.",
            show_default=False,
            rich_help_panel=EXPERT,
        ),
    ] = None,
    sensor: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KIND:LINK[@INSTRUMENT]",
            help="What measures: laser (the robot's; laser:LINK@SCREEN for one on a named screen), or {sensors} of a target on LINK, "
            "several on one link as LINK:LABEL, by one of several instruments (a link, or a name in rig.yaml) as LINK@INSTRUMENT; "
            "repeatable, they are mixed. Default: the boards of --board and --rig by every camera, else laser.",
            show_default=False,
        ),
    ] = None,
    target_noise_mm: Annotated[
        float, typer.Option(help="Noise in mm of a point's coordinate and of a distance, and how far a touch is off.")
    ] = 0.1,
    orientation_noise_deg: Annotated[
        float, typer.Option(help="Noise of an orientation about each axis in deg.", rich_help_panel=EXPERT)
    ] = 0.02,
    camera: Annotated[
        Path | None,
        typer.Option(
            "--camera",
            metavar="YAML",
            help="Lens that pixels are read with; it stands where it sees much. Default: a usual one, written to <stem>_camera.yaml.",
            show_default=False,
            rich_help_panel=RIG,
        ),
    ] = None,
    rig: Annotated[
        Path | None,
        typer.Option(
            "--rig", metavar="YAML", help="rig.yaml: which links are boards, and the reference.", show_default=False, rich_help_panel=RIG
        ),
    ] = None,
    board: BoardLink = None,
    pixel_noise_px: Annotated[float, typer.Option(help="Noise of a corner in a picture in px.")] = 0.2,
    places: Annotated[
        int,
        typer.Option(min=1, max=_MOST_PLACES, help="How many planes, and sockets, a target touches in turn.", rich_help_panel=EXPERT),
    ] = 4,
    reference: Reference = None,
    reference_known: Annotated[
        bool,
        typer.Option(
            "--reference-known",
            help="Measure from the reference link itself, not from a frame that stands anywhere.",
            rich_help_panel=EXPERT,
        ),
    ] = False,
    target_known: Annotated[
        bool,
        typer.Option(
            "--target-known",
            help="Measure the targets' links themselves, not something that sits anywhere on them.",
            rich_help_panel=EXPERT,
        ),
    ] = False,
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
    """Simulate measurements of a robot with stated or random errors."""
    from urdfcal.calibration.reach import screen_area
    from urdfcal.cli.simulated_files import Simulator
    from urdfcal.robot.configurations import require_room, without_room
    from urdfcal.simulation.readings import reading_noise
    from urdfcal.simulation.setup import parse_sensors, seen_with
    from urdfcal.simulation.truth import sag_scales

    require_no_json(as_json, output)
    rig_file = with_board(rig_file_of(rig, reference_known, target_known), board)
    arm = load(robot, xacro_arg, package_dir, screen, laser, rig_file, xacro_limit=xacro_limit, quiet=quiet)
    require_boards(arm, rig_file)
    boards, stations = rig_file.grids(), stations_of(arm, rig_file)
    sensors, lasers = parse_sensors(sensor or _boards_seen(boards, stations) or ["laser"], arm, places, boards, stations)
    pictured = any(own.by_camera and own.instrument not in stations.cameras for own in sensors)
    _require_use_of(camera, pictured, output)
    inputs = (robot, rig, camera, *rig_file.cameras(), None if "," in errors else Path(errors))
    place = _folder_place(output) if robots is not None else _files_place(arm, output, pictured and camera is None, inputs, overwrite)
    read_with = reading_noise(spot_noise_mm, joint_noise_deg, noise.value, target_noise_mm, orientation_noise_deg, pixel_noise_px)
    soft = sag_scales(sag_mrad, sag_across_mrad, eccentricity_mrad, gravity, payload or ())
    lens = _usual_lens() if pictured and camera is None else camera_of(camera)
    if sensors:
        arm = seen_with(arm, sensors, reference or rig_file.reference or "", lasers, boards, stations)
    area = stated_area(screen_size_m) or screen_area(arm)
    say(verbose, about(arm))
    require_room(arm)
    held = without_room(arm)
    warn([f"{held}, so they stand still in all poses"] if held else [], quiet)
    sizes = {"spot_mm": spot_noise_mm} if lasers or any(own.aimed for own in sensors) else {}
    sizes |= {"target_mm": target_noise_mm, "orientation_deg": orientation_noise_deg} if sensors else {}
    sizes |= {"pixel_px": pixel_noise_px} if any(own.by_camera for own in sensors) else {}
    bent = {"sag_mrad": sag_mrad, "sag-across_mrad": sag_across_mrad, "eccentricity_mrad": eccentricity_mrad} if soft else {}
    simulator = Simulator(
        arm,
        errors,
        (poses, test_poses),
        read_with,
        sensors,
        lasers,
        area,
        rig_file,
        stations,
        lens=lens,
        soft=soft,
        sizes={**sizes, "joint_deg": joint_noise_deg},
        bent=bent,
        distribution=noise.value,
    )
    if robots is None:
        _one(simulator, place, seed, camera, rig, as_json, quiet)
        return
    fitted = rig_file.model_copy(update={"screen": screen or rig_file.screen, "lasers": laser or rig_file.lasers})
    bends = [word for own in payload or () for word in ("--payload", own)] + (["--gravity", gravity] if gravity else [])
    _fleet(simulator, place, range(seed, seed + robots), fitted, bends, as_json, quiet)


def _files_place(arm: Robot, output: Path, lens: bool, inputs: tuple[Path | None, ...], overwrite: bool) -> Path:
    """Where measurements are to be written, with truth and lens beside them.

    Raises:
        UsageError: something of another kind is there, or it is an input.
    """
    from urdfcal.base.files import sha256
    from urdfcal.output.replaced import require_marked

    output = named(output, f"{arm.description.stem}_simulated.csv")
    require_ending("-o", output, MEASUREMENTS, "a file of measurements")
    written = {output: ("SIMULATED", "urdfcal simulate")}
    if output != STDOUT:
        written[beside(output, "truth")] = ("SIMULATED", sha256(arm.description.text))
    if lens:
        written[beside(output, "camera")] = ("# A camera", "simulated: true")
    require_places(*written, inputs=inputs)
    if not overwrite:
        for place, marks in written.items():
            require_marked(place, marks, "result of urdfcal simulate for this robot")
    return output


def _folder_place(output: Path) -> Path:
    """Where a fleet is to be written.

    Raises:
        UsageError: it can be no new folder.
    """
    from urdfcal.base.whole_files import require_new_folder

    if output == STDOUT or output.suffix.lower() in MEASUREMENTS[:-1]:
        raise UsageError(f"-o {output}: --robots makes a folder with a file of measurements a robot; name one, such as -o fleet/")
    folder = folder_of(output)
    require_new_folder(folder)
    return folder


def _one(simulator: Simulator, output: Path, seed: int, camera: Path | None, rig: Path | None, as_json: bool, quiet: bool) -> None:
    """One robot: its measurements, truth and lens."""
    from urdfcal.base.terminal import many

    lens_file = beside(output, "camera") if simulator.lens is not None and camera is None else None
    made = simulator.made(seed, lens_file or camera, rig)
    truth_file = None if output == STDOUT else beside(output, "truth")
    files: dict[str | Path, bytes] = {truth_file: made.truth} if truth_file else {}
    files |= {lens_file: _lens_yaml(simulator.lens)} if lens_file else {}
    count = many(made.poses, "simulated pose")
    deliver({**files, output: made.measurements})
    told = f"wrote {listed([f'{output} ({count})', *files])}" if files else f"{count}; the truth is not kept"
    machine = {"measurements": str(output), "truth": str(truth_file), "poses": made.poses, "random_poses": made.looked}
    machine |= {"camera": str(lens_file)} if lens_file else {}
    finish(machine if as_json else None, "\n".join([told, *made.again]), quiet)


def _fleet(simulator: Simulator, folder: Path, seeds: range, rig: RigFile, bends: list[str], as_json: bool, quiet: bool) -> None:
    """Robots of one model, and the manifest that `urdfcal fleet` takes."""
    from urdfcal.base.terminal import many
    from urdfcal.base.whole_files import folder_whole
    from urdfcal.cli.console import ProgressBar
    from urdfcal.cli.simulated_fleet import MANIFEST, SimulatedFleet

    fleet = SimulatedFleet(simulator, rig, tuple(bends), None if simulator.lens is None else _lens_yaml(simulator.lens))
    with folder_whole(folder) as inside, ProgressBar("simulating", len(seeds), quiet or as_json) as advance:
        poses = fleet.write(inside, seeds, advance)
    manifest = folder / MANIFEST
    machine = {"folder": str(folder), "manifest": str(manifest), "robots": len(seeds), "poses": poses}
    told = f"wrote {folder}: {many(len(seeds), 'simulated robot')} of {many(poses, 'pose')} each"
    following = f"next: urdfcal fleet {quote(str(manifest))} -o {quote(f'{folder}_fitted')}"
    finish(machine if as_json else None, f"{told}\n{following}", quiet)


def _boards_seen(boards: Iterable[str], stations: Stations) -> list[str]:
    """The sensors that read all boards, by every camera that is named."""
    return [f"pixels:{link}{at}" for at in [f"@{name}" for name in stations.cameras] or [""] for link in boards]


def _usual_lens() -> Any:
    """The lens to try things with where there is none."""
    from urdfcal.vision.render.usual_camera import usual_lens

    return usual_lens()


def _lens_yaml(lens: Any) -> bytes:
    """The same as a file."""
    from urdfcal.vision.camera.camera_file import camera_yaml

    return camera_yaml(lens, {"simulated": True})


def _require_use_of(camera: Path | None, pictured: bool, output: Path) -> None:
    """Refuse a camera that has nothing to read, and one that nobody would know of.

    Raises:
        UsageError: what to ask for.
    """
    if camera is not None and not pictured:
        raise UsageError(f"--camera {camera}: nothing is read by it; name a board with --board or --rig, or --sensor pixels:LINK")
    if pictured and camera is None and output == STDOUT:
        raise UsageError("-o -: the camera of these pixels would not be kept; name its lens with --camera YAML, or a file with -o")
