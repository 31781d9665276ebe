"""`check`: what measurements can determine, against an SVD by another route."""

from __future__ import annotations

import json
from collections.abc import Callable

import numpy as np
import pytest

from tests.support.helpers import central_differences
from tests.support.paths import ROBOTS_DIR
from urdfcal.calibration.analysis.check import check
from urdfcal.calibration.problem import Problem
from urdfcal.calibration.reach import draw_poses
from urdfcal.estimation.identifiability import correlated_groups, indices, observe
from urdfcal.model.options import ModelOptions
from urdfcal.robot.robot import Robot, load_robot
from urdfcal.sensors.measurements import Measurements, spots_measured
from urdfcal.simulation.readings import true_spots
from urdfcal.simulation.truth import random_truth


def measured(robot: Robot, rng: np.random.Generator, poses: int = 60, limits: np.ndarray | None = None) -> Measurements:
    """Exact spots of the nominal robot."""
    model, zero = random_truth(robot, rng, 0.0, 0.0)
    q = draw_poses(robot, model, zero, poses, rng, limits=limits)
    return spots_measured(robot, q, true_spots(robot, model, zero, q))


def with_one_beam(name: str) -> Robot:
    """A robot of ours with its first laser alone."""
    return load_robot(ROBOTS_DIR / name / f"{name}.urdf.xacro", lasers=["laser_1"])


CASES = {
    "arm7 dh": ("arm7", False, ModelOptions(error_model="dh"), 33, 33),
    "arm7 dh, one beam": ("arm7", True, ModelOptions(error_model="dh"), 33, 31),
    "arm7 dh, screen": ("arm7", False, ModelOptions(error_model="dh", estimate=("screen",)), 34, 34),
    "arm4 dh": ("arm4", False, ModelOptions(error_model="dh"), 21, 19),
    "arm4 auto": ("arm4", False, ModelOptions(), 23, 22),
    "panda": ("panda", False, ModelOptions(), 34, 34),
    "panda, one beam": ("panda", True, ModelOptions(), 34, 32),
    "ur5": ("ur5", False, ModelOptions(), 30, 30),
    "ur5, one beam": ("ur5", True, ModelOptions(), 30, 28),
}


@pytest.mark.parametrize("case", CASES.values(), ids=CASES)
def test_rank_and_sigmas_are_those_of_another_route(robots: dict[str, Robot], case: tuple, rng: np.random.Generator) -> None:
    """The rank is that of a Jacobian by differences and its SVD; sigmas of what is seen agree within 5 %."""
    name, one_beam, options, count, rank = case
    robot = with_one_beam(name) if one_beam else robots[name]
    data = measured(robot, rng)
    found = check(robot, data, options=options)
    model = Problem(found.errors, data)
    J = central_differences(lambda x: np.stack(model.read(x), axis=1).ravel(), np.zeros(count)) / 1e-3 * found.errors.sigma
    _, values, rows = np.linalg.svd(J)
    assert (len(found.errors.names), found.observability.rank) == (count, rank)
    assert int(np.sum(values > 1e-7 * values[0])) == rank
    variance = np.sum(rows.T**2 / (1 + np.concatenate([values, np.zeros(count - len(values))]) ** 2), axis=1)
    np.testing.assert_allclose(found.sigma, np.sqrt(variance) * found.errors.sigma, rtol=0.05)


def test_both_hidden_sums_of_the_four_joint_arm_are_named(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """On arm4 under dh the two sums that the digest of the paper found by hand are put in words."""
    found = check(robots["arm4"], measured(robots["arm4"], rng), options=ModelOptions(error_model="dh"))
    assert {hidden.words() for hidden in found.observability.hidden} == {
        "only joint1.d_d + joint2.d_d moves the spots",
        "only joint4.d_d + slm.trans_z moves the spots",
    }


def test_a_second_beam_is_suggested_where_one_is_not_enough(rng: np.random.Generator) -> None:
    """With one beam two directions of the mount are hidden, and a second beam would determine them."""
    robot = with_one_beam("panda")
    best = check(robot, measured(robot, rng)).suggestions[0]
    assert "a second beam" in best.words
    assert {"slm.rot_y", "slm.rot_z"} <= set(best.determines)


def test_more_range_is_suggested_for_the_joint_that_stood_still(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Where one joint was never moved, moving it is the first suggestion among the joints."""
    robot = robots["panda"]
    from urdfcal.robot.configurations import joint_limits

    limits = joint_limits(robot)
    limits[:, 5] = 1.9, 1.91
    ranges = [
        suggestion.words for suggestion in check(robot, measured(robot, rng, limits=limits)).suggestions if "more range" in suggestion.words
    ]
    assert ranges[0].startswith("more range of panda_joint6")


def test_healthy_poses_need_no_more_range(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Poses over the whole workspace bring no suggestion to move a joint more."""
    assert not any("more range" in suggestion.words for suggestion in check(robots["panda"], measured(robots["panda"], rng)).suggestions)


def test_the_papers_rig_is_told_of_the_screens_yaw(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """On a rig whose base frame lies on the screen dh is told of the missing yaw, and no longer once it is estimated; auto has it."""
    data = measured(robots["arm7"], rng)

    def told(options: ModelOptions) -> bool:
        found = check(robots["arm7"], data, options=options)
        return any("--estimate screen" in suggestion.words for suggestion in found.suggestions)

    assert told(ModelOptions(error_model="dh"))
    assert not told(ModelOptions(error_model="dh", estimate=("screen",)))
    assert not told(ModelOptions())


def test_indices_are_their_definitions() -> None:
    """O1 to O5 of the singular values 4, 2, 1 from 4 poses."""
    found = indices(np.array([4.0, 2.0, 1.0]), 4)
    assert found == pytest.approx({"O1": 1.0, "O2": 0.25, "O3": 1.0, "O4": 0.25, "O5": 1 / 1.75})


def test_a_parameter_that_moves_nothing_is_named_alone() -> None:
    """A zero column is hidden by itself, and not mixed into sums."""
    H = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 1.0]])
    assert [hidden.words() for hidden in observe(["a", "b", "c"], H, np.ones(3), 3).hidden] == ["b moves no spot"]


def test_correlations_are_grouped() -> None:
    """Parameters linked by high correlations, also through others, are one group."""
    root = np.array([[1.0, 0, 0, 0], [1.0, 0.1, 0, 0], [1.0, 0.2, 0.1, 0], [0, 0, 0, 1.0]])
    assert correlated_groups(["a", "b", "c", "d"], root @ root.T) == [("a", "b", "c")]


def test_the_command_says_it_in_words_and_json(run_cli: Callable[..., object]) -> None:
    """`urdfcal check` prints verdict, sums and suggestions, and the same for machines."""
    run_cli("simulate", ROBOTS_DIR / "arm4" / "arm4.urdf.xacro", "-o", "m.csv")
    words = ("check", ROBOTS_DIR / "arm4" / "arm4.urdf.xacro", "m.csv", "--error-model", "dh", "-q")
    out = run_cli(*words).out  # type: ignore[attr-defined]
    assert "the spots move with 19 of 21 directions" in out
    assert "only joint1.d_d + joint2.d_d moves the spots" in out
    machine = json.loads(run_cli(*words, "--json").out)  # type: ignore[attr-defined]
    assert (machine["rank"], len(machine["hidden"]), set(machine["observability"])) == (19, 2, {"O1", "O2", "O3", "O4", "O5"})
