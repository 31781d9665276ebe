"""A calibration in a controller's hands: corrected Pinocchio models, and what inverse kinematics gains by them."""

from __future__ import annotations

import importlib.util
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

import urdfcal
from tests.robot.test_urdf_writer import random_corrections
from tests.support.helpers import assert_poses_close
from tests.support.paths import ROOT
from tests.support.small_robot import URDF, robot_of
from urdfcal.base.errors import CalibrationFileError, RobotError, UsageError
from urdfcal.base.geometry import Vector
from urdfcal.calibration.reach import draw_poses
from urdfcal.model.error_model import ErrorModel
from urdfcal.robot.corrections import OriginCorrection, corrected_model, corrected_models
from urdfcal.robot.robot import Robot, robot_from
from urdfcal.robot.urdf_writer import with_origins
from urdfcal.simulation.readings import true_spots
from urdfcal.simulation.truth import SagScales, random_truth, soft_truth

NAMES = ("arm7", "panda", "ur5", "tiago")
EXAMPLE = ROOT / "examples" / "inverse_kinematics.py"
WEIGHTY = URDF.replace(  # a module, a tool and a base with mass, and a box on each
    '<link name="slm"/>', '<link name="slm"><inertial><mass value="0.7"/><origin xyz="0.01 0.02 0.03"/>'
    '<inertia ixx="1e-3" ixy="1e-4" ixz="0" iyy="2e-3" iyz="0" izz="2e-3"/></inertial>'
    '<visual><origin xyz="0 0.1 0" rpy="0.3 0 0"/><geometry><box size="1 2 3"/></geometry></visual></link>'
).replace(
    '<link name="tool"/>', '<link name="tool"><inertial><mass value="2"/><origin xyz="0.1 0 0"/>'
    '<inertia ixx="1e-2" ixy="0" ixz="0" iyy="2e-2" iyz="0" izz="2e-2"/></inertial>'
    '<visual><geometry><box size="1 1 1"/></geometry></visual></link>'
).replace(
    '<link name="base"/>', '<link name="base"><inertial><mass value="3"/>'
    '<inertia ixx="1" ixy="0" ixz="0" iyy="2" iyz="0" izz="2"/></inertial>'
    '<visual><origin rpy="0 0 1"/><geometry><sphere radius="0.1"/></geometry></visual></link>'
)  # fmt: skip


def calibrated(robot: Robot, rng: np.random.Generator, names: list[str] | None = None) -> tuple[dict[str, OriginCorrection], Robot]:
    """Errors of centimetres and degrees on joints, by default all between screen and lasers; and the robot whose URDF holds them."""
    way = [step.joint.name for step in robot.chain.steps] + [way[0].name for way in robot.chain.laser_joints]
    corrections = random_corrections(robot, rng, names or way)
    text = with_origins(robot.description, {name: correction.corrected for name, correction in corrections.items()})
    return corrections, robot_from(replace(robot.description, text=text))


def estimated(robot: Robot) -> list[str]:
    """The joints that a fit moves: those that turn or slide, the module's mount and the screen's."""
    chain = robot.chain
    fixed = [joint.name for joint in (chain.mount_joint, chain.screen_joint and chain.screen_joint.joint) if joint is not None]
    return [step.joint.name for step in chain.moving] + fixed


def assert_same_model(actual: Any, expected: Any, rng: np.random.Generator) -> None:
    """Fail where a frame stands elsewhere at random positions, or a joint weighs something else."""
    assert [frame.name for frame in actual.frames] == [frame.name for frame in expected.frames]
    here, there = actual.createData(), expected.createData()
    for _ in range(3):
        q = pin.integrate(actual, pin.neutral(actual), rng.uniform(-1, 1, actual.nv))
        pin.framesForwardKinematics(actual, here, q)
        pin.framesForwardKinematics(expected, there, q)
        for frame, mine, theirs in zip(actual.frames, here.oMf, there.oMf, strict=True):
            np.testing.assert_allclose(mine.homogeneous, theirs.homogeneous, atol=1e-9, err_msg=frame.name)
    for name, mine, theirs in zip(actual.names, actual.inertias, expected.inertias, strict=True):
        np.testing.assert_allclose(mine.toDynamicParameters(), theirs.toDynamicParameters(), atol=1e-9, err_msg=name)


