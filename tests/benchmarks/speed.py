"""Speed, as ratios taken in one run: a sweep, a fit, 100 000 poses, the paper's schedule, start-up.

python tests/benchmarks/speed.py
"""

from __future__ import annotations

import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pinocchio as pin

from urdfcal.api import fit
from urdfcal.calibration.problem import Problem
from urdfcal.calibration.reach import draw_poses
from urdfcal.estimation.ekf import Belief, paper_schedule
from urdfcal.estimation.noise import Noise
from urdfcal.model.error_model import ErrorModel
from urdfcal.model.gauge import build_error_model
from urdfcal.model.options import ModelOptions
from urdfcal.robot.robot import Robot, load_robot
from urdfcal.simulation.paper import paper_poses, paper_truth
from urdfcal.simulation.readings import SimulatedNoise, simulate

ROOT = Path(__file__).parents[2]
ARM7 = ROOT / "robots" / "arm7" / "arm7.urdf.xacro"


def best(function: Callable[[], object], repeats: int) -> float:
    """The shortest of several runs, [s]."""
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        function()
        times.append(time.perf_counter() - start)
    return min(times)


def bare_loop(robot: Robot, q: np.ndarray) -> None:
    """What Pinocchio alone takes for forward kinematics and regressor, called from Python pose by pose."""
    model, data = robot.model, robot.model.createData()
    module = model.getFrameId(robot.rig.tip)
    for pose in q:
        pin.forwardKinematics(model, data, pose)
        pin.computeFrameKinematicRegressor(model, data, module, pin.LOCAL)


def sweep(robot: Robot, errors: ErrorModel, truth: np.ndarray, rng: np.random.Generator) -> str:
    """One sweep over 6000 poses against the bare loop."""
    q = draw_poses(robot, errors, truth, 6000, rng)
    spots = Problem(errors, simulate(robot, errors, truth, q, rng))

    def normal_equations() -> None:
        spots.linearise(truth + 1e-6 * rng.normal(size=len(truth))).sums  # noqa: B018  # another state each time: the last one is known

    ours, bare = (np.median([best(f, 3) for _ in range(9)]) for f in (normal_equations, lambda: bare_loop(robot, q)))
    return (
        f"one sweep of 6000 poses with its normal equations               {ours / 6e-3:6.2f} us a pose, {ours / bare:.2f} x bare Pinocchio"
    )


def whole_fit(robot: Robot, errors: ErrorModel, truth: np.ndarray, rng: np.random.Generator) -> str:
    """`urdfcal.fit` of the paper's case 3."""
    data = simulate(robot, errors, truth, paper_poses(robot, errors, truth, rng), rng, SimulatedNoise(1.15e-3, 1e-3))
    auto, dh = (best(lambda model=model: fit(robot, data, error_model=model), 30) * 1e3 for model in ("auto", "dh"))
    return f"urdfcal.fit of case 3, 60 poses                                 {auto:6.1f} ms (auto), {dh:.1f} ms (dh)"


def many_poses(count: int) -> str:
    """A fit of many poses in a process of its own: time and peak memory."""
    done = subprocess.run([sys.executable, __file__, str(count)], capture_output=True, text=True, check=True)
    return done.stdout.strip()


def many_poses_here(count: int) -> str:
    """The same in this process."""
    robot, rng = load_robot(ARM7), np.random.default_rng(0)
    errors = build_error_model(robot.chain, robot.rig, ModelOptions(error_model="dh"))
    truth = paper_truth(errors)
    data = simulate(robot, errors, truth, draw_poses(robot, errors, truth, count, rng), rng, SimulatedNoise(1e-3))
    start, before = time.perf_counter(), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    found = fit(robot, data, error_model="dh")
    took, peak = time.perf_counter() - start, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return (
        f"urdfcal.fit of {count:6d} poses                                     {took:6.2f} s, {len(found.estimate.history) - 1} sweeps, "
        f"peak memory {peak / 2**20:.2f} GiB ({before / 2**20:.2f} before the fit)"
    )


def paper_sweeps(robot: Robot, errors: ErrorModel, truth: np.ndarray, rng: np.random.Generator) -> str:
    """5000 sweeps of the `paper` schedule."""
    data = simulate(robot, errors, truth, paper_poses(robot, errors, truth, rng), rng, SimulatedNoise(1.15e-3))
    spots, prior = Problem(errors, data), Belief(errors.mean, np.diag(errors.sigma**2))
    took = best(lambda: paper_schedule(spots.linearise, prior, Noise(1e-3, np.zeros(7)), tolerance=0.0, max_sweeps=5000), 1)
    return f"paper schedule, 5000 sweeps of 60 poses                         {took:6.2f} s"


def start_up() -> list[str]:
    """Whole commands as ratios to `python -c 'import pinocchio'`."""
    folder = tempfile.mkdtemp()
    command = [sys.executable, "-m", "urdfcal.cli"]

    def run(words: list[str]) -> float:
        return best(lambda: subprocess.run(words, check=True, capture_output=True, cwd=folder), 5)

    pinocchio = run([sys.executable, "-c", "import pinocchio"])
    lines = [f"python -c 'import pinocchio'                                    {pinocchio:6.2f} s"]
    for name, words in (("--help", ["--help"]), ("fit on arm7", ["fit", str(ARM7), str(ARM7.parent / "measurements.csv")])):
        took = run([*command, *words])
        lines.append(f"urdfcal {name:14s}                                          {took:6.2f} s, {took / pinocchio:.1f} x that")
    return lines


def main() -> None:
    """Print every figure."""
    if len(sys.argv) > 1:
        print(many_poses_here(int(sys.argv[1])))
        return
    robot, rng = load_robot(ARM7), np.random.default_rng(0)
    errors = build_error_model(robot.chain, robot.rig, ModelOptions(error_model="dh"))
    truth = paper_truth(errors)
    for line in (sweep(robot, errors, truth, rng), whole_fit(robot, errors, truth, rng)):
        print(line)
    for count in (1_000, 10_000, 100_000):
        print(many_poses(count))
    print(paper_sweeps(robot, errors, truth, rng))
    print("\n".join(start_up()))


if __name__ == "__main__":
    main()
