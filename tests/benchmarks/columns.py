"""Spots that state their own noise, rightly or not: what is found beyond it, and do the sigmas hold the truth?

    python tests/benchmarks/columns.py [--seeds N] [--poses N] [--jobs N] [--resume FOLDER]

A Panda with Gaussian errors of 2 mm and 0.2 deg; what a column states is drawn for every spot, evenly on a logarithmic scale.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass
from functools import partial
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))

import numpy as np

from tests.support.studies import over, with_jobs
from urdfcal.api import fit
from urdfcal.base.geometry import DEG, MM
from urdfcal.calibration.reach import draw_poses
from urdfcal.model.gauge import build_error_model
from urdfcal.robot.robot import Robot, load_robot
from urdfcal.simulation.readings import SimulatedNoise, simulate

PANDA = Path(__file__).parents[2] / "robots" / "panda" / "panda.urdf.xacro"


@dataclass(frozen=True)
class Case:
    """What columns state, and what is true.

    Attributes:
        stated: From and to, [mm].
        beyond: Noise that no column states, [mm].
        outliers: Share of the spots that are up to 200 mm off.
    """

    stated: tuple[float, float]
    beyond: float = 0.0
    outliers: float = 0.0


CASES = {
    "right, 0.3 to 3 mm": Case((0.3, 3.0)),
    "right, 0.03 to 10 mm": Case((0.03, 10.0)),
    "right, and 20 % outliers": Case((0.3, 3.0), outliers=0.2),
    "1 mm beyond 0.3 to 3 mm": Case((0.3, 3.0), 1.0),
    "1 mm beyond 0.1 mm": Case((0.1, 0.1), 1.0),
    "0.5 mm beyond 1 mm": Case((1.0, 1.0), 0.5),
}


def tried(robot: Robot, case: Case, poses: int, seed: int) -> tuple[float, float, float]:
    """Share of the parameters in their 95 % interval, root mean square of error over sigma, and the noise that was added, [mm]."""
    rng = np.random.default_rng(seed)
    errors = build_error_model(robot.chain, robot.rig)
    truth = rng.normal(size=len(errors.names)) * np.where(np.array(errors.units) == "m", 2 * MM, 0.2 * DEG)
    data = simulate(robot, errors, truth, draw_poses(robot, errors, truth, poses, rng), rng, SimulatedNoise(0.0))
    stated = np.exp(rng.uniform(*np.log(case.stated), data.seen.shape)) * MM
    off = rng.normal(size=data.spots.shape) * np.hypot(stated, case.beyond * MM)[..., None]
    wild = rng.random(data.seen.shape) < case.outliers
    off += wild[..., None] * rng.uniform(-200 * MM, 200 * MM, data.spots.shape)
    found = fit(robot, data.with_spots(data.spots + off, sigma=stated))
    away = (found.x - truth) / found.sigma
    return float(np.mean(np.abs(away) < 1.96)), float(np.sqrt(np.mean(away**2))), found.extra_noise.get("spot", 0.0) / MM


def main() -> None:
    """Print a line for each case."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=60)
    parser.add_argument("--poses", type=int, default=60)
    with_jobs(parser)
    arguments = parser.parse_args()
    robot = load_robot(PANDA)
    for name, case in CASES.items():
        held, rms, added = np.array(over(partial(tried, robot, case, arguments.poses), range(arguments.seeds), arguments)).T
        print(
            f"{name:26s} parameters in 95 %: {held.mean():6.1%}, error over sigma {np.sqrt(np.mean(rms**2)):.2f}; "
            f"noise was added {np.count_nonzero(added)} of {len(added)} times, {added.mean():.3f} mm on average",
            flush=True,
        )


if __name__ == "__main__":
    main()
