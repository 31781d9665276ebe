"""What the panel of the view says: every kind of mark in words that need no manual, with a box that hides it, and a table of distances."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from urdfcal.base.geometry import MM
from urdfcal.base.terminal import many
from urdfcal.output.view.cameras import CAMERA
from urdfcal.output.view.instruments import SHEET as INSTRUMENT_SHEET
from urdfcal.output.view.key_frames import Rows
from urdfcal.output.view.marks import CALIBRATED, ERROR, MEASURED, NOMINAL, PLANE
from urdfcal.output.view.scene import MarkGroup, Scene
from urdfcal.output.view.screen import FAINT_OPACITY, FAINT_WIDTH, FINE, GRID, MISSING, SHEET, beam_colour

BEAM = 3.0  # [px] width of a beam


@dataclass(frozen=True)
class Swatch:
    """The little picture of a row.

    Attributes:
        shape: Which one the template draws.
        colour: Its colour, or that of its lines.
        fill: What is between the lines.
        opacity: 1 is opaque.
        width: Of a line, [px].
        dashes: Of a line, as SVG has them.
        turn: How far it is turned, [deg].
        colours: Where there are several.
    """

    shape: str
    colour: str = ""
    fill: str = ""
    opacity: float = 1.0
    width: float = BEAM
    dashes: str = ""
    turn: int = 0
    colours: tuple[str, ...] = ()


@dataclass(frozen=True)
class Layer:
    """One row of the legend: a picture, words, and the paths in the scene that its box hides."""

    swatch: Swatch
    words: str
    paths: tuple[str, ...]
    shown: bool = True


def layers(scene: Scene) -> list[Layer]:
    """What is in this scene, in the order of the legend."""
    both = scene.calibrated is not None
    calibrated = "robot, calibrated" if scene.bent is None else "robot, calibrated, with its compensation"
    found = [Layer(Swatch("robot", "#8b95a1"), calibrated if both else "robot, as its URDF has it", ("solid",))]
    if both:
        found.append(Layer(Swatch("robot", css(NOMINAL), opacity=0.4), f"robot, uncalibrated, {_shared(scene)}", ("nominal",)))
    axes = tuple(f"frames/{number}" for number in range(len(scene.frames)))
    found.append(Layer(Swatch("triad"), f"frame{'s' if len(axes) > 1 else ''} of {', '.join(scene.frames)}", axes))
    if scene.camera is not None:
        found.append(Layer(Swatch("camera", css(CAMERA)), "camera, and how far it sees to the sides", (f"{scene.camera.frame}/camera",)))
    found += _instrument_layers(scene)
    for frame, group in scene.groups.items():
        found += _screen_layers(scene, both) if frame == "screen" else _frame_layers(scene, group)
        found += _mark_layers(group, both, scene.planned is not None)
        found += _axes_layers(group, len(scene.data) > 1)
    return found


def _instrument_layers(scene: Scene) -> list[Layer]:
    """Each of several instruments: its frame, and what it is beside that."""
    found = []
    for own in scene.instruments:
        where = f"frame of {own.name}" if own.name == own.link else f"frame of {own.name}, fixed to {own.link}"
        if not own.with_marks:
            found.append(Layer(Swatch("triad"), where, (f"{own.path}/axes",)))
        if own.camera is not None:
            sees = f"camera {own.name}, and how far it sees to the sides"
            found.append(Layer(Swatch("camera", css(CAMERA)), sees, (f"{own.path}/camera",)))
        if len(own.spots):
            line = Swatch("line", css(INSTRUMENT_SHEET), width=1.4)
            found.append(Layer(line, f"sheet of {own.name}, about its spots", (f"{own.path}/sheet",)))
    return found


def _shared(scene: Scene) -> str:
    """What stands at the same place for both robots."""
    if "screen" in scene.groups:
        return "before the same screen"
    reference = scene.solid.rig.base
    return "on the same base" if reference == scene.solid.tree.root else f"with the same {reference}"


def _screen_layers(scene: Scene, both: bool) -> list[Layer]:
    """The sheet and the beams."""
    lasers = scene.data.lasers

    def paths(name: str) -> tuple[str, ...]:
        return tuple(f"screen/pose/{name}_{laser + 1}" for laser in range(len(lasers)))

    squares = f"{scene.sheet.pitch / MM:g} and {scene.sheet.pitch / FINE / MM:g} mm"
    found = [Layer(Swatch("screen", css(GRID), css(SHEET)), f"screen, squares of {squares}", ("screen/sheet",))]
    colours = tuple(css(beam_colour(laser)) for laser in range(min(len(lasers), 2)))
    found.append(Layer(Swatch("beams", colours=colours), f"beams: {', '.join(lasers)}", paths("beam")))
    if both:
        faint = Swatch("line", css(NOMINAL), opacity=FAINT_OPACITY, width=FAINT_WIDTH * BEAM)
        found.append(Layer(faint, "beams, uncalibrated", paths("nominal_beam")))
    missing = paths("beam_missing") + (paths("nominal_beam_missing") if both else ())
    found.append(Layer(Swatch("line", css(MISSING), dashes="5 3"), "beam that misses the screen", missing))
    if len(scene.data) > 1:
        found.append(Layer(Swatch("line", css(beam_colour(0)), width=1), "beams of all poses", ("screen/beams",), shown=False))
    return found


def _frame_layers(scene: Scene, group: MarkGroup) -> list[Layer]:
    """The measuring frame, and what targets are measured from and against."""
    instrument = scene.solid.rig.instruments.every[scene.placed[-1].drawn_frame]
    name = f"frame of {instrument.name}" if instrument.name != instrument.link else "measuring frame"
    words = f"{name}, fixed to {instrument.link}" if instrument.placed else f"frame of {instrument.link}"
    own = instrument.link in scene.frames and not instrument.placed  # drawn with the robot's frames
    found = [] if own else [Layer(Swatch("triad"), words, tuple(f"frame/marks/frame_{axis}" for axis in "xyz"))]
    if any(mark.normals is not None for mark in group.marks):
        found.append(Layer(Swatch("robot", css(PLANE), opacity=0.6), "planes that were touched", ("frame/marks/planes",)))
    lines = sorted({mark.sensor.line for mark in group.marks if mark.sensor.line})
    if lines:
        looked = tuple(f"frame/pose/line_{index + 1}" for index in group.moving if group.marks[index].start is not None)
        found.append(Layer(Swatch("line", css(MISSING), width=1.4), " and ".join(lines), looked))
    return found


def _mark_layers(group: MarkGroup, both: bool, planned: bool) -> list[Layer]:
    """What was read, where robots have it, and the errors."""
    numbers = [index + 1 for index in group.moving if group.marks[index].is_point]
    if not numbers:
        return []

    def paths(name: str) -> tuple[str, ...]:
        return (f"{group.frame}/marks/{name}", *(f"{group.frame}/pose/{name}_{number}" for number in numbers))

    what, shape, turn = ("spot", "ring", 0) if group.frame == "screen" else ("target", "cross", 45)
    words = "; ".join(dict.fromkeys(mark.sensor.mark for mark in group.marks if mark.is_point))
    who = "uncalibrated robot" if both else "URDF"
    if planned and not both:  # all of these are at one place
        every = (path for name in ("measured", "nominal", "error") for path in paths(name))
        return [Layer(Swatch("disc", css(MEASURED)), f"{what}, planned", tuple(every))]
    words = f"{what}, planned" if planned else words
    measured = [Layer(Swatch("disc", css(MEASURED)), words, paths("measured"))]
    predicted = [Layer(Swatch(shape, css(NOMINAL)), f"{what}, predicted by the {who}", paths("nominal"))]
    shift = []
    if both:
        calibrated = Swatch(shape, css(CALIBRATED), turn=turn)
        predicted.append(Layer(calibrated, f"{what}, predicted by the calibrated robot", paths("calibrated")))
        shift = [Layer(Swatch("line", css(NOMINAL), width=1), "error, uncalibrated, true length", (f"{group.frame}/marks/shift",))]
    length = f"{group.magnification:g} times longer" if group.magnification != 1 else "true length"
    error = Layer(Swatch("arrow", css(ERROR)), f"error{', calibrated' if both else ''}, {length}", paths("error"))
    return [*measured, *predicted, *shift, error] if not np.isnan(group.read).all() else predicted


def _axes_layers(group: MarkGroup, several: bool) -> list[Layer]:
    """The measured axes of orientations."""
    turned = tuple(f"{group.frame}/pose/axes_{index + 1}" for index in group.moving if group.marks[index].axes is not None)
    if not turned:
        return []
    every = Layer(Swatch("triad"), "measured axes of all poses", (f"{group.frame}/marks/axes",), shown=False)
    return [Layer(Swatch("triad"), "measured axes", turned), *([every] if several else [])]


@dataclass(frozen=True)
class ErrorRow:
    """One row of the table: what is read, and its mean errors over all poses, in words."""

    name: str
    means: tuple[str, ...]


@dataclass(frozen=True)
class ErrorTable:
    """How far measured and predicted are apart.

    Attributes:
        title: Of the table.
        unit: Of all rows; the empty string where each has its own, which stands behind its name.
        groups: Headings over the phases.
        phases: Before and after calibration, or the one there is.
        rows: One for each kind of mark.
    """

    title: str
    unit: str
    groups: tuple[str, ...]
    phases: tuple[str, ...]
    rows: tuple[ErrorRow, ...]


@dataclass(frozen=True)
class Panel:
    """What stands beside the scene.

    Attributes:
        title: The robot's name.
        about: What there is to see, in a line.
        choice: Whether there are poses to choose from.
        errors: None where nothing was measured.
        layers: Rows of the legend.
    """

    title: str
    about: str
    choice: bool
    errors: ErrorTable | None
    layers: tuple[Layer, ...]


def panel_of(scene: Scene, shown: int) -> Panel:
    """The panel of a scene of which `shown` poses are animated."""
    n, measured = len(scene.data), not scene.data.empty
    about = f"{n} poses, {_count(scene)}" if measured else f"{many(n, 'pose')}, nothing measured"
    about = about if scene.planned is None else f"{many(n, 'planned pose')}, nothing measured yet"
    told = scene.planned is None or scene.calibrated is not None  # else all errors are zero
    if shown < n:
        about += f"; {shown} of the poses can be stepped through"
    return Panel(scene.robot.name, about, n > 1, _errors(scene) if measured and told else None, tuple(layers(scene)))


def _count(scene: Scene) -> str:
    return f"{int(scene.data.seen.sum())} measured spots" if scene.data.only_spots else scene.data.summary


def pose_entries(scene: Scene, rows: Rows) -> list[dict[str, object]]:
    """Label and errors of every animated pose, as words."""
    return [
        {
            "label": _label(scene, int(row)),
            "errors": [[_number(phase[row]) for phase in compared.phases] for compared in scene.compared],
        }
        for row in rows
    ]


def _label(scene: Scene, row: int) -> str:
    mark = " (test)" if scene.data.sets[row] == "test" else ""
    return f"{scene.data.poses[row]}{mark}"


def _errors(scene: Scene) -> ErrorTable:
    several = len(scene.data) > 1
    what = "measured" if scene.planned is None else "planned"
    units = {compared.unit for compared in scene.compared}
    common = units.pop() if len(units) == 1 else ""
    rows = (
        ErrorRow(
            compared.name if common else f"{compared.name}, {compared.unit}",
            tuple(_number(mean) for mean in compared.means) if several else (),
        )
        for compared in scene.compared
    )
    return ErrorTable(
        f"Distance from {what} to predicted spot" if scene.data.only_spots else f"From {what} to predicted",
        common,
        ("this pose", "mean of all") if several else ("this pose",),
        ("before", "after") if scene.calibrated is not None else ("error",),
        tuple(rows),
    )


def _number(error: float) -> str:
    return "–" if not np.isfinite(error) else f"{error:.3f}" if error < 0.1 else f"{error:.2f}" if error < 10 else f"{error:.1f}"


def css(colour: int) -> str:
    """A colour as style sheets have it."""
    return f"#{colour:06x}"
