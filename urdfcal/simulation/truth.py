"""The errors of a simulated robot, its joints' give included: drawn at random, or read from a file.

A joint that gravity turns does so the way that it is pulled, so its compliance is drawn positive: a half-normal number. Eccentricities
are normal.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from urdfcal.base.errors import InputError, UsageError, no_such
from urdfcal.base.files import YamlFile, is_yaml, read_yaml
from urdfcal.base.geometry import Vector
from urdfcal.model.error_model import ErrorModel, with_softness
from urdfcal.model.gauge import build_error_model
from urdfcal.model.gravity import Gravity, WeighedRobot, parse_gravity, parse_payload
from urdfcal.model.options import ModelOptions, length_and_angle
from urdfcal.model.slots import MODELS
from urdfcal.model.softness import Term, extra_terms, gravity_terms
from urdfcal.robot.configurations import random_positions
from urdfcal.robot.robot import Robot
from urdfcal.robot.urdf_xml import FARTHEST

_CONFIGURATIONS = 400
_MRAD = 1e-3


def random_truth(robot: Robot, rng: np.random.Generator, translation: float, rotation: float) -> tuple[ErrorModel, Vector]:
    """Gaussian errors in all six directions of every joint, the mount and the screen, whatever can be seen of them.

    Args:
        robot: Nominal robot.
        rng: Source of randomness.
        translation: Standard deviation of each translation, [m].
        rotation: Standard deviation of each rotation, [rad].
    """
    errors = build_error_model(robot.chain, robot.rig, ModelOptions(error_model="placement"))
    scale = np.where(np.array(errors.units) == "m", translation, rotation)
    return errors, rng.normal(0.0, 1.0, len(scale)) * scale


def stated_truth(errors: ErrorModel, values: Mapping[str, float]) -> Vector:
    """The state with the named errors, [m] and [rad], and zero elsewhere.

    Raises:
        UsageError: a name is no parameter.
    """
    x = np.zeros(len(errors.names))
    for name, value in values.items():
        if name not in errors.names:
            raise UsageError(no_such("parameter", name, errors.names))
        x[errors.names.index(name)] = value
    return x


def truth_of(robot: Robot, errors: str, rng: np.random.Generator) -> tuple[ErrorModel, Vector]:
    """Errors as the command line states them: `2mm,0.2deg` for random ones, or a YAML file.

    The file names parameters of one error model, in metres and radians:

        error_model: dh
        parameters: {joint1.d_a: 0.01, joint1.d_theta: 0.0175}

    Raises:
        UsageError: neither a pair of scales nor a file, or an unknown parameter.
        InputError: the file cannot be read.
    """
    if is_yaml(Path(errors)):
        return _from_file(robot, Path(errors))
    if errors.strip() == "none":
        return random_truth(robot, rng, 0.0, 0.0)
    scales = length_and_angle(errors)
    if scales is None:
        raise UsageError(f"--errors {errors}: expected a length and an angle such as 2mm,0.2deg, none, or a YAML file")
    return random_truth(robot, rng, *scales)


def _from_file(robot: Robot, path: Path) -> tuple[ErrorModel, Vector]:
    file = read_yaml(path, InputError)
    content = file.content
    if not isinstance(content, dict) or not isinstance(content.get("parameters"), dict):
        raise InputError("expected entries error_model and parameters, e.g. parameters: {joint1.d_a: 0.01}", path, file.line())
    values = {str(name): _number(file, name, value) for name, value in content["parameters"].items()}
    name = str(content.get("error_model", "placement" if content.get("simulated") is True else "dh"))  # simulate writes placement errors
    if name not in MODELS:
        raise InputError(f"no error model '{name}'; there are: {', '.join(MODELS)}", path, file.line(["error_model"]))
    model = build_error_model(robot.chain, robot.rig, ModelOptions(error_model=name))
    for parameter in values:
        if parameter not in model.names:
            raise InputError(
                f"the error model {name} has {no_such('parameter', parameter, model.names)}", path, file.line(["parameters", parameter])
            )
    return model, stated_truth(model, values)


def _number(file: YamlFile, name: Any, value: Any) -> float:
    if isinstance(value, dict):  # the file that simulate wrote
        value = value.get("value")
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= FARTHEST:
        raise InputError(f"parameter '{name}': found {value!r}, expected a number in m or rad", file.path, file.line(["parameters", name]))
    return float(value)


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
        UsageError: a payload hangs on no link of this robot, gravity bends none of its joints, or their limits leave no room.
    """
    drawn = random_positions(robot, _CONFIGURATIONS, rng)
    weighed = WeighedRobot(robot, scales.gravity)
    terms = [*gravity_terms(robot.chain, weighed.moments(drawn)), *extra_terms(robot.chain, ["eccentricity"])]
    terms = [term for term in terms if scales.sigma(term)]
    if not any(term.largest for term in terms) and (scales.own or scales.across):
        raise UsageError("--sag-mrad: gravity bends no joint of this robot")
    numbers = rng.normal(0.0, 1.0, len(terms)) * [scales.sigma(term) for term in terms]
    values = {term.name: abs(value) if term.largest else value for term, value in zip(terms, numbers.tolist(), strict=True)}
    soft = with_softness(errors, terms, weighed, robot.rig.tip)
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
        term.name: {"value": value[term.name], "unit": term.unit or "1"} | ({"at_moment_Nm": term.largest} if term.largest else {})
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
