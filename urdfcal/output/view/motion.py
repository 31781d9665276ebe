"""How the scene moves: the robots from pose to pose, their beams with them, and the marks of the pose shown.

How the marks of targets move: they jump from pose to pose, in the axes of the measuring frame.

Nodes of the scene that move: where each is at first, and its clip.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin

from urdfcal.base.geometry import MM, SE3, Mask, Matrix, Vector, Z
from urdfcal.output.view.key_frames import Clips, KeyFrames, Rows, jumps
from urdfcal.output.view.marks import (
    CALIBRATED,
    ERROR,
    FAINT_WIDTH,
    LAYERS,
    MEASURED,
    MISSING,
    NOMINAL,
    POSE_LAYER,
    POSE_SIZE,
    beam_colour,
    disc,
    draw_beam,
    flat,
    lifted,
    ring,
    unit_arrow,
    unit_beam,
)
from urdfcal.output.view.scene import Beams, Mark, Scene, beams_of, frame_placements, screen_placements
from urdfcal.output.view.shapes import Shapes
from urdfcal.output.view.target_marks import TARGET_POSE_SIZE, sight_of
from urdfcal.robot.configurations import whole_configurations
from urdfcal.robot.robot import Robot

_MISS = 0.6  # length of a beam that misses, over the size of the scene
BEAM = 0.0024  # radius of a drawn beam over the size of the scene

HIDDEN = 1e-6  # scale of what is not to be seen; zero would have no inverse

_STILL = np.array([0.0, 0.0, 0.0, 1.0])


def draw_motion(viewer: Any, scene: Scene, shapes: Shapes, keys: KeyFrames) -> Clips:
    """Put everything that moves where it is at the first pose, and give back how it goes on."""
    clips = Clips()
    whole = whole_configurations(scene.solid, keys.q)
    T_root_screen = screen_placements(scene.solid, whole)
    if scene.data.lasers:
        place(viewer, clips, "screen", keys.times, T_root_screen)
    if scene.targets:
        place(viewer, clips, "frame", keys.times, frame_placements(scene.targets[-1], whole, keys.q))
        move_targets(viewer, clips, scene, keys)
    _move_robot(viewer, clips, "solid", scene.solid, shapes, keys.times, whole)
    if scene.calibrated is not None:
        ghost = whole_configurations(scene.robot, keys.q)
        roots = [ours * theirs.inverse() for ours, theirs in zip(T_root_screen, screen_placements(scene.robot, ghost), strict=True)]
        place(viewer, clips, "nominal", keys.times, roots)
        _move_robot(viewer, clips, "nominal", scene.robot, shapes, keys.times, ghost)
    if scene.data.lasers:
        if scene.calibrated is not None:
            _move_beams(viewer, clips, "screen/pose/nominal_beam", scene, beams_of(scene.robot, keys.q), keys.times)
        _move_beams(viewer, clips, "screen/pose/beam", scene, beams_of(scene.solid, keys.q), keys.times)
        _move_marks(viewer, clips, scene, keys)
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
        turned = turns(Z, beams.direction[:, laser])
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


def _move_marks(viewer: Any, clips: Clips, scene: Scene, keys: KeyFrames) -> None:
    """Marks of the pose shown; they jump half way between two poses."""
    times, rows = jumps(keys)
    predicted = {"nominal": scene.before, "calibrated": scene.after}
    for laser in range(len(scene.data.lasers)):
        marks = {"measured": (scene.data.spots[rows, laser], scene.data.seen[rows, laser])}
        marks |= {name: (beams.spots[rows, laser], scene.lands(beams)[rows, laser]) for name, beams in predicted.items() if beams}
        for name, (places, visible) in marks.items():
            at, still = _flat_places(places, visible), np.tile([0.0, 0.0, 0.0, 1.0], (len(rows), 1))
            scale = np.where(visible[:, None], 1.0, HIDDEN) * np.ones(3)
            put(viewer, clips, f"screen/pose/{name}_{laser + 1}", times, at, still, scale)
        _move_arrow(viewer, clips, scene, times, rows, laser)


def _move_arrow(viewer: Any, clips: Clips, scene: Scene, times: Vector, rows: Rows, laser: int) -> None:
    """The magnified error of one laser: an arrow of unit length, turned about the screen's x and scaled."""
    spots, shown = scene.data.spots[rows, laser], scene.shown
    both = scene.data.seen[rows, laser] & scene.lands(shown)[rows, laser]
    error = np.where(both[:, None], scene.magnification * (shown.spots[rows, laser] - spots), 0.0)
    length, half = np.linalg.norm(error, axis=1), np.arctan2(error[:, 1], error[:, 0]) / 2
    turned = np.column_stack([np.sin(half), np.zeros((len(rows), 2)), np.cos(half)])  # from y to the error
    wide = np.minimum(1.0, length / (6 * POSE_SIZE * scene.mark))
    scale = np.stack([np.ones_like(wide), np.maximum(length, HIDDEN), np.maximum(wide, HIDDEN)], -1)  # keeps its distance from the sheet
    put(viewer, clips, f"screen/pose/error_{laser + 1}", times, _flat_places(spots, both), turned, scale)


