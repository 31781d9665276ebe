"""Convergence from afar: screen and module placed only roughly, joints 20 mm and 3 deg off. Does fit reach the answer?

Truths: Gaussian joint parameters; screen and module off by a given distance and angle in random directions. On a rig whose screen has
no placement of its own, the joint parameters that stand for it are off instead. The nominal robot is where every fit starts. *Same
answer*: the iterated fit from the start agrees with the one from the truth, under the same priors, to 1e-3 of every sigma.
*Without start*: the same for a fit from the nominal robot under the priors as they stand. Spots have no outliers unless asked for.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np
import numpy.typing as npt

import urdfcal
from urdfcal.ekf import Belief, Estimate, iterated_schedule
from urdfcal.error_model import ErrorModel
from urdfcal.errors import UsageError
from urdfcal.gauge import ModelOptions, build_error_model
from urdfcal.geometry import DEG, MM
from urdfcal.measurements import Measurements
from urdfcal.noise import START_SPOT_SIGMA, Noise
from urdfcal.simulation import SimulatedNoise, draw_poses, simulate
from urdfcal.spot_model import SpotModel
from urdfcal.start import find_start, rig_columns

Array = npt.NDArray[np.float64]

CASES = (("panda", ()), ("ur5", ()), ("arm7", ("screen",)), ("arm7", ()))


def off(errors: ErrorModel, columns: Array, mm: float, deg: float, rng: np.random.Generator) -> Array:
    """A displacement of given length and angle in a random direction."""
    value = rng.normal(size=len(columns))
    lengths = np.array([errors.units[column] == "m" for column in columns])
    for part, size in ((lengths, mm * MM), (~lengths, deg * DEG)):
        value[part] *= size / np.linalg.norm(value[part])
    return value


def draw_truth(errors: ErrorModel, arguments: argparse.Namespace, rng: np.random.Generator) -> Array:
    """Joints by chance, screen and module as far off as asked for."""
    x = rng.normal(0, np.where(np.array(errors.units) == "m", arguments.joint_mm * MM, arguments.joint_deg * DEG))
    for columns in rig_columns(errors):
        x[columns] = off(errors, columns, arguments.mm, arguments.deg, rng)
    return x


def measured(robot: urdfcal.Robot, errors: ErrorModel, x: Array, arguments: argparse.Namespace, rng: np.random.Generator) -> Measurements:
    """Noisy spots of the true robot, some of them gross outliers."""
    q = draw_poses(robot, errors, x, arguments.poses, rng)
    data = simulate(robot, errors, x, q, rng, SimulatedNoise(arguments.noise_mm * MM))
    bad = rng.random(data.seen.shape) < arguments.outliers
    return urdfcal.measurements_from(robot, data.q, data.spots + bad[..., None] * rng.uniform(-200 * MM, 200 * MM, data.spots.shape))


def same(one: Estimate, other: Estimate) -> bool:
    """Whether two estimates agree."""
    apart = np.abs(one.belief.x - other.belief.x) / np.sqrt(np.diag(other.belief.P))
    return one.converged and other.converged and float(apart.max()) < 1e-3


def run(robot: urdfcal.Robot, errors: ErrorModel, arguments: argparse.Namespace, seed: int) -> Array | None:
    """Same answer with a start, and without; plausible; milliseconds of the start, and of the fit from it; sweeps."""
    rng = np.random.default_rng(seed)
    x = draw_truth(errors, arguments, rng)
    try:
        model = SpotModel(errors, measured(robot, errors, x, arguments, rng))
    except UsageError:
        return None  # the beams of this robot hardly ever meet this screen
    noise = Noise(START_SPOT_SIGMA, np.zeros(len(robot.chain.inputs)), stated=False)
    times = [time.perf_counter()]
    begun = find_start(model, noise)
    times.append(time.perf_counter())
    found = fitted(model, begun.errors, noise, begun.x)
    times.append(time.perf_counter())
    answer = fitted(model, begun.errors, noise, x)
    if not same(found, answer) and arguments.verbose:
        print(f"  seed {seed}: from the start {found.stop}, from the truth {answer.stop}; {begun.scale / MM:.3g} mm left; {begun.message}")
    plain = same(fitted(model, errors, noise, errors.mean), fitted(model, errors, noise, x))
    return np.array([same(found, answer), plain, begun.plausible, *(1e3 * np.diff(times)), len(found.history)])


def fitted(model: SpotModel, errors: ErrorModel, noise: Noise, x: Array) -> Estimate:
    """The iterated fit from a given state."""
    return iterated_schedule(model.linearise, Belief(errors.mean, np.diag(errors.sigma**2)), noise, start=x)


def row(name: str, runs: Array) -> str:
    """One line of the table."""
    reached, plain, plausible = runs[:, :3].sum(axis=0).astype(int)
    _, _, _, begin, fit, sweeps = np.median(runs, axis=0)
    times = f"{f'{begin:.0f} ..{runs[:, 3].max():.0f}':>14s}{fit:10.0f}{sweeps:8.0f}"
    return f"{name:16s}{len(runs):7d}{reached:13d}{plain:15d}{plausible:11d}{times}"


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
    parser.add_argument("-v", "--verbose", action="store_true", help="name the seeds that fail")
    arguments = parser.parse_args()
    head = f"{'robot':16s}{'starts':>7s}{'same answer':>13s}{'without start':>15s}{'plausible':>11s}"
    print(f"{head}{'start [ms]':>14s}{'fit [ms]':>10s}{'sweeps':>8s}")
    for name, estimate in CASES:
        robot = urdfcal.load_robot(arguments.robots / name / f"{name}.urdf.xacro")
        errors = build_error_model(robot.chain, robot.rig, ModelOptions(estimate=estimate))
        runs = [found for seed in range(arguments.seeds) if (found := run(robot, errors, arguments, seed)) is not None]
        print(row(" +".join((name, *estimate)), np.array(runs)), flush=True)


if __name__ == "__main__":
    main()
