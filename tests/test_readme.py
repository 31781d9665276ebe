"""What the README shows is run."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.conftest import CliResult
from tests.support.paths import ROOT
from urdfcal.calibration.rig_file import read_rig_file
from urdfcal.model.gauge import build_error_model
from urdfcal.robot.robot import Robot
from urdfcal.vision.camera.markers import read_screen_markers
from urdfcal.vision.render import usual_camera

README = (ROOT / "README.md").read_text("utf-8")


def blocks(language: str) -> list[str]:
    """Code blocks of a language."""
    return re.findall(rf"```{language}\n(.*?)```", README, re.DOTALL)


@pytest.fixture
def checkout(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder that has the checkout's robots and nothing else."""
    (tmp_path / "robots").symlink_to(ROOT / "robots")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("block", blocks("python"))
def test_python_blocks_run(block: str, checkout: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Every Python block runs as it stands."""
    exec(compile(block, "README.md", "exec"), {})
    assert "joint1.d_a" in capsys.readouterr().out
    assert (checkout / "arm7_calibrated.urdf").exists()


@pytest.mark.parametrize("block", blocks("yaml"))
def test_rig_blocks_are_taken(block: str, tmp_path: Path, robots: dict[str, Robot]) -> None:
    """Every rig.yaml in the README is read and fits arm7."""
    path = tmp_path / "rig.yaml"
    path.write_text(block)
    errors = build_error_model(robots["arm7"].chain, robots["arm7"].rig, read_rig_file(path).options())
    assert "joint2.d_a" not in errors.names


def test_the_screen_block_is_taken(tmp_path: Path) -> None:
    """The screen.yaml in the README is read."""
    (block,) = blocks("yaml screen.yaml")
    (tmp_path / "screen.yaml").write_text(block)
    assert len(read_screen_markers(tmp_path / "screen.yaml").centres) == 4


def test_the_line_without_hardware_runs(checkout: Path, run_cli: Callable[..., CliResult], monkeypatch: pytest.MonkeyPatch) -> None:
    """Simulated poses become pictures, pictures spots, and spots a calibrated URDF, as the README has it, on a quarter of the pixels."""
    monkeypatch.setattr(usual_camera, "_SIZE", (840, 630))  # on fewer than that most spots are lost, and too few numbers are left
    monkeypatch.setattr(usual_camera, "_FOCAL", 787.5)
    (block,) = (block for block in blocks("bash") if "tried without hardware" in block)
    for line in block.splitlines():
        done = run_cli(*line.partition("#")[0].split()[1:])
        assert done.code == 0, done.err
    assert (checkout / "arm7_calibrated.urdf").exists()


def test_the_output_shown_is_the_output(run_cli: Callable[..., CliResult]) -> None:
    """The tables printed under the first command are what it prints today."""
    done = run_cli("fit", ROOT / "robots" / "arm7" / "arm7.urdf.xacro", ROOT / "robots" / "arm7" / "measurements.csv")
    printed = [line.rstrip() for line in done.out.splitlines()]
    shown = re.search(r"and prints\n\n(.*?)\n\nA sigma", README, re.DOTALL)
    assert shown
    lines = [line.removeprefix("    ").rstrip() for line in shown[1].splitlines()]
    missing = [line for line in lines if line and line != "..." and line not in printed]
    assert missing == []


def test_every_command_is_in_the_table(run_cli: Callable[..., CliResult]) -> None:
    """The README's table of commands has every command of --help."""
    listed = re.search(r"Commands:\n(.*)", run_cli("--help").out, re.DOTALL)
    assert listed
    commands = set(re.findall(r"^  (\w+) ", listed[1], re.MULTILINE)) - {"version"}
    assert commands == set(re.findall(r"^\| `urdfcal (\w+)", README, re.MULTILINE))
