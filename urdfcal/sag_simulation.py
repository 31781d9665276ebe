"""Simulated robots whose joints give way: under gravity, and by eccentric encoders and gears.

A joint that gravity turns does so the way that it is pulled, so its compliance is drawn positive: a half-normal number. Eccentricities
are normal.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import yaml

from urdfcal.error_model import ErrorModel, with_softness
from urdfcal.errors import UsageError
from urdfcal.geometry import Vector
from urdfcal.gravity import Gravity, WeighedRobot, parse_gravity, parse_payload
from urdfcal.robot import Robot
from urdfcal.simulation import joint_limits
from urdfcal.softness import Term, extra_terms, gravity_terms

_CONFIGURATIONS = 400
_MRAD = 1e-3


@dataclass(frozen=True)
class SagScales:
    """How soft a simulated robot is.

    Attributes:
        own: Standard deviation of a joint's deflection about its own axis at its largest gravity moment, [rad].
        across: The same about the two axes across it, [rad].
        eccentricity: Standard deviation of the sine and cosine parts of a joint's eccentricity, once and twice a turn, [rad].
        gravity: Where down is, and what is carried.
    """

    own: float = 0.0
    across: float = 0.0
    eccentricity: float = 0.0
    gravity: Gravity = field(default_factory=Gravity)

    def __bool__(self) -> bool:
        return bool(self.own or self.across or self.eccentricity)

    def sigma(self, term: Term) -> float:
        """The one that a term is drawn with."""
        return self.eccentricity if not term.largest else self.own if term.axis is None else self.across


def soft_truth(robot: Robot, errors: ErrorModel, x: Vector, scales: SagScales, rng: np.random.Generator) -> tuple[ErrorModel, Vector]:
    """The truth with joints that give way as well.

    Args:
        robot: Nominal robot.
        errors: Error model of the rigid truth.
        x: The rigid truth, (p,), [m] and [rad].
        scales: How soft the joints are.
        rng: Source of randomness.

    Raises:
        UsageError: a payload hangs on no link of this robot, or gravity bends none of its joints.
    """
    weighed = WeighedRobot(robot, scales.gravity)
    lower, upper = joint_limits(robot)
    drawn = rng.uniform(lower, upper, (_CONFIGURATIONS, len(lower)))
    terms = [*gravity_terms(robot.chain, weighed.moments(drawn)), *extra_terms(robot.chain, ["eccentricity"])]
    terms = [term for term in terms if scales.sigma(term)]
    if not any(term.largest for term in terms) and (scales.own or scales.across):
        raise UsageError("--sag-mrad: gravity bends no joint of this robot")
    numbers = rng.normal(0.0, 1.0, len(terms)) * [scales.sigma(term) for term in terms]
    values = {term.name: abs(value) if term.largest else value for term, value in zip(terms, numbers.tolist(), strict=True)}
    soft = with_softness(errors, terms, weighed, robot.rig.module)
    known = dict(zip(errors.names, errors.check(x).tolist(), strict=True)) | values
    return soft, np.array([known[name] for name in soft.names])


def sag_bytes(errors: ErrorModel, x: Vector) -> bytes:
    """The same for the end of a YAML file; nothing where nothing gives way."""
    entries = sag_entries(errors, x)
    return yaml.safe_dump({"sag": entries}, sort_keys=False, default_flow_style=None, width=160).encode() if entries else b""


def sag_entries(errors: ErrorModel, x: Vector) -> dict[str, Any]:
    """What gives way, and how far, for a file; SI."""
    if errors.soft is None:
        return {}
    weighed, value = errors.soft.weighed, dict(zip(errors.names, x.tolist(), strict=True))
    terms = {
        term.name: {"value": value[term.name], "unit": "rad"} | ({"at_moment_Nm": term.largest} if term.largest else {})
        for term in errors.soft.terms
    }
    gravity = {"direction": list(weighed.gravity.direction), "payloads_kg": dict(weighed.gravity.payloads)}
    return {"gravity": gravity, "masses": "generic" if weighed.generic else "urdf", "deflections": terms}


def sag_scales(
    sag_mrad: float, across_mrad: float, eccentricity_mrad: float, gravity: str | None = None, payloads: Sequence[str] = ()
) -> SagScales:
    """Scales, direction of gravity and payloads as the command line has them.

    Raises:
        UsageError: a scale is negative or not finite, gravity or a payload is not readable, or they are given for a rigid robot.
    """
    for name, value in (("sag", sag_mrad), ("sag-across", across_mrad), ("eccentricity", eccentricity_mrad)):
        if not 0 <= value < np.inf:
            raise UsageError(f"--{name}-mrad {value:g}: expected a deflection in mrad, zero or above")
    if (gravity is not None or payloads) and not (sag_mrad or across_mrad):
        raise UsageError("--gravity and --payload bend no rigid robot; say how soft it is with --sag-mrad")
    direction = Gravity().direction if gravity is None else parse_gravity(gravity)
    pull = Gravity(direction, dict(parse_payload(text) for text in payloads))
    return SagScales(sag_mrad * _MRAD, across_mrad * _MRAD, eccentricity_mrad * _MRAD, pull)
