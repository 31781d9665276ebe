"""Files of public data sets as measurements.csv; the contents here are made up in their layouts."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

import urdfcal
from urdfcal.base.errors import MeasurementError, ShapeMismatch
from urdfcal.sensors.public_data import pose_table, socket_folder, tracker_series

JOINTS = ("shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint", "wrist_1_joint", "wrist_2_joint", "wrist_3_joint")
MEASURED = ("x", "y", "z", "rx", "ry", "rz")


def series(tmp_path: Path, q: np.ndarray, p_mm: np.ndarray, degrees: np.ndarray) -> Path:
    """A tracker series with its other columns around what matters."""
    header = ["Timestamp", "Goal x", *JOINTS, "measurement_temperature"]
    header += [word for name in MEASURED for word in (f"measurement_{name}", f"measurement_std_{name}")]
    lines = [";".join(header)]
    for joints, position, angles in zip(q, p_mm, degrees, strict=True):
        cells = [2.02e13, 0.5, *joints, 21.68, *(value for number in (*position, *angles) for value in (number, 0.01))]
        lines.append(";".join(f"{float(cell):.9g}".replace(".", ",") for cell in cells))
    path = tmp_path / "series.csv"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


def test_a_tracker_series_is_read_as_poses_with_rotations_about_moving_axes(
    tmp_path: Path, example_robots: Path, rng: np.random.Generator
) -> None:
    """Joints and points come through, and rx, ry, rz turn about the target's own axes one after the other, as Pinocchio multiplies them."""
    q, p_mm, degrees = rng.uniform(-2, 2, (4, 6)), rng.uniform(-3000, 3000, (4, 3)), rng.uniform(-180, 180, (4, 3))
    path = tmp_path / "measurements.csv"
    path.write_text(tracker_series(series(tmp_path, q, p_mm, degrees)), encoding="utf-8")
    data = urdfcal.read_measurements(path, urdfcal.load_robot(example_robots / "ur_description/urdf/ur10_robot.urdf"))
    point, turned = data.readings
    assert point.link == "tool0"
    np.testing.assert_allclose(data.q, q, atol=1e-8)
    np.testing.assert_allclose(point.values, p_mm / 1000, atol=1e-5)
    for (a, b, c), quaternion in zip(np.radians(degrees), turned.values, strict=True):
        expected = pin.rpy.rpyToMatrix(a, 0, 0) @ pin.rpy.rpyToMatrix(0, b, 0) @ pin.rpy.rpyToMatrix(0, 0, c)
        assert np.abs(pin.Quaternion(quaternion).matrix() - expected).max() < 1e-7


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("measurement_rx", "rotation"), "no column measurement_rx"),
        (("_joint", ""), "no column whose name ends in _joint"),
        (("21,68", "n/a"), None),
        (("2,02e+13", "2,02e+13"), None),
    ],
    ids=["angle", "joints", "cell that does not matter", "as it is"],
)
def test_a_series_that_is_none_is_refused_by_line(tmp_path: Path, change: tuple[str, str], words: str | None) -> None:
    """What is missing is named with the file and the header's line; cells that nobody reads may hold anything."""
    path = series(tmp_path, np.zeros((1, 6)), np.ones((1, 3)), np.ones((1, 3)))
    path.write_text(path.read_text(encoding="utf-8").replace(*change), encoding="utf-8")
    if words is None:
        assert tracker_series(path).count("\n") == 2
        return
    with pytest.raises(MeasurementError, match=rf"series\.csv:1: {words}"):
        tracker_series(path)


def test_a_cell_that_is_no_number_is_named(tmp_path: Path) -> None:
    """With its file, line and column."""
    path = series(tmp_path, np.zeros((2, 6)), np.full((2, 3), 7.0), np.ones((2, 3)))
    path.write_text(path.read_text(encoding="utf-8")[::-1].replace(";7;", ";x;", 1)[::-1], encoding="utf-8")
    with pytest.raises(MeasurementError, match=r"series\.csv:3: column 'measurement_z': 'x' is not a number"):
        tracker_series(path)


