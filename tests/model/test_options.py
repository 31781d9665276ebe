"""Options that commands share are on every command where they mean something."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.conftest import CliResult
from tests.support.paths import ROBOTS_DIR

COMMON = {"--xacro-arg", "--package-dir", "--screen", "--laser", "--seed", "--json", "--quiet", "--verbose"}
WITHOUT_CHANCE = {"evaluate", "dh"}  # nothing in them is drawn at random
COMMANDS = ("fit", "evaluate", "check", "dh", "simulate", "paper", "apply")


@pytest.mark.parametrize("command", COMMANDS)
def test_common_options_are_everywhere(command: str, run_cli: Callable[..., CliResult]) -> None:
    """Every command on a robot takes the common options; a seed where something is drawn."""
    found = set(re.findall(r"^  .*?(--[a-z-]+)", run_cli(command, "--help").out, re.MULTILINE))
    assert COMMON - found == ({"--seed"} if command in WITHOUT_CHANCE else set())


def test_the_paper_takes_a_robot_with_arguments(run_cli: Callable[..., CliResult], tmp_path: Path) -> None:
    """`paper` hands its robot options on: an unknown xacro argument or laser is refused, and -v says which arm it is."""
    arm7 = ROBOTS_DIR / "arm7" / "arm7.urdf.xacro"
    done = run_cli("paper", arm7, "--runs", "1", "--xacro-arg", "nothing:=1")
    assert (done.code, done.err.endswith("takes no xacro argument 'nothing'\n")) == (2, True)
    assert (run_cli("paper", arm7, "--runs", "1", "--laser", "laser_9", "-v")).code == 2


def test_dh_names_what_the_rig_lacks(run_cli: Callable[..., CliResult], tmp_path: Path) -> None:
    """A calibrated joint of the rig that the robot no longer has is named, unless -q is given."""
    from tests.support.small_robot import URDF

    (tmp_path / "small.urdf").write_text(URDF)
    assert run_cli("simulate", "small.urdf", "-o", "m.csv", "--poses", "10", "-q").code == 0
    record = (tmp_path / "m_truth.yaml").read_text()
    (tmp_path / "m_truth.yaml").write_text(record.replace("slm_mount:", "old_mount:"))
    done = run_cli("dh", "small.urdf", "--calibration", "m_truth.yaml")
    assert (done.code, "small.urdf has no joint old_mount of the measuring rig" in done.err) == (0, True)
    assert run_cli("dh", "small.urdf", "--calibration", "m_truth.yaml", "-q").err == ""
