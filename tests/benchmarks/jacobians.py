"""Jac1, Jac2 and J against central differences, at x = 0 and well away from it, for every robot and error model.

What is differentiated are poses and spots that plain numpy works out from the URDF with the origins of `corrected_origins(x)`; the
chain, Pinocchio and the derivatives of urdfcal have no part in it. Differences of two steps are extrapolated to step zero
(Richardson). An error is measured against the largest entry of its column over all poses. Screen and beams (two angles and two
offsets each) are estimated on top of every model; a beam's own columns count for J and not for Jac1, which is the module's motion.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
from second_witness import UrdfWay, observations_of

import urdfcal
from urdfcal.calibration.problem import Problem
from urdfcal.model.error_model import ErrorModel
from urdfcal.model.gauge import build_error_model
from urdfcal.model.jacobian import arm_motion
from urdfcal.model.options import ModelOptions
from urdfcal.model.slots import MODELS
from urdfcal.robot.configurations import joint_limits
from urdfcal.sensors.spots import Beams, beams_in, spot_jacobian

Array = npt.NDArray[np.float64]

ROBOTS = ("arm7", "arm4", "panda", "ur5", "tiago")
SCALES = (0.0, 1e-9, 1e-5, 1e-2, 0.1)
STEPS = (4e-4, 2e-4)
LEAST_ZX, LONGEST, GOAL = 0.3, 3.0, 1e-7


@dataclass(frozen=True)
class Worst:
    """Largest errors relative to their columns' scale, and how many poses were drawn and kept."""

    jac1: float
    jac2: float
    J: float
    parameters: int
    drawn: int
    kept: int


class Witness:
    """Poses and spots of a robot with errors x, worked out without urdfcal's kinematics."""

    def __init__(self, robot: urdfcal.Robot, errors: ErrorModel, q: Array) -> None:
        self.way, self.errors, self.screen = UrdfWay(robot.description.text), errors, robot.rig.base
        self.links = [robot.rig.tip, *robot.rig.lasers]
        self.q = dict(zip(robot.chain.input_names, q.T, strict=True))

    def poses(self, x: Array) -> Array:
        """T_screen_link of module and lasers, (n, links, 4, 4)."""
        origins = {name: origin.homogeneous for name, origin in self.errors.corrected_origins(x).items()}
        return self.way.poses(origins, self.q, self.screen, self.links)

    def spots(self, x: Array) -> Array:
        """(n, lasers, 2)."""
        return observations_of(self.poses(x)[:, 1:])[0]

    def spatial_twists(self, x: Array, direction: Array) -> Array:
        """Twist [v, w] of the module against the screen, in screen axes at the screen's origin, for a motion of x, (n, 6)."""
        T = self.poses(x)[:, 0]
        dT = derivative(lambda step: self.poses(x + step * direction)[:, 0]) @ np.linalg.inv(T)
        return np.column_stack([dT[:, :3, 3], dT[:, 2, 1], dT[:, 0, 2], dT[:, 1, 0]])


def derivative(function: Callable[[float], Array]) -> Array:
    """Central differences with two steps, extrapolated: the error falls with the fourth power of the step."""
    coarse, fine = ((function(h) - function(-h)) / (2 * h) for h in STEPS)
    return (4 * fine - coarse) / 3


def twisted_spots(beams: Beams, twist: Array) -> Array:
    """Spots after the lasers were turned about the screen's origin and shifted."""
    v, w = twist[:3], twist[3:]
    angle = np.linalg.norm(w)
    rotate = (lambda p: p) if angle == 0 else (lambda p: rodrigues(w / angle, angle, p))
    source, direction = rotate(beams.source) + v, rotate(beams.direction)
    return (source - source[..., :1] / direction[..., :1] * direction)[..., 1:]


def rodrigues(axis: Array, angle: float, p: Array) -> Array:
    """Rotate vectors (..., 3) about an axis through the origin."""
    return p * np.cos(angle) + np.cross(axis, p) * np.sin(angle) + (p @ axis)[..., None] * axis * (1 - np.cos(angle))


