"""The paper's simulation, as far as its own figures can be expected."""

from __future__ import annotations

import json
from collections.abc import Callable

import numpy as np
import pytest

from tests.conftest import CliResult
from urdfcal.base.terminal import as_text
from urdfcal.model.gauge import build_error_model
from urdfcal.model.options import ModelOptions
from urdfcal.output.text.paper import paper_json, study_blocks
from urdfcal.robot.robot import Robot
from urdfcal.simulation.paper import Line, Repeated, repeat
from urdfcal.simulation.study import SECTION_4, Study, cases, paper_poses, paper_truth


@pytest.fixture(scope="module")
def repeated(robots: dict[str, Robot]) -> Repeated:
    """One draw."""
    return repeat(robots["arm7"], SECTION_4, runs=1, seed=1)


@pytest.fixture(scope="module")
def lines(repeated: Repeated) -> list[Line]:
    """Its tables."""
    return repeated.lines


def test_the_command_prints_both_tables_wherever_it_is_called_from(
    repeated: Repeated, monkeypatch: pytest.MonkeyPatch, run_cli: Callable[..., CliResult]
) -> None:
    """`paper` without an argument finds its arm, that of the paper, from a folder without robots, and prints every line."""
    asked: list[str] = []

    def tables(robot: Robot, study: Study, runs: int, seed: int, advance: object) -> Repeated:
        asked.append(f"{robot.name}, section {study.section}, {runs} run, seed {seed}")
        return repeated

    monkeypatch.setattr("urdfcal.simulation.paper.repeat", tables)
    done = run_cli("paper", "--runs", "1", "--json")
    assert (done.code, done.err, asked) == (0, "", ["arm7, section 4, 1 run, seed 0"])
    assert len(json.loads(done.out)["lines"]) == len(repeated.lines) == 35


def mean_to_true(lines: list[Line], protocol: str, estimator: str, case: int, poses: str) -> float:
    """Mean distance to the noise-free spot over both lasers, [mm]."""
    found = [line for line in lines if (line.protocol, line.estimator, line.case, line.poses) == (protocol, estimator, case, poses)]
    return float(found[0].to_true[:, 0].mean())


def test_poses_are_the_papers(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """30 poses within 10 deg of home with joint 4 not positive, 30 within the limits of Table I."""
    robot = robots["arm7"]
    errors = build_error_model(robot.chain, robot.rig, ModelOptions(error_model="dh"))
    q = np.degrees(paper_poses(robot, errors, paper_truth(errors), rng))
    assert q.shape == (60, 7)
    assert np.abs(q[:30]).max() <= 10
    assert q[:, 3].max() <= 0
    assert (q >= [-180, -10, -10, -120, -90, -30, -30]).all()
    assert (q <= [90, 90, 30, 0, 90, 30, 30]).all()


def test_cases_share_the_poses_as_section_iv_says() -> None:
    """Case 1 calibrates near home and tests wide, case 2 halves both, case 3 takes all."""
    rows = {(case, name): mask for case, name, mask in cases()}
    assert [int(mask.sum()) for mask in rows.values()] == [30, 30, 30, 30, 60]
    assert (rows[1, "fit"] ^ rows[1, "test"]).all()
    assert rows[2, "fit"][:30].sum() == rows[2, "fit"][30:].sum() == 15


def test_table_ii_is_of_the_published_size(lines: list[Line]) -> None:
    """Before calibration the poses near home are off by what the paper prints: 84 mm and 16 mm, within a quarter."""
    before = next(line for line in lines if not line.estimator and (line.case, line.poses) == (1, "fit"))
    np.testing.assert_allclose(before.to_true[:, 0], [84.06, 15.94], rtol=0.25)


def test_the_published_accuracy_needs_averaged_readings(lines: list[Line]) -> None:
    """With the mean of 100 readings case 3 comes out as published (about 0.1 mm), with one reading ten times worse."""
    averaged = mean_to_true(lines, "mean of 100", "EKF", 3, "fit")
    assert 0.05 < averaged < 0.2
    assert 5 < mean_to_true(lines, "one reading", "EKF", 3, "fit") / averaged < 20


def test_poses_over_the_whole_workspace_generalise(lines: list[Line]) -> None:
    """As the paper concludes, calibrating near home alone (case 1) predicts wide poses far worse than case 2."""
    assert mean_to_true(lines, "mean of 100", "EKF", 1, "test") > 3 * mean_to_true(lines, "mean of 100", "EKF", 2, "test")


def test_the_tables_hold_published_and_own_figures(repeated: Repeated) -> None:
    """Both reports name every case and the published figures; nothing is cut off."""
    text = as_text(study_blocks(repeated))
    assert "0.12/0.04/0.23" in text
    assert "84.1/4.54/96.0" in text
    assert "…" not in text
    assert len(paper_json([repeated])["lines"]) == 5 + 2 * 3 * 5
