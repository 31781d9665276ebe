"""The forms in which a calibration is deployed, each read back by a road of its own."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
import yaml

from tests.conftest import CliResult
from tests.robot.test_urdf_writer import random_corrections
from tests.support.helpers import assert_poses_close
from tests.support.paths import ROBOTS_DIR
from tests.support.small_robot import URDF, joint, robot_of
from urdfcal.base.errors import RobotError, UsageError
from urdfcal.base.geometry import SE3
from urdfcal.output.driver_yaml import UR_JOINTS, origins_yaml, ur_joints, ur_yaml
from urdfcal.output.endings import stem_of
from urdfcal.output.formats import Deployed, deployment
from urdfcal.output.joint_offsets import joint_offset, joint_offsets, offset_loss
from urdfcal.robot.configurations import random_configurations
from urdfcal.robot.robot import Robot, load_robot, robot_from
from urdfcal.robot.urdf_writer import with_origins

UR_ORIGINS = {  # the frames of ur_description, with the nominal lengths of a UR5
    "shoulder_pan_joint": "0 0 0.089159 0 0 0",
    "shoulder_lift_joint": "0 0 0 1.570796327 0 0",
    "elbow_joint": "-0.425 0 0 0 0 0",
    "wrist_1_joint": "-0.39225 0 0.10915 0 0 0",
    "wrist_2_joint": "0 -0.09465 0 1.570796327 0 0",
    "wrist_3_joint": "0 0.0823 0 1.5707963265897931 3.1415926535897931 3.1415926535897931",
}


def ur_text(prefix: str = "", root: str = "base_link") -> str:
    """A UR5 with the frames of ur_description: every joint turns about z, and the base is turned by half a turn."""
    text = joint(f"{prefix}base_turn", root, f"{prefix}link0", '<origin rpy="0 0 3.141592653589793"/>', kind="fixed")
    for number, (name, numbers) in enumerate(UR_ORIGINS.items()):
        xyz, rpy = numbers.split()[:3], numbers.split()[3:]
        origin = f'<origin xyz="{" ".join(xyz)}" rpy="{" ".join(rpy)}"/><axis xyz="0 0 1"/>'
        text += joint(prefix + name, f"{prefix}link{number}", f"{prefix}link{number + 1}", origin)
    return "".join(f'<link name="{prefix}link{number}"/>' for number in range(7)) + text


def ur_robot(*prefixes: str) -> Robot:
    return robot_of('<robot name="ur"><link name="base_link"/>' + "".join(map(ur_text, prefixes or ("",))) + "</robot>")


def corrected(robot: Robot, rng: np.random.Generator, names: list[str] | None = None) -> dict[str, SE3]:
    """Origins with errors of centimetres and degrees."""
    return {name: each.corrected for name, each in random_corrections(robot, rng, names).items()}


def rebuilt(robot: Robot, origins: dict[str, SE3]) -> Robot:
    return robot_from(replace(robot.description, text=with_origins(robot.description, origins)))


def placement(entry: dict[str, float]) -> SE3:
    """A section of a YAML file as URDF's and xacro's readers take it: Rz(yaw) Ry(pitch) Rx(roll), by SciPy."""
    from scipy.spatial.transform import Rotation

    turn = Rotation.from_euler("xyz", [entry["roll"], entry["pitch"], entry["yaw"]]).as_matrix()
    return pin.SE3(turn, np.array([entry["x"], entry["y"], entry["z"]]))


@pytest.mark.parametrize("name", ["arm7", "panda", "ur5", "tiago"])
def test_origins_come_back_from_yaml(name: str, robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Every moving joint and every calibrated fixed one is in the file, to 1e-12 where the calibrated URDF has it."""
    robot = robots[name]
    fixed = [robot.chain.mount_joint.name, robot.chain.steps[0].joint.name]  # type: ignore[union-attr]
    origins = corrected(robot, rng, [robot.chain.moving[1].joint.name, *fixed])
    content = yaml.safe_load(origins_yaml(robot, origins))
    expected = rebuilt(robot, origins).tree.joints
    assert content["robot"] == robot.name
    assert set(content["joints"]) == {each for each, joint in expected.items() if joint.moves or each in origins}
    for each, entry in content["joints"].items():
        assert_poses_close(placement(entry), expected[each].origin, mm=1e-9, mrad=1e-9)
        np.testing.assert_allclose([entry["x"], entry["y"], entry["z"]], expected[each].xyz, atol=1e-12)
        np.testing.assert_allclose(pin.rpy.rpyToMatrix(*expected[each].rpy), placement(entry).rotation, atol=1e-12)


