# ruff: noqa: E501
"""Measurements as people have them: names, units and layouts that are not ours."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.support.small_robot import URDF, robot_of
from urdfcal.base.errors import MeasurementError
from urdfcal.robot.robot import Robot
from urdfcal.sensors.measurements import Measurements
from urdfcal.sensors.measurements_csv import read_measurements, read_named_table
from urdfcal.sensors.overview import overview, told

Q = np.array([[0.1, -0.2, 0.15], [0.2, 0.1, 0.05], [-0.3, 0.25, 0.1]])
P = np.array([[1.25, -0.5, 0.75], [1.0, 0.25, 0.5], [0.75, 0.5, -0.25]])


@pytest.fixture(scope="module")
def robot() -> Robot:
    """The small robot: turn, lift, slide; a link tool, and a screen that nobody needs here."""
    return robot_of(URDF)


def text(head: str, *, separator: str = ",", degrees: bool = False, mm: bool = False, index: bool = False, behind: str = "") -> str:
    """The poses under some header."""
    lines = [head]
    for number, (q, p) in enumerate(zip(Q, P, strict=True)):
        joints = [f"{value:.12g}" for value in (*(np.degrees(q[:2]) if degrees else q[:2]), q[2])]
        points = [f"{value:.12g}" for value in (p * 1000 if mm else p)]
        lines.append(separator.join([*([str(number)] if index else []), *joints, *points]) + behind)
    return "\n".join(lines) + "\n"


HEAD = "turn,lift,slide,tool.x,tool.y,tool.z"
# file, --target, what is said of it
AS_PEOPLE_HAVE_IT: dict[str, tuple[str, str | None, str]] = {
    "ours": (text(HEAD), None, ""),
    "x y z": (text("turn,lift,slide,x,y,z"), "tool", "'x' as 'tool.x', 'y' as 'tool.y'"),
    "X (mm)": (text("turn,lift,slide,X (mm),Y (mm),Z (mm)", mm=True), "tool", "'X' as 'tool.x'"),
    "x_mm": (text("turn,lift,slide,x_mm,y_mm,z_mm", mm=True), "tool", "'x_mm' as 'tool.x [mm]'"),
    "tool_x": (text("turn,lift,slide,tool_x,tool_y,tool_z"), None, "'tool_x' as 'tool.x'"),
    "Tool X": (text("turn,lift,slide,Tool X,Tool Y,Tool Z"), None, "'Tool X' as 'tool.x'"),
    "tool_x_mm": (text("turn,lift,slide,tool_x_mm,tool_y_mm,tool_z_mm", mm=True), None, "'tool_x_mm' as 'tool.x [mm]'"),
    "title": (text(f"Trial 3\n\nexported, by hand\n{HEAD}"), None, ":4: taken for the header; what stands above it"),
    "spaces": (text("turn lift  slide tool.x tool.y tool.z", separator="   "), None, ""),
    "spaces and units": (text("turn [deg] lift (deg) slide tool.x tool.y tool.z", separator=" ", degrees=True), None, ""),
    "(mm)": (text("turn,lift,slide,tool.x (mm),tool.y(mm),tool.z (MM)", mm=True), None, ""),
    "joint_deg": (text("turn_deg,lift_deg,slide,tool.x,tool.y,tool.z", degrees=True), None, "'turn_deg' as 'turn [deg]'"),
    "[°]": (text("turn [°],lift [°],slide,tool.x,tool.y,tool.z", degrees=True), None, ""),
    "[Deg]": (text("turn [Deg],lift [DEG],slide,tool.x,tool.y,tool.z", degrees=True), None, ""),
    "[degrees]": (text("turn [degrees],lift [degree],slide [meters],tool.x,tool.y,tool.z", degrees=True), None, ""),
    "[millimeters]": (text("turn,lift,slide,tool.x [millimeters],tool.y [Millimetre],tool.z [mm]", mm=True), None, ""),
    "pandas index": (text(f",{HEAD}", index=True), None, "taken for an index and not used"),
    "pandas index read again": (text(f"Unnamed: 0,{HEAD}", index=True), None, "taken for an index and not used"),
    "trailing cells": (text(f"{HEAD},,,,", behind=",,,,") + ",,,,,,,,,\n,,,,,,,,,\n", None, ""),
    "trailing cells, no title": (text(HEAD, behind=",,,,"), None, ""),
    "empty column": (text("turn,lift,slide,,tool.x,tool.y,tool.z").replace("0.15,", "0.15,,").replace("0.05,1", "0.05,,1").replace("0.1,0.75", "0.1,,0.75"), None, ""),
    "row of units": (text(f"{HEAD}\ndeg,[deg],m,mm,mm,mm", degrees=True, mm=True), None, ":2: taken for a row of units"),
    "upper-case joints": (text("TURN,Lift,SLIDE,tool.x,tool.y,tool.z"), None, "'TURN' as 'turn', 'Lift' as 'lift', 'SLIDE' as 'slide'"),
    "recorded positions": (text("turn.position,lift.position,/joint_states/slide/position,tool.x,tool.y,tool.z"), None, "as 'turn'"),
    "LeRobot in degrees": (text("turn.pos [deg],lift.pos [deg],slide,tool.x,tool.y,tool.z", degrees=True), None, "'turn.pos' as 'turn'"),
    "decimal commas between spaces": (text("turn lift slide tool.x tool.y tool.z", separator=" ").replace("0.", "0,"), None, ""),
}  # fmt: skip


def read(robot: Robot, folder: Path, content: str, **options: str | None) -> Measurements:
    path = folder / "m.csv"
    path.write_text(content, encoding="utf-8")
    return read_measurements(path, robot, **options)


@pytest.mark.parametrize("case", AS_PEOPLE_HAVE_IT)
def test_a_file_as_people_have_it_is_read_as_ours(case: str, robot: Robot, tmp_path: Path) -> None:
    """Positions and points are those that were written, and what was guessed is said, else nothing."""
    content, target, said = AS_PEOPLE_HAVE_IT[case]
    data = read(robot, tmp_path, content, target=target)
    np.testing.assert_allclose(data.q, Q, atol=1e-12)
    np.testing.assert_allclose(data.readings[0].values, P, atol=1e-12)
    assert said in "\n".join(data.warnings)
    assert bool(data.warnings) == bool(said)


def test_a_set_in_any_case_is_one(robot: Robot, tmp_path: Path) -> None:
    """`Set` marks test poses as `set` does, and that is said."""
    data = read(
        robot, tmp_path, text(f"Set,{HEAD}").replace("\n0.1", "\nfit,0.1").replace("\n0.2", "\ntest,0.2").replace("\n-0.3", "\n,-0.3")
    )
    assert data.sets.tolist() == ["fit", "test", "fit"]
    assert "'Set' as 'set'" in data.warnings[0]


def test_nan_is_an_empty_cell(robot: Robot, tmp_path: Path) -> None:
    """A point that a program wrote as NaN was not seen; the others were."""
    data = read(robot, tmp_path, text(HEAD).replace("1,0.25,0.5", "NaN,nan,NAN"))
    assert data.readings[0].seen.tolist() == [True, False, True]


def test_a_workbook_is_read_as_a_table(robot: Robot, tmp_path: Path) -> None:
    """The first sheet of an .xlsx gives the same numbers, with a word where there are others; its rows are the lines of messages."""
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    for row in (["Trial 3"], HEAD.split(","), *(list(map(float, (*q, *p))) for q, p in zip(Q, P, strict=True)), [None] * 6):
        book.active.append(row)
    book.create_sheet("notes")
    book.save(tmp_path / "m.xlsx")
    data = read_measurements(tmp_path / "m.xlsx", robot)
    np.testing.assert_array_equal(data.q, Q)
    np.testing.assert_array_equal(data.readings[0].values, P)
    assert data.lines is not None
    assert data.lines.tolist() == [3, 4, 5]
    assert "of the workbook's sheets the first one, 'Sheet', is read" in data.warnings[0]


def test_a_workbook_without_its_reader_says_what_to_install(robot: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One line names the extra, and the way without it."""
    monkeypatch.setitem(sys.modules, "openpyxl", None)
    (tmp_path / "m.xlsx").write_bytes(b"PK\x03\x04...")
    with pytest.raises(MeasurementError, match=r"save it as CSV, or install what reads it: pip install 'urdfcal\[xlsx\]'"):
        read_measurements(tmp_path / "m.xlsx", robot)


