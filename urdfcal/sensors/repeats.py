"""Which rows are readings of one pose: those whose joints agree within their resolution.

Nobody comes back to a pose to the last bit: encoders jitter by some counts, files round. How far apart two readings of one pose may be
is taken from the data: at least RESOLUTION, at which an arm can have no other error; a step and a half where positions come in coarser
steps; and where consecutive rows are either much closer to each other than all others or far away, as far as the close ones. It is
never more than one and a half times COARSEST, so that poses on a grid stay poses.

Rows are sorted into cells of that size and cells that touch are one pose. A slow sweep through many cells is no pose: it is cut.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from urdfcal.base.geometry import Matrix, Vector

Rows = npt.NDArray[np.intp]

RESOLUTION = 1e-4  # [rad], [m]
COARSEST = 2e-3  # [rad], [m]
_STEP = 1.5  # steps of a coarse encoder within which it is at rest
_GAP = 10.0  # times that the next move is longer than the longest jitter
_WHOLE = 0.05  # share of a step by which multiples of it may be off
_ROUNDING = 1e-9  # [rad], [m]
_CELLS = 6  # cells through which a pose may reach
_NO_MOVE = 1e-3  # share of a joint's range that is no move
_APART = 10  # cells between rows that are no readings of one pose whatever their joints say


def resolution(q: Matrix) -> Vector:
    """How far apart joints may be read at one pose, (joints,), [rad] or [m].

    Args:
        q: Joint positions, (n, joints), [rad] or [m].
    """
    steps = np.array([_step(positions) for positions in q.T])
    return np.maximum(np.maximum(_jitter(q), RESOLUTION), np.where(steps <= COARSEST, _STEP * steps, 0.0))


def read_again(q: Matrix, new: Vector) -> bool:
    """Whether a further row, (joints,), stands as close to any of some rows (n, joints) as readings of one pose do."""
    near = np.abs(q[:, 0] - new[0]) <= _STEP * COARSEST
    if not near.any():  # of one joint already, as mostly
        return False
    apart = np.abs(q[near] - new)
    apart = apart[(apart <= _STEP * COARSEST).all(axis=1)]
    return bool(len(apart) and (apart <= resolution(np.vstack([q, new]))).all(axis=1).any())


def _step(positions: Vector) -> float:
    """The step that all positions of a joint are multiples of, as far as it can be one of an encoder; 0 if there is none."""
    values = np.unique(positions)
    gaps = np.diff(values)
    gaps = gaps[gaps > _ROUNDING]
    if not len(gaps):
        return 0.0
    multiples = (values - values[0]) / gaps.min()
    return float(gaps.min()) if np.max(np.abs(multiples - np.round(multiples))) < _WHOLE else 0.0


def _jitter(q: Matrix) -> float:
    """How far consecutive rows move where the arm stands still; 0 if standing still cannot be told from moving."""
    moves = np.max(np.abs(np.diff(q, axis=0)), axis=1, initial=0.0)
    still = moves[moves <= COARSEST]
    most = float(still.max(initial=0.0))
    return most if len(still) < len(moves) and not np.any((moves > most) & (moves < _GAP * most)) else 0.0


def last_moves(q: Matrix) -> Matrix:
    """Direction of each joint's last move before each row, (n, joints): -1, 0 or 1; while a joint stands still, of its move before.

    What is no farther than readings may scatter is no move: a thousandth of the joint's range, and no less than its resolution.

    Args:
        q: Joint positions in the order in which they were taken up, (n, joints), [rad] or [m].
    """
    if not len(q):
        return np.zeros_like(q)
    moves = np.diff(q, axis=0, prepend=q[:1])
    moved = np.abs(moves) > np.maximum(resolution(q), _NO_MOVE * np.ptp(q, axis=0))
    came = np.maximum.accumulate(np.where(moved, np.arange(len(q))[:, None], 0), axis=0)
    return np.asarray(np.take_along_axis(np.where(moved, np.sign(moves), 0.0), came, axis=0))


def same_poses(q: Matrix, keys: Rows, approach: Matrix | None = None) -> Rows:
    """Index of the pose that each row is a reading of, (n,), in order of their first rows, without gaps.

    Args:
        q: Joint positions, (n, joints), [rad] or [m].
        keys: What else must be equal, (n,): session, payload, what was touched.
        approach: Directions of the joints' last moves, (n, joints), of which none may be opposite.
    """
    if len(q) < 2:
        return np.zeros(len(q), dtype=np.intp)
    steps = np.round(q / resolution(q)).astype(np.int64)
    ways = np.zeros((len(q), 0), dtype=np.int64) if approach is None else approach.astype(np.int64)
    cells, cell_of = _distinct_rows(np.column_stack([_APART * keys, steps, ways]))
    one, other = _touching(cells[:, : 1 + q.shape[1]], cells[:, 1 + q.shape[1] :])
    if not len(one):
        return _in_order(cell_of.ravel())
    places = cells[:, : 1 + q.shape[1]]
    joined = _joined(len(cells), one, other)
    least = np.full(places.shape, np.iinfo(np.int64).max)
    np.minimum.at(least, joined, places)
    cut = np.column_stack([joined, (places - least[joined]) // _CELLS])
    return _in_order(np.unique(cut, axis=0, return_inverse=True)[1].ravel()[cell_of.ravel()])


def _distinct_rows(table: Matrix) -> tuple[Matrix, Rows]:
    """The different rows of whole numbers, and which of them each row is; mostly all of them are different, and one sum tells it."""
    sums = table @ np.random.default_rng(0).integers(1, 1 << 40, table.shape[1])
    if len(np.unique(sums)) == len(table):
        return table, np.arange(len(table))
    rows, which = np.unique(table, axis=0, return_inverse=True)
    return rows, which


def _touching(places: Matrix, ways: Matrix) -> tuple[Rows, Rows]:
    """Pairs of cells that touch and were not reached from opposite sides.

    Sorted along one line, neighbours are compared, then next but one, as far as any can touch.
    """
    line = np.random.default_rng(0).uniform(0.5, 1.0, places.shape[1])
    along = places @ line
    order = np.argsort(along, kind="stable")
    places, ways, along = places[order], ways[order], along[order]
    pairs, reach = [], float(np.sum(line))
    for apart in range(1, len(order)):
        near = np.flatnonzero(along[apart:] - along[:-apart] <= reach)
        if not len(near):
            break
        touch = (np.abs(places[near + apart] - places[near]) <= 1).all(axis=1) & (ways[near + apart] * ways[near] >= 0).all(axis=1)
        pairs.append(np.column_stack([order[near[touch]], order[near[touch] + apart]]))
    found = np.concatenate(pairs) if pairs else np.empty((0, 2), dtype=np.intp)
    return found[:, 0], found[:, 1]


def _joined(count: int, one: Rows, other: Rows) -> Rows:
    """The least member of the set that each of some things belongs to, (count,), where pairs belong together."""
    least = np.arange(count)
    while True:
        last = least.copy()
        np.minimum.at(least, one, last[other])
        np.minimum.at(least, other, last[one])
        least = least[least]
        if np.array_equal(least, last):
            return least


def _in_order(labels: Rows) -> Rows:
    """Labels numbered anew in the order in which they come first."""
    _, first, which = np.unique(labels, return_index=True, return_inverse=True)
    rank = np.empty(len(first), dtype=np.intp)
    rank[np.argsort(first)] = np.arange(len(first))
    return np.asarray(rank[which.ravel()])


def first_rows(poses: Rows) -> Rows:
    """The first row of every pose, (poses,)."""
    return np.unique(poses, return_index=True)[1]


def codes(*columns: Any) -> Rows:
    """A number for every different combination of what some columns, (n,) each, hold."""
    found = np.zeros(len(columns[0]), dtype=np.intp)
    for column in columns:
        if (column != column[:1]).any():
            _, which = np.unique(column, return_inverse=True)
            found = np.unique(found * (which.max() + 1) + which.ravel(), return_inverse=True)[1].ravel()
    return found


def distinct(*columns: Any) -> Rows:
    """The rows that are no copies of earlier ones, in their order; columns (n,) or (n, m), of which nan equals nan."""
    keys = [np.asarray(column).reshape(len(column), -1) for column in columns]
    numbers = [key if key.dtype.kind == "f" else np.unique(key, return_inverse=True)[1].reshape(key.shape).astype(float) for key in keys]
    table = np.ascontiguousarray(np.hstack(numbers) + 0.0)
    return np.sort(np.unique(table.view(np.dtype((np.void, table.dtype.itemsize * table.shape[1]))).ravel(), return_index=True)[1])


def repeated(poses: Rows) -> bool:
    """Whether any pose was read several times."""
    return bool(len(poses)) and int(poses.max()) + 1 < len(poses)
