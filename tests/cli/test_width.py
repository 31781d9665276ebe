"""Everything that a command says fits a terminal of 80 columns, names of joints and links being as long as they often are."""

from __future__ import annotations

import shlex
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.conftest import CliResult
from tests.support.small_robot import URDF
from urdfcal.cli.described import COMMANDS
from urdfcal.cli.streams import Shown

Run = Callable[..., CliResult]
LONG = {
    '"turn"': '"left_arm_shoulder_pan_joint"',
    '"lift"': '"left_arm_shoulder_lift_joint"',
    '"slide"': '"left_arm_telescope_slide_joint"',
    '"tool"': '"left_arm_tool_flange_link"',
}
BENCH = """\
distance [mm],laser_1.x [mm],laser_1.y [mm],laser_2.x [mm],laser_2.y [mm]
300,-158.1,6.7,180.6,4.3\n500,-263.6,11.2,301.1,7.2\n700,-368.9,15.6,421.6,10.1\n900,-474.5,20.1,542.2,12.9
"""
SCREEN = "dictionary: DICT_4X4_50\nsize_mm: 100\nmarkers: {0: [550, 400], 1: [-550, 400], 2: [550, -400], 3: [-550, -400]}\n"
CHANGED = {
    "render": "urdfcal render robot.urdf poses.csv -o pictures/",  # which makes the camera, too
    "simulate": "urdfcal simulate robot.urdf -o try.csv --sensor point:left_arm_tool_flange_link",
    "apply": f"{COMMANDS['apply'].example} --overwrite",
    "measurements": "urdfcal measurements robot.urdf tracker.csv --target left_arm_tool_flange_link",
    "dh": "urdfcal dh robot.urdf --tip left_arm_tool_flange_link",
    "rig": "urdfcal rig robot.urdf --tip left_arm_tool_flange_link --screen 1.3,0,0.5 --prefix two_ -o cell.urdf",
    "correct": "urdfcal correct robot.urdf targets.csv --calibration robot_calibration.yaml -o out.csv",
    "compare": "urdfcal compare robot.urdf robot_calibration.yaml",
    "import": "urdfcal import robot.urdf robot_calibrated.urdf -o imported.yaml",
    "fit": "urdfcal fit robot.urdf measured.csv -o robot_calibrated.urdf --overwrite",
}
ORDER = "rig measurements check fit evaluate apply compare import correct dh view simulate markers render spots module version".split()
ELSEWHERE = {"boards", "camera", "fleet", "paper", "poses"}  # take as long as all the others; their own tests look at them


@pytest.fixture
def inputs(tmp_path: Path, run_cli: Run) -> Path:
    """A folder with what the examples read."""
    text = URDF
    for old, new in LONG.items():
        text = text.replace(old, new)
    for name, content in {"robot.urdf": text, "bench.csv": BENCH, "screen.yaml": SCREEN}.items():
        (tmp_path / name).write_text(content)
    sensors = "--sensor", "laser", "--sensor", "pose:left_arm_tool_flange_link"
    assert run_cli("simulate", "robot.urdf", "-o", "measured.csv", *sensors, "--poses", "24", "--seed", "3").code == 0
    lines = (tmp_path / "measured.csv").read_text().splitlines()
    head = next(number for number, line in enumerate(lines) if line.startswith("pose,"))
    (tmp_path / "poses.csv").write_text("\n".join(lines[head : head + 3]))
    points = (",".join((*cells.split(",")[1:4], *cells.split(",")[8:11])) for cells in lines[head + 1 :])
    names = ",".join((*(name.strip('"') for name in list(LONG.values())[:3]), "x", "y", "z"))
    (tmp_path / "tracker.csv").write_text("\n".join([names, *points]))
    (tmp_path / "targets.csv").write_text("\n".join(",".join(line.split(",")[1:4]) for line in lines[head : head + 3]))
    return tmp_path


@pytest.mark.usefixtures("small_pictures")
def test_what_the_examples_say_fits_80_columns(run_cli: Run, inputs: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """No line of results, of warnings or of tables is longer than the terminal is wide, and none ends in the middle of a word."""
    assert set(ORDER) | ELSEWHERE >= set(COMMANDS)
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.setattr(Shown, "isatty", lambda self: True, raising=False)
    for command in ORDER:
        done = run_cli(*shlex.split(CHANGED.get(command, COMMANDS[command].example))[1:])
        said = (done.out + done.err).splitlines()
        assert done.code == 0, (command, done.err)
        assert said or command == "version"
        assert [line for line in said if len(line) > 80 and " " in line.strip()] == []  # one long word is a path
        if command == "render":
            (inputs / "camera.yaml").write_bytes((inputs / "pictures" / "camera.yaml").read_bytes())
