"""measurements.csv: what is read, what is refused with which words, and that what was written comes back."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from tests.support.small_robot import URDF, robot_of
from urdfcal.base.errors import MeasurementError, ShapeMismatch
from urdfcal.robot.robot import Robot, robot_from
from urdfcal.sensors.measurements import Measurements, spots_measured
from urdfcal.sensors.measurements_csv import read_measurements, write_measurements

HEAD = "turn,lift,slide,laser_1.y,laser_1.z,laser_2.y,laser_2.z"
ROW = "0.1,-0.2,0.15,0.01,0.02,0.03,0.04"
Q, SPOTS = [0.1, -0.2, 0.15], [[0.01, 0.02], [0.03, 0.04]]


@pytest.fixture(scope="module")
def robot() -> Robot:
    return robot_of(URDF)


def read(folder: Path, text: str | bytes, robot: Robot) -> Measurements:
    (folder / "m.csv").write_bytes(text if isinstance(text, bytes) else text.encode())
    return read_measurements(folder / "m.csv", robot)


SAME = {
    "comma": f"{HEAD}\n{ROW}\n",
    "no end of line": f"{HEAD}\n{ROW}",
    "semicolon": f"{HEAD}\n{ROW}".replace(",", ";"),
    "decimal comma": f"{HEAD}\n{ROW}".replace(",", ";").replace("0.", "0,"),
    "decimal comma, units with points": f"{HEAD}\n{ROW}".replace(",", ";").replace("-0.2", "-2,0e-1").replace("0.15", ",15"),
    "tab": f"{HEAD}\n{ROW}".replace(",", "\t"),
    "tab in a comma file": f"{HEAD}\n{ROW}".replace(",", ",\t", 2),
    "CRLF": f"{HEAD}\r\n{ROW}\r\n",
    "CR": f"{HEAD}\r{ROW}\r",
    "byte-order mark": f"\ufeff{HEAD}\n{ROW}\n",
    "comments and blank lines": f"# a\n\n  # b; c, d\n{HEAD}\n#\n   \n{ROW}\n# end",
    "blanks": f"{HEAD}\n{ROW}".replace(",", " ,  "),
    "quotes": "\n".join(",".join(f'"{cell}"' for cell in line.split(",")) for line in (HEAD, ROW)),
    "trailing separators": f"{HEAD},,\n{ROW},,\n",
    "other order": "laser_2.z,slide,turn,laser_1.z,laser_1.y,lift,laser_2.y\n0.04,0.15,0.1,0.02,0.01,-0.2,0.03\n",
    "units": "turn [deg],lift[rad],slide [ mm ],laser_1.y [mm],laser_1.z [m],laser_2.y,laser_2.z\n"
    "5.729577951308232,-0.2,150,10,0.02,0.03,0.04\n",
    "exponents": f"{HEAD}\n1e-1,-2.E-1,+.15,0.01,2e-2,3e-02,0.04\n",
}


@pytest.mark.parametrize("case", SAME)
def test_the_same_pose_is_read_however_it_is_written(case: str, robot: Robot, tmp_path: Path) -> None:
    """Separator, decimal comma, byte-order mark, line ends, comments, quotes, order of columns and units change no number."""
    data = read(tmp_path, SAME[case], robot)
    np.testing.assert_allclose(data.q, [Q], rtol=1e-15)
    np.testing.assert_allclose(data.spots, [SPOTS], rtol=1e-15)
    assert (data.joints, data.lasers, data.warnings) == (("turn", "lift", "slide"), ("laser_1", "laser_2"), ())
    assert (list(data.sets), list(data.poses), list(data.sessions)) == (["fit"], ["1"], [""])
    assert np.isnan(data.sigma).all()


def test_every_optional_column_is_read(robot: Robot, tmp_path: Path) -> None:
    """pose, set, session and <laser>.sigma are read; empty cells of theirs have defaults."""
    text = f"pose,set,session,laser_2.sigma [mm],{HEAD}\nhome,test,monday,2,{ROW}\n,,,,{ROW}\n"
    data = read(tmp_path, text, robot)
    assert [list(column) for column in (data.poses, data.sets, data.sessions)] == [["home", "2"], ["test", "fit"], ["monday", ""]]
    np.testing.assert_array_equal(data.sigma, [[np.nan, 0.002], [np.nan, np.nan]])
    assert data.session_names == ("monday", "")
    fit_set, test_set = data.split()
    assert (list(fit_set.poses), list(test_set.poses), test_set.where(0), fit_set.where(0)) == (
        ["2"],
        ["home"],
        f"{tmp_path}/m.csv:2",
        f"{tmp_path}/m.csv:3",
    )


def test_a_beam_that_was_not_seen_leaves_the_other(robot: Robot, tmp_path: Path) -> None:
    """Two empty cells mean an unseen beam; the pose's other beam counts."""
    data = read(tmp_path, f"{HEAD}\n0,0,0,,,0.3,0.4\n0,0,0,,,,\n0,0,0,0.1,0.2,,\n", robot)
    np.testing.assert_array_equal(data.seen, [[False, True], [False, False], [True, False]])
    np.testing.assert_array_equal(data.spots[0, 1], [0.3, 0.4])


