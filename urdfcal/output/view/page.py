"""The page: meshcat's viewer, the scene as its commands and the legend in one file, seen from where the robot hides few of the marks."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np
import pinocchio as pin

from urdfcal.base.errors import RobotError
from urdfcal.base.geometry import DEG, SE3, Mask, Matrix, Vector
from urdfcal.output.templates import filled_template
from urdfcal.output.view.cameras import draw_camera
from urdfcal.output.view.drawn_shapes import draw_shapes
from urdfcal.output.view.instruments import draw_instruments
from urdfcal.output.view.key_frames import KeyFrames, Rows, SetClips, key_frames
from urdfcal.output.view.legend import panel_of, pose_entries
from urdfcal.output.view.marks import NOMINAL, FlatStyle, RoundStyle, Style, draw_frame, draw_marks, draw_pose_marks, draw_triad, frame_axes
from urdfcal.output.view.meshes import on_screen, seen_through
from urdfcal.output.view.motion import draw_motion
from urdfcal.output.view.placed import frame_placements, link_placements, screen_placements
from urdfcal.output.view.recorder import VIEWER_SCRIPT, Recorder
from urdfcal.output.view.scene import Frame, Scene
from urdfcal.output.view.screen import Sheet, draw_all_beams, draw_pose_beams, draw_sheet
from urdfcal.output.view.shapes import Shapes
from urdfcal.robot.configurations import whole_configurations
from urdfcal.robot.robot import Robot

_MOST_PLACES = 100  # of the lasers and the sheet that the camera has to hold
_NEAR_FRAME = 1.2  # widths of the marks; a measuring frame that is farther from all of them need not be in the picture
_GHOST_OPACITY = 0.3
_FRAME = 0.07  # length of the axes of links over the extent of the robot
_FARTHEST = 1e5  # [m] from the root
_LIGHTS = {"AmbientLight": 0.5, "FillLight": 0.22, "PointLightNegativeX": 0.3, "PointLightPositiveX": 0.3}  # white stays below white

_AZIMUTHS = tuple(angle * DEG for angle in (-60, -50, -40, -30, 30, 40, 50, 60))  # from the screen's normal
_ELEVATIONS = tuple(angle * DEG for angle in (14, 22, 32))
_THICK = 0.09  # [m] from the robot's middle within which it hides what is behind
_DISTANCE = 3.0  # times the size of the scene: the camera's distance while we choose
_PREFERRED = 42 * DEG  # neither along the screen, where spots are slim, nor along the beams, which are not seen then


def page_of(scene: Scene, shapes: Shapes) -> str:
    """The whole scene as one page that needs no network."""
    keys = key_frames(scene)
    config = {"poses": pose_entries(scene, keys.rows), "ghost": _ghost(scene, shapes), "sight": _sight(scene, shapes, keys.solid[0])}
    return filled_template(
        "urdfcal.output.view",
        "view.html.j2",
        panel=panel_of(scene, len(keys.rows)),
        config=config,
        scene=_drawn(scene, shapes, keys).packed(),
        meshcat=VIEWER_SCRIPT.read_text("utf-8"),
    )


def _drawn(scene: Scene, shapes: Shapes, keys: KeyFrames) -> Recorder:
    recorder = Recorder()
    tab = recorder.visualizer()
    tab["/Background"].set_property("top_color", [1.0, 1.0, 1.0])
    tab["/Background"].set_property("bottom_color", [0.88, 0.9, 0.92])
    for own in ("/Grid", "/Axes"):
        tab[own].set_property("visible", False)
    for light, intensity in _LIGHTS.items():
        tab[f"/Lights/{light}/<object>"].set_property("intensity", intensity)
    draw_shapes(tab["solid/visuals"], shapes)
    styles: dict[Frame, Style] = {frame: FlatStyle(scene.side) if frame == "screen" else RoundStyle() for frame in scene.groups}
    for frame, group in scene.groups.items():
        draw_marks(tab[f"{frame}/marks"], group, styles[frame])
        draw_pose_marks(tab[f"{frame}/pose"], group, styles[frame])
    if "screen" in scene.groups:
        _draw_screen(tab["screen"], scene)
    if "frame" in scene.groups:
        draw_frame(tab["frame/marks"], scene.groups["frame"], scene.placed[-1].planes)
    length = _axes_length(shapes.corners(scene.solid, whole_configurations(scene.solid, keys.solid[:1])[0]))
    for number in range(len(scene.frames)):
        draw_triad([tab[f"frames/{number}/{axis}"] for axis in "xyz"], length, 0.06 * length, seen_through)
    if scene.camera is not None:
        draw_camera(tab[f"{scene.camera.frame}/camera"], scene.camera, _camera_depth(scene, length, scene.camera.frame))
    if scene.instruments:
        draw_instruments(tab, scene.instruments, 1.5 * _camera_depth(scene, length, "frame"))
    for seen in (own for own in scene.instruments if not own.with_marks):
        draw_triad([tab[f"{seen.path}/axes/{axis}"] for axis in "xyz"], 1.5 * length, 0.09 * length, seen_through)
    clips = draw_motion(tab, scene, shapes, keys, styles)
    if len(keys.rows) > 1:
        recorder.send(SetClips(clips))
    return recorder


def _axes_length(corners: Matrix) -> float:
    """How long the axes of links are, [m], on a robot of these corners."""
    return _FRAME * float(np.ptp(corners, axis=0).max())


def _camera_depth(scene: Scene, length: float, frame: Frame) -> float:
    """How deep the pyramid of a camera is drawn, [m]: as long as a frame's axes, and not beyond what it looks at."""
    return min(1.5 * length, 0.5 * scene.groups[frame].size)


