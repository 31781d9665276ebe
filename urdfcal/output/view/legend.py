"""The legend of the view: every kind of mark with its picture, in words that need no manual, and a box that hides it.

The little pictures of the legend.
"""

from __future__ import annotations

from dataclasses import dataclass
from html import escape

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

BEAM = 3  # [px] width of a beam


@dataclass(frozen=True)
class Layer:
    """One row of the legend: a picture, words, and the paths in the scene that its box hides."""

    swatch: str
    words: str
    paths: tuple[str, ...]
    shown: bool = True


def layers(scene: Scene) -> list[Layer]:
    """What is in this scene, in the order of the legend."""
    both = scene.calibrated is not None
    found = [Layer(box("#8b95a1"), "robot, calibrated" if both else "robot, as its URDF has it", ("solid",))]
    if both:
        found.append(Layer(box(css(NOMINAL), 0.4), f"robot, uncalibrated, {_shared(scene)}", ("nominal",)))
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
    found = [Layer(grid(), f"screen, squares of {squares}", ("screen/sheet",))]
    paths = _pose_paths(scene, "beam")
    found.append(Layer(beams(len(names)), f"beams: {', '.join(names)}", paths))
    if both:
        faint = line(css(NOMINAL), FAINT_WIDTH * BEAM, opacity=FAINT_OPACITY)
        found.append(Layer(faint, "beams, uncalibrated", _pose_paths(scene, "nominal_beam")))
    missing = _pose_paths(scene, "beam_missing") + (_pose_paths(scene, "nominal_beam_missing") if both else ())
    found.append(Layer(line(css(MISSING), BEAM, "5 3"), "beam that misses the screen", missing))
    if len(scene.data) > 1:
        found.append(Layer(line(css(beam_colour(0)), 1), "beams of all poses", ("screen/beams",), shown=False))
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
    found = [Layer(triad(), f"measuring frame, fixed to {link}" if placed else f"frame of {link}", frame)]
    if "plane" in kinds:
        found.append(Layer(box("#8fb8de", 0.6), "planes that were touched", ("frame/marks/planes",)))
    if (placed and {"point", "pixel"} & set(kinds)) or "distance" in kinds:
        words = " and ".join(word for kind, word in (("point", "line of sight"), ("distance", "wire")) if kind in kinds) or "line of sight"
        lines = tuple(f"frame/pose/line_{number}" for number in numbers)
        found.append(Layer(line(css(MISSING), 1.4), words, lines))
    if numbers:
        words = "; ".join(_READ[kind] for kind in kinds if kind in _READ)
        found.append(Layer(disc(css(MEASURED)), words, paths("measured")))
        who = "uncalibrated robot" if both else "URDF"
        found.append(Layer(cross(css(NOMINAL)), f"target, predicted by the {who}", paths("nominal")))
        if both:
            found.append(Layer(cross(css(CALIBRATED), 45), "target, predicted by the calibrated robot", paths("calibrated")))
            found.append(Layer(line(css(NOMINAL), 1), "error, uncalibrated, true length", ("frame/marks/shift",)))
        found.append(Layer(arrow(), f"error{', calibrated' if both else ''}, {_length(scene.target_magnification)}", paths("error")))
    if turned:
        found.append(Layer(triad(), "measured axes", tuple(f"frame/pose/axes_{number}" for number in turned)))
        if len(scene.data) > 1:
            found.append(Layer(triad(), "measured axes of all poses", ("frame/marks/axes",), shown=False))
    return found


def _length(times: float) -> str:
    return f"{times:g} times longer" if times != 1 else "true length"


def _spot_layers(scene: Scene, measured: bool, both: bool) -> list[Layer]:
    def paths(name: str) -> tuple[str, ...]:
        return (f"screen/spots/{name}", *_pose_paths(scene, name))

    found = []
    if measured:
        found.append(Layer(disc(css(MEASURED)), "spot, measured", paths("measured")))
    found.append(Layer(ring(css(NOMINAL)), "spot, predicted by the " + ("uncalibrated robot" if both else "URDF"), paths("nominal")))
    if both:
        found.append(Layer(ring(css(CALIBRATED)), "spot, predicted by the calibrated robot", paths("calibrated")))
    if measured and both:
        found.append(Layer(line(css(NOMINAL), 1), "error, uncalibrated, true length", ("screen/spots/shift",)))
    if measured:
        found.append(Layer(arrow(), f"error{', calibrated' if both else ''}, {_length(scene.magnification)}", paths("error")))
    return found


def _pose_paths(scene: Scene, name: str) -> tuple[str, ...]:
    return tuple(f"screen/pose/{name}_{laser + 1}" for laser in range(len(scene.data.lasers)))


