"""Poses chosen by `plan_poses` against random ones: how far off the tool really is after a fit of them, and is predicted to be.

Robots with errors drawn from the prior (0.3 of its sigmas), lasers with 1 mm of noise. Everything is simulated.

python -m tests.benchmarks.planned
"""

from __future__ import annotations

import argparse

import numpy as np

import urdfcal
from tests.calibration.analysis.test_prediction import tool_errors
from urdfcal.calibration.reach import draw_poses
from urdfcal.model.gauge import build_error_model
from urdfcal.robot.configurations import joint_limits
from urdfcal.simulation.readings import SimulatedNoise, simulate

NOISE = 1e-3  # [m]


def run(name: str, poses: int, robots: int) -> str:
    """A line of figures: RMS over robots and workspace, in mm."""
    robot = urdfcal.load_robot(f"robots/{name}/{name}.urdf.xacro")
    errors = build_error_model(robot.chain, robot.rig)
    off: dict[str, list[float]] = {"chosen": [], "random": []}
    for seed in range(robots):
        rng = np.random.default_rng(seed)
        truth = errors.mean + 0.3 * errors.sigma * rng.normal(size=len(errors.names))
        plan = urdfcal.plan_poses(robot, n=poses, candidates=1000, seed=100 + seed)
        workspace = rng.uniform(*joint_limits(robot), (60, len(robot.chain.inputs)))
        for what, q in (("chosen", plan.q), ("random", draw_poses(robot, errors, truth, poses, rng))):
            data = simulate(robot, errors, truth, q, np.random.default_rng(seed), SimulatedNoise(NOISE))
            found = urdfcal.fit(robot, data, spot_sigma=NOISE, gated=False, evidence=False, asking=False, sane=False)
            off[what].append(float(tool_errors(robot, errors, truth, found.x[None], "slm", workspace)[0].mean()))
    told = ", ".join(f"{what} {1e3 * np.sqrt(np.mean(squares)):.2f}" for what, squares in off.items())
    return f"{name:6s}{poses} poses: {told} mm off; predicted {plan.tool_sigma_mm[-1]:.2f} and {plan.at_random_mm:.2f}"


def main() -> None:
    """Parse the command line and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robots", type=int, default=10, help="how many robots (default 10)")
    arguments = parser.parse_args()
    for name in ("panda", "ur5"):
        for poses in (12, 30):
            print(run(name, poses, arguments.robots), flush=True)


if __name__ == "__main__":
    main()
