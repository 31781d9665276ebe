"""Which pose to measure next: of some candidates the one that lowers what is predicted of the tool most, given what was read so far.

At a candidate every instrument is taken to read every target that it has read before, as far as the belief says that it can: beams meet
the screen, and targets stand before the camera. What touches is left out, since only who stands beside the robot knows what is touched
where; and so are poses that were measured already, of which another reading averages noise and shows nothing new.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from urdfcal.base.errors import UsageError
from urdfcal.base.geometry import Array3, Mask, Matrix, Vector
from urdfcal.calibration.analysis.more_poses import without_lost
from urdfcal.calibration.problem import Problem, problem_of
from urdfcal.calibration.reach import screen_area
from urdfcal.estimation.noise import Noise
from urdfcal.model.error_model import ErrorModel
from urdfcal.robot.robot import Robot
from urdfcal.robot.sheet import ScreenArea
from urdfcal.sensors.measurements import Measurements, spots_measured
from urdfcal.sensors.readings import Readings, blank_readings
from urdfcal.sensors.repeats import codes, same_poses


@dataclass(frozen=True)
class NextPose:
    """The pose to measure next.

    Attributes:
        row: Which of the candidates it is.
        q: Its joint positions, (inputs,), [rad] or [m].
        tool_sigma_mm: What the tool is predicted to be off by once it was measured: RMS over the workspace, [mm].
    """

    row: int
    q: Vector
    tool_sigma_mm: float


def read_at(robot: Robot, errors: ErrorModel, x: Vector, data: Measurements, q: Matrix) -> Measurements:
    """What the instruments of some measurements would read at other positions, without noise.

    Args:
        robot: As the sensors see it.
        errors: Error model with everything placed.
        x: Where the robot is taken to be, (p,).
        data: What was read; its last pose says of which session, with which payload and so on.
        q: Positions, (m, inputs), [rad] or [m].

    Raises:
        UsageError: nothing was read but by touch.
    """
    anywhere = [own for own in data.readings if not own.kind.touches]
    if not anywhere:
        raise UsageError("next_pose: only touches were read, and which poses reach what is touched is not known here")
    n = len(q)
    there = data.subset(np.full(n, len(data) - 1)) if len(data) else spots_measured(robot, q, np.zeros((n, len(robot.rig.lasers), 2)))
    there = replace(there, q=q, readings=tuple(_blank(own, n) for own in anywhere), approach=None)
    with np.errstate(invalid="ignore", divide="ignore"):
        values = Problem(errors, there).read(x)
    area = screen_area(robot)
    return replace(there, readings=tuple(_made(own, read, area) for own, read in zip(there.readings, values, strict=True)))


def _blank(own: Readings, n: int) -> Readings:
    """A sensor that has read nothing yet, and states what it stated last of its noise."""
    stated = own.sigma[own.seen & np.isfinite(own.sigma)]
    blank = blank_readings(own.sensor, own.target, own.link, n, own.instrument)
    return replace(blank, sigma=np.full(n, stated[-1])) if len(stated) else blank


def _made(own: Readings, read: Matrix, area: ScreenArea) -> Readings:
    """Readings that can be made: finite ones, and of spots those on the screen."""
    good: Mask = np.asarray(np.isfinite(read).all(axis=1))
    if own.kind.on_screen:
        good = good & area.holds(read)
    return replace(own, values=np.where(good[:, None], read, np.nan))


def whitened(errors: ErrorModel, x: Vector, data: Measurements, noise: Noise) -> Array3:
    """Jacobian of every pose in units of its noise, (m, k, p); each row is taken for a pose of its own."""
    linearisation = replace(without_lost(problem_of(errors, data, noise).linearise(x)).of_poses(len(data)), poses=None)
    return noise.weights(linearisation).jacobian(linearisation).reshape(len(data), -1, len(errors.names))


def measured_before(q: Matrix, held: Measurements) -> Mask:
    """Which positions (m, inputs) were measured already, within what joints are read to, (m,)."""
    poses = same_poses(np.vstack([held.q, q]), codes(np.zeros(len(held) + len(q))))
    return np.isin(poses[len(held) :], poses[: len(held)])
