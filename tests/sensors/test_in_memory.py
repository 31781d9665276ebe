"""Arrays, dictionaries and DataFrames are read as the file that they would be written as."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from tests.support.sensor_cases import CASES, NOISE, robot_named, setup_of
from urdfcal.base.errors import MeasurementError, ShapeMismatch, UsageError
from urdfcal.robot.robot import Robot, load_robot
from urdfcal.sensors.in_memory import measurements_from
from urdfcal.sensors.joined import joined
from urdfcal.sensors.measurements import Measurements, spots_measured
from urdfcal.sensors.measurements_csv import read_measurements, write_measurements
from urdfcal.simulation.readings import simulate_readings

NAMES = ("every kind", "inclination", "sessions")


@dataclass(frozen=True)
class Frame:
    """What measurements need of a DataFrame, of whatever library: columns, and each by its name."""

    cells: dict[str, Any]

    @property
    def columns(self) -> list[str]:
        return list(self.cells)

    def __getitem__(self, name: str) -> Any:
        return self.cells[name]


@pytest.fixture(scope="module", params=NAMES)
def written(
    request: pytest.FixtureRequest, robots: dict[str, Robot], tmp_path_factory: pytest.TempPathFactory
) -> tuple[Robot, Measurements, Path]:
    """A robot, what its instruments read, and a file of it."""
    case, path = CASES[request.param], tmp_path_factory.mktemp("written") / "read.csv"
    rng = np.random.default_rng(5)
    data = simulate_readings(setup_of(case, robots, rng), 12, rng, NOISE)
    write_measurements(path, data)
    return robot_named(case, robots), data, path


def require_same(one: Measurements, other: Measurements) -> None:
    """Two sets hold the same, to the digits that a file has."""
    assert (one.joints, one.poses.tolist(), one.sessions.tolist()) == (other.joints, other.poses.tolist(), other.sessions.tolist())
    np.testing.assert_allclose(one.q, other.q, atol=1e-11)
    assert [(own.sensor, own.target) for own in one.readings] == [(own.sensor, own.target) for own in other.readings]
    for own, also in zip(one.readings, other.readings, strict=True):
        np.testing.assert_allclose(own.values, also.values, atol=1e-10)
        assert own.labels.tolist() == also.labels.tolist()


def cells_of(path: Path) -> dict[str, list[Any]]:
    """Columns of a file of ours, numbers as numbers."""
    head, *rows = [line.split(",") for line in path.read_text("utf-8").splitlines()]
    columns = dict(zip(head, zip(*rows, strict=True), strict=True))
    return {name: [float(cell) if cell and name != "session" else cell or np.nan for cell in cells] for name, cells in columns.items()}


def test_a_table_is_read_as_its_file(written: tuple[Robot, Measurements, Path]) -> None:
    """A dictionary of columns, whatever has columns, and the file are the same measurements; labels stay labels as numbers, too."""
    robot, _, path = written
    from_file, cells = read_measurements(path, robot), cells_of(path)
    require_same(measurements_from(robot, cells), from_file)
    require_same(measurements_from(robot, Frame(cells)), from_file)


def test_arrays_by_sensor_are_read_as_a_file(written: tuple[Robot, Measurements, Path]) -> None:
    """Positions and whole arrays under the sensors' names are the same measurements as the file, to the last bit."""
    robot, data, path = written
    arrays = {f"{own.target}.{own.sensor}": own.labels if own.kind.touches else own.values for own in data.readings}
    read = measurements_from(robot, data.q, arrays, sessions=data.sessions.tolist())
    require_same(read, read_measurements(path, robot))
    np.testing.assert_array_equal(read.q, data.q)


def test_pandas_is_read(robots: dict[str, Robot], tmp_path: Path) -> None:
    """A DataFrame that pandas read from a file, its rows in part, and a unit in a header are what the file is."""
    pandas = pytest.importorskip("pandas")
    robot = robots["ur5"]
    rows = np.random.default_rng(1).uniform(-1, 1, (4, 9))
    head = [*(f"{name} [deg]" for name in robot.chain.input_names), "tool0_x", "tool0_y", "tool0_z"]
    path = tmp_path / "read.csv"
    path.write_text("\n".join([",".join(head), *(",".join(map(repr, row)) for row in rows.tolist())]), "utf-8")
    frame = pandas.read_csv(path)
    require_same(measurements_from(robot, frame), read_measurements(path, robot))
    require_same(measurements_from(robot, frame[2:], poses=["3", "4"]), read_measurements(path, robot).subset([2, 3]))


