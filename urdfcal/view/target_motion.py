"""How the marks of targets move: they jump from pose to pose, in the axes of the measuring frame."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin

from urdfcal.geometry import Matrix, Vector, Z
from urdfcal.view.key_frames import Clips, KeyFrames, Rows, jumps
from urdfcal.view.scene import Scene
from urdfcal.view.scene_nodes import HIDDEN, put, turns
from urdfcal.view.target_marks import POSE_SIZE, sight_of
from urdfcal.view.target_scene import Mark

_STILL = np.array([0.0, 0.0, 0.0, 1.0])


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
        wide = np.minimum(1.0, np.linalg.norm(error, axis=1) / (6 * POSE_SIZE * scene.ball))
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
