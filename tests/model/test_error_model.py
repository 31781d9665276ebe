"""Slots, parameters and their placements."""

from __future__ import annotations

import pickle

import numpy as np
import pinocchio as pin
import pytest

from tests.support.helpers import ROBOTS, assert_poses_close
from urdfcal.base.errors import ShapeMismatch, UsageError
from urdfcal.model.gauge import build_error_model
from urdfcal.model.options import ModelOptions, ParameterPrior
from urdfcal.model.slots import MODELS
from urdfcal.robot.robot import Robot


def rot(axis: int, angle: float) -> pin.SE3:
    """Rotation about a coordinate axis."""
    return pin.SE3(pin.exp3(np.eye(3)[axis] * angle), np.zeros(3))


def trans(x: float, z: float) -> pin.SE3:
    """Translation along x and z."""
    return pin.SE3(np.eye(3), np.array([x, 0.0, z]))


def test_dh_errors_are_equation_2(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """With errors of centimetres and degrees the joint placements of arm7 are Trans Trans Rot Rot of the sums, exactly."""
    robot = robots["arm7"]
    errors = build_error_model(robot.chain, robot.rig, ModelOptions(error_model="dh"))
    x = rng.normal(0, 0.05, len(errors.names))
    value = dict(zip(errors.names, x, strict=True))
    table = [(-0.5, 0, -90, -90), (0, 0.1, -90, 90), (0, 0, -90, -90), (0, 0.2, 90, 0), (0, 0, -90, 0), (0, 0.2, 90, 90), (0, 0, 90, 0)]
    for number, (a, d, alpha, theta) in enumerate(table, start=1):
        da, dd, dalpha, dtheta = (value[f"joint{number}.d_{name}"] for name in ("a", "d", "alpha", "theta"))
        expected = trans(a + da, d + dd) * rot(0, np.radians(alpha) + dalpha) * rot(2, np.radians(theta) + dtheta)
        assert_poses_close(pin.SE3(errors.placements(x).joints[number - 1]), expected, mm=1e-9, mrad=1e-9)


def test_the_mount_is_the_papers_five(robots: dict[str, Robot]) -> None:
    """Under dh the module has Trans x, Trans z along the last frame's axes, as in (2), then Rot x, Rot y, Rot z of its own."""
    robot = robots["arm7"]
    errors = build_error_model(robot.chain, robot.rig, ModelOptions(error_model="dh"))
    assert errors.names[28:] == ("slm.trans_x", "slm.trans_z", "slm.rot_x", "slm.rot_y", "slm.rot_z")
    x = np.zeros(33)
    x[28:] = 0.01, -0.02, 0.03, 0.04, -0.05
    to_module = robot.chain.T_last_module
    laser = to_module.actInv(pin.SE3(errors.placements(np.zeros(33)).frames[0]))
    moved = trans(0.01, -0.02) * to_module * rot(0, 0.03) * rot(1, 0.04) * rot(2, -0.05)
    assert_poses_close(pin.SE3(errors.placements(x).frames[0]), moved * laser)


@pytest.mark.parametrize("model", MODELS)
@pytest.mark.parametrize("name", ROBOTS)
def test_written_origins_are_the_model(robots: dict[str, Robot], name: str, model: str, rng: np.random.Generator) -> None:
    """Joint origins with the errors in them, multiplied along the way, give the error model's placements."""
    robot = robots[name]
    errors = build_error_model(robot.chain, robot.rig, ModelOptions(error_model=model, estimate=("beams4",)))
    x = rng.normal(0, 0.02, len(errors.names))
    origins, placed = errors.corrected_origins(x), errors.placements(x)
    edge, edges = pin.SE3.Identity(), []
    for step in robot.chain.steps:
        origin = origins.get(step.joint.name, step.joint.origin)
        edge = edge * (origin if step.forward else origin.inverse())
        if step.joint.moves:
            edges.append(edge)
            edge = pin.SE3.Identity()
    for actual, expected in zip(edges, placed.joints, strict=True):
        assert_poses_close(actual, pin.SE3(expected), mm=1e-10, mrad=1e-10)
    for way, expected in zip(robot.chain.laser_joints, placed.frames, strict=True):
        laser = edge
        for joint in way:
            laser = laser * origins.get(joint.name, joint.origin)
        assert_poses_close(laser, pin.SE3(expected), mm=1e-10, mrad=1e-10)


def test_a_copy_leaves_behind_what_can_be_worked_out_again(robots: dict[str, Robot]) -> None:
    """Pickled after use it is no larger than before, and places the arm alike."""
    robot = robots["panda"]
    errors = build_error_model(robot.chain, robot.rig)
    before, x = len(pickle.dumps(errors)), np.full(len(errors.names), 0.01)
    placed = errors.placements(x)
    assert errors.arm.elements
    copied = pickle.dumps(errors)
    assert len(copied) <= before
    np.testing.assert_array_equal(pickle.loads(copied).placements(x).joints, placed.joints)


def test_untouched_joints_are_not_written(robots: dict[str, Robot]) -> None:
    """Only joints with a parameter in the state get a new origin."""
    robot = robots["panda"]
    errors = build_error_model(robot.chain, robot.rig, ModelOptions(only=("panda_joint3.*",)))
    assert set(errors.corrected_origins(np.ones(len(errors.names)) * 0.01)) == {"panda_joint3"}


def test_a_held_value_is_in_the_robot(robots: dict[str, Robot]) -> None:
    """A parameter fixed at a stated value leaves the state and is written all the same."""
    robot = robots["arm7"]
    options = ModelOptions(error_model="dh", single={"joint2.d_a": ParameterPrior(mean=0.003, fixed=True)})
    errors = build_error_model(robot.chain, robot.rig, options)
    assert "joint2.d_a" not in errors.names
    moved = errors.placements(np.zeros(len(errors.names))).joints[1][:3, 3] - robot.tree.joints["joint2"].origin.translation
    assert np.linalg.norm(moved) == pytest.approx(0.003)
    assert "joint2" in errors.corrected_origins(np.zeros(len(errors.names)))


def test_priors_go_by_group_unit_and_name(robots: dict[str, Robot]) -> None:
    """Defaults are the contract's; a rig.yaml entry overrides a single one."""
    robot = robots["panda"]
    options = ModelOptions(estimate=("beams",), single={"panda_joint3.d_alpha": ParameterPrior(sigma=1e-4)})
    sigma = dict(zip((errors := build_error_model(robot.chain, robot.rig, options)).names, errors.sigma, strict=True))
    found = [
        sigma[name]
        for name in (
            "panda_joint4.d_a",
            "panda_joint4.d_alpha",
            "slm.trans_x",
            "slm.rot_x",
            "screen.trans_z",
            "screen.rot_y",
            "laser_1.rot_x",
        )
    ]
    np.testing.assert_allclose(found, [0.010, np.radians(1), 0.020, np.radians(2), 0.100, np.radians(5), np.radians(1)])
    assert sigma["panda_joint3.d_alpha"] == 1e-4


def test_patterns_that_mean_nothing_are_refused(robots: dict[str, Robot]) -> None:
    """--fix and --only name the nearest parameter when theirs does not exist."""
    robot = robots["arm7"]
    for options in (ModelOptions(fix=("joint3.d_alfa",)), ModelOptions(only=("joint3.d_alfa",))):
        with pytest.raises(UsageError, match=r"did you mean 'joint3.d_alpha'"):
            build_error_model(robot.chain, robot.rig, options)


def test_a_state_of_the_wrong_length_is_refused(robots: dict[str, Robot]) -> None:
    """x must have one number a parameter."""
    robot = robots["arm7"]
    errors = build_error_model(robot.chain, robot.rig)
    with pytest.raises(ShapeMismatch, match=f"{len(errors.names)} parameters, x has shape"):
        errors.placements(np.zeros(5))
