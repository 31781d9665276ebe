"""Convergence from afar: screen and module placed only roughly, joints 20 mm and 3 deg off. Does `fit` reach the answer?

    python tests/benchmarks/far_start.py [--seeds N] [--poses N] [--jobs N] [--resume FOLDER] [-v]

Truths: Gaussian joint parameters; screen and module off by a given distance and angle in random directions. On a rig whose screen has
no placement of its own, the joint parameters that stand for it are off instead. The nominal robot is where `fit` starts. *Same answer*:
it agrees to 1e-3 of every sigma with the filter that starts from the truth, on the spots that `fit` kept and under the priors and the
noise that it had in the end. *Refused*: `fit` took the data for mistaken ones. *Widened*: it said that the rig stands elsewhere. *Lost*:
share of the good spots that were left out, all starts together. Spots have no outliers unless asked for.
"""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))

import numpy as np
import numpy.typing as npt

import urdfcal
from tests.support.studies import over, with_jobs
from urdfcal.base.errors import UsageError
from urdfcal.base.geometry import DEG, MM, Mask
from urdfcal.calibration.problem import Problem
from urdfcal.calibration.reach import draw_poses
from urdfcal.calibration.start.rig_search import rig_columns
from urdfcal.estimation.ekf import Belief, Estimate, iterated_schedule
from urdfcal.model.error_model import ErrorModel
from urdfcal.model.gauge import build_error_model
from urdfcal.model.options import ModelOptions
from urdfcal.sensors.measurements import Measurements
from urdfcal.simulation.readings import SimulatedNoise, simulate

Array = npt.NDArray[np.float64]

CASES = (("panda", ()), ("ur5", ()), ("arm7", ("screen",)), ("arm7", ()))


@dataclass(frozen=True)
class Start:
    """How far off all is, how noisy spots are, the share of bad ones, and how many poses."""

    mm: float
    deg: float
    joint_mm: float
    joint_deg: float
    noise_mm: float
    outliers: float
    poses: int


def off(errors: ErrorModel, columns: Array, mm: float, deg: float, rng: np.random.Generator) -> Array:
    """A displacement of given length and angle in a random direction."""
    value = rng.normal(size=len(columns))
    lengths = np.array([errors.units[column] == "m" for column in columns])
    for part, size in ((lengths, mm * MM), (~lengths, deg * DEG)):
        value[part] *= size / np.linalg.norm(value[part])
    return value


def draw_truth(errors: ErrorModel, start: Start, rng: np.random.Generator) -> Array:
    """Joints by chance, screen and module as far off as asked for."""
    x = rng.normal(0, np.where(np.array(errors.units) == "m", start.joint_mm * MM, start.joint_deg * DEG))
    for columns in rig_columns(errors):
        x[columns] = off(errors, columns, start.mm, start.deg, rng)
    return x


def measured(robot: urdfcal.Robot, errors: ErrorModel, x: Array, start: Start, rng: np.random.Generator) -> tuple[Measurements, Mask]:
    """Noisy spots of the true robot, some of them gross outliers, and which are not."""
    q = draw_poses(robot, errors, x, start.poses, rng)
    data = simulate(robot, errors, x, q, rng, SimulatedNoise(start.noise_mm * MM))
    bad = rng.random(data.seen.shape) < start.outliers
    spots = data.spots + bad[..., None] * rng.uniform(-200 * MM, 200 * MM, data.spots.shape)
    return urdfcal.measurements_from(robot, data.q, spots), ~bad


@dataclass(frozen=True)
class Run:
    """One start: whether the answer is the one from the truth, what `fit` said, [ms], good spots lost, and the words behind a failure."""

    same: bool
    refused: bool
    widened: bool
    milliseconds: float
    sweeps: int
    lost: float
    words: str = ""


def from_the_truth(found: urdfcal.Calibration, x: Array) -> Estimate:
    """The fit that starts from the truth, on the data and under the priors and noise that `fit` had in the end."""
    errors, noise = found.errors, replace(found.estimate.noise, stated=True)
    return iterated_schedule(Problem(errors, found.data).linearise, Belief(errors.mean, np.diag(errors.sigma**2)), noise, start=x)