def relative(actual: Array, expected: Array) -> float:
    """Worst error of columns (..., columns), each relative to its own largest entry."""
    error = np.abs(actual - expected).reshape(-1, expected.shape[-1]).max(axis=0)
    return float((error / np.abs(expected).reshape(-1, expected.shape[-1]).max(axis=0)).max())


def draw(robot: urdfcal.Robot, errors: ErrorModel, x: Array, count: int, rng: np.random.Generator) -> Array:
    """Those of `count` random poses whose beams, with errors x, meet the screen steeply enough and not too far away."""
    q = rng.uniform(*joint_limits(robot), (count, len(robot.chain.inputs)))
    lasers = Witness(robot, errors, q).poses(x)[:, 1:]
    lengths = observations_of(lasers)[1]
    good = (lengths > 0) & (lengths < LONGEST) & (np.abs(lasers[..., 0, 2]) > LEAST_ZX)
    return q[good.all(axis=1)]


def worst(robot: urdfcal.Robot, model: str, scale: float, count: int, rng: np.random.Generator) -> Worst:
    """Compare all derivatives of one robot under one error model at one size of x."""
    errors = build_error_model(robot.chain, robot.rig, ModelOptions(error_model=model, estimate=("screen", "beams4")))
    x = scale * rng.uniform(-1, 1, len(errors.names))
    q = draw(robot, errors, x, count, rng)
    if not len(q):
        return Worst(np.nan, np.nan, np.nan, len(x), count, 0)
    witness, motion = Witness(robot, errors, q), arm_motion(errors, q, x)
    beams, of_module = beams_in(robot.chain, motion), errors.moves()[robot.chain.laser_frames].all(axis=0)
    spots, directions = beams.spots, np.eye(len(x))
    blank = urdfcal.measurements_from(robot, q, spots)
    jac1 = np.stack([witness.spatial_twists(x, direction) for direction in directions[of_module]], axis=-1)
    jac2 = np.stack([derivative(lambda step, one=one: twisted_spots(beams, step * one)) for one in np.eye(6)], axis=-1)
    J = np.stack([derivative(lambda step, one=one: witness.spots(x + step * one)) for one in directions], axis=-1)
    there = Problem(errors, blank).linearise(x)
    return Worst(
        relative(motion.jac1[..., of_module], jac1),
        relative(spot_jacobian(spots, beams.direction), jac2),
        relative(there.jacobian.reshape(J.shape), J),
        len(x),
        count,
        len(q),
    )


def summary(runs: list[Worst]) -> str:
    """The worst of some runs, and how many of the drawn poses were kept."""
    errors = [np.max([getattr(run, of) for run in runs]) for of in ("jac1", "jac2", "J")]
    return "".join(f"{error:10.1e}" for error in errors) + f"{sum(run.kept for run in runs):8d} of {sum(run.drawn for run in runs)}"


def main() -> None:
    """Parse the command line and run the study."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--poses", type=int, default=400, help="poses drawn for each robot, model and size of x (default 400)")
    parser.add_argument("--seed", type=int, default=0, help="of the random numbers (default 0)")
    parser.add_argument("--robots", type=Path, default=Path("robots"), help="folder of the robots (default robots)")
    arguments = parser.parse_args()
    start, rng = time.perf_counter(), np.random.default_rng(arguments.seed)
    sizes = ", ".join(f"{scale:g}" for scale in SCALES)
    print(f"{'robot':7s}{'model':11s}{'p':>3s}{'Jac1':>10s}{'Jac2':>10s}{'J':>10s}  kept of drawn, and J at x ~ {sizes}")
    found = []
    for name in ROBOTS:
        robot = urdfcal.load_robot(arguments.robots / name / f"{name}.urdf.xacro")
        for model in MODELS:
            runs = [worst(robot, model, scale, arguments.poses, rng) for scale in SCALES]
            found += runs
            each = " ".join(f"{run.J:.0e}" for run in runs)
            print(f"{name:7s}{model:11s}{runs[0].parameters:3d}{summary(runs)}   {each}", flush=True)
    print(f"{'all':21s}{summary(found)}   (goal {GOAL:g}); {time.perf_counter() - start:.0f} s")


if __name__ == "__main__":
    main()
