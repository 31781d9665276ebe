"""A stored calibration, and how it is put on a robot description (again)."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
import yaml

from tests.support.helpers import assert_poses_close
from tests.support.small_robot import URDF, robot_of
from urdfcal.base.errors import CalibrationFileError
from urdfcal.output.calibration_yaml import joint_entries
from urdfcal.output.stored import StoredCalibration, read_calibration
from urdfcal.robot.corrections import OriginCorrection
from urdfcal.robot.robot import Robot, load_robot
from urdfcal.robot.urdf_writer import with_origins

NAMES = ["base_mount", "turn", "lift", "slide", "slm_mount", "laser_1_mount"]


@pytest.fixture
def stored(tmp_path: Path, rng: np.random.Generator) -> StoredCalibration:
    """A calibration of the small robot with errors of centimetres and degrees, after its way through a file."""
    joints = robot_of(URDF).tree.joints
    corrections = {
        name: OriginCorrection(joints[name].origin, joints[name].origin * pin.exp6(rng.normal(0, 0.02, 6)), joints[name].moves)
        for name in NAMES
    }
    (tmp_path / "c.yaml").write_text(yaml.safe_dump({"joints": joint_entries(corrections)}))
    found = read_calibration(tmp_path / "c.yaml")
    for name, correction in corrections.items():
        assert_poses_close(found.corrections[name].nominal, correction.nominal, mm=1e-11, mrad=1e-11)
        assert_poses_close(found.corrections[name].corrected, correction.corrected, mm=1e-11, mrad=1e-11)
    return found


def put_on(robot: Robot, stored: StoredCalibration, force: bool = False) -> Robot:
    origins, _ = stored.origins_for(robot, force)
    return robot_of(with_origins(robot.description, origins))


def without(text: str, *parts: str) -> str:
    """A URDF without some links and the joints that carry them."""
    for part in parts:
        start = text.index(f'  <joint name="{part}_mount"')
        text = text[:start] + text[text.index("</joint>\n", start) + len("</joint>\n") :]
        text = text.replace(f'  <link name="{part}"/>\n', "")
    return text


def test_a_nominal_robot_gets_the_corrected_origins(stored: StoredCalibration) -> None:
    """Every origin that equals the nominal one becomes the corrected one, and no other changes."""
    before, after = robot_of(URDF).tree.joints, put_on(robot_of(URDF), stored).tree.joints
    for name, joint in after.items():
        assert_poses_close(joint.origin, stored.corrections[name].corrected if name in NAMES else before[name].origin, mm=1e-11, mrad=1e-11)


def test_a_robot_that_has_changed_elsewhere_gets_them_too(stored: StoredCalibration) -> None:
    """Another name, another mesh, another comment and rounding far under a micrometre are no obstacle."""
    text = (
        URDF.replace('name="small"', 'name="other"').replace("-1.4 0 -0.1", "-1.4000000000001 0 -0.1").replace("<axis", "<!-- new --><axis")
    )
    assert_poses_close(
        put_on(robot_of(text), stored).tree.joints["base_mount"].origin, stored.corrections["base_mount"].corrected, mm=1e-11
    )


@pytest.mark.parametrize("force", [False, True])
def test_a_calibrated_robot_is_left_alone(force: bool, stored: StoredCalibration) -> None:
    """A robot that holds the corrected origins is refused as already calibrated, also with --force."""
    with pytest.raises(CalibrationFileError, match=r"c\.yaml: the robot small\.urdf is already calibrated with this file"):
        stored.origins_for(put_on(robot_of(URDF), stored), force)


def test_what_is_left_is_applied(stored: StoredCalibration) -> None:
    """A calibrated arm with a new, nominal module gets the module's correction and keeps its own."""
    arm = put_on(robot_of(URDF), stored)
    fresh = robot_of(with_origins(arm.description, {name: stored.corrections[name].nominal for name in ("slm_mount", "laser_1_mount")}))
    origins, missing = stored.origins_for(fresh)
    assert (sorted(origins), missing) == (["laser_1_mount", "slm_mount"], [])


def test_another_origin_is_refused_unless_forced(stored: StoredCalibration) -> None:
    """An origin that is neither nominal nor corrected is refused with its distance; --force puts the delta on top of it."""
    robot = robot_of(URDF.replace('xyz="0 0 0.2"', 'xyz="0 0 0.203"'))
    with pytest.raises(CalibrationFileError, match=r"joint 'turn' of small\.urdf is neither .* \(3 mm, 0 mrad from nominal\); --force"):
        stored.origins_for(robot)
    correction = stored.corrections["turn"]
    forced = put_on(robot, stored, force=True).tree.joints["turn"].origin
    assert_poses_close(forced, robot.tree.joints["turn"].origin * correction.nominal.inverse() * correction.corrected, mm=1e-10, mrad=1e-10)


