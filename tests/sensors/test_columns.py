"""Columns of targets in measurements.csv: read, written, read again; and what is refused with which words."""

from __future__ import annotations

import os
import shlex
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tests.conftest import CliResult
from tests.support.sensor_cases import CASES, NOISE, robot_named, setup_of
from tests.support.small_robot import URDF, robot_of
from urdfcal.base.rotations import quaternions_of
from urdfcal.robot.robot import Robot
from urdfcal.sensors.columns import figaroh_name, lost_column, reading_columns, refusal
from urdfcal.sensors.measurements import Measurements
from urdfcal.sensors.measurements_csv import read_measurements, write_measurements
from urdfcal.simulation.readings import simulate_readings

JOINTS = "turn,lift,slide"
ROWS = ("0.1,-0.2,0.1", "0.2,0.1,0.2", "-0.3,0.4,0.05", "0.3,-0.1,0.15")
POINTS = ("1,2,3", "1.1,2,3", "1,2.2,3", "1.1,2,3.1")
UPRIGHT = ("0,0,0,1",) * 4
LABELS = ("a", "a", "b", "b")


def table(head: str, *cells: str) -> str:
    return "\n".join([f"{JOINTS},{head}", *(f"{row},{cell}" for row, cell in zip(ROWS, cells, strict=False))]) + "\n"


def read(folder: Path, text: str, **options: str) -> Measurements:
    (folder / "m.csv").write_text(text)
    return read_measurements(folder / "m.csv", robot_of(URDF), **options)


@pytest.mark.parametrize("name", CASES)
def test_what_was_written_comes_back(name: str, robots: dict[str, Robot], rng: np.random.Generator, tmp_path: Path) -> None:
    """Every kind of reading, with empty cells, stated sigmas, sessions and sets, is read as it was written."""
    case = CASES[name]
    setup = setup_of(case, robots, rng)
    data = simulate_readings(setup, 12, rng, NOISE)
    readings = list(data.readings)
    stated = np.where(np.arange(12) % 2, 1e-3, np.nan)
    for index, own in enumerate(readings):
        if own.sensor == "point":
            values = own.values.copy()
            values[3], values[4, 1] = np.nan, np.nan
            readings[index] = replace(own, values=values, sigma=stated)
    sets = np.where(np.arange(12) < 9, "fit", "test")
    data = replace(data, readings=tuple(readings), sets=sets, poses=np.array([f"p {number}" for number in range(12)]))
    write_measurements(tmp_path / "m.csv", data, ["simulated"])
    back = read_measurements(tmp_path / "m.csv", robot_named(case, robots), reference=case.reference)
    assert back.warnings == ()
    assert (back.joints, back.lasers, back.instruments) == (data.joints, data.lasers, replace(data.instruments, reference=case.reference))
    for field in ("q", "spots"):
        np.testing.assert_allclose(getattr(back, field), getattr(data, field), rtol=1e-11)
    for field in ("poses", "sets", "sessions"):
        assert getattr(back, field).tolist() == getattr(data, field).tolist()
    assert [(own.sensor, own.target, own.link) for own in back.readings] == [(own.sensor, own.target, own.link) for own in data.readings]
    for actual, desired in zip(back.readings, data.readings, strict=True):
        np.testing.assert_allclose(actual.values, desired.values, atol=1e-11)
        assert actual.labels.tolist() == desired.labels.tolist()
        np.testing.assert_array_equal(actual.sigma, desired.sigma)


def test_units_and_orientations_mean_the_same_however_they_are_written(tmp_path: Path) -> None:
    """Millimetres and degrees in the header, roll-pitch-yaw or a quaternion of either sign: one reading."""
    turn = Rotation.from_euler("xyz", [10, 20, -30], degrees=True)
    quaternion = ",".join(f"{number:.15g}" for number in turn.as_quat())
    opposite = ",".join(f"{-number:.15g}" for number in turn.as_quat())
    radians = ",".join(f"{number:.15g}" for number in np.radians([10, 20, -30]))
    spellings = [
        table("tool.x,tool.y,tool.z,tool.qx,tool.qy,tool.qz,tool.qw", f"0.1,-0.2,0.3,{quaternion}"),
        table("tool.x [mm],tool.y [mm],tool.z,tool.qx,tool.qy,tool.qz,tool.qw", f"100,-200,0.3,{opposite}"),
        table("tool.x,tool.y [mm],tool.z,tool.roll [deg],tool.pitch [deg],tool.yaw [deg]", "0.1,-200,0.3,10,20,-30"),
        table("tool.x,tool.y,tool.z,tool.roll,tool.pitch [rad],tool.yaw", f"0.1,-0.2,0.3,{radians}"),
        table("tool.yaw [deg],tool.z,tool.roll [deg],tool.x,tool.pitch [deg],tool.y", "-30,0.3,10,0.1,20,-0.2"),
    ]
    for text in spellings:
        data = read(tmp_path, text)
        by_kind = {own.sensor: own for own in data.readings}
        np.testing.assert_allclose(by_kind["point"].values, [[0.1, -0.2, 0.3]], atol=1e-15)
        np.testing.assert_allclose(Rotation.from_quat(by_kind["orientation"].values).as_matrix(), [turn.as_matrix()], atol=1e-14)
    assert read(tmp_path, table("tool.distance [mm]", "1500")).readings[0].values[0, 0] == pytest.approx(1.5)


