"""Gravity's moments at the joints."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from tests.support.sensor_cases import CASES, seen_robot
from urdfcal.base.errors import UsageError
from urdfcal.base.geometry import Matrix, Vector
from urdfcal.model.gravity import G, Gravity, WeighedRobot, parse_gravity, parse_payload
from urdfcal.robot.configurations import whole_configurations
from urdfcal.robot.robot import Robot

DOWN = Gravity()
OBLIQUE = Gravity((0.48, -0.6, 0.64))
HEAVY = ["panda", "ur5", "tiago"]


def arm(name: str, robots: dict[str, Robot]) -> Robot:
    """A robot of ours, or one whose first joints carry what it is measured from."""
    return seen_robot(CASES["reference carried"], robots) if name == "reference carried" else robots[name]


def positions(robot: Robot, rng: np.random.Generator, n: int = 6) -> Matrix:
    return rng.uniform(-2, 2, (n, len(robot.chain.inputs))) * np.where([joint.prismatic for joint in robot.chain.inputs], 0.1, 1.0)


def axes_of(robot: Robot) -> Matrix:
    return np.array([step.joint.axis for step in robot.chain.moving])


@pytest.mark.parametrize("gravity", [DOWN, OBLIQUE], ids=["down", "oblique"])
@pytest.mark.parametrize("name", [*HEAVY, "reference carried"])
def test_moments_about_the_axes_are_pinocchios(name: str, gravity: Gravity, robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """About each turning joint's own axis gravity pulls with minus what `computeGeneralizedGravity` says that holds it."""
    robot = arm(name, robots)
    q, model = positions(robot, rng), robot.model.copy()
    model.gravity.linear = G * np.array(gravity.direction)
    own = np.einsum("nmi,mi->nm", WeighedRobot(robot, gravity).moments(q), axes_of(robot))
    turning = [index for index, step in enumerate(robot.chain.moving) if not step.joint.prismatic]
    columns = [model.joints[model.getJointId(robot.chain.moving[index].joint.name)].idx_v for index in turning]
    for pose, whole in enumerate(whole_configurations(robot, q)):
        expected = -pin.computeGeneralizedGravity(model, model.createData(), whole)[columns]
        np.testing.assert_allclose(own[pose, turning], expected, atol=1e-10)


