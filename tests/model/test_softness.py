"""Joints that give way with the pose: their terms, and how they move what is measured."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from tests.support.helpers import assert_poses_close, central_differences, poses_in_view
from tests.support.sensor_cases import CASES, SensorCase, session_errors, setup_of
from tests.support.small_robot import joint, robot_of, robot_text
from urdfcal.base.geometry import SE3, Matrix, Vector
from urdfcal.calibration.problem import Problem
from urdfcal.model.error_model import ErrorModel, with_softness
from urdfcal.model.gauge import build_error_model
from urdfcal.model.gravity import Gravity, WeighedRobot
from urdfcal.model.jacobian import motion_at
from urdfcal.model.kinematics import ArmKinematics
from urdfcal.model.options import ModelOptions
from urdfcal.model.softness import EXTRAS, Softness, across, extra_terms, gravity_terms
from urdfcal.robot.chain import Step
from urdfcal.robot.robot import Robot
from urdfcal.sensors.measurements import Measurements, spots_measured
from urdfcal.sensors.spots import beams_in
from urdfcal.simulation.readings import simulate_readings

CARRIED = SensorCase("panda", ("pose:panda_link0", "point:panda_link3"), "panda_link8")
SCREEN_CARRIED = robot_text(
    joint("one", "base", "a", '<origin xyz="0 0 0.3" rpy="0.2 0 0"/><axis xyz="0 0 1"/>'),
    joint("two", "a", "b", '<origin xyz="0.3 0 0.1"/><axis xyz="0 0.6 0.8"/>'),
    joint("three", "b", "c", '<origin xyz="0.2 0.1 0" rpy="0 0.3 0"/><axis xyz="0 1 0"/>'),
    joint("held", "c", "screen", '<origin xyz="0.1 0 0.1" rpy="0 1.2 0"/>', kind="fixed"),
    joint("m1", "base", "laser_1", '<origin xyz="-0.5 0 0.2" rpy="0 1.3 0"/>', kind="fixed"),
    joint("m2", "base", "laser_2", '<origin xyz="-0.5 0.1 0.2" rpy="0.2 1.5 0"/>', kind="fixed"),
    links="base a b c screen laser_1 laser_2",
)
SOFT = {**{name: None for name in ("panda", "ur5", "tiago", "arm7", "screen carried")}, "pose": CASES["pose"], "reference carried": CARRIED}
SOFT |= {name: CASES[name] for name in ("hand sees hand", "several targets", "lasers and points")}


def soft_model(robot: Robot, errors: ErrorModel, q: Matrix, gravity: Gravity | None = None) -> ErrorModel:
    """An error model with every soft term that there is."""
    weighed = WeighedRobot(robot, gravity or Gravity((0.36, 0.48, -0.8)))
    terms = (*gravity_terms(robot.chain, weighed.moments(q)), *extra_terms(robot.chain, EXTRAS))
    return with_softness(errors, terms, weighed, robot.rig.tip)


def soft_case(name: str, robots: dict[str, Robot], rng: np.random.Generator) -> tuple[Problem, Vector]:
    """A measured robot that gives way, with payloads and known last moves, and a state far from zero."""
    case = SOFT[name]
    if case is None:
        robot = robot_of(SCREEN_CARRIED) if name == "screen carried" else robots[name]
        errors = build_error_model(robot.chain, robot.rig)
        q = poses_in_view(robot, errors, np.zeros(len(errors.names)), 6, rng, 0.5)
        data = spots_measured(robot, q, np.zeros((6, len(robot.rig.lasers), 2)))
        x = np.zeros(len(errors.names))
    else:
        setup = setup_of(case, robots, rng)
        robot, data = setup.robot, simulate_readings(setup, 6, rng)
        errors, x = session_errors(setup, ModelOptions(error_model="auto", reference_known=case.known), data)
    data = replace(data, payload=rng.uniform(0, 3, len(data)), approach=rng.integers(-1, 2, data.q.shape).astype(float))
    soft = soft_model(robot, errors, data.q)
    x = np.append(x, np.zeros(len(soft.names) - len(x))) + rng.normal(0, 5e-3, len(soft.names))
    return Problem(soft, data), x


@pytest.mark.parametrize("name", SOFT)
def test_jacobian_is_the_derivative(name: str, robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Of every reading by every parameter, soft ones and geometry under softness, away from zero, whichever way joints are walked."""
    model, x = soft_case(name, robots, rng)
    here = model.linearise(x)
    numeric = -central_differences(lambda state: model.linearise(state).residual, x)
    soft = [index for index, parameter in enumerate(model.errors.parameters) if parameter.kind == "soft"]
    assert np.median(np.abs(here.jacobian[:, :, soft]).max(axis=(0, 1))) > 0.01
    np.testing.assert_allclose(here.jacobian, numeric, atol=3e-8 * max(1.0, np.abs(numeric).max()))


