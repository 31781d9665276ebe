"""The legend of the view: every kind of mark with its picture, in words that need no manual, and a box that hides it."""

from __future__ import annotations

from dataclasses import dataclass
from html import escape

import numpy as np

from urdfcal.geometry import MM, Matrix
from urdfcal.key_frames import Rows
from urdfcal.scene import FINE, Scene
from urdfcal.scene_marks import CALIBRATED, ERROR, GRID, MEASURED, MISSING, NOMINAL, SHEET, beam_colour


@dataclass(frozen=True)
class Layer:
    """One row of the legend: a picture, words, and the paths in the scene that its box hides."""

    swatch: str
    words: str
    paths: tuple[str, ...]
    shown: bool = True


def layers(scene: Scene) -> list[Layer]:
    """What is in this scene, in the order of the legend."""
    both, names = scene.calibrated is not None, scene.data.lasers
    found = [Layer(_box("#8b95a1"), "robot, calibrated" if both else "robot, as its URDF has it", ("solid",))]
    if both:
        found.append(Layer(_box(_css(NOMINAL), 0.4), "robot, uncalibrated, before the same screen", ("nominal",)))
    squares = f"{scene.sheet.pitch / MM:g} and {scene.sheet.pitch / FINE / MM:g} mm"
    found.append(Layer(_grid(), f"screen, squares of {squares}", ("screen/sheet",)))
    paths = _pose_paths(scene, "beam")
    found.append(Layer(_beams(len(names)), f"beams: {', '.join(names)}", paths))
    if both:
        found.append(Layer(_line(_css(NOMINAL), 2), "beams, uncalibrated", _pose_paths(scene, "nominal_beam")))
    missing = _pose_paths(scene, "beam_missing") + (_pose_paths(scene, "nominal_beam_missing") if both else ())
    found.append(Layer(_line(_css(MISSING), 3, "5 3"), "beam that misses the screen", missing))
    if len(scene.data) > 1:
        found.append(Layer(_line(_css(beam_colour(0)), 1), "beams of all poses", ("screen/beams",), shown=False))
    return found + _spot_layers(scene, bool(scene.data.seen.any()), both)


def _spot_layers(scene: Scene, measured: bool, both: bool) -> list[Layer]:
    def paths(name: str) -> tuple[str, ...]:
        return (f"screen/spots/{name}", *_pose_paths(scene, name))

    found = []
    if measured:
        found.append(Layer(_disc(_css(MEASURED)), "spot, measured", paths("measured")))
    found.append(Layer(_ring(_css(NOMINAL)), "spot, predicted by the " + ("uncalibrated robot" if both else "URDF"), paths("nominal")))
    if both:
        found.append(Layer(_ring(_css(CALIBRATED)), "spot, predicted by the calibrated robot", paths("calibrated")))
    if measured and both:
        found.append(Layer(_line(_css(NOMINAL), 1), "error, uncalibrated, true length", ("screen/spots/shift",)))
    if measured:
        length = f"{scene.magnification:g} times longer" if scene.magnification != 1 else "true length"
        found.append(Layer(_arrow(), f"error{', calibrated' if both else ''}, {length}", paths("error")))
    return found


def _pose_paths(scene: Scene, name: str) -> tuple[str, ...]:
    return tuple(f"screen/pose/{name}_{laser + 1}" for laser in range(len(scene.data.lasers)))


def panel_html(scene: Scene, shown: int) -> str:
    """The panel: title, legend, and a table of distances; `shown` poses are animated."""
    n, spots = len(scene.data), int(scene.data.seen.sum())
    about = f"{n} poses, {spots} measured spots" if spots else f"{n} {'pose' if n == 1 else 'poses'}, nothing measured"
    if shown < n:
        about += f"; {shown} of the poses can be stepped through"
    rows = "".join(
        f'<label>{layer.swatch}<span>{escape(layer.words)}</span><input type="checkbox" data-paths="{escape(" ".join(layer.paths))}"'
        f"{' checked' if layer.shown else ''}></label>"
        for layer in layers(scene)
    )
    return (
        f'<div id="panel"><h1>{escape(scene.robot.name)}</h1><button id="fold" title="fold or unfold">&#8722;</button><p>{about}</p>'
        f"{_pose_rows() if n > 1 else ''}{_table(scene) if spots else ''}<h2>What you see</h2>{rows}"
        '<div id="hint">The large marks belong to the pose shown. Drag to turn, wheel to zoom, right button to shift; '
        "play and slider are under Animations.</div></div>"
    )


