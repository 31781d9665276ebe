"""Bad input from end to end: exit code 2, one line on stderr that says where and what, and nothing written."""

from __future__ import annotations

import os
import shlex
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.conftest import CliResult
from tests.support.small_robot import CSV, URDF, XACRO

FIT = "fit small.urdf m.csv"
XFIT = "fit small.xacro m.csv"
RIG = "fit small.urdf m.csv --rig rig.yaml"
APPLY = "apply small.urdf c.yaml -o out.urdf"
SIMULATE = "simulate small.urdf -o out.csv --errors t.yaml"
ORIGIN = "{xyz: [0, 0, 0], rpy: [0, 0, 0]}"
ENTRY = f"{{moves: true, nominal: {ORIGIN}, corrected: {ORIGIN}}}"
XHEAD = '<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">\n'


def urdf(old: str, new: str) -> dict[str, str]:
    assert old in URDF
    return {"small.urdf": URDF.replace(old, new, 1)}


def csv(old: str, new: str) -> dict[str, str]:
    assert old in CSV
    return {"m.csv": CSV.replace(old, new, 1)}


URDFS = {
    "payload on no link": (f"{FIT} --payload 2@tol", {}, "no link named 'tol' among 8 links; did you mean 'tool'"),
    "urdf missing": ("fit nope.urdf m.csv", {}, "nope.urdf: cannot be read: No such file or directory"),
    "urdf is a folder": ("fit . m.csv", {}, ".: cannot be read: Is a directory"),
    "urdf empty": (FIT, {"small.urdf": ""}, "small.urdf:1: not well-formed XML: no element found"),
    "urdf cut": (FIT, {"small.urdf": URDF[:500]}, "small.urdf:19: not well-formed XML: unclosed token"),
    "urdf other document": (FIT, {"small.urdf": "<sdf/>"}, "small.urdf:1: the document is a <sdf>, expected a URDF with <robot>"),
    "urdf binary": (FIT, {"small.urdf": b"\x7fELF\x00\x01"}, "small.urdf:1: not well-formed XML"),
    "urdf UTF-16": (FIT, {"small.urdf": URDF.replace('"1.0"', '"1.0" encoding="UTF-16"', 1).encode("utf-16")}, "save it as UTF-8"),
    "urdf Latin-1 undeclared": (
        FIT,
        {"small.urdf": URDF.replace("small", "gr\u00f6\u00df").encode("latin-1")},
        "small.urdf:2: not well-formed XML",
    ),
    "urdf entity": (
        FIT,
        urdf("<robot", '<!DOCTYPE r [<!ENTITY e SYSTEM "/etc/passwd">]><robot'),
        "small.urdf:2: declares the entity 'e'; entity declarations are refused",
    ),
    "urdf laughs": (
        FIT,
        urdf("<robot", '<!DOCTYPE r [<!ENTITY a "aa"><!ENTITY b "&a;&a;">]><robot'),
        "small.urdf:2: declares the entity 'a'",
    ),
    "urdf namespace": (
        FIT,
        urdf("<robot", '<robot xmlns="u"'),
        "small.urdf:2: <robot> is in the default namespace 'u', expected none; remove xmlns",
    ),
    "urdf without a name": (FIT, urdf(' name="small"', ""), "small.urdf:2: <robot> has no name; expected <robot name="),
    "urdf no screen": (
        FIT,
        {"small.urdf": URDF.replace('"screen"', '"screem"')},
        "no link named 'screen' among 8 links; did you mean 'screem'",
    ),
    "urdf no laser": (
        FIT,
        {"small.urdf": URDF.replace('"laser_', '"beam_')},
        "m.csv:1: column 'laser_1.y': the file looks like laser spots (.y and .z), and the robot has no link 'laser_1'; name the lasers",
    ),
    "urdf lasers on two links": (
        FIT,
        {"small.urdf": URDF.replace('<parent link="slm"/>\n    <child link="laser_2"/>', '<parent link="base"/><child link="laser_2"/>')},
        "laser_1 on tool, laser_2 on screen; choose with --laser",
    ),
    "urdf unknown link": (
        FIT,
        urdf('<child link="tool"/>', '<child link="tol"/>'),
        "small.urdf:29: joint 'slide': no link named 'tol' among 8 links; did you mean 'tool'?",
    ),
    "urdf no number": (FIT, urdf("0 0 0.2", "0 0 O.2"), "small.urdf:19: joint 'turn': xyz=\"0 0 O.2\": 'O.2' is not a finite number"),
    "urdf far away": (FIT, urdf("0 0 0.2", "0 0 1e300"), "'1e300' is beyond 1e+06; expected metres and radians"),
    "urdf no limit": (
        FIT,
        urdf('<limit lower="-0.6" upper="0.6" effort="1" velocity="1"/>', ""),
        "small.urdf:16: joint 'turn' is revolute and has no <limit>",
    ),
    "urdf floating": (
        FIT,
        urdf('name="lift" type="continuous"', 'name="lift" type="floating"'),
        "small.urdf:23: joint 'lift' on the way from 'screen' to 'slm' is floating; expected revolute",
    ),
    "urdf mimic loop": (
        FIT,
        urdf('<axis xyz="0 1 0"/>', '<axis xyz="0 1 0"/><mimic joint="lift"/>'),
        "small.urdf:23: joint 'lift' mimics itself",
    ),
    "urdf nothing moves": (
        FIT,
        {"small.urdf": URDF.replace("revolute", "fixed").replace("continuous", "fixed").replace("prismatic", "fixed")},
        "no moving joint between the screen 'screen' and the laser 'laser_1'",
    ),
    "xacro argument of a urdf": (f"{FIT} --xacro-arg a:=1", {}, "small.urdf: is a plain URDF and takes no xacro argument (a)"),
    "xacro include missing": (
        XFIT,
        {"small.xacro": XHEAD + '<xacro:include filename="arm.xacro"/></robot>'},
        "small.xacro: xacro: the included file arm.xacro cannot be read: No such file",
    ),
    "xacro package missing": (
        XFIT,
        {"small.xacro": XHEAD + '<xacro:include filename="$(find arm)/arm.xacro"/></robot>'},
        "package 'arm' was not found; name the folder that holds it with --package-dir",
    ),
    "xacro macro unknown": (XFIT, {"small.xacro": XHEAD + "<xacro:arm/></robot>"}, "small.xacro: xacro: unknown macro name: xacro:arm"),
    "xacro recursion": (
        XFIT,
        {"small.xacro": XHEAD + '<xacro:include filename="small.xacro"/></robot>'},
        "small.xacro: xacro: macros, properties or includes call themselves without end",
    ),
    "xacro python": (XFIT, {"small.xacro": XHEAD + '<link name="${open(1)}"/></robot>'}, "small.xacro: xacro: name 'open' is not defined"),
    "xacro entity in an include": (
        XFIT,
        {"small.xacro": XHEAD + '<xacro:include filename="a.xml"/></robot>', "a.xml": '<!DOCTYPE r [<!ENTITY e "x">]><robot/>'},
        "a.xml:1: declares the entity 'e'",
    ),
    "xacro argument unknown": (f"{XFIT} --xacro-arg hight:=1", {}, "small.xacro: takes no xacro argument 'hight'; did you mean 'height'?"),
    "xacro argument malformed": (f"{XFIT} --xacro-arg height=1", {}, "--xacro-arg height=1: expected NAME:=VALUE"),
    "xacro value": (f"{XFIT} --xacro-arg height:=tall", {}, "small.xacro (expanded):"),
    "package dir": (f"{XFIT} --package-dir nope", {}, "--package-dir nope: no such folder"),
}

