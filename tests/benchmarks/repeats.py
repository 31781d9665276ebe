"""Several readings of one pose: do intervals hold the truth as often as they say, whatever the readings have in common?

    python tests/benchmarks/repeats.py [--sets N] [--poses N] [--estimators ekf lse robust] [--jitter-deg SIGMA]
        [--jobs N] [--resume FOLDER]

Simulated arms whose errors are drawn from the priors of the fit, read 1, 3 and 10 times at every pose (`mixed`: once, three or ten times).
Of the noise, 0.5 mm a coordinate, readings of a pose share nothing, half of its variance, nine tenths, or all. `arm7` sees laser spots,
`ur5` a point by a tracker. *Parameters*: how often the 95 % intervals of determined parameters of the joints hold the truth. *Unseen*: the
same of noise-free readings at poses that were not fitted, by the covariance of the parameters alone. *Found*: noise and share in common,
means over the sets. *Rows*: coverage of the parameters if every row were a pose of its own, as a witness that it matters.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))

import numpy as np
import numpy.typing as npt

import urdfcal
from tests.support.studies import over, with_jobs
from urdfcal.base.geometry import DEG, MM
from urdfcal.calibration.problem import Problem
from urdfcal.calibration.reach import draw_poses
from urdfcal.model.gauge import build_error_model
from urdfcal.model.options import ModelOptions
from urdfcal.model.parameters import Kind, PriorScale
from urdfcal.sensors.measurements import Measurements, spots_measured
from urdfcal.simulation.readings import simulate_readings, true_spots
from urdfcal.simulation.setup import parse_sensors, seen_with, simulated_setup

Array = npt.NDArray[np.float64]

ROBOTS = Path(__file__).parents[2] / "robots"
NOISE, UNSEEN = 0.5 * MM, 100
PRIORS: dict[Kind, PriorScale] = {
    "joint": PriorScale(2 * MM, 0.2 * DEG),
    "mount": PriorScale(20 * MM, 2 * DEG),
    "screen": PriorScale(100 * MM, 5 * DEG),
}
TIMES = ("1", "3", "10", "mixed")
COMMON = (0.0, 0.5, 0.9, 1.0)
Z95 = 1.959963984540054


@dataclass(frozen=True)
class Simulated:
    """A robot with errors drawn from the prior, readings without noise at poses to fit and at unseen ones, and the truth by name."""

    robot: urdfcal.Robot
    truth: dict[str, float]
    clean: Measurements
    unseen: Measurements


@dataclass(frozen=True)
class Case:
    """What is studied: robot, how often a pose is read, what its readings share, how joints scatter [rad], poses, and the estimator."""

    robot: str
    times: str
    common: float
    jitter: float
    poses: int
    estimator: str


@dataclass(frozen=True)
class Said:
    """Of one set: shares of parameters and of unseen numbers within their intervals, the noise found; and the first if rows were poses."""

    parameters: float
    unseen: float
    noise: float
    common: float
    single: float | None


def spots(poses: int, rng: np.random.Generator) -> Simulated:
    """Laser spots of arm7."""
    robot = urdfcal.load_robot(ROBOTS / "arm7" / "arm7.urdf.xacro")
    errors = build_error_model(robot.chain, robot.rig, ModelOptions(priors=PRIORS))
    x = rng.normal(errors.mean, errors.sigma)
    q = draw_poses(robot, errors, x, poses + UNSEEN, rng)
    seen = spots_measured(robot, q, true_spots(robot, errors, x, q))
    rows = np.arange(len(q))
    return Simulated(robot, dict(zip(errors.names, x.tolist(), strict=True)), seen.subset(rows < poses), seen.subset(rows >= poses))


def points(poses: int, rng: np.random.Generator) -> Simulated:
    """A point on a UR5's tool."""
    robot = urdfcal.load_robot(ROBOTS / "ur5" / "ur5.urdf.xacro")
    sensors, lasers = parse_sensors(("point:tool0",), robot, 6)
    seen = seen_with(robot, sensors, "", lasers)
    errors = build_error_model(seen.chain, seen.rig, ModelOptions())
    x = rng.normal(0, 1, len(errors.names)) * [PRIORS["joint"].sigma(unit) for unit in errors.units]
    setup = simulated_setup(seen, errors, x, sensors, rng)
    clean, unseen = (simulate_readings(setup, count, rng, None) for count in (poses, UNSEEN))
    return Simulated(setup.robot, dict(zip(setup.errors.names, setup.x.tolist(), strict=True)), clean, unseen)


CASES = {"arm7": spots, "ur5": points}


