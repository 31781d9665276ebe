"""Residuals of every sensor's readings, and which of them are suspected."""

from __future__ import annotations

import math
import re
from dataclasses import replace

import numpy as np
import pytest

from tests.support.sensor_cases import CASES, NOISE, SensorCase, setup_of
from urdfcal.api import Calibration, fit
from urdfcal.base.geometry import MM
from urdfcal.calibration.problem import Problem
from urdfcal.output.report.content import report_of
from urdfcal.output.report.html import page
from urdfcal.output.report.residuals import residuals_of
from urdfcal.output.report.suspects import suspect_limit
from urdfcal.robot.rig import Grid
from urdfcal.robot.robot import Robot
from urdfcal.simulation.readings import simulate_readings


def calibrated(case: SensorCase, robots: dict[str, Robot], poses: int = 40) -> Calibration:
    """A fit of simulated readings."""
    rng = np.random.default_rng(4)
    setup = setup_of(case, robots, rng)
    return fit(setup.robot, simulate_readings(setup, poses, rng, NOISE), evidence=False)


@pytest.fixture(scope="module")
def every_kind(robots: dict[str, Robot]) -> Calibration:
    """Lasers and all kinds of targets in one fit."""
    return calibrated(CASES["every kind"], robots)


def test_arrows_of_a_map_end_where_the_robot_has_what_was_read(every_kind: Calibration) -> None:
    """A mark less its residual is the predicted spot on the screen, or the target's place in the measuring frame."""
    problem = Problem(every_kind.errors, every_kind.data)
    channels = {channel.block.name: index for index, channel in enumerate(problem.channels)}
    views, read = problem.views(every_kind.x), problem.read(every_kind.x)
    drawn = [own for own in residuals_of(every_kind) if own.places is not None]
    assert {own.sensor.name for own in drawn} == {"spot", "point", "socket"}
    for own in drawn:
        index = channels[own.name]
        predicted = read[index] if own.sensor.beam else views[index].p
        np.testing.assert_allclose(own.places[1] - own.after, predicted[own.rows] / MM, rtol=0, atol=1e-6)


def test_components_name_every_number(every_kind: Calibration) -> None:
    """As many letters as numbers, or none."""
    for own in residuals_of(every_kind):
        assert len(own.sensor.components) in (0, own.sensor.numbers)
        assert own.before.shape == own.after.shape == own.sigma.shape == (len(own.rows), own.sensor.numbers)
        assert own.places is None or own.places.shape == (2, *own.after.shape)


def test_the_corners_of_a_board_are_one_set(robots: dict[str, Robot]) -> None:
    """They have one name, one row in the tables and one picture of components; no id of the page stands twice."""
    link = "panda_link8"
    apart = calibrated(SensorCase("panda", (f"point:{link}:0", f"point:{link}:1")), robots)
    board = replace(apart, data=replace(apart.data, boards={link: Grid(2, 1, 0.03)}))
    (one, other), (whole,) = residuals_of(apart), residuals_of(board)
    assert whole.name == link
    np.testing.assert_array_equal(whole.after, np.concatenate([one.after, other.after]))
    assert whole.places is not None
    assert whole.places.shape == (2, len(one.rows) + len(other.rows), 3)
    ids = re.findall(r'\bid="([^"]+)"', page(report_of(board, []), board))
    assert len(ids) == len(set(ids))


def test_the_limit_of_a_pair_has_a_closed_form(every_kind: Calibration) -> None:
    """A pair is longer than t with probability exp(-t^2 / 2); more numbers have a higher limit, and none are never suspected."""
    sets = residuals_of(every_kind)
    readings = sum(len(own.rows) for own in sets)
    assert suspect_limit(sets, 2) == pytest.approx(max(4.0, math.sqrt(2 * math.log(10 * readings))), rel=1e-9)
    assert suspect_limit([], 2) == pytest.approx(4.0, rel=1e-9)
    assert suspect_limit(sets, 1) < suspect_limit(sets, 2) < suspect_limit(sets, 3) < suspect_limit(sets, 0)
