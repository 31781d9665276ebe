"""What a posterior says of the parameters and their sums."""

from __future__ import annotations

import numpy as np
import pytest

from urdfcal.api import fit
from urdfcal.calibration.reach import draw_poses
from urdfcal.estimation.identifiability import identify
from urdfcal.model.gauge import build_error_model
from urdfcal.model.options import ModelOptions
from urdfcal.robot.robot import Robot
from urdfcal.simulation.readings import SimulatedNoise, simulate


def test_a_sum_is_determined_where_its_terms_are_not() -> None:
    """Data that see only a + b determine that sum, not a, not b, and not a - b; c stands alone."""
    H = np.array([[1.0, 1.0, 0.0], [0.0, 0.0, 1.0]]) / 0.01
    P = np.linalg.inv(np.eye(3) + H.T @ H)
    found = identify(["a", "b", "c"], np.array([0.2, 0.3, 0.5]), P, np.ones(3))
    assert found.determined == (False, False, True)
    assert found.rank == 2
    by_words = {combination.words(): combination for combination in found.combinations}
    assert set(by_words) == {"a + b", "a - b"}
    assert by_words["a + b"].determined
    assert not by_words["a - b"].determined
    assert by_words["a + b"].value == pytest.approx(0.5)
    assert by_words["a + b"].sigma == pytest.approx(0.01, rel=1e-3)


@pytest.mark.parametrize("wide", [2.0, 10.0, 30.0])
def test_a_narrow_prior_of_its_partner_determines_nothing(wide: float) -> None:
    """No term of a sum that is determined alone is called determined, though its partner's prior puts it far under its own."""
    H = np.array([[1.0, 1.0, 0.0], [0.0, 0.0, 1.0]]) / 0.01
    P = np.linalg.inv(np.diag([1.0, wide**-2.0, 1.0]) + H.T @ H)
    found = identify(["narrow", "wide", "own"], np.zeros(3), P, np.array([1.0, wide, 1.0]))
    assert found.left[1] == pytest.approx(1 / np.hypot(1, wide), rel=1e-3)
    assert [set(each.terms) for each in found.combinations if each.determined] == [{"narrow", "wide"}]
    assert found.determined == (False, False, True)


def test_what_the_data_say_of_a_term_counts() -> None:
    """A parameter that the data tell by itself is determined, and no term of the sum that it leaks into a little."""
    H = np.array([[1.0, 1.0, 0.03], [0.0, 0.0, 1.0]]) / np.array([[0.01], [0.1]])
    P = np.linalg.inv(np.eye(3) + H.T @ H)
    found = identify(["a", "b", "c"], np.zeros(3), P, np.ones(3))
    assert found.determined == (False, False, True)
    assert [set(each.terms) for each in found.combinations if each.determined] == [{"a", "b"}]


def test_everything_determined_has_no_combinations() -> None:
    """Where the data decide every parameter nothing is grouped."""
    found = identify(["a", "b"], np.zeros(2), np.eye(2) * 1e-4, np.ones(2))
    assert (found.rank, found.determined, found.combinations) == (2, (True, True), ())


def test_the_four_joint_arm_has_two_hidden_directions(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """On arm4 under dh only joint1.d_d + joint2.d_d and joint4.d_d + slm.trans_z are seen, as the digest has it: rank 19 of 21."""
    robot = robots["arm4"]
    errors = build_error_model(robot.chain, robot.rig, ModelOptions(error_model="dh"))
    truth = rng.normal(0, 1e-3, len(errors.names))
    found = fit(
        robot, simulate(robot, errors, truth, draw_poses(robot, errors, truth, 60, rng), rng, SimulatedNoise(0.5e-3)), error_model="dh"
    )
    assert found.identifiability.rank == 19
    hidden = {name for name, determined in zip(errors.names, found.identifiability.determined, strict=True) if not determined}
    assert hidden == {"joint1.d_d", "joint2.d_d", "joint4.d_d", "slm.trans_z"}  # whose prior is the wider, so that joint4's decides it
    sums = [set(combination.terms) for combination in found.identifiability.combinations if combination.determined]
    assert {"joint1.d_d", "joint2.d_d"} in sums
    assert {"joint4.d_d", "slm.trans_z"} in sums
