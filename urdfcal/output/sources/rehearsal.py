"""What would become of a xacro's sources, before the time that a fit takes: a change of all that such a fit may change."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from urdfcal.model.gauge import build_error_model
from urdfcal.model.options import ModelOptions
from urdfcal.output.sources.patch import SourcePatch, patched_sources
from urdfcal.robot.robot import Robot

_SIZE = 1e-4  # [m] and [rad]


def rehearsed(robot: Robot, options: ModelOptions | None = None, sessions: Sequence[str] = ("",), *, split: bool = False) -> SourcePatch:
    """The sources with small made-up errors of every parameter that a fit would estimate: which files change, if they can.

    Args:
        robot: As it was expanded.
        options: What is to be calibrated.
        sessions: Labels of the sessions.
        split: Whether a number that feeds several joints may become one for each.

    Raises:
        RobotError: as `patched_sources`; no fit of this kind could be put into the sources.
    """
    errors = build_error_model(robot.chain, robot.rig, options, sessions)
    x = _SIZE * np.random.default_rng(0).uniform(0.5, 1.5, len(errors.parameters))
    return patched_sources(robot.description, errors.corrected_origins(x), split=split)