def ur_arm(content: dict[str, Any], q: np.ndarray) -> SE3:
    """The last link of a UR arm in its base, put together as ur_description does: origin, then a turn about z, six times."""
    tool = pin.SE3(pin.rpy.rpyToMatrix(0, 0, np.pi), np.zeros(3))
    for section, angle in zip(("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3"), q, strict=True):
        tool = tool * placement(content["kinematics"][section]) * pin.SE3(pin.rpy.rpyToMatrix(0, 0, angle), np.zeros(3))
    return tool


@pytest.mark.parametrize("prefix", ["", "left_"])
def test_a_robot_built_from_the_ur_file_is_the_calibrated_one(prefix: str, rng: np.random.Generator) -> None:
    """ur_description's composition of the six sections puts the tool where the calibrated URDF does, with any prefix."""
    robot = ur_robot(prefix)
    origins = corrected(robot, rng, [prefix + name for name in UR_ORIGINS])
    content, model = yaml.safe_load(ur_yaml(robot, origins)), rebuilt(robot, origins).model
    assert list(content["kinematics"]) == list(UR_JOINTS)
    for q in rng.uniform(-3, 3, (10, 6)):
        data = model.createData()
        pin.framesForwardKinematics(model, data, q)
        assert_poses_close(ur_arm(content, q), data.oMf[model.getFrameId(f"{prefix}link6")], mm=1e-9, mrad=1e-9)


def test_the_nominal_ur_file_is_the_published_one(rng: np.random.Generator) -> None:
    """With one joint corrected, the other five sections hold the description's own numbers."""
    robot = ur_robot()
    sections = yaml.safe_load(ur_yaml(robot, corrected(robot, rng, ["elbow_joint"])))["kinematics"]
    for section, name in UR_JOINTS.items():
        numbers = [float(word) for word in UR_ORIGINS[name].split()]
        same = np.allclose(placement(sections[section]).homogeneous, placement(dict(zip(sections[section], numbers, strict=True))))
        assert same == (section != "forearm")


def test_of_two_arms_the_calibrated_one_is_written(rng: np.random.Generator) -> None:
    """Prefixes are told apart by what was calibrated; where that leaves both, the format is refused."""
    robot = ur_robot("left_", "right_")
    assert ur_joints(robot, ["right_elbow_joint"])["wrist_3"].name == "right_wrist_3_joint"
    with pytest.raises(RobotError, match="the UR format is for one arm, found those with the prefixes 'left_', 'right_'"):
        ur_yaml(robot, corrected(robot, rng))


def test_what_is_no_ur_is_refused(robots: dict[str, Robot]) -> None:
    """The joints that are missing are named."""
    with pytest.raises(
        RobotError, match="the UR format needs the six joints of a UR arm; missing: shoulder_pan_joint, shoulder_lift_joint"
    ):
        ur_joints(robots["panda"], ["panda_joint1"])
    five = robot_of('<robot name="ur"><link name="base_link"/>' + ur_text("a_").replace("a_wrist_2_joint", "a_wrist_two") + "</robot>")
    with pytest.raises(RobotError, match=r"missing: a_wrist_2_joint; did you mean 'a_wrist_\w+'\?"):
        ur_joints(five, ["a_elbow_joint"])


def test_no_hash_is_invented(rng: np.random.Generator) -> None:
    """There is a hash where one is given, and none otherwise."""
    robot = ur_robot()
    origins = corrected(robot, rng, ["elbow_joint"])
    assert "hash" not in yaml.safe_load(ur_yaml(robot, origins))["kinematics"]
    assert yaml.safe_load(ur_yaml(robot, origins, "calib_12788084448423163542"))["kinematics"]["hash"] == "calib_12788084448423163542"


