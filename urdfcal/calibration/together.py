"""Do the outliers lie together? Bad readings are scattered; where a model is wrong they are neighbours.

Poses are drawn at random as often as it takes to see what chance does (a permutation test): as many as there are outliers, among all
that were read. Compared are how many of their nearest neighbours in joint space are outliers, too; how short a stretch of one joint's
motion, or of the order of measuring, holds most of them; and how many one session has. With Bonferroni's correction over all of these,
outliers that are scattered are said to lie together in fewer than FALSE_ALARMS of the sets.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from math import ceil

import numpy as np
import numpy.typing as npt

from urdfcal.base.geometry import DEG, MM, Mask, Matrix, Vector
from urdfcal.robot.chain import Chain
from urdfcal.sensors.measurements import Measurements
from urdfcal.sensors.repeats import first_rows

FALSE_ALARMS = 0.01
_LEAST = 3  # outliers of which it can be told
_MOST_PART = 0.6  # share of the outliers that a stretch must hold
_NEIGHBOURS = 5
_DRAWS = 4999
_AT_ONCE = 500  # draws
_MANY = 2000  # poses, of which the distances of all from all are not taken
_SAME = 1e-4  # [rad] and [m] within which joints agree: readings of one pose
_NAMED = 2  # joints that a sentence has room for

Rows = npt.NDArray[np.intp]


@dataclass(frozen=True)
class _Poses:
    """Poses of which some are outliers; readings of one pose are one.

    Attributes:
        q: Joint positions, (n, inputs).
        sessions: Index of each pose's session, (n,).
        names: Of the sessions.
        out: Which are outliers, (n,).
        drawn: As many at random, (draws, n).
    """

    q: Matrix
    sessions: Rows
    names: tuple[str, ...]
    out: Mask
    drawn: Mask


def lie_together(chain: Chain, data: Measurements, out: Mask) -> tuple[str, ...]:
    """Where outliers lie together, in words, the surest first; empty where chance scatters them so.

    Args:
        chain: The way that the joints are on.
        data: All that was measured.
        out: Which poses have an outlier, (n,).
    """
    poses = _poses(data, out)
    if poses is None:
        return ()
    found = list(_compared(chain, data, poses))
    limit = FALSE_ALARMS / len(found)
    said = sorted((chance, words) for chance, words in found if words and chance < limit)
    moved = [words for _, words in said if words.startswith("the motion")]
    return tuple(words for _, words in said if words not in moved[_NAMED:])


def _poses(data: Measurements, out: Mask) -> _Poses | None:
    """Distinct poses in the order of measuring; None where too few, or too many, are outliers."""
    seen = np.flatnonzero(data.observed)
    first, place = first_rows(data.pose_of[seen]), np.unique(data.pose_of[seen], return_inverse=True)[1]
    apart = np.zeros(len(first), dtype=bool)
    np.logical_or.at(apart, place, out[seen])
    if not _LEAST <= apart.sum() < len(apart) / 2:
        return None
    rows = seen[first]
    rng, n, k = np.random.default_rng(0), len(apart), int(apart.sum())
    lots = rng.random((_DRAWS, n), dtype=np.float32)
    drawn = np.zeros((_DRAWS, n), dtype=bool)
    np.put_along_axis(drawn, np.argpartition(lots, k - 1, axis=1)[:, :k], True, axis=1)
    names, sessions = np.unique(data.sessions[rows], return_inverse=True)
    return _Poses(data.q[rows], sessions.ravel(), tuple(names.tolist()), apart, drawn)


def _compared(chain: Chain, data: Measurements, poses: _Poses) -> Iterator[tuple[float, str]]:
    """How likely chance is, and words for it, for everything in which outliers may lie together."""
    near = nearest(poses.q, _NEIGHBOURS)
    yield _chance(_joined(poses.out[None], near), _joined(poses.drawn, near)), "in joint space"
    order = np.arange(len(poses.q))
    usual = _stretches(poses.drawn, order)
    yield _chance(-_stretches(poses.out[None], order), -usual), "in the order of measuring"
    for joint, values in zip(chain.inputs, poses.q.T, strict=True):
        order = np.argsort(values, kind="stable")
        length = _stretches(poses.out[None], order)
        moves = bool(np.ptp(values) > _SAME)
        yield _chance(-length, -usual) if moves else 1.0, f"the motion of {joint.name} ({_held(values, poses.out, joint.prismatic)})"
    if len(poses.names) > 1:
        yield _chance(_excess(poses.out[None], poses.sessions), _excess(poses.drawn, poses.sessions)), _most(poses)


def _chance(found: Vector, drawn: Vector) -> float:
    """How often chance gives at least as much."""
    return float((1 + np.count_nonzero(drawn >= found[0])) / (1 + len(drawn)))


def nearest(q: Matrix, count: int) -> Rows:
    """The nearest other poses of each, (n, count), every joint in units of its own spread.

    Args:
        q: Joint positions, (n, inputs), [rad] or [m].
        count: How many neighbours, at most n - 1.
    """
    spread = q.std(axis=0)
    moves = spread > _SAME
    scaled = q[:, moves] / spread[moves] if moves.any() else np.zeros((len(q), 1))
    count = min(count, len(q) - 1)
    if len(q) > _MANY:
        return _nearest_of_many(scaled, count)
    far = (scaled**2).sum(axis=1)[:, None] + (scaled**2).sum(axis=1) - 2 * scaled @ scaled.T
    np.fill_diagonal(far, np.inf)
    return np.asarray(np.argpartition(far, count - 1, axis=1)[:, :count])


def _nearest_of_many(scaled: Matrix, count: int) -> Rows:
    from scipy.spatial import KDTree  # takes longer to load than a usual fit takes

    found = KDTree(scaled).query(scaled, k=count + 1)[1]
    own = found == np.arange(len(scaled))[:, None]
    own[~own.any(axis=1), -1] = True  # as many others are at the very place of the pose itself
    return np.asarray(found[~own].reshape(len(scaled), count), dtype=np.intp)


def _joined(marked: Mask, near: Rows) -> Vector:
    """How many neighbours of marked poses are marked, for every draw, (draws,)."""
    return np.concatenate(
        [(part[:, near] & part[:, :, None]).sum(axis=(1, 2)).astype(float) for part in np.array_split(marked, ceil(len(marked) / _AT_ONCE))]
    )


def _stretches(marked: Mask, order: Rows) -> Vector:
    """The shortest stretch of an order that holds most of the marked poses, for every draw, (draws,)."""
    count = int(marked[0].sum())
    held = _held_count(count)
    places = np.nonzero(marked[:, order])[1].reshape(len(marked), count)
    return np.asarray((places[:, held - 1 :] - places[:, : count - held + 1]).min(axis=1), dtype=float)


def _held_count(count: int) -> int:
    return max(_LEAST, ceil(_MOST_PART * count))


def _held(values: Vector, out: Mask, slides: bool) -> str:
    """The stretch of a joint's motion that holds most of the outliers: `-12 to 8 deg`."""
    order = np.argsort(values, kind="stable")
    places, held = np.flatnonzero(out[order]), _held_count(int(out.sum()))
    first = int(np.argmin(places[held - 1 :] - places[: len(places) - held + 1]))
    ends = values[order][places[[first, first + held - 1]]]
    low, high = np.round(ends / (MM if slides else DEG)).astype(int).tolist()
    return f"{low} to {high} {'mm' if slides else 'deg'}"


def _excess(marked: Mask, sessions: Rows) -> Vector:
    """By how much more than its share one session has of the marked poses, for every draw, (draws,)."""
    return np.asarray(_shares(marked, sessions).max(axis=1))


def _shares(marked: Mask, sessions: Rows) -> Matrix:
    own = np.eye(sessions.max() + 1)[sessions]
    expected = marked[0].sum() * own.mean(axis=0)
    return np.asarray((marked @ own - expected) / np.sqrt(expected))


def _most(poses: _Poses) -> str:
    return f"in session '{poses.names[int(np.argmax(_shares(poses.out[None], poses.sessions)[0]))]}'"