def run(robot: urdfcal.Robot, errors: ErrorModel, estimate: tuple[str, ...], start: Start, seed: int) -> Run | None:
    """One start; None where the beams of such a robot hardly ever meet this screen."""
    rng = np.random.default_rng(seed)
    x = draw_truth(errors, start, rng)
    try:
        data, good = measured(robot, errors, x, start, rng)
    except UsageError:
        return None
    at = time.perf_counter()
    try:
        found = urdfcal.fit(robot, data, estimate=estimate)
    except urdfcal.FitRejected as refused:
        return Run(False, True, False, 1e3 * (time.perf_counter() - at), 0, 0.0, str(refused))
    milliseconds = 1e3 * (time.perf_counter() - at)
    widened, sweeps = any("widened to" in warning for warning in found.warnings), len(found.estimate.history)
    answer, lost = from_the_truth(found, x), float(np.mean(~found.data.seen[good]))
    apart = float(np.max(np.abs(found.x - answer.belief.x) / found.sigma))
    words = f"{found.estimate.stop}, from the truth {answer.stop}; {apart:.2g} sigmas apart; spot noise "
    words += f"{found.estimate.noise.spot_sigma / MM:.3g} mm; {len(found.outliers)} spots left out; {found.rejection or 'not rejected'}"
    return Run(found.converged and answer.converged and apart < 1e-3, False, widened, milliseconds, sweeps, lost, words)


def row(name: str, runs: list[Run]) -> str:
    """One line of the table."""
    same, refused, widened = (sum(getattr(run, what) for run in runs) for what in ("same", "refused", "widened"))
    times, lost = [run.milliseconds for run in runs], f"{np.mean([run.lost for run in runs]):.2%}"
    spent, sweeps = f"{np.median(times):.0f} ..{max(times):.0f}", np.median([run.sweeps for run in runs])
    return f"{name:16s}{len(runs):7d}{same:13d}{refused:9d}{widened:9d}{lost:>8s}{spent:>14s}{sweeps:8.0f}"


def main() -> None:
    """Parse the command line and run the study."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=200, help="how many starts (default 200)")
    parser.add_argument("--mm", type=float, default=300.0, help="how far screen and module are off (default 300)")
    parser.add_argument("--deg", type=float, default=20.0, help="how far screen and module are turned (default 20)")
    parser.add_argument("--joint-mm", type=float, default=20.0, help="sigma of the joints' lengths (default 20)")
    parser.add_argument("--joint-deg", type=float, default=3.0, help="sigma of the joints' angles (default 3)")
    parser.add_argument("--noise-mm", type=float, default=1.0, help="sigma of a spot coordinate (default 1)")
    parser.add_argument("--outliers", type=float, default=0.0, help="share of spots up to 200 mm off (default 0)")
    parser.add_argument("--poses", type=int, default=60, help="how many poses (default 60)")
    parser.add_argument("--robots", type=Path, default=Path("robots"), help="folder of the robots (default robots)")
    with_jobs(parser)
    parser.add_argument("-v", "--verbose", action="store_true", help="name the seeds that fail")
    arguments = parser.parse_args()
    start = Start(
        arguments.mm, arguments.deg, arguments.joint_mm, arguments.joint_deg, arguments.noise_mm, arguments.outliers, arguments.poses
    )
    print(f"{'robot':16s}{'starts':>7s}{'same answer':>13s}{'refused':>9s}{'widened':>9s}{'lost':>8s}{'fit [ms]':>14s}{'sweeps':>8s}")
    for name, estimate in CASES:
        robot = urdfcal.load_robot(arguments.robots / name / f"{name}.urdf.xacro")
        errors = build_error_model(robot.chain, robot.rig, ModelOptions(estimate=estimate))
        runs = over(partial(run, robot, errors, estimate, start), range(arguments.seeds), arguments)
        for seed, found in enumerate(runs):
            if arguments.verbose and found is not None and not found.same:
                print(f"  seed {seed}: {found.words}")
        print(row(" +".join((name, *estimate)), [found for found in runs if found is not None]), flush=True)


if __name__ == "__main__":
    main()
