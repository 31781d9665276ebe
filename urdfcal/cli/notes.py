"""What several commands say of a robot, its paths and its sources."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from urdfcal.output.formats import Deployment
    from urdfcal.robot.robot import Robot


def about(robot: Robot) -> str:
    """A robot in one line."""
    from urdfcal.output.text.instruments import rig_in_words

    return f"{robot.name}: moving joints {', '.join(step.joint.name for step in robot.chain.moving)}; {rig_in_words(robot)}"


def listed(paths: Iterable[str | Path]) -> str:
    """`a, b and c`."""
    *first, last = map(str, paths)
    return f"{', '.join(first)} and {last}" if first else last


def expanded_note(robot: Robot) -> str:
    """A word where the URDF that is written is not the text that was read."""
    return f" (the URDF is the expanded {robot.description.path.name})" if robot.description.expanded else ""


def beside_note(plan: Deployment) -> str:
    """What became of a xacro's sources beside their patch."""
    its = plan.sources
    copies = [f"; {its.folder} has changed copies"] if its.folder is not None else []
    return "".join([*copies, *(["; changed the sources in place, each kept as .orig"] if its.in_place else [])])
