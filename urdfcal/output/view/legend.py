"""What the panel of the view says: every kind of mark in words that need no manual, with a box that hides it, and a table of distances."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from urdfcal.base.geometry import MM
from urdfcal.output.view.key_frames import Rows
from urdfcal.output.view.marks import CALIBRATED, ERROR, FAINT_OPACITY, FAINT_WIDTH, GRID, MEASURED, MISSING, NOMINAL, SHEET, beam_colour
from urdfcal.output.view.scene import FINE, Scene

_READ = {  # what the balls are
    "point": "point, measured",
    "pixel": "target, on the ray of its pixel",
    "socket": "socket, where its touches meet",
    "plane": "touch, on its plane",
    "distance": "target, at the measured distance",
}

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
    found = [Layer(Swatch("robot", "#8b95a1"), "robot, calibrated" if both else "robot, as its URDF has it", ("solid",))]
    if both:
        found.append(Layer(Swatch("robot", css(NOMINAL), opacity=0.4), f"robot, uncalibrated, {_shared(scene)}", ("nominal",)))
    return found + (_laser_layers(scene, both) if scene.data.lasers else []) + (_target_layers(scene, both) if scene.targets else [])


def _shared(scene: Scene) -> str:
    """What stands at the same place for both robots."""
    if scene.data.lasers:
        return "before the same screen"
    reference = scene.solid.rig.screen
    return "on the same base" if reference == scene.solid.tree.root else f"with the same {reference}"


def _laser_layers(scene: Scene, both: bool) -> list[Layer]:
    names = scene.data.lasers
    squares = f"{scene.sheet.pitch / MM:g} and {scene.sheet.pitch / FINE / MM:g} mm"
    found = [Layer(Swatch("screen", css(GRID), css(SHEET)), f"screen, squares of {squares}", ("screen/sheet",))]
    colours = tuple(css(beam_colour(laser)) for laser in range(min(len(names), 2)))
    paths = _pose_paths(scene, "beam")
    found.append(Layer(Swatch("beams", colours=colours), f"beams: {', '.join(names)}", paths))
    if both:
        faint = Swatch("line", css(NOMINAL), opacity=FAINT_OPACITY, width=FAINT_WIDTH * BEAM)
        found.append(Layer(faint, "beams, uncalibrated", _pose_paths(scene, "nominal_beam")))
    missing = _pose_paths(scene, "beam_missing") + (_pose_paths(scene, "nominal_beam_missing") if both else ())
    found.append(Layer(Swatch("line", css(MISSING), dashes="5 3"), "beam that misses the screen", missing))
    if len(scene.data) > 1:
        found.append(Layer(Swatch("line", css(beam_colour(0)), width=1), "beams of all poses", ("screen/beams",), shown=False))
    return found + _spot_layers(scene, bool(scene.data.seen.any()), both)


def _target_layers(scene: Scene, both: bool) -> list[Layer]:
    numbers = [index + 1 for index in scene.moving if scene.marks[index].is_point]
    turned = [index + 1 for index in scene.moving if not scene.marks[index].is_point]

    def paths(name: str) -> tuple[str, ...]:
        return (f"frame/marks/{name}", *(f"frame/pose/{name}_{number}" for number in numbers))

    kinds = dict.fromkeys(mark.kind for mark in scene.marks)
    frame = tuple(f"frame/marks/frame_{axis}" for axis in "xyz")
    link = scene.solid.rig.instruments.reference
    placed = scene.solid.rig.instruments.placed
    found = [Layer(Swatch("triad"), f"measuring frame, fixed to {link}" if placed else f"frame of {link}", frame)]
    if "plane" in kinds:
        found.append(Layer(Swatch("robot", "#8fb8de", opacity=0.6), "planes that were touched", ("frame/marks/planes",)))
    if (placed and {"point", "pixel"} & set(kinds)) or "distance" in kinds:
        words = " and ".join(word for kind, word in (("point", "line of sight"), ("distance", "wire")) if kind in kinds) or "line of sight"
        lines = tuple(f"frame/pose/line_{number}" for number in numbers)
        found.append(Layer(Swatch("line", css(MISSING), width=1.4), words, lines))
    if numbers:
        words = "; ".join(_READ[kind] for kind in kinds if kind in _READ)
        found.append(Layer(Swatch("disc", css(MEASURED)), words, paths("measured")))
        who = "uncalibrated robot" if both else "URDF"
        found.append(Layer(Swatch("cross", css(NOMINAL)), f"target, predicted by the {who}", paths("nominal")))
        if both:
            found.append(Layer(Swatch("cross", css(CALIBRATED), turn=45), "target, predicted by the calibrated robot", paths("calibrated")))
            found.append(Layer(Swatch("line", css(NOMINAL), width=1), "error, uncalibrated, true length", ("frame/marks/shift",)))
        found.append(
            Layer(
                Swatch("arrow", css(ERROR)), f"error{', calibrated' if both else ''}, {_length(scene.target_magnification)}", paths("error")
            )
        )
    if turned:
        found.append(Layer(Swatch("triad"), "measured axes", tuple(f"frame/pose/axes_{number}" for number in turned)))
        if len(scene.data) > 1:
            found.append(Layer(Swatch("triad"), "measured axes of all poses", ("frame/marks/axes",), shown=False))
    return found


def _length(times: float) -> str:
    return f"{times:g} times longer" if times != 1 else "true length"


def _spot_layers(scene: Scene, measured: bool, both: bool) -> list[Layer]:
    def paths(name: str) -> tuple[str, ...]:
        return (f"screen/spots/{name}", *_pose_paths(scene, name))

    found = []
    if measured:
        found.append(Layer(Swatch("disc", css(MEASURED)), "spot, measured", paths("measured")))
    found.append(
        Layer(Swatch("ring", css(NOMINAL)), "spot, predicted by the " + ("uncalibrated robot" if both else "URDF"), paths("nominal"))
    )
    if both:
        found.append(Layer(Swatch("ring", css(CALIBRATED)), "spot, predicted by the calibrated robot", paths("calibrated")))
    if measured and both:
        found.append(Layer(Swatch("line", css(NOMINAL), width=1), "error, uncalibrated, true length", ("screen/spots/shift",)))
    if measured:
        found.append(
            Layer(Swatch("arrow", css(ERROR)), f"error{', calibrated' if both else ''}, {_length(scene.magnification)}", paths("error"))
        )
    return found


def _pose_paths(scene: Scene, name: str) -> tuple[str, ...]:
    return tuple(f"screen/pose/{name}_{laser + 1}" for laser in range(len(scene.data.lasers)))


@dataclass(frozen=True)
class ErrorRow:
    """One row of the table: what is read, and its mean errors over all poses, in words."""

    name: str
    means: tuple[str, ...]


@dataclass(frozen=True)
class ErrorTable:
    """How far measured and predicted are apart, in mm.

    Attributes:
        title: Of the table.
        groups: Headings over the phases.
        phases: Before and after calibration, or the one there is.
        rows: One for each kind of mark.
    """

    title: str
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
    about = f"{n} poses, {_count(scene)}" if measured else f"{n} {'pose' if n == 1 else 'poses'}, nothing measured"
    if shown < n:
        about += f"; {shown} of the poses can be stepped through"
    return Panel(scene.robot.name, about, n > 1, _errors(scene) if measured else None, tuple(layers(scene)))


def _count(scene: Scene) -> str:
    return scene.data.summary if scene.targets else f"{int(scene.data.seen.sum())} measured spots"


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
    rows = (
        ErrorRow(
            compared.name + (f", {compared.unit}" if compared.unit != "mm" else ""),
            tuple(_number(mean) for mean in compared.means) if several else (),
        )
        for compared in scene.compared
    )
    return ErrorTable(
        "From measured to predicted" if scene.targets else "Distance from measured to predicted spot",
        ("this pose", "mean of all") if several else ("this pose",),
        ("before", "after") if scene.calibrated is not None else ("error",),
        tuple(rows),
    )


def _number(error: float) -> str:
    return "–" if not np.isfinite(error) else f"{error:.3f}" if error < 0.1 else f"{error:.2f}" if error < 10 else f"{error:.1f}"


def css(colour: int) -> str:
    """A colour as style sheets have it."""
    return f"#{colour:06x}"
