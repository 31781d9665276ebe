"""Poses that could be measured: within the limits, free of what is in the way, and seen; and what is wrong with the others."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from urdfcal.base.errors import UsageError
from urdfcal.base.geometry import Mask, Matrix
from urdfcal.base.interrupts import enough
from urdfcal.base.terminal import many
from urdfcal.planning.sight import HIDDEN, Eyes, Hidden
from urdfcal.robot.configurations import measured_positions
from urdfcal.robot.robot import Robot

Allowed = Callable[[Robot, Matrix], Mask]
COLLIDE, SPLIT = "collide", "are seen by no instrument as a whole"
_LOOKED_FOR = ("", COLLIDE, HIDDEN, SPLIT)  # what is said of poses that took a look at all bodies
_BATCH, _LEAST_BATCH = 4096, 64  # random positions drawn at a time
_MOST = 500_000  # random positions, until the rest is given up
_MOST_LOOKS = 10  # at what is in the way, of the number of candidates that are wanted
_SPARE = 1.2  # more are drawn at a time than the share so far makes likely


@dataclass(frozen=True)
class Candidates:
    """Poses to choose from.

    Attributes:
        q: Their positions, (m, inputs), [rad] or [m].
        rows: Which of the given ones they are, (m,); counted as they were kept where they were drawn.
        read: Which readings can be made there, (m, readings).
        looked: How many were looked at.
        reasons: Of how many each reason was the first why they cannot be measured.
    """

    q: Matrix
    rows: npt.NDArray[np.intp]
    read: Mask
    looked: int
    reasons: Mapping[str, int]

    def told(self, drawn: bool = True) -> str:
        """`1500 of 4096 random poses can be measured: 2000 collide, 596 are out of the picture`."""
        bad = sorted(self.reasons.items(), key=lambda item: -item[1])
        why = f": {', '.join(f'{count} {reason}' for reason, count in bad)}" if bad else ""
        kind = "random pose" if drawn else "candidate"
        return f"{self.looked - sum(self.reasons.values())} of {many(self.looked, kind)} can be measured{why}"


@dataclass(frozen=True)
class Lookout:
    """What tells which poses can be measured.

    Attributes:
        robot: As the sensors see it.
        eyes: What is seen.
        allowed: Which positions it may take; None for all.
        hidden: At which of them something stands between two points; None for nowhere.
    """

    robot: Robot
    eyes: Eyes
    allowed: Allowed | None = None
    hidden: Hidden | None = None

    def look(self, q: Matrix) -> tuple[Mask, npt.NDArray[np.object_]]:
        """Which readings are made at positions, (n, readings), and the first reason why none are, (n,): cheap questions first."""
        seen = self.eyes.geometry(q)
        read, why = seen.read.copy(), seen.why.copy()
        if self.allowed is not None and (good := np.flatnonzero(why == "")).size:
            why[good[~self.allowed(self.robot, q[good])]] = COLLIDE
        if self.hidden is not None and (good := np.flatnonzero(why == "")).size:
            unhidden = self.eyes.unhidden(q[good], self.hidden)
            read[good] &= unhidden.read
            none = ~read[good].any(axis=1)
            why[good[none]] = np.where(unhidden.why[none] == "", SPLIT, unhidden.why[none])  # one hidden, and the other not seen
        return read & (why == "")[:, None], why


def drawn(lookout: Lookout, limits: Matrix, count: int, rng: np.random.Generator) -> Candidates:
    """Random positions within limits (2, inputs) that can be measured; fewer than were asked for where they are too rare."""
    found: list[tuple[Matrix, Mask]] = []
    reasons: Counter[str] = Counter()
    kept = looked = freely = 0
    batch = min(count, _BATCH)
    while kept < count and not enough() and looked < _MOST and freely < _MOST_LOOKS * count:
        q = rng.uniform(limits[0], limits[1], (batch, len(limits[0])))
        read, why = lookout.look(q)
        reasons.update(reason for reason in why.tolist() if reason)
        good = np.flatnonzero(why == "")
        found.append((q[good], read[good]))
        kept, looked, freely = kept + len(good), looked + len(q), freely + int(np.isin(why, _LOOKED_FOR).sum())
        wanted, looks = (count - kept) * _SPARE * looked / max(kept, 1), (_MOST_LOOKS * count - freely) * looked / max(freely, 1)
        batch = int(np.clip(min(wanted, looks), _LEAST_BATCH, _BATCH))
    q, read = (np.concatenate([part[index] for part in found])[:count] for index in (0, 1))
    return Candidates(q, np.arange(len(q)), read, looked, dict(reasons))


def given(lookout: Lookout, q: npt.ArrayLike) -> Candidates:
    """Those of some positions (m, inputs) that can be measured.

    Raises:
        ShapeMismatch: they do not fit the robot.
    """
    q = measured_positions(lookout.robot, q, "plan_poses: candidates")
    read, why = lookout.look(q)
    rows = np.flatnonzero(why == "")
    return Candidates(q[rows], rows, read[rows], len(q), dict(Counter(reason for reason in why.tolist() if reason)))


def require_enough(candidates: Candidates, n: int, was_given: bool) -> None:
    """Refuse to choose more poses than there are.

    Raises:
        UsageError: and why there are so few.
    """
    count = len(candidates.q)
    if count >= n >= 1:
        return
    told = f"; {candidates.told(not was_given)}" if candidates.reasons else ""
    if not was_given and n >= 1:
        raise UsageError(f"{many(n, 'pose')} wanted of {many(count, 'candidate')}{told}")
    raise UsageError(f"plan_poses: expected n from 1 to {count}, the number of candidates, found {n}{told}")
