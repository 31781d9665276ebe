"""`urdfcal rig`: from a bare URDF to a calibrated one, without writing URDF or xacro."""

from __future__ import annotations

import json
import shlex
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.conftest import CliResult
from tests.support.small_robot import joint
from urdfcal.calibration.rig_file import read_rig_file
from urdfcal.robot.robot import load_robot

Run = Callable[..., CliResult]
ROBOT = (
    '<robot name="r">\n'
    + "".join(f'<link name="{name}"/>\n' for name in ("base", "a", "b", "c", "tool"))
    + joint("j1", "base", "a", '<origin xyz="0 0 0.3"/><axis xyz="0 0 1"/>').replace('9"', '0.5"')
    + joint("j2", "a", "b", '<origin xyz="0.1 0 0"/><axis xyz="0 1 0"/>').replace('9"', '0.5"')
    + joint("j3", "b", "c", '<origin xyz="0.4 0 0"/><axis xyz="0 1 0"/>').replace('9"', '0.5"')
    + joint("j4", "c", "tool", '<origin xyz="0.3 0 0"/><axis xyz="1 0 0"/>').replace('9"', '1.5"')
    + "</robot>\n"
)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "r.urdf").write_text(ROBOT)
    return tmp_path


KINDS = {
    "screen": ("--screen", "1.7,0,0.4"),
    "screen, second": ("--screen", "1.7,0,0.4", "--prefix", "left_", "--base", "base"),
    "board": ("--board", "5x4:30mm"),
    "charuco": ("--board", "6x5:30mm:22mm", "--base", "base", "--turn-deg", "0,90,0", "--offset", "0.05,0,0"),
    "tracker": ("--tracker", "--base", "base"),
}


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_told_to_type_next_calibrates_the_robot(kind: str, run_cli: Run, folder: Path) -> None:
    """Each of the commands that are told is taken as it stands, and the robot is calibrated at their end."""
    done = run_cli("rig", "r.urdf", "--tip", "tool", *KINDS[kind], "-o", "cell.urdf")
    assert (done.code, done.err) == (0, "")
    for command in done.out.partition("next:\n")[2].splitlines():
        words = shlex.split(command)[1:]
        shown = ["--html", "cell.html"] if words[0] == "view" else ["--poses", "25"] if words[0] == "simulate" else ["--no-sag"]
        ran = run_cli(*words, *shown)
        assert ran.code == 0, ran.err
    assert "Verdict: can be used" in ran.out
    assert {"cell.html", "cell_calibrated.urdf"} <= {path.name for path in folder.iterdir()}


def test_what_was_put_where_is_said(run_cli: Run, folder: Path) -> None:
    """To people and to machines: links, places and sizes; other bytes stay, also in what xacro made."""
    done = run_cli("rig", "r.urdf", "--tip", "tool", "--screen", "-1.7,0,0.4", "--screen-size-m", "2,1.5", "-o", "cell.urdf")
    assert "slm      on tool at 20, 50, 0 mm: its beams leave 30 deg to either side of +x\n" in done.out
    assert "screen   on base at -1700, 0, 400 mm: 2 x 1.5 m, facing the robot\n" in done.out
    assert "wrote cell.urdf: 4 new links, all else as it was\n" in done.out
    assert (folder / "cell.urdf").read_text().startswith(ROBOT.removesuffix("</robot>\n"))
    (folder / "r.urdf.xacro").write_text(ROBOT.replace("<robot", '<robot xmlns:xacro="http://www.ros.org/wiki/xacro"'))
    told = json.loads(run_cli("rig", "r.urdf.xacro", "--tip", "tool", "--board", "5x4:30mm", "-o", "x.urdf", "--json").out)
    assert told["files"] == ["x.urdf", "x_rig.yaml"]
    (board,) = told["added"]
    assert (board["link"], board["on"]) == ("board", "tool")
    placed = load_robot(folder / "x.urdf").tree.by_child["board"].origin
    np.testing.assert_allclose(placed.translation, board["xyz"], atol=1e-15)
    assert str(read_rig_file(folder / "x_rig.yaml").grids()["board"]) == "5x4:30mm"
    assert "(the URDF is the expanded r.urdf.xacro)" in run_cli("rig", "r.urdf.xacro", "--tip", "tool", "--tracker", "-o", "t.urdf").out


