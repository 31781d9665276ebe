"""Gravity's moments at the joints: what bends an arm under its own weight.

Every joint carries the part of the robot behind it, whose weight puts a moment on the joint (`static_moments.py`).

Inertias are the URDF's where they look real. Where links of the way have none, or all the same placeholder, every moving link gets a
generic mass instead: a rod from its joint to the next one, and a drive at the joint. Only moments relative to a joint's own largest one
matter to a calibration, so how heavy the robot is as a whole plays no part.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import pinocchio as pin

from urdfcal.base.errors import UsageError, no_such
from urdfcal.base.geometry import Array3, Matrix, Vector
from urdfcal.model.static_moments import StaticMoments
from urdfcal.robot.configurations import WholeRobot
from urdfcal.robot.robot import Robot
from urdfcal.robot.urdf_tree import UrdfJoint

G = 9.81  # [m/s^2]
_ROD, _DRIVE = 8.0, 1.5  # [kg/m] and [kg] of a generic link
_LEAST_MASS = 1e-3  # [kg] under which a link's mass is none
_ALIKE = 1e-6  # relative difference under which masses are the same placeholder


@dataclass(frozen=True)
class Gravity:
    """Where down is, and what is carried.

    Attributes:
        direction: Unit vector along gravity's pull in the root link, (3,).
        payloads: Masses fixed to links, at their origins, [kg].
    """

    direction: tuple[float, float, float] = (0.0, 0.0, -1.0)
    payloads: Mapping[str, float] = field(default_factory=dict)


class WeighedRobot:
    """A robot with masses, for the moments of its weight; holds a model of its own and never the caller's."""

    def __init__(self, robot: Robot, gravity: Gravity) -> None:
        """Weigh a robot.

        Raises:
            UsageError: a payload hangs on no link of this robot.
        """
        self.robot, self.gravity = robot, gravity
        self.model = robot.model.copy()
        self.generic = not _real_inertias(robot)
        if self.generic:
            _give_generic_masses(self.model, robot)
        for link, mass in gravity.payloads.items():
            self._hang(self.model, link, mass)
        self.model.gravity.linear = G * np.array(gravity.direction)
        self.joints = [self.model.getJointId(step.joint.name) for step in robot.chain.moving]
        self.whole = WholeRobot(robot, robot.chain.input_names)
        self._kilograms: dict[str, StaticMoments] = {}

    def _hang(self, model: Any, link: str, mass: float) -> None:
        if not model.existFrame(link, pin.BODY):
            raise UsageError(f"--payload {mass:g}@{link}: {no_such('link', link, self.robot.tree.links)}")
        frame = model.frames[model.getFrameId(link, pin.BODY)]
        model.appendBodyToJoint(frame.parentJoint, pin.Inertia(mass, np.zeros(3), np.zeros((3, 3))), frame.placement)

    def moments(self, q: Matrix) -> Array3:
        """Moments of gravity on what each moving joint carries, about its origin in its own frame, (n, moving, 3), [N m].

        Args:
            q: Positions of the measured joints, (n, inputs), [rad] or [m].
        """
        return self._static.at(q)

    def payload_moments(self, q: Matrix, link: str) -> Array3:
        """Moments per kilogram at the origin of a link, as `moments`, (n, moving, 3), [N m/kg]."""
        if link not in self._kilograms:
            model = self.model.copy()
            for index in range(model.njoints):
                model.inertias[index] = pin.Inertia.Zero()
            self._hang(model, link, 1.0)
            self._kilograms[link] = StaticMoments(model, self.whole, self.joints)
        return self._kilograms[link].at(q)

    @cached_property
    def _static(self) -> StaticMoments:
        return StaticMoments(self.model, self.whole, self.joints)


def parse_gravity(text: str) -> tuple[float, float, float]:
    """`0,0,-1` as a unit vector.

    Raises:
        UsageError: it is none.
    """
    try:
        vector = np.array([float(word) for word in text.split(",")])
    except ValueError:
        vector = np.zeros(0)
    if vector.shape != (3,) or not np.isfinite(vector).all() or not np.linalg.norm(vector) > 0:
        raise UsageError(f"--gravity {text}: expected three numbers such as 0,0,-1, the direction of gravity's pull in the root link")
    x, y, z = (vector / np.linalg.norm(vector)).tolist()
    return x, y, z


def parse_payload(text: str) -> tuple[str, float]:
    """`2.5@tool0` or `2.5kg@tool0` as link and mass [kg].

    Raises:
        UsageError: it is neither.
    """
    mass, at, link = text.partition("@")
    try:
        kilograms = float(mass.strip().removesuffix("kg"))
    except ValueError:
        kilograms = np.nan
    if not at or not link.strip() or not 0 < kilograms < 1e5:
        raise UsageError(f"--payload {text}: expected a mass and a link, such as 2.5@tool0")
    return link.strip(), kilograms


def _real_inertias(robot: Robot) -> bool:
    """Whether every moving link of the way has a mass, and they are not all the same placeholder."""
    masses = [_carried_mass(robot, step.joint) for step in robot.chain.moving]
    inner = masses[:-1] if len(masses) > 1 else masses  # the last link is often a bare flange
    return min(inner) > _LEAST_MASS and (len(masses) < 3 or float(np.ptp(masses)) > _ALIKE * max(masses))


def _carried_mass(robot: Robot, joint: UrdfJoint) -> float:
    return float(robot.model.inertias[robot.model.getJointId(joint.name)].mass)


def _give_generic_masses(model: Any, robot: Robot) -> None:
    """Rods between the moving joints of the way, and drives at them; whatever else the robot has weighs nothing."""
    for index in range(model.njoints):
        model.inertias[index] = pin.Inertia.Zero()
    joints = [model.getJointId(step.joint.name) for step in robot.chain.moving if step.forward]
    joints += [model.getJointId(step.joint.name) for step in robot.chain.moving if not step.forward]
    for joint in joints:
        ends = [model.jointPlacements[child].translation for child in joints if model.parents[child] == joint]
        model.inertias[joint] += pin.Inertia(_DRIVE, np.zeros(3), np.zeros((3, 3)))
        for end in ends or [_tip(model, joint)]:
            model.inertias[joint] += pin.Inertia(_ROD * float(np.linalg.norm(end)), np.asarray(end) / 2, np.zeros((3, 3)))


def _tip(model: Any, joint: int) -> Vector:
    """The farthest frame that a last link carries."""
    places = [np.array(frame.placement.translation) for frame in model.frames if frame.parentJoint == joint]
    return max(places, key=lambda place: float(np.linalg.norm(place)), default=np.zeros(3))
