"""`urdfcal poses`: poses that the robot may take and that tell much, in an order to drive."""

from __future__ import annotations

import csv
import itertools
import json
import os
import re
import signal
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
import yaml

import urdfcal
from tests.conftest import CliResult
from tests.support.paths import ROBOTS_DIR
from tests.support.small_robot import URDF
from urdfcal.cell.collisions import cell_of
from urdfcal.cell.ways import Ways
from urdfcal.robot.robot import load_robot

Run = Callable[..., CliResult]
PANDA = ROBOTS_DIR / "panda" / "panda.urdf.xacro"
UR5 = ROBOTS_DIR / "ur5" / "ur5.urdf.xacro"
POINT = ("--sensor", "point:tool0")
FEW = ("--candidates", "150", "-n", "8")
SCENE = "boxes: {table: {size_mm: [1600, 1600, 40], xyz_mm: [0, 0, -60]}}\nlink: panda_link0\n"


def positions(path: Path) -> np.ndarray:
    """The joints' columns."""
    with path.open() as stream:
        rows = list(csv.DictReader(line for line in stream if not line.startswith("#")))
    return np.array([[float(value) for name, value in row.items() if name not in ("pose", "set")] for row in rows])


def test_poses_are_free_and_so_is_the_way(run_cli: Run, tmp_path: Path) -> None:
    """Above a table no pose and no step of a leg touches, looked at anew; the trajectory goes through all of them, in growing time."""
    (tmp_path / "scene.yaml").write_text(SCENE)
    done = run_cli(
        "poses", PANDA, "-o", "p.csv", "--sensor", "point:panda_link8", *FEW, "--scene", "scene.yaml", "--trajectory", "t.yaml", "--json"
    )
    assert done.code == 0, done.err
    told = json.loads(done.out)
    assert told["blocked"] == []
    robot = urdfcal.plan_poses(load_robot(PANDA), candidates=10, n=2, sensors=["point:panda_link8"]).robot  # as the sensor sees it
    cell = cell_of(robot, scene=tmp_path / "scene.yaml", clearance=0.0)
    names = told["joints"]
    trajectory = yaml.safe_load((tmp_path / "t.yaml").read_text())
    points = np.array([point["positions"] for point in trajectory["points"]])
    assert trajectory["joint_names"] == names
    times = [point["time_from_start"]["sec"] + 1e-9 * point["time_from_start"]["nanosec"] for point in trajectory["points"]]
    assert (np.diff(times) > 0).all()
    for a, b in itertools.pairwise(points):
        assert cell.free(a + np.linspace(0, 1, 1 + int(np.abs(b - a).max() / 2e-3))[:, None] * (b - a)).all()
    assert np.allclose(positions(tmp_path / "p.csv"), told["poses"], atol=1e-6)
    assert len(points) == 8 + sum(map(len, told["vias"].values()))


def test_chosen_poses_tell_more_than_random_ones(run_cli: Run) -> None:
    """The prediction after them is below that after as many random ones; each further pose makes it smaller; a fifth is to test on."""
    done = run_cli("poses", UR5, "-o", "p.csv", *POINT, *FEW, "--no-collisions", "--report", "p.html", "--json")
    assert done.code == 0, done.err
    told = json.loads(done.out)
    page = Path("p.html").read_text()
    assert told["files"] == ["p.csv", "p.html"]
    assert f"{told['at_random_mm']:.3g} mm after as many random ones" in page
    assert all(name in page for name in told["joints"])
    assert not re.search(r"(src|href)=.https?:", page)
    sigma = np.array(told["tool_sigma_mm"])
    assert (np.diff(sigma) < 0).all()
    assert sigma[-1] < 0.9 * told["at_random_mm"]
    assert Path("p.csv").read_text().count(",test,") == 1


