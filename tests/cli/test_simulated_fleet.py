"""`urdfcal simulate --robots`: a folder of robots that `urdfcal fleet` takes as it is."""

from __future__ import annotations

import csv
import json
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import yaml

import urdfcal
from tests.conftest import CliResult
from tests.support.small_robot import URDF

Run = Callable[..., CliResult]
ASKED = ("--sensor", "point:tool", "--poses", "25", "--errors", "1mm,0.1deg")


@pytest.fixture
def small(tmp_path: Path) -> Path:
    """The folder of a description."""
    (tmp_path / "small.urdf").write_text(URDF)
    return tmp_path


def rows(folder: Path) -> list[dict[str, str]]:
    """Of a manifest."""
    lines = [line for line in (folder / "manifest.csv").read_text().splitlines() if not line.startswith("#")]
    return list(csv.DictReader(lines))


def test_a_robot_of_a_fleet_is_that_of_its_seed(run_cli: Run, small: Path) -> None:
    """Readings and truth of the second of two are those of `simulate` with the next seed, in Python, too; no robot is another."""
    assert run_cli("simulate", "small.urdf", "-o", "fleet/", "--robots", "2", "--seed", "7", *ASKED).code == 0
    assert run_cli("simulate", "small.urdf", "-o", "one.csv", "--seed", "8", *ASKED).code == 0

    def readings(file: str) -> list[str]:
        return [line for line in (small / file).read_text().splitlines() if not line.startswith("#")]

    def truth(file: str) -> str:
        return re.sub("(created|command): .*", "", (small / file).read_text())

    assert readings("fleet/robot2.csv") == readings("one.csv") != readings("fleet/robot1.csv")
    assert truth("fleet/robot2_truth.yaml") == truth("one_truth.yaml") != truth("fleet/robot1_truth.yaml")
    robot = urdfcal.load_robot("fleet/small.urdf")
    made = urdfcal.simulate(robot, 25, sensors=["point:tool"], errors=(1e-3, np.radians(0.1)), seed=8)
    read = urdfcal.read_measurements("fleet/robot2.csv", made.nominal)
    assert np.allclose(read.readings[0].values, made.measurements.readings[0].values, rtol=0, atol=1e-10)


def test_fleet_takes_the_manifest_as_it_is(run_cli: Run, small: Path) -> None:
    """Also from another folder, and of pixels: lens and boards are named there; every robot comes near to its truth."""
    (small / "rig.yaml").write_text("boards: {tool: '3x3:40mm'}\n")
    words = ("--rig", "rig.yaml", "--poses", "22", "--errors", "2mm,0.2deg")
    done = run_cli("simulate", "small.urdf", "-o", "pixels", "--robots", "2", *words, "--json")
    assert json.loads(done.out) == {"folder": "pixels", "manifest": "pixels/manifest.csv", "robots": 2, "poses": 22}
    assert [row["options"] for row in rows(small / "pixels")] == ["--rig rig.yaml --camera camera.yaml"] * 2
    assert yaml.safe_load((small / "pixels" / "rig.yaml").read_text())["boards"] == {"tool": "3x3:40mm"}
    (small / "pixels").rename(small / "moved")
    done = run_cli("fleet", "moved/manifest.csv", "-o", "out", "--workers", "1", "--fit", "--no-sag", "--json")
    assert done.code == 0, done.err
    robots = json.loads(done.out)["robots"]
    assert [row["name"] for row in robots] == ["robot1", "robot2"]
    assert all(0.15 < row["after_px"] < min(0.3, row["before_px"]) for row in robots)  # two coordinates of 0.2 px each


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("-o", "-"), "-o -: --robots makes a folder with a file of measurements a robot"),
        (("-o", "fleet.csv"), "-o fleet.csv: --robots makes a folder"),
        (("-o", "."), "is not empty; name a new folder"),
        (("-o", "small.urdf"), "small.urdf: is a file, expected a folder"),
        (("-o", "no/fleet"), "no/fleet: the folder no does not exist"),
        (("-o", "fleet", "--errors", "nonsense"), "nonsense"),
        (("-o", "fleet", "--screen-size-m", "0.001", "--sensor", "laser"), "screen"),
    ],
)
def test_what_makes_no_fleet_is_refused(run_cli: Run, small: Path, words: tuple[str, ...], said: str) -> None:
    """One line, exit code 2, and nothing written, also where the first robot turns out impossible."""
    done = run_cli("simulate", "small.urdf", "--robots", "2", "--poses", "5", *words)
    assert (done.code, done.err.count("\n")) == (2, 1), done
    assert said in done.err
    assert [path.name for path in small.iterdir()] == ["small.urdf"]


def test_what_bends_the_robots_is_told_to_the_fit(run_cli: Run, small: Path) -> None:
    """Payloads and the way down are options of every robot, and so is a reference that is known."""
    soft = ("--sag-mrad", "1", "--payload", "2@tool", "--gravity", "0,0,-1")
    words = ("--sensor", "point:tool", "--reference", "base", "--reference-known", "--poses", "3")
    assert run_cli("simulate", "small.urdf", "-o", "fleet", "--robots", "2", *words, *soft).code == 0
    assert [row["options"] for row in rows(small / "fleet")] == ["--rig rig.yaml --payload 2@tool --gravity 0,0,-1"] * 2
    assert yaml.safe_load((small / "fleet" / "rig.yaml").read_text()) == {"reference": "base", "reference_known": True}