def test_the_module_may_be_taken_off(stored: StoredCalibration) -> None:
    """Links of the rig that are missing are no error: the joints of the robot get their corrections."""
    bare = robot_of(without(URDF, "laser_1", "laser_2", "slm"))
    origins, missing = stored.origins_for(bare)
    assert (sorted(origins), sorted(missing)) == (["base_mount", "lift", "slide", "turn"], ["laser_1_mount", "slm_mount"])


def test_a_moving_joint_must_be_there(stored: StoredCalibration) -> None:
    """A calibrated joint that the robot lacks is refused with the nearest name."""
    with pytest.raises(CalibrationFileError, match=r"the robot small\.urdf has no joint 'lift'; did you mean 'lift_2'\?"):
        stored.origins_for(robot_of(URDF.replace('"lift"', '"lift_2"')))


def test_a_calibration_of_the_rig_alone_needs_the_rig(stored: StoredCalibration) -> None:
    """Where none of the calibrated joints is left, nothing is written."""
    rig = StoredCalibration(stored.path, {name: stored.corrections[name] for name in ("slm_mount", "laser_1_mount")})
    with pytest.raises(CalibrationFileError, match="has none of the calibrated joints: slm_mount, laser_1_mount"):
        rig.origins_for(robot_of(without(URDF, "laser_1", "laser_2", "slm")))


def test_any_rotation_is_recognised_after_its_way_through_text(rng: np.random.Generator) -> None:
    """The nominal origin is found again after rpy has been written and read, at pitch 90 deg and half turns too."""
    special = [(0, np.pi / 2, 0.3), (np.pi, 0, 0), (0, 0, -np.pi), (np.pi, -np.pi / 2, 1), (1e-9, 1e-9, np.pi)]
    for rpy in [*special, *rng.uniform(-4, 4, (200, 3))]:
        robot = robot_of(URDF.replace('rpy="0.1 0 0"', f'rpy="{" ".join(repr(float(angle)) for angle in rpy)}"'))
        again = robot_of(with_origins(robot.description, {"lift": robot.tree.joints["lift"].origin * pin.exp6(np.full(6, 1e-13))}))
        stored = StoredCalibration(Path("c"), {"lift": OriginCorrection(again.tree.joints["lift"].origin, pin.SE3.Random(), True)})
        assert list(stored.origins_for(robot)[0]) == ["lift"]


def test_a_controller_gets_the_same_robot(stored: StoredCalibration) -> None:
    """The corrected Pinocchio model has the placements of the corrected URDF."""
    robot = robot_of(URDF)
    model, again = stored.apply_to(robot.model), put_on(robot, stored).model
    for mine, theirs in zip(model.jointPlacements, again.jointPlacements, strict=True):
        assert_poses_close(mine, theirs, mm=1e-9, mrad=1e-9)


ENTRY = "{moves: true, nominal: {xyz: [0, 0, 0], rpy: [0, 0, 0]}, corrected: {xyz: [0, 0, 0], rpy: [0, 0, 0]}}"
BAD = {
    "empty": ("", ": is no calibration: it has no entry 'joints'; expected a file written by urdfcal fit or simulate"),
    "list": ("[1]", ": is no calibration"),
    "no joints": ("joints: {}", ":1: entry 'joints': Dictionary should have at least 1 item"),
    "joints list": ("joints: [1]", ":1: entry 'joints': Input should be a valid dictionary"),
    "joint word": ("joints:\n  a: b", ":2: entry 'joints.a': Input should be a valid dictionary"),
    "no corrected": (
        "joints:\n  a: {moves: true, nominal: {xyz: [0, 0, 0], rpy: [0, 0, 0]}}",
        ":2: entry 'joints.a.corrected': Field required",
    ),
    "no moves": (f"joints:\n  a: {ENTRY}".replace("moves: true, ", ""), ":2: entry 'joints.a.moves': Field required"),
    "two numbers": (f"joints:\n  a: {ENTRY}".replace("[0, 0, 0]", "[0, 0]", 1), ":2: entry 'joints.a.nominal.xyz.2': Field required"),
    "word": (
        f"joints:\n  a: {ENTRY}".replace("[0, 0, 0]", "[0, x, 0]", 1),
        ":2: entry 'joints.a.nominal.xyz.1': Input should be a valid number",
    ),
    "nan": (
        f"joints:\n  a: {ENTRY}".replace("[0, 0, 0]", "[0, .nan, 0]", 1),
        ":2: entry 'joints.a.nominal.xyz.1': Input should be a finite number",
    ),
    "twice": (f"joints:\n  a: {ENTRY}\n  a: {ENTRY}", ":3: the entry 'a' stands twice"),
}