def _flat_places(spots: Matrix, visible: Mask) -> Matrix:
    """Spots (k, 2) as points of the screen's axes; hidden ones at its origin."""
    return lifted(np.where(visible[:, None], spots, 0.0), 0.0)


def draw_pose_marks(node: Any, scene: Scene) -> None:
    """The marks and beams of the pose shown, in unit size where they are scaled as they move."""
    mark = POSE_SIZE * scene.mark
    middle = np.zeros((1, 2))
    for laser in range(len(scene.data.lasers)):
        lifts = {name: scene.side * (lift + POSE_LAYER) * MM for name, lift in LAYERS.items()}
        node[f"measured_{laser + 1}"].set_object(disc(mark, middle, lifts["measured"]), flat(MEASURED))
        node[f"nominal_{laser + 1}"].set_object(ring(mark, middle, lifts["nominal"]), flat(NOMINAL))
        node[f"error_{laser + 1}"].set_object(unit_arrow(0.5 * mark, lifts["error"]), flat(ERROR))
        colours = {"beam": beam_colour(laser)}
        if scene.calibrated is not None:
            node[f"calibrated_{laser + 1}"].set_object(ring(mark, middle, lifts["calibrated"]), flat(CALIBRATED))
            colours["nominal_beam"] = NOMINAL
        for name, colour in colours.items():
            faint = name != "beam"
            radius = (FAINT_WIDTH if faint else 1.0) * BEAM * scene.extent
            draw_beam(node[f"{name}_{laser + 1}"], unit_beam(radius), colour, faint)
            draw_beam(node[f"{name}_missing_{laser + 1}"], unit_beam(radius, dashed=True), MISSING, faint)


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


def turns(axis: Vector, directions: Matrix) -> Matrix:
    """Quaternions (x, y, z, w) that turn an axis to directions (k, 3)."""
    return np.array([pin.Quaternion.FromTwoVectors(axis, direction).coeffs() for direction in directions])


def mirror(scale: Vector) -> Vector:
    """Signs that the viewer puts into the rotation when it takes a mirrored mesh's transform apart: it flips x alone."""
    signs = np.sign(scale)
    return signs * (-1, 1, 1) if np.prod(signs) < 0 else signs


def move_targets(viewer: Any, clips: Clips, scene: Scene, keys: KeyFrames) -> None:
    """Marks of the pose shown; they jump half way between two poses."""
    times, rows = jumps(keys)
    placed = scene.solid.rig.instruments.placed
    for index in scene.moving:
        mark, number = scene.marks[index], index + 1
        own = mark.read[rows]
        _put_mark(viewer, clips, f"line_{number}", times, *_lines(own, sight_of(mark, placed)))
        if mark.axes is not None:
            _put_mark(viewer, clips, f"axes_{number}", times, own, _quaternions(mark, rows), _unit(own))
            continue
        still = np.tile(_STILL, (len(rows), 1))
        places = {"measured": own, "nominal": scene.shifted(0, index)[rows]}
        places |= {"calibrated": scene.shifted(1, index)[rows]} if scene.calibrated is not None else {}
        for name, at in places.items():
            _put_mark(viewer, clips, f"{name}_{number}", times, at, still, _unit(own))
        error = scene.target_magnification * (scene.shifted(len(scene.targets) - 1, index)[rows] - own)
        wide = np.minimum(1.0, np.linalg.norm(error, axis=1) / (6 * TARGET_POSE_SIZE * scene.ball))
        _put_mark(viewer, clips, f"error_{number}", times, own, *_stretched(error, np.nan_to_num(wide)))


def _put_mark(viewer: Any, clips: Clips, name: str, times: Vector, at: Matrix, turned: Matrix, scale: Matrix) -> None:
    put(viewer, clips, f"frame/pose/{name}", times, np.nan_to_num(at), turned, scale)


def _unit(places: Matrix) -> Matrix:
    """Scale of marks: one, or next to nothing where there is no place."""
    return np.where(np.isnan(places[:, :1]), HIDDEN, 1.0) * np.ones(3)


def _stretched(along: Matrix, wide: Vector) -> tuple[Matrix, Matrix]:
    """Turn and scale of what is of unit length along z, to reach (k, 3); hidden where that is nan."""
    reach = np.nan_to_num(along)
    length = np.linalg.norm(reach, axis=1)
    scale = np.maximum(np.stack([wide, wide, length], -1), HIDDEN)
    scale[~(length > 0)] = HIDDEN
    return turns(Z, np.where(length[:, None] > 0, reach, Z)), scale


def _lines(places: Matrix, start: Vector | None) -> tuple[Matrix, Matrix, Matrix]:
    """Lines of sight and wires: where they begin, turn and scale."""
    begin = np.zeros(3) if start is None else start
    reach = places - begin if start is not None else np.full_like(places, np.nan)
    return np.tile(begin, (len(places), 1)), *_stretched(reach, np.ones(len(places)))


def _quaternions(mark: Mark, rows: Rows) -> Matrix:
    """Measured axes as quaternions, (k, 4)."""
    assert mark.axes is not None
    return np.array([pin.Quaternion(own).coeffs() for own in mark.axes[rows]])
