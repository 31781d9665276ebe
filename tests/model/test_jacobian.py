"""Jac1 against Pinocchio's regressor and against central differences, away from zero."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from tests.support.helpers import ROBOTS, central_differences, poses_in_view
from urdfcal.base.errors import ShapeMismatch
from urdfcal.base.geometry import six_screws
from urdfcal.model.gauge import build_error_model
from urdfcal.model.jacobian import arm_motion
from urdfcal.model.kinematics import ArmKinematics
from urdfcal.model.options import ModelOptions
from urdfcal.model.slots import MODELS
from urdfcal.robot.robot import Robot
from urdfcal.sensors.spots import beams_at, beams_in, spot_jacobian

SCALES = [0.0, 1e-9, 1e-5, 1e-2, 0.1]


@pytest.mark.parametrize("scale", SCALES, ids="x~{:g}".format)
@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("name", ROBOTS)
def test_jacobians_are_derivatives(robots: dict[str, Robot], name: str, model: str, scale: float, rng: np.random.Generator) -> None:
    """Jac2 Jac1 is the derivative of the spots to 1e-7 of each column's scale, beams and screen included."""
    robot = robots[name]
    errors = build_error_model(robot.chain, robot.rig, ModelOptions(error_model=model, estimate=("beams4", "screen")))
    x = rng.normal(0, scale, len(errors.names)) if scale else np.zeros(len(errors.names))
    q = poses_in_view(robot, errors, x, 5, rng)

    def spots(state: np.ndarray) -> np.ndarray:
        return beams_in(robot.chain, arm_motion(errors, q, state)).spots

    motion = arm_motion(errors, q, x)
    jacobian = spot_jacobian(spots(x), beams_in(robot.chain, motion).direction) @ motion.jac1[:, None]
    jacobian *= errors.placements(x).moves[robot.chain.laser_frames][:, None, :]
    expected = central_differences(spots, x, step=1e-5)
    scale_of_column = np.maximum(np.abs(expected).max(axis=(0, 1, 2)), 1e-3)
    worst = (np.abs(jacobian - expected) / scale_of_column).max(axis=(0, 1, 2))
    assert worst.max() < 1e-7, f"{errors.names[int(worst.argmax())]} is off by {worst.max():.2g} of its scale"


@pytest.mark.parametrize("name", ROBOTS)
def test_joint_jacobian_is_the_derivative_by_q(robots: dict[str, Robot], name: str, rng: np.random.Generator) -> None:
    """The twist per measured joint moves the spots as differences in q do."""
    robot = robots[name]
    errors = build_error_model(robot.chain, robot.rig)
    x = rng.normal(0, 0.01, len(errors.names))
    q = poses_in_view(robot, errors, x, 1, rng)[0]

    def spots(positions: np.ndarray) -> np.ndarray:
        return beams_in(robot.chain, arm_motion(errors, positions[None], x)).spots[0]

    motion = arm_motion(errors, q[None], x)
    direction = beams_in(robot.chain, motion).direction
    jacobian = spot_jacobian(spots(q)[None], direction)[0] @ motion.axis_twists @ robot.chain.coupling.T
    np.testing.assert_allclose(jacobian, central_differences(spots, q), rtol=1e-7, atol=1e-8)


@pytest.mark.parametrize("name", ["arm7", "panda", "tiago"])
def test_twists_are_pinocchios_regressor(robots: dict[str, Robot], name: str, rng: np.random.Generator) -> None:
    """At x = 0 the columns of a six-direction model are those of computeFrameKinematicRegressor of the whole robot."""
    robot = robots[name]
    errors = build_error_model(robot.chain, robot.rig, ModelOptions(error_model="placement"))
    q = rng.uniform(-1, 1, (1, len(robot.chain.inputs)))
    motion = arm_motion(errors, q, np.zeros(len(errors.names)))
    model, data = robot.model, robot.model.createData()
    full = pin.neutral(model)
    for joint, value in zip(robot.chain.inputs, q[0], strict=True):
        full[model.joints[model.getJointId(joint.name)].idx_q] = value
    pin.framesForwardKinematics(model, data, full)
    screen, module = (model.getFrameId(link) for link in (robot.rig.base, robot.rig.tip))
    regressor = pin.computeFrameKinematicRegressor(model, data, module, pin.LOCAL)
    screen_module = data.oMf[screen].actInv(data.oMf[module])
    for step in robot.chain.moving:
        joint = model.getJointId(step.joint.name)
        columns = [
            errors.names.index(f"{step.joint.name}.{parameter}")
            for parameter in ("trans_x", "trans_y", "trans_z", "rot_x", "rot_y", "rot_z")
        ]
        expected = screen_module.action @ regressor[:, 6 * (joint - 1) : 6 * joint] @ six_screws()
        np.testing.assert_allclose(motion.jac1[0][:, columns], expected, atol=1e-12)


def test_home_pose_of_the_seven_joint_arm(robots: dict[str, Robot]) -> None:
    """At q = 0 the module and its spots are where the digest of the paper has them."""
    robot = robots["arm7"]
    errors = build_error_model(robot.chain, robot.rig)
    beams = beams_at(errors, np.zeros(len(errors.names)), np.zeros((1, 7)))
    np.testing.assert_allclose(beams.source[0] * 1e3, [[-500, 100, -450]] * 2, atol=1e-9)
    np.testing.assert_allclose(beams.spots[0] * 1e3, [[-188.675, -450.0], [388.675, -450.0]], atol=5e-4)
    np.testing.assert_allclose(beams.length[0] * 1e3, [577.350, 577.350], atol=5e-4)


def test_positions_of_the_wrong_shape_are_refused(robots: dict[str, Robot]) -> None:
    """q must have one column a measured joint."""
    with pytest.raises(ShapeMismatch, match=r"expected joint positions of shape \(poses, 7\)"):
        ArmKinematics(robots["arm7"].chain).chain_positions(np.zeros((3, 6)))