CSVS = {
    "csv missing": ("fit small.urdf nope.csv", {}, "nope.csv: cannot be read: No such file"),
    "csv empty": (FIT, {"m.csv": ""}, "m.csv: the file has no header line"),
    "csv no rows": (FIT, {"m.csv": "# c\n" + CSV.splitlines()[0]}, "m.csv:2: there is a header and no row"),
    "csv joint missing": (
        FIT,
        csv("lift", "left"),
        "m.csv:1: column 'lift': is missing; expected a column for each joint on the way; did you mean 'left'?",
    ),
    "csv spot missing": (
        FIT,
        csv("laser_2.z", "laser_2.x"),
        "m.csv:1: column 'laser_2.z': is missing; a spot of laser_2 needs laser_2.y and laser_2.z",
    ),
    "csv column twice": (FIT, csv("lift", "turn"), "m.csv:1: column 'turn': stands twice, in cells 1 and 2"),
    "csv unit": (FIT, csv("turn", "turn [grad]"), "m.csv:1: column 'turn': unit 'grad' is not understood, expected rad or deg"),
    "csv no number": (
        FIT,
        csv("0.07", "0.O7"),
        "m.csv:3: column 'laser_2.y': '0.O7' is not a number; leave both cells of a beam empty if it was not seen",
    ),
    "csv infinite": (FIT, csv("0.07", "inf"), "m.csv:3: column 'laser_2.y': 'inf' is not finite"),
    "csv far away": (FIT, csv("0.07", "1e300"), "m.csv:3: column 'laser_2.y': '1e300' is beyond 1e+06"),
    "csv lone cell": (FIT, csv("0.07", ""), "m.csv:3: column 'laser_2.y': the cell is empty and the beam's other one is not"),
    "csv short row": (FIT, csv(",0.08", ""), "m.csv:3: the row has 6 cells, expected 7 as in the header"),
    "csv decimal comma": (
        FIT,
        csv("0.08", "0,08"),
        "m.csv:3: the row has 8 cells, expected 7 as in the header; a decimal comma needs ; between the cells",
    ),
    "csv degrees": (
        FIT,
        {"m.csv": CSV.replace("0.1,-0.2", "11,-0.2").replace("0.2,0.1", "22,0.1")},
        "m.csv:2: column 'turn': 2 of 2 cells lie outside the limits -0.6 to 0.6 rad and inside them as degrees; write 'turn [deg]'",
    ),
    "csv set": (
        FIT,
        {"m.csv": CSV.replace("2.z\n", "2.z,set\n").replace("4\n", "4,fit\n").replace("8\n", "8,tset\n")},
        "m.csv:3: column 'set': 'tset' is neither fit (or train) nor test",
    ),
    "csv all test": (
        FIT,
        {"m.csv": CSV.replace("2.z\n", "2.z,set\n").replace("4\n", "4,test\n").replace("8\n", "8,test\n")},
        "no pose is left to fit: every row with a measurement is marked as test",
    ),
    "csv Latin-1": (
        FIT,
        {"m.csv": CSV.replace("turn", "dr\u00e4h").encode("latin-1")},
        "m.csv:1: is not UTF-8 text; save it as CSV in UTF-8",
    ),
    "csv is a urdf": ("fit small.urdf small.urdf", {}, "small.urdf: is XML, as robot descriptions are; expected a table"),
    "test csv missing": (f"{FIT} --test nope.csv", {}, "nope.csv: cannot be read: No such file"),
}

