"""Robots seen by every kind of sensor, in every arrangement: what the tests of sensors are parametrised by."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from tests.support.small_robot import joint, robot_of, robot_text
from urdfcal.base.geometry import DEG, MM, Vector
from urdfcal.model.error_model import ErrorModel
from urdfcal.model.gauge import build_error_model
from urdfcal.model.options import ModelOptions
from urdfcal.robot.robot import Robot
from urdfcal.sensors.measurements import Measurements
from urdfcal.simulation.readings import ReadingNoise
from urdfcal.simulation.setup import SimulatedSetup, parse_sensors, seen_with, simulated_setup

TWO_ARMS = robot_text(
    joint("lift", "screen", "a", '<origin xyz="0 0 0.3"/><axis xyz="0 0 1"/>', kind="prismatic").replace("-9", "0").replace("9", "0.4"),
    joint("left_1", "a", "b", '<origin xyz="0.2 0.1 0" rpy="0.3 0 0"/><axis xyz="0 1 0"/>'),
    joint("left_2", "b", "c", '<origin xyz="0.1 0.3 0.2" rpy="0 0.4 0"/><axis xyz="0 0.6 0.8"/>'),
    joint("left_hand", "c", "d", '<origin xyz="0 0.1 0.1" rpy="0 0 0.5"/>', kind="fixed"),
    joint("right_1", "a", "e", '<origin xyz="0.2 -0.1 0" rpy="-0.3 0 0"/><axis xyz="0 1 0"/>'),
    joint("right_2", "e", "f", '<origin xyz="0.3 0 0.1"/><axis xyz="1 0 0"/><mimic joint="right_1" multiplier="-0.7" offset="0.2"/>'),
    joint("right_3", "f", "g", '<origin xyz="0.2 0.1 0"/><axis xyz="0 0 1"/>'),
    links="screen a b c d e f g",
)


@dataclass(frozen=True)
class SensorCase:
    """A robot, what reads of it, and what it is read from."""

    robot: str
    sensors: tuple[str, ...]
    reference: str = ""
    sessions: tuple[str, ...] = ("",)
    known: bool = False


SINGLE = {
    "point": SensorCase("ur5", ("point:tool0",)),
    "pose": SensorCase("ur5", ("pose:tool0",)),
    "distance": SensorCase("ur5", ("distance:tool0",)),
    "plane": SensorCase("ur5", ("plane:tool0:probe",)),
    "socket": SensorCase("ur5", ("socket:tool0:ball",)),
    "inclination": SensorCase("ur5", ("inclination:tool0",)),
}
ARRANGED = {
    "reference carried": SensorCase("panda", ("pose:panda_link0",), "panda_link8"),
    "points on the base": SensorCase("ur5", ("point:base_link:a", "point:base_link:b", "distance:base_link"), "tool0"),
    "head camera": SensorCase("tiago", ("pose:arm_tool_link",), "xtion_optical_frame"),
    "hand sees hand": SensorCase("two arms", ("pose:g", "point:f", "point:e", "point:a"), "d"),
    "reference known": SensorCase("panda", ("pose:panda_link8",), known=True),
    "several targets": SensorCase("panda", ("point:panda_link8", "point:panda_link8:b", "pose:panda_link5", "distance:panda_link6")),
    "sessions": SensorCase("ur5", ("pose:tool0", "point:forearm_link"), sessions=("monday", "friday")),
    "lasers and points": SensorCase("ur5", ("laser", "point:tool0", "point:forearm_link")),
    "every kind": SensorCase(
        "ur5", ("laser", "point:tool0", "pose:wrist_1_link", "distance:slm:bar", "plane:tool0:probe", "socket:tool0:ball")
    ),
}
CASES = SINGLE | ARRANGED
NOISE = ReadingNoise(spot=0.3 * MM, length=0.1 * MM, angle=0.02 * DEG)


def robot_named(case: SensorCase, robots: dict[str, Robot]) -> Robot:
    return robot_of(TWO_ARMS) if case.robot == "two arms" else robots[case.robot]


def seen_robot(case: SensorCase, robots: dict[str, Robot], places: int = 4) -> Robot:
    """The robot of a case, as its sensors see it."""
    robot = robot_named(case, robots)
    sensors, lasers = parse_sensors(case.sensors, robot, places)
    return seen_with(robot, sensors, case.reference, lasers)


def setup_of(
    case: SensorCase,
    robots: dict[str, Robot],
    rng: np.random.Generator,
    *,
    model: str = "placement",
    translation: float = 2 * MM,
    rotation: float = 0.2 * DEG,
    places: int = 4,
) -> SimulatedSetup:
    """The case's robot with Gaussian errors in the parameters of an error model; what is beside joints and mount stands anywhere."""
    seen = seen_robot(case, robots, places)
    errors = build_error_model(seen.chain, seen.rig, ModelOptions(error_model=model, reference_known=case.known))
    x = rng.normal(0, 1, len(errors.names)) * np.where(np.array(errors.units) == "m", translation, rotation)
    sensors, _ = parse_sensors(case.sensors, robot_named(case, robots), places)
    return simulated_setup(seen, errors, x, sensors, rng, sessions=case.sessions, reference_known=case.known)


def session_errors(setup: SimulatedSetup, options: ModelOptions, data: Measurements) -> tuple[ErrorModel, Vector]:
    """Another error model of the same robot whose frames and planes are at the truth, and a state near it."""
    errors = build_error_model(setup.robot.chain, setup.robot.rig, options, data.session_names)
    found = {slot.label: slot.found for slot in setup.errors.slots}
    slots = tuple(replace(slot, found=found.get(slot.label, {})) for slot in errors.slots)
    value = dict(zip(setup.errors.names, setup.x.tolist(), strict=True))
    shared = [any(word in name for word in ("socket:", "plane:", ":wire", "gravity")) for name in errors.names]
    x = np.array([value.get(name, 0.0) if own else 0.0 for name, own in zip(errors.names, shared, strict=True)])
    return replace(errors, slots=slots, planes=setup.errors.planes), x
