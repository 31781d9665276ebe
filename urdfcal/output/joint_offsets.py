"""Joint offsets alone: what a controller that cannot change its geometry can still take over, and what that loses.

An offset moves a joint along itself: corrected = nominal * delta, and of delta only the part along the joint's own axis is kept. For
a turning joint that is the twist of the swing-twist decomposition, theta = 2 atan2(q . axis, q_w) with delta's quaternion (q_w, q);
for D-H errors in the order of equation (2) it is d_theta itself. For a sliding joint it is the translation along the axis.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pinocchio as pin

from urdfcal.base.errors import RigError, RobotError
from urdfcal.base.geometry import MM, SE3, Matrix, Vector, rotation_screw, translation_screw
from urdfcal.base.terminal import rounded
from urdfcal.output.driver_yaml import yaml_text
from urdfcal.robot.configurations import has_room, random_configurations
from urdfcal.robot.corrections import OriginCorrection, corrected_model
from urdfcal.robot.robot import Robot
from urdfcal.robot.urdf_tree import UrdfJoint

CONFIGURATIONS = 1000
_NOTHING = 1e-3  # [mm]


@dataclass(frozen=True)
class OffsetLoss:
    """How far a tool is off where offsets alone are deployed, over random configurations, [mm].

    Attributes:
        tool, base: Links; the tool's position relative to the base is meant.
        mean_mm, max_mm: With offsets alone, from where the whole correction puts the tool.
        nominal_mean_mm, nominal_max_mm: The same with nothing deployed.
        configurations: How many.
        held: Joints whose limits leave them no room, so that they stand still in all of these.
    """

    tool: str
    base: str
    mean_mm: float
    max_mm: float
    nominal_mean_mm: float
    nominal_max_mm: float
    configurations: int
    held: tuple[str, ...] = ()

    @property
    def warnings(self) -> tuple[str, ...]:
        """What to say of it; nothing where nothing is lost."""
        return (*self._loss(), *self._held())

    def _held(self) -> tuple[str, ...]:
        if not self.held:
            return ()
        return (
            f"lower and upper limit of {', '.join(self.held)} are the same: what offsets alone lose is judged with these at one position, "
            "and may be more elsewhere",
        )

    def _loss(self) -> tuple[str, ...]:
        if self.max_mm < _NOTHING:
            return ()
        return (
            f"offsets alone keep the nominal geometry: they leave '{self.tool}' {rounded(self.mean_mm, 3)} mm off in the mean and "
            f"{rounded(self.max_mm, 3)} mm at most, of {rounded(self.nominal_mean_mm, 3)} and "
            f"{rounded(self.nominal_max_mm, 3)} mm without any correction; "
            "where offsets are all that can be deployed, fit with --error-model offset",
        )


def joint_offset(joint: UrdfJoint, delta: SE3) -> float:
    """The part of a correction along the joint's own motion, [rad] or [m]."""
    axis = np.array(joint.axis)
    if joint.prismatic:
        return float(axis @ delta.translation)
    quaternion = pin.Quaternion(delta.rotation)
    angle = 2 * np.arctan2(axis @ quaternion.vec(), quaternion.w)
    return float(np.remainder(angle + np.pi, 2 * np.pi) - np.pi)


def joint_offsets(robot: Robot, origins: Mapping[str, SE3]) -> dict[str, float]:
    """The offset of every moving joint that was corrected, [rad] or [m]; position in the model = reading + offset.

    Raises:
        RobotError: no moving joint was corrected.
    """
    joints = robot.tree.joints
    offsets = {
        name: joint_offset(joints[name], joints[name].origin.actInv(origin)) for name, origin in origins.items() if joints[name].moves
    }
    if not offsets:
        raise RobotError("no moving joint was corrected, so there are no joint offsets", robot.description.label)
    return offsets


