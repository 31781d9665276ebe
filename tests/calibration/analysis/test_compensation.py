"""What control code gets: deflections as joint positions, and a pair of files that is never mixed."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
import yaml

import urdfcal
from tests.support.sensor_cases import CASES, SensorCase, seen_robot
from tests.support.small_robot import joint, robot_of, robot_text
from urdfcal.base.errors import CalibrationFileError, ShapeMismatch
from urdfcal.base.geometry import Matrix, Vector
from urdfcal.calibration.analysis.compensation import ArmScrews, Compensation, compensation_files, in_memory
from urdfcal.model.error_model import ErrorModel
from urdfcal.model.gravity import Gravity, WeighedRobot
from urdfcal.model.jacobian import ArmMotion, motion_at
from urdfcal.model.kinematics import ArmKinematics
from urdfcal.model.softness import EXTRAS, Softness, extra_terms, gravity_terms
from urdfcal.robot.configurations import joint_limits, whole_configurations
from urdfcal.robot.robot import Robot

OBLIQUE = Gravity((0.36, 0.48, -0.8))
MIMIC = robot_text(
    joint("one", "screen", "a", '<origin xyz="-0.4 0 0.3" rpy="0.4 0 0"/><axis xyz="0 0 1"/>'),
    joint("two", "a", "b", '<origin xyz="0.3 0 0.1"/><axis xyz="0 1 0"/>'),
    joint("three", "b", "c", '<origin xyz="0.2 0.1 0"/><axis xyz="0 1 0"/><mimic joint="two" multiplier="-0.5" offset="0.1"/>'),
    joint("four", "c", "d", '<origin xyz="0.2 0 0.1"/><axis xyz="1 0 0"/>'),
    joint("m1", "d", "laser_1", '<origin xyz="0.1 0 0" rpy="0 1.5 0"/>', kind="fixed"),
    joint("m2", "d", "laser_2", '<origin xyz="0.1 0 0.1" rpy="0 1.6 0"/>', kind="fixed"),
)
ARMS = ("panda", "ur5", "tiago", "arm7", "mimic", "reference carried", "hand sees hand")


def arm(name: str, robots: dict[str, Robot]) -> Robot:
    if name in ("reference carried", "hand sees hand"):
        case = CASES[name] if name == "hand sees hand" else SensorCase("panda", ("pose:panda_link0",), "panda_link8")
        return seen_robot(case, robots)
    return robot_of(MIMIC) if name == "mimic" else robots[name]


def soft_arm(
    name: str, robots: dict[str, Robot], rng: np.random.Generator, mrad: float = 1.0, extras: tuple[str, ...] = ()
) -> Compensation:
    """A robot whose joints bend by about so much, as if it had been calibrated so."""
    robot = arm(name, robots)
    weighed = WeighedRobot(robot, OBLIQUE)
    terms = (*gravity_terms(robot.chain, weighed.moments(positions(robot, rng, 200))), *extra_terms(robot.chain, extras))
    softness = Softness(robot.chain, terms, weighed, robot.rig.tip)
    return Compensation(robot, softness, {term.name: float(rng.normal(0, mrad * 1e-3)) for term in terms}, dict.fromkeys([], 0.0))


def positions(robot: Robot, rng: np.random.Generator, n: int = 20) -> Matrix:
    return rng.uniform(-1.5, 1.5, (n, len(robot.chain.inputs))) * np.where([each.prismatic for each in robot.chain.inputs], 0.1, 1.0)


def soft_motion(compensation: Compensation, q: Matrix) -> ArmMotion:
    """The bent arm as the fit sees it: by the error model's own kinematics."""
    soft = compensation.softness
    bare, kinematics = ErrorModel(soft.chain, (), (), held=compensation.values, soft=soft), ArmKinematics(soft.chain, soft.bends)
    placed = bare.placements(np.empty(0))
    return motion_at(kinematics, placed, kinematics.chain_positions(q), yielding=bare.yielding(np.empty(0), soft.basis(q)))


