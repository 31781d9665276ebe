"""Limits of 0 and 0, as CAD exporters write them: nothing is drawn from one configuration without a word."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.conftest import CliResult
from tests.support.small_robot import joint, robot_text

Run = Callable[..., CliResult]
MOVING = robot_text(
    joint("j1", "base", "a", '<origin xyz="0 0 0.3"/><axis xyz="0 0 1"/>'),
    joint("j2", "a", "b", '<origin xyz="0.1 0 0.2"/><axis xyz="0 1 0"/>'),
    joint("j3", "b", "tool", '<origin xyz="0.3 0 0.1"/><axis xyz="0 1 0"/>'),
    links="base a b tool",
).replace("9", "1.5")
STILL = re.sub(r'lower="-1.5" upper="1.5"', 'lower="0" upper="0"', MOVING)
SAME = "lower and upper limit of j1, j2, j3 are the same"
POINT = ("--sensor", "point:tool")


@pytest.fixture
def measured(run_cli: Run, tmp_path: Path) -> Path:
    """Both robots, and measurements of the one that moves."""
    (tmp_path / "moving.urdf").write_text(MOVING)
    (tmp_path / "still.urdf").write_text(STILL)
    assert run_cli("simulate", "moving.urdf", "-o", "m.csv", "--poses", "60", "--errors", "5mm,0.5deg", *POINT).code == 0
    return tmp_path


def numbers(entry: object) -> Iterator[float]:
    """Every number in a JSON entry."""
    if isinstance(entry, dict):
        for value in entry.values():
            yield from numbers(value)
    elif isinstance(entry, float):
        yield entry


@pytest.mark.parametrize("more", [(), ("--sag-mrad", "1")])
def test_no_poses_are_simulated_where_nothing_can_move(more: tuple[str, ...], run_cli: Run, measured: Path) -> None:
    """Simulate refuses a robot without a workspace and writes nothing; a joint that stands still is a warning."""
    run = run_cli("simulate", "still.urdf", "-o", "s.csv", *POINT, *more)
    assert (run.code, run.out, SAME in run.err, list(measured.glob("s*.csv"))) == (2, "", True, [])
    (measured / "one.urdf").write_text(MOVING.replace('lower="-1.5" upper="1.5"', 'lower="0" upper="0"', 1))
    run = run_cli("simulate", "one.urdf", "-o", "s.csv", *POINT)
    assert (run.code, "lower and upper limit of j1 are the same, so they stand still in all poses" in run.err) == (0, True)


def test_what_is_predicted_is_of_the_measured_range(run_cli: Run, measured: Path) -> None:
    """The prediction of a robot with limits 0 0 is within a tenth of that with the limits that were measured, and the reason is said."""
    found = {}
    for robot in ("moving", "still"):
        run = run_cli("fit", f"{robot}.urdf", "m.csv", "--tool", "tool", "--no-sag", "--json", "--force")
        assert (run.code, SAME in run.err) == (3, robot == "still")  # the tool in the base frame is not what a free tracker tells
        found[robot] = list(numbers(json.loads(run.out)["tool"]))
    assert len(found["still"]) >= 3
    assert found["still"] == pytest.approx(found["moving"], rel=0.1)


@pytest.mark.parametrize("command", [("check",), ("evaluate",), ("fit", "--no-sag", "--format", "offsets")])
def test_every_command_says_so_once(command: tuple[str, ...], run_cli: Run, measured: Path) -> None:
    """One line of stderr is about the limits where measurements are read; offsets add what their figures rest on."""
    run = run_cli(command[0], "still.urdf", "m.csv", *command[1:])
    lines = [line for line in run.err.splitlines() if SAME in line]
    assert (run.code, len(lines)) == (0, 2 if "offsets" in command else 1)
    assert "no wider one is suggested" in lines[0]
    assert "judged with these at one position" in lines[-1] or "offsets" not in command
