"""What one pose costs the online calibrator, and how far its belief is from the batch fit. Everything is simulated.

python tests/benchmarks/online.py
"""

from __future__ import annotations

import argparse
import time

import numpy as np

import urdfcal
from urdfcal.calibration.analysis.online import OnlineCalibrator
from urdfcal.calibration.reach import draw_poses
from urdfcal.model.options import ModelOptions
from urdfcal.simulation.readings import SimulatedNoise, simulate
from urdfcal.simulation.truth import random_truth

TRANSLATION, ROTATION, SPOT_NOISE = 3e-3, np.radians(0.3), 0.5e-3  # [m], [rad], [m]
ROBOTS = {"arm7": ModelOptions(estimate=("screen",)), "panda": ModelOptions()}
CHECKS = (5, 10, 20, 30, 50, 100, 200, 300, 400, 500)


def run(name: str, options: ModelOptions, poses: int, stated: bool) -> str:
    """One robot, pose by pose; a line of figures."""
    robot, rng = urdfcal.load_robot(f"robots/{name}/{name}.urdf.xacro"), np.random.default_rng(1)
    errors, truth = random_truth(robot, rng, TRANSLATION, ROTATION)
    data = simulate(robot, errors, truth, draw_poses(robot, errors, truth, poses, rng), rng, SimulatedNoise(SPOT_NOISE))
    calibrator = OnlineCalibrator(robot, options, spot_sigma=SPOT_NOISE if stated else None)
    took, fresh, off = [], [], {}
    for pose in range(poses):
        start = time.perf_counter()
        state = calibrator.update(data.q[pose], data.spots[pose])
        took.append(1e6 * (time.perf_counter() - start))
        fresh.append(state.relinearised)
        if pose + 1 in CHECKS:
            batch = calibrator.calibration()
            off[pose + 1] = float(np.max(np.abs(batch.x - state.x) / batch.sigma))
    cost, again = np.array(took), np.array(fresh)
    figures = (
        f"median {np.median(cost):.0f}, plain {np.median(cost[~again]):.0f}, afresh {np.median(cost[again]):.0f}, max {cost.max():.0f} us"
    )
    where = ", ".join(f"{count}: {sigmas:.4f}" for count, sigmas in off.items())
    noise = "noise stated" if stated else "noise estimated"
    compared = f"largest difference from the batch fit in sigmas at n poses: {where}"
    return f"{name:6s}{noise}: {figures}; {again.sum()} of {poses} afresh\n      {compared}"


def main() -> None:
    """Parse the command line and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--poses", type=int, default=500, help="how many poses (default 500)")
    arguments = parser.parse_args()
    for name, options in ROBOTS.items():
        for stated in (True, False):
            print(run(name, options, arguments.poses, stated), flush=True)


if __name__ == "__main__":
    main()
