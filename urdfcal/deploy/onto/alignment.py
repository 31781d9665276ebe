"""Where the base of a URDF stands in another description of the robot, and whether the two are of one geometry.

Two chains move alike if, all joints at zero, their axes coincide up to one motion W of the whole. Where frames are the same in both, W
follows from the first joint's; where they are not, it is the motion that takes directions to directions (Wahba's problem) and then lines
to lines, which wants two axes that are not parallel.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from urdfcal.base.geometry import MM, SE3
from urdfcal.deploy.onto.zero import Axis

LEAST_MM, LEAST_MRAD = 0.05, 0.1  # what rounding leaves in a description that was written by hand; a calibration changes more
_PARALLEL = 1e-3
_OTHER_FRAMES = 1000.0  # times what is let pass: beyond that, frames are others and not joints elsewhere


@dataclass(frozen=True)
class Fit:
    """How two sets of axes lie on each other.

    Attributes:
        T_model_base: The URDF's base in the other description.
        off: Distance and angle by joint, [mm] and [mrad].
    """

    T_model_base: SE3
    off: Mapping[str, tuple[float, float]]

    @property
    def worst(self) -> float:
        """The largest in units of what is let pass."""
        return max(max(mm / LEAST_MM, mrad / LEAST_MRAD) for mm, mrad in self.off.values())

    @property
    def first(self) -> str | None:
        """The first joint that is farther off than rounding explains."""
        return next((name for name, (mm, mrad) in self.off.items() if mm > LEAST_MM or mrad > LEAST_MRAD), None)


def aligned(ours: Mapping[str, Axis], theirs: Mapping[str, Axis], by_frame: Sequence[SE3]) -> Fit:
    """The first way to lay our axes on theirs that fits; if none does, that which tells best what is off.

    Args:
        ours: The URDF's, in its base; in the order of the tree.
        theirs: Those of the other description in its own base, of the same joints.
        by_frame: Where the base is if a joint's frame is the same in both.
    """
    ways = [_fit(placement, ours, theirs) for placement in by_frame]
    other = _by_axes(ours, theirs)
    found = [fit for fit in (*ways, *other) if fit.worst <= 1] or [fit for fit in ways if fit.worst < _OTHER_FRAMES] or other or ways
    return found[0]


def _by_axes(ours: Mapping[str, Axis], theirs: Mapping[str, Axis]) -> list[Fit]:
    a = np.array([axis.direction for axis in ours.values()])
    b = np.array([theirs[name].direction for name in ours])
    if np.linalg.svd(a, compute_uv=False)[1:2].sum() < _PARALLEL:
        return []
    u, _, vt = np.linalg.svd(b.T @ a)
    rotation = u @ np.diag([1.0, 1.0, np.linalg.det(u) * np.linalg.det(vt)]) @ vt
    turning = [name for name, axis in ours.items() if not axis.slides]
    across = [np.eye(3) - np.outer(theirs[name].direction, theirs[name].direction) for name in turning]
    if not turning or np.linalg.svd(np.vstack(across), compute_uv=False)[-1] < _PARALLEL:
        return []
    gaps = [theirs[name].point - rotation @ ours[name].point for name in turning]
    target = np.concatenate([projector @ gap for projector, gap in zip(across, gaps, strict=True)])
    translation = np.linalg.lstsq(np.vstack(across), target, rcond=None)[0]
    return [_fit(pin.SE3(rotation, translation), ours, theirs)]


def _fit(placement: SE3, ours: Mapping[str, Axis], theirs: Mapping[str, Axis]) -> Fit:
    return Fit(placement, {name: off(axis.moved(placement), theirs[name]) for name, axis in ours.items()})


def off(one: Axis, other: Axis) -> tuple[float, float]:
    """How far an axis is from another, [mm], near the other's point, and how much it is turned, [mrad]; a slide has no place."""
    angle = float(np.arctan2(np.linalg.norm(np.cross(one.direction, other.direction)), one.direction @ other.direction))
    gap = other.point - one.point
    return 0.0 if one.slides else float(np.linalg.norm(gap - one.direction * (one.direction @ gap)) / MM), angle * 1e3