def test_quaternions_are_normalised(tmp_path: Path) -> None:
    """Rounding of the file is taken out; a length that is off by more is no rounding (see below)."""
    data = read(tmp_path, table("tool.qx,tool.qy,tool.qz,tool.qw", "0.5,0.5,0.5,0.5003"))
    assert np.linalg.norm(data.readings[0].values) == pytest.approx(1.0, abs=1e-15)


def test_angles_about_fixed_axes_are_scipys() -> None:
    """Roll, pitch and yaw are about fixed axes x, y, z, also at pitch 90 deg; nothing read stays nothing."""
    angles = np.vstack([np.random.default_rng(0).uniform(-4, 4, (50, 3)), [0.3, np.pi / 2, -0.2]])
    np.testing.assert_allclose(
        Rotation.from_quat(quaternions_of(angles)).as_matrix(), Rotation.from_euler("xyz", angles).as_matrix(), atol=1e-14
    )
    assert np.isnan(quaternions_of(np.full((2, 3), np.nan))).all()


def test_figarohs_columns_are_read_as_they_are(tmp_path: Path) -> None:
    """x1, y1, z1, phix1, phiy1, phiz1 belong to the link that is named, those of further markers to labels."""
    text = table("x1,y1,z1,phix1,phiy1,phiz1,x2,y2,z2", "1,2,3,0.1,0.2,0.3,4,5,6")
    data = read(tmp_path, text, target="tool")
    assert [(own.sensor, own.target, own.link) for own in data.readings] == [
        ("point", "tool", "tool"),
        ("orientation", "tool", "tool"),
        ("point", "tool:2", "tool"),
    ]
    np.testing.assert_allclose(Rotation.from_quat(data.readings[1].values).as_euler("xyz"), [[0.1, 0.2, 0.3]], atol=1e-14)
    np.testing.assert_allclose(read(tmp_path, table("x1 [mm]", "5"), target="tool").readings[0].values[0, 0], 0.005)
    assert [figaroh_name(cell, "hand") for cell in ("x1", " phiz3 ", "x", "x1y", "phi1", "joint1")] == [
        "hand.x",
        "hand:3.yaw",
        "",
        "",
        "",
        "",
    ]


def test_links_and_labels_are_told_apart(tmp_path: Path) -> None:
    """Several targets on one link, links with a label, lasers with x beside y and z, and sigmas of nothing."""
    robot = robot_of(URDF)
    names = ["tool.x", "tool:a.x", "tool:b:c.x", "slm.distance", "laser_1.y", "laser_1.z", "nobody.x", "tool.w", "upper.sigma", "turn"]
    found = reading_columns(names, robot, ("laser_1", "laser_2"))
    assert [(column.target, column.link, column.sensor) for column in found] == [
        ("tool", "tool", "point"),
        ("tool:a", "tool", "point"),
        ("slm", "slm", "distance"),
        ("laser_1", "laser_1", "spot"),
        ("laser_1", "laser_1", "spot"),
    ]
    data = read(tmp_path, table("laser_1.x,laser_1.y,laser_1.z", *POINTS))
    assert (data.lasers, [own.target for own in data.readings]) == ((), ["laser_1"])


HEADERS = {
    "two orientations": (
        ["tool.qx", "tool.qy", "tool.qz", "tool.qw", "tool.roll"],
        {},
        ("tool.roll", "the orientation is in 'tool.qx', too; leave one of the two out"),
    ),
    "unit of a label": (["tool.socket"], {"tool.socket": "mm"}, ("tool.socket", "the unit 'mm' of a label means nothing; expected")),
    "empty label": (["tool:.x"], {}, ("tool:.x", "the label behind 'tool:' is empty; expected tool.x, or a label")),
    "fine": (["tool.x", "tool:a.plane", "tool.qx", "tool.qy"], {"tool.x": "mm"}, None),
}


