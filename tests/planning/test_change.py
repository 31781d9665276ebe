"""What check poses are said to show of a change."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

from urdfcal.model.options import ModelOptions
from urdfcal.planning.change import changing, detected_mm
from urdfcal.planning.measuring import Asked, ReadWith, measuring, whitened
from urdfcal.planning.plan import plan_poses
from urdfcal.robot.robot import Robot


def test_changes_are_shown_as_often_as_said(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Of random changes that move the tool by what is said, nine of ten raise an alarm that few no change does, the tracker set anew."""
    robot = robots["ur5"]
    plan = plan_poses(robot, candidates=200, check=True, sensors=["point:tool0"])
    assert len(plan) == 8
    made = measuring(robot, Asked(["point:tool0"]), ModelOptions(), np.random.default_rng(0))
    H = whitened(made, plan.q, ReadWith())
    joint = np.array([parameter.kind == "joint" for parameter in made.errors.parameters])
    M = np.eye(len(joint)) + 0.3 * np.diag(joint.astype(float))
    size = detected_mm(made.errors, H, M, np.random.default_rng(1)) * 1e-3
    rows = H.reshape(-1, len(joint))
    rows = rows[np.any(rows != 0, axis=1)]
    other = rows[:, ~joint]
    q, _ = np.linalg.qr(other)
    freedom = len(rows) - other.shape[1]
    changes = rng.normal(size=(3000, joint.sum())) * changing(made.errors)[joint]
    changes *= size / np.sqrt(1.3 * np.sum(changes**2, axis=1))[:, None]

    def alarms(moved: np.ndarray) -> float:
        seen = moved + rng.normal(size=(len(moved), len(rows))) - rng.normal(size=(len(moved), len(rows)))
        left = (seen - (seen @ q) @ q.T) / np.sqrt(2)
        return float(np.mean(np.sum(left**2, axis=1) > chi2.ppf(0.99, freedom)))

    assert alarms(np.zeros((3000, len(rows)))) == pytest.approx(0.01, abs=0.006)
    assert alarms(changes @ rows[:, joint].T) == pytest.approx(0.9, abs=0.03)


def test_check_poses_show_smaller_changes_than_random_ones(robots: dict[str, Robot]) -> None:
    """What eight chosen poses show is less than what eight random ones do."""
    chosen = plan_poses(robots["ur5"], candidates=200, check=True, sensors=["point:tool0"])
    drawn = [plan_poses(robots["ur5"], candidates=8, n=8, check=True, sensors=["point:tool0"], seed=seed).detects_mm for seed in range(4)]
    assert chosen.detects_mm is not None
    assert chosen.detects_mm < min(size for size in drawn if size is not None)


def test_poses_that_tell_nothing_show_no_change(robots: dict[str, Robot]) -> None:
    """Where no reading moves with any joint there is no size of change that shows, and no number is given for one."""
    made = measuring(robots["ur5"], Asked(["point:tool0"]), ModelOptions(), np.random.default_rng(0))
    p = len(made.errors.names)
    assert detected_mm(made.errors, np.zeros((8, 3, p)), np.eye(p), np.random.default_rng(1)) == np.inf
