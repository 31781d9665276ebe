"""Every sensor on simulated UR5s: is the noise found, is the truth within what the fit claims, and how long do 10 000 poses take?

    python tests/benchmarks/sensors.py [--robots N] [--poses N] [--data DIR] [--speed]

Truths are Gaussian (2 mm, 0.2 deg in the parameters of `auto`, stated as the joints' prior, so that every interval ought to hold) and
the makers' own calibrations of UR arms (ur_factory in DIR; six numbers a joint, priors chosen by the data). Measuring frame, targets and
places stand anywhere. Unseen readings are without noise, so that what is off is the calibration alone.
"""

from __future__ import annotations

import argparse
import resource
import subprocess
import sys
import time
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))

import numpy as np

from tests.support.studies import over, with_jobs
from urdfcal.api import Calibration, fit
from urdfcal.base.geometry import DEG, MM
from urdfcal.calibration.error_table import error_table, rms_of
from urdfcal.calibration.problem import Problem
from urdfcal.model.gauge import build_error_model
from urdfcal.model.options import ModelOptions
from urdfcal.model.parameters import PriorScale
from urdfcal.robot.robot import Robot, load_robot
from urdfcal.sensors.measurements import Measurements
from urdfcal.sensors.readings import KnownLength
from urdfcal.simulation.readings import ReadingNoise, simulate_readings
from urdfcal.simulation.setup import SimulatedSetup, parse_sensors, seen_with, simulated_setup

try:
    from tests.benchmarks.evidence import factory_truths
except ModuleNotFoundError:  # run as a script
    from evidence import factory_truths

ROOT = Path(__file__).parents[2]
SENSORS = {
    "point": ("point:tool0",),
    "point, no z": ("point:tool0",),
    "three points": ("point:tool0", "point:tool0:b", "point:forearm_link"),
    "pose": ("pose:tool0",),
    "distance": ("distance:tool0",),
    "plane": ("plane:tool0:probe",),
    "socket": ("socket:tool0:ball",),
    "socket, a length known": ("socket:tool0:ball",),
    "socket and point": ("socket:tool0:ball", "point:tool0"),
    "laser and point": ("laser", "point:tool0"),
}
ALONE = ("point", "pose", "distance", "plane", "socket")
NOISE = ReadingNoise(spot=0.5 * MM, length=0.1 * MM, angle=0.02 * DEG)
SCALE = PriorScale(2 * MM, 0.2 * DEG)
Z95 = 1.959963984540054


@dataclass(frozen=True)
class Run:
    """One simulated robot.

    Attributes:
        noise: Found over true, by kind.
        inside: Of each joint parameter, whether its 95 % interval holds the truth; empty where the truth has other parameters.
        share: Errors of unseen readings over their claimed standard deviations.
        before: RMS of unseen readings with the nominal robot, [mm].
        after: With the calibrated one, [mm].
    """

    noise: dict[str, float]
    inside: np.ndarray
    share: np.ndarray
    before: float
    after: float


def setup_of(robot: Robot, name: str, truth: np.ndarray | None, rng: np.random.Generator) -> SimulatedSetup:
    """A robot with Gaussian errors in the parameters of `auto`, or with the stated ones, (36,), in six a joint."""
    sensors, lasers = parse_sensors(SENSORS[name], robot, 6)
    seen = seen_with(robot, sensors, "", lasers)
    errors = build_error_model(seen.chain, seen.rig, ModelOptions(error_model="auto" if truth is None else "placement"))
    x = rng.normal(0, 1, len(errors.names)) * [SCALE.sigma(unit) for unit in errors.units]
    if truth is not None:
        x[[parameter.kind == "joint" for parameter in errors.parameters]] = truth
    return simulated_setup(seen, errors, x, sensors, rng)


def measured(setup: SimulatedSetup, name: str, poses: int, rng: np.random.Generator, noise: ReadingNoise | None = None) -> Measurements:
    """Readings of the sensors of that name."""
    data = simulate_readings(setup, poses, rng, noise)
    if name == "socket, a length known":
        apart = float(np.linalg.norm(setup.place("socket:1") - setup.place("socket:2")))
        return replace(data, lengths=(KnownLength("socket:1", "socket:2", apart),))
    if name != "point, no z":
        return data
    flat = data.readings[0].values.copy()
    flat[:, 2] = np.nan
    return replace(data, readings=(replace(data.readings[0], values=flat),))