def tips(robot: Robot, q: Matrix) -> Matrix:
    """The module in the frame of what it is measured from, by Pinocchio's model of the whole robot, (n, 3)."""
    model, data, found = robot.model, robot.model.createData(), []
    end = robot.rig.lasers[0] if robot.rig.lasers else robot.rig.tip
    for whole in whole_configurations(robot, q):
        pin.framesForwardKinematics(model, data, whole)
        base, tip = (data.oMf[model.getFrameId(link)] for link in (robot.rig.base, end))
        found.append(base.actInv(tip).translation)
    return np.array(found)


def bent_tips(compensation: Compensation, q: Matrix) -> Matrix:
    motion = soft_motion(compensation, q)
    if compensation.robot.rig.lasers:
        return motion.frames[compensation.softness.chain.laser_frames[0]][:, :, 3]
    chain = compensation.softness.chain
    return motion.seen(chain.frame_index("target", compensation.robot.rig.tip), chain.measuring_frame)[0]


def wrists_free(compensation: Compensation, q: Matrix) -> Matrix:
    """Poses at which the joints can move the module every way: those where the least singular value of the Jacobian is largest."""
    soft = compensation.softness
    J = ArmScrews(compensation.robot, [], []).twists(q) @ soft.chain.coupling.T
    return q[np.argsort(-np.linalg.svd(J, compute_uv=False)[:, -1])[:20]]


