"""What a fit decided of the robot's joints, for a later fit that shares some of them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pinocchio as pin

from urdfcal.base.errors import RobotError
from urdfcal.base.geometry import Matrix, Vector, distance_mm_mrad
from urdfcal.model.earlier import EarlierJoints
from urdfcal.model.slots import Slot
from urdfcal.robot.corrections import same_origin
from urdfcal.robot.robot import Robot

if TYPE_CHECKING:
    from urdfcal.calibration.result import FitResult


def joints_of(found: FitResult) -> EarlierJoints:
    """The joints' parameters of a fit and of those before it, as twists about the origins that it gives."""
    errors, names = found.errors, found.errors.names
    values = errors.slot_values(found.x, errors.sessions[0])
    screws: dict[str, Vector] = {}
    for slot, value in zip(errors.slots, values, strict=True):
        if slot.kind == "joint":
            screws |= zip((f"{slot.label}.{name}" for name in slot.names), twists(slot, value).T, strict=True)
    columns = [column for column, name in enumerate(names) if name in screws]
    own = tuple(names[column] for column in columns)
    origins = {name: correction.corrected for name, correction in found.corrections.items()}
    joints = {name.rpartition(".")[0] for name in own}
    P = found.covariance
    decided = EarlierJoints(
        own,
        errors.sigma[columns],
        np.column_stack([screws[name] for name in own]) if own else np.empty((6, 0)),
        P[np.ix_(columns, columns)],
        {name: origin for name, origin in origins.items() if name in joints},
    )
    if errors.earlier is None:
        return decided
    rest, cross = errors.earlier.updated(errors.joint_names, names, P)
    return EarlierJoints(
        (*own, *rest.names),
        np.concatenate([decided.sigma, rest.sigma]),
        np.hstack([decided.screws, rest.screws]),
        np.block([[decided.covariance, cross[:, columns].T], [cross[:, columns], rest.covariance]]),
        {**decided.origins, **{joint: origins[joint] for joint in rest.origins}},
    )


def twists(slot: Slot, value: Vector) -> Matrix:
    """Twist of a slot's placement, in its own axes, per unit of each parameter at these values, (6, k).

    Of the product exp(s_1 x_1) ... exp(s_k x_k) the i-th is Ad(exp(s_i+1 x_i+1) ... exp(s_k x_k))^-1 s_i.
    """
    behind, columns = pin.SE3.Identity(), []
    for screw, coordinate in zip(slot.screws.T[::-1], value[::-1].tolist(), strict=True):
        columns.append(behind.actInv(pin.Motion(screw)).vector)
        behind = pin.exp6(pin.Motion(screw * coordinate)) * behind
    return np.column_stack(columns[::-1]) if columns else np.empty((6, 0))


def require_written(earlier: EarlierJoints, robot: Robot, source: str) -> None:
    """Refuse a robot that is not the one that an earlier calibration wrote.

    Raises:
        RobotError: naming the joint, how far off it is, and the way out.
    """
    for joint, origin in earlier.origins.items():
        if joint not in robot.tree.joints:
            raise RobotError(f"{source} calibrated joint '{joint}', which {robot.description.path} does not have")
        present = robot.tree.joints[joint].origin
        if not same_origin(present, origin):
            off_mm, off_mrad = distance_mm_mrad(present, origin)
            raise RobotError(
                f"joint '{joint}' of {robot.description.path} is {off_mm:.4g} mm and {off_mrad:.4g} mrad from where {source} has it; "
                "fit the URDF that was written with that calibration (urdfcal apply writes it again)"
            )
