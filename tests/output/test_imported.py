"""Geometry that somebody else found, brought in."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
import yaml

from urdfcal.base.errors import InputError, MeasurementError, RobotError
from urdfcal.base.geometry import SE3, X, Z, rotation_screw, translation_screw, xyz_rpy
from urdfcal.calibration.analysis.comparison import Account, compare
from urdfcal.model.error_model import ErrorModel
from urdfcal.model.gauge import build_error_model
from urdfcal.model.options import ModelOptions
from urdfcal.output.driver_yaml import origins_yaml, ur_yaml
from urdfcal.output.imported import assumed_joints, corrections_to, dh_origins, origins_of, read_origins
from urdfcal.output.stored import corrected_robot
from urdfcal.robot.robot import Robot, load_robot

ROWS = np.array([[0.05, 0.30, -1.5, 0.2], [0.40, 0.05, 0.4, -0.3], [0.06, 0.10, 1.3, 0.5], [0.02, 0.35, -1.4, 0.1]])  # a d alpha theta
ERRORS = np.array([[1e-3, -2e-3, 2e-3, 1e-3], [-1e-3, 1e-3, 1e-3, -2e-3], [5e-4, 2e-3, -3e-3, 3e-3], [2e-3, -1e-3, 2e-3, 1e-3]])


def about(direction: np.ndarray, angle: float) -> SE3:
    """A turn about an axis through the origin."""
    return pin.exp6(pin.Motion(rotation_screw(direction, np.zeros(3)) * angle))


def along(direction: np.ndarray, length: float) -> SE3:
    """A shift."""
    return pin.exp6(pin.Motion(translation_screw(direction) * length))


def modified(rows: np.ndarray) -> list[SE3]:
    """Placements of joints, and of a tool, of a table in Craig's convention."""
    return [about(X, alpha) * along(X, a) * about(Z, theta) * along(Z, d) for a, d, alpha, theta in rows] + [along(Z, 0.1)]


def standard(rows: np.ndarray) -> list[SE3]:
    """Placements of joints, and of a tool, of a table in the standard convention: a link lies behind its joint."""
    return [pin.SE3.Identity(), *(about(Z, theta) * along(Z, d) * along(X, a) * about(X, alpha) for a, d, alpha, theta in rows)]


def robot_with(placements: list[SE3], path: Path) -> Robot:
    """A serial arm of turning joints about z, with a fixed tool."""
    lines = ['<robot name="dh"><link name="base"/>']
    parent = "base"
    for index, placement in enumerate(placements):
        last = index == len(placements) - 1
        child, kind = ("tool", "fixed") if last else (f"link{index + 1}", "revolute")
        xyz, rpy = (" ".join(f"{value:.17g}" for value in part) for part in xyz_rpy(placement))
        lines.append(f'<link name="{child}"/><joint name="j{index + 1}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>')
        lines.append(f'<origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="1" velocity="1"/></joint>')
        parent = child
    path.write_text("\n".join([*lines, "</robot>"]))
    return load_robot(path)


@pytest.mark.parametrize(("convention", "placements"), [("modified", modified), ("standard", standard)])
def test_dh_errors_make_the_robot_of_the_whole_table(convention: str, placements, tmp_path: Path, rng: np.random.Generator) -> None:
    """Errors laid over the nominal robot give the robot that nominal rows plus errors are multiplied out to."""
    nominal, real = (robot_with(placements(rows), tmp_path / f"{name}.urdf") for name, rows in (("a", ROWS), ("b", ROWS + ERRORS)))
    table = tmp_path / "dh.csv"
    lines = [f"j{index + 1},{','.join(map(repr, row.tolist()))}" for index, row in enumerate(ERRORS * [1e3, 1e3, 1, 1])]
    table.write_text("\n".join(["joint,d_a [mm],d_d [mm],d_alpha,d_theta", *lines]))
    found = corrected_robot(nominal, dh_origins(table, nominal, "tool", convention))
    assert compare(Account("found", found), Account("real", real), "tool", rng, count=50).at_tool.distance.max() < 1e-12


def test_the_papers_convention_is_that_of_the_error_model(robots: dict[str, Robot], tmp_path: Path) -> None:
    """A table of errors gives the origins that the dh error model gives for the same values."""
    arm = robots["arm7"]
    errors: ErrorModel = build_error_model(arm.chain, arm.rig, ModelOptions(error_model="dh"))
    x = np.where([name.startswith("joint") for name in errors.names], 1e-3 * np.arange(len(errors.names)), 0.0)
    values = dict(zip(errors.names, x.tolist(), strict=True))
    names = ("d_a", "d_d", "d_alpha", "d_theta")
    table = tmp_path / "dh.csv"
    lines = [f"{joint},{','.join(str(values.get(f'{joint}.{name}', 0.0)) for name in names)}" for joint in arm.chain.input_names]
    table.write_text("\n".join([f"joint,{','.join(names)}", *lines]))
    expected = errors.corrected_origins(x)
    for joint, origin in dh_origins(table, arm, "slm", "paper").items():
        assert np.allclose(origin.homogeneous, expected[joint].homogeneous, atol=1e-14)