YAMLS = {
    "rig missing": (RIG, {}, "rig.yaml: cannot be read: No such file"),
    "rig syntax": (RIG, {"rig.yaml": "screen: a\n  b: c"}, "rig.yaml:2: not readable as YAML: mapping values are not allowed"),
    "rig entry": (RIG, {"rig.yaml": "screen: screen\nnoises: {}"}, "rig.yaml:2: entry 'noises' is unknown; did you mean 'noise'?"),
    "rig value": (RIG, {"rig.yaml": "noise:\n  spot_mm: -1"}, "rig.yaml:2: entry 'noise.spot_mm': Input should be greater than"),
    "rig alias": (RIG, {"rig.yaml": "lasers: &a [*a]"}, "rig.yaml:1: the alias '*a' is refused; write the entry out"),
    "rig depth": (RIG, {"rig.yaml": "[" * 50_000}, "rig.yaml:1: nested more than 30 levels deep"),
    "rig link": (RIG, {"rig.yaml": "screen: wall"}, "no link named 'wall' among 8 links"),
    "rig joint": (
        RIG,
        {"rig.yaml": "error_models: {elbow: dh}"},
        "error_models: no joint 'elbow' that is calibrated; there are: turn, lift, slide",
    ),
    "rig noise of no joint": (RIG, {"rig.yaml": "noise: {joints_deg: {elbow: 1}}"}, "no joint named 'elbow' among 3 joints"),
    "rig prior": (RIG, {"rig.yaml": "priors: {joint: 1}"}, "rig.yaml:1: entry 'priors.joint': Input should be a valid string, found 1"),
    "calibration missing": (APPLY, {}, "c.yaml: cannot be read: No such file"),
    "calibration is a rig": (APPLY, {"c.yaml": "screen: a"}, "c.yaml: is no calibration: it is a rig file, which --rig takes"),
    "rig is a camera": (RIG, {"rig.yaml": "intrinsics: {fx: 1}"}, "rig.yaml: is no rig file: it is a camera, which --camera takes"),
    "rig is a compensation": (
        RIG,
        {"rig.yaml": "urdfcal: compensation"},
        "is no rig file: it is a compensation, which --comp",
    ),
    "camera is a calibration": (f"{FIT} --camera c.yaml", {"c.yaml": f"joints:\n  a: {ENTRY}"}, "is no camera: it is a calibration, which"),
    "camera is a rig": (f"{FIT} --camera c.yaml", {"c.yaml": "boards: {}"}, "is no camera: it is a rig file, which --rig takes; expected"),
    "camera is markers": (
        f"{FIT} --camera c.yaml",
        {"c.yaml": "dictionary: a"},
        "is no camera: it is a screen.yaml, which --markers",
    ),
    "calibration number": (
        APPLY,
        {"c.yaml": f"joints:\n  turn: {ENTRY}".replace("0", "zero", 1)},
        "c.yaml:2: entry 'joints.turn.nominal.xyz.0': Input should be a valid number",
    ),
    "calibration of another robot": (APPLY, {"c.yaml": f"joints:\n  elbow: {ENTRY}"}, "c.yaml: the robot small.urdf has no joint 'elbow'"),
    "calibration of another origin": (
        APPLY,
        {"c.yaml": f"joints:\n  turn: {ENTRY}"},
        "c.yaml: joint 'turn' of small.urdf is neither at its nominal nor at its corrected origin (200 mm, 0 mrad from nominal); --force",
    ),
    "calibration far away": (
        APPLY,
        {"c.yaml": f"joints:\n  turn: {ENTRY}".replace("0", "1e300", 1)},
        "c.yaml:2: entry 'joints.turn.nominal.xyz.0': Input should be",
    ),
    "calibration twice": (APPLY, {"c.yaml": f"joints:\n  a: {ENTRY}\n  a: {ENTRY}"}, "c.yaml:3: the entry 'a' stands twice"),
    "truth missing": (SIMULATE, {}, "t.yaml: cannot be read: No such file"),
    "truth empty": (SIMULATE, {"t.yaml": "- 1"}, "t.yaml:1: expected entries error_model and parameters"),
    "truth name": (SIMULATE, {"t.yaml": "parameters:\n  turn.d_b: 1"}, "t.yaml:2: the error model dh has no parameter named 'turn.d_b'"),
    "truth value": (
        SIMULATE,
        {"t.yaml": "parameters:\n  turn.d_a: 1mm"},
        "t.yaml:2: parameter 'turn.d_a': found '1mm', expected a number in m or rad",
    ),
    "truth infinite": (
        SIMULATE,
        {"t.yaml": "parameters: {turn.d_a: .inf}"},
        "t.yaml:1: parameter 'turn.d_a': found inf, expected a number",
    ),
    "truth model": (
        SIMULATE,
        {"t.yaml": "error_model: denavit\nparameters: {}"},
        "t.yaml:1: no error model 'denavit'; there are: auto, dh",
    ),
}

