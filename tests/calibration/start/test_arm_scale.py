"""The overall scale of an arm: held where nothing measures it, and only there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.support.sensor_cases import CASES, NOISE, SensorCase, setup_of
from urdfcal.api import Calibration, fit
from urdfcal.base.geometry import MM
from urdfcal.calibration.problem import Problem
from urdfcal.calibration.start.begin import with_scale
from urdfcal.model.error_model import ErrorModel
from urdfcal.model.gauge import build_error_model
from urdfcal.model.options import ModelOptions
from urdfcal.model.parameters import DEFAULT_PRIORS
from urdfcal.robot.robot import Robot
from urdfcal.sensors.measurements import Measurements
from urdfcal.sensors.readings import KnownLength
from urdfcal.simulation.readings import ReadingNoise, simulate_readings
from urdfcal.simulation.setup import SimulatedSetup

TOUCHES = {"socket": CASES["socket"], "plane": CASES["plane"], "both": SensorCase("ur5", ("socket:tool0:ball", "plane:tool0:probe"))}
SCALED = {
    "point": CASES["point"],
    "distance": CASES["distance"],
    "socket and point": SensorCase("ur5", ("socket:tool0:ball", "point:tool0")),
    "socket and wire": SensorCase("ur5", ("socket:tool0:ball", "distance:tool0")),
    "socket and lasers": SensorCase("ur5", ("laser", "socket:tool0:ball")),
}


def touched(
    case: SensorCase, robots: dict[str, Robot], noise: ReadingNoise | None = None, poses: int = 150
) -> tuple[SimulatedSetup, Measurements]:
    rng = np.random.default_rng(5)
    setup = setup_of(case, robots, rng, model="auto")
    return setup, simulate_readings(setup, poses, rng, noise)


def with_length(setup: SimulatedSetup, data: Measurements) -> Measurements:
    apart = float(np.linalg.norm(setup.place("socket:1") - setup.place("socket:2")))
    return replace(data, lengths=(KnownLength("socket:1", "socket:2", apart),))


@pytest.mark.parametrize("name", TOUCHES)
def test_touches_alone_leave_the_scale_open_and_it_is_held(name: str, robots: dict[str, Robot]) -> None:
    """The growth of all links is a direction that no touch sees; holding it adds just that one direction, and says so."""
    setup, data = touched(TOUCHES[name], robots)
    held, words = with_scale(build_error_model(setup.robot.chain, setup.robot.rig), data)
    assert words.startswith("touches alone leave the arm's overall scale open, so it is held as the URDF has it")
    assert np.linalg.norm(list(held.held_sum.values())) == pytest.approx(1.0)
    assert not any(own.startswith("shoulder_pan_joint.") for own in held.held_sum)
    errors = replace(setup.errors, held_sum=held.held_sum)
    ranks = [seen_directions(each, setup, data) for each in (setup.errors, errors)]
    assert ranks[1] == ranks[0] + 1


@pytest.mark.parametrize("name", SCALED)
def test_what_has_a_scale_is_left_alone(name: str, robots: dict[str, Robot]) -> None:
    """Points, wires and lasers measure lengths, so nothing is held and nothing said; and no direction is missing then."""
    setup, data = touched(SCALED[name], robots, poses=60)
    errors = build_error_model(setup.robot.chain, setup.robot.rig)
    assert with_scale(errors, data) == (errors, "")


def test_a_known_length_gives_the_scale(robots: dict[str, Robot]) -> None:
    """One distance between two sockets adds the one direction that was missing, and nothing is held any more."""
    setup, data = touched(CASES["socket"], robots)
    known = with_length(setup, data)
    errors = build_error_model(setup.robot.chain, setup.robot.rig)
    assert with_scale(errors, known) == (errors, "")
    assert seen_directions(setup.errors, setup, known) == seen_directions(setup.errors, setup, data) + 1


def test_zeros_alone_have_no_scale_to_hold(robots: dict[str, Robot]) -> None:
    """Where no length is estimated the arm cannot grow."""
    setup, data = touched(CASES["socket"], robots, poses=20)
    errors = build_error_model(setup.robot.chain, setup.robot.rig, ModelOptions(error_model="offset"))
    assert with_scale(errors, data) == (errors, "")


def test_a_fit_with_a_length_finds_the_size_of_the_arm_and_one_without_keeps_it(robots: dict[str, Robot]) -> None:
    """The held sum stays at zero, the distance between sockets comes out as it is only where one is known."""
    setup, data = touched(CASES["socket"], robots, NOISE)
    stated = {"joint": DEFAULT_PRIORS["joint"]}
    free, known = (fit(setup.robot, each, priors=stated, gated=False) for each in (data, with_length(setup, data)))
    assert free.converged
    assert known.converged
    assert any(words.startswith("touches alone") for words in free.warnings)
    assert not any(words.startswith("touches alone") for words in known.warnings)
    held = sum(weight * free.x[free.errors.names.index(name)] for name, weight in free.errors.held_sum.items())
    assert abs(held) < 1e-7
    true = np.linalg.norm(setup.place("socket:3") - setup.place("socket:4"))
    found = [np.linalg.norm(place(each, "socket:3") - place(each, "socket:4")) for each in (free, known)]
    assert abs(found[0] - true) > 0.5 * MM
    assert abs(found[1] - true) < 0.3 * MM
    assert known.after["tool0:ball socket"].mean == pytest.approx(free.after["tool0:ball socket"].mean, rel=0.01)


def place(found: Calibration, name: str) -> np.ndarray:
    return np.array([found.x[found.errors.names.index(f"{name}.{axis}")] for axis in "xyz"])


def seen_directions(errors: ErrorModel, setup: SimulatedSetup, data: Measurements) -> int:
    """Rank of what the data see of joints, targets and places, at the truth, columns in units of a tenth of a metre and a radian."""
    here = Problem(errors, data).linearise(setup.x)
    scale = np.where(np.array(errors.units) == "m", 0.1, 1.0)
    values = np.linalg.svd(here.jacobian.reshape(-1, len(scale)) * scale, compute_uv=False)
    return int(np.sum(values > 1e-7 * values[0]))


@pytest.mark.parametrize("name", ["socket", "plane", "distance"])
def test_places_stand_for_where_the_robot_stands(name: str, robots: dict[str, Robot]) -> None:
    """Where nothing but unknown places is met, the first joints' share in the base's placement is theirs; held places leave it alone."""
    setup, data = touched(CASES[name], robots, poses=20)
    errors = build_error_model(setup.robot.chain, setup.robot.rig)
    carried = [own for own, carrier in errors.carried.items() if carrier == "the places that are touched"]
    assert len(carried) == 5
    assert {own.rpartition(".")[0] for own in carried} == {"shoulder_pan_joint", "shoulder_lift_joint"}
    place = data.instruments.places[0].name
    known = build_error_model(setup.robot.chain, setup.robot.rig, ModelOptions(fix=(f"{place}.*",)))
    assert known.carried == {}
