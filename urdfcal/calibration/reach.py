"""Poses at which the beams fall where they can be seen."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from urdfcal.base.errors import UsageError
from urdfcal.base.geometry import Array3, Mask, Matrix, Vector
from urdfcal.model.error_model import ErrorModel
from urdfcal.robot.configurations import joint_limits, require_room
from urdfcal.robot.robot import Robot
from urdfcal.sensors.measurements import Measurements
from urdfcal.sensors.spots import Beams, beams_at

_BATCH, _MOST_LOOKS = 4096, 50 * 4096  # random positions drawn at a time, and how many until none are in view
_MOST_DRAWS, _LEAST_SHARE = 500_000, 0.005
_LEAST_LENGTH = 0.1  # [m]; nearer to the screen the nominal robot's module may already stand behind it


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

    def in_view(beams: Beams) -> Mask:
        inside = ((beams.spots >= corners[0]) & (beams.spots <= corners[1])).all(axis=-1)
        return np.asarray((inside & beams.makes_spot()).all(axis=1))

    return _drawn(errors, x, joint_limits(robot, seen.q), poses, rng, in_view, _MOST_LOOKS)[0]


@dataclass(frozen=True)
class ScreenArea:
    """The part of the screen plane that is there.

    Attributes:
        size: Side of the square, [m].
        centre: (y, z) of its middle, [m].
    """

    size: float = 3.0
    centre: tuple[float, float] = (0.0, 0.0)

    def holds(self, spots: Array3) -> Mask:
        """Which spots (..., 2) lie on it."""
        return np.asarray((np.abs(spots - np.array(self.centre)) <= self.size / 2).all(axis=-1))


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
    """Random joint positions at which every beam of the robot with errors x makes a spot on the screen.

    Args:
        robot: Nominal robot.
        errors: Error model of the truth.
        x: The truth, (p,).
        poses: How many.
        rng: Source of randomness.
        area: The screen.
        limits: Lower and upper limit of each measured joint, (2, inputs); by default the URDF's, and half a turn either way
            for a continuous joint.

    Returns:
        (poses, inputs), [rad] or [m].

    Raises:
        UsageError: such positions are too rare, or the limits leave no room.
    """
    if limits is None:
        require_room(robot)
    where, most = area or ScreenArea(), max(_MOST_DRAWS, int(poses / _LEAST_SHARE))

    def on_screen(beams: Beams) -> Mask:
        return np.asarray((where.holds(beams.spots) & beams.makes_spot(nearest=_LEAST_LENGTH)).all(axis=1))

    found, drawn = _drawn(errors, x, joint_limits(robot) if limits is None else limits, poses, rng, on_screen, most)
    if len(found) < poses:
        raise UsageError(
            f"only {len(found)} of {drawn} random poses put every beam on the screen, {poses} were asked for; "
            "move the screen or the module, or make the screen larger"
        )
    return found


def _drawn(
    errors: ErrorModel, x: Vector, limits: Matrix, poses: int, rng: np.random.Generator, good: Callable[[Beams], Mask], most: int
) -> tuple[Matrix, int]:
    """Joint positions within limits (2, inputs) whose beams are good, at most so many, and how many were drawn until there were enough."""
    found, drawn = np.empty((0, len(limits[0]))), 0
    while len(found) < poses and drawn < most:
        q = rng.uniform(limits[0], limits[1], (_BATCH, len(limits[0])))
        found, drawn = np.vstack([found, q[good(beams_at(errors, x, q))]]), drawn + _BATCH
    return found[:poses], drawn
