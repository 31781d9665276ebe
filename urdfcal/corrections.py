"""Corrected origins, and how they are put on a Pinocchio model."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import pinocchio as pin

from urdfcal.errors import RobotError, did_you_mean
from urdfcal.geometry import SE3


@dataclass(frozen=True)
class OriginCorrection:
    """One joint's origin before and after calibration.

    Attributes:
        nominal: Placement of the joint in its parent link, as it was.
        corrected: As it was found to be.
        moving: Whether the joint moves; if not it belongs to the rig or the base.
    """

    nominal: SE3
    corrected: SE3
    moving: bool

    @property
    def delta(self) -> SE3:
        """What stands behind the nominal origin: corrected = nominal * delta."""
        return self.nominal.actInv(self.corrected)


def corrected_model(model: Any, corrections: Mapping[str, OriginCorrection]) -> Any:
    """A copy of a Pinocchio model with corrected placements of joints and frames; inertias stay as they are.

    Args:
        model: Model of the same robot, with or without the rig; left unchanged.
        corrections: By URDF joint name. Fixed joints that the model does not have are passed over.

    Raises:
        RobotError: the model lacks a moving joint that was calibrated.
    """
    for name, correction in corrections.items():
        if correction.moving and not model.existJointName(name):
            raise RobotError(f"the model has no joint '{name}', which was calibrated{did_you_mean(name, list(model.names)[1:])}")
    result = model.copy()
    for index, frame in enumerate(model.frames):
        if index == 0:
            continue
        above = model.frames[frame.parentFrame]
        delta = corrections[frame.name].delta if _is_joint(frame) and frame.name in corrections else pin.SE3.Identity()
        moved_above = result.frames[frame.parentFrame].placement
        if frame.type == pin.FrameType.JOINT:
            joint = frame.parentJoint
            result.jointPlacements[joint] = moved_above * above.placement.actInv(model.jointPlacements[joint]) * delta
        else:
            result.frames[index].placement = moved_above * above.placement.actInv(frame.placement) * delta
    return result


def _is_joint(frame: Any) -> bool:
    return bool(frame.type in (pin.FrameType.JOINT, pin.FrameType.FIXED_JOINT))