def test_a_laser_without_columns_is_never_seen_and_said_so(robot: Robot, tmp_path: Path) -> None:
    """A laser of the robot that has no columns is a warning."""
    data = read(tmp_path, "turn,lift,slide,laser_2.y,laser_2.z\n0,0,0,0.3,0.4\n", robot)
    np.testing.assert_array_equal(data.seen, [[False, True]])
    assert data.warnings == (f"{tmp_path}/m.csv: laser 'laser_1' of the robot has no columns; it is taken as never seen",)


def test_columns_that_mean_nothing_are_named(robot: Robot, tmp_path: Path) -> None:
    """A column that means nothing is a warning with the nearest name; a joint that is not on the way is none."""
    text = f"# c\n{HEAD},humidity [C],laser_1.sigm,slm_mount\n{ROW},20,1,0\n"
    data = read(tmp_path, text, robot)
    where = f"{tmp_path}/m.csv:2: column"
    assert data.warnings[0].startswith(f"{where} 'humidity' means nothing here and is not used")
    assert data.warnings[1] == f"{where} 'laser_1.sigm' means nothing here and is not used; did you mean 'laser_1.sigma'?"
    assert data.warnings[2].startswith(f"{where} 'slm_mount' means nothing")
    side = '<link name="side"/><joint name="finger" type="continuous"><parent link="tool"/><child link="side"/></joint></robot>'
    assert read(tmp_path, f"{HEAD},finger\n{ROW},0.3\n", robot_of(URDF.replace("</robot>", side))).warnings == ()


def test_mimic_joints_need_no_column(tmp_path: Path) -> None:
    """A joint that mimics another has no column of its own, and may have one that is not used."""
    robot = robot_of(URDF.replace('<axis xyz="0 1 0"/>', '<axis xyz="0 1 0"/><mimic joint="turn" multiplier="2"/>'))
    data = read(tmp_path, "turn,slide,laser_1.y,laser_1.z,laser_2.y,laser_2.z,lift\n0.1,0.15,1,2,3,4,0.2\n", robot)
    assert (data.joints, data.q.tolist(), data.warnings) == (("turn", "slide"), [[0.1, 0.15]], ())


def row(**cells: str) -> str:
    values = dict(zip(HEAD.split(","), ROW.split(","), strict=True))
    return ",".join((values | {name.replace("_y", ".y").replace("_z", ".z"): value for name, value in cells.items()}).values())


def rows(count: int, **cells: str) -> str:
    return f"{HEAD}\n" + "\n".join([row(**cells)] * count)


