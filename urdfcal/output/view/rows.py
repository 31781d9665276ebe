"""Which of the measurements are shown, before which screen, and where the arm stands at them with what it gives way."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from urdfcal.base.errors import ShapeMismatch, UsageError
from urdfcal.base.geometry import Matrix
from urdfcal.model.options import ModelOptions
from urdfcal.robot.robot import Robot, with_text
from urdfcal.robot.urdf_writer import with_origins
from urdfcal.sensors.measurements import Measurements

if TYPE_CHECKING:
    from urdfcal.calibration.analysis.compensation import Compensation


def of_session(rows: Measurements, session: str | None, together: bool) -> tuple[Measurements, list[str]]:
    """The rows of a session, and what is said of the others.

    Args:
        rows: What was measured.
        session: Its name; None for the first, or for all.
        together: Whether all can be shown together.

    Raises:
        UsageError: there is no such session.
    """
    names = rows.session_names or ("",)
    if session is None and (together or len(names) == 1):
        return rows, []
    if session is not None and session not in names:
        raise UsageError(f"session '{session}': the measurements have {', '.join(map(repr, names))}")
    shown = names[0] if session is None else session
    others = ", ".join(f"'{name}'" for name in names if name != shown)
    words = [f"of the sessions '{shown}' is shown; --session shows another one: {others}"] if others else []
    return rows.subset(rows.sessions == shown), words


def has_another_screen(robot: Robot, rows: Measurements, every: Measurements) -> bool:
    """Whether these are spots of a session other than the first, whose screen a calibrated robot has, and its screen can be placed."""
    other = len(every.session_names) > 1 and rows.session_names[0] != every.session_names[0]
    return other and rows.only_spots and robot.chain.screen_joint is not None


def before_its_screen(robot: Robot, rows: Measurements) -> Robot:
    """The same robot with the screen where these spots have it."""
    from urdfcal.calibration.fitting import fit

    own = replace(rows, sessions=np.full(len(rows), ""))
    found = fit(robot, own, options=ModelOptions(estimate=("screen",), only=(f"{robot.rig.base}.*",)))
    return with_text(robot, with_origins(robot.description, {name: each.corrected for name, each in found.corrections.items()}))


def bent_positions(compensation: Compensation, rows: Measurements) -> Matrix:
    """Joint positions at which a calibrated robot stands where the arm does, (n, inputs), [rad] or [m].

    Raises:
        ShapeMismatch: the compensation is of other joints.
    """
    if set(compensation.joints) != set(rows.joints):
        raise ShapeMismatch(f"the compensation is of {', '.join(compensation.joints)}; the measurements are of {', '.join(rows.joints)}")
    order = [rows.joints.index(joint) for joint in compensation.joints]
    approach = None if rows.approach is None else rows.approach[:, order]
    bent = rows.q.copy()
    bent[:, order] = compensation.corrected_configuration(rows.q[:, order], rows.payload, approach)
    return bent
