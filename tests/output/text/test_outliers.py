"""Outliers as a short table with a count."""

from __future__ import annotations

import numpy as np

from urdfcal.api import fit
from urdfcal.base.geometry import MM
from urdfcal.base.terminal import as_text
from urdfcal.calibration.error_table import rms_of
from urdfcal.calibration.outliers import Outlier
from urdfcal.calibration.reach import draw_poses
from urdfcal.output.text.outliers import outlier_blocks, outlier_groups, short_pose
from urdfcal.output.text.result import calibration_json, text_report
from urdfcal.robot.robot import Robot
from urdfcal.simulation.readings import SimulatedNoise, simulate
from urdfcal.simulation.truth import random_truth


def test_outliers_of_one_laser_and_reason_are_one_row() -> None:
    """A row has the count, the median and the largest distance, and the pose of that; what has no distance is counted alone."""
    outliers = [Outlier(f"pose {number}", "laser_1", float(number), "") for number in (1, 2, 9)]
    outliers += [Outlier("pose 4", "laser_1", None, "", "missed"), Outlier("pose 5", "laser_2", 300.0, "", "exchanged")]
    rows = [group.cells() for group in outlier_groups(outliers)]
    assert rows == [
        ("laser_1", "far off", "3", "2", "9", "pose 9"),
        ("laser_1", "misses the screen", "1", "", "", "pose 4"),
        ("laser_2", "exchanged", "1", "300", "300", "pose 5"),
    ]


def test_a_pose_is_named_without_its_folder() -> None:
    """What is before the file's name has no room in a table."""
    assert short_pose("/some/where/arm.csv:17", "/some/where/arm.csv") == "arm.csv:17"
    assert short_pose("arm.csv:17", "arm.csv") == "arm.csv:17"
    assert short_pose("pose 17", "") == "pose 17"


def test_many_outliers_take_few_lines_and_machines_have_each(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """20 outliers of the fit and 5 of the test are two rows each; test figures are of all readings, and trimmed ones stand beside."""
    robot = robots["panda"]
    errors, truth = random_truth(robot, rng, 1 * MM, 1e-3)
    data = simulate(robot, errors, truth, draw_poses(robot, errors, truth, 110, rng), rng, SimulatedNoise(0.5 * MM))
    spots = data.spots.copy()
    spots[:10] += 0.1 * rng.choice([-1, 1], (10, 2, 2))
    spots[-5:, 0] += 0.1
    data = data.with_spots(spots)
    found = fit(robot, data.subset(np.arange(110) < 80), test=data.subset(np.arange(110) >= 80))
    text, entries = as_text(outlier_blocks(found)), calibration_json(found)
    assert "20 of 160 readings" in " ".join(text.split())
    assert len(text.splitlines()) < 20
    assert len(entries["outliers"]) == 20
    assert len(entries["test_outliers"]) == 5
    assert entries["test"]["after"]["laser_1"]["n"] == 30
    assert entries["test_trimmed"]["after"]["laser_1"]["n"] == 25
    assert found.test is not None
    assert found.test_trimmed is not None
    assert rms_of(found.test[1]) > 30 > 3 > rms_of(found.test_trimmed[1])
    assert "test, trimmed" in text_report(found)