def offsets_yaml(robot: Robot, origins: Mapping[str, SE3], loss: OffsetLoss) -> bytes:
    """Offsets, and the limits that they shift: a stop that is reached at reading q stands at q + offset in the model."""
    joints = robot.tree.joints
    entries = {name: _entry(joints[name], offset) for name, offset in joint_offsets(robot, origins).items()}
    comments = [
        "Joint offsets found by urdfcal, in rad (m where the joint slides): position in the nominal model = reading + offset.",
        "A joint that is not listed has none.",
        "lower and upper are the nominal limits shifted alike, for a controller that counts from the new zero.",
        *(f"NOTE: {warning}" for warning in loss.warnings),
    ]
    lost = {
        "tool": loss.tool,
        "base": loss.base,
        "configurations": loss.configurations,
        "offsets_alone_mm": {"mean": loss.mean_mm, "max": loss.max_mm},
        "nothing_mm": {"mean": loss.nominal_mean_mm, "max": loss.nominal_max_mm},
    }
    return yaml_text(comments, {"robot": robot.name, "joints": entries, "off_from_the_whole_correction": lost})


def offset_loss(robot: Robot, origins: Mapping[str, SE3], rng: np.random.Generator, count: int = CONFIGURATIONS) -> OffsetLoss:
    """Where offsets alone put the tool, against the whole correction.

    The tool is the module and the base the screen, both where the calibration found them; without the rig, the links at the ends
    of the calibrated joints. Configurations are drawn evenly between the joints' limits.

    Args:
        robot: The description that the origins belong to.
        origins: Corrected placement by joint name.
        rng: Source of randomness.
        count: How many configurations.

    Raises:
        RobotError: no moving joint was corrected.
    """
    joints = robot.tree.joints
    base, tool = _ends(robot, joint_offsets(robot, origins))
    alone = {
        name: joints[name].origin * pin.exp6(joint_screw(joints[name]) * value) for name, value in joint_offsets(robot, origins).items()
    }
    fixed = {name: origin for name, origin in origins.items() if not joints[name].moves}
    q = random_configurations(robot, rng, count)
    whole, offsets, nominal = (_positions(robot, placed, base, tool, q) for placed in (origins, fixed | alone, fixed))
    lost, uncorrected = (np.linalg.norm(found - whole, axis=1) / MM for found in (offsets, nominal))
    return OffsetLoss(
        tool=tool,
        base=base,
        mean_mm=float(lost.mean()),
        max_mm=float(lost.max()),
        nominal_mean_mm=float(uncorrected.mean()),
        nominal_max_mm=float(uncorrected.max()),
        configurations=count,
        held=tuple(name for name, joint in joints.items() if joint.moves and joint.mimic is None and not has_room(joint)),
    )


def _entry(joint: UrdfJoint, offset: float) -> dict[str, Any]:
    entry: dict[str, Any] = {"offset": offset, "unit": "m" if joint.prismatic else "rad"}
    if np.isfinite(joint.upper - joint.lower):
        entry |= {"lower": joint.lower + offset, "upper": joint.upper + offset}
    return entry


def joint_screw(joint: UrdfJoint) -> Vector:
    """Along which a joint moves, in its own frame, (6,)."""
    axis = np.array(joint.axis)
    return translation_screw(axis) if joint.prismatic else rotation_screw(axis, np.zeros(3))


def _ends(robot: Robot, moving: Mapping[str, float]) -> tuple[str, str]:
    """Screen and module, or the links before the first and behind the last corrected joint where there is no rig."""
    joints = sorted((robot.tree.joints[name] for name in moving), key=lambda joint: len(robot.tree.path_from_root(joint.child)))
    try:
        return robot.rig.base, robot.rig.tip
    except RigError:
        return joints[0].parent, joints[-1].child


def _positions(robot: Robot, origins: Mapping[str, SE3], base: str, tool: str, q: Matrix) -> Matrix:
    """The tool's position relative to the base, (n, 3), [m], with some origins corrected."""
    joints = robot.tree.joints
    model = corrected_model(
        robot.model, {name: OriginCorrection(joints[name].origin, origin, joints[name].moves) for name, origin in origins.items()}
    )
    data, frames = model.createData(), (model.getFrameId(base, pin.BODY), model.getFrameId(tool, pin.BODY))
    found = np.empty((len(q), 3))
    for pose, configuration in enumerate(q):
        pin.forwardKinematics(model, data, configuration)
        T_world_base, T_world_tool = (pin.updateFramePlacement(model, data, frame) for frame in frames)
        found[pose] = T_world_base.actInv(T_world_tool).translation
    return found