BAD = {
    "empty file": ("", ": the file has no header line; expected the names of the joints (turn, lift, slide) and of what was measured"),
    "comments alone": ("# a\n\n# b\n", ": the file has no header line"),
    "no rows": (f"\n{HEAD}\n# end\n", ":2: there is a header and no row; expected one row a pose"),
    "joint missing": (
        "turn,slide,laser_1.y,laser_1.z\n0,0,0,0",
        ":1: column 'lift': is missing; expected a column for each joint on the way",
    ),
    "joint misspelt": (
        f"# c\n{HEAD}\n{ROW}".replace("slide", "slid"),
        ":2: column 'slide': is missing; expected a column for each joint on the way; did you mean 'slid'?",
    ),
    "z missing": (
        "turn,lift,slide,laser_1.y\n0,0,0,0",
        ":1: column 'laser_1.z': is missing; a spot of laser_1 needs laser_1.y and laser_1.z",
    ),
    "y missing": ("turn,lift,slide,laser_1.z\n0,0,0,0", ":1: column 'laser_1.y': is missing; a spot of laser_1 needs"),
    "no laser": ("turn,lift,slide\n0,0,0", ":1: column 'laser_1.y': is missing, and no other laser has columns"),
    "column twice": (f"{HEAD},turn\n{ROW},0", ":1: column 'turn': stands twice, in cells 1 and 8"),
    "column twice in other units": (f"{HEAD},turn [deg]\n{ROW},0", ":1: column 'turn': stands twice, in cells 1 and 8"),
    "empty name": (f"{HEAD},,x\n{ROW},0,0", ":1: cell 8 of the header is empty, expected a name"),
    "unit alone": (f"{HEAD},[mm]\n{ROW},0", ":1: column '[mm]': cell 8 of the header is empty, expected a name"),
    "bracket open": (f"{HEAD}\n{ROW}".replace("turn", "turn [deg"), ":1: column 'turn [deg': the unit has no closing bracket"),
    "unit of an angle": (
        f"{HEAD}\n{ROW}".replace("turn", "turn [mm]"),
        ":1: column 'turn': unit 'mm' is not understood, expected rad or deg",
    ),
    "unit of a length": (
        f"{HEAD}\n{ROW}".replace("slide", "slide [cm]"),
        ":1: column 'slide': unit 'cm' is not understood, expected m or mm",
    ),
    "unit of a spot": (
        f"{HEAD}\n{ROW}".replace("laser_2.z", "laser_2.z [px]"),
        ":1: column 'laser_2.z': unit 'px' is not understood, expected m or mm",
    ),
    "empty unit": (f"{HEAD}\n{ROW}".replace("turn", "turn []"), ":1: column 'turn': unit '' is not understood"),
    "short row": (f"{HEAD}\n{ROW}\n0,0,0\n", ":3: the row has 3 cells, expected 7 as in the header"),
    "long row": (f"{HEAD}\n{ROW},1\n", ":2: the row has 8 cells, expected 7 as in the header; a decimal comma needs ; between the cells"),
    "no number": (
        f"{HEAD}\n{row(lift='up')}",
        ":2: column 'lift': 'up' is not a number; expected the joint's position in rad (or say [deg]",
    ),
    "underscore": (f"{HEAD}\n{row(lift='1_0')}", ":2: column 'lift': '1_0' is not a number"),
    "arabic digit": (f"{HEAD}\n" + row(lift="\u0661"), ":2: column 'lift': '\u0661' is not a number"),
    "two points": (f"{HEAD}\n{row(lift='1.234.5')}", ":2: column 'lift': '1.234.5' is not a number"),
    "thousands": (
        f"{HEAD}\n{row(lift='1.234,5')}".replace(",", ";").replace("1.234;5", "1.234,5"),
        ":2: column 'lift': '1.234,5' is not a number",
    ),
    "empty joint": (f"{HEAD}\n{row(slide='')}", ":2: column 'slide': the cell is empty; expected the joint's position in m"),
    "nan joint": (f"{HEAD}\n{ROW}\n{row(turn='NaN')}", ":3: column 'turn': the cell is 'NaN'; expected the joint's position"),
    "infinite spot": (
        f"{HEAD}\n{row(laser_1_y='-inf')}",
        ":2: column 'laser_1.y': '-inf' is not finite; leave both cells of a beam empty if it was not seen",
    ),
    "overflow": (f"{HEAD}\n{row(laser_1_y='1e999')}", ":2: column 'laser_1.y': '1e999' is not finite"),
    "no header": (f"{ROW}\n{ROW}", ":1: there is no header line: the first line has numbers alone"),
    "a title and no header": (f"Trial 3\n{ROW}\n{ROW}", ":1: there is no header line: above the numbers stands 'Trial 3' alone"),
    "nan in half a spot": (f"{HEAD}\n{row(laser_1_y='nan')}", ":2: column 'laser_1.y': the cell is 'nan' and the beam's other one is not"),
    "lone y": (f"{HEAD}\n{ROW}\n{row(laser_2_z='')}", ":3: column 'laser_2.z': the cell is empty and the beam's other one is not"),
    "lone z": (f"{HEAD}\n{row(laser_1_y='')}", ":2: column 'laser_1.y': the cell is empty and the beam's other one is not"),
    "nothing seen": (f"{HEAD}\n0,0,0,,,,\n", ":2: column 'laser_1.y': every spot is empty; expected at least one that was seen"),
    "sigma zero": (
        f"{HEAD},laser_1.sigma\n{ROW},1\n{ROW},0\n",
        ":3: column 'laser_1.sigma': '0' is not above 1e-12 m; expected a standard deviation, or nothing",
    ),
    "sigma no number": (
        f"{HEAD},laser_1.sigma\n{ROW},small\n",
        ":2: column 'laser_1.sigma': 'small' is not a number; expected a standard deviation, or nothing",
    ),
    "set": (f"{HEAD},set\n{ROW},learn\n", ":2: column 'set': 'learn' is neither fit (or train) nor test"),
    "degrees": (
        rows(3, turn="30"),
        ":2: column 'turn': 3 of 3 cells lie outside the limits -0.6 to 0.6 rad and inside them as degrees; write 'turn [deg]' in the",
    ),
    "degrees of a continuous joint": (
        rows(3, lift="-90"),
        ":2: column 'lift': 3 of 3 cells lie outside the limits -12.57 to 12.57 rad and inside them as degrees",
    ),
    "Latin-1": (f"# c\n{HEAD},gr\u00f6\u00dfe\n{ROW},0".encode("latin-1"), ":2: is not UTF-8 text; save it as CSV in UTF-8"),
    "UTF-16": (f"{HEAD}\n{ROW}".encode("utf-16"), ":1: is not UTF-8 text"),
    "endless cell": (f"{HEAD}\n{'1' * 200_000},0,0,0,0,0,0", ":2: cannot be split into cells: field larger than field limit"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_measurements_are_refused(case: str, robot: Robot, tmp_path: Path) -> None:
    """Each fault is one message FILE:LINE: column NAME: what was found, what was expected."""
    text, message = BAD[case]
    with pytest.raises(MeasurementError) as error:
        read(tmp_path, text, robot)
    assert str(error.value).startswith(f"{tmp_path}/m.csv{message}")


@pytest.mark.parametrize("name", ["nope.csv", "."])
def test_a_file_that_cannot_be_read_is_refused(name: str, robot: Robot, tmp_path: Path) -> None:
    """A missing file or a folder is refused by name."""
    with pytest.raises(MeasurementError, match=r"cannot be read: (No such file|Is a directory)"):
        read_measurements(tmp_path / name, robot)


def test_single_cells_outside_the_limits_are_a_warning(robot: Robot, tmp_path: Path) -> None:
    """Half of the cells or fewer outside, or more that are no degrees either, are only said."""
    text = f"{HEAD}\n" + "\n".join([row(turn="30", slide="9", lift="99999")] * 2 + [row(slide="0.31")] + [row()])
    data = read(tmp_path, text, robot)
    assert data.warnings == (
        f"{tmp_path}/m.csv:2: column 'turn': 2 of 4 cells lie outside the joint's limits -0.6 to 0.6 rad",
        f"{tmp_path}/m.csv:2: column 'lift': 2 of 4 cells lie outside the joint's limits -12.57 to 12.57 rad",
        f"{tmp_path}/m.csv:2: column 'slide': 3 of 4 cells lie outside the joint's limits 0 to 0.3 m",
    )


def test_one_wild_cell_hides_no_degrees(robot: Robot, tmp_path: Path) -> None:
    """Degrees are found out also when another cell is a typing error; as [deg] the same cells are taken."""
    cells = [row(turn="30")] * 3 + [row(turn="99999")]
    with pytest.raises(MeasurementError, match=r"m\.csv:2: column 'turn': 3 of 4 cells"):
        read(tmp_path, f"{HEAD}\n" + "\n".join(cells), robot)
    data = read(tmp_path, f"{HEAD}\n".replace("turn", "turn [deg]") + "\n".join(cells[:3]), robot)
    np.testing.assert_allclose(data.q[:, 0], math.pi / 6)


def test_continuous_joints_may_turn_twice(robot: Robot, tmp_path: Path) -> None:
    """A continuous joint is in order up to 4 pi either way."""
    assert read(tmp_path, rows(3, lift="12.56"), robot).warnings == ()
    assert len(read(tmp_path, rows(1, lift="12.57") + "\n" + row() + "\n" + row(), robot).warnings) == 1


def random_measurements(robot: Robot, rng: np.random.Generator, n: int = 40) -> Measurements:
    spots = rng.normal(size=(n, 2, 2)) * 10.0 ** rng.integers(-6, 1, (n, 2, 1))
    spots[rng.random((n, 2)) < 0.2] = np.nan
    sigma = np.where(rng.random((n, 2)) < 0.3, np.nan, 10.0 ** rng.uniform(-5, -1, (n, 2)))
    labels = ["a,b", 'say "hi"', "x;y", "\u00fc 1"] * (n // 4)
    return spots_measured(
        robot,
        rng.uniform(-0.5, 0.5, (n, 3)) * [1, 1, 0.2] + [0, 0, 0.15],
        spots,
        sigma=sigma,
        poses=labels,
        sets=["fit", "test"] * (n // 2),
        sessions=["", "2, b"] * (n // 2),
    )


def test_what_was_written_comes_back(robot: Robot, rng: np.random.Generator, tmp_path: Path) -> None:
    """Writing and reading keeps every number to 1e-11 of itself, and every label, set and session."""
    data = random_measurements(robot, rng)
    write_measurements(tmp_path / "m.csv", data, ["first\nsecond", "third"])
    back = read_measurements(tmp_path / "m.csv", robot)
    for name in ("q", "spots", "sigma"):
        np.testing.assert_allclose(getattr(back, name), getattr(data, name), rtol=1e-11, err_msg=name)
    for name in ("poses", "sets", "sessions"):
        assert list(getattr(back, name)) == list(getattr(data, name))
    assert back.warnings == ()
    assert (tmp_path / "m.csv").read_text("utf-8").startswith("# first second\n# third\npose,turn,lift,slide,laser_1.y")


def test_a_label_makes_no_comment_of_its_row(robot: Robot, tmp_path: Path) -> None:
    """A pose called # 1 is written so that its row is read again."""
    write_measurements(tmp_path / "m.csv", spots_measured(robot, [Q] * 2, [SPOTS] * 2, poses=["# 1", "two\nlines"]))
    assert list(read_measurements(tmp_path / "m.csv", robot).poses) == ["1", "two lines"]


def test_columns_that_say_nothing_are_not_written(robot: Robot, tmp_path: Path) -> None:
    """Without sessions, test poses and stated noise there are no columns for them."""
    write_measurements(tmp_path / "m.csv", spots_measured(robot, [Q], [SPOTS]))
    assert (tmp_path / "m.csv").read_text() == f"pose,{HEAD}\n1,{ROW}\n"


WRONG = {
    "q": (dict(q=np.zeros((2, 2))), "q has shape"),
    "spots": (dict(spots=np.zeros((2, 3, 2))), "spots has shape"),
    "sets": (dict(sets=["fit"]), "sets has shape"),
    "infinite": (dict(q=np.full((2, 3), np.inf)), "joint positions must be finite"),
    "lone": (dict(spots=np.array([[[1, np.nan], [1, 1]]] * 2)), "a spot is two finite numbers"),
    "sigma": (dict(sigma=np.zeros((2, 2))), "must be finite, and stated standard deviations above zero"),
    "set": (dict(sets=["fit", "train"]), "belongs to the set 'fit' or 'test'"),
}


@pytest.mark.parametrize("case", WRONG)
def test_arrays_that_do_not_fit_are_refused(case: str, robot: Robot) -> None:
    """Measurements are checked when built, also from arrays."""
    arguments, message = WRONG[case]
    with pytest.raises(ShapeMismatch, match=message):
        spots_measured(robot, **({"q": np.zeros((2, 3)), "spots": np.zeros((2, 2, 2))} | arguments))


def test_one_laser_of_two(robot: Robot, tmp_path: Path) -> None:
    """With --laser laser_2 the first laser's columns mean nothing."""
    data = read(tmp_path, SAME["comma"], robot_from(robot.description, lasers=["laser_2"]))
    np.testing.assert_array_equal(data.spots, [[SPOTS[1]]])
    assert [warning.split("column ")[1].split(" means")[0] for warning in data.warnings] == ["'laser_1.y'", "'laser_1.z'"]
