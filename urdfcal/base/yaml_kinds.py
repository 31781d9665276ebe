"""Which of the files that urdfcal writes or reads a YAML document is, so that one in another's place is named with what reads it."""

from __future__ import annotations

from typing import Any

_NAMED = {"compensation": "a compensation, which --compensation takes", "prior": "a fleet's prior, which fit --prior-from takes"}
RIG = "a rig file, which --rig takes"
_BY_ENTRY = {
    "dictionary": "a screen.yaml, which --markers takes",
    "intrinsics": "a camera, which --camera takes",
    "joints": "a calibration, which urdfcal apply, view --calibrated and --calibration take",
    "kinematics": "a kinematics file of the UR driver, which the robot's xacro reads (--xacro-arg kinematics_params:=FILE)",
} | dict.fromkeys(("boards", "beams", "lasers", "noise", "priors", "error_model", "estimate", "screen"), RIG)


def kind_of(content: Any) -> str:
    """Words for what a document is; empty where it is none that is known."""
    if not isinstance(content, dict):
        return ""
    if content.get("urdfcal") in _NAMED:
        return _NAMED[content["urdfcal"]]
    return next((words for entry, words in _BY_ENTRY.items() if entry in content), "")


def is_not(what: str, content: Any, entry: str, maker: str) -> str:
    """`is no camera: it is a rig file, which --rig takes; expected a file written by urdfcal camera`, or which entry it lacks."""
    found = f"is {kind}" if (kind := kind_of(content)) else f"has no entry '{entry}'"
    return f"is no {what}: it {found}; expected a file written by urdfcal {maker}"
