"""What the numbers of origins are to become: those nearest to what is written, of all that say the same placement."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from urdfcal.base.errors import RobotError, no_such
from urdfcal.base.geometry import SE3, Vector, pose, xyz_rpy
from urdfcal.output.sources.numbers import SIX, Expansion, Wanted

SAME = 1e-12  # [m] and [rad] a number that near is left as it is
PROOF = 1e-9  # [m] and of rotation matrices


def wishes(base: Expansion, origins: Mapping[str, SE3]) -> dict[Wanted, float]:
    """The numbers that must change, and by how much.

    Args:
        base: The document as it is.
        origins: Placements that are wanted, by joint.

    Raises:
        RobotError: there is no such joint.
    """
    found: dict[Wanted, float] = {}
    for joint, origin in origins.items():
        if joint not in base.joints:
            raise RobotError(no_such("joint", joint, base.joints))
        old = base.six(joint)
        new = np.concatenate([origin.translation, nearest_rpy(origin, old[3:])])
        if np.abs(pose(old[:3], old[3:]).rotation - origin.rotation).max() <= SAME:
            new[3:] = old[3:]
        found |= {Wanted(joint, *six): float(by) for six, by in zip(SIX, new - old, strict=True) if abs(by) > SAME}
    return found


def nearest_rpy(origin: SE3, old: Vector) -> Vector:
    """Roll, pitch and yaw of a placement, (3,), [rad], of the many that say the same the nearest to the old ones."""
    roll, pitch, yaw = xyz_rpy(origin)[1]
    if abs(np.cos(pitch)) < 1e-11:  # roll and yaw turn about one axis: the old roll stays
        yaw = yaw + np.sign(pitch) * (old[0] - roll)
        roll = old[0]
    both = np.array([[roll, pitch, yaw], [roll + np.pi, np.pi - pitch, yaw + np.pi]])
    turned = both + 2 * np.pi * np.round((old - both) / (2 * np.pi))
    nearest: Vector = turned[np.argmin(np.abs(turned - old).sum(axis=1))]
    return nearest


def apart(found: Expansion, joint: str, origin: SE3) -> float:
    """How far a joint's placement is from the one that is wanted: the most of metres and of entries of the rotation matrix."""
    six = found.six(joint)
    its = pose(six[:3], six[3:])
    return float(max(np.abs(its.translation - origin.translation).max(), np.abs(its.rotation - origin.rotation).max()))
