"""Stacked kinematics against Pinocchio's forward kinematics and frame Jacobians, on arms of every kind."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from tests.support.helpers import assert_poses_close
from tests.support.pinocchio_arm import PinocchioArm
from tests.support.sensor_cases import ARRANGED, SINGLE, seen_robot
from urdfcal.base.geometry import Matrix
from urdfcal.model.error_model import ErrorModel, with_softness
from urdfcal.model.gauge import build_error_model
from urdfcal.model.gravity import Gravity, WeighedRobot
from urdfcal.model.jacobian import ArmMotion, motion_at
from urdfcal.model.kinematics import ArmKinematics, PlacedArm
from urdfcal.model.options import ModelOptions
from urdfcal.model.softness import Yielding, unit_terms
from urdfcal.robot.robot import Robot

KINDS = ["panda", "tiago", "arm7", "point", "reference carried", "points on the base", "head camera", "hand sees hand", "lasers and points"]


def placed_arm(name: str, robots: dict[str, Robot], rng: np.random.Generator) -> tuple[Robot, ErrorModel, Matrix]:
    """A robot with lasers or targets on it, its error model, and joint positions."""
    robot = robots[name] if name in robots else seen_robot((SINGLE | ARRANGED)[name], robots)
    errors = build_error_model(robot.chain, robot.rig, ModelOptions(error_model="placement"))
    slides = np.array([joint.prismatic for joint in robot.chain.inputs])
    return robot, errors, rng.uniform(-2.5, 2.5, (6, len(slides))) * np.where(slides, 0.1, 1.0)


def moving(arm: ArmKinematics, errors: ErrorModel, q: Matrix, rng: np.random.Generator) -> tuple[ArmMotion, PinocchioArm, Matrix]:
    """An arm whose joints all give way, its witness, and the positions of all joints of that, in its order."""
    chain = errors.chain
    terms, positions = unit_terms(chain), arm.chain_positions(q)
    angles = rng.normal(0, 0.1, (len(q), len(terms)))
    bends = iter(range(len(terms)))
    yielding = Yielding(
        columns=np.empty(0, dtype=np.intp),
        joints=tuple(term.joint for term in terms),
        bends=tuple(-1 if term.axis is None else next(bends) for term in terms),
        basis=angles,
        x=np.ones(len(terms)),
    )
    placed = errors.placements(rng.normal(0, 0.02, len(errors.names)))
    witness, every = PinocchioArm(chain, placed, arm.bends), np.zeros((len(q), len(arm.elements)))
    for column, (joint, bend) in enumerate(witness.columns):
        own = [number for number, term in enumerate(terms) if (term.joint, yielding.bends[number]) == (joint, bend)]
        sign = 1.0 if chain.moving[joint].forward else -1.0
        every[:, column] = sign * angles[:, own].sum(axis=1) + (positions[:, joint] if bend < 0 else 0.0)
    return motion_at(arm, placed, positions, yielding), witness, every


@pytest.mark.parametrize("name", KINDS)
def test_frames_are_pinocchios(name: str, robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Lasers, targets and measuring frames of arms that bend about every axis stand where Pinocchio puts them, to 1e-9 mm."""
    robot, errors, q = placed_arm(name, robots, rng)
    soft = with_softness(errors, unit_terms(robot.chain), WeighedRobot(robot, Gravity()), robot.rig.tip).soft
    assert soft is not None
    motion, witness, every = moving(ArmKinematics(robot.chain, soft.bends), errors, q, rng)
    for index, frames in enumerate(motion.frames):
        for pose, found in enumerate(frames):
            assert_poses_close(pin.SE3(found[:, :3], found[:, 3]), witness.frame(every[pose], index), mm=1e-9, mrad=1e-9)


@pytest.mark.parametrize("name", KINDS)
def test_derivatives_are_pinocchios(name: str, robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """What a twist meets on its way out is Pinocchio's frame Jacobian by joints, and Ad(T_j) times the screws by parameters."""
    robot, errors, q = placed_arm(name, robots, rng)
    soft = with_softness(errors, unit_terms(robot.chain), WeighedRobot(robot, Gravity()), robot.rig.tip).soft
    assert soft is not None
    motion, witness, every = moving(ArmKinematics(robot.chain, soft.bends), errors, q, rng)
    placed, g = motion.placed.placed, rng.normal(size=(len(q), 4, 6))
    by_parameter, by_axis = motion.derivatives(g)
    last = int(np.argmax([frame.depth for frame in errors.chain.frames]))
    own = [number for number, (_, bend) in enumerate(witness.columns) if bend < 0]
    for pose in range(len(q)):
        J = witness.jacobian(every[pose], last)[:, own]
        reached = errors.chain.frames[last].depth
        np.testing.assert_allclose(by_axis[:reached, :, pose], (g[pose] @ J)[:, :reached].T, atol=1e-11)
        twists = [witness.body(every[pose], anchor) @ screw for anchor, screw in zip(placed.anchors, placed.screws.T, strict=True)]
        np.testing.assert_allclose(by_parameter[:, :, pose], np.array(twists) @ g[pose].T, atol=1e-11)


@pytest.mark.parametrize(("only", "known"), [("tool0.*", True), ("*joint.*", False)])
def test_joints_that_stand_still_are_worked_out_once(only: str, known: bool, robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Where parameters are of instruments alone, the arm is where it was a sweep before; where they are of joints it is not."""
    robot = seen_robot(SINGLE["point"], robots)
    errors, arm = build_error_model(robot.chain, robot.rig, ModelOptions(only=(only,))), ArmKinematics(robot.chain)
    posture = arm.posture(arm.chain_positions(rng.uniform(-1, 1, (3, 6))))
    one, other = (posture.frames(PlacedArm(arm, errors.placements(rng.normal(0, 0.1, len(errors.names))))) for _ in range(2))
    assert (one is other) == known
    assert np.array_equal(one, other) == known
