"""Mistakes in the measurements: each named, and none on healthy data."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from tests.support.helpers import with_joint
from urdfcal.base.geometry import DEG, MM, Vector
from urdfcal.calibration.problem import Problem
from urdfcal.calibration.reach import draw_poses
from urdfcal.calibration.start.mistakes import mistakes_of_joints, mistakes_of_readings
from urdfcal.calibration.start.rig_search import find_start
from urdfcal.calibration.start.spot_hypotheses import best_spot_hypothesis
from urdfcal.estimation.noise import Noise
from urdfcal.model.gauge import build_error_model
from urdfcal.robot.robot import Robot
from urdfcal.sensors.measurements import Measurements, spots_measured
from urdfcal.simulation.readings import SimulatedNoise, simulate

Change = Callable[[Measurements], Measurements]


def measured(robot: Robot, mm: float, deg: float, outliers: float, seed: int, poses: int = 50) -> tuple[Problem, Vector]:
    """A robot with errors of a given size, and its spots with 1 mm of noise, some up to 200 mm off."""
    rng, errors = np.random.default_rng(seed), build_error_model(robot.chain, robot.rig)
    x = rng.normal(0, np.where(np.array(errors.units) == "m", mm * MM, deg * DEG))
    data = simulate(robot, errors, x, draw_poses(robot, errors, x, poses, rng), rng, SimulatedNoise(1 * MM))
    bad = rng.random(data.seen.shape) < outliers
    data = data.with_spots(data.spots + bad[..., None] * rng.uniform(-200 * MM, 200 * MM, data.spots.shape))
    return Problem(errors, data), x


def noise_of(model: Problem) -> Noise:
    """What `fit` assumes where nothing is stated."""
    return Noise(1 * MM, np.zeros(len(model.data.joints)), stated=False)


def said(model: Problem, change: Change) -> str:
    """What is said of changed measurements, as `fit` would ask."""
    wrong = Problem(model.errors, change(model.data))
    if find_start(wrong, noise_of(wrong)).plausible:
        return ""
    found = best_spot_hypothesis(wrong, noise_of(wrong))
    return found.words if found else ""


def with_spots(matrix: list[list[float]]) -> Change:
    """A mistake in what was read off the screen."""
    return lambda data: data.with_spots(data.spots @ np.array(matrix, dtype=float).T)


MISTAKES: dict[str, Change] = {
    "laser_1 and laser_2 swapped": lambda data: data.with_spots(data.spots[:, ::-1]),
    "y and z of the spots swapped": with_spots([[0, 1], [1, 0]]),
    "y of the spots mirrored": with_spots([[-1, 0], [0, 1]]),
    "z of the spots mirrored": with_spots([[1, 0], [0, -1]]),
    "the spots read as millimetres": with_spots([[1e3, 0], [0, 1e3]]),
    "all joints read as degrees": lambda data: replace(data, q=data.q / DEG),
    "joint read as degrees": with_joint(2, factor=1 / DEG),
    "the sign of joint flipped": with_joint(2, factor=-1.0),
    "90 deg added to joint": with_joint(2, shift=-90 * DEG),
    "the joints taken from the row behind": lambda data: replace(data, q=np.roll(data.q, 1, axis=0)),
}


@pytest.mark.parametrize(
    ("words", "name", "outliers"), [(words, *[("panda", 0.0), ("ur5", 0.2)][turn % 2]) for turn, words in enumerate(MISTAKES)]
)
def test_a_mistake_is_named(robots: dict[str, Robot], words: str, name: str, outliers: float) -> None:
    """Each mistake in the measurements of a robot with honest errors is named, also with every fifth spot far off."""
    model, _ = measured(robots[name], 3, 0.3, outliers, seed=1)
    expected = words.replace("of joint", f"of {model.data.joints[2]}").replace("to joint", f"to {model.data.joints[2]}")
    expected = expected.replace("joint read", f"{model.data.joints[2]} read")
    line = said(model, MISTAKES[words])
    assert expected in line
    assert line.startswith("the data fit ")
    assert "\n" not in line


def test_a_joint_that_is_counted_from_the_horizontal_is_named(robots: dict[str, Robot]) -> None:
    """Spots of an arm whose controller reads its third joint less the second."""
    model, _ = measured(robots["ur5"], 3, 0.3, 0.0, seed=1)
    line = said(model, lambda data: replace(data, q=data.q - data.q[:, [1]] * (np.arange(6) == 2)))
    assert f"with {model.data.joints[1]} added to {model.data.joints[2]}" in line


@pytest.mark.parametrize(("mm", "deg", "outliers"), [(0.3, 0.05, 0.0), (10, 1, 0.0), (10, 1, 0.2)])
@pytest.mark.parametrize("name", ["panda", "arm7", "arm4"])
def test_healthy_data_are_left_alone(robots: dict[str, Robot], name: str, mm: float, deg: float, outliers: float) -> None:
    """Honest errors of 10 mm and 1 deg with 20 % gross outliers raise no alarm, even when asked directly."""
    model, _ = measured(robots[name], mm, deg, outliers, seed=2)
    begun = find_start(model, noise_of(model))
    assert begun.plausible
    assert begun.message == ""
    assert best_spot_hypothesis(model, noise_of(model)) is None


def test_a_turned_module_is_offered_beside_swapped_lasers(robots: dict[str, Robot]) -> None:
    """Beams at opposite angles from one point cannot tell swapped lasers from a module turned by 180 deg; the line says so."""
    model, _ = measured(robots["panda"], 0.3, 0.05, 0.0, seed=3)
    assert said(model, MISTAKES["laser_1 and laser_2 swapped"]).endswith("laser_1 and laser_2 swapped (or with 'slm' turned by 180 deg)")


def test_a_joint_assembled_wrongly_is_no_mistake_of_the_data(robots: dict[str, Robot]) -> None:
    """A zero that is 30 deg off is no mistake that has a name, and none is made up for it."""
    model, _ = measured(robots["panda"], 0.3, 0.05, 0.0, seed=4)
    assert said(model, with_joint(3, shift=30 * DEG)) == ""


def test_noise_is_no_mistake(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Spots at random fit nothing, and nothing is named."""
    robot = robots["ur5"]
    errors = build_error_model(robot.chain, robot.rig)
    data = spots_measured(robot, rng.uniform(-1, 1, (40, 6)), rng.uniform(-1, 1, (40, 2, 2)))
    model = Problem(errors, data)
    assert best_spot_hypothesis(model, noise_of(model)) is None


def test_no_two_hypotheses_do_the_same(robots: dict[str, Robot]) -> None:
    """Each hypothesis changes the measurements, and no two change them alike; the data themselves stay."""
    robot = robots["tiago"]
    model, _ = measured(robot, 0, 0, 0.0, seed=5)
    before = model.data.q.copy()
    mistakes = (*mistakes_of_readings(model.data, beams=True), *mistakes_of_joints(model.data, robot.chain.inputs))
    changed = [mistake.change(model.data) for mistake in mistakes]
    prints = {(np.round(data.q, 9).tobytes(), np.round(data.spots, 12).tobytes()) for data in [*changed, model.data]}
    assert len(prints) == len(changed) + 1
    np.testing.assert_array_equal(model.data.q, before)