@pytest.mark.parametrize(
    ("readings", "error", "message"),
    [
        ({"tool0.point": np.zeros((3, 4))}, ShapeMismatch, r"measurements: 'tool0.point' has shape \(3, 4\), expected \(n, 3\)"),
        ({"tool0.pose": np.zeros((3, 6))}, ShapeMismatch, r"'tool0.pose' has shape \(3, 6\), expected \(n, 7\) or \(n, 4, 4\)"),
        ({"tool0.pose": np.zeros((3, 4, 4))}, MeasurementError, r"measurements:1: 'tool0.pose': is no placement; expected a rotation"),
        ({"tool0.foo": np.zeros((3, 3))}, ShapeMismatch, r"'tool0.foo' has shape \(3, 3\), expected .* ends in one of .*\.point.*\.pose"),
        ({"tool0.point": np.zeros((2, 3))}, ShapeMismatch, r"measurements: q has shape \(3, 6\), expected \(2, 6\)"),
        ({"tool0.point": np.zeros((3, 3)), "tool0.distance": [1.0]}, ShapeMismatch, r"column 'tool0\.distance' has 1 rows, expected 3"),
        ({"tool0.point": np.zeros((3, 3)), "tool0.x": np.zeros(3)}, UsageError, r"column 'tool0\.x' is given twice"),
        ({"tool_0.point": np.zeros((3, 3))}, MeasurementError, r"'tool_0\.x': no link named 'tool_0' .* did you mean 'tool0'"),
        ({"tool0.x": ["1", "2", "n/a"], "tool0.y": [1, 2, 3]}, MeasurementError, r"measurements:3: column 'tool0\.x': 'n/a' is not a num"),
        ({"tool0.point": np.full((3, 3), np.inf)}, MeasurementError, r"measurements:1: column 'tool0\.x': 'inf' is not finite"),
        (None, UsageError, r"there are joint positions and no readings"),
    ],
)  # fmt: skip
def test_what_does_not_fit_is_named(robots: dict[str, Robot], readings: Any, error: type[Exception], message: str) -> None:
    """Shapes, names and cells that mean nothing are refused in one line, with the row and the column; rows are counted from 1."""
    with pytest.raises(error, match=message):
        measurements_from(robots["ur5"], np.zeros((3, 6)), readings)


def test_a_link_that_is_not_there_is_named_on_a_bare_arm(example_robots: Path) -> None:
    """Arrays of a target whose link has another name are refused as a table of it is: by the link, not for want of lasers."""
    robot = load_robot(example_robots / "ur_description/urdf/ur5_robot.urdf")
    with pytest.raises(MeasurementError, match=r"column 'tool_0\.x': no link named 'tool_0' .* did you mean 'tool0'"):
        measurements_from(robot, np.zeros((3, 6)), {"tool_0.point": np.zeros((3, 3))})


def test_a_transposed_placement_is_refused_by_its_row(robots: dict[str, Robot]) -> None:
    """A matrix whose translation stands in the last row is no placement; one that was rounded to four digits is."""
    T = np.tile(pin.exp6(np.array([0.3, -0.2, 0.5, 0.4, 1.1, -0.7])).homogeneous, (3, 1, 1))
    read = measurements_from(robots["ur5"], np.zeros((3, 6)), {"tool0.pose": T.round(4)})
    np.testing.assert_allclose(read.readings[0].values[:, :3], T[:, :3, 3], atol=1e-4)
    T[2] = T[2].T
    with pytest.raises(MeasurementError, match=r"measurements:3: 'tool0\.pose': is no placement"):
        measurements_from(robots["ur5"], np.zeros((3, 6)), {"tool0.pose": T})


def test_a_table_holds_the_readings_too(robots: dict[str, Robot]) -> None:
    """Readings beside a table, and noise of spots beside other readings, are refused."""
    with pytest.raises(UsageError, match="a table holds the readings, too"):
        measurements_from(robots["ur5"], {"elbow_joint": [0.0]}, {"tool0.point": np.zeros((1, 3))})
    with pytest.raises(UsageError, match="sigma belongs to spots alone"):
        measurements_from(robots["ur5"], np.zeros((1, 6)), {"tool0.point": np.zeros((1, 3))}, sigma=[[1e-3]])


def test_parts_go_together_again(written: tuple[Robot, Measurements, Path]) -> None:
    """Poses one by one, joined, are the measurements that they were of."""
    _, data, _ = written
    require_same(joined([data.subset([row]) for row in range(len(data))]), data)


def test_parts_with_other_sensors_go_together(written: tuple[Robot, Measurements, Path]) -> None:
    """What one part did not read, it did not see."""
    _, data, _ = written
    few = replace(data, readings=data.readings[:1])
    together = joined([few, data])
    assert [int(own.seen[: len(data)].sum()) for own in together.readings][1:] == [0] * (len(data.readings) - 1)
    require_same(together.subset(np.arange(len(data), 2 * len(data))), data)


def test_parts_of_other_joints_do_not(robots: dict[str, Robot]) -> None:
    """Other joints are refused."""
    parts = [spots_measured(robots[name], np.zeros((1, 6 + (name == "panda"))), np.zeros((1, 2, 2))) for name in ("ur5", "panda")]
    with pytest.raises(ShapeMismatch, match="do not go on with those of shoulder_pan_joint"):
        joined(parts)