def read_again(clean: Measurements, times: str, common: float, jitter: float, rng: np.random.Generator) -> Measurements:
    """Every pose read so many times, with noise of which a share of the variance is common to its readings."""
    poses = np.arange(len(clean))
    count = rng.choice([1, 3, 10], len(clean)) if times == "mixed" else np.full(len(clean), int(times))
    rows = np.repeat(poses, count)
    data = clean.subset(rows)
    readings = []
    for reading in data.readings:
        shared = rng.normal(0, NOISE * np.sqrt(common), clean.subset(poses).readings[0].values.shape)[rows]
        own = rng.normal(0, NOISE * np.sqrt(1 - common), reading.values.shape)
        readings.append(replace(reading, values=reading.values + shared + own))
    return replace(data, q=data.q + rng.normal(0, jitter, data.q.shape), readings=tuple(readings), approach=None)


def held(found: urdfcal.Calibration, truth: dict[str, float]) -> float:
    """Share of the determined joint parameters whose intervals hold the truth."""
    own = [
        index
        for index, (parameter, known) in enumerate(zip(found.errors.parameters, found.identifiability.determined, strict=True))
        if parameter.kind == "joint" and known
    ]
    off = found.x[own] - [truth[found.errors.names[index]] for index in own]
    return float(np.mean(np.abs(off) < Z95 * found.sigma[own]))


def foreseen(found: urdfcal.Calibration, unseen: Measurements) -> float:
    """Share of the numbers of unseen readings within the intervals that the parameters give them."""
    here = Problem(found.errors, unseen).linearise(found.x)
    spread = np.sqrt(np.einsum("nmp,pq,nmq->nm", here.jacobian, found.covariance, here.jacobian))
    return float(np.mean((np.abs(here.residual) < Z95 * spread)[: len(unseen)][here.measured[: len(unseen)]]))


def as_poses(data: Measurements) -> Measurements:
    """The same as if every row were a pose of its own."""
    return replace(data, payload=np.arange(len(data)) * 1e-12)


def run(case: Case, seed: int) -> Said:
    """One set."""
    rng = np.random.default_rng([seed, TIMES.index(case.times), int(case.common * 10)])
    one = CASES[case.robot](case.poses, rng)
    data = read_again(one.clean, case.times, case.common, case.jitter, rng)
    fit = partial(urdfcal.fit, one.robot, priors=PRIORS, estimator=case.estimator, gated=False)
    found = fit(data)
    noise = found.estimate.noise
    single = held(fit(as_poses(data)), one.truth) if case.times != "1" else None
    return Said(held(found, one.truth), foreseen(found, one.unseen), noise.spot_sigma / NOISE, float(noise.common[0]), single)


def row(case: Case, sets: Sequence[Said]) -> str:
    """One line of the table."""
    found = f"{np.mean([own.noise for own in sets]):.3f} | {np.mean([own.common for own in sets]):.2f}"
    shares = [share([own.parameters for own in sets]), share([own.unseen for own in sets])]
    single = share([own.single for own in sets if own.single is not None])
    return f"| {case.robot} | {case.estimator} | {case.times} | {case.common:g} | {' | '.join(shares)} | {found} | {single} |"


def share(values: list[float]) -> str:
    """Mean and its standard error."""
    return f"{np.mean(values):6.1%} +- {np.std(values) / np.sqrt(len(values)):.1%}" if values else "-"


def main() -> None:
    """Parse the command line and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sets", type=int, default=100, help="sets a row (default 100)")
    parser.add_argument("--poses", type=int, default=40)
    parser.add_argument("--cases", nargs="+", default=list(CASES), choices=list(CASES))
    parser.add_argument("--times", nargs="+", default=list(TIMES), choices=TIMES)
    parser.add_argument("--common", nargs="+", type=float, default=list(COMMON))
    parser.add_argument("--estimators", nargs="+", default=["ekf"], choices=["ekf", "lse", "robust"])
    parser.add_argument("--jitter-deg", type=float, default=0.0, help="sigma of the joints among readings of one pose (default 0)")
    with_jobs(parser)
    arguments = parser.parse_args()
    begun = time.perf_counter()
    print("| robot | estimator | readings | in common | parameters in 95 % | unseen in 95 % | noise found | common found | rows |")
    print("|---|---|---|---|---|---|---|---|---|")
    for name in arguments.cases:
        for estimator in arguments.estimators:
            for times in arguments.times:
                for common in arguments.common if times != "1" else arguments.common[:1]:
                    case = Case(name, times, common, arguments.jitter_deg * DEG, arguments.poses, estimator)
                    print(row(case, over(partial(run, case), range(arguments.sets), arguments)), flush=True)
    print(f"{time.perf_counter() - begun:.0f} s")


if __name__ == "__main__":
    main()
