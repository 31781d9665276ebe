"""Which pose to measure next: the one that taking each of them in turn finds."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
import pytest

import urdfcal
from urdfcal.base.errors import ShapeMismatch, UsageError
from urdfcal.calibration.analysis.online import OnlineCalibrator
from urdfcal.robot.robot import Robot

KNOWN = {"laser": {"spot": 5e-4}, "point:tool0": {"point": 1e-4}, "inclination:tool0": {"inclination": 2e-4}}


@pytest.mark.parametrize("sensors", [["laser"], ["point:tool0", "inclination:tool0"]], ids=" and ".join)
def test_the_best_candidate_is_found_as_by_taking_each(robots: dict[str, Robot], sensors: list[str]) -> None:
    """The pose, and how sure the tool is said to be after it, are those of the filter that takes every candidate in turn."""
    data = urdfcal.simulate(robots["ur5"], 32, sensors=sensors, seed=3).measurements
    sigmas = {kind: sigma for sensor in sensors for kind, sigma in KNOWN[sensor].items()}
    calibrator = OnlineCalibrator(robots["ur5"], sigmas=sigmas, joint_sigma=1e-4)
    before = calibrator.update(data.subset(np.arange(10)))
    calibrator._stale = lambda belief: False  # type: ignore[method-assign]  # linearised where it is
    tried = [copy.deepcopy(calibrator).update(data.subset([row])).tool_sigma_mm for row in range(10, 32)]
    found = calibrator.next_pose(data.q)
    assert found.row == 10 + int(np.argmin(tried))
    assert np.array_equal(found.q, data.q[found.row])
    assert found.tool_sigma_mm == pytest.approx(min(tried), rel=1e-6)
    assert min(tried) < before.tool_sigma_mm < 1e3
    assert calibrator.state is before


def test_beams_beside_the_screen_tell_nothing(robots: dict[str, Robot]) -> None:
    """Before any pose was taken a laser robot is told where its beams meet the screen, and refused where none does."""
    calibrator, q = OnlineCalibrator(robots["ur5"], sigmas={"spot": 5e-4}), np.random.default_rng(0).uniform(-2, 2, (300, 6))
    best = calibrator.next_pose(q)
    state = calibrator.update(best.q, _spots(calibrator, best.q))
    assert state.tool_sigma_mm == pytest.approx(best.tool_sigma_mm, rel=1e-6)
    blind = np.array([row for row in q if not (np.abs(_spots(calibrator, row)) <= 1.5).all(axis=-1).any()])
    with pytest.raises(UsageError, match=rf"none of {len(blind)} candidates tells anything"):
        calibrator.next_pose(blind)


def _spots(calibrator: OnlineCalibrator, q: Any) -> Any:
    """Where the beams of the nominal robot meet the screen; far beside it where they do not."""
    from urdfcal.sensors.spots import beams_at

    beams = beams_at(calibrator.errors, calibrator.errors.mean, np.asarray(q)[None])
    return np.where(beams.makes_spot(nearest=0.1)[..., None], beams.spots, 1e3)[0]


def test_what_cannot_be_chosen_is_said(robots: dict[str, Robot]) -> None:
    """Candidates of other joints, of poses that were measured already, and before anything is placed are refused in a line."""
    data = urdfcal.simulate(robots["ur5"], 8, sensors=["pose:tool0"], seed=3).measurements
    calibrator = OnlineCalibrator(robots["ur5"])
    calibrator.update(data.subset([0]))
    with pytest.raises(
        UsageError, match=r"1 pose waits until tool0, the measuring frame can be placed.*; begin with poses that differ in every joint"
    ):
        calibrator.next_pose(data.q)
    calibrator.update(data.subset(np.arange(1, 8)))
    with pytest.raises(UsageError, match="none of 8 candidates tells anything"):
        calibrator.next_pose(data.q)
    with pytest.raises(ShapeMismatch, match=r"candidates have shape \(3, 7\), expected finite \(m, 6\)"):
        calibrator.next_pose(np.zeros((3, 7)))
    with pytest.raises(ShapeMismatch, match="candidates are no table of numbers"):
        calibrator.next_pose([[0.0, 1.0], [0.0]])