def pose_entries(scene: Scene, rows: Rows) -> list[dict[str, object]]:
    """Label and distances in mm of every animated pose, as words."""
    phases = [scene.errors_mm(beams)[rows] for beams in (scene.before, scene.after) if beams is not None]
    return [
        {
            "label": _label(scene, int(row)),
            "errors": [[_millimetres(phase[index, laser]) for phase in phases] for laser in range(len(scene.data.lasers))],
        }
        for index, row in enumerate(rows)
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
    phases = [("before", scene.before), ("after", scene.after)] if scene.after else [("error", scene.before)]
    groups = ("this pose", "mean of all") if len(scene.data) > 1 else ("this pose",)
    titles = "".join(f'<th colspan="{len(phases)}">{group}</th>' for group in groups)
    heads = "".join(f"<th>{name}</th>" for name, _ in phases) * len(groups)
    body = ""
    for laser, name in enumerate(scene.data.lasers):
        cells = "".join(f'<td id="error-{laser}-{phase}"></td>' for phase in range(len(phases)))
        if len(groups) > 1:
            cells += "".join(f"<td>{_mean(scene.errors_mm(beams)[:, laser])}</td>" for _, beams in phases if beams)
        body += f"<tr><th>{escape(name)}</th>{cells}</tr>"
    head = f"<thead><tr><th></th>{titles}</tr><tr><th></th>{heads}</tr></thead>"
    return f"<h2>Distance from measured to predicted spot in mm</h2><table>{head}<tbody>{body}</tbody></table>"


def _mean(errors: Matrix) -> str:
    return _millimetres(float(np.nanmean(errors))) if np.isfinite(errors).any() else "–"


def _millimetres(error: float) -> str:
    return "–" if not np.isfinite(error) else f"{error:.2f}" if error < 10 else f"{error:.1f}"


def _css(colour: int) -> str:
    return f"#{colour:06x}"


def _svg(content: str) -> str:
    return f'<svg viewBox="0 0 26 18" aria-hidden="true">{content}</svg>'


def _box(colour: str, opacity: float = 1.0) -> str:
    return _svg(f'<path d="M5 15V8l8-5 8 5v7h-5v-5h-6v5z" fill="{colour}" opacity="{opacity}"/>')


def _grid() -> str:
    return _svg(
        f'<rect x="4" y="1" width="18" height="16" fill="{_css(SHEET)}" stroke="{_css(GRID)}"/>'
        f'<path d="M10 1v16M16 1v16M4 6.3h18M4 11.6h18" stroke="{_css(GRID)}"/>'
    )


def _line(colour: str, width: float, dashes: str = "") -> str:
    return _svg(f'<path d="M1 14L25 4" stroke="{colour}" stroke-width="{width}" stroke-dasharray="{dashes}"/>')


def _beams(count: int) -> str:
    lines = (f'<path d="M1 {14 - 5 * k}L25 {8 - 5 * k}" stroke="{_css(beam_colour(k))}" stroke-width="3"/>' for k in range(min(count, 2)))
    return _svg("".join(lines))


def _disc(colour: str) -> str:
    return _svg(f'<circle cx="13" cy="9" r="5" fill="{colour}"/>')


def _ring(colour: str) -> str:
    return _svg(f'<circle cx="13" cy="9" r="6" fill="none" stroke="{colour}" stroke-width="2.4"/>')


def _arrow() -> str:
    return _svg(f'<path d="M2 9h15" stroke="{_css(ERROR)}" stroke-width="2.4"/><path d="M16 4l8 5-8 5z" fill="{_css(ERROR)}"/>')