@pytest.mark.parametrize("name", ["panda", "screen carried", "reference carried", "hand sees hand"])
def test_a_soft_arm_is_the_product_of_its_turns(name: str, robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Module and targets stand where the URDF's origins, the joints' turns and the turns across them put them, multiplied by hand."""
    model, _ = soft_case(name, robots, rng)
    soft = model.errors.soft
    assert soft is not None
    chain, basis = soft.chain, soft.basis(model.data.q, model.data.payload, model.data.approach)
    values = dict(zip([term.name for term in soft.terms], rng.normal(0, 0.02, len(soft.terms)).tolist(), strict=True))
    bare = ErrorModel(chain, (), (), held=values, soft=soft)
    arm = ArmKinematics(chain, soft.bends)
    motion = motion_at(arm, bare.placements(np.empty(0)), arm.chain_positions(model.data.q), yielding=bare.yielding(np.empty(0), basis))
    beams = beams_in(chain, motion)
    positions = (model.data.q @ chain.coupling + chain.offset) * [1.0 if step.forward else -1.0 for step in chain.moving]
    for pose in range(len(model.data)):
        turned = [
            [(term, basis[pose, number] * values[term.name]) for number, term in enumerate(soft.terms) if term.joint == index]
            for index in range(len(chain.moving))
        ]
        T = behind(chain.steps, positions[pose], turned)[-1]
        for index, way in enumerate(chain.laser_joints):
            T_laser = T
            for fixed in way:
                T_laser = T_laser * fixed.origin
            np.testing.assert_allclose(beams.source[pose, index], T_laser.translation, atol=1e-12)
            np.testing.assert_allclose(beams.direction[pose, index], T_laser.rotation[:, 2], atol=1e-12)
        for index, frame in enumerate(chain.frames):
            T_frame = behind(chain.steps, positions[pose], turned)[frame.depth]
            for step in frame.steps:
                T_frame = T_frame * (step.joint.origin if step.forward else step.joint.origin.inverse())
            found = motion.frames[index][pose]
            assert_poses_close(pin.SE3(found[:, :3], found[:, 3]), T_frame, mm=1e-9, mrad=1e-9)


def behind(steps: tuple[Step, ...], positions: Vector, turned: list[list[tuple[object, float]]]) -> list[SE3]:
    """Frames on the screen's link behind each motion of the way, before the first and, last, at the module."""
    T, found, index = pin.SE3.Identity(), [pin.SE3.Identity()], 0
    for step in steps:
        if step.forward:
            T = T * step.joint.origin
        if step.joint.moves:
            M = own_motion(step, positions[index], turned[index])
            T = T * (M if step.forward else M.inverse())
            found.append(T)
            index += 1
        if not step.forward:
            T = T * step.joint.origin.inverse()
    return [*found, T]


def own_motion(step: Step, position: float, turned: list[tuple[object, float]]) -> SE3:
    """A joint's motion in its URDF direction: its own axis with all that turns it, then the axes across, in order."""
    axis = np.array(step.joint.axis)
    own = sum(angle for term, angle in turned if term.axis is None)  # type: ignore[attr-defined]
    if step.joint.prismatic:
        M = pin.SE3(np.eye(3), axis * (position + own))
    else:
        M = pin.SE3(pin.exp3(axis * (position + own)), np.zeros(3))
    for term, angle in turned:
        if term.axis is not None:  # type: ignore[attr-defined]
            M = M * pin.SE3(pin.exp3(np.array(term.axis) * angle), np.zeros(3))  # type: ignore[attr-defined]
    return M


def test_gravity_bends_what_it_can(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """A vertical axis does not sag about itself, nor a slide along itself; what is bent across has two axes, square to its own."""
    robot = robots["tiago"]
    q = rng.uniform(-1, 1, (100, len(robot.chain.inputs)))
    terms = gravity_terms(robot.chain, WeighedRobot(robot, Gravity()).moments(q))
    names = [term.name for term in terms]
    slide = next(step.joint.name for step in robot.chain.moving if step.joint.prismatic)
    assert f"{slide}.sag" not in names
    assert {f"{slide}.sag_1", f"{slide}.sag_2", "arm_2_joint.sag"} <= set(names)
    assert "arm_1_joint.sag" not in names
    for term in terms:
        if term.axis is not None:
            own = robot.chain.moving[term.joint].joint.axis
            assert abs(np.dot(own, term.axis)) < 1e-12
    assert len(set(names)) == len(names)


@pytest.mark.parametrize("axis", [(0, 0, 1), (1, 0, 0), (0, -0.6, 0.8), (0.6, 0.64, 0.48)])
def test_axes_across_make_a_frame(axis: Vector) -> None:
    """Both unit vectors are square to the axis and to each other, right-handed."""
    one, other = (np.array(each) for each in across(np.array(axis, dtype=float)))
    np.testing.assert_allclose(np.cross(axis, one), other, atol=1e-12)
    np.testing.assert_allclose(np.cross(one, other), axis, atol=1e-12)


def test_without_weight_there_is_nothing_to_bend(robots: dict[str, Robot]) -> None:
    """No moments, no terms."""
    chain = robots["panda"].chain
    assert gravity_terms(chain, np.zeros((10, len(chain.moving), 3))) == ()


def test_the_largest_deflection_is_the_parameter(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Over the poses that the terms were scaled by, no basis exceeds 1; about its own axis each reaches it."""
    robot = robots["panda"]
    q = rng.uniform(-2, 2, (100, 7))
    weighed = WeighedRobot(robot, Gravity())
    terms = gravity_terms(robot.chain, weighed.moments(q))
    basis = Softness(robot.chain, terms, weighed, robot.rig.tip).basis(q)
    own = [term.axis is None for term in terms]
    np.testing.assert_allclose(np.abs(basis[:, own]).max(axis=0), 1.0)
    assert np.abs(basis).max() <= 1.0 + 1e-12
    pairs = [index for index, term in enumerate(terms) if term.name.endswith(".sag_1")]
    np.testing.assert_allclose([np.hypot(basis[:, index], basis[:, index + 1]).max() for index in pairs], 1.0)


def test_terms_on_request_are_what_they_say(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Encoder scale q, eccentricity sin and cos of q and 2q, approach the sign of the last move; slides have scale and approach."""
    robot = robots["tiago"]
    chain, data = robot.chain, six_poses(robot, rng)
    terms = extra_terms(chain, EXTRAS)
    basis = Softness(chain, terms, WeighedRobot(robot, Gravity()), robot.rig.tip).basis(data.q, None, data.approach)
    turning = [column for column, each in enumerate(chain.inputs) if not each.prismatic]
    sliding = [column for column, each in enumerate(chain.inputs) if each.prismatic]
    assert sliding
    assert len(terms) == 6 * len(turning) + 2 * len(sliding)
    for column in sliding:
        name = chain.inputs[column].name
        own = {term.name: (number, term.unit) for number, term in enumerate(terms) if term.name.startswith(f"{name}.")}
        assert {word: unit for word, (_, unit) in own.items()} == {f"{name}.scale": "", f"{name}.approach": "m"}
        np.testing.assert_array_equal(basis[:, own[f"{name}.scale"][0]], data.q[:, column])
    assert data.approach is not None
    for column in turning:
        name, angle = chain.inputs[column].name, data.q[:, column]
        waves = {"ecc_sin": np.sin(angle), "ecc_cos": np.cos(angle), "ecc_sin2": np.sin(2 * angle), "ecc_cos2": np.cos(2 * angle)}
        for what, expected in ({"scale": angle, "approach": data.approach[:, column]} | waves).items():
            index = next(number for number, term in enumerate(terms) if term.name == f"{name}.{what}")
            np.testing.assert_array_equal(basis[:, index], expected)
    assert {term.name.rpartition(".")[2] for term in extra_terms(chain, ["scale"])} == {"scale"}
    assert extra_terms(chain, []) == ()


def test_a_payload_of_a_pose_bends_that_pose_alone(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Poses with 2 kg give the basis of a robot that carries 2 kg all the time, the others that of the bare one."""
    robot = robots["ur5"]
    q = rng.uniform(-2, 2, (4, 6))
    weighed = WeighedRobot(robot, Gravity())
    terms = gravity_terms(robot.chain, weighed.moments(q))
    module = robot.rig.tip
    bare, loaded = (Softness(robot.chain, terms, each, module) for each in (weighed, WeighedRobot(robot, Gravity(payloads={module: 2.0}))))
    found = bare.basis(q, np.array([0.0, 2.0, 0.0, 2.0]))
    np.testing.assert_allclose(found[::2], bare.basis(q)[::2], atol=1e-14)
    np.testing.assert_allclose(found[1::2], loaded.basis(q)[1::2], atol=1e-12)
    assert np.abs(found[1::2] - bare.basis(q)[1::2]).max() > 0.05


def six_poses(robot: Robot, rng: np.random.Generator) -> Measurements:
    q = rng.uniform(-1, 1, (6, len(robot.chain.inputs)))
    data = spots_measured(robot, q, np.zeros((6, len(robot.rig.lasers), 2)))
    return replace(data, approach=np.sign(np.diff(q, axis=0, prepend=q[:1])))