USAGE = {
    "no argument": ("fit small.urdf", {}, "MEASUREMENTS"),
    "one too many": ("evaluate small.urdf m.csv more", {}, "more"),
    "no such command": ("calibrate small.urdf", {}, "calibrate"),
    "no such option": (f"{FIT} --prior 1", {}, "--prior"),
    "output missing": ("apply small.urdf c.yaml", {}, "--output"),
    "no number": (f"{FIT} --spot-sigma-mm wide", {}, "'--spot-sigma-mm'"),
    "noise of zero": (f"{FIT} --spot-sigma-mm 0", {}, "--spot-sigma-mm 0: expected a number between"),
    "noise not finite": (f"{FIT} --spot-sigma-mm nan", {}, "--spot-sigma-mm nan: expected a number between"),
    "joint noise negative": (f"{FIT} --joint-sigma-deg -1", {}, "--joint-sigma-deg -1: expected"),
    "joint noise not finite": (f"{FIT} --joint-sigma-deg inf", {}, "joint"),
    "tolerance": (f"{FIT} --tolerance -1", {}, "--tolerance -1: expected a number between"),
    "process noise": (f"{FIT} --schedule paper --process-noise -1", {}, "found q = -1 and r = 0.0001"),
    "prior": (f"{FIT} --prior-joint 1mm", {}, "'1mm' is not a prior; expected a length and an angle such as 10mm,1deg, or flat"),
    "prior units": (f"{FIT} --prior-mount 1deg,1mm", {}, "'1deg,1mm' is not a prior"),
    "estimator": (f"{FIT} --estimator ukf", {}, "'ukf' is not one of 'ekf', 'lse'"),
    "schedule": (f"{FIT} --schedule fast", {}, "'fast' is not one of 'iterated', 'paper'"),
    "error model": (f"{FIT} --error-model poe", {}, "'poe' is not one of 'auto', 'dh', 'hayati', 'placement', 'offset'"),
    "compensation of few": (
        f"{FIT} --compensation c.yaml",
        {},
        "--compensation c.yaml: sag is looked at from 20 fitted poses on, and there are 2; nothing was fitted",
    ),
    "estimate": (f"{FIT} --estimate beam", {}, "'beam' is not one of 'screen', 'beams', 'beams4', 'lens'; did you mean 'beams'?"),
    "fix nothing": (f"{FIT} --fix elbow.d_a", {}, "no parameter matches 'elbow.d_a'"),
    "only nothing": (f"{FIT} --only elbow.*", {}, "no parameter matches 'elbow.*'"),
    "fix everything": (f"{FIT} --fix *", {}, "nothing is left to estimate: every parameter is fixed"),
    "screen link": (f"{FIT} --screen wall", {}, "no link named 'wall' among 8 links"),
    "laser link": (f"{FIT} --laser laser_3", {}, "no link named 'laser_3' among 8 links; did you mean 'laser_"),
    "output in no folder": (f"{FIT} -o nope/out.urdf", {}, "nope/out.urdf: the folder nope does not exist"),
    "output is in no folder": (f"{FIT} -o nope/", {}, "nope/small_calibrated.urdf: the folder nope does not exist"),
    "output is the robot": (f"{FIT} -o small.urdf", {}, "small.urdf: is an input of this command; name another output with -o"),
    "output is the data": ("fit small.urdf m -o ./m", {"m": CSV}, "m: is an input of this command"),
    "apply onto the robot": (
        "apply small.urdf c.yaml -o small.urdf",
        {"c.yaml": f"joints: {{turn: {ENTRY}}}"},
        "small.urdf: is an input of this command",
    ),
    "simulate no poses": ("simulate small.urdf -o out.csv --poses 0", {}, "--poses"),
    "simulate scales": (
        "simulate small.urdf -o out.csv --errors 2",
        {},
        "--errors 2: expected a length and an angle such as 2mm,0.2deg, none,",
    ),
    "simulate noise": ("simulate small.urdf -o out.csv --noise pink", {}, "'pink' is not one of 'gaussian', 'uniform'"),
    "simulate noise negative": ("simulate small.urdf -o out.csv --spot-noise-mm -1", {}, "noise must be finite and not negative"),
    "simulate onto the errors": ("simulate small.urdf -o m.csv --errors m.csv", {}, "m.csv: is an input of this command"),
    "simulate off the screen": ("simulate small.urdf -o out.csv --screen-size-m 0.000001", {}, "random poses put every beam on the screen"),
}