def test_a_wrong_table_is_refused(robots: dict[str, Robot], tmp_path: Path) -> None:
    """Unknown joints, no errors at all, and one that nothing can carry are named with line and column."""
    table, arm = tmp_path / "dh.csv", robots["arm7"]
    for text, word in (
        ("joint,d_a\njoint9,1e-3", "dh.csv:2: column 'joint': no joint named 'joint9'"),
        ("joint,a\njoint1,1e-3", "column 'd_a': is missing, and so are the others"),
        ("joint,d_a\njoint7,x", "dh.csv:2: column 'd_a': 'x'"),
    ):
        table.write_text(text)
        with pytest.raises(MeasurementError, match=word.replace("(", r"\(")):
            dh_origins(table, arm, "slm", "modified")
    table.write_text("joint,d_a\njoint7,1e-3")
    with pytest.raises(MeasurementError, match="lies behind the last joint"):
        dh_origins(table, arm, "link7", "standard")


def test_origins_come_back(robots: dict[str, Robot], tmp_path: Path) -> None:
    """What urdfcal writes as origins, and another URDF, are read as the same placements; a joint that is not there is named."""
    arm = robots["arm7"]
    origins = {f"joint{index}": arm.tree.joints[f"joint{index}"].origin * along(X, 1e-3 * index) for index in (1, 4)}
    file = tmp_path / "origins.yaml"
    file.write_bytes(origins_yaml(arm, origins))
    other = corrected_robot(arm, origins)
    for found in (read_origins(file, arm), origins_of(other, arm)):
        for name, origin in origins.items():
            assert np.allclose(found[name].homogeneous, origin.homogeneous, atol=1e-15)
    file.write_text(file.read_text().replace("joint4:", "joint44:"))
    with pytest.raises(InputError, match=r"origins.yaml:\d+: joints: no joint named 'joint44'"):
        read_origins(file, arm)


def test_a_ur_kinematics_file_is_the_robots_own(example_robots: Path, tmp_path: Path, rng: np.random.Generator) -> None:
    """A file with the numbers of a UR whose joints turn about other axes than z is refused, and one of z axes is taken."""
    sections = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")
    names = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
    placements = [*modified(np.vstack([ROWS, ROWS[:2]]))]
    path = tmp_path / "ur.urdf"
    text = robot_with(placements, path).description.text.decode()
    for index, name in enumerate(names):
        text = text.replace(f'"j{index + 1}"', f'"{name}_joint"')
    path.write_text(text)
    robot = load_robot(path)
    real = {section: placement * along(X, rng.normal(0, 1e-3)) for section, placement in zip(sections, placements[:-1], strict=True)}
    entries = {
        section: dict(zip(("x", "y", "z", "roll", "pitch", "yaw"), np.concatenate(xyz_rpy(placement)).tolist(), strict=True))
        for section, placement in real.items()
    }
    file = tmp_path / "kinematics.yaml"
    file.write_text(yaml.safe_dump({"kinematics": {**entries, "hash": "calib_1"}}))
    found = read_origins(file, robot)
    for section, name in zip(sections, names, strict=True):
        assert np.allclose(found[f"{name}_joint"].homogeneous, real[section].homogeneous, atol=1e-12)
    file.write_bytes(ur_yaml(robot, found, None))  # our own, which has no hash
    assert all(np.allclose(own.homogeneous, found[name].homogeneous, atol=1e-9) for name, own in read_origins(file, robot).items())
    with pytest.raises(RobotError, match="turn about other axes than z"):
        read_origins(file, load_robot(example_robots / "ur_description" / "urdf" / "ur5_robot.urdf"))


def test_what_is_assumed_is_a_prior_of_each_number(robots: dict[str, Robot]) -> None:
    """Six independent numbers a moving joint, as unsure as was said, about the origins that were read."""
    from urdfcal.model.options import parse_prior

    arm = robots["arm7"]
    origins = {name: arm.tree.joints[name].origin for name in ("joint1", "joint2", "slm_joint") if name in arm.tree.joints}
    known = assumed_joints(arm, origins, parse_prior("0.3mm,1mrad"))
    assert set(known.origins) == {"joint1", "joint2"}
    assert np.allclose(np.sqrt(np.diag(known.covariance)), np.tile([3e-4] * 3 + [1e-3] * 3, 2))
    assert all(own.moving for own in corrections_to(arm, known.origins).values())
