"""`urdfcal simulate`: measurements of robots whose errors are known."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from urdfcal.base.errors import UsageError
from urdfcal.cli.console import finish, say, warn
from urdfcal.cli.help import EXPERT, OurCommand
from urdfcal.cli.inputs import (
    about,
    camera_of,
    listed,
    load,
    require_boards,
    rig_file_of,
    stated_area,
    stations_of,
    with_board,
)
from urdfcal.cli.options import (
    RIG,
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
from urdfcal.cli.places import MEASUREMENTS, STDOUT, deliver, named, require_ending, require_no_json, require_places, stated_place

if TYPE_CHECKING:
    from urdfcal.sensors.columns import Stations
    from urdfcal.simulation.setup import SimulatedSetup


_MOST_POSES, _MOST_PLACES = 100_000, 1000  # more take all memory, and nobody measures so many


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
            "without the truth.",
            show_default=False,
        ),
    ],
    poses: Annotated[int, typer.Option(min=1, max=_MOST_POSES, help="How many poses.")] = 60,
    test_poses: Annotated[int, typer.Option(min=0, max=_MOST_POSES, help="Further poses, marked as test in a 'set' column.")] = 0,
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
    board: Annotated[
        str | None,
        typer.Option(
            metavar="LINK=COLSxROWS:SQUARE",
            help="A link that is a board, by its INNER corners, e.g. board=9x6:25mm.",
            show_default=False,
            rich_help_panel=RIG,
        ),
    ] = None,
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
    import numpy as np

    from urdfcal.base.files import sha256
    from urdfcal.base.terminal import many
    from urdfcal.calibration.reach import screen_area
    from urdfcal.model.parameters import INSTRUMENTS
    from urdfcal.output.calibration_yaml import truth_yaml
    from urdfcal.output.replaced import require_marked
    from urdfcal.robot.configurations import require_room, without_room
    from urdfcal.robot.corrections import OriginCorrection
    from urdfcal.sensors.measurements_csv import measurements_csv
    from urdfcal.simulation.readings import reading_noise
    from urdfcal.simulation.setup import parse_sensors, seen_with
    from urdfcal.simulation.simulated import simulated_by
    from urdfcal.simulation.truth import sag_bytes, sag_scales, soft_truth, truth_of

    require_no_json(as_json, output)
    rig_file = with_board(rig_file_of(rig, reference_known, target_known), board)
    arm = load(robot, xacro_arg, package_dir, screen, laser, rig_file, xacro_limit=xacro_limit, quiet=quiet)
    require_boards(arm, rig_file)
    output = named(output, f"{arm.description.stem}_simulated.csv")
    require_ending("-o", output, MEASUREMENTS, "a file of measurements")
    boards, stations = rig_file.grids(), stations_of(arm, rig_file)
    sensors, lasers = parse_sensors(sensor or _boards_seen(boards, stations) or ["laser"], arm, places, boards, stations)
    pictured = any(own.by_camera and own.instrument not in stations.cameras for own in sensors)
    _require_use_of(camera, pictured, output)
    truth_file = None if output == STDOUT else output.parent / f"{output.stem}_truth.yaml"
    lens_file = output.parent / f"{output.stem}_camera.yaml" if pictured and camera is None else None
    written = {
        output: ("SIMULATED", "urdfcal simulate"),
        **({truth_file: ("SIMULATED", sha256(arm.description.text))} if truth_file else {}),
    }
    written |= {lens_file: ("# A camera", "simulated: true")} if lens_file else {}
    require_places(*written, inputs=(robot, rig, camera, *rig_file.cameras(), None if "," in errors else Path(errors)))
    if not overwrite:
        for place, marks in written.items():
            require_marked(place, marks, "result of urdfcal simulate for this robot")
    rng = np.random.default_rng(seed)
    read_with = reading_noise(spot_noise_mm, joint_noise_deg, noise.value, target_noise_mm, orientation_noise_deg, pixel_noise_px)
    soft = sag_scales(sag_mrad, sag_across_mrad, eccentricity_mrad, gravity, payload or ())
    lens = _usual_lens() if lens_file else camera_of(camera)
    if sensors:
        arm = seen_with(arm, sensors, reference or rig_file.reference or "", lasers, boards, stations)
    area = stated_area(screen_size_m) or screen_area(arm)
    say(verbose, about(arm))
    require_room(arm)
    held = without_room(arm)
    warn([f"{held}, so they stand still in all poses"] if held else [], quiet)
    model, x = truth_of(arm, errors, rng)
    if soft:
        model, x = soft_truth(arm, model, x, soft, rng)
    setup, found = simulated_by(
        arm,
        model,
        x,
        sensors,
        (poses, test_poses),
        rng,
        read_with,
        area=area,
        reference_known=rig_file.reference_known,
        target_known=rig_file.target_known,
        camera=lens,
        boards=boards,
        stations=stations,
    )
    model, x, data, looked = setup.errors, setup.x, found.data, found.looked
    again = _drawn_again(len(data), looked, lasers, setup)
    joints = arm.tree.joints
    corrections = {
        name: OriginCorrection(joints[name].origin, origin, joints[name].moves) for name, origin in model.corrected_origins(x).items()
    }
    spots = lasers or any(own.aimed for own in sensors)
    sizes = {"spot_mm": spot_noise_mm} if spots else {}
    sizes |= {"target_mm": target_noise_mm, "orientation_deg": orientation_noise_deg} if sensors else {}
    sizes |= {"pixel_px": pixel_noise_px} if setup.pictured else {}
    bent = {"sag_mrad": sag_mrad, "sag-across_mrad": sag_across_mrad, "eccentricity_mrad": eccentricity_mrad} if soft else {}
    stated = {"distribution": noise.value, **sizes, "joint_deg": joint_noise_deg, "seed": seed}
    comments = [
        f"SIMULATED measurements of {arm.name}, made by urdfcal simulate; no robot has been measured.",
        f"seed {seed}, {noise} noise: {_in_words({**sizes, 'joint_deg': joint_noise_deg})}; errors: {Path(errors).name}"
        + (f"; {_in_words(bent)}" if bent else ""),
        "joints in rad (m where they slide), lengths in m" + (", spots (y, z) on the screen" if spots else ""),
        *again,
        *_advice(setup, (lens_file or camera) if pictured else None, rig),
    ]
    values = {own.name: value for own, value in zip(model.parameters, x, strict=True) if own.kind not in (*INSTRUMENTS, "soft")}
    truth = truth_yaml(arm, corrections, values, sys.argv, stated) + sag_bytes(model, x)
    if sensors:
        import yaml

        truth += yaml.safe_dump({"instruments": setup.entries()}, sort_keys=False, default_flow_style=None, width=160).encode()
    files: dict[str | Path, bytes] = {truth_file: truth} if truth_file else {}
    files |= {lens_file: _lens_yaml(lens)} if lens_file else {}
    made = f"{output} ({many(len(data), 'simulated pose')})"
    deliver({**files, output: measurements_csv(data, comments)})
    finish(
        {
            "measurements": str(output),
            "truth": str(truth_file),
            "poses": len(data),
            "random_poses": looked or len(data),
            **({"camera": str(lens_file)} if lens_file else {}),
        }
        if as_json
        else None,
        "\n".join([f"wrote {listed([made, *files])}" if files else f"{many(len(data), 'simulated pose')}; the truth is not kept", *again]),
        quiet,
    )


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


def _in_words(sizes: dict[str, float]) -> str:
    """`spot 1 mm, joint 0 deg`."""
    return ", ".join("{} {:g} {}".format(name.rpartition("_")[0], size, name.rpartition("_")[2]) for name, size in sizes.items())


def _drawn_again(poses: int, looked: int, lasers: bool, setup: SimulatedSetup) -> list[str]:
    """How many random poses were passed over, and why; nothing where none was."""
    from urdfcal.simulation.sights import several

    if looked <= poses:
        return []
    wanted = [f"with every beam on the screen of {setup.area}"] if lasers else []
    wanted += ["with the beams of an arm on the screen that they name"] if any(own.aimed for own in setup.sensors) else []
    wanted += [f"with {'a' if several(setup) else 'the'} board in the picture"] if setup.pictured else []
    return [f"{looked - poses} of {looked} random poses were drawn again, for {poses} {' and '.join(wanted)}"]


def _advice(setup: SimulatedSetup, camera: Path | None, rig: Path | None) -> list[str]:
    """What a fit has to be told beyond the file: the reference link, the camera, boards, a length where only touches were made."""
    from itertools import pairwise

    import numpy as np

    instruments, lines = setup.robot.rig.instruments, []
    if any(own.placed for own in instruments.every):
        kinds = {slot.kind for slot in setup.errors.slots if slot.found}
        known = "".join(f" --{kind}-known" for kind in ("reference", "target") if kind not in kinds)
        by = "" if instruments.name else f" --reference {instruments.reference}"
        by += known + (f" --camera {camera}" if camera is not None else "") + (f" --rig {rig}" if rig else "")
        frames = " and ".join(own.name or instruments.reference for own in instruments.every)
        lines.append(f"measured from {frames}: urdfcal fit ...{by}")
    if setup.boards and setup.pictured:
        entries = ", ".join(f"{link}: '{grid}'" for link, grid in setup.boards.items())
        lines.append(f"for a rig.yaml: boards: {{{entries}}}")
    sockets = [place.name for place in instruments.places if place.name.startswith("socket:")]
    apart = {
        f"{one.removeprefix('socket:')} - {other.removeprefix('socket:')}": float(np.linalg.norm(setup.place(one) - setup.place(other)))
        for one, other in pairwise(sockets)
    }
    if apart:
        lengths = ", ".join(f"'{pair}': {length * 1e3:.3f}" for pair, length in apart.items())
        lines.append(f"true distances, for a rig.yaml: sockets: {{distances_mm: {{{lengths}}}}}")
    return lines
