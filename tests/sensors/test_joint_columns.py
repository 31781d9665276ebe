"""Joint columns of any table: the same numbers and the same refusals, whether anything was measured or not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.support.small_robot import URDF, robot_of
from urdfcal.base.errors import MeasurementError
from urdfcal.base.geometry import Matrix
from urdfcal.base.tables import read_table
from urdfcal.sensors.joint_columns import joint_positions, limit_warnings


def positions(folder: Path, text: str) -> tuple[Matrix, list[str]]:
    """Positions in a table, and what is to be said of them."""
    (folder / "q.csv").write_text(text)
    table, robot = read_table(folder / "q.csv", "a column a joint", "one row a pose"), robot_of(URDF)
    q = joint_positions(table, robot)
    return q, list(limit_warnings(table, robot, q))


def test_positions_are_in_the_order_of_the_arm_and_in_si(tmp_path: Path) -> None:
    """Order of the columns, units and other columns change nothing."""
    q, warnings = positions(tmp_path, "slide [mm];image;turn [deg];lift\n150;a.png;18;-0,2\n")
    np.testing.assert_allclose(q, [[np.pi / 10, -0.2, 0.15]], rtol=1e-15)
    assert warnings == []


def test_a_cell_outside_its_limits_is_said(tmp_path: Path) -> None:
    """One line names the first such row, how many there are, and the limits."""
    _, warnings = positions(tmp_path, "turn,lift,slide\n0,0,0\n0,0,0.4\n")
    assert warnings == [f"{tmp_path}/q.csv:3: column 'slide': a cell lies outside the joint's limits 0 to 0.3 m"]


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