@pytest.mark.parametrize("case", BAD)
def test_what_is_no_calibration_is_refused(case: str, tmp_path: Path) -> None:
    """Each fault is one message with file, line and entry."""
    text, message = BAD[case]
    (tmp_path / "c.yaml").write_text(text)
    with pytest.raises(CalibrationFileError) as error:
        read_calibration(tmp_path / "c.yaml")
    assert str(error.value).startswith(f"{tmp_path}/c.yaml{message}")


def test_apply_gives_the_robot_that_fit_wrote(run_cli: Callable[..., tuple[int, str, str]], tmp_path: Path) -> None:
    """simulate, fit and apply on the command line: the applied URDF has the fitted placements, and says so of a second time."""
    (tmp_path / "small.urdf").write_text(URDF)
    assert run_cli("simulate", "small.urdf", "-o", "m.csv", "--poses", "20", "--errors", "5mm,0.5deg")[0] == 0
    assert run_cli("fit", "small.urdf", "m.csv", "--error-model", "placement")[0] == 0
    assert run_cli("apply", "small.urdf", "small_calibration.yaml", "-o", "again.urdf")[0] == 0
    fitted, again = load_robot("small_calibrated.urdf").tree.joints, load_robot("again.urdf").tree.joints
    for name, joint in fitted.items():
        assert_poses_close(again[name].origin, joint.origin, mm=1e-10, mrad=1e-10)
    code, out, err = run_cli("apply", "again.urdf", "small_calibration.yaml", "-o", "twice.urdf")
    assert (code, out, err) == (2, "", "urdfcal: small_calibration.yaml: the robot again.urdf is already calibrated with this file\n")
    assert not Path("twice.urdf").exists()


def test_a_truth_is_applied_and_simulated_again(run_cli: Callable[..., tuple[int, str, str]], tmp_path: Path) -> None:
    """The truth of a simulation can be applied like a calibration, and stated as the errors of another simulation."""
    (tmp_path / "small.urdf").write_text(URDF)
    noiseless = ("--poses", "5", "--spot-noise-mm", "0", "--seed", "3")
    assert run_cli("simulate", "small.urdf", "-o", "m.csv", *noiseless)[0] == 0
    assert run_cli("apply", "small.urdf", "m_truth.yaml", "-o", "true.urdf")[0] == 0
    code, out, _ = run_cli("evaluate", "true.urdf", "m.csv", "--json")
    table = yaml.safe_load(out)["before"]
    assert (code, max(row["max_mm"] for row in table.values()) < 1e-6) == (0, True)
    assert run_cli("simulate", "small.urdf", "-o", "n.csv", "--errors", "m_truth.yaml", *noiseless)[0] == 0
    again = yaml.safe_load((tmp_path / "n_truth.yaml").read_text())
    assert again["joints"] == yaml.safe_load((tmp_path / "m_truth.yaml").read_text())["joints"]


def test_paths_that_are_no_utf8_are_recorded(run_cli: Callable[..., tuple[int, str, str]], tmp_path: Path) -> None:
    """A robot and measurements with Latin-1 bytes in their names are calibrated, and the record stays UTF-8."""
    robot, data = (os.fsdecode(name) for name in (b"caf\xe9.urdf", b"m\xe9.csv"))
    try:
        (tmp_path / robot).write_text(URDF)
    except OSError:
        pytest.skip("this file system takes UTF-8 names alone")
    assert run_cli("simulate", robot, "-o", data, "--poses", "20", "-q")[0] == 0
    assert run_cli("fit", robot, data, "-o", "out.urdf", "--force", "-q")[0] in (0, 3)
    record = yaml.safe_load((tmp_path / "out_calibration.yaml").read_text("utf-8"))
    assert (record["robot"]["file"], record["measurements"]["file"]) == (r"caf\udce9.urdf", r"m\udce9.csv")