def panel_html(scene: Scene, shown: int) -> str:
    """The panel: title, legend, and a table of distances; `shown` poses are animated."""
    n, measured = len(scene.data), not scene.data.empty
    about = f"{n} poses, {_count(scene)}" if measured else f"{n} {'pose' if n == 1 else 'poses'}, nothing measured"
    if shown < n:
        about += f"; {shown} of the poses can be stepped through"
    rows = "".join(
        f'<label>{layer.swatch}<span>{escape(layer.words)}</span><input type="checkbox" data-paths="{escape(" ".join(layer.paths))}"'
        f"{' checked' if layer.shown else ''}></label>"
        for layer in layers(scene)
    )
    return (
        f'<div id="panel"><h1>{escape(scene.robot.name)}</h1><button id="fold" title="fold or unfold">&#8722;</button><p>{about}</p>'
        f"{_pose_rows() if n > 1 else ''}{_table(scene) if measured else ''}<h2>What you see</h2>{rows}"
        '<div id="hint">The large marks belong to the pose shown. Drag to turn, wheel to zoom, right button to shift; '
        "play and slider are under Animations.</div></div>"
    )


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


def _pose_rows() -> str:
    buttons = [
        f'<button id="{name}" title="{title}">&#{sign};</button>'
        for name, title, sign in (("back", "pose before", 9664), ("next", "next pose", 9654))
    ]
    return f'<h2>Pose</h2><div id="steps">{buttons[0]}<select id="pose">%POSES%</select>{buttons[1]}</div>'


def _table(scene: Scene) -> str:
    names = ["before", "after"] if scene.calibrated is not None else ["error"]
    groups = ("this pose", "mean of all") if len(scene.data) > 1 else ("this pose",)
    titles = "".join(f'<th colspan="{len(names)}">{group}</th>' for group in groups)
    heads = "".join(f"<th>{name}</th>" for name in names) * len(groups)
    body = ""
    for row, compared in enumerate(scene.compared):
        cells = "".join(f'<td id="error-{row}-{phase}"></td>' for phase in range(len(names)))
        if len(groups) > 1:
            cells += "".join(f"<td>{_number(mean)}</td>" for mean in compared.means)
        unit = f", {compared.unit}" if compared.unit != "mm" else ""
        body += f"<tr><th>{escape(compared.name)}{unit}</th>{cells}</tr>"
    head = f"<thead><tr><th></th>{titles}</tr><tr><th></th>{heads}</tr></thead>"
    what = "From measured to predicted" if scene.targets else "Distance from measured to predicted spot"
    return f"<h2>{what} in mm</h2><table>{head}<tbody>{body}</tbody></table>"


def _number(error: float) -> str:
    return "–" if not np.isfinite(error) else f"{error:.3f}" if error < 0.1 else f"{error:.2f}" if error < 10 else f"{error:.1f}"


def css(colour: int) -> str:
    """A colour as style sheets have it."""
    return f"#{colour:06x}"


def svg(content: str) -> str:
    """A picture of the size of a line of the legend."""
    return f'<svg viewBox="0 0 26 18" aria-hidden="true">{content}</svg>'


def box(colour: str, opacity: float = 1.0) -> str:
    """A robot, or a sheet."""
    return svg(f'<path d="M5 15V8l8-5 8 5v7h-5v-5h-6v5z" fill="{colour}" opacity="{opacity}"/>')


def grid() -> str:
    """The screen."""
    return svg(
        f'<rect x="4" y="1" width="18" height="16" fill="{css(SHEET)}" stroke="{css(GRID)}"/>'
        f'<path d="M10 1v16M16 1v16M4 6.3h18M4 11.6h18" stroke="{css(GRID)}"/>'
    )


def line(colour: str, width: float, dashes: str = "", opacity: float = 1.0) -> str:
    """A line, dashed on request."""
    return svg(f'<path d="M1 14L25 4" stroke="{colour}" stroke-width="{width:g}" stroke-dasharray="{dashes}" opacity="{opacity}"/>')


def beams(count: int) -> str:
    """One beam or two, in their lasers' colours, the first one above."""
    lines = (
        f'<path d="M1 {9 + 5 * k}L25 {3 + 5 * k}" stroke="{css(beam_colour(k))}" stroke-width="{BEAM}"/>' for k in range(min(count, 2))
    )
    return svg("".join(lines))


def disc(colour: str) -> str:
    """A measured mark."""
    return svg(f'<circle cx="13" cy="9" r="5" fill="{colour}"/>')


def ring(colour: str) -> str:
    """A predicted spot."""
    return svg(f'<circle cx="13" cy="9" r="6" fill="none" stroke="{colour}" stroke-width="2.4"/>')


def arrow() -> str:
    """An error."""
    return svg(f'<path d="M2 9h15" stroke="{css(ERROR)}" stroke-width="2.4"/><path d="M16 4l8 5-8 5z" fill="{css(ERROR)}"/>')


def cross(colour: str, turn: int = 0) -> str:
    """A predicted target, turned by degrees."""
    return svg(f'<path d="M13 3v12M7 9h12" stroke="{colour}" stroke-width="2.6" transform="rotate({turn} 13 9)"/>')


def triad() -> str:
    """A frame."""
    bars = (("#d0342c", "M11 12h11"), ("#2e9e3f", "M11 12V2"), ("#2f5fd0", "M11 12L4 17"))
    return svg("".join(f'<path d="{path}" stroke="{colour}" stroke-width="2"/>' for colour, path in bars))