def sockets(tmp_path: Path) -> Path:
    """Two places with two holes each, and files beside them that are none."""
    for place in ("front", "back"):
        folder = tmp_path / "panda_1" / place
        folder.mkdir(parents=True)
        for hole in (0, 1):
            (folder / f"hole_{hole}.csv").write_text(f"0.1,0.2e-1,{hole}\n-0.5,1.0,{hole}\n", encoding="utf-8")
        (folder / "hole_0_pose.csv").write_text("not a number\n", encoding="utf-8")
        (folder / "comments.txt").write_text("the table moved\n", encoding="utf-8")
    return tmp_path / "panda_1"


def test_a_socket_folder_becomes_one_table(tmp_path: Path) -> None:
    """One row a pose with its place and hole as label; other files in the folder are left alone."""
    lines = socket_folder(sockets(tmp_path), ("j1", "j2", "j3"), "hand").splitlines()
    assert lines[:3] == ["j1,j2,j3,hand.socket", "0.1,0.02,0,back/0", "-0.5,1,0,back/0"]
    labels = [f"{place}/{hole}" for place in ("back", "front") for hole in (0, 0, 1, 1)]
    assert [line.rsplit(",", 1)[1] for line in lines[1:]] == labels


def test_a_socket_folder_with_too_few_columns_or_none_at_all_is_refused(tmp_path: Path) -> None:
    """A robot with more joints than the files have columns, and a folder without places."""
    with pytest.raises(MeasurementError, match=r"hole_0\.csv:1: column 'j4': '' is not a number"):
        socket_folder(sockets(tmp_path), ("j1", "j2", "j3", "j4"), "hand")
    with pytest.raises(MeasurementError, match=r"there is no <place>/hole_<k>\.csv"):
        socket_folder(tmp_path / "panda_1" / "front", ("j1",), "hand")


def test_poses_in_arrays_come_back_from_the_table(tmp_path: Path, example_robots: Path, rng: np.random.Generator) -> None:
    """Joints, points and axes are those that were given."""
    robot = urdfcal.load_robot(example_robots / "ur_description/urdf/ur10_robot.urdf")
    q, p, R = rng.uniform(-2, 2, (3, 6)), rng.normal(size=(3, 3)), np.array([pin.exp3(rng.normal(size=3)) for _ in range(3)])
    path = tmp_path / "measurements.csv"
    path.write_text(pose_table(JOINTS, q, "tool0", p, R), encoding="utf-8")
    data = urdfcal.read_measurements(path, robot)
    np.testing.assert_allclose(data.q, q, atol=1e-11)
    np.testing.assert_allclose(data.readings[0].values, p, atol=1e-11)
    for rotation, quaternion in zip(R, data.readings[1].values, strict=True):
        assert np.abs(pin.Quaternion(quaternion).matrix() - rotation).max() < 1e-10


def test_arrays_that_do_not_fit_are_refused() -> None:
    """Shapes that differ, and axes that are no rotations."""
    with pytest.raises(ShapeMismatch, match=r"do not fit together; expected \(n, 2\)"):
        pose_table(("a", "b"), np.zeros((2, 2)), "tool", np.zeros((3, 3)), np.tile(np.eye(3), (2, 1, 1)))
    with pytest.raises(ShapeMismatch, match="no rotations"):
        pose_table(("a",), np.zeros((1, 1)), "tool", np.zeros((1, 3)), -np.eye(3)[None])


def test_figaroh_files_are_read_as_they_are(tmp_path: Path, example_robots: Path) -> None:
    """Columns x1, y1, z1 belong to the link that --target names; figaroh's time column is named in a warning and means nothing."""
    text = "t,x1,y1,z1,torso_1_joint,torso_2_joint," + ",".join(f"arm_left_{k}_joint" for k in range(1, 8)) + "\n"
    text += "1.5,0.1,0.2,0.3,0,0.1,0,0.5,0,-0.5,0,0,0\n"
    path = tmp_path / "figaroh.csv"
    path.write_text(text, encoding="utf-8")
    robot = urdfcal.load_robot(example_robots / "talos_data/robots/talos_reduced.urdf")
    data = urdfcal.read_measurements(path, robot, target="arm_left_7_link")
    assert [(each.sensor, each.target) for each in data.readings] == [("point", "arm_left_7_link")]
    np.testing.assert_array_equal(data.readings[0].values, [[0.1, 0.2, 0.3]])
    assert data.joints[:2] == ("torso_1_joint", "torso_2_joint")
    assert any("'t'" in warning for warning in data.warnings)
