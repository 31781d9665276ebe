"""Kinematics files of Universal Robots' driver: whose hash is taken over."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
import yaml

from tests.conftest import CliResult
from tests.output.test_formats import UR_ORIGINS, ur_robot
from urdfcal.base.errors import CalibrationFileError, InputError
from urdfcal.base.geometry import MM, SE3
from urdfcal.output.driver_yaml import ur_yaml
from urdfcal.output.formats import Deployed, deployment
from urdfcal.output.stored import read_calibration
from urdfcal.output.ur_file import read_ur_file
from urdfcal.robot.robot import Robot

HASH = "calib_12788084448423163542"
UR10 = {"elbow_joint": "-0.612 0 0", "wrist_1_joint": "-0.5723 0 0.163941", "shoulder_pan_joint": "0 0 0.1273"}  # published lengths


def shifted(robot: Robot, mm: float, mrad: float) -> dict[str, SE3]:
    """Every joint's origin moved along one axis and turned about another."""
    delta = pin.SE3(pin.exp3(np.array([0, mrad * 1e-3, 0])), np.array([mm * MM, 0, 0]))
    return {name: robot.tree.joints[name].origin * delta for name in UR_ORIGINS}


def factory_file(folder: Path, robot: Robot, mm: float = 0.0, mrad: float = 0.0) -> Path:
    """The file of a robot whose factory calibration has these errors."""
    path = folder / "factory.yaml"
    path.write_bytes(ur_yaml(robot, shifted(robot, mm, mrad), HASH))
    return path


def warnings_of(robot: Robot, path: Path) -> tuple[str, ...]:
    plan = deployment(["ur"], None, "ur", path)
    plan.require_fit_for(robot, UR_ORIGINS)
    return Deployed(robot, shifted(robot, 1, 1)).warnings(plan)


def test_the_file_that_the_description_was_made_with_is_taken_without_a_word(tmp_path: Path) -> None:
    """Numbers that agree to a micrometre say nothing, and the hash is written, for an arm with a prefix, too."""
    robot = ur_robot()
    path = factory_file(tmp_path, robot)
    path.write_text(path.read_text().replace("-0.425", "-0.4250001"))
    assert warnings_of(robot, path) == ()
    plan = deployment(["ur"], None, "ur", path)
    (content,) = Deployed(robot, shifted(robot, 1, 1)).files(plan).values()
    assert yaml.safe_load(content)["kinematics"]["hash"] == HASH


@pytest.mark.parametrize(("mm", "mrad"), [(0.02, 0), (0, 0.02), (3, 17), (8, 40)])
def test_another_calibration_s_file_is_warned_of(mm: float, mrad: float, tmp_path: Path) -> None:
    """Where the description was not made with the file, how far apart the two are is said; nothing is refused."""
    robot = ur_robot()
    (said,) = warnings_of(robot, factory_file(tmp_path, robot, mm, mrad))
    assert f"its numbers are up to {mm:.2f} mm and {mrad:.2f} mrad from those of" in said


def test_another_model_s_file_is_refused(tmp_path: Path) -> None:
    """The lengths of a UR10 beside a UR5's description are those of another robot; the farthest joint is named."""
    robot, path = ur_robot(), factory_file(tmp_path, ur_robot())
    content = yaml.safe_load(path.read_text())
    for section, joint in (("forearm", "elbow_joint"), ("wrist_1", "wrist_1_joint"), ("shoulder", "shoulder_pan_joint")):
        content["kinematics"][section] |= dict(zip("xyz", map(float, UR10[joint].split()), strict=True))
    path.write_text(yaml.safe_dump(content))
    with pytest.raises(InputError, match=r"factory\.yaml: its wrist_1 is 188 mm and 0 mrad from that of .* as in another model of robot"):
        warnings_of(robot, path)


def test_frames_that_cannot_be_compared_are_not(robots: dict[str, Robot], tmp_path: Path) -> None:
    """An older description has other frames, which is warned of already; a file without numbers cannot be told."""
    said = warnings_of(robots["ur5"], factory_file(tmp_path, ur_robot(), 3, 5))
    assert ["turn about other axes than z" in line for line in said] == [True]
    bare = tmp_path / "bare.yaml"
    bare.write_text(f"kinematics:\n  shoulder: {{x: 0}}\n  hash: {HASH}\n")
    (line,) = warnings_of(ur_robot(), bare)
    assert line.endswith("bare.yaml: has no numbers of the six joints, so nothing tells whether its hash is this robot's")


@pytest.mark.parametrize("text", ["kinematics: {}", "[1]", "kinematics: {hash: 3}", "", "kinematics: 3"])
def test_a_file_without_a_hash_is_refused(text: str, tmp_path: Path) -> None:
    """What ur_calibration did not extract is named as such."""
    (tmp_path / "other.yaml").write_text(text)
    with pytest.raises(InputError, match=r"other\.yaml: has no entry kinematics: hash"):
        read_ur_file(tmp_path / "other.yaml")


def test_a_kinematics_file_is_no_calibration(tmp_path: Path) -> None:
    """Given where a calibration belongs, it is told what reads it."""
    with pytest.raises(CalibrationFileError, match=r"is a kinematics file of the UR driver, which the robot's xacro reads \(--xacro-arg"):
        read_calibration(factory_file(tmp_path, ur_robot()))


def test_fit_says_whose_hash_it_takes(run_cli: Callable[..., CliResult], tmp_path: Path) -> None:
    """From end to end: another model's file is exit 2 with nothing written, another calibration's a warning."""
    robot = ur_robot()
    (tmp_path / "ur.urdf").write_bytes(robot.description.text)
    assert run_cli("simulate", "ur.urdf", "-o", "m.csv", "--sensor", "pose:link6", "--poses", "30").code == 0
    for mm, code, words in ((60, 2, "another model of robot"), (2, 0, "its hash is right only if both are of the very robot")):
        path = factory_file(tmp_path, robot, mm)
        run = run_cli("fit", "ur.urdf", "m.csv", "--no-sag", "--format", "ur", "--ur-hash-from", path)
        assert (run.code, words in run.err) == (code, True), run.err
        assert (tmp_path / "ur_kinematics.yaml").exists() == (code == 0)
