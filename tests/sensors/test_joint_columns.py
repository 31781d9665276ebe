"""Joint columns of any table: the same numbers and the same refusals, whether anything was measured or not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.support.small_robot import URDF, joint, robot_of, robot_text
from urdfcal.base.errors import MeasurementError
from urdfcal.base.geometry import DEG, Matrix
from urdfcal.base.tables import Table, read_table
from urdfcal.robot.rig import Instruments, Target
from urdfcal.robot.robot import Robot
from urdfcal.sensors.joint_columns import JointColumns


def positions(folder: Path, text: str) -> tuple[Matrix, list[str]]:
    """Positions in a table, and what is to be said of them."""
    (folder / "q.csv").write_text(text)
    table, robot = read_table(folder / "q.csv", "a column a joint", "one row a pose"), robot_of(URDF)
    columns = JointColumns(table, robot)
    return columns.positions, list(columns.warnings())


def test_positions_are_in_the_order_of_the_arm_and_in_si(tmp_path: Path) -> None:
    """Order of the columns, units and other columns change nothing."""
    q, warnings = positions(tmp_path, "slide [mm];image;turn [deg];lift\n150;a.png;18;-0,2\n")
    np.testing.assert_allclose(q, [[np.pi / 10, -0.2, 0.15]], rtol=1e-15)
    assert warnings == []


def test_a_cell_outside_its_limits_is_said(tmp_path: Path) -> None:
    """One line names the first such row, how many there are, and the limits."""
    _, warnings = positions(tmp_path, "turn,lift,slide\n0,0,0\n0,0,0.4\n")
    assert warnings == [f"{tmp_path}/q.csv:3: column 'slide': a cell lies outside the joint's limits 0 to 0.3 m"]


TURNS = robot_text(
    joint("half", "a", "b").replace("-9", "-2").replace('"9"', '"2"'),
    joint("positive", "b", "c").replace("-9", "0").replace('"9"', '"6.3"'),
    joint("several", "c", "d").replace("-9", "-13").replace('"9"', '"13"'),
    joint("endless", "d", "e", kind="continuous"),
    joint("slide", "e", "f", kind="prismatic").replace("-9", "-1").replace('"9"', '"1"'),
    links="a b c d e f",
)
INSIDE = np.array(  # [rad] and [m]; readings of the second row lie outside where they are counted otherwise
    [[-1.9, 6.2, -12.9, -3.1, 0.5], [-0.3, 0.1, 12.9, 3.1, -0.5], [0.2, 3.3, 0.0, 0.0, 0.0], [1.9, 3.2, 7.0, 1.0, 0.9]]
)


def turned_table(folder: Path, q: Matrix, unit: str) -> Table:
    names = [*(f"{name}{' [deg]' if unit == 'deg' else ''}" for name in ("half", "positive", "several", "endless")), "slide"]
    cells = q / np.array([DEG if unit == "deg" else 1.0] * 4 + [1.0])
    (folder / "q.csv").write_text("\n".join([",".join(names), *(",".join(f"{cell:.12g}" for cell in row) for row in cells)]))
    return read_table(folder / "q.csv", "a column a joint", "one row a pose")


def turned_robot() -> Robot:
    seen = Instruments((Target("f", "f"),), "a", placed=True)
    return robot_of(TURNS).seen_by(seen, ())


@pytest.mark.parametrize("unit", ["rad", "deg"])
def test_a_reading_a_full_turn_away_is_taken_inside(unit: str, tmp_path: Path) -> None:
    """From 0 to 360 and from -180 to 180 deg, in either unit, give the same positions; one line says how many cells were moved."""
    counted = INSIDE + 2 * np.pi * np.array([[1, -1, 0, 0, 0], [1, 0, 0, 0, 0], [0, -1, 0, 0, 0], [0, -1, 0, 0, 0]])
    table, robot = turned_table(tmp_path, counted, unit), turned_robot()
    np.testing.assert_allclose(JointColumns(table, robot).positions, INSIDE, atol=1e-10)
    moved = "5 of 20 cells are a full turn or more outside the limits of half, positive and taken for the same place inside"
    assert list(JointColumns(table, robot).warnings()) == [f"{tmp_path}/q.csv:2: column 'half': {moved}"]


def test_the_nearest_turn_inside_is_taken(tmp_path: Path) -> None:
    """Limits that allow several turns leave what is inside them, and take what is outside to the nearest place inside."""
    several = np.array([[0, 3, -12.9, 0, 0], [0, 3, 12.9, 0, 0], [0, 3, 13.1, 0, 0], [0, 3, -13.1 - 2 * np.pi, 0, 0.0]])
    q = JointColumns(turned_table(tmp_path, several, "deg"), turned_robot()).positions
    np.testing.assert_allclose(q[:, 2], [-12.9, 12.9, 13.1 - 2 * np.pi, -13.1 + 2 * np.pi], atol=1e-10)


def test_continuous_and_sliding_joints_stay_where_they_are(tmp_path: Path) -> None:
    """A continuous joint keeps its turns, and what a slide reads has none."""
    q = np.array([[0, 3, 0, 12.5, 0.5], [0, 3, 0, -12.5, 0.5], [0, 3, 0, 40.0, 0.5 + 2 * np.pi], [0, 3, 0, 0, 0.0]])
    table, robot = turned_table(tmp_path, q, "deg"), turned_robot()
    np.testing.assert_allclose(JointColumns(table, robot).positions, q, atol=1e-10)
    said = list(JointColumns(table, robot).warnings())
    assert [line.split("'")[1] for line in said] == ["endless", "slide"]
    assert "outside the joint's limits -720 to 720 deg" in said[0]


@pytest.mark.parametrize("seed", range(20))
def test_degrees_under_radians_are_not_taken_for_turns(seed: int, tmp_path: Path) -> None:
    """Degrees within the limits, under a header in radians, are refused as before, though some of them lie a turn or several away."""
    rng = np.random.default_rng(seed)
    degrees = rng.uniform([-110, 5, -700, -170, -1], [110, 350, 700, 170, 1], (40, 5))
    with pytest.raises(MeasurementError, match=r"cells lie outside the limits .* and inside them as degrees; write '\w+ \[deg\]'"):
        list(JointColumns(turned_table(tmp_path, degrees, "rad"), turned_robot()).warnings())


def test_a_place_outside_all_turns_is_said_in_the_header_s_unit(tmp_path: Path) -> None:
    """What no turn brings inside stays, and is told beside those that were moved; a header in degrees is not advised to be one."""
    q = INSIDE + np.array([[0.5 - 2 * np.pi, 0, 0, 0, 0]] + [[0, 0, 0, 0, 0]] * 2 + [[1.1 - 0 * np.pi, 0, 0, 0, 0]])
    q[1:3, 0] += 2 * np.pi
    table, robot = turned_table(tmp_path, q, "deg"), turned_robot()
    np.testing.assert_allclose(JointColumns(table, robot).positions[:, 0], [-1.4, -0.3, 0.2, 3.0], atol=1e-10)
    said = list(JointColumns(table, robot).warnings())
    assert said[0] == f"{tmp_path}/q.csv:5: column 'half': a cell lies outside the joint's limits -114.6 to 114.6 deg"
    assert said[1].endswith("3 of 20 cells are a full turn or more outside the limits of half and taken for the same place inside")


def test_joints_without_room_are_told_in_one_line(tmp_path: Path) -> None:
    """Limits that are the same are said once for all joints that move all the same, and not for one that stands there."""
    text = TURNS.replace('lower="-2" upper="2"', 'lower="0" upper="0"').replace('lower="0" upper="6.3"', 'lower="1" upper="1"')
    text = text.replace('lower="-13" upper="13"', 'lower="0" upper="0"')
    robot = robot_of(text).seen_by(Instruments((Target("f", "f"),), "a", placed=True), ())
    q = INSIDE * [1, 1, 0, 1, 1]
    table = turned_table(tmp_path, q, "rad")
    np.testing.assert_allclose(JointColumns(table, robot).positions, q, atol=1e-10)
    (said,) = JointColumns(table, robot).warnings()
    assert said.startswith(
        "small.urdf: lower and upper limit of half, positive are the same, which leaves no workspace; their positions are"
    )


BAD = {
    "missing": ("turn,lift,slid\n0,0,0", ":1: column 'slide': is missing; expected a column for each joint on the way; did you mean"),
    "word": ("turn,lift,slide\n0,up,0", ":2: column 'lift': 'up' is not a number; expected the joint's position in rad (or say [deg]"),
    "far away": ("turn,lift,slide\n0,1e300,0", ":2: column 'lift': '1e300' is beyond 1e+06; expected the joint's position in rad"),
    "degrees": ("turn,lift,slide\n0,0,0\n30,0,0\n20,0,0", ":3: column 'turn': 2 of 3 cells lie outside the limits -0.6 to 0.6 rad and"),
}


@pytest.mark.parametrize("case", BAD)
def test_what_no_joint_can_be_is_refused(case: str, tmp_path: Path) -> None:
    """A missing column, a word, a number beyond all robots, and degrees under a radian header."""
    text, message = BAD[case]
    with pytest.raises(MeasurementError) as error:
        positions(tmp_path, text)
    assert str(error.value).startswith(f"{tmp_path}/q.csv{message}")