@pytest.mark.parametrize("name", ["panda", "ur5", "tiago", "arm7", "reference carried"])
def test_the_rigid_model_is_where_the_bent_arm_is(name: str, robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Corrected positions put the rigid model within a twentieth of the sag of the soft one, however large it is, off singularities."""
    left = []
    for scale in (2.0, 1.0):
        compensation = soft_arm(name, robots, np.random.default_rng(5), scale)
        q = wrists_free(compensation, positions(compensation.robot, rng, 400))
        there = bent_tips(compensation, q)
        before = np.linalg.norm(tips(compensation.robot, q) - there, axis=1).mean()
        after = np.linalg.norm(tips(compensation.robot, compensation.corrected_configuration(q)) - there, axis=1).mean()
        left.append(after / before)
    assert max(left) < 0.05


@pytest.mark.parametrize("name", ["panda", "mimic", "reference carried", "hand sees hand"])
def test_sag_about_the_joints_own_axes_is_exact(name: str, robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Where joints bend about their own axes alone, and stand alone, nothing is left at all, whichever way they are walked."""
    whole = soft_arm(name, robots, rng, 5.0, ("scale", "eccentricity"))
    followed = ("two", "three", "right_1", "right_2")
    own = tuple(term for term in whole.softness.terms if term.axis is None and not term.name.startswith(followed))
    compensation = replace(whole, softness=replace(whole.softness, terms=own))
    q = positions(compensation.robot, rng)
    there = bent_tips(compensation, q)
    np.testing.assert_allclose(tips(compensation.robot, compensation.corrected_configuration(q)), there, atol=1e-12)
    assert np.linalg.norm(tips(compensation.robot, q) - there, axis=1).max() > 1e-4


def test_joints_that_others_follow_are_made_up_for(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """A joint that sags and its follower that does not: the measured joints make up for what they can, and lose nothing by it."""
    compensation = soft_arm("mimic", robots, rng, 3.0)
    q = positions(compensation.robot, rng, 100)
    there = bent_tips(compensation, q)
    before = np.linalg.norm(tips(compensation.robot, q) - there, axis=1)
    after = np.linalg.norm(tips(compensation.robot, compensation.corrected_configuration(q)) - there, axis=1)
    assert after.mean() < 0.7 * before.mean()


@pytest.mark.parametrize("name", ARMS)
def test_screws_are_those_of_the_error_model(name: str, robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Twists by the joints from the whole robot's kinematics are the error model's joint Jacobian, turned and moved to the module."""
    robot = arm(name, robots)
    q, kinematics = positions(robot, rng, 5), ArmKinematics(robot.chain)
    bare = ErrorModel(robot.chain, (), ())
    expected = motion_at(kinematics, bare.placements(np.empty(0)), kinematics.chain_positions(q)).axis_twists
    found, model, data = ArmScrews(robot, [], []).twists(q), robot.model, robot.model.createData()
    for pose, whole in enumerate(whole_configurations(robot, q)):
        pin.framesForwardKinematics(model, data, whole)
        base, tip = (data.oMf[model.getFrameId(link)] for link in (robot.rig.base, robot.rig.tip))
        for column in range(len(robot.chain.moving)):
            at_tip = pin.SE3(base.rotation, base.translation).act(pin.Motion(expected[pose, :, column]))
            v = at_tip.linear + np.cross(at_tip.angular, tip.translation)
            np.testing.assert_allclose(found[pose, :, column], [*v, *at_tip.angular], atol=1e-10)


@pytest.mark.parametrize("name", ARMS)
def test_command_is_the_inverse(name: str, robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Both ways round, with a payload and without."""
    compensation = soft_arm(name, robots, rng)
    q = positions(compensation.robot, rng)
    for payload in (None, 2.0):
        np.testing.assert_allclose(compensation.corrected_configuration(compensation.command(q, payload), payload), q, atol=1e-10)
        np.testing.assert_allclose(compensation.command(compensation.corrected_configuration(q, payload), payload), q, atol=1e-10)


def test_one_pose_is_a_stack_of_one(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Single calls, stacks, and payloads one for all or one a pose agree; nothing comes of nothing."""
    compensation = soft_arm("tiago", robots, rng, extras=EXTRAS)
    q, masses = positions(compensation.robot, rng, 5), rng.uniform(0, 3, 5)
    for function in (compensation.corrected_configuration, compensation.command):
        stacked = function(q, masses)
        assert stacked.shape == q.shape
        single = [function(row, float(mass)) for row, mass in zip(q, masses, strict=True)]
        assert single[0].shape == q[0].shape
        np.testing.assert_allclose(stacked, single, atol=1e-14)
        np.testing.assert_allclose(function(q, 2.0), function(q, np.full(5, 2.0)), atol=1e-15)
        assert np.abs(function(q, 2.0) - function(q)).max() > 1e-6
        assert function(q[:0]).shape == (0, q.shape[1])
    rigid = replace(compensation, values=dict.fromkeys(compensation.values, 0.0))
    np.testing.assert_array_equal(rigid.corrected_configuration(q), q)


def test_positions_of_other_joints_are_refused(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """With the joints' names, in order; payloads with the count."""
    compensation = soft_arm("ur5", robots, rng)
    assert compensation.joints == robots["ur5"].chain.input_names
    for q in (np.zeros(5), np.zeros((2, 7)), np.zeros((1, 2, 6)), np.float64(1.0)):
        for function in (compensation.corrected_configuration, compensation.command, compensation.deflections):
            with pytest.raises(ShapeMismatch, match="expected positions of the joints shoulder_pan_joint, shoulder_lift_joint"):
                function(q)
    with pytest.raises(ShapeMismatch, match=r"expected one payload, or 3; found shape \(2,\)"):
        compensation.corrected_configuration(np.zeros((3, 6)), np.zeros(2))


@dataclass(frozen=True)
class Pair:
    """A written pair."""

    compensation: Compensation
    urdf: Path
    yaml: Path


@pytest.fixture(params=["ur5", "reference carried"])
def pair(request: pytest.FixtureRequest, tmp_path: Path, robots: dict[str, Robot], rng: np.random.Generator) -> Pair:
    """URDF and compensation of a soft robot, with lasers and with a target."""
    soft = soft_arm(request.param, robots, rng, extras=("scale",))
    values = {name: (value, 1e-4) for name, value in soft.values.items()}
    paths = tmp_path / "arm.urdf", tmp_path / "arm.yaml"
    robot = soft.robot
    for path, text in zip(
        paths, compensation_files(robot.description.text, "arm.urdf", robot, soft.softness, OBLIQUE, values), strict=True
    ):
        path.write_bytes(text)
    return Pair(in_memory(robot, robot.description.text, soft.softness, values), *paths)


def test_what_is_loaded_is_what_was_written(pair: Pair, rng: np.random.Generator) -> None:
    """A loaded pair corrects as the fit that it came from, its model is the URDF's, and its sigmas are there."""
    loaded = urdfcal.load_compensation(pair.yaml)
    q = positions(pair.compensation.robot, rng)
    np.testing.assert_array_equal(loaded.corrected_configuration(q), pair.compensation.corrected_configuration(q))
    assert loaded.model == pin.buildModelFromUrdf(str(pair.urdf))
    assert set(loaded.sigma.values()) == {1e-4}
    assert loaded.joints == pair.compensation.joints


def test_a_pair_is_not_mixed(pair: Pair, tmp_path: Path) -> None:
    """An edited URDF, an edited compensation, the plain URDF, another's URDF and a missing one are refused with one line."""
    urdf, text = pair.urdf.read_bytes(), pair.yaml.read_bytes()
    spoilt: dict[str, Callable[[], object]] = {
        "is not the URDF that it was fitted with": lambda: pair.urdf.write_bytes(urdf.replace(b'xyz="0', b'xyz="1', 1)),
        "belongs to another compensation": lambda: pair.yaml.write_bytes(text.replace(b"# Deflections", b"# deflections")),
        "arm.urdf belongs to another compensation": lambda: pair.urdf.write_bytes(urdf[: urdf.rindex(b"\n<!--")]),
        "keep the two files together": lambda: pair.urdf.unlink(),
    }
    for message, spoil in spoilt.items():
        pair.urdf.write_bytes(urdf)
        pair.yaml.write_bytes(text)
        spoil()
        with pytest.raises(CalibrationFileError, match=message) as refused:
            urdfcal.load_compensation(pair.yaml)
        assert "\n" not in str(refused.value)
        assert str(pair.yaml) in str(refused.value)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda content: content.clear(), "is no compensation"),
        (lambda content: content.update(urdfcal="calibration"), "is no compensation"),
        (lambda content: content.pop("terms"), "an entry is missing or not readable: 'terms'"),
        (lambda content: content.update(urdf="arm.urdf"), "an entry is missing or not readable"),
        (lambda content: content.update(terms=3), "an entry is missing or not readable"),
        (lambda content: content.update(terms=["sag"]), "an entry is missing or not readable"),
        (lambda content: content["terms"][0].update(value="soft"), "an entry is missing or not readable"),
        (lambda content: content["terms"][0].update(value=float("nan")), "an entry is missing or not readable"),
        (lambda content: content["terms"][0].update(axis=[1, 0]), "an entry is missing or not readable"),
        (lambda content: content["gravity"].update(direction=[0, 0]), "an entry is missing or not readable"),
        (lambda content: content["terms"][0].update(name="shoulder.magic"), "an entry is missing or not readable"),
        (lambda content: content["terms"][0].update(joint="elbow"), "joint 'elbow' is not between the links of its rig; there are:"),
        (lambda content: content.update(rig={"reference": "base_link"}), "an entry is missing or not readable"),
        (lambda content: content.update(rig=None), "an entry is missing or not readable"),
        (lambda content: content["terms"].append(dict(content["terms"][0])), "the term '.*' is there twice"),
    ],
)
def test_malformed_files_are_refused(
    change: Callable[[dict], object], message: str, tmp_path: Path, robots: dict[str, Robot], rng: np.random.Generator
) -> None:
    """With one line that names the file, even where the hashes have been made to fit."""
    soft = soft_arm("ur5", robots, rng)
    values = {name: (value, 1e-4) for name, value in soft.values.items()}
    text = soft.robot.description.text
    _, written = compensation_files(text, "arm.urdf", soft.robot, soft.softness, OBLIQUE, values)
    content = yaml.safe_load(written)
    change(content)
    path = tmp_path / "arm.yaml"
    path.write_text(yaml.safe_dump(content))
    comment = f"\n<!-- urdfcal compensation sha256 {hashlib.sha256(path.read_bytes()).hexdigest()} -->\n".encode()
    (tmp_path / "arm.urdf").write_bytes(text + comment)
    with pytest.raises(CalibrationFileError, match=message) as refused:
        urdfcal.load_compensation(path)
    assert str(path) in str(refused.value)
    assert "\n" not in str(refused.value)


def test_files_that_are_not_there_are_refused(tmp_path: Path) -> None:
    """By name."""
    with pytest.raises(CalibrationFileError, match=r"nothing\.yaml: cannot be read"):
        urdfcal.load_compensation(tmp_path / "nothing.yaml")


def test_a_vector_is_no_matter(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Lists of numbers do as well, and the caller's array stays as it is."""
    compensation = soft_arm("ur5", robots, rng)
    q: Vector = positions(compensation.robot, rng, 1)[0]
    before = q.copy()
    np.testing.assert_array_equal(compensation.command(q.tolist()), compensation.command(q))  # type: ignore[arg-type]
    np.testing.assert_array_equal(q, before)


@pytest.mark.parametrize("name", ARMS)
def test_the_exact_placement_is_the_fit_s_own(name: str, robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Every deflection at its own joint puts tip and lasers where the fit's model has them, to 1e-9, stretched arms and slides included."""
    compensation = soft_arm(name, robots, rng, 20.0, ("scale", "eccentricity"))
    robot = compensation.robot
    q = np.vstack([positions(robot, rng), np.zeros((1, len(compensation.joints)))])
    end = robot.rig.lasers[0] if robot.rig.lasers else robot.rig.tip
    base, tip = compensation.placement(q, robot.rig.base), compensation.placement(q, end)
    np.testing.assert_allclose(np.linalg.solve(base, tip)[:, :3, 3], bent_tips(compensation, q), atol=1e-9)
    assert np.linalg.norm(tips(robot, compensation.corrected_configuration(q)) - bent_tips(compensation, q), axis=1).max() > 1e-6


@pytest.mark.parametrize("name", ["tiago", "mimic", "hand sees hand"])
def test_the_exact_placement_of_a_stiff_arm_is_pinocchio_s(name: str, robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Without deflections every link of the robot, on the way or not, is where the whole robot's Pinocchio model has it."""
    soft = soft_arm(name, robots, rng)
    stiff = replace(soft, values=dict.fromkeys(soft.values, 0.0))
    q = positions(soft.robot, rng, 3)
    model, data = stiff.model, stiff.model.createData()
    for number, whole in enumerate(stiff.whole(q)):
        pin.framesForwardKinematics(model, data, whole)
        for link in stiff.robot.tree.links:
            expected = data.oMf[model.getFrameId(link, pin.BODY)].homogeneous
            np.testing.assert_allclose(stiff.placement(q, link)[number], expected, atol=1e-12)


def test_one_placement_is_of_a_stack_with_payload_and_approach(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """One configuration gives the SE3 that a stack has in that row; payload and direction matter, and a strange link is refused."""
    compensation = soft_arm("tiago", robots, rng, extras=EXTRAS)
    link, q = compensation.robot.rig.tip, positions(compensation.robot, rng, 4)
    moves = rng.choice([-1.0, 1.0], q.shape)
    stacked = compensation.placement(q, link, 2.0, moves)
    np.testing.assert_allclose(compensation.placement(q[1], link, 2.0, moves[1]).homogeneous, stacked[1], atol=1e-14)
    assert np.abs(stacked - compensation.placement(q, link)).max() > 1e-6
    assert compensation.placement(q[:0], link).shape == (0, 4, 4)
    with pytest.raises(urdfcal.UsageError, match=r"no link.* 'tool9'"):
        compensation.placement(q, "tool9")


def test_what_joint_positions_cannot_make_up_for_is_said(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """The distances over the joints' range are those between Pinocchio at corrected positions and where the arm is."""
    compensation = soft_arm("ur5", robots, rng, 2.0)
    found = compensation.shortfall(np.random.default_rng(4))
    lower, upper = joint_limits(compensation.robot)
    q = np.random.default_rng(4).uniform(lower, upper, (1000, len(lower)))
    robot = compensation.robot
    base, tip = compensation.placement(q, robot.rig.base), compensation.placement(q, robot.rig.tip)
    model, data, left = robot.model, robot.model.createData(), []
    for number, whole in enumerate(compensation.whole(compensation.corrected_configuration(q))):
        pin.framesForwardKinematics(model, data, whole)
        at, there = (data.oMf[model.getFrameId(link, pin.BODY)] for link in (robot.rig.base, robot.rig.tip))
        left.append(np.linalg.norm(at.actInv(there).translation - np.linalg.solve(base[number], tip[number])[:3, 3]))
    np.testing.assert_allclose([found.median, found.p95, found.worst], np.quantile(left, [0.5, 0.95, 1.0]), atol=1e-9)
    assert found.median < found.p95 < found.worst < 20 * found.sag
    assert f"{found.worst * 1e3:.3f} mm (worst)" in found.words