@pytest.mark.parametrize("name", [*HEAVY, "reference carried"])
def test_moments_are_slopes_of_the_potential_energy(name: str, robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Turning a joint by a little changes the potential energy by minus gravity's moment about it, whatever follows."""
    robot = arm(name, robots)
    q, weighed, step = positions(robot, rng, 1), WeighedRobot(robot, OBLIQUE), 1e-5
    own = np.einsum("mi,mi->m", weighed.moments(q)[0], axes_of(robot))

    def energy(position: Matrix) -> float:
        return float(pin.computePotentialEnergy(weighed.model, weighed.model.createData(), whole_configurations(robot, position)[0]))

    for column, joint in enumerate(robot.chain.inputs):
        if not joint.prismatic:
            shift = np.eye(len(robot.chain.inputs))[column][None] * step
            slope = (energy(q + shift) - energy(q - shift)) / (2 * step)
            index = next(index for index, each in enumerate(robot.chain.moving) if each.joint.name == joint.name)
            assert slope == pytest.approx(-own[index], abs=1e-6)


@pytest.mark.parametrize("name", [*HEAVY, "arm7", "reference carried"])
def test_moments_are_levers_times_weights(name: str, robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """All three components: the sum over the bodies behind a joint of lever x weight, in the joint's frame; with a payload too."""
    robot = arm(name, robots)
    weighed = WeighedRobot(robot, replace(OBLIQUE, payloads={robot.rig.tip: 3.0}))
    model, data, q = weighed.model, weighed.model.createData(), positions(robot, rng, 3)
    moments, pull = weighed.moments(q), G * np.array(OBLIQUE.direction)
    for pose, whole in enumerate(whole_configurations(robot, q)):
        pin.forwardKinematics(model, data, whole)
        for place, step in enumerate(robot.chain.moving):
            joint = model.getJointId(step.joint.name)
            total = np.zeros(3)
            for body in model.subtrees[joint].tolist():
                inertia = model.inertias[body]
                total += np.cross(data.oMi[body].act(inertia.lever) - data.oMi[joint].translation, inertia.mass * pull)
            np.testing.assert_allclose(moments[pose, place], data.oMi[joint].rotation.T @ total, atol=1e-9)


def test_a_payload_pulls_where_it_hangs(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Moments per kilogram are the lever to the link's origin times a kilogram's weight; a stated payload adds as many of them."""
    robot = robots["ur5"]
    q, bare = positions(robot, rng), WeighedRobot(robot, OBLIQUE)
    kilogram = bare.payload_moments(q, "tool0")
    loaded = WeighedRobot(robot, replace(OBLIQUE, payloads={"tool0": 2.5}))
    np.testing.assert_allclose(loaded.moments(q), bare.moments(q) + 2.5 * kilogram, atol=1e-10)
    np.testing.assert_allclose(loaded.payload_moments(q, "tool0"), kilogram, atol=1e-12)
    model, data = robot.model, robot.model.createData()
    pin.framesForwardKinematics(model, data, whole_configurations(robot, q)[2])
    for place, step in enumerate(robot.chain.moving):
        frame = data.oMi[model.getJointId(step.joint.name)]
        lever = data.oMf[model.getFrameId("tool0")].translation - frame.translation
        expected = frame.rotation.T @ np.cross(lever, G * np.array(OBLIQUE.direction))
        np.testing.assert_allclose(kilogram[2, place], expected, atol=1e-10)


def test_where_masses_are_missing_generic_ones_stand_in(robots: dict[str, Robot]) -> None:
    """arm7 and two arms without inertias, and a UR5 whose links all weigh the same, get rods and drives; the Panda keeps its own."""
    alike = robots["ur5"].model.copy()
    for index in range(1, alike.njoints):
        alike.inertias[index] = pin.Inertia(1.0, np.zeros(3), np.eye(3))
    for robot in (robots["arm7"], seen_robot(CASES["hand sees hand"], robots), replace(robots["ur5"], model=alike)):
        weighed = WeighedRobot(robot, DOWN)
        assert weighed.generic
        masses = [weighed.model.inertias[joint].mass for joint in weighed.joints]
        assert min(masses) >= 1.5
    panda = WeighedRobot(robots["panda"], DOWN)
    assert not panda.generic
    for joint in panda.joints:
        assert panda.model.inertias[joint] == robots["panda"].model.inertias[joint]


def test_generic_masses_pull_like_real_ones(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Divided by its largest, the shoulder's and the elbow's generic moment of a UR5 follows the real one."""
    robot = robots["ur5"]
    bare = robot.model.copy()
    for index in range(bare.njoints):
        bare.inertias[index] = pin.Inertia.Zero()
    q = positions(robot, rng, 200)
    real, generic = (
        np.einsum("nmi,mi->nm", WeighedRobot(each, DOWN).moments(q), axes_of(robot)) for each in (robot, replace(robot, model=bare))
    )
    for place in (1, 2):
        assert np.corrcoef(real[:, place], generic[:, place])[0, 1] > 0.97


def test_the_callers_model_stays_as_it_is(robots: dict[str, Robot]) -> None:
    """Masses, payloads and gravity go on a copy."""
    model = robots["arm7"].model
    before = model.copy()
    WeighedRobot(robots["arm7"], Gravity((1.0, 0.0, 0.0), {"slm": 4.0}))
    assert model == before


@pytest.mark.parametrize(
    ("text", "vector"), [("0,0,-1", (0, 0, -1)), ("0, 0, -9.81", (0, 0, -1)), ("3,0,4", (0.6, 0, 0.8))], ids=["unit", "SI", "oblique"]
)
def test_a_direction_is_made_a_unit_vector(text: str, vector: Vector) -> None:
    """Whatever length it is given with."""
    np.testing.assert_allclose(parse_gravity(text), vector, atol=1e-15)


@pytest.mark.parametrize("text", ["", "0,0", "0,0,0", "down", "0,0,nan", "1,2,3,4", "0,0,inf"])
def test_what_is_no_direction_is_refused(text: str) -> None:
    """With what was found and an example."""
    with pytest.raises(UsageError, match=r"--gravity .*: expected three numbers such as 0,0,-1"):
        parse_gravity(text)


def test_payloads_are_read_and_refused() -> None:
    """`2.5@tool0` and `2.5kg@tool0` are the same; no mass, no link, or a mass below zero is none."""
    assert parse_payload("2.5@tool0") == parse_payload(" 2.5kg @ tool0") == ("tool0", 2.5)
    for text in ("2.5", "@tool0", "2.5@", "-1@tool0", "0@tool0", "heavy@tool0", "nan@tool0", "2.5lb@tool0"):
        with pytest.raises(UsageError, match=r"--payload .*: expected a mass and a link, such as 2.5@tool0"):
            parse_payload(text)


def test_a_payload_hangs_on_a_link_that_is_there(robots: dict[str, Robot]) -> None:
    """Or is refused by name."""
    with pytest.raises(UsageError, match=r"--payload 1@tool: no link named 'tool' among \d+ links; did you mean 'tool0'\?"):
        WeighedRobot(robots["ur5"], Gravity(payloads={"tool": 1.0}))
