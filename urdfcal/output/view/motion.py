"""How the scene moves: the robots from pose to pose, their beams with them, and the marks of the pose shown, which jump.

A node of the scene that moves stands where it is at first, and has a clip.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin

from urdfcal.base.geometry import SE3, Matrix, Vector
from urdfcal.output.view.key_frames import Clips, KeyFrames, jumps
from urdfcal.output.view.marks import PREDICTED, Style
from urdfcal.output.view.placed import frame_placements, link_placements, screen_placements
from urdfcal.output.view.scene import Frame, MarkGroup, Scene
from urdfcal.output.view.shapes import Shapes
from urdfcal.robot.configurations import whole_configurations
from urdfcal.robot.robot import Robot
from urdfcal.sensors.spots import Beams

_MISS = 0.6  # length of a beam that misses, over the size of the scene
HIDDEN = 1e-6  # scale of what is not to be seen; zero would have no inverse


def draw_motion(viewer: Any, scene: Scene, shapes: Shapes, keys: KeyFrames, styles: dict[Frame, Style]) -> Clips:
    """Put everything that moves where it is at the first pose, and give back how it goes on."""
    clips = Clips()
    whole = whole_configurations(scene.solid, keys.solid)
    T_root_screen = screen_placements(scene.solid, whole)
    _move_robot(viewer, clips, "solid", scene.solid, shapes, keys.times, whole)
    for number, link in enumerate(scene.frames):
        place(viewer, clips, f"frames/{number}", keys.times, link_placements(scene.solid, link, whole))
    if scene.calibrated is not None:
        ghost = whole_configurations(scene.robot, keys.q)
        roots = [ours * theirs.inverse() for ours, theirs in zip(T_root_screen, screen_placements(scene.robot, ghost), strict=True)]
        place(viewer, clips, "nominal", keys.times, roots)
        _move_robot(viewer, clips, "nominal", scene.robot, shapes, keys.times, ghost)
    if "screen" in scene.groups:
        place(viewer, clips, "screen", keys.times, T_root_screen)
        robots = zip(("beam", "nominal_beam"), reversed(scene.placed), (keys.solid, keys.q), strict=False)
        for name, placed, q in robots:
            _move_beams(viewer, clips, f"screen/pose/{name}", scene, placed.beams(q), keys.times)
    if "frame" in scene.groups:
        place(viewer, clips, "frame", keys.times, frame_placements(scene.placed[-1], whole, keys.solid))
    for own in scene.instruments:
        place(viewer, clips, own.path, keys.times, frame_placements(scene.placed[-1], whole, keys.solid, own.frame))
    for frame, group in scene.groups.items():
        _move_marks(viewer, clips, group, styles[frame], keys)
    return clips


def _move_robot(viewer: Any, clips: Clips, root: str, robot: Robot, shapes: Shapes, times: Vector, whole: Matrix) -> None:
    model, data = robot.model, robot.model.createData()
    geometry = shapes.on(robot)
    placed, found = geometry.createData(), []
    for q in whole:
        pin.forwardKinematics(model, data, q)
        pin.updateGeometryPlacements(model, data, geometry, placed)
        found.append([placement.copy() for placement in placed.oMg])
    for index, shape in enumerate(geometry.geometryObjects):
        place(viewer, clips, f"{root}/visuals/{shape.name}", times, [row[index] for row in found], np.array(shape.meshScale))


def _move_beams(viewer: Any, clips: Clips, path: str, scene: Scene, beams: Beams, times: Vector) -> None:
    lands = scene.lands(beams)
    for laser in range(lands.shape[1]):
        turned = turns_from_z(beams.direction[:, laser])
        ends = (
            ("", np.where(lands[:, laser], beams.length[:, laser], 0.0)),
            ("_missing", np.where(lands[:, laser], 0.0, _missing_length(scene, beams, laser))),
        )
        for suffix, length in ends:
            scale = np.where(length[:, None] > 0, np.stack([np.ones_like(length)] * 2 + [length], -1), HIDDEN)
            put(viewer, clips, f"{path}{suffix}_{laser + 1}", times, beams.source[:, laser], turned, scale)


def _missing_length(scene: Scene, beams: Beams, laser: int) -> Vector:
    """How long a beam that misses is drawn: up to the screen's plane where that is near, else some way."""
    length, usual = beams.length[:, laser], _MISS * scene.extent
    with np.errstate(invalid="ignore"):
        return np.where((length > 0) & (length < 2 * usual), length, usual)


