"""Do sigmas hold where lenses are refined with the robot? Lenses drawn from the covariance of their files, two cameras before a UR5.

    python tests/benchmarks/refined_lens.py [--sets N] [--poses N] [--as-filed] [--jobs N] [--resume FOLDER]

Every joint is off by 2 mm and 0.2 deg along the parameters of `auto`, corners of a board have 0.2 px of noise. Printed is how often 95 %
intervals hold: of the joints' determined parameters, and of the intrinsics. `--as-filed` takes the lenses as their files have them.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))

import numpy as np

from tests.calibration.test_refined_lens import FILE
from tests.simulation.test_pictures import GRID
from tests.support.paths import ROBOTS_DIR
from tests.support.studies import over, with_jobs
from urdfcal.api import Robot, fit, load_robot
from urdfcal.base.geometry import DEG, MM
from urdfcal.estimation.identifiability import DETERMINED
from urdfcal.model.gauge import build_error_model
from urdfcal.sensors.columns import Stations
from urdfcal.simulation.readings import ReadingNoise, simulate_readings
from urdfcal.simulation.setup import parse_sensors, seen_with, simulated_setup

NAMES, Z95 = ("one", "two"), 1.959963984540054


def run(robot: Robot, poses: int, as_filed: bool, seed: int) -> tuple[list[bool], list[bool]]:
    """Whether the intervals of one set hold: of the joints' determined parameters, and of the intrinsics."""
    rng, boards = np.random.default_rng(seed), {"tool0": GRID}
    true = {name: FILE.refined(rng.normal(0, 1, 9)) for name in NAMES}
    stations = Stations(dict.fromkeys(NAMES, "base_link"), cameras=true)
    sensors, _ = parse_sensors([f"pixels:tool0@{name}" for name in NAMES], robot, 0, boards, stations)
    seen = seen_with(robot, sensors, "", False, boards, stations)
    errors = build_error_model(seen.chain, seen.rig)
    x = np.array([rng.normal(0, 2 * MM if own.unit == "m" else 0.2 * DEG) for own in errors.parameters])
    setup = simulated_setup(seen, errors, x, sensors, rng, boards=boards, stations=stations)
    data = replace(simulate_readings(setup, poses, rng, ReadingNoise(pixel=0.2)), cameras=dict.fromkeys(NAMES, FILE))
    found = fit(robot, data, estimate=[] if as_filed else ["lens"])
    truth = dict(zip(setup.errors.names, setup.x.tolist(), strict=True))
    own = [row for row, each in enumerate(found.errors.parameters) if each.kind == "joint"]
    own = [row for row in own if found.sigma[row] < DETERMINED * found.errors.sigma[row]]
    joints = [bool(abs(found.x[row] - truth[found.errors.names[row]]) < Z95 * found.sigma[row]) for row in own]
    lenses = list[bool]()
    for name, camera in found.refined_cameras().items():
        off = np.abs(camera.intrinsics - true[name].intrinsics)
        lenses += (off < Z95 * np.sqrt(np.diag(camera.lens_covariance))).tolist()
    return joints, lenses


def main() -> None:
    """Print two shares."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--sets", type=int, default=40)
    parser.add_argument("--poses", type=int, default=60)
    parser.add_argument("--as-filed", action="store_true")
    with_jobs(parser)
    arguments = parser.parse_args()
    robot = load_robot(ROBOTS_DIR / "ur5" / "ur5.urdf.xacro")
    runs = over(partial(run, robot, arguments.poses, arguments.as_filed), range(arguments.sets), arguments)
    joints, lenses = (np.concatenate(own) for own in zip(*runs, strict=True))
    told = f", {np.mean(lenses):.1%} of {len(lenses)} intrinsics" if len(lenses) else ""
    print(f"95 % intervals hold {np.mean(joints):.1%} of {len(joints)} parameters of joints{told}")


if __name__ == "__main__":
    main()