def test_ctrl_c_gives_the_best_so_far(run_cli: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    """Interrupted while ways are looked at, the poses are written all the same, what was not looked at is said, and the code is 130."""
    looked, way = [], Ways.free_until

    def interrupted(ways: Ways, a: np.ndarray, b: np.ndarray) -> float:
        looked.append(1)
        if len(looked) == 2:
            os.kill(os.getpid(), signal.SIGINT)
        return way(ways, a, b)

    monkeypatch.setattr(Ways, "free_until", interrupted)
    done = run_cli("poses", PANDA, "-o", "p.csv", "--sensor", "point:panda_link8", "--trajectory", "t.yaml", *FEW)
    assert done.code == 130
    assert "t.yaml: to poses 1 to 3 alone, since no way leads on" in done.err
    assert "interrupted: legs that were not looked at" in done.err
    assert "no free way was found from pose 3 to 4" in done.err
    assert len(positions(Path("p.csv"))) == 8
    assert len(looked) == 2


def test_a_robot_without_a_rig_is_planned_for(run_cli: Run, tmp_path: Path) -> None:
    """No laser and no screen are asked for where a tracker measures; a slide is a joint like others, in m."""
    (tmp_path / "bare.urdf").write_text(URDF.replace("laser_", "lamp_").replace("screen", "wall"))
    done = run_cli("poses", "bare.urdf", "-o", "p.csv", "--sensor", "point:tool", "--candidates", "60", "-n", "10", "--verbose", "--json")
    assert done.code == 0, done.err
    told = json.loads(done.out)
    assert told["joints"] == ["turn", "lift", "slide"]
    assert np.ptp(np.array(told["poses"])[:, 2]) <= 0.3


def test_as_few_as_suffice(run_cli: Run) -> None:
    """--until stops where the prediction is there, and what was measured already counts."""
    words = ("poses", UR5, *POINT, "--candidates", "150", "--no-collisions", "--until", "0.3mm", "--json")
    done = json.loads(run_cli(*words, "-o", "p.csv").out)
    assert done["tool_sigma_mm"][-1] <= 0.3
    assert len(done["poses"]) > 6
    assert run_cli("simulate", UR5, "-o", "m.csv", *POINT, "--poses", "12").code == 0
    further = json.loads(run_cli(*words, "-o", "q.csv", "--have", "m.csv").out)
    assert len(further["poses"]) < len(done["poses"])


@pytest.mark.parametrize(
    ("words", "said", "not_said"),
    [
        (("--until", "9000mm"), "1 pose for small: 'tool' predicted", "at full speed"),
        (("-n", "4", "--criterion", "O1"), "as many random ones; larger is better", ""),
        (("-n", "4", "--criterion", "A"), "as many random ones; smaller is better", ""),
        (("-n", "4", "--have", "m.csv"), "mm with those alone that were measured already", "before any"),
        (("--until", "0.0001mm"), "--until is not reached: after 25 poses the tool is predicted to be", ""),
    ],
)
def test_what_is_said_of_a_plan(run_cli: Run, tmp_path: Path, words: tuple[str, ...], said: str, not_said: str) -> None:
    """Sentences fit one pose as well as many, those that complete others, and a criterion that nobody knows by heart."""
    (tmp_path / "small.urdf").write_text(URDF)
    if "--have" in words:
        assert run_cli("simulate", "small.urdf", "-o", "m.csv", "--sensor", "point:tool", "--poses", "4").code == 0
    done = run_cli(
        "poses",
        "small.urdf",
        "-o",
        "p.csv",
        "--sensor",
        "point:tool",
        "--candidates",
        "25",
        "--no-collisions",
        "--report",
        "r.html",
        *words,
    )
    assert done.code == 0, done.err
    assert said in done.out + done.err
    assert not not_said or not_said not in done.out
    assert ", 0 s at full speed" not in (tmp_path / "r.html").read_text()


def test_the_page_of_a_check_marks_all_of_its_poses(run_cli: Run, tmp_path: Path) -> None:
    """All are to test on, in the file and on the page alike."""
    (tmp_path / "small.urdf").write_text(URDF)
    words = ("poses", "small.urdf", "--check", "--sensor", "point:tool", "--candidates", "25", "--no-collisions", "--report", "r.html")
    assert run_cli(*words, "-o", "p.csv").code == 0
    page = (tmp_path / "r.html").read_text()
    assert len(re.findall(r"<td[^>]*>test</td>", page)) == 8
    assert not re.search(r"<td[^>]*>fit</td>", page)


def test_the_file_is_what_fit_reads(run_cli: Run) -> None:
    """With what was read in a pose written beside it, the file is measurements."""
    assert run_cli("poses", UR5, "-o", "p.csv", *POINT, "--candidates", "60", "-n", "25", "--no-collisions").code == 0
    lines = Path("p.csv").read_text().splitlines()
    head, rows = lines[2], lines[3:]
    model = load_robot(UR5).model
    data, filled = model.createData(), []
    for row in rows:
        pin.framesForwardKinematics(model, data, np.array([float(value) for value in row.split(",")[2:]]))
        filled.append(",".join([row, *map(repr, data.oMf[model.getFrameId("tool0")].translation.tolist())]))
    Path("m.csv").write_text("\n".join([f"{head},tool0.x,tool0.y,tool0.z", *filled]))
    done = run_cli("measurements", UR5, "m.csv")
    assert done.code == 0, done.err
    assert "25" in done.out


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ((*POINT, "-n", "5", "--until", "1mm"), "-n and --until both say how many poses"),
        ((*POINT, "--no-collisions", "--scene", "s.yaml"), "--scene is for collisions, which --no-collisions leaves out"),
        ((*POINT, "--scene", "none.yaml"), "none.yaml: cannot be read"),
        ((*POINT, "--speed", "0"), "--speed 0: expected"),
        ((*POINT, "--clearance-mm", "-1"), "a clearance of -1 mm: expected a number from 0 to 1000 mm"),
        (("--sensor", "socket:tool0"), "socket:tool0 touches"),
        ((*POINT, "--scene", "full.yaml"), "random poses is free"),
        ((*POINT, "--trajectory", "t.xml"), "expected .yaml (ROS 2), .script (URScript) or .csv (degrees)"),
        ((*POINT, "--until", "0.1"), "--until 0.1: expected a length with its unit, such as 0.1mm"),
        ((*POINT, "--check", "--criterion", "D"), "--check has a criterion and a number of its own; leave out --criterion"),
        ((*POINT, "--range-m", "5,1"), "--range-m 5,1: expected the least distance, from 0, and behind it the larger one"),
        (("--sensor", "laser", "--range-m", "1,5"), "acceptance and range are those of a tracker, and none reads here"),
        ((*POINT, "--acceptance-deg", "30"), "a tracker whose place is known, and none reads here; name its link with --reference"),
        ((*POINT, "--check", "-n", "20"), "-n 20: a check has 6 to 10 poses"),
        ((*POINT, "--limits", "l.yaml"), "l.yaml:1: joint 'elbow_joint': 10 to 5 deg leaves no room"),
        (("--board", "tool0=9x6:25mm"), "name the camera's lens with --camera CAMERA.yaml"),
        (("--sensor", "point:tool0@leica"), "no instrument or link named 'leica'"),
    ],
)
def test_what_cannot_be_planned_is_refused(run_cli: Run, tmp_path: Path, words: tuple[str, ...], said: str) -> None:
    """One line, exit code 2, nothing written."""
    (tmp_path / "full.yaml").write_text("boxes: {wall: {size_mm: [9000, 9000, 9000]}}\nlink: world\n")
    (tmp_path / "l.yaml").write_text("deg: {elbow_joint: [10, 5]}\n")
    done = run_cli("poses", UR5, "-o", "p.csv", "--candidates", "40", *words)
    assert said in done.err
    assert done.code == 2
    assert not (tmp_path / "p.csv").exists()