REFUSED = {
    (): "name the link that carries it with --tip LINK; the last one of r is 'tool'",
    ("--tip", "tol"): "no link named 'tol' among 5 links; did you mean 'tool'?",
    ("--tip", "base"): "no moving joint between --tip 'base' and 'base'; --tip names the link that carries it, such as 'tool'",
    ("--tip", "tool", "--base", "tool"): "no moving joint between --tip 'tool' and 'tool'",
    ("--tip", "tool", "--screen", "1,2"): "--screen 1,2: found 2 numbers; expected its middle in m, such as 1.3,0,0.5",
    ("--tip", "tool", "--screen", "1,b,2"): "--screen 1,b,2: 'b' is not a finite number; expected its middle in m",
    ("--tip", "tool", "--screen", "1,0,1e9"): "--screen 1,0,1e9: '1e9' is beyond 1e+06; expected its middle in m",
    (
        "--tip",
        "tool",
        "--screen",
        "1300,0,500",
    ): "--screen 1300,0,500: 1300 m is too far for a cell; expected its middle in m, such as 1.3,0,0.5, and 1.3,0,0.5 if these are mm",
    (
        "--tip",
        "tool",
        "--screen",
        "2,0,1",
        "--screen-size-m",
        "1500,900",
    ): "1500 m is too far for a cell; expected width and height in m, such as 1.5 or 2,1.5, and 1.5,0.9 if these are mm",
    ("--tip", "tool", "--offset", "0,0,-120"): "--offset 0,0,-120: -120 m is too far for a cell; expected a place in m",
    ("--tip", "tool", "--board", "9x6"): "--board 9x6: expected COLUMNSxROWS:SQUARE such as 9x6:25mm",
    ("--tip", "tool", "--board", "9x6:25mm:30mm"): "a marker is smaller than its square",
    (
        "--tip",
        "tool",
        "--screen",
        "1,0,0",
        "--offset",
        "1",
    ): "--offset and --turn-deg are of one thing on the tip, and --screen and --tracker are",
    ("--tip", "tool", "--screen-turn-deg", "1,0,0"): "--screen-turn-deg turns the screen, and --screen X,Y,Z is not asked for",
    ("--tip", "tool", "--screen", "1,0,0", "--screen-size-m", "0"): "--screen-size-m 0: expected a number between",
    ("--tip", "tool", "--prefix", "1 "): "--prefix 1 : expected letters, digits and _ such as left_",
}


@pytest.mark.parametrize("words", REFUSED, ids=" ".join)
def test_what_cannot_be_put_on_is_refused(words: tuple[str, ...], run_cli: Run, folder: Path) -> None:
    """One line, exit code 2, nothing written."""
    code, out, err = run_cli("rig", "r.urdf", "--tracker", "-o", "cell.urdf", *words)
    assert REFUSED[words] in err
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert not (folder / "cell.urdf").exists()


def test_what_stands_there_is_kept(run_cli: Run, folder: Path) -> None:
    """A second rig at another place does not replace the first one, nor is it put upon it under the same names."""
    words = ("rig", "r.urdf", "--tip", "tool", "-o", "cell.urdf")
    assert "nothing to put on the robot: ask for --screen" in run_cli(*words).err
    assert run_cli(*words, "--screen", "1.7,0,0.4").code == 0
    assert run_cli(*words, "--screen", "1.7,0,0.4").code == 0
    assert "cell.urdf: is there already and holds something else; --overwrite replaces it" in run_cli(*words, "--screen", "1.6,0,0.4").err
    assert run_cli(*words, "--screen", "1.6,0,0.4", "--overwrite").code == 0
    again = run_cli("rig", "cell.urdf", "--tip", "a", "--screen", "1.6,0,0.4", "-o", "two.urdf")
    assert "cell.urdf: has a link 'slm' already; --prefix rig_ names what is new rig_slm" in again.err


def test_what_will_disappoint_is_warned_of(run_cli: Run, folder: Path) -> None:
    """A screen that hardly any pose puts both beams on, and meshes that the new file no longer finds."""
    text = ROBOT.replace('<link name="a"/>', '<link name="a"><visual><geometry><mesh filename="meshes/a.stl"/></geometry></visual></link>')
    (folder / "r.urdf").write_text(text)
    (folder / "out").mkdir()
    done = run_cli("rig", "r.urdf", "--tip", "tool", "--screen", "1.7,0,9", "-o", "out/")
    assert (done.code, (folder / "out" / "r_rigged.urdf").is_file()) == (0, True)
    assert "0.0% of random poses put both beams on the screen: move it, make it larger, or turn the module" in done.err
    assert "meshes such as meshes/a.stl are named from the folder of r.urdf" in done.err
    assert "meshes" not in run_cli("rig", "r.urdf", "--tip", "tool", "--screen", "1.7,0,0.4", "-o", "cell.urdf").err


def test_who_has_no_rig_is_told_how_to_get_one(run_cli: Run, folder: Path) -> None:
    """The command that is named puts one on this very robot."""
    told = run_cli("dh", "r.urdf").err
    command = told.partition("--screen; ")[2].partition(" puts these on")[0]
    assert command == "urdfcal rig r.urdf --tip tool --screen 1.3,0,0.5 -o cell.urdf"
    assert run_cli(*shlex.split(command)[1:]).code == 0
    assert run_cli("dh", "cell.urdf").code == 0
    columns = {"laser_1.y,laser_1.z": "rig --screen", "board:0.u,board:0.v": "rig --board COLSxROWS:SQUARE", "target.x": "rig --tracker"}
    for names, option in columns.items():
        (folder / "m.csv").write_text(f"j1,j2,j3,j4,{names}\n0,0,0,0{',1' * (names.count(',') + 1)}\n")
        assert f"urdfcal {option} " in run_cli("check", "r.urdf", "m.csv").err.replace(",", " ")