CASES = URDFS | CSVS | YAMLS | USAGE


@pytest.mark.parametrize("case", CASES)
def test_bad_input_is_one_line_and_nothing_is_written(case: str, run_cli: Callable[..., CliResult], tmp_path: Path) -> None:
    """Exit code 2, one line on stderr with the place and the way out, nothing on stdout, no file made or changed."""
    command, files, message = CASES[case]
    contents = {
        name: content if isinstance(content, bytes) else content.encode()
        for name, content in ({"small.urdf": URDF, "small.xacro": XACRO, "m.csv": CSV} | files).items()
    }
    for name, content in contents.items():
        (tmp_path / name).write_bytes(content)
    code, out, err = run_cli(*shlex.split(command))
    assert message in err
    assert (code, out, err.count("\n"), err.endswith("\n")) == (2, "", 1, True)
    assert err.startswith("urdfcal: ")
    assert {name: (tmp_path / name).read_bytes() for name in os.listdir(tmp_path)} == contents


def test_the_files_behind_the_cases_are_good(run_cli: Callable[..., CliResult], tmp_path: Path) -> None:
    """Unbroken, the same robot and measurements are taken."""
    (tmp_path / "small.urdf").write_text(URDF)
    (tmp_path / "small.xacro").write_text(XACRO)
    (tmp_path / "m.csv").write_text(CSV)
    for robot in ("small.urdf", "small.xacro"):
        assert run_cli("evaluate", robot, "m.csv").code == 0


@pytest.mark.parametrize("option", ["--places", "--poses", "--test-poses"])
def test_more_than_can_be_simulated_is_refused(option: str, run_cli: Callable[..., CliResult], tmp_path: Path) -> None:
    """Numbers of poses or places that would take all memory are refused before any work, in one line that says how many there can be."""
    (tmp_path / "small.urdf").write_text(URDF)
    result = run_cli("simulate", "small.urdf", "-o", "m.csv", option, "1000000000")
    assert (result.code, len(result.err.splitlines())) == (2, 1)
    assert option in result.err
    assert ("1000" if option == "--places" else "100000") in result.err
    assert not (tmp_path / "m.csv").exists()
