"""Poses at which the beams fall where they can be seen."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from urdfcal.base.errors import UsageError
from urdfcal.base.geometry import Mask, Matrix, Vector
from urdfcal.model.error_model import ErrorModel
from urdfcal.robot.configurations import joint_limits, require_room
from urdfcal.robot.robot import Robot
from urdfcal.robot.sheet import ScreenArea, stated_sheet
from urdfcal.sensors.measurements import Measurements
from urdfcal.sensors.spots import LEAST_LENGTH, beams_at

_BATCH, _MOST_LOOKS = 4096, 50 * 4096  # random positions drawn at a time, and how many until none are in view
_MOST_DRAWS, _LEAST_SHARE = 500_000, 0.005


def poses_in_view(robot: Robot, errors: ErrorModel, x: Vector, seen: Measurements, rng: np.random.Generator, poses: int = 500) -> Matrix:
    """Random joint positions within the limits at which the robot with errors x puts every beam where the camera has seen spots.

    Args:
        robot: Nominal robot.
        errors: Names, order and units of the parameters.
        x: Error parameters, (p,), [m] and [rad].
        seen: Measurements; the rectangle around their spots is the screen.
        rng: Source of randomness.
        poses: How many are wanted.

    Returns:
        (poses, inputs), [rad] or [m]; fewer rows, or none, where such positions are too rare to be found.
    """
    corners = np.nanmin(seen.spots, axis=(0, 1)), np.nanmax(seen.spots, axis=(0, 1))

    def in_view(q: Matrix) -> Mask:
        beams = beams_at(errors, x, q)
        inside = ((beams.spots >= corners[0]) & (beams.spots <= corners[1])).all(axis=-1)
        return np.asarray((inside & beams.makes_spot()).all(axis=1))

    return draw_where(in_view, joint_limits(robot, seen.q), poses, rng, most=_MOST_LOOKS).q


@dataclass(frozen=True)
class DrawnPoses:
    """Random joint positions that could be measured.

    Attributes:
        q: (poses, inputs), [rad] or [m].
        looked: How many had to be drawn for them.
    """

    q: Matrix
    looked: int


def draw_poses(
    robot: Robot,
    errors: ErrorModel,
    x: Vector,
    poses: int,
    rng: np.random.Generator,
    *,
    area: ScreenArea | None = None,
    limits: Matrix | None = None,
) -> Matrix:
    """Random joint positions (poses, inputs) of `drawn_in_view` alone."""
    return drawn_in_view(robot, errors, x, poses, rng, area=area, limits=limits).q


def drawn_in_view(
    robot: Robot,
    errors: ErrorModel,
    x: Vector,
    poses: int,
    rng: np.random.Generator,
    *,
    area: ScreenArea | None = None,
    limits: Matrix | None = None,
) -> DrawnPoses:
    """Random joint positions at which every beam of the robot with errors x makes a spot on the screen.

    Args:
        robot: Nominal robot.
        errors: Error model of the truth.
        x: The truth, (p,).
        poses: How many.
        rng: Source of randomness.
        area: The screen; by default as large as the URDF draws it, else a square of 3 m.
        limits: Lower and upper limit of each measured joint, (2, inputs); by default the URDF's, and half a turn either way
            for a continuous joint.

    Raises:
        UsageError: such positions are too rare, or the limits leave no room.
    """
    if limits is None:
        require_room(robot)
    where = area or screen_area(robot)
    drawn = draw_where(on_screen(errors, x, where), joint_limits(robot) if limits is None else limits, poses, rng)
    if len(drawn.q) < poses:
        raise UsageError(
            f"only {len(drawn.q)} of {drawn.looked} random poses put every beam on the screen of {where}, {poses} were asked for; "
            "move the screen or the module, or make the screen larger"
        )
    return drawn


def on_screen(errors: ErrorModel, x: Vector, area: ScreenArea) -> Callable[[Matrix], Mask]:
    """Tells of positions (n, inputs) where every beam of the robot with errors x makes a spot on the screen, (n,)."""

    def all_meet(q: Matrix) -> Mask:
        beams = beams_at(errors, x, q)
        return np.asarray((area.holds(beams.spots) & beams.makes_spot(nearest=LEAST_LENGTH)).all(axis=1))

    return all_meet


def screen_area(robot: Robot) -> ScreenArea:
    """The screen as the URDF draws it, else a square of 3 m about its origin."""
    return stated_sheet(robot) or ScreenArea()


def draw_where(
    good: Callable[[Matrix], Mask], limits: Matrix, poses: int, rng: np.random.Generator, *, most: int | None = None, batch: int = _BATCH
) -> DrawnPoses:
    """Random positions within limits (2, inputs) that are good; fewer where they are too rare.

    Args:
        good: Tells of positions (n, inputs) which are, (n,).
        limits: Lower and upper limit of each measured joint.
        poses: How many are wanted.
        rng: Source of randomness.
        most: How many are drawn until the rest is given up; by default so many that one in 200 would do.
        batch: How many are drawn at a time.
    """
    most = max(_MOST_DRAWS, int(poses / _LEAST_SHARE)) if most is None else most
    found, looked, drawn = np.empty((0, len(limits[0]))), 0, 0
    while len(found) < poses and drawn < most:
        q = rng.uniform(limits[0], limits[1], (batch, len(limits[0])))
        rows = np.flatnonzero(good(q))[: poses - len(found)]
        enough = len(found) + len(rows) == poses
        found, looked, drawn = np.vstack([found, q[rows]]), drawn + (int(rows[-1]) + 1 if enough else batch), drawn + batch
    return DrawnPoses(found, looked)
