"""Fixtures that many tests share."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from tests.support.paths import ROBOTS_DIR

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # the matrices are small, and the tests run side by side

import numpy as np
import pytest

from urdfcal.robot.robot import Robot, load_robot


class CliResult(NamedTuple):
    """What a command line left behind."""

    code: int
    out: str
    err: str


@pytest.fixture(scope="session")
def robots() -> dict[str, Robot]:
    """The robots that come with urdfcal, by name."""
    return {folder.name: load_robot(folder / f"{folder.name}.urdf.xacro") for folder in sorted(ROBOTS_DIR.iterdir()) if folder.is_dir()}


@pytest.fixture
def rng() -> np.random.Generator:
    """Seeded randomness."""
    return np.random.default_rng(20261122)


@pytest.fixture(scope="session")
def example_robots() -> Path:
    """The folder of example-robot-data's robot descriptions."""
    from urdfcal.robot.packages import find_package

    return find_package("example-robot-data") / "robots"


@pytest.fixture
def small_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    """The camera that `render` places where none is named has the same field of view on an eighth of its pixels."""
    from urdfcal.vision.render import usual_camera

    monkeypatch.setattr(usual_camera, "_SIZE", (560, 420))
    monkeypatch.setattr(usual_camera, "_FOCAL", 525.0)


@pytest.fixture
def run_cli(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> Callable[..., CliResult]:
    """Run the command line in this process, in an empty folder; what native code writes is caught too."""
    from urdfcal.cli.main import main

    monkeypatch.chdir(tmp_path)

    def run(*words: str | Path) -> CliResult:
        capfd.readouterr()
        monkeypatch.setattr(sys, "argv", ["urdfcal", *map(str, words)])
        with pytest.raises(SystemExit) as stop:
            main()
        out, err = capfd.readouterr()
        return CliResult(stop.value.code if isinstance(stop.value.code, int) else -1, out, err)

    return run