def test_frames_of_an_older_ur_description_are_told(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Joints that do not turn about z are named in a warning and in the file itself."""
    robot = robots["ur5"]
    deployed = Deployed(robot, corrected(robot, rng, ["elbow_joint"]))
    (warning,) = deployed.warnings(deployment(["ur"], None, "ur5"))
    assert "shoulder_lift_joint, elbow_joint, wrist_1_joint, wrist_3_joint turn about other axes than z" in warning
    assert f"# {warning}\n" in deployed.content("ur").decode()
    modern = Deployed(ur_robot(), corrected(ur_robot(), rng, ["elbow_joint"]))
    assert modern.warnings(deployment(["ur"], None, "ur5")) == ()


@pytest.mark.parametrize("offset", [0.02, -1.0, 3.1, 0.0])
def test_a_pure_offset_is_found(offset: float, rng: np.random.Generator) -> None:
    """An offset about the joint's own axis comes back, whatever stands beside it perpendicular to that axis."""
    joints = robot_of(URDF).tree.joints
    for name in ("turn", "lift"):
        axis = np.array(joints[name].axis)
        sideways = np.cross(axis, rng.normal(size=3)) * 0.1
        delta = pin.SE3(pin.exp3(sideways), rng.normal(size=3)) * pin.SE3(pin.exp3(axis * offset), np.zeros(3))
        assert joint_offset(joints[name], delta) == pytest.approx(offset, abs=1e-12)
    slide = np.array(joints["slide"].axis)
    assert joint_offset(joints["slide"], pin.SE3(pin.exp3(slide), slide * offset + np.cross(slide, [1, 2, 3]))) == pytest.approx(offset)


def test_the_offset_is_the_one_nearest_to_the_correction(rng: np.random.Generator) -> None:
    """No other angle about the axis leaves a smaller rotation between offset and correction."""
    lift = robot_of(URDF).tree.joints["lift"]
    for _ in range(20):
        delta = pin.SE3(pin.exp3(rng.normal(0, 0.5, 3)), np.zeros(3))

        def left(angle: float, delta: SE3 = delta) -> float:
            return float(np.linalg.norm(pin.log3(pin.exp3(-angle * np.array(lift.axis)) @ delta.rotation)))

        best = joint_offset(lift, delta)
        assert left(best) <= min(left(best + step) for step in (-1e-3, 1e-3))


def test_offsets_lose_nothing_where_there_is_nothing_else(rng: np.random.Generator) -> None:
    """With pure offsets the tool is where the whole correction puts it; with other errors the loss is what Pinocchio finds."""
    robot = robot_of(URDF)
    joints = robot.tree.joints
    pure = {name: joints[name].origin * pin.SE3(pin.exp3(0.02 * np.array(joints[name].axis)), np.zeros(3)) for name in ("turn", "lift")}
    loss = offset_loss(robot, pure, rng, 50)
    assert (loss.tool, loss.base, loss.warnings) == ("slm", "screen", ())
    assert loss.max_mm < 1e-9
    assert loss.nominal_mean_mm > 1
    shifted = {"turn": joints["turn"].origin * pin.SE3(np.eye(3), np.array([0.003, 0, 0.004]))}
    loss = offset_loss(robot, shifted, rng, 50)
    assert [loss.mean_mm, loss.max_mm, loss.nominal_mean_mm] == pytest.approx([5, 5, 5])
    assert "they leave 'slm' 5 mm off in the mean and 5 mm at most, of 5 and 5 mm without" in loss.warnings[0]


def test_limits_are_shifted_alike(rng: np.random.Generator) -> None:
    """A revolute joint's limits move by its offset, a continuous joint has none, a sliding one's are in metres."""
    robot = robot_of(URDF)
    joints = robot.tree.joints
    origins = corrected(robot, rng, ["turn", "lift", "slide"])
    content = yaml.safe_load(Deployed(robot, origins).content("offsets"))["joints"]
    offsets = joint_offsets(robot, origins)
    assert content["turn"] == {"offset": offsets["turn"], "unit": "rad", "lower": -0.6 + offsets["turn"], "upper": 0.6 + offsets["turn"]}
    assert content["lift"] == {"offset": offsets["lift"], "unit": "rad"}
    assert (content["slide"]["unit"], content["slide"]["upper"]) == ("m", 0.3 + offsets["slide"])
    assert joints["slide"].upper == 0.3
    with pytest.raises(RobotError, match="no moving joint was corrected"):
        joint_offsets(robot, corrected(robot, rng, ["slm_mount"]))


def test_offsets_of_a_robot_without_its_rig(robots: dict[str, Robot], rng: np.random.Generator, example_robots: Path) -> None:
    """With the module taken off, the loss is told at the ends of the calibrated joints, mimic fingers and all."""
    bare = load_robot(example_robots / "panda_description" / "urdf" / "panda.urdf")
    loss = offset_loss(bare, corrected(bare, rng, [f"panda_joint{number}" for number in range(1, 8)]), rng, 20)
    assert (loss.base, loss.tool) == ("panda_link0", "panda_link7")
    assert 0 < loss.mean_mm < loss.nominal_mean_mm


def test_mimic_joints_follow_in_the_configurations(rng: np.random.Generator) -> None:
    """Configurations lie within the limits, and a mimic joint stands where its leader puts it."""
    text = URDF.replace('<axis xyz="0 1 0"/>', '<axis xyz="0 1 0"/><mimic joint="turn" multiplier="-2" offset="0.3"/>')
    robot = robot_of(
        text.replace('type="continuous"', 'type="revolute"').replace(
            "<mimic", '<limit lower="-9" upper="9" effort="1" velocity="1"/><mimic'
        )
    )
    turn, lift, slide = random_configurations(robot, rng, 100).T
    np.testing.assert_allclose(lift, 0.3 - 2 * turn, atol=1e-12)
    assert (np.abs(turn) <= 0.6).all()
    assert (slide >= 0).all()
    assert (slide <= 0.3).all()
    assert turn.std() > 0.2


PLANS = {
    "default": ([], None, ["arm_calibrated.urdf"], "arm"),
    "all": (
        ["urdf", "origins-yaml", "ur", "offsets", "ur"],
        None,
        ["arm_calibrated.urdf", "arm_origins.yaml", "arm_kinematics.yaml", "arm_offsets.yaml"],
        "arm",
    ),
    "offsets alone": (["offsets"], None, ["arm_offsets.yaml"], "arm"),
    "beside the named one": (["urdf", "offsets"], "out/a.urdf", ["out/a.urdf", "out/a_offsets.yaml"], "a"),
    "the name tells which": (["urdf", "offsets"], "out/a.yaml", ["out/a.yaml", "out/a_calibrated.urdf"], "a"),
    "its own ending first": (["origins-yaml", "offsets"], "b_offsets.yaml", ["b_offsets.yaml", "b_origins.yaml"], "b"),
    "any other name": (["ur"], "config.d", ["config.d"], "config.d"),
}


@pytest.mark.parametrize("case", PLANS)
def test_where_formats_are_written(case: str) -> None:
    """`-o` names the main output, and the others stand beside it under their own endings."""
    formats, output, expected, stem = PLANS[case]
    plan = deployment(formats, Path(output) if output else None, "arm")
    assert [path.as_posix() for path in plan.places.values()] == expected
    assert (plan.main.as_posix(), plan.stem) == (expected[0], stem)


@pytest.mark.parametrize(
    ("formats", "output", "message"),
    [
        (["uri"], None, r"no format 'uri'; did you mean 'ur'\?"),
        (["offsets"], "a.urdf", r"a\.urdf: --format offsets writes YAML, expected a name that does not end in \.urdf"),
        (["urdf"], "a.yaml", r"a\.yaml: --format urdf writes a URDF"),
    ],
)
def test_plans_that_cannot_be(formats: list[str], output: str | None, message: str) -> None:
    """An unknown format, or a name that belongs to another kind of file, is refused."""
    with pytest.raises(UsageError, match=message):
        deployment(formats, Path(output) if output else None, "arm")


def test_a_stem_is_found_again() -> None:
    """Every ending that urdfcal gives is taken off; other names stay whole."""
    names = ("arm_calibrated.urdf", "arm.urdf", "arm_offsets.yaml", "arm_origins.yaml", "arm_kinematics.yaml", "arm.yml")
    assert {stem_of(Path(name)) for name in names} == {"arm"}
    assert [stem_of(Path(name)) for name in ("arm.v2", "_calibrated.urdf")] == ["arm.v2", "_calibrated"]


def test_fit_and_apply_write_the_same_files(run_cli: Callable[..., CliResult]) -> None:
    """Every format on the command line: what fit writes, apply writes again from the stored calibration."""
    ur5 = ROBOTS_DIR / "ur5" / "ur5.urdf.xacro"
    formats = [word for name in ("urdf", "origins-yaml", "ur", "offsets") for word in ("--format", name)]
    assert run_cli("simulate", ur5, "-o", "m.csv", "--poses", "40").code == 0
    done = run_cli("fit", ur5, "m.csv", *formats)
    assert (done.code, "offsets alone keep the nominal geometry" in done.err) == (0, True), done.err
    assert "wrote ur5_calibrated.urdf, ur5_origins.yaml, ur5_kinematics.yaml, ur5_offsets.yaml and ur5_calibration.yaml" in done.out
    again = run_cli("apply", ur5, "ur5_calibration.yaml", "-o", "again.urdf", *formats, "--json", "-q")
    assert (again.code, again.err) == (0, "")
    files = yaml.safe_load(again.out)["files"]
    assert files["offsets"] == "again_offsets.yaml"
    for name, old in zip(files, ("calibrated.urdf", "origins.yaml", "kinematics.yaml", "offsets.yaml"), strict=True):
        first, second = (Path(each).read_text() for each in (f"ur5_{old}", files[name]))
        assert numbers_differ_by(first, second) < 1e-12, name
    fitted = load_robot("ur5_calibrated.urdf").tree.joints
    for section, entry in yaml.safe_load(Path("ur5_kinematics.yaml").read_text())["kinematics"].items():
        assert_poses_close(placement(entry), fitted[UR_JOINTS[section]].origin, mm=1e-9, mrad=1e-9)


def numbers_differ_by(first: str, second: str) -> float:
    """The largest difference of two texts' numbers, if the words between them are the same."""
    import re

    number = r"-?\d+\.?\d*(?:e-?\d+)?"
    assert re.sub(number, "#", first) == re.sub(number, "#", second)
    a, b = (np.array([float(word) for word in re.findall(number, text)]) for text in (first, second))
    return float(np.abs(a - b).max())


def test_offsets_are_all_of_an_offset_fit(run_cli: Callable[..., CliResult], tmp_path: Path) -> None:
    """A fit of offsets alone loses nothing when offsets are deployed, and nothing is said of a loss."""
    (tmp_path / "small.urdf").write_text(URDF)
    (tmp_path / "e.yaml").write_text("error_model: offset\nparameters: {turn.d_theta: 0.02, lift.d_theta: -0.05}")
    assert run_cli("simulate", "small.urdf", "-o", "m.csv", "--poses", "30", "--errors", "e.yaml").code == 0
    done = run_cli("fit", "small.urdf", "m.csv", "--error-model", "offset", "--format", "offsets", "--json")
    assert yaml.safe_load(done.out)["files"] == {"offsets": "small_offsets.yaml", "calibration": "small_calibration.yaml"}
    assert (done.code, "offsets alone" in done.err, Path("small_calibrated.urdf").exists()) == (0, False, False), done.err
    content = yaml.safe_load(Path("small_offsets.yaml").read_text())
    assert content["joints"]["lift"]["offset"] == pytest.approx(-0.05, abs=3e-3)
    assert content["off_from_the_whole_correction"]["offsets_alone_mm"]["max"] < 1e-9
    assert Path("small_calibration.yaml").exists()


REFUSED = {
    "not a UR": (("--format", "ur"), "missing: shoulder_pan_joint"),
    "unknown": (("--format", "dh"), "'dh' is not one of 'urdf', 'origins-yaml', 'ur', 'offsets'"),
    "hash without ur": (("--ur-hash-from", "h.yaml"), "--ur-hash-from means something with --format ur alone"),
    "kind of file": (("--format", "offsets", "-o", "x.urdf"), "x.urdf: --format offsets writes YAML"),
    "an input": (("--format", "urdf", "-o", "small.urdf"), "small.urdf: is an input of this command"),
    "no folder": (("--format", "urdf", "--format", "offsets", "-o", "nowhere/x.urdf"), "the folder nowhere does not exist"),
    "one file twice": (("-o", "x.urdf", "--compensation", "x.yaml"), "two outputs of this command"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_refused_formats_leave_nothing(case: str, run_cli: Callable[..., CliResult], tmp_path: Path) -> None:
    """Exit code 2, one line, and no file is written."""
    words, message = REFUSED[case]
    (tmp_path / "small.urdf").write_text(URDF)
    assert run_cli("simulate", "small.urdf", "-o", "m.csv", "--poses", "20", "-q").code == 0
    before = sorted(tmp_path.iterdir())
    done = run_cli("fit", "small.urdf", "m.csv", *words)
    assert (done.code, done.out, done.err.count("\n")) == (2, "", 1)
    assert message in done.err
    assert sorted(tmp_path.iterdir()) == before


def test_a_wrong_rig_link_is_refused_by_apply(run_cli: Callable[..., CliResult], tmp_path: Path) -> None:
    """`apply --laser` names links that must be there; without it the rig may have been taken off."""
    (tmp_path / "small.urdf").write_text(URDF)
    assert run_cli("simulate", "small.urdf", "-o", "m.csv", "--poses", "20", "-q").code == 0
    assert run_cli("apply", "small.urdf", "m_truth.yaml", "-o", "o.urdf", "--laser", "laser_1", "--screen", "screen").code == 0
    done = run_cli("apply", "small.urdf", "m_truth.yaml", "-o", "p.urdf", "--laser", "laser_9")
    assert (done.code, "laser_9" in done.err, Path("p.urdf").exists()) == (2, True, False)