@pytest.mark.parametrize("case", HEADERS)
def test_columns_that_cannot_be_taken_are_named(case: str) -> None:
    """The first such column, and the way out."""
    names, units, expected = HEADERS[case]
    found = refusal(reading_columns(names, robot_of(URDF), ()), units)
    if expected is None:
        assert found is None
    else:
        assert found is not None
        assert found[0] == expected[0]
        assert found[1].startswith(expected[1])


def test_a_header_that_measures_nothing_is_explained() -> None:
    """A misspelt link gets its nearest name, an unknown ending the endings that there are; joints are no such columns."""
    robot = robot_of(URDF)
    assert lost_column(["turn", "tol.x"], robot) == ("tol.x", "no link named 'tol' among 8 links; did you mean 'tool'?")
    assert lost_column(["turn", "tol:a.socket"], robot)[0] == "tol:a.socket"  # type: ignore[index]
    name, words = lost_column(["turn", "tool.X"], robot) or ("", "")
    assert (name, words[:49]) == ("tool.X", "the ending '.X' means nothing; expected one of .x")
    assert lost_column(["turn", "lift", "pose", "a.b", "no.unit"], robot) is None


BAD = {
    "half a quaternion": (
        table("tool.qx,tool.qy,tool.qz", *POINTS),
        "m.csv:1: column 'tool.qw': is missing; an orientation needs qx, qy, qz, qw",
    ),
    "degrees under a radian header": (
        table("tool.roll,tool.pitch,tool.yaw", "0.5,0.2,-30.5"),
        "m.csv:2: column 'tool.yaw': '-30.5' lies beyond 2 pi rad (1 of 1 cells do), expected radians; write 'tool.yaw [deg]'",
    ),
    "degrees of an inclinometer under a radian header": (
        table("tool.incl_x [rad],tool.incl_y", "12,0.1"),
        "m.csv:2: column 'tool.incl_x': '12' lies beyond 2 pi rad (1 of 1 cells do), expected radians; write 'tool.incl_x [deg]'",
    ),
    "half of roll, pitch, yaw": (table("tool.roll,tool.yaw", "0,0"), "m.csv:1: column 'tool.pitch': is missing; an orientation needs roll"),
    "orientation cell": (
        table("tool.qx,tool.qy,tool.qz,tool.qw", *UPRIGHT[:2], ",0,0,1"),
        "m.csv:4: column 'tool.qx': the cell is empty and others of this orientation are not; leave all of them empty, or none",
    ),
    "quaternion": (
        table("tool.qx,tool.qy,tool.qz,tool.qw", *UPRIGHT[:2], "0,0,0.5,1"),
        "m.csv:4: column 'tool.qx': the quaternion has length 1.118, expected 1 (x, y, z, w)",
    ),
    "quaternion of zeros": (table("tool.qx,tool.qy,tool.qz,tool.qw", "0,0,0,0"), "m.csv:2: column 'tool.qx': the quaternion has length 0"),
    "unit of a quaternion": (
        table("tool.qx [rad],tool.qy,tool.qz,tool.qw", *UPRIGHT),
        "m.csv:1: column 'tool.qx': unit 'rad' is not understood",
    ),
    "angle for a length": (
        table("tool.x [deg],tool.y,tool.z", *POINTS),
        "m.csv:1: column 'tool.x': unit 'deg' is not understood, expected m or mm",
    ),
    "length for an angle": (
        table("tool.roll [mm],tool.pitch,tool.yaw", "0,0,0"),
        "column 'tool.roll': unit 'mm' is not understood, expected rad or deg",
    ),
    "inches": (table("tool.distance [in]", "1"), "m.csv:1: column 'tool.distance': unit 'in' is not understood, expected m or mm"),
    "no number": (
        table("tool.x,tool.y,tool.z", "1,2,3", "1,n/a,3"),
        "m.csv:3: column 'tool.y': 'n/a' is not a number; leave the cell empty if it was not read",
    ),
    "infinite": (table("tool.x,tool.y,tool.z", "1,inf,3"), "m.csv:2: column 'tool.y': 'inf' is not finite; leave the cell empty"),
    "far away": (table("tool.distance", "1e300"), "m.csv:2: column 'tool.distance': '1e300' is beyond 1e+06"),
    "missing joint": (
        table("tool.x,tool.y,tool.z", *POINTS).replace("lift", "left"),
        "m.csv:1: column 'lift': is missing; expected a column for each joint on the way; did you mean 'left'?",
    ),
    "the reference itself": (
        table("screen.x,screen.y,screen.z", *POINTS),
        "small.urdf: no moving joint between the reference 'screen' and the target 'screen'",
    ),
    "on the reference's body": (
        table("base.x,base.y,base.z", *POINTS),
        "no moving joint between the reference 'screen' and the target 'base'",
    ),
    "all cells empty": (
        table("tool.x,tool.y,tool.z", ",,", ",,"),
        "m.csv:2: column 'tool.x': every reading is empty; expected at least one",
    ),
    "all labels empty": (
        table("tool.socket", "", ""),
        "m.csv:2: column 'tool.socket': every reading is empty; expected at least one that was seen",
    ),
    "two touches": (
        table("tool.plane", *LABELS),
        "m.csv:2: plane 'a' is touched twice, expected three times or more; touch it at more poses",
    ),
    "one touch each": (table("tool.socket", "a", "b", "c"), "m.csv:2: socket 'a' is touched once, and so is every other; poses that touch"),
    "sigma": (table("tool.x,tool.sigma", "1,-1"), "m.csv:2: column 'tool.sigma': '-1' is not above 1e-12 m; expected a standard deviation"),
    "unit of a sigma": (
        table("tool.x,tool.sigma [deg]", "1,1"),
        "m.csv:1: column 'tool.sigma': unit 'deg' is not understood, expected m or mm",
    ),
    "column twice": (table("tool.x,tool.x", "1,1"), "m.csv:1: column 'tool.x': stands twice, in cells 4 and 5"),
    "figaroh without a link": (
        table("x1,y1,z1", *POINTS),
        "m.csv:1: column 'x1': which link is it measured on? name it with --target LINK",
    ),
    "short row": (table("tool.x,tool.y,tool.z", "1,2,3", "1,2"), "m.csv:3: the row has 5 cells, expected 6 as in the header"),
    "no such reference": (table("tool.x", "1", "2"), "no link named 'tol' among 8 links; did you mean 'tool'?", "--reference tol"),
    "socket pattern": (table("tool.socket", *LABELS), "sockets.distances_mm: 'a' is not two sockets, such as", "--rig a.yaml"),
    "socket pattern of no socket": (
        table("tool.socket", *LABELS),
        "sockets.distances_mm: 'a - c' means no two of the sockets a, b",
        "--rig ac.yaml",
    ),
    "socket length": (
        table("tool.socket", *LABELS),
        "rig.yaml:1: entry 'sockets.distances_mm.a - b': Input should be greater than",
        "--rig rig.yaml",
    ),
}
BAD |= {
    "unknown link": (
        table("tol.x,tol.y,tol.z", *POINTS),
        "m.csv:1: column 'tol.x': no link named 'tol' among 8 links; did you mean 'tool'?",
    ),
    "unknown ending": (table("tool.k", "1"), "m.csv:1: column 'tool.k': the ending '.k' means nothing; expected one of .x, .y"),
    "two orientations": (
        table("tool.qx,tool.qy,tool.qz,tool.qw,tool.roll,tool.pitch,tool.yaw", "0,0,0,1,0,0,0"),
        "m.csv:1: column 'tool.roll': the orientation is in 'tool.qx', too; leave one of the two out",
    ),
    "unit of a label": (table("tool.socket [mm]", *LABELS), "m.csv:1: column 'tool.socket': the unit 'mm' of a label means nothing"),
    "empty label": (table("tool:.x", "1"), "m.csv:1: column 'tool:.x': the label behind 'tool:' is empty; expected tool.x, or a label"),
    "negative distance": (table("tool.distance", "1", "-2"), "m.csv:3: column 'tool.distance': -2 m is below zero; expected a distance"),
    "name of the module": (
        table("slm.distance,laser_1.y,laser_1.z", *POINTS),
        "'slm' is the name of a mount and of a target, whose parameters could not be told apart; give the target a label, 'slm:NAME'",
    ),
}
RIGS = {
    "a.yaml": "sockets: {distances_mm: {'a': 50}}\n",
    "ac.yaml": "sockets: {distances_mm: {'a - c': 50}}\n",
    "rig.yaml": "sockets: {distances_mm: {'a - b': 0}}\n",
}


@pytest.mark.parametrize("case", BAD)
def test_bad_columns_are_one_line_and_nothing_is_written(case: str, run_cli: Callable[..., CliResult], tmp_path: Path) -> None:
    """Exit code 2, one line on stderr with file, line, column and the way out; no file made or changed."""
    text, message, *words = BAD[case]
    contents = {"small.urdf": URDF, "m.csv": text} | RIGS
    for name, content in contents.items():
        (tmp_path / name).write_text(content)
    code, out, err = run_cli("fit", "small.urdf", "m.csv", *shlex.split(" ".join(words)))
    assert message in err
    assert (code, out, err.count("\n"), err.startswith("urdfcal: ")) == (2, "", 1, True)
    assert {name: (tmp_path / name).read_text() for name in os.listdir(tmp_path)} == contents
