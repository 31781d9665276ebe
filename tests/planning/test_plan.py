"""Poses that are worth measuring: what is promised of them, and that they are better ones."""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest

import urdfcal
from urdfcal.base.errors import ShapeMismatch, UsageError
from urdfcal.estimation.gains import gains
from urdfcal.planning.criteria import Traced
from urdfcal.planning.plan import plan_poses
from urdfcal.planning.selection import exchanged, expected, greedy
from urdfcal.robot.robot import Robot
from urdfcal.sensors.spots import beams_at


def test_a_gain_is_what_the_posterior_loses(rng: np.random.Generator) -> None:
    """What a candidate is said to gain is what is lost of tr(P M) when the information matrices are added up and inverted."""
    H, sigma, root = rng.normal(size=(5, 2, 4)), rng.uniform(0.5, 2, 4), rng.normal(size=(4, 4))
    M, before = root @ root.T, np.diag(sigma**-2) + H[3].T @ H[3]
    P = np.linalg.inv(before)
    after = [np.trace(np.linalg.inv(before + own.T @ own) @ M) for own in H]
    np.testing.assert_allclose(gains(H, P, M), np.trace(P @ M) - after, rtol=1e-10)


def test_the_best_is_taken_pose_after_pose(rng: np.random.Generator) -> None:
    """Each choice is the best of those left by trying every one, none is taken twice, and what is left is that of the chosen together."""
    H, M = rng.normal(size=(8, 1, 3)), np.diag([1.0, 2.0, 0.5])
    by = Traced(np.ones(3), M)
    chosen, left = greedy(H, by, 4)
    for count in range(4):
        tried = [expected(H, by, np.append(chosen[:count], row)) for row in range(8) if row not in chosen[:count]]
        assert left[count + 1] == pytest.approx(min(tried))
    assert len(set(chosen.tolist())) == 4
    assert left[0] == pytest.approx(np.trace(M))


def test_exchanges_are_never_worse_and_find_what_trying_all_finds(rng: np.random.Generator) -> None:
    """From any choice an exchange leaves no more, what was measured before counted; of few candidates it mostly ends at the best set."""
    best = 0
    for _ in range(20):
        H, root = rng.normal(size=(9, 1, 4)), rng.normal(size=(4, 4))
        by, known, begun = Traced(np.ones(4), root @ root.T), H[0].T @ H[0], rng.choice(9, 4, replace=False)
        chosen, left = exchanged(H, by, begun, known)
        assert left[-1] <= expected(H, by, begun, known) * (1 + 1e-12)
        assert left[-1] == pytest.approx(expected(H, by, chosen, known))
        assert len(set(chosen.tolist())) == 4
        best += left[-1] <= min(expected(H, by, np.array(rows), known) for rows in combinations(range(9), 4)) * (1 + 1e-9)
    assert best >= 15


def test_a_plan_completes_what_was_measured(robots: dict[str, Robot]) -> None:
    """With poses that were measured before, fewer are left to be gained, and the plan starts from what they leave."""
    first = plan_poses(robots["ur5"], candidates=150, n=6, sensors="point:tool0")
    second = plan_poses(robots["ur5"], candidates=150, n=6, sensors="point:tool0", have=first.q)
    assert second.tool_sigma_mm[0] == pytest.approx(first.tool_sigma_mm[-1], rel=0.2)
    assert second.tool_sigma_mm[-1] < first.tool_sigma_mm[-1]


def test_what_is_predicted_of_a_plan_is_what_check_says(robots: dict[str, Robot]) -> None:
    """The accuracy promised after lasers' poses is that of `OnlineCalibrator` once it has taken them from the nominal robot."""
    robot = robots["panda"]
    workspace = np.random.default_rng(1).uniform(-1, 1, (40, 7))
    plan = plan_poses(robot, candidates=300, n=12, workspace=workspace, spot_sigma=5e-4)
    calibrator = urdfcal.OnlineCalibrator(robot, spot_sigma=5e-4, workspace=workspace)
    state = calibrator.update(urdfcal.measurements_from(robot, plan.q, beams_at(calibrator.errors, calibrator.errors.mean, plan.q).spots))
    assert plan.tool == calibrator.tool
    assert state.tool_sigma_mm == pytest.approx(plan.tool_sigma_mm[-1], rel=1e-3)


@pytest.mark.parametrize("sensors", [["pose:tool0"], ["point:tool0", "distance:tool0:bar"], ["laser"]])
def test_chosen_poses_are_better_than_random_ones(robots: dict[str, Robot], sensors: list[str]) -> None:
    """What is left after the chosen poses falls with each, ends under what random ones leave, and they are among the candidates."""
    plan = plan_poses(robots["ur5"], candidates=200, n=10, sensors=sensors)
    assert (np.diff(plan.tool_sigma_mm) < 0).all()
    assert plan.tool_sigma_mm[-1] < plan.at_random_mm
    given = plan_poses(robots["ur5"], candidates=plan.q, n=10, sensors=sensors)
    assert sorted(given.chosen.tolist()) == list(range(10))
    assert len(repr(plan)) < 200


def test_what_cannot_be_planned_is_said(robots: dict[str, Robot]) -> None:
    """More poses than candidates, candidates of other joints, and touches are refused in one line."""
    robot = robots["ur5"]
    with pytest.raises(UsageError, match="expected n from 1 to 5, the number of candidates, found 6"):
        plan_poses(robot, candidates=np.zeros((5, 6)), n=6, sensors=["point:tool0"])
    with pytest.raises(ShapeMismatch, match=r"candidates have shape \(5, 7\), expected finite \(m, 6\), for shoulder_pan_joint"):
        plan_poses(robot, candidates=np.zeros((5, 7)), n=2, sensors=["point:tool0"])
    with pytest.raises(ShapeMismatch, match=r"limits have shape \(3, 6\), expected \(2, 6\)"):
        plan_poses(robot, candidates=50, n=2, sensors=["point:tool0"], limits=np.zeros((3, 6)))
    with pytest.raises(UsageError, match="limits of elbow_joint: 1 to -1 leave no room"):
        plan_poses(robot, candidates=50, n=2, sensors=["point:tool0"], limits=[[-1, -1, 1, -1, -1, -1], [1, 1, -1, 1, 1, 1]])
    with pytest.raises(UsageError, match="laser:laser_1@card: poses are planned for the robot's own lasers"):
        plan_poses(robot, sensors=["laser:laser_1@card"])
    with pytest.raises(UsageError, match="socket:tool0 touches"):
        plan_poses(robot, sensors=["socket:tool0"])
