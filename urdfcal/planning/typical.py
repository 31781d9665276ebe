"""Where targets sit, and instruments stand, of which nobody says it: of many draws the one in the middle of what they promise.

Which poses are good ones depends little on it, but how much they tell does: a target far beside the last joint's axis shows that joint
turn, one near the axis hardly does, and after the same poses the tool is off by twice as much or more. What is predicted after the first
draw would be luck. The mean of what is predicted after all of them says little, since the few that lie nearly on the axis make up most of
it; of the middle one half of all places do better.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from urdfcal.base.geometry import Matrix, Vector
from urdfcal.model.slots import Slot
from urdfcal.planning.candidates import Candidates
from urdfcal.planning.criteria import Traced
from urdfcal.planning.measuring import Measuring, ReadWith, whitened
from urdfcal.planning.selection import greedy, information
from urdfcal.simulation.setup import simulated_setup

_DRAWS, _STEP = 49, 4
_MOST = 500  # candidates out of which poses are chosen to judge draws by
_POSES = 30  # how many, at most


def typical(made: Measuring, candidates: Candidates, n: int, noise: ReadWith, M: Matrix, rng: np.random.Generator) -> Measuring:
    """What measures with all that is drawn at random where it is typical; the same where nothing is.

    Poses that are chosen for a draw tell more of it than of others. So draws are tried from the middle on until one promises no more than
    the middle of all do after the poses that are chosen for it, and it is the one of those tried that comes nearest to that.

    Args:
        made: What measures, with one draw of it.
        candidates: What can be measured.
        n: How many of them will be chosen.
        noise: Of the readings.
        M: Mean of J'J over the workspace, J the motion of the tool, (p, p).
        rng: Source of randomness.
    """
    if not any(_is_drawn(slot, made) for slot in made.errors.slots):
        return made
    some = rng.choice(len(candidates.q), min(_MOST, len(candidates.q)), replace=False)
    draws, by = [made, *(_drawn_again(made, rng) for _ in range(_DRAWS - 1))], Traced(made.errors.sigma, M)

    def left(draw: int) -> Vector:
        """What all draws leave after poses that are chosen for one of them."""
        H = whitened(draws[draw], candidates.q[some], noise, candidates.read[some])
        rows = some[greedy(H, by, min(n, _POSES, len(some)))[0]]
        return np.array([by.left(information(whitened(own, candidates.q[rows], noise, candidates.read[rows]))) for own in draws])

    tried: dict[int, float] = {}
    for draw in np.argsort(left(0))[_DRAWS // 2 :: _STEP].tolist():
        after = left(draw)
        tried[draw] = float(np.log(after[draw] / np.median(after)))
        if tried[draw] >= 0:
            break
    return draws[min(tried, key=lambda draw: abs(tried[draw]))]


def _is_drawn(slot: Slot, made: Measuring) -> bool:
    """Whether it was drawn where something stands; cameras were put where they see much, and links are where they are."""
    cameras = {made.errors.chain.seen_from(own.instrument) for own in made.blank if own.kind.by_camera}
    return bool(slot.found) and not (slot.kind == "reference" and slot.frame in cameras)


def _drawn_again(made: Measuring, rng: np.random.Generator) -> Measuring:
    errors = made.errors
    others = simulated_setup(made.robot, errors, errors.mean, (), rng, area=made.area).errors.slots
    slots = (other if _is_drawn(slot, made) else slot for slot, other in zip(errors.slots, others, strict=True))
    return replace(made, errors=replace(errors, slots=tuple(slots)))