REFUSED: dict[str, tuple[str, str | None, str]] = {
    "x y z of nobody": (
        text("turn,lift,slide,x,y,z"),
        None,
        ":1: column 'x': the file looks like points (x, y, z); which link are they of? name it with --target LINK",
    ),
    "two joints left out": (
        text("turn,a,b,tool.x,tool.y,tool.z"),
        None,
        ":1: column 'lift': is missing, and so is 'slide'; expected a column for each joint on the way",
    ),
    "hint in use": (text("turn,lift,lif,tool.x,tool.y,tool.z"), None, "column 'slide': is missing; expected a column for each joint on the way"),
    "mistyped joint": (text("turn,lift,slyde,tool.x,tool.y,tool.z"), None, "on the way; did you mean 'slyde'?"),
    "mistyped link": (text("turn,lift,slide,tol.x,tol.y,tol.z"), None, "column 'tol.x': no link named 'tol' among 8 links; did you mean 'tool'?"),
    "mistyped lasers": (
        text("turn,lift,slide,laser1.y,laser1.z,laser2.y"),
        None,
        "column 'laser_1.y': is missing, and no other laser has columns; expected <laser>.y and <laser>.z; did you mean 'laser1.y'?",
    ),
    "mistyped half of a spot": (
        text("turn,lift,slide,laser_1.y,laser_l.z,laser2.y"),
        None,
        "column 'laser_1.z': is missing; a spot of laser_1 needs laser_1.y and laser_1.z; did you mean 'laser_l.z'?",
    ),
    "LeRobot without a unit": (
        text("turn.pos,lift.pos,slide,tool.x,tool.y,tool.z"),
        None,
        "column 'turn': is missing, and 'turn.pos' does not say its unit, which LeRobot has as degrees or as -100 to 100",
    ),
    "two units": (text("turn_deg [rad],lift,slide,tool.x,tool.y,tool.z"), None, "its name says deg and its unit [rad]; leave one"),
    "units at odds": (text(f"{HEAD.replace('turn', 'turn [rad]')}\ndeg,deg,m,m,m,m"), None, "the header says [rad] and the row under it deg"),
    "two columns of one meaning": (text("TURN,Turn,lift,slide,tool.x,tool.y"), None, "column 'turn': stands twice"),
    "a robot for a table": (URDF, None, "is XML, as robot descriptions are; expected a table"),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_what_is_ambiguous_is_refused_with_the_way_out(case: str, robot: Robot, tmp_path: Path) -> None:
    """Nothing that can mean two things is guessed: the line names the column and what to write."""
    content, target, message = REFUSED[case]
    with pytest.raises(MeasurementError) as error:
        read(robot, tmp_path, content, target=target)
    assert message in str(error.value)
    if case == "hint in use":
        assert "did you mean" not in str(error.value)


def test_readings_that_are_ours_keep_others_unused(robot: Robot, tmp_path: Path) -> None:
    """Where a file has readings in our names, columns that were not used before are not used now, and named as before."""
    data = read(robot, tmp_path, text("turn,lift,slide,tool.x,tool.y,slm_z"))
    assert [reading.target for reading in data.readings] == ["tool"]
    assert "'slm_z' means nothing here and is not used" in data.warnings[0]


WITHOUT_LASERS = URDF.replace('"laser_', '"beam_').replace('"screen"', '"base_link"')
NO_SCREEN = URDF.replace('"screen"', '"base_link"')
LOST: dict[str, tuple[str, str]] = {
    "laser spots": (text("turn,lift,slide,laser_1.y,laser_1.z,a"), "the file looks like laser spots (.y and .z), and the robot has no link 'laser_1'"),
    "points of no link": (
        text("turn,lift,slide,marker_x_mm,marker_y_mm,marker_z_mm"),
        "the file looks like points of 'marker', and there is no link named 'marker' among 8 links",
    ),
    "points of a mistyped link": (text("turn,lift,slide,tol_x,tol_y,tol_z"), "among 8 links; did you mean 'tool'?; or name"),
    "joints alone": (text("turn,lift,slide,a,b,c"), "is missing, and so is every other reading: the file has joints alone; expected for example"),
}  # fmt: skip


@pytest.mark.parametrize("case", LOST)
def test_a_robot_without_lasers_is_told_what_its_file_looks_like(case: str, tmp_path: Path) -> None:
    """Nobody who brings no lasers is told of screens: the line says what the file looks like and how to name what was measured."""
    content, message = LOST[case]
    with pytest.raises(MeasurementError) as error:
        read(robot_of(WITHOUT_LASERS), tmp_path, content)
    assert message in str(error.value)


def test_a_robot_with_a_rig_is_told_of_the_link_that_its_file_names(robot: Robot, tmp_path: Path) -> None:
    """Who measures a marker on a robot that stands before a screen, too, is told of the marker, and not of lasers."""
    with pytest.raises(MeasurementError, match="the file looks like points of 'marker', and there is no link named 'marker'"):
        read(robot, tmp_path, text("turn,lift,slide,marker_x,marker_y,marker_z"))


def test_a_calibration_in_the_robots_place_is_told_so(run_cli: Callable[..., tuple[int, str, str]], tmp_path: Path) -> None:
    """`apply` with its arguments swapped is refused by that name, not as broken XML."""
    (tmp_path / "c.yaml").write_text("calibration: 1\n")
    (tmp_path / "small.urdf").write_text(URDF)
    code, out, err = run_cli("apply", "c.yaml", "small.urdf", "-o", "out.urdf")
    assert (code, out) == (2, "")
    assert err == "urdfcal: c.yaml: is YAML where the robot is expected; the robot's URDF or xacro comes first, then other files\n"


def test_swapped_arguments_are_told_so(run_cli: Callable[..., tuple[int, str, str]], tmp_path: Path) -> None:
    """Measurements in the robot's place are refused by that name, not as broken XML."""
    (tmp_path / "m.csv").write_text(text(HEAD))
    (tmp_path / "small.urdf").write_text(URDF)
    code, out, err = run_cli("fit", "m.csv", "small.urdf")
    assert (code, out) == (2, "")
    assert err == "urdfcal: m.csv: is a table where the robot is expected; the robot's URDF or xacro comes first, then the measurements\n"


def test_lasers_without_a_screen_are_no_matter_for_a_file_without_spots(tmp_path: Path) -> None:
    """A robot that carries a module, but stands before no screen, is told of its file's columns, and not of a screen."""
    with pytest.raises(MeasurementError, match="the file has joints alone; expected for example"):
        read(robot_of(NO_SCREEN), tmp_path, text("turn,lift,slide,a,b,c"))


def test_a_reading_in_part_is_told_so(robot: Robot, tmp_path: Path) -> None:
    """A point that lacks one coordinate counts as one in part, and the line of the first is named; a column that nobody has is none."""
    (tmp_path / "m.csv").write_text(text(HEAD).replace("1,0.25,0.5", "1,NaN,0.5"))
    data = read_measurements(tmp_path / "m.csv", robot)
    found = overview(read_named_table(tmp_path / "m.csv", robot), robot.seen_by(data.instruments, ()), data)
    assert told([found.readings[0]]) == "3 points, 1 in part"
    assert "1 of 3 points of tool lacks a coordinate, in line 3; what else was read there is used" in set(found.missing())
    data = read(robot, tmp_path, text("turn,lift,slide,tool.x,tool.y,tool.zz"))
    found = overview(read_named_table(tmp_path / "m.csv", robot), robot.seen_by(data.instruments, ()), data)
    assert told([found.readings[0]]) == "3 points"
    assert data.warnings[0].endswith("column 'tool.zz' means nothing here and is not used; did you mean 'tool.z'?")


def test_columns_may_stand_in_any_order(robot: Robot, tmp_path: Path) -> None:
    """Positions follow the header's names, not their places in it."""
    names = HEAD.split(",")
    order = [4, 2, 0, 5, 1, 3]
    cells = np.hstack([Q, P])[:, order]
    rows = [",".join(names[place] for place in order), *(",".join(map(str, row)) for row in cells.tolist())]
    data = read(robot, tmp_path, "\n".join(rows))
    np.testing.assert_array_equal(data.q, Q)
    np.testing.assert_array_equal(data.readings[0].values, P)
