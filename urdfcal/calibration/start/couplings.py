"""Joints that a controller counts together with others: from the horizontal, in place of from the link before.

Fanuc's, and arms with a parallelogram, read J3 - J2 or J3 + J2 for the third axis, SCARAs the hand's direction in the base for the last;
the links of a wrist drive each other. A URDF counts every joint from the link before it, and what undoes the coupling is a joint's
reading plus or minus those before it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from urdfcal.base.geometry import Vector
from urdfcal.calibration.start.mistakes import Mistake
from urdfcal.robot.chain import Chain
from urdfcal.sensors.measurements import Measurements

_PARALLEL = 0.99  # cosine


@dataclass(frozen=True)
class _Turn:
    """A measured joint that turns: its column, its name and its axis where all joints are at zero, in the frame of the way's start."""

    column: int
    name: str
    axis: Vector


def mistakes_of_couplings(chain: Chain) -> Iterator[Mistake]:
    """Joints that were counted together with those before them, towards the root.

    Args:
        chain: Whose measured joints they are. Successive joints are tried in pairs, whatever their axes, and the joints of a run of
            parallel axes each with every one before it and with all of them.
    """
    for branch in _branches(chain):
        for index, joint in enumerate(branch):
            run = _run_before(branch, index)
            pairs = [{other.column: 1.0} for other in (run or branch[max(index - 1, 0) : index])]
            sums = [{other.column: float(np.sign(other.axis @ joint.axis)) for other in run}] if len(run) > 1 else []
            for weights in (*pairs, *sums):
                yield _coupled(chain, joint, weights)
                yield _coupled(chain, joint, {column: -weight for column, weight in weights.items()})


def _coupled(chain: Chain, joint: _Turn, weights: Mapping[int, float]) -> Mistake:
    added, taken = ([chain.input_names[column] for column, own in weights.items() if own * sign > 0] for sign in (1, -1))
    words = [f"{' and '.join(added)} added to {joint.name}"] if added else []
    words += [f"{' and '.join(taken)} subtracted from {joint.name}"] if taken else []
    return Mistake(" and ".join(words), partial(_counted_with, joint.column, weights))


def _counted_with(column: int, weights: Mapping[int, float], data: Measurements) -> Measurements:
    q = data.q.copy()
    q[:, column] += data.q[:, list(weights)] @ np.array(list(weights.values()))
    return replace(data, q=q)


def _run_before(branch: Sequence[_Turn], index: int) -> list[_Turn]:
    """The joints just before one whose axes are all parallel to its own."""
    run: list[_Turn] = []
    for other in branch[:index][::-1]:
        if abs(other.axis @ branch[index].axis) < _PARALLEL:
            break
        run.insert(0, other)
    return run


def _branches(chain: Chain) -> tuple[list[_Turn], list[_Turn]]:
    """The measured joints that turn, from the root outward: those that carry what sees, and those that carry what is seen."""
    placed, backward, forward = np.eye(3), list[_Turn](), list[_Turn]()
    for step in chain.steps:
        joint = step.joint
        placed = placed @ joint.origin.rotation if step.forward else placed
        if joint.moves and not joint.prismatic and joint.name in chain.input_names:
            turn = _Turn(chain.input_names.index(joint.name), joint.name, placed @ np.array(joint.axis))
            (forward if step.forward else backward).append(turn)
        placed = placed if step.forward else placed @ joint.origin.rotation.T
    return backward[::-1], forward
