"""Times and what is where at them: the key frames of an animation, and clips as meshcat wants them.

Time is the number of the pose: pose k is held from k - 0.3 to k + 0.3 and the robots move in between, straight in joint space, so
that links stay together and beams end on the screen on the way, too. Where a planned way goes around, they go that way.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from urdfcal.base.geometry import Array3, Matrix, Vector
from urdfcal.output.view.scene import Scene

Rows = npt.NDArray[np.intp]

MOST_POSES = 200  # in the animation; all spots are drawn anyway
HELD = 0.3  # pose k is held from k - HELD to k + HELD
_MOST_KEYS = 700
_DIGITS = 6
_ENDLESS = 1_000_000  # JSON has no infinity
_FPS = 1  # of our clips: keys are in seconds


@dataclass(frozen=True)
class KeyFrames:
    """Joint positions at times.

    Attributes:
        times: (k,), rising.
        q: Measured joints at those times, (k, inputs).
        solid: The same of the robot that is drawn solid, which may give way.
        rows: Row of the data that each animated pose is.
    """

    times: Vector
    q: Matrix
    solid: Matrix
    rows: Rows


@dataclass
class Clips:
    """What moves, by path, as meshcat wants it."""

    entries: list[dict[str, Any]] = field(default_factory=list)

    def add(self, path: str, times: Vector, **tracks: Matrix) -> None:
        """Tracks `position` and `scale` (k, 3) and `quaternion` (k, 4); one that never changes is left out."""
        kinds = {"position": "vector3", "scale": "vector3", "quaternion": "quaternion"}
        lowered = [
            {
                "name": f".{name}",
                "type": kinds[name],
                "keys": [{"time": t, "value": v} for t, v in zip(times.tolist(), values, strict=True)],
            }
            for name, values in ((name, np.round(table, _DIGITS).tolist()) for name, table in tracks.items() if _changes(table))
        ]
        if lowered:
            self.entries.append({"path": f"/meshcat/{path}", "clip": {"fps": _FPS, "name": "default", "tracks": lowered}})


@dataclass(frozen=True)
class SetClips:
    """meshcat's command to load an animation, not playing yet."""

    clips: Clips

    def lower(self) -> dict[str, Any]:
        """As meshcat's viewer reads it."""
        options = {"play": False, "repetitions": _ENDLESS, "clampWhenFinished": True}
        return {"type": "set_animation", "animations": self.clips.entries, "options": options, "path": ""}


def key_frames(scene: Scene) -> KeyFrames:
    """The poses that are animated (the worst and others evenly, where there are very many) and steps between them."""
    rows = animated_rows(scene)
    steps = max(1, min(8, _MOST_KEYS // max(len(rows), 1) - 1))
    times, q, solid = [0.0], [scene.data.q[rows[0]]], [scene.bent_data.q[rows[0]]]
    for number, row in enumerate(rows, start=1):
        times += [number - HELD, number + HELD]
        q += [scene.data.q[row]] * 2
        solid += [scene.bent_data.q[row]] * 2
        if number < len(rows):
            ways = [_way(scene, own, row, rows[number]) for own in (scene.data.q, scene.bent_data.q)]
            shares = _shares(ways[0])
            between = np.union1d(np.arange(1, steps) / steps, shares[1:-1])
            times += list(number + HELD + (1 - 2 * HELD) * between)
            for found, way in zip((q, solid), ways, strict=True):
                found += list(np.column_stack([np.interp(between, shares, column) for column in way.T]))
    return KeyFrames(np.array(times), np.array(q), np.array(solid), rows)


def _way(scene: Scene, q: Matrix, here: int, after: int) -> Matrix:
    """The corners of the way from a row's position to another's, both included, (k, inputs)."""
    by = (scene.planned or {}).get(here) if after == here + 1 else None
    return np.vstack([q[here], *([] if by is None else by), q[after]])


def _shares(way: Matrix) -> Vector:
    """Which share of the way each of its corners is at, (k,), as far as the joint goes that goes farthest."""
    lengths = np.maximum(np.abs(np.diff(way, axis=0)).max(axis=1), 1e-9)
    return np.asarray(np.concatenate([[0.0], np.cumsum(lengths)]) / lengths.sum())


def jumps(keys: KeyFrames) -> tuple[Vector, Rows]:
    """Times just before and behind every change of pose, and the row of the data that is shown at each."""
    count = len(keys.rows)
    edges = np.arange(1, count) + 0.5
    times = np.concatenate([[0.0], np.stack([edges - 0.01, edges + 0.01], -1).ravel(), [count + HELD]])
    return times, keys.rows[np.repeat(np.arange(count), 2)]


def animated_rows(scene: Scene) -> Rows:
    """Which rows of the data are animated."""
    n = len(scene.data)
    if n <= MOST_POSES:
        return np.arange(n)
    rows = [row.phases[-1] for row in scene.compared if row.unit == "mm"] or [row.phases[-1] for row in scene.compared]
    worst = np.argsort(np.nan_to_num(rows).max(axis=0))[-MOST_POSES // 10 :]
    others = np.setdiff1d(np.arange(n), worst)
    even = others[np.linspace(0, len(others) - 1, MOST_POSES - len(worst)).astype(int)]
    return np.sort(np.concatenate([worst, even]))


def _changes(table: Matrix | Array3) -> bool:
    return bool(np.ptp(table, axis=0).max() > 10.0**-_DIGITS)
