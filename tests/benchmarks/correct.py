"""Does the real tool come where it was wanted, by targets that were corrected?

    python -m tests.benchmarks.correct [--targets N] [--seed N]

Simulated real arms with errors of 1 mm and 0.1 deg in six directions of every joint; 60 poses measured (0.1 mm, 0.02 deg) in the
base's own frame, fitted with both ends known. Then targets, joints and placements in turn, at random configurations whose Jacobian has no
singular value below 0.05. *nominal*: RMS distance of the real tool from where it was wanted with the targets as they are; *corrected*: with
those of `correct`; *floor*: from where the calibrated model has it at the same positions, which is what the model itself is off by; *kept*:
targets at which no joint turns by more than 10 deg from the nominal configuration; *a second*: targets, joints and placements.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
import pinocchio as pin

from urdfcal.base.geometry import DEG, MM, Array3, Matrix
from urdfcal.base.tables import csv_text
from urdfcal.deploy.false_targets import FAR, false_joints, false_placements, solved
from urdfcal.output.accounts import account_of
from urdfcal.output.stored import corrected_robot, read_calibration
from urdfcal.robot.packages import find_package
from urdfcal.robot.robot import load_robot
from urdfcal.robot.way import Way

ARMS = {
    "UR5": ("ur_description/urdf/ur5_robot.urdf", "tool0"),
    "Panda": ("panda_description/urdf/panda.urdf", "panda_link8"),
    "TIAGo": ("tiago_description/robots/tiago.urdf", "arm_tool_link"),
    "TALOS": ("talos_data/robots/talos_reduced.urdf", "gripper_left_base_link"),
    "Kinova": ("kinova_description/robots/kinova.urdf", "j2s6s200_end_effector"),
}


def urdfcal(*words: object) -> None:
    """Run a command."""
    subprocess.run([sys.executable, "-m", "urdfcal", *map(str, words)], check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def ways(path: Path, tool: str, folder: Path, rng: np.random.Generator) -> tuple[Way, Way, Way]:
    """The nominal, the true and the calibrated arm."""
    data, out, robot = folder / "data.csv", folder / "out.urdf", load_robot(path)
    nominal = Way.between(robot, tool)
    errors = {name: rng.normal(0.0, [1 * MM] * 3 + [0.1 * DEG] * 3) for name in nominal.names}
    origins = {name: robot.tree.joints[name].origin * pin.exp6(error) for name, error in errors.items()}
    true, q = Way.between(corrected_robot(robot, origins), tool), configurations(nominal, rng, 60)
    rows = []
    for position, placed in zip(q, true.placements(q), strict=True):
        read = pin.SE3(placed) * pin.SE3(pin.exp3(rng.normal(0.0, 0.02 * DEG, 3)), np.zeros(3))
        rows.append([*position, *(placed[:3, 3] + rng.normal(0.0, 0.1 * MM, 3)), *pin.Quaternion(read.rotation).coeffs()])
    columns = [*nominal.names, *(f"{tool}.{ending}" for ending in ("x", "y", "z", "qx", "qy", "qz", "qw"))]
    data.write_bytes(csv_text(columns, rows))
    known = ("--reference", robot.tree.root, "--reference-known", "--target-known")
    urdfcal("fit", path, data, *known, "--no-sag", "--no-ask", "--overwrite", "-o", out)
    found = account_of(read_calibration(folder / "out_calibration.yaml"), robot).robot
    return nominal, true, Way.between(found, tool)


def configurations(way: Way, rng: np.random.Generator, count: int) -> Matrix:
    """Random positions within the limits, away from singular ones."""
    lower, upper = np.maximum(way.limits[0], -np.pi), np.minimum(way.limits[1], np.pi)
    q = lower + (upper - lower) * rng.uniform(0.05, 0.95, (50 * count, len(lower)))
    _, J = way.jacobians(q)
    return q[np.linalg.svd(J, compute_uv=False)[:, -1] > 0.05][:count]


def rms(one: Array3, other: Array3) -> float:
    """Root mean square distance of tools, [mm]."""
    return float(np.sqrt(np.mean(np.sum((one[:, :3, 3] - other[:, :3, 3]) ** 2, axis=1)))) / MM


def main() -> None:
    """Print a line an arm."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--targets", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    rng, robots = np.random.default_rng(options.seed), find_package("example-robot-data") / "robots"
    print(f"{'arm':8}{'nominal':>9}{'corrected':>11}{'floor':>8}{'ratio':>7}{'kept':>10}{'a second':>16}")
    for name, (path, tool) in ARMS.items():
        with tempfile.TemporaryDirectory() as folder:
            nominal, true, found = ways(robots / path, tool, Path(folder), rng)
        q = configurations(nominal, rng, options.targets)
        wanted, begun = nominal.placements(q), time.process_time()
        joints = false_joints(nominal, found.placements, q)
        halfway = time.process_time()
        placed = false_placements(nominal, found.placements, wanted, solved(nominal, wanted, q + rng.normal(0.0, 0.02, q.shape)).q)
        done = time.process_time()
        told = joints.reached.q
        corrected, floor = rms(true.placements(told), wanted), rms(true.placements(told), found.placements(told))
        kept = int((np.abs(joints.reached.moved).max(axis=1) < FAR).sum())
        again = solved(nominal, placed.placements, placed.reached.q)
        assert np.allclose(true.placements(again.q), true.placements(placed.reached.q), atol=1e-6) or nominal.inputs[6:]
        speed = f"{len(q) / (halfway - begun):.0f}, {len(q) / (done - halfway):.0f}"
        nominal_off = rms(true.placements(q), wanted)
        print(f"{name:8}{nominal_off:9.2f}{corrected:11.3f}{floor:8.3f}{corrected / floor:7.3f}{kept:6} of {len(q)}{speed:>16}")


if __name__ == "__main__":
    main()
