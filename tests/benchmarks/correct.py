"""Does the real tool come where it was wanted, by targets that were corrected?

    python -m tests.benchmarks.correct [--targets N] [--seed N]

Simulated real arms with errors of 1 mm and 0.1 deg in six directions of every joint; 60 poses measured (0.1 mm, 0.02 deg) in the
base's own frame, fitted with both ends known. Then targets, joints and placements in turn, at random configurations whose Jacobian has no
singular value below 0.05. *nominal*: RMS distance of the real tool from where it was wanted with the targets as they are; *corrected*: with
those of `correct`; *floor*: from where the calibrated model has it at the same positions, which is what the model itself is off by; *kept*:
targets at which no joint turns by more than 10 deg from the nominal configuration; *a second*: targets, joints and placements. In the lines
with *sag* each joint of the real arm also gives way under gravity, by 1 mrad about its own axis and half of that across it, and
`--compensation` has what was fitted of it; *geometry alone*: corrected without. The last line is a program of 1000 moves to placements that
follow each other, whose configuration is that of the move before.
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
from urdfcal.calibration.analysis.compensation import in_memory, load_compensation
from urdfcal.deploy.false_targets import FAR, Placements, false_joints, false_placements, sagging, solved
from urdfcal.deploy.programs.languages import read_program
from urdfcal.deploy.targets import corrected
from urdfcal.output.accounts import account_of
from urdfcal.output.stored import corrected_robot, read_calibration
from urdfcal.robot.packages import find_package
from urdfcal.robot.robot import load_robot
from urdfcal.robot.urdf_writer import with_origins
from urdfcal.robot.way import Way
from urdfcal.simulation.setup import parse_sensors, seen_with
from urdfcal.simulation.truth import SagScales, random_truth, soft_truth

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


def rigid(nominal: Way, rng: np.random.Generator) -> Placements:
    """Where an arm with errors has its tool."""
    robot, errors = nominal.robot, {name: rng.normal(0.0, [1 * MM] * 3 + [0.1 * DEG] * 3) for name in nominal.names}
    origins = {name: robot.tree.joints[name].origin * pin.exp6(error) for name, error in errors.items()}
    return Way.between(corrected_robot(robot, origins), nominal.tool).placements


def soft(nominal: Way, rng: np.random.Generator) -> Placements:
    """The same of one that also gives way."""
    sensors, lasers = parse_sensors([f"pose:{nominal.tool}"], nominal.robot, 1)
    robot = seen_with(nominal.robot, sensors, "", lasers)
    errors, x = random_truth(robot, rng, 1 * MM, 0.1 * DEG)
    errors, x = soft_truth(robot, errors, x, SagScales(own=1e-3, across=0.5e-3), rng)
    assert errors.soft is not None
    values = {term.name: (float(x[errors.names.index(term.name)]), 0.0) for term in errors.soft.terms}
    origins = {name: own for name, own in errors.corrected_origins(x).items() if name in nominal.names}
    return sagging(in_memory(robot, with_origins(robot.description, origins), errors.soft, values), nominal)


def fitted(path: Path, nominal: Way, true: Placements, folder: Path, rng: np.random.Generator, poses: int, *words: object) -> Path:
    """The calibration of measurements of the true arm."""
    data, out, robot, tool = folder / "data.csv", folder / "out.urdf", nominal.robot, nominal.tool
    q, rows = configurations(nominal, rng, poses), []
    for position, placed in zip(q, true(q), strict=True):
        read = pin.SE3(placed) * pin.SE3(pin.exp3(rng.normal(0.0, 0.02 * DEG, 3)), np.zeros(3))
        rows.append([*position, *(placed[:3, 3] + rng.normal(0.0, 0.1 * MM, 3)), *pin.Quaternion(read.rotation).coeffs()])
    columns = [*nominal.names, *(f"{tool}.{ending}" for ending in ("x", "y", "z", "qx", "qy", "qz", "qw"))]
    data.write_bytes(csv_text(columns, rows))
    known = ("--reference", robot.tree.root, "--reference-known", "--target-known")
    urdfcal("fit", path, data, *known, *words, "--no-ask", "--overwrite", "-o", out)
    return folder / "out_calibration.yaml"


def configurations(way: Way, rng: np.random.Generator, count: int) -> Matrix:
    """Random positions within the limits, away from singular ones."""
    lower, upper = np.maximum(way.limits[0], -np.pi), np.minimum(way.limits[1], np.pi)
    q = lower + (upper - lower) * rng.uniform(0.05, 0.95, (50 * count, len(lower)))
    _, J = way.jacobians(q)
    return q[np.linalg.svd(J, compute_uv=False)[:, -1] > 0.05][:count]


def rms(one: Array3, other: Array3) -> float:
    """Root mean square distance of tools, [mm]."""
    return float(np.sqrt(np.mean(np.sum((one[:, :3, 3] - other[:, :3, 3]) ** 2, axis=1)))) / MM


def corrected_line(path: Path, tool: str, sags: bool, targets: int, rng: np.random.Generator) -> str:
    """What a simulated arm gives."""
    nominal = Way.between(load_robot(path), tool)
    true = (soft if sags else rigid)(nominal, rng)
    with tempfile.TemporaryDirectory() as folder:
        words = ("--compensation", Path(folder) / "sag.yaml") if sags else ("--no-sag",)
        record = fitted(path, nominal, true, Path(folder), rng, 150 if sags else 60, *words)
        alone = Way.between(account_of(read_calibration(record), nominal.robot).robot, tool).placements
        found = sagging(load_compensation(Path(folder) / "sag.yaml"), nominal) if sags else alone
    q = configurations(nominal, rng, targets)
    wanted, begun = nominal.placements(q), time.process_time()
    joints = false_joints(nominal, found, q)
    halfway = time.process_time()
    placed = false_placements(nominal, found, wanted, solved(nominal, wanted, q + rng.normal(0.0, 0.02, q.shape)).q)
    done = time.process_time()
    told = joints.reached.q
    corrected, floor = rms(true(told), wanted), rms(true(told), found(told))
    kept = int((np.abs(joints.reached.moved).max(axis=1) < FAR).sum())
    again = solved(nominal, placed.placements, placed.reached.q)
    assert np.allclose(true(again.q), true(placed.reached.q), atol=1e-6) or nominal.inputs[6:]
    geometry = f"{rms(true(false_joints(nominal, alone, q).reached.q), wanted):10.3f}" if sags else f"{'':10}"
    speed = f"{len(q) / (halfway - begun):.0f}, {len(q) / (done - halfway):.0f}"
    off = rms(true(q), wanted)
    return f"{off:9.2f}{corrected:11.3f}{floor:8.3f}{corrected / floor:7.3f}{geometry}{kept:6} of {len(q)}{speed:>16}"


def program_line(path: Path, tool: str, rng: np.random.Generator) -> str:
    """1000 moves that follow each other, in URScript."""
    nominal = Way.between(load_robot(path), tool)
    q = np.array([0.3, -1.2, 1.4, -0.6, 1.2, 0.3]) + np.cumsum(rng.normal(0.0, 0.01, (1000, 6)), axis=0)
    poses = [",".join(f"{number:.9f}" for number in (*T[:3, 3], *pin.log3(T[:3, :3]))) for T in nominal.placements(q)]
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder) / "a.script"
        begin = "movej([0.3,-1.2,1.4,-0.6,1.2,0.3])\n"
        place.write_text(begin + "\n".join(f"movel(p[{pose}])" for pose in poses))
        file = read_program(place, nominal)
    real, begun = rigid(nominal, rng), time.process_time()
    found = corrected(file, nominal, real)
    seconds = time.process_time() - begun
    apart = max(float(np.abs(each.q - own).max()) for each, own in zip(found[1:], q, strict=True))
    return f"{len(found)} targets of a program: {len(found) / seconds:.0f} a second, joints within {apart / DEG:.2f} deg of the nominal"


def main() -> None:
    """Print a line an arm."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--targets", type=int, default=100)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    rng, robots = np.random.default_rng(options.seed), find_package("example-robot-data") / "robots"
    print(f"{'arm':12}{'nominal':>9}{'corrected':>11}{'floor':>8}{'ratio':>7}{'geometry':>10}{'kept':>10}{'a second':>16}")
    for sags in (False, True):
        for name, (path, tool) in ARMS.items():
            line = corrected_line(robots / path, tool, sags, options.targets, rng)
            print(f"{name + (' sag' if sags else ''):12}{line}", flush=True)
    print(program_line(robots / ARMS["UR5"][0], "tool0", rng))


if __name__ == "__main__":
    main()