def _draw_screen(node: Any, scene: Scene) -> None:
    """The sheet and the beams."""
    draw_sheet(node["sheet"], scene.sheet, scene.side)
    draw_all_beams(node["beams"], scene.shown, scene.lands(scene.shown))
    draw_pose_beams(node["pose"], "beam", len(scene.data.lasers), scene.extent)
    if scene.calibrated is not None:
        draw_pose_beams(node["pose"], "nominal_beam", len(scene.data.lasers), scene.extent, NOMINAL)


def _ghost(scene: Scene, shapes: Shapes) -> dict[str, Any]:
    names = [shape.name for shape in shapes.model.geometryObjects] if scene.calibrated is not None else []
    return {"names": names, "color": NOMINAL, "opacity": _GHOST_OPACITY}


def _sight(scene: Scene, shapes: Shapes, q: Matrix) -> dict[str, Any]:
    """Where to look from, and what the picture is to hold: the robot in the first pose, the sheet, lasers and targets in all."""
    whole = whole_configurations(scene.solid, q[None])
    rows = np.arange(0, len(scene.data), 1 + len(scene.data) // _MOST_PLACES)
    every = whole_configurations(scene.solid, scene.bent_data.q[rows])
    robot = shapes.corners(scene.solid, whole[0])
    _require_near(scene, robot)
    targets = _targets_in_root(scene, rows, every)
    if "screen" in scene.groups:
        normal, seen, spots = _screen_in_root(scene, rows, every)
    else:
        middle = (targets if len(targets) else robot).mean(axis=0)
        normal, seen, spots = middle - _base(scene.solid, whole[0]), [], targets
    axes = [_in_root(link_placements(scene.solid, link, whole)[0], _axes_length(robot) * np.eye(3)) for link in scene.frames]
    points = np.unique(np.round(np.concatenate([robot, *axes, *seen, targets, *_camera_in_root(scene, whole, q)]), 3), axis=0)
    direction = choose_direction(normal, spots, _skeleton(scene.solid, whole[0]), points)
    return {"direction": direction.tolist(), "points": points.tolist()}


def _camera_in_root(scene: Scene, whole: Matrix, q: Vector) -> list[Matrix]:
    """Where cameras and other instruments stand in the first pose, if there are any."""
    if scene.camera is None:
        return [frame_placements(scene.placed[-1], whole, q[None], own.frame)[0].translation[None] for own in scene.instruments]
    there = screen_placements(scene.solid, whole) if scene.camera.frame == "screen" else frame_placements(scene.placed[-1], whole, q[None])
    return [(there[0] * scene.camera.T_frame_camera).translation[None]]


def _require_near(scene: Scene, corners: Matrix) -> None:
    if not (np.abs(corners) < _FARTHEST).all():
        raise RobotError(
            f"the robot reaches beyond {_FARTHEST / 1e3:g} km, and cannot be drawn; expected origins of joints in metres",
            scene.solid.description.label,
        )


def _screen_in_root(scene: Scene, rows: Rows, every: Matrix) -> tuple[Vector, list[Matrix], Matrix]:
    """Normal of the screen towards the lasers, what belongs to it at some poses, and the spots."""
    placed = screen_placements(scene.solid, every)
    corners, sources, group = _with_numbers(scene.sheet), scene.shown.source, scene.groups["screen"]
    seen = [_in_root(T, np.concatenate([corners, sources[row]])) for T, row in zip(placed, rows, strict=True)]
    read = group.read[~np.isnan(group.read[:, 0])]
    spots = _in_root(placed[0], read if len(read) else on_screen(scene.shown.spots[scene.shown.meets_plainly]))
    return placed[0].rotation[:, 0] * scene.side, seen, spots


def _targets_in_root(scene: Scene, rows: Rows, every: Matrix) -> Matrix:
    """Where targets were read at some poses, and the measuring frame where it is near, (k, 3)."""
    group = scene.groups.get("frame")
    if group is None:
        return np.empty((0, 3))
    found = []
    for T, row in zip(frame_placements(scene.placed[-1], every, scene.bent_data.q[rows]), rows, strict=True):
        own = np.array([mark.read[row] for mark in group.marks if not np.isnan(mark.read[row, 0])]).reshape(-1, 3)
        near = np.linalg.norm(own, axis=1) < _NEAR_FRAME * group.size
        seen = near.any() or (scene.camera is not None and scene.camera.frame == "frame")
        found.append(_in_root(T, np.concatenate([own, *([np.zeros((1, 3)), frame_axes(group)] if seen else [])])))
    return np.concatenate(found)


def _with_numbers(sheet: Sheet) -> Matrix:
    """The corners of the sheet with the numbers along its edges, (4, 3), in screen axes, [m]."""
    (left, low), (right, high) = sheet.low - 0.1 * sheet.size, sheet.high + np.array([0.01, 0.09]) * sheet.size
    return np.array([[0.0, y, z] for y in (left, right) for z in (low, high)])


def _in_root(T_root_screen: SE3, points: Matrix) -> Matrix:
    return np.asarray(points @ T_root_screen.rotation.T + T_root_screen.translation)


def _base(robot: Robot, q: Vector) -> Vector:
    """Where the first moving joint stands."""
    return np.asarray(_skeleton(robot, q)[0])


def _skeleton(robot: Robot, q: Matrix) -> Matrix:
    data = robot.model.createData()
    pin.forwardKinematics(robot.model, data, q)
    joints = [robot.model.getJointId(step.joint.name) for step in robot.chain.moving]
    return np.asarray([data.oMi[joint].translation for joint in joints])


def choose_direction(normal: Vector, spots: Matrix, skeleton: Matrix, points: Matrix) -> Vector:
    """Look from the lasers' side of the screen and a little from above.

    Args:
        normal: Of the screen, towards the lasers, in the root's axes.
        spots: (s, 3), [m]: what should not be hidden.
        skeleton: Line through the robot, (k, 3), [m].
        points: What is to be in the picture, (n, 3), [m].

    Returns:
        Unit vector from the scene to the camera.
    """
    up = np.array([0.0, 0.0, 1.0])
    front = normal - up * (normal @ up)
    front = front / np.linalg.norm(front) if np.linalg.norm(front) > 0.1 else np.array([1.0, 0.0, 0.0])
    across = np.cross(up, front)
    size = float(np.ptp(points, axis=0).max())
    best, found = -np.inf, front
    for azimuth in _AZIMUTHS:
        for elevation in _ELEVATIONS:
            flat = np.cos(azimuth) * front + np.sin(azimuth) * across
            direction = np.cos(elevation) * flat + np.sin(elevation) * up
            eye = points.mean(axis=0) + _DISTANCE * size * direction
            open_share = 1.0 - float(np.mean(_hidden(eye, spots, skeleton))) if len(spots) else 1.0
            score = open_share - 1.0 * (abs(azimuth) - _PREFERRED) ** 2 - 0.2 * (elevation - _ELEVATIONS[1]) ** 2
            if score > best + 1e-9:
                best, found = score, direction
    return found


def _hidden(eye: Vector, spots: Matrix, skeleton: Matrix) -> Mask:
    """Which spots lie behind the robot, (s,)."""
    line = np.concatenate([np.linspace(a, b, 12) for a, b in pairwise(skeleton)] or [skeleton])
    rays = spots - eye
    along = np.einsum("sj,kj->sk", rays, line - eye) / np.sum(rays**2, axis=1)[:, None]
    off = np.linalg.norm((line - eye)[None] - along[..., None] * rays[:, None], axis=-1)
    return np.asarray(((off < _THICK) & (along < 1)).any(axis=1))
