"""Simulated arms that do one thing which geometry has no word for."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

import urdfcal
from urdfcal.base.geometry import DEG, MM, Matrix, Vector
from urdfcal.calibration.channel import Channel
from urdfcal.calibration.problem import Problem
from urdfcal.calibration.reach import draw_poses
from urdfcal.model.error_model import ErrorModel
from urdfcal.robot.configurations import random_positions
from urdfcal.sensors.readings import Readings
from urdfcal.sensors.sensor import View
from urdfcal.simulation.readings import ReadingNoise, simulate_readings
from urdfcal.simulation.setup import SimulatedSetup, parse_sensors, seen_with, simulated_setup
from urdfcal.simulation.truth import SagScales, random_truth, soft_truth

NOISE = ReadingNoise(spot=0.5 * MM, length=0.1 * MM, angle=0.02 * DEG)
USUAL: Mapping[str, float] = {
    "none": 0.0,
    "sag": 1e-3,  # [rad] at the largest moment of each joint; half of it across
    "eccentricity": 0.03 * DEG,
    "two_cycles": 0.03 * DEG,
    "harmonics": 0.03 * DEG,
    "scale": 1e-3,
    "approach": 0.02 * DEG,
    "joint_noise": 0.02 * DEG,
    "drift": 1 * MM,  # over the set, with as many mrad
    "walk": 1 * MM,
    "temperature": 0.3e-3,  # of all lengths and, in mm, of the measuring frame, from the first pose to the last
    "screen_bow": 1 * MM,  # half a metre from the midst
    "lens": 1 * MM,  # 0.5 m from the midst
    "readings_scale": 1e-3,
}
HARMONIC = 50  # cycles a turn
_Z95 = 1.959963984540054


@dataclass(frozen=True)
class DisturbedArm:
    """A simulated arm, measured.

    Attributes:
        robot: Nominal.
        errors: Error model of the truth.
        x: The truth.
        fit: Measurements with noise.
        unseen: What a perfect instrument would read of the real arm at poses that were not measured.
    """

    robot: urdfcal.Robot
    errors: ErrorModel
    x: Vector
    fit: urdfcal.Measurements
    unseen: urdfcal.Measurements


def disturbed_arm(
    robot: urdfcal.Robot,
    sensor: str,
    what: str,
    seed: int,
    *,
    times: float = 1.0,
    poses: int = 60,
    unseen: int = 100,
    error: tuple[float, float] = (1 * MM, 0.1 * DEG),
) -> DisturbedArm:
    """One arm with geometric errors and one nuisance.

    Args:
        robot: Nominal.
        sensor: `point:LINK`, `pose:LINK` or `laser`.
        what: Of USUAL.
        seed: Of everything that is drawn.
        times: How many times the usual size the nuisance has.
        poses: How many are measured.
        unseen: How many are not.
        error: Standard deviation of the geometric errors, [m] and [rad].
    """
    rng, size = np.random.default_rng(seed), times * USUAL[what]
    sensors, lasers = parse_sensors([sensor], robot, 1)
    robot = seen_with(robot, sensors, "", lasers)
    errors, x = random_truth(robot, rng, *error)
    if what == "sag":
        errors, x = soft_truth(robot, errors, x, SagScales(own=size, across=size / 2), rng)
    setup = simulated_setup(robot, errors, x, sensors, rng)
    total = poses + unseen
    q = draw_poses(robot, errors, x, total, rng) if lasers else random_positions(setup.robot, total, rng)
    blank = replace(simulate_readings(setup, total, rng), q=q)
    real = _Real(setup, what, size, rng)
    clock = np.concatenate([np.linspace(-0.5, 0.5, poses), np.zeros(unseen)])
    true = real.read(blank, clock, measured=np.arange(total) < poses)
    turning = np.array([not joint.prismatic for joint in robot.chain.inputs])
    joints = rng.normal(0, size, q.shape) * turning * (np.arange(total) < poses)[:, None] if what == "joint_noise" else 0.0
    noisy = replace(true, q=q + joints, readings=tuple(_noisy(one, rng) for one in true.readings))
    noisy = replace(noisy.subset(np.arange(poses)), approach=real.approach[:poses] if what == "approach" else None)
    if what == "temperature":
        noisy = replace(noisy, temperature=20 + 10 * (clock[:poses] + 0.5))
    perfect = true.subset(np.arange(poses, total))
    if what == "approach" and real.approach is not None:
        perfect = replace(perfect, approach=real.approach[poses:])
    return DisturbedArm(robot, setup.errors, setup.x, noisy, perfect)


def held_and_off(errors: ErrorModel, x: Vector, P: Matrix, arm: DisturbedArm) -> tuple[float, float]:
    """Share of 95 % intervals that hold by the covariance alone, and mean square of what is off in the first unit, at unseen poses.

    A perfect instrument reads there, in a rig that stands still.
    """
    linearised = Problem(errors, arm.unseen).linearise(x)
    J, off = linearised.jacobian, linearised.residual
    if errors.rig is not None:
        own = [errors.names.index(term.name) for term in errors.rig.terms]
        off, J = off + J[:, :, own] @ x[own], J.copy()
        J[:, :, own] = 0.0
    sigma, first = np.sqrt(np.einsum("nmp,pr,nmr->nm", J, P, J)), linearised.kinds == 0
    held = np.mean((np.abs(off) < _Z95 * sigma)[linearised.measured])
    return float(held), float(np.mean(off[:, first][linearised.measured[:, first]] ** 2))


@dataclass
class _Real:
    """What the real arm and its rig do."""

    setup: SimulatedSetup
    what: str
    size: float
    rng: np.random.Generator
    approach: Matrix | None = None

    def read(self, data: urdfcal.Measurements, clock: Vector, measured: Vector) -> urdfcal.Measurements:
        """What is read without noise: disturbances of the rig while it is measured, those of the arm always."""
        q = data.q + self._moved(data.q)
        problem = Problem(self.setup.errors, replace(data, q=q))
        walk = np.cumsum(self.rng.normal(0, 1 / np.sqrt(measured.sum()), (len(q), 6)), axis=0)
        directions = self.rng.normal(0, 1, 6)
        readings = []
        for channel, view in zip(problem.channels, problem.views(self.setup.x), strict=True):
            view = self._seen(view, clock * measured, (walk - walk[measured].mean(axis=0)) * measured[:, None], directions)
            values = self._of_instrument(channel, view, channel.sensor.read(view))
            readings.append(replace(channel.readings, values=np.where(measured[:, None], values, channel.sensor.read(view))))
        return replace(data, readings=tuple(readings))

    def _moved(self, q: Matrix) -> Matrix:
        """How much farther the joints are than they say."""
        joints, turning = q.shape[1], np.array([not joint.prismatic for joint in self.setup.robot.chain.inputs])
        phase, sizes = self.rng.uniform(0, 2 * np.pi, joints), self.rng.normal(0, self.size, joints)
        cycles = {"eccentricity": 1, "two_cycles": 2, "harmonics": HARMONIC}.get(self.what)
        if cycles:
            return sizes * np.sin(cycles * q + phase) * turning
        if self.what == "scale":
            return sizes * q
        if self.what == "approach":
            self.approach = np.sign(np.diff(q, axis=0, prepend=q[-1:]))
            return np.abs(sizes) * self.approach * turning
        return np.zeros_like(q)

    def _seen(self, view: View, clock: Vector, walk: Matrix, directions: Vector) -> View:
        """A target as a measuring frame has it that moves, before an arm that grows."""
        if self.what not in ("drift", "walk", "temperature"):
            return view
        p, R = view.p.copy(), view.R.copy()
        if self.what == "temperature":
            p *= (1 + self.size * clock)[:, None]
            p += (clock[:, None] * directions[:3]) * self.size
            return replace(view, p=p)
        twists = self.size * (walk if self.what == "walk" else clock[:, None] * directions)
        for pose, twist in enumerate(twists):
            moved = pin.exp6(twist).inverse()
            p[pose], R[pose] = moved.act(p[pose]), moved.rotation @ R[pose]
        return replace(view, p=p, R=R)

    def _of_instrument(self, channel: Channel, view: View, values: Matrix) -> Matrix:
        """What a screen that is bowed, a lens that bends, or a scale that is wrong makes of it."""
        if self.what == "screen_bow" and channel.sensor.beam:
            spots, lean = values, view.R[:, 1:, 2] / view.R[:, :1, 2]
            for _ in range(5):  # where the beam meets x = bow(y, z)
                spots = values + lean * (-self.size * ((spots / 0.5) ** 2 @ [0.7, 0.3]))[:, None]
            return np.asarray(spots)
        if self.what == "lens" and channel.sensor.beam:
            return np.asarray(values * (1 + self.size / 0.5 * np.sum((values / 0.5) ** 2, axis=1, keepdims=True)))
        if self.what == "readings_scale" and channel.sensor.words.unit == "mm":
            return np.asarray(values * (1 + self.size))
        return values


def _noisy(reading: Readings, rng: np.random.Generator) -> Readings:
    how = reading.kind
    scale = NOISE.angle if how.words.unit == "deg" else NOISE.spot if how.beam else NOISE.length
    return replace(reading, values=how.disturbed(reading.values, lambda shape: NOISE.draw(rng, scale, shape)))
