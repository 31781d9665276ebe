"""Do sigmas hold where lenses are refined with the robot? Lenses drawn from the covariance of their files, two cameras before a UR5.

    python tests/benchmarks/refined_lens.py [--sets N] [--poses N] [--as-filed]

Every joint is off by 2 mm and 0.2 deg along the parameters of `auto`, corners of a board have 0.2 px of noise. Printed is how often 95 %
intervals hold: of the joints' determined parameters, and of the intrinsics. `--as-filed` takes the lenses as their files have them.
"""

from __future__ import annotations

import argparse
from dataclasses import replace

import numpy as np

from tests.calibration.test_refined_lens import FILE
from tests.simulation.test_pictures import GRID
from tests.support.paths import ROBOTS_DIR
from urdfcal.api import fit, load_robot
from urdfcal.base.geometry import DEG, MM
from urdfcal.estimation.identifiability import DETERMINED
from urdfcal.model.gauge import build_error_model
from urdfcal.sensors.columns import Stations
from urdfcal.simulation.readings import ReadingNoise, simulate_readings
from urdfcal.simulation.setup import parse_sensors, seen_with, simulated_setup

NAMES, Z95 = ("one", "two"), 1.959963984540054


def main() -> None:
    """Print two shares."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--sets", type=int, default=40)
    parser.add_argument("--poses", type=int, default=60)
    parser.add_argument("--as-filed", action="store_true")
    arguments = parser.parse_args()
    robot, boards = load_robot(ROBOTS_DIR / "ur5" / "ur5.urdf.xacro"), {"tool0": GRID}
    joints, lenses = list[bool](), list[bool]()
    for seed in range(arguments.sets):
        rng = np.random.default_rng(seed)
        true = {name: FILE.refined(rng.normal(0, 1, 9)) for name in NAMES}
        stations = Stations(dict.fromkeys(NAMES, "base_link"), cameras=true)
        sensors, _ = parse_sensors([f"pixels:tool0@{name}" for name in NAMES], robot, 0, boards, stations)
        seen = seen_with(robot, sensors, "", False, boards, stations)
        errors = build_error_model(seen.chain, seen.rig)
        x = np.array([rng.normal(0, 2 * MM if own.unit == "m" else 0.2 * DEG) for own in errors.parameters])
        setup = simulated_setup(seen, errors, x, sensors, rng, boards=boards, stations=stations)
        data = replace(simulate_readings(setup, arguments.poses, rng, ReadingNoise(pixel=0.2)), cameras=dict.fromkeys(NAMES, FILE))
        found = fit(robot, data, estimate=[] if arguments.as_filed else ["lens"])
        truth = dict(zip(setup.errors.names, setup.x.tolist(), strict=True))
        own = [row for row, each in enumerate(found.errors.parameters) if each.kind == "joint"]
        own = [row for row in own if found.sigma[row] < DETERMINED * found.errors.sigma[row]]
        joints += [abs(found.x[row] - truth[found.errors.names[row]]) < Z95 * found.sigma[row] for row in own]
        for name, camera in found.refined_cameras().items():
            off = np.abs(camera.intrinsics - true[name].intrinsics)
            lenses += (off < Z95 * np.sqrt(np.diag(camera.lens_covariance))).tolist()
    told = f", {np.mean(lenses):.1%} of {len(lenses)} intrinsics" if lenses else ""
    print(f"95 % intervals hold {np.mean(joints):.1%} of {len(joints)} parameters of joints{told}")


if __name__ == "__main__":
    main()