def shapes(robot: Robot, model: Any, kind: Any = pin.GeometryType.VISUAL) -> Any:
    """The shapes of a robot's own URDF, without meshes, hung on a model of it."""
    import re

    text = re.sub(r"<(visual|collision)\b(?:(?!</\1>).)*?<mesh.*?</\1>", "", robot.description.text.decode(), flags=re.DOTALL)
    return pin.buildGeomFromUrdfString(model, text, kind)


@pytest.mark.parametrize("name", NAMES)
def test_a_corrected_model_is_the_one_read_from_the_calibrated_urdf(name: str, robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Every frame and inertia agrees with Pinocchio's reading of the written URDF to 1e-9; the model given stays as it was."""
    robot = robots[name]
    corrections, expected = calibrated(robot, rng)
    before = robot.model.copy()
    assert_same_model(corrected_model(robot.model, corrections), expected.model, rng)
    assert robot.model == before
    assert_frames_equal(robot.model, before)


def assert_frames_equal(model: Any, before: Any) -> None:
    for mine, theirs in zip(model.frames, before.frames, strict=True):
        assert mine == theirs
    for mine, theirs in zip(model.jointPlacements, before.jointPlacements, strict=True):
        assert mine == theirs


@pytest.mark.parametrize("name", NAMES)
def test_shapes_move_with_their_links(name: str, robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Each shape stands where the calibrated URDF puts it, to 1e-9, module and screen included."""
    robot = robots[name]
    corrections, expected = calibrated(robot, rng)
    given = shapes(robot, robot.model)
    places = [shape.placement.homogeneous.copy() for shape in given.geometryObjects]
    _, moved = corrected_models(robot.model, [given], corrections)
    wanted = shapes(expected, expected.model)
    assert [shape.name for shape in moved.geometryObjects] == [shape.name for shape in wanted.geometryObjects]
    assert {"slm_0", "laser_1_0", "screen_0"} <= {shape.name for shape in moved.geometryObjects}
    for mine, theirs in zip(moved.geometryObjects, wanted.geometryObjects, strict=True):
        np.testing.assert_allclose(mine.placement.homogeneous, theirs.placement.homogeneous, atol=1e-9, err_msg=mine.name)
    for shape, place in zip(given.geometryObjects, places, strict=True):
        np.testing.assert_array_equal(shape.placement.homogeneous, place)


def test_masses_on_corrected_fixed_joints_are_moved(rng: np.random.Generator) -> None:
    """A heavy module is weighed where the correction puts it, like a model of the calibrated URDF: the same torques follow."""
    robot = robot_of(WEIGHTY)
    corrections, expected = calibrated(robot, rng)
    model = corrected_model(robot.model, corrections)
    assert_same_model(model, expected.model, rng)
    q, v, a = rng.uniform(-1, 1, (3, model.nv))
    q = pin.integrate(model, pin.neutral(model), q)
    torque, wanted = (pin.rnea(each, each.createData(), q, v, a) for each in (model, expected.model))
    np.testing.assert_allclose(torque, wanted, atol=1e-9)
    assert np.abs(torque - pin.rnea(robot.model, robot.model.createData(), q, v, a)).max() > 1e-2


def test_a_free_flying_model(rng: np.random.Generator) -> None:
    """A model with a free-flyer root gets the same corrections."""
    robot = robot_of(WEIGHTY)
    corrections, expected = calibrated(robot, rng)
    given, wanted = (pin.buildModelFromXML(each.description.text.decode(), pin.JointModelFreeFlyer()) for each in (robot, expected))
    assert_same_model(corrected_model(given, corrections), wanted, rng)


@pytest.mark.parametrize("locked", [["turn"], ["lift"], ["turn", "lift"], ["lift", "slide"], ["slide"]], ids="+".join)
def test_a_reduced_model(locked: list[str], rng: np.random.Generator) -> None:
    """Calibrated joints may be locked: correcting the reduced model gives the corrected model, reduced, shapes included."""
    robot = robot_of(WEIGHTY)
    corrections, expected = calibrated(robot, rng)
    ids = [robot.model.getJointId(name) for name in locked]
    q = pin.integrate(robot.model, pin.neutral(robot.model), np.array([0.3, -0.4, 0.0]))
    given, (visual,) = pin.buildReducedModel(robot.model, [shapes(robot, robot.model)], ids, q)
    wanted, (wanted_visual,) = pin.buildReducedModel(expected.model, [shapes(expected, expected.model)], ids, q)
    model, moved = corrected_models(given, [visual], corrections)
    assert_same_model(model, wanted, rng)
    for mine, theirs in zip(moved.geometryObjects, wanted_visual.geometryObjects, strict=True):
        np.testing.assert_allclose(mine.placement.homogeneous, theirs.placement.homogeneous, atol=1e-9, err_msg=mine.name)


def test_a_model_with_its_gripper_locked(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Joints of no concern to the calibration may be locked, as a controller does with fingers and heads."""
    for name, locked in (("panda", ["panda_finger_joint1", "panda_finger_joint2"]), ("tiago", ["head_1_joint", "wheel_left_joint"])):
        robot = robots[name]
        corrections, expected = calibrated(robot, rng, estimated(robot))
        given, wanted = (
            pin.buildReducedModel(each, [each.getJointId(joint) for joint in locked], pin.neutral(each))
            for each in (robot.model, expected.model)
        )
        assert_same_model(corrected_model(given, corrections), wanted, rng)


def test_a_lock_that_cannot_be_followed_is_refused(rng: np.random.Generator) -> None:
    """A joint slid out before it was locked hides its origin; the way out is to correct first and to reduce then."""
    robot = robot_of(WEIGHTY)
    corrections, _ = calibrated(robot, rng)
    q = pin.integrate(robot.model, pin.neutral(robot.model), np.array([0.0, 0.0, 0.2]))
    reduced = pin.buildReducedModel(robot.model, [robot.model.getJointId("slide")], q)
    with pytest.raises(RobotError, match=r"joint 'slide' is locked in this reduced model.*apply the calibration to the whole model"):
        corrected_model(reduced, corrections)


def test_a_users_own_frames_follow(rng: np.random.Generator) -> None:
    """A frame put on a link moves with the link; one put on a joint alone stays in that joint."""
    robot = robot_of(URDF)
    corrections, _ = calibrated(robot, rng)
    model = robot.model.copy()
    slm, joint = model.getFrameId("slm"), model.getJointId("slide")
    grip = pin.SE3.Random()
    on_link = model.addFrame(pin.Frame("grip", joint, slm, model.frames[slm].placement * grip, pin.FrameType.OP_FRAME))
    on_joint = model.addFrame(pin.Frame("flange", joint, grip, pin.FrameType.OP_FRAME))
    odd = model.addFrame(pin.Frame("odd", joint, model.getFrameId("base"), grip, pin.FrameType.OP_FRAME))  # Pinocchio lets it pass
    corrected = corrected_model(model, corrections)
    assert_poses_close(corrected.frames[slm].placement.actInv(corrected.frames[on_link].placement), grip, mm=1e-9, mrad=1e-9)
    for frame in (on_joint, odd):
        assert_poses_close(corrected.frames[frame].placement, grip, mm=1e-12, mrad=1e-12)


def test_a_model_without_the_rig(robots: dict[str, Robot], rng: np.random.Generator, example_robots: Path) -> None:
    """The bare robot of the manufacturer's URDF gets its joints corrected; module and screen are passed over."""
    corrections, expected = calibrated(robots["panda"], rng)
    bare = pin.buildModelFromUrdf(str(example_robots / "panda_description" / "urdf" / "panda.urdf"))
    corrected = corrected_model(bare, corrections)
    assert not bare.existFrame("slm")
    for joint in bare.names[1:]:
        placement = expected.model.jointPlacements[expected.model.getJointId(joint)]
        assert_poses_close(corrected.jointPlacements[corrected.getJointId(joint)], placement, mm=1e-9, mrad=1e-9)


def test_another_robot_is_refused(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Joints that the model does not have are named, with the nearest name; so is a joint that stands elsewhere."""
    corrections, expected = calibrated(robot_of(URDF), rng)
    with pytest.raises(RobotError, match=r"the model has no joint 'turn', 'lift', 'slide', which were calibrated; there are: joint1, "):
        corrected_model(robots["arm7"].model, corrections)
    renamed = robot_of(URDF.replace('"lift"', '"lift_2"'))
    with pytest.raises(RobotError, match=r"the model has no joint 'lift', which was calibrated; did you mean 'lift_2'\?"):
        corrected_model(renamed.model, corrections)
    with pytest.raises(RobotError, match="joint 'turn' of the model stands at its corrected origin: this model is calibrated already"):
        corrected_model(expected.model, corrections)
    moved = robot_of(URDF.replace('xyz="0 0 0.2"', 'xyz="0 0 0.203"'))
    with pytest.raises(RobotError, match="joint 'turn' of the model is 3 mm and 0 mrad from the origin that was calibrated"):
        corrected_model(moved.model, corrections)


def test_geometry_of_another_model_is_refused(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Shapes that hang on joints or links that the model does not have are refused by name."""
    robot = robot_of(URDF)
    corrections, _ = calibrated(robot, rng)
    other = shapes(robots["arm7"], robots["arm7"].model)
    with pytest.raises(RobotError, match=r"the geometry 'link\d_\d' does not belong to this model"):
        corrected_models(robot.model, [other], corrections)


def test_what_is_no_model_is_refused(tmp_path: Path, rng: np.random.Generator) -> None:
    """A robot in place of its model, arguments exchanged, a model in place of shapes: one line says what was found and expected."""
    robot = robot_of(URDF)
    corrections, _ = calibrated(robot, rng)
    stored = urdfcal.StoredCalibration(tmp_path / "c.yaml", corrections)
    expected = "expected a pin.Model, such as robot.model"
    for call in (lambda: stored.apply_to(robot), lambda: urdfcal.apply(robot, stored)):
        with pytest.raises(UsageError, match=f"found a Robot where the Pinocchio model belongs; {expected}"):
            call()
    with pytest.raises(UsageError, match=r"found a Model where the calibration belongs; expected apply\(robot\.model, calibration\)"):
        urdfcal.apply(stored, robot.model)
    with pytest.raises(UsageError, match=r"found a Model behind the model; expected a pin\.GeometryModel"):
        stored.apply_to(robot.model, robot.model)


def test_every_way_to_apply_is_the_same(tmp_path: Path, robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """A calibration applied, loaded from its file and applied, or applied by its path: one model; with shapes, a tuple."""
    robot = robots["arm7"]
    data = urdfcal.read_measurements(EXAMPLE.parents[1] / "robots" / "arm7" / "measurements.csv", robot)
    calibration = urdfcal.fit(robot, data)
    calibration.write(tmp_path / "c.yaml")
    stored = urdfcal.load_calibration(tmp_path / "c.yaml")
    visual = shapes(robot, robot.model)
    expected = calibration.apply_to(robot.model)
    for model in (stored.apply_to(robot.model), urdfcal.apply(robot.model, calibration), urdfcal.apply(robot.model, stored)):
        assert_same_model(model, expected, rng)
    model, moved, again = urdfcal.apply(robot.model, str(tmp_path / "c.yaml"), visual, visual)
    assert_same_model(model, expected, rng)
    assert (moved.ngeoms, again.ngeoms) == (visual.ngeoms, visual.ngeoms)
    with pytest.raises(CalibrationFileError, match=r"nothing\.yaml: cannot be read"):
        urdfcal.apply(robot.model, tmp_path / "nothing.yaml")


@pytest.fixture(scope="module")
def example() -> Any:
    """The example as a module."""
    spec = importlib.util.spec_from_file_location("inverse_kinematics", EXAMPLE)
    assert spec
    assert spec.loader
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses look their module up
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("name", ["arm7", "panda"])
def test_the_true_robot_comes_nearer_to_its_targets(name: str, example: Any, robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """With the calibrated model the simulated true robot ends at least ten times nearer, at every target nearer than ever before."""
    study = example.study(robots[name], rng, count=10)
    nominal, calibrated = (study.errors[each] for each in ("nominal", "calibrated"))
    assert nominal.shape == calibrated.shape == (10, 2)
    assert calibrated[:, 0].mean() < nominal[:, 0].mean() / 10
    assert calibrated[:, 0].max() < nominal[:, 0].min()
    assert calibrated[:, 1].max() < nominal[:, 1].min()


@pytest.mark.parametrize("name", ["panda", "ur5"])
def test_sag_in_the_command_brings_the_true_robot_nearer(
    name: str, example: Any, robots: dict[str, Robot], rng: np.random.Generator
) -> None:
    """Where the simulated true robot sags, geometry alone leaves more than twice the distance that URDF and compensation leave."""
    study = example.study(robots[name], rng, count=10, noise_mm=0.1, sag_mrad=2.0, poses=100)
    nominal, calibrated, sagging = (study.errors[each][:, 0] for each in ("nominal", "calibrated", "with sag"))
    assert calibrated.mean() < nominal.mean() / 3
    assert sagging.mean() < calibrated.mean() / 2


def test_the_sagging_robot_is_the_one_that_was_measured(example: Any, robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """The example's own kinematics of a robot that bends, and the error model's spots, put the beams on the same places."""
    robot = robots["panda"]
    errors, x = random_truth(robot, rng, 2e-3, 2e-3)
    errors, x = soft_truth(robot, errors, x, SagScales(0.02, 0.02), rng)
    q = draw_poses(robot, errors, x, 5, rng)
    spots = true_spots(robot, errors, x, q)
    rigid = example.arm_of(robot, corrected_of(robot, errors, x), "slm")
    soft = example.SoftArm(robot, rigid, errors, x)
    for pose in range(5):
        T = soft.T_base_tool(q[pose])
        for laser in range(2):
            joint = robot.chain.laser_joints[laser][0]
            beam = T * joint.origin
            length = -beam.translation[0] / beam.rotation[0, 2]
            np.testing.assert_allclose((beam.translation + length * beam.rotation[:, 2])[1:], spots[pose, laser], atol=1e-9)


def corrected_of(robot: Robot, errors: ErrorModel, x: Vector) -> Any:
    joints = robot.tree.joints
    return corrected_model(
        robot.model,
        {name: OriginCorrection(joints[name].origin, origin, joints[name].moves) for name, origin in errors.corrected_origins(x).items()},
    )


def test_a_perfect_robot_is_on_its_targets(example: Any, robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Without errors the nominal model has nothing to lose: the solver itself is exact to a nanometre."""
    study = example.study(robots["panda"], rng, count=5, errors_mm=0.0, errors_deg=0.0, noise_mm=0.01)
    assert study.errors["nominal"].max() < 2e-6
    assert study.errors["calibrated"][:, 0].max() < 0.1


def test_inverse_kinematics_keeps_the_limits(example: Any, robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """A pose that the robot can take is reached within the joints' limits, checked by forward kinematics."""
    robot = robots["ur5"]
    arm = example.arm_of(robot, robot.model, "slm")
    for _ in range(5):
        target = arm.T_base_tool(arm.draw(rng))
        q = example.reach(arm, target, [arm.draw(rng) for _ in range(20)], example.clik)
        assert_poses_close(arm.T_base_tool(q), target, mm=1e-5, mrad=1e-5)
        assert (q >= arm.model.lowerPositionLimit).all()
        assert (q <= arm.model.upperPositionLimit).all()
    far = pin.SE3(np.eye(3), np.array([-5.0, 0.0, 0.0]))
    assert example.reach(arm, far, [arm.draw(rng)], example.clik) is None


def test_pink_reaches_the_same_targets(example: Any, robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """The example's other solver gains as much, where pink is installed."""
    pytest.importorskip("pink", reason="pink is not installed (pip install pin-pink daqp)")
    study = example.study(robots["panda"], rng, count=3, solver=example.with_pink)
    assert study.errors["calibrated"][:, 0].max() < study.errors["nominal"][:, 0].min()


def test_the_example_prints_both_errors(
    example: Any, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], robots: dict[str, Robot]
) -> None:
    """Run as a program it says that all is simulated, and prints a line a model."""
    path = str(robots["panda"].description.path)
    monkeypatch.setattr(sys, "argv", ["inverse_kinematics.py", path, "--targets", "3", "--seed", "2"])
    example.main()
    out = capsys.readouterr().out
    assert "panda, simulated (errors 2 mm and 0.2 deg, 60 poses, spot noise 0.5 mm)" in out
    assert [line.split()[0] for line in out.splitlines()[2:4]] == ["nominal", "calibrated"]
