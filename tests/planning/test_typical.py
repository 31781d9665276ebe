"""What a plan promises where nobody says where targets sit: what comes of it by batch algebra over places drawn here."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from urdfcal.base.geometry import Matrix
from urdfcal.calibration.analysis.prediction import tool_jacobian
from urdfcal.model.options import ModelOptions
from urdfcal.planning.candidates import Candidates
from urdfcal.planning.measuring import Asked, Measuring, ReadWith, measuring, whitened
from urdfcal.planning.plan import plan_poses
from urdfcal.planning.typical import typical
from urdfcal.robot.configurations import joint_limits, random_positions
from urdfcal.robot.rig import Grid
from urdfcal.robot.robot import Robot
from urdfcal.sensors.camera import Camera

LENS = Camera((1200, 900), np.array([[900.0, 0, 600], [0, 900, 450], [0, 0, 1]]), np.zeros(5))


def made_of(robot: Robot, asked: Asked, options: ModelOptions | None = None) -> Measuring:
    """What measures."""
    return measuring(robot, asked, options or ModelOptions(), np.random.default_rng(0))


def at(made: Measuring, place: np.ndarray) -> Measuring:
    """The same with the target at a place on its link."""
    slots = (replace(own, found={"": pin.SE3(np.eye(3), place)}) if own.kind == "target" else own for own in made.errors.slots)
    return replace(made, errors=replace(made.errors, slots=tuple(slots)))


def promised(made: Measuring, q: Matrix, J: np.ndarray, noise: ReadWith) -> float:
    """The tool's error over a workspace with the Jacobians J (c, 3, p), [mm]: the posterior by inverting the information matrix."""
    rows = np.concatenate(list(whitened(made, q, noise)))
    P = np.linalg.inv(rows.T @ rows + np.diag(made.errors.sigma**-2))
    return 1e3 * float(np.sqrt(np.trace(J @ P @ J.transpose(0, 2, 1), axis1=1, axis2=2).mean()))


@pytest.mark.parametrize("seed", [2, 3, 7])  # whose first draws are far from the middle
def test_targets_are_taken_to_sit_in_the_middle_of_all_places(robots: dict[str, Robot], seed: int) -> None:
    """What is promised is the median of what 200 places of a reflector leave, 80 mm from its link's origin along each axis."""
    robot = robots["ur5"]
    plan = plan_poses(robot, candidates=60, n=15, sensors=["point:tool0"], seed=seed)
    made, rng = made_of(robot, Asked(["point:tool0"])), np.random.default_rng(100 + seed)
    over = rng.uniform(*joint_limits(made.robot), (200, len(plan.joints)))
    J = tool_jacobian(made.robot, made.errors, made.errors.mean, plan.tool, over)[:, :3]
    left = [promised(at(made, place), plan.q, J, ReadWith()) for place in rng.normal(0, 0.08, (200, 3))]
    assert plan.tool_sigma_mm[-1] == pytest.approx(np.median(left), rel=0.15)


@pytest.mark.parametrize("seed", [5, 7])  # in which the poses of every draw that is tried tell more of it than of the middle one
def test_no_extreme_place_is_taken_where_poses_are_few(robots: dict[str, Robot], seed: int) -> None:
    """Of fourteen poses of a TIAGo, fewer than it takes to tell all parameters, what is promised is still near the median."""
    plan = plan_poses(robots["tiago"], candidates=60, n=14, sensors=["point:arm_7_link"], sigmas={"point": 1e-4}, seed=seed)
    made = made_of(robots["tiago"], Asked(["point:arm_7_link"]))
    over = random_positions(made.robot, 200, np.random.default_rng(1))
    J = tool_jacobian(made.robot, made.errors, made.errors.mean, plan.tool, over)[:, :3]
    places = np.random.default_rng(2).normal(0, 0.08, (60, 3))
    left = [promised(at(made, place), plan.q, J, ReadWith(None, {"point": 1e-4})) for place in places]
    assert plan.tool_sigma_mm[-1] == pytest.approx(np.median(left), rel=0.25)


@pytest.mark.parametrize(
    "asked",
    [Asked(), Asked(["point:tool0"], "base_link"), Asked(["pixels:screen"], "tool0", LENS, {"screen": Grid(5, 4, 0.1)})],
    ids=["lasers", "a target that is its link", "a board"],
)
def test_what_is_known_is_left_where_it_is(robots: dict[str, Robot], asked: Asked) -> None:
    """Where nothing was drawn at random there is nothing to draw again, and no randomness is spent."""
    made, rng = made_of(robots["ur5"], asked, ModelOptions(target_known=True)), np.random.default_rng(5)
    q = random_positions(made.robot, 10, rng)
    found = Candidates(q, np.arange(10), np.ones((10, len(made.blanks(q).readings)), dtype=bool), 10, {})
    before = rng.bit_generator.state
    assert typical(made, found, 5, ReadWith(), np.eye(len(made.errors.names)), rng) is made
    assert rng.bit_generator.state == before
