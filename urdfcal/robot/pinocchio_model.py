"""The Pinocchio model of a URDF; what its reader complains of becomes our message."""

from __future__ import annotations

import re
from typing import Any

import pinocchio as pin

from urdfcal.base.errors import RobotError
from urdfcal.base.native import native_stderr
from urdfcal.robot.description import Description
from urdfcal.robot.urdf_xml import for_pinocchio, read_xml

_OF_ITS_SOURCE = re.compile(r"From file: \S+ in function: .*? at line: \d+ message: |\s*at line \d+ in \S+")  # on another machine


def pinocchio_model(description: Description) -> Any:
    """The whole robot, mimic joints taken as joints of their own.

    Raises:
        RobotError: Pinocchio cannot read it, and why.
    """
    text = for_pinocchio(read_xml(description.text), shapes=False)
    with native_stderr() as complaints:
        try:
            model = pin.buildModelFromXML(text)
        except (ValueError, RuntimeError) as error:
            reason = str(error)
            model = None
    if model is None:
        said = complaints[0].replace("Error:", "").strip() or reason
        raise RobotError(f"Pinocchio's URDF reader refuses it: {without_its_source(said)}", description.label)
    return model


def without_its_source(said: str) -> str:
    """A message of Pinocchio or what it reads with in one line, without where in their own code they raised it."""
    return _OF_ITS_SOURCE.sub("", " ".join(said.split()))
