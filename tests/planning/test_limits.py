"""Narrower limits from a file: they hold, in the units that are named, and nothing else is taken."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.support.small_robot import URDF, robot_of
from urdfcal.base.errors import InputError
from urdfcal.planning.limits import read_limits
from urdfcal.robot.configurations import joint_limits
from urdfcal.robot.robot import Robot


@pytest.fixture
def robot(tmp_path: Path) -> Robot:
    """Two turns and a slide."""
    return robot_of(URDF, str(tmp_path / "small.urdf"))


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("l.yaml", "deg: {turn: [-30, 20]}\nmm: {slide: [10, 60]}\n"),
        ("l.yaml", "rad: {turn: [-0.5235987755982988, 0.3490658503988659]}\nm: {slide: [0.01, 0.06]}\n"),
        ("l.csv", "joint,lower,upper,unit\nturn,-30,20,deg\nslide,10,60,mm\n"),
        ("l.csv", "joint;lower;upper;unit\nslide;0,01;0,06;m\nturn;-30;20;deg\n"),
    ],
)
def test_limits_are_narrowed(robot: Robot, tmp_path: Path, name: str, text: str) -> None:
    """In degrees and radians, millimetres and metres, YAML and CSV; a joint that is not named keeps its own."""
    (tmp_path / name).write_text(text)
    own, names = joint_limits(robot), robot.chain.input_names
    found = read_limits(tmp_path / name, robot)
    assert np.allclose(found[:, names.index("turn")], np.radians([-30, 20]))
    assert np.allclose(found[:, names.index("slide")], [0.01, 0.06])
    assert np.array_equal(found[:, names.index("lift")], own[:, names.index("lift")])


def test_limits_never_widen(robot: Robot, tmp_path: Path) -> None:
    """Beyond what the robot has they are the robot's."""
    (tmp_path / "l.yaml").write_text("deg: {turn: [-9000, 9000]}\n")
    assert np.array_equal(read_limits(tmp_path / "l.yaml", robot), joint_limits(robot))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("deg: {tern: [-30, 20]}", "l.yaml:1: no measured joint named 'tern' .* did you mean 'turn'"),
        ("mm: {turn: [-30, 20]}", "joint 'turn' turns: found mm, expected deg or rad"),
        ("deg: {slide: [0, 1]}", "joint 'slide' slides: found deg, expected mm or m"),
        ("deg: {turn: [45, -30]}", "joint 'turn': 45 to -30 deg leaves no room in the robot's own limits"),
        ("deg: {turn: [0]}", "entry 'deg.turn"),
        ("deg: {turn: [0, .nan]}", "entry 'deg.turn"),
        ("degrees: {turn: [0, 1]}", "entry 'degrees' is unknown"),
        ("deg: {turn: [0, 1]}\nrad: {turn: [0, 1]}", "l.yaml:2: joint 'turn' stands twice"),
        ("[1, 2]", "holds a list, expected entries such as"),
    ],
)
def test_what_is_no_limit_is_refused(robot: Robot, tmp_path: Path, text: str, said: str) -> None:
    """In one line that names file and joint."""
    (tmp_path / "l.yaml").write_text(text)
    with pytest.raises(InputError, match=said):
        read_limits(tmp_path / "l.yaml", robot)


def test_a_table_without_units_is_refused(robot: Robot, tmp_path: Path) -> None:
    """Degrees or radians is for the file to say."""
    (tmp_path / "l.csv").write_text("joint,lower,upper\nturn,-30,20\n")
    with pytest.raises(InputError, match="column 'unit': is missing"):
        read_limits(tmp_path / "l.csv", robot)
    (tmp_path / "l.csv").write_text("joint,lower,upper,unit\nturn,-30,20,\n")
    with pytest.raises(InputError, match="found unit '', expected deg, rad, mm, m"):
        read_limits(tmp_path / "l.csv", robot)


def test_broken_files_are_refused_in_one_line(robot: Robot, tmp_path: Path, rng: np.random.Generator) -> None:
    """Of files with bytes exchanged, left out or put in each is read, or refused by an error that names it."""
    good = {
        "l.yaml": b"deg: {turn: [-30, 20]}\nmm: {slide: [10, 60]}\n",
        "l.csv": b"joint,lower,upper,unit\nturn,-30,20,deg\nslide,10,60,mm\n",
    }
    refused: list[tuple[str, str]] = []
    for name, content in good.items():
        for _ in range(150):
            at, put = int(rng.integers(len(content))), bytes(rng.integers(0, 256, int(rng.integers(0, 3)), dtype=np.uint8))
            (tmp_path / name).write_bytes(content[:at] + put + content[at + int(rng.integers(0, 3)) :])
            try:
                found = read_limits(tmp_path / name, robot)
            except InputError as error:
                refused.append((name, str(error)))
            else:
                assert (found[1] > found[0]).all()
    assert len(refused) > 50
    assert all(name in said and "\n" not in said for name, said in refused)
