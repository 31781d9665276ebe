"""Small robots of two branches: a head that sees a hand, and a waist that carries two arms."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from urdfcal.base.geometry import Vector
from urdfcal.model.error_model import ErrorModel
from urdfcal.model.gauge import build_error_model
from urdfcal.model.options import ModelOptions
from urdfcal.robot.description import Description
from urdfcal.robot.robot import Robot, robot_from
from urdfcal.sensors.measurements import Measurements
from urdfcal.simulation.readings import ReadingNoise, simulate_readings
from urdfcal.simulation.setup import SimulatedSetup, parse_sensors, seen_with, simulated_setup

Joint = tuple[str, str, str, str]  # name, parent, xyz, axis
NOISE = ReadingNoise(length=1e-4, angle=3e-4)
TEXT = (
    '<link name="{name}_link"/><joint name="{name}" type="{type}"><parent link="{parent}"/><child link="{name}_link"/>'
    '<origin xyz="{xyz}"/><axis xyz="{axis}"/><limit lower="-1.2" upper="1.2" effort="1" velocity="1"/></joint>'
)
HEAD = [("pan", "base", "0.02 0 0.6", "0 0 1"), ("tilt", "pan_link", "0.03 0 0.05", "0 1 0")]
WAIST = [("yaw", "base", "0 0 0.3", "0 0 1"), ("roll", "yaw_link", "0.03 0 0.1", "1 0 0"), ("pitch", "roll_link", "0 0.02 0.1", "0 1 0")]


def arm(prefix: str, parent: str, foot: str, first: str = "0 0 1") -> list[Joint]:
    """Six joints: the first as asked, then a usual arm."""
    joints = [("1", foot, first), ("2", "0.08 0 0.25", "0 1 0"), ("3", "0 0 0.4", "0 1 0")]
    joints += [("4", "0.2 0 0.05", "1 0 0"), ("5", "0.2 0 0", "0 1 0"), ("6", "0.06 0.02 0", "1 0 0")]
    names = [parent, *(f"{prefix}{number}_link" for number, _, _ in joints)]
    return [(f"{prefix}{number}", above, xyz, axis) for above, (number, xyz, axis) in zip(names, joints, strict=False)]


def robot_of(joints: Sequence[Joint], ends: Sequence[tuple[str, str]] = (), path: Path = Path("robot.urdf")) -> Robot:
    """A robot of turning joints, and of fixed ones (name, parent) that carry its ends 50 mm off."""
    text = '<robot name="two_ends"><link name="base"/>'
    text += "".join(TEXT.format(name=name, type="revolute", parent=parent, xyz=xyz, axis=axis) for name, parent, xyz, axis in joints)
    text += "".join(TEXT.format(name=name, type="fixed", parent=parent, xyz="0.05 0.02 0.04", axis="1 0 0") for name, parent in ends)
    return robot_from(Description(path, f"{text}</robot>".encode(), expanded=False), lasers=())


def seen(robot: Robot, hand: str, reference: str, known: bool = False) -> tuple[Robot, ErrorModel]:
    """The robot whose hand's pose is seen from a link, and six numbers a joint for its truth."""
    arm_seen = seen_with(robot, parse_sensors([f"pose:{hand}"], robot, 0)[0], reference)
    options = ModelOptions(error_model="placement", reference_known=known, target_known=known)
    return arm_seen, build_error_model(arm_seen.chain, arm_seen.rig, options)


def measured(
    robot: Robot,
    errors: ErrorModel,
    truth: Vector,
    hand: str,
    rng: np.random.Generator,
    poses: int = 60,
    known: bool = False,
    noise: ReadingNoise = NOISE,
) -> tuple[SimulatedSetup, Measurements]:
    """What is read of a robot with these errors."""
    sensors = parse_sensors([f"pose:{hand}"], robot, 0)[0]
    setup = simulated_setup(robot, errors, truth, sensors, rng, reference_known=known, target_known=known)
    return setup, simulate_readings(setup, poses, rng, noise)