def run(robot: Robot, name: str, poses: int, arms: list[np.ndarray], seed: int) -> Run:
    """Simulate, fit, and compare with the truth, of which arms take turns if there are any, and with readings that were not fitted."""
    truth = arms[seed % len(arms)] * (-1.0) ** (seed // len(arms)) if arms else None
    rng = np.random.default_rng([seed, poses])
    setup = setup_of(robot, name, truth, rng)
    data, unseen = measured(setup, name, poses, rng, NOISE), measured(setup, name, 200, rng)
    found = fit(setup.robot, data, priors={"joint": SCALE} if truth is None else {}, gated=False)
    model = Problem(found.errors, unseen)
    here = model.linearise(found.x)
    spread = np.sqrt(np.einsum("nmp,pq,nmq->nm", here.jacobian, found.covariance, here.jacobian))
    rows = here.measured.copy()
    rows[len(unseen) :] = False
    true_noise = {"spot": NOISE.spot, "orientation": NOISE.angle}
    sigma = dict(zip(found.kinds, found.estimate.noise.sigma.tolist(), strict=True))
    after = rms_of(error_table(here, len(unseen)))
    return Run(
        {kind: value / true_noise.get(kind, NOISE.length) for kind, value in sigma.items()},
        held(setup, found) if truth is None else np.empty(0),
        here.residual[rows] / spread[rows],
        rms_of(found.nominal.table(unseen)),
        after,
    )


def held(setup: SimulatedSetup, found: Calibration) -> np.ndarray:
    """Whether the interval of each joint parameter holds the truth."""
    truth = dict(zip(setup.errors.names, setup.x.tolist(), strict=True))
    joints = [index for index, parameter in enumerate(found.errors.parameters) if parameter.kind == "joint"]
    names = [found.errors.names[index] for index in joints]
    return np.abs(found.x[joints] - [truth[name] for name in names]) < Z95 * found.sigma[joints]


def line(name: str, kind: str, poses: int, runs: list[Run]) -> str:
    """One row of the table."""
    noise = ", ".join(f"{own} {np.mean([one.noise[own] for one in runs]):.3f}" for own in runs[0].noise)
    inside = np.concatenate([one.inside for one in runs])
    holds = f"{inside.mean():.1%} of {inside.size}" if inside.size else "-"
    within = np.mean(np.abs(np.concatenate([one.share for one in runs])) < Z95)
    rms = np.median([np.sqrt(np.mean(one.share**2)) for one in runs])
    before, after = np.median([one.before for one in runs]), np.median([one.after for one in runs])
    return f"| {name} | {kind} | {poses} | {noise} | {holds} | {within:.1%} | {rms:.2f} | {before:.2f} | {after:.3f} |"


def study(robot: Robot, arguments: argparse.Namespace, arms: list[np.ndarray]) -> None:
    """Print the table."""
    robots, poses = arguments.robots, arguments.poses
    print(f"{robots} simulated UR5s each, noise 0.1 mm and 0.02 deg (spots 0.5 mm)")
    head = (
        "sensor",
        "truth",
        "poses",
        "noise found / true",
        "parameters in 95 %",
        "unseen in 95 %",
        "error / claim",
        "before mm",
        "after mm",
    )
    print(f"| {' | '.join(head)} |\n|{'---|' * len(head)}")
    for name in SENSORS:
        for kind, truths in (("Gaussian", []), *([("factory", arms)] if arms else [])):
            runs = over(partial(run, robot, name, poses, truths), range(robots), arguments)
            print(line(name, kind, poses, runs), flush=True)


def speed(robot: Robot, name: str, poses: int) -> str:
    """Time and peak memory of one fit, in this process."""
    rng = np.random.default_rng(0)
    setup = setup_of(robot, name, None, rng)
    data = measured(setup, name, poses, rng, NOISE)
    before, start = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, time.perf_counter()
    found = fit(setup.robot, data, gated=False)
    took, peak = time.perf_counter() - start, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    memory = f"{peak / 2**20:.2f} GiB ({before / 2**20:.2f} before the fit)"
    return f"| {name} | {poses} | {took:.2f} s | {len(found.estimate.history) - 1} | {memory} |"


def main() -> None:
    """Parse the command line and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robots", type=int, default=30)
    parser.add_argument("--poses", type=int, default=100)
    parser.add_argument("--data", type=Path, default=ROOT.parent / "shared" / "data")
    parser.add_argument("--speed", action="store_true", help="time 10 000 poses of each sensor, each in a process of its own")
    parser.add_argument("--one", help=argparse.SUPPRESS)
    with_jobs(parser)
    arguments = parser.parse_args()
    robot = load_robot(ROOT / "robots" / "ur5" / "ur5.urdf.xacro")
    if arguments.one:
        print(speed(robot, arguments.one, 10_000))
    elif arguments.speed:
        print("| sensor | poses | fit | sweeps | peak memory |\n|---|---|---|---|---|")
        for name in ALONE:
            subprocess.run([sys.executable, __file__, "--one", name], check=True)
    else:
        there = (arguments.data / "ur_factory").is_dir()
        if not there:
            print(f"no factory truths: {arguments.data / 'ur_factory'} is not there (name its folder with --data)")
        study(robot, arguments, factory_truths(arguments.data) if there else [])


if __name__ == "__main__":
    main()
