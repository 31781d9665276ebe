"""What a file says of its poses beside their joints."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import urdfcal
from urdfcal.base.errors import MeasurementError
from urdfcal.robot.robot import Robot
from urdfcal.sensors.measurements_csv import write_measurements


def read(tmp_path: Path, robots: dict[str, Robot], columns: dict[str, list[object]]) -> urdfcal.Measurements:
    """A file of points of a UR5's tool with further columns."""
    names = ["shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3"]
    rows = 4
    table: dict[str, list[object]] = {
        f"{name}_joint": [round(0.1 * row * (1 + number), 3) for row in range(rows)] for number, name in enumerate(names)
    }
    table |= {f"tool0.{axis}": [0.1 * row + 0.2 for row in range(rows)] for axis in "xyz"} | columns
    lines = [",".join(table), *(",".join(str(cell) for cell in row) for row in zip(*table.values(), strict=True))]
    file = tmp_path / "m.csv"
    file.write_text("\n".join(lines) + "\n")
    return urdfcal.read_measurements(file, robots["ur5"])


@pytest.mark.parametrize(
    ("header", "cells", "seconds"),
    [
        ("time", [0, 1.5, 3, 10], [0, 1.5, 3, 10]),
        ("time [min]", [0, 1, 2, 4], [0, 60, 120, 240]),
        ("time", ["2026-01-31T12:00:00", "2026-01-31T12:00:01.5Z", "2026-01-31T12:01:00", "2026-02-01T12:00:00"], [0, 1.5, 60, 86400]),
    ],
)
def test_times_are_seconds_or_dates(
    tmp_path: Path, robots: dict[str, Robot], header: str, cells: list[object], seconds: list[float]
) -> None:
    """Whatever the unit; dates are those of one calendar, whatever file they stand in."""
    time = read(tmp_path, robots, {header: cells}).time
    assert time is not None
    np.testing.assert_allclose(time - (time[0] if "2026" in str(cells[0]) else 0.0), seconds)


def test_a_time_that_is_none_is_not_used_and_said(tmp_path: Path, robots: dict[str, Robot]) -> None:
    """The order of the rows stands for it then."""
    data = read(tmp_path, robots, {"time": ["early", "late", "later", "latest"]})
    assert data.time is None
    assert any("'time' has cells that are neither seconds nor dates" in warning for warning in data.warnings)
    np.testing.assert_allclose(data.clock, [0, 1, 2, 3])


def test_directions_may_be_stated(tmp_path: Path, robots: dict[str, Robot]) -> None:
    """In place of what the order of the rows shows; an empty cell is unknown, and what is no direction is refused."""
    data = read(tmp_path, robots, {"elbow_joint.approach": [1, -1, 0, ""]})
    assert data.approach is not None
    elbow = data.joints.index("elbow_joint")
    assert data.approach[:, elbow].tolist() == [1, -1, 0, 0]
    assert data.approach[:, 0].tolist() == [0, 1, 1, 1]
    assert not data.warnings
    with pytest.raises(MeasurementError, match=r"column 'elbow_joint\.approach': '2' is no direction; expected -1, 0 or 1"):
        read(tmp_path, robots, {"elbow_joint.approach": [1, 2, 0, ""]})


def test_what_was_read_of_poses_is_written_again(tmp_path: Path, robots: dict[str, Robot]) -> None:
    """Time, temperature and payload."""
    data = read(tmp_path, robots, {"time": [0, 1, 2, 3], "temperature": [20, 21, 22.5, 23], "payload [kg]": [0, 1, 0, 1]})
    write_measurements(tmp_path / "again.csv", data)
    again = urdfcal.read_measurements(tmp_path / "again.csv", robots["ur5"])
    for name in ("time", "temperature", "payload"):
        np.testing.assert_array_equal(getattr(again, name), getattr(data, name))
