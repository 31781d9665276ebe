"""Does `compare` call two calibrations of one arm the same as often as it should, and of a changed arm different?

    python -m tests.benchmarks.comparisons [--pairs N]

Simulated arms with errors of 1 mm and 0.1 deg in six directions of every joint, measured twice at 40 poses of their own by a tracker
that reads points of the tool (0.1 mm), each time fitted by itself. *differ*: pairs of which is said that they differ by more than they
are unsure of (5 % would be right); *mean p*: of the probabilities (0.5 would be right). Then one joint's zero is changed by 0.05 deg.
"""

from __future__ import annotations

import argparse
import os
import tempfile
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
import pinocchio as pin

import urdfcal
from urdfcal.base.geometry import DEG, MM
from urdfcal.base.tables import csv_text
from urdfcal.calibration.analysis.comparison import Account, compare
from urdfcal.calibration.known_joints import joints_of
from urdfcal.output.stored import corrected_robot
from urdfcal.robot.packages import find_package
from urdfcal.robot.robot import Robot, load_robot
from urdfcal.robot.way import Way

ARMS = {
    "UR5": ("ur_description/urdf/ur5_robot.urdf", "tool0", "elbow_joint"),
    "Panda": ("panda_description/urdf/panda.urdf", "panda_link8", "panda_joint4"),
}


def measured(true: Way, path: Path, rng: np.random.Generator, count: int = 40) -> None:
    """Write what a tracker reads of the tool."""
    lower, upper = np.maximum(true.limits[0], -np.pi), np.minimum(true.limits[1], np.pi)
    q = rng.uniform(lower, upper, (count, len(lower)))
    points = true.placements(q)[:, :3, 3] + rng.normal(0.0, 0.1 * MM, (count, 3))
    path.write_bytes(csv_text([*true.names, *(f"{true.tool}.{axis}" for axis in "xyz")], np.hstack([q, points])))


def account(label: str, robot: Robot, true: Way, rng: np.random.Generator) -> Account:
    """What a calibration says of the arm."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "data.csv"
        measured(true, path, rng)
        data = urdfcal.read_measurements(path, robot, reference=robot.tree.root)
    found = urdfcal.fit(robot, data, asking=False)
    origins = {name: own.corrected for name, own in found.corrections.items()}
    return Account(label, corrected_robot(robot, origins), joints_of(found))


def main() -> None:
    """Print two lines an arm."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pairs", type=int, default=60)
    options = parser.parse_args()
    robots = find_package("example-robot-data") / "robots"
    for name, (path, tool, changed) in ARMS.items():
        robot = load_robot(robots / path)
        nominal = Way.between(robot, tool)
        for change in (0.0, 0.05 * DEG):
            chances = []
            for seed in range(options.pairs):
                rng = np.random.default_rng(seed)
                errors = {joint: rng.normal(0.0, [1 * MM] * 3 + [0.1 * DEG] * 3) for joint in nominal.names}
                origins = {joint: robot.tree.joints[joint].origin * pin.exp6(error) for joint, error in errors.items()}
                before = Way.between(corrected_robot(robot, origins), tool)
                turn = np.concatenate([np.zeros(3), np.array(robot.tree.joints[changed].axis) * change])
                origins[changed] = origins[changed] * pin.exp6(turn)
                after = Way.between(corrected_robot(robot, origins), tool)
                pair = account("before", robot, before, rng), account("after", robot, after, rng)
                chances.append(compare(*pair, tool, rng, count=200).by_chance or 0.0)
            differ = np.mean(np.array(chances) < 0.05)
            print(
                f"{name:7} changed by {change / DEG:.2f} deg: differ {differ:6.1%}, mean p {np.mean(chances):.2f} of {len(chances)} pairs"
            )


if __name__ == "__main__":
    main()