def _move_marks(viewer: Any, clips: Clips, group: MarkGroup, style: Style, keys: KeyFrames) -> None:
    """Marks of the pose shown; they jump half way between two poses."""
    times, rows = jumps(keys)
    still = np.tile([0.0, 0.0, 0.0, 1.0], (len(rows), 1))

    def move(name: str, at: Matrix, turned: Matrix, scale: Matrix) -> None:
        put(viewer, clips, f"{group.frame}/pose/{name}", times, np.nan_to_num(at), turned, scale)

    for index in group.moving:
        mark, number = group.marks[index], index + 1
        read = mark.read[rows]
        if mark.start is not None:
            reach, ones = read - mark.start[rows], np.ones(len(rows))
            length = np.linalg.norm(reach, axis=1)
            move(f"line_{number}", mark.start[rows], turns_from_z(reach), _hidden(np.stack([ones, ones, length], -1)))
        if mark.axes is not None:
            move(f"axes_{number}", read, np.array([pin.Quaternion(own).coeffs() for own in mark.axes[rows]]), _unit(read))
        if not mark.is_point:
            continue
        predicted = [group.shifted(phase, index)[rows] for phase in range(len(group.phases))]
        for name, at in zip(("measured", *PREDICTED), (read, *predicted), strict=False):
            move(f"{name}_{number}", at, still, _unit(at))
        error = group.magnification * (predicted[-1] - read)
        length = np.linalg.norm(error, axis=1)
        wide = np.minimum(1.0, length / (6 * style.pose_size * group.radius))
        move(f"error_{number}", read, turns_from_z(error), _hidden(style.scales(length, wide)))


def place(viewer: Any, clips: Clips, path: str, times: Vector, placements: list[SE3], scale: Vector | None = None) -> None:
    """A node at its first placement, and its clip."""
    signs = mirror(scale) if scale is not None else np.ones(3)
    first = placements[0].homogeneous.copy()
    first[:3, :3] *= scale if scale is not None else 1.0
    viewer[path].set_transform(first)
    turned = [pin.Quaternion(placement.rotation * signs).coeffs() for placement in placements]
    clips.add(path, times, position=np.array([placement.translation for placement in placements]), quaternion=np.array(turned))


def put(viewer: Any, clips: Clips, path: str, times: Vector, position: Matrix, quaternion: Matrix, scale: Matrix) -> None:
    """A node of unit size that is moved, turned (x, y, z, w) and scaled, each (k, ...), and its clip."""
    first = np.eye(4)
    first[:3, :3] = pin.Quaternion(quaternion[0]).toRotationMatrix() * scale[0]
    first[:3, 3] = position[0]
    viewer[path].set_transform(first)
    clips.add(path, times, position=position, quaternion=quaternion, scale=scale)


def _unit(places: Matrix) -> Matrix:
    """Scale of marks: one, or next to nothing where there is no place."""
    return np.where(np.isnan(places[:, :1]), HIDDEN, 1.0) * np.ones(3)


def _hidden(scales: Matrix) -> Matrix:
    """The same scales, but next to nothing where the last one, a length, is zero or nan."""
    return np.where(scales[:, 2:] > 0, np.maximum(scales, HIDDEN), HIDDEN)


def turns_from_z(directions: Matrix) -> Matrix:
    """Quaternions (x, y, z, w) that turn z to directions (k, 3), in the plane of both; about x where that is none, or no direction."""
    length = np.linalg.norm(directions, axis=1, keepdims=True)
    x, y, z = np.where(length > 0, directions / np.where(length > 0, length, 1.0), (0.0, 0.0, 1.0)).T
    turned = np.column_stack([-y, x, np.zeros_like(x), 1.0 + z])
    turned[np.hypot(x, y) < 1e-9] *= (0, 0, 0, 1)
    turned[(np.hypot(x, y) < 1e-9) & (z < 0)] = (1.0, 0.0, 0.0, 0.0)
    return np.asarray(turned / np.linalg.norm(turned, axis=1, keepdims=True))


def mirror(scale: Vector) -> Vector:
    """Signs that the viewer puts into the rotation when it takes a mirrored mesh's transform apart: it flips x alone."""
    signs = np.sign(scale)
    return signs * (-1, 1, 1) if np.prod(signs) < 0 else signs
