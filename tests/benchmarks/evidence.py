"""Held-out error with priors chosen by evidence against the fixed defaults, over simulated robots with three kinds of truth.

    python tests/benchmarks/evidence.py [--robots N] [--poses N ...] [--data DIR]

Truths: Gaussian (1 mm, 2 mrad in six directions), the makers' own calibrations of UR arms (ur_factory in DIR), and none at all.
"""

from __future__ import annotations

import argparse
import csv
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))

import numpy as np

from tests.support.studies import over, with_jobs
from urdfcal.api import fit
from urdfcal.calibration.problem import Problem
from urdfcal.calibration.reach import draw_poses
from urdfcal.model.error_model import ErrorModel
from urdfcal.model.gauge import build_error_model
from urdfcal.model.options import ModelOptions
from urdfcal.robot.robot import Robot, load_robot
from urdfcal.sensors.measurements import spots_measured
from urdfcal.simulation.readings import SimulatedNoise, simulate, true_spots

ROOT = Path(__file__).parents[2]
SIX = ("trans_x", "trans_y", "trans_z", "rot_x", "rot_y", "rot_z")


def factory_truths(folder: Path) -> list[np.ndarray]:
    """Twists of the six joint frames against nominal, (36,) each, [m] and [rad]."""
    arms: dict[str, list[list[float]]] = {}
    with (folder / "ur_factory" / "joint_frame_deltas.csv").open() as stream:
        for row in csv.reader(stream):
            if row[0] != "robot":
                arms.setdefault(row[0], []).append([float(value) for value in row[3:9]])
    return [np.concatenate(arm) for arm in arms.values() if len(arm) == 6]


def truth_of(kind: str, errors: ErrorModel, arms: list[np.ndarray], rng: np.random.Generator) -> np.ndarray:
    """Errors of every joint; mount and screen are 5 mm and 0.5 deg off whatever the kind."""
    joints = np.array([parameter.kind == "joint" for parameter in errors.parameters])
    metres = np.array(errors.units) == "m"
    x = rng.normal(0, 1, len(joints)) * np.where(metres, 5e-3, np.radians(0.5))
    if kind == "factory":
        x[joints] = rng.choice([-1.0, 1.0]) * arms[rng.integers(len(arms))]
    else:
        x[joints] *= 0.0 if kind == "zero" else np.where(metres, 1e-3 / 5e-3, 2e-3 / np.radians(0.5))[joints]
    return x


def held_out(robot: Robot, poses: int, kind: str, arms: list[np.ndarray], seed: int) -> tuple[float, float]:
    """RMS error on noise-free unseen spots with the defaults and by evidence, [mm]."""
    rng = np.random.default_rng([seed, poses])
    six = build_error_model(robot.chain, robot.rig, ModelOptions(error_model="placement"))
    truth = truth_of(kind, six, arms, rng)
    q = draw_poses(robot, six, truth, poses + 200, rng)
    data = simulate(robot, six, truth, q[:poses], rng, SimulatedNoise(1e-3))
    unseen = spots_measured(robot, q[poses:], true_spots(robot, six, truth, q[poses:]))
    rms = []
    for evidence in (False, True):
        found = fit(robot, data, evidence=evidence, gated=False)
        predicted = np.stack(Problem(replace(found.errors, sessions=("",)), unseen).read(found.x), axis=1)
        rms.append(float(np.sqrt(np.mean((predicted - unseen.spots) ** 2)) * 1e3))
    return rms[0], rms[1]


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robots", type=int, default=100)
    parser.add_argument("--arm", default="ur5", help="a folder of robots/ (default ur5); factory truths are of that one alone")
    parser.add_argument("--poses", type=int, nargs="+", default=[20, 30, 60, 200])
    parser.add_argument("--data", type=Path, default=ROOT.parent / "shared" / "data")
    with_jobs(parser)
    arguments = parser.parse_args()
    robot = load_robot(ROOT / "robots" / arguments.arm / f"{arguments.arm}.urdf.xacro")
    arms = factory_truths(arguments.data) if arguments.arm == "ur5" and (arguments.data / "ur_factory").is_dir() else []
    print(f"{arguments.arm}, 1 mm noise, {arguments.robots} robots each: held-out RMS [mm], defaults and by evidence; ratio (median, 95 %)")
    for kind in ("gaussian", *(["factory"] if arms else []), "zero"):
        for poses in arguments.poses:
            both = np.array(over(partial(held_out, robot, poses, kind, arms), range(arguments.robots), arguments))
            ratio = both[:, 1] / both[:, 0]
            print(
                f"  {kind:9s} {poses:4d} poses   {np.median(both[:, 0]):.3f}   {np.median(both[:, 1]):.3f}   "
                f"{np.median(ratio):.2f} {np.quantile(ratio, 0.95):.2f}   evidence better in {np.mean(ratio < 1):.0%}"
            )


if __name__ == "__main__":
    main()
