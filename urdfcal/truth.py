"""The errors of a simulated robot: drawn at random, or read from a file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from urdfcal.error_model import ErrorModel
from urdfcal.errors import InputError, UsageError, no_such
from urdfcal.files import YamlFile, read_yaml
from urdfcal.gauge import ModelOptions, build_error_model, parse_prior
from urdfcal.geometry import Vector
from urdfcal.robot import Robot
from urdfcal.simulation import random_truth, stated_truth
from urdfcal.slots import MODELS
from urdfcal.urdf_tree import FARTHEST


def truth_of(robot: Robot, errors: str, rng: np.random.Generator) -> tuple[ErrorModel, Vector]:
    """Errors as the command line states them: `2mm,0.2deg` for random ones, or a YAML file.

    The file names parameters of one error model, in metres and radians:

        error_model: dh
        parameters: {joint1.d_a: 0.01, joint1.d_theta: 0.0175}

    Raises:
        UsageError: neither a pair of scales nor a file, or an unknown parameter.
        InputError: the file cannot be read.
    """
    if errors.endswith((".yaml", ".yml")):
        return _from_file(robot, Path(errors))
    if errors.strip() == "none":
        return random_truth(robot, rng, 0.0, 0.0)
    if errors.strip() == "flat":
        raise UsageError("--errors flat: expected a length and an angle such as 2mm,0.2deg, none, or a YAML file")
    scale = parse_prior(errors)
    return random_truth(robot, rng, scale.translation, scale.rotation)


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
