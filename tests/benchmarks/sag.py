"""Gravity sag: what it gains on real robots, and whether it is found, with honest intervals, on simulated ones.

    python tests/benchmarks/sag.py truth|none|real|cost [--seeds N] [--data DIR] [--set NAME ...]

truth   simulated arms that sag: share of the 95 % intervals of the soft parameters that hold the truth, what is left of their error, and
        held-out RMS with and without sag; median gain of log evidence, and the share of arms whose report speaks of sag for it.
none    the same arms, rigid: by how much sag makes the held-out error larger.
real    held-out RMS on the four real robots of `real_robots.py`, nominal, geometry alone (what the URDF carries) and the pair of URDF and
        compensation. Random splits by number of training poses, and the repeatable ones. `reference` is that of their README.
cost    time of a fit with and without sag.

Simulated arms have Gaussian errors (1 mm, 1 mrad in six directions of every joint, mount and screen) and half-normal sag (1 mrad about a
joint's axis at its largest gravity moment, 0.5 mrad across); points, poses and spots are read with 0.1 mm and 0.02 deg; 60 poses.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).parents[2]))

import numpy as np

import urdfcal
from tests.benchmarks.real_robots import ROBOTS, ROOT, Split, random_splits, repeatable_splits
from tests.support.studies import over, with_jobs
from urdfcal.api import Calibration
from urdfcal.base.geometry import DEG, MM
from urdfcal.calibration.analysis.sag import SagFit, fit_sag
from urdfcal.calibration.error_table import error_table, rms_of
from urdfcal.calibration.problem import Problem
from urdfcal.calibration.reach import draw_poses
from urdfcal.calibration.start.nominal import with_new_places
from urdfcal.robot.packages import find_package
from urdfcal.simulation.readings import ReadingNoise, simulate, simulate_readings
from urdfcal.simulation.setup import parse_sensors, seen_with, simulated_setup
from urdfcal.simulation.truth import SagScales, random_truth, soft_truth

MRAD = 1e-3
WORTH_IT = 3.0  # of log evidence, under which the report says that sag is not worth a compensation
TRAIN, TEST = 60, 300
NOISE = ReadingNoise(spot=0.1 * MM, length=0.1 * MM, angle=0.02 * DEG)
ARMS = {"panda": "panda_link8", "ur10": "tool0", "tiago": "arm_tool_link"}
SENSORS = ("laser", "point", "pose")


@dataclass(frozen=True)
class Simulated:
    """One simulated arm, measured.

    Attributes:
        robot: Nominal.
        train, test: Measurements.
        truth: Soft parameters and the moments that they belong to, by name.
    """

    robot: urdfcal.Robot
    train: urdfcal.Measurements
    test: urdfcal.Measurements
    truth: dict[str, tuple[float, float]]


def load(arm: str) -> urdfcal.Robot:
    """The UR10 of example-robot-data has neither screen nor lasers; the others are this project's."""
    if arm == "ur10":
        return urdfcal.load_robot(find_package("example-robot-data") / "robots/ur_description/urdf/ur10_robot.urdf")
    return urdfcal.load_robot(ROOT / "robots" / arm / f"{arm}.urdf.xacro")


def simulated(arm: str, sensor: str, scales: SagScales, seed: int) -> Simulated:
    """Measurements of an arm with errors, and with sag if scales say so."""
    rng, robot = np.random.default_rng([seed, 7]), load(arm)
    sensors, lasers = parse_sensors([sensor if sensor == "laser" else f"{sensor}:{ARMS[arm]}"], robot, 1)
    robot = seen_with(robot, sensors, "", lasers) if sensors else robot
    errors, x = random_truth(robot, rng, 1 * MM, 1 * MRAD)
    errors, x = soft_truth(robot, errors, x, scales, rng) if scales else (errors, x)
    if sensors:
        data = simulate_readings(simulated_setup(robot, errors, x, sensors, rng), TRAIN + TEST, rng, NOISE)
    else:
        data = simulate(robot, errors, x, draw_poses(robot, errors, x, TRAIN + TEST, rng), rng, NOISE)
    terms = errors.soft.terms if errors.soft is not None else ()
    truth = {term.name: (float(x[errors.names.index(term.name)]), term.largest) for term in terms}
    return Simulated(robot, data.subset(np.arange(TRAIN)), data.subset(np.arange(TRAIN, TRAIN + TEST)), truth)


def held_out(calibration: Calibration, sag: SagFit, test: urdfcal.Measurements) -> float:
    """RMS of the tested poses under the joint fit, [mm]."""
    errors, x = with_new_places(sag.errors, sag.estimate.belief.x, test, sag.estimate.noise)
    return rms_of(error_table(Problem(errors, test).linearise(x), len(test)))


def fitted(robot: urdfcal.Robot, train: urdfcal.Measurements, test: urdfcal.Measurements) -> tuple[Calibration, SagFit | None]:
    """Both fits, on the same poses."""
    calibration = urdfcal.fit(robot, train, test=test)
    return calibration, fit_sag(calibration, folds=0, compare_directions=False)


class Sagged(NamedTuple):
    """Of one simulated arm: the ratio of held-out errors, the gain, whether intervals hold and squares of errors and truths, by kind."""

    ratio: float
    gain: float
    inside: list[tuple[str, bool]]
    left: list[list[float]]


def run(arm: str, sensor: str, scales: SagScales, seed: int) -> Sagged:
    """Simulate an arm and fit it with sag and without."""
    case = simulated(arm, sensor, scales, seed)
    calibration, sag = fitted(case.robot, case.train, case.test)
    assert sag is not None, "gravity bends these arms"
    assert calibration.test is not None
    assert calibration.test_data is not None
    inside, left = [], []
    largest = {term.name: term.largest for term in sag.softness.terms}
    for name, (value, moment) in case.truth.items():
        if name in largest:
            expected = value * largest[name] / moment
            found, sigma = sag.soft_values[name]
            inside.append(("own" if name.endswith(".sag") else "across", bool(abs(found - expected) < 1.96 * sigma)))
            left.append([(found - expected) ** 2, expected**2])
    ratio = held_out(calibration, sag, calibration.test_data) / rms_of(calibration.test[1])
    return Sagged(ratio, sag.gain, inside, left)


def simulated_study(arms: list[str], scales: SagScales, arguments: argparse.Namespace) -> Iterator[str]:
    """A line for each arm and sensor."""
    yield (
        f"{'arm':<8}{'sensor':<8}{'held-out ratio':>16}{'worst':>8}{'95 % hold':>11}{'own':>7}{'across':>8}{'error left':>12}"
        f"{'gain':>8}{'told':>6}"
    )
    for arm in arms:
        for sensor in SENSORS:
            if arm == "ur10" and sensor == "laser":
                continue
            runs = over(partial(run, arm, sensor, scales), range(arguments.seeds), arguments)
            ratios, gains, inside, left = [one.ratio for one in runs], [one.gain for one in runs], defaultdict(list), []
            for one in runs:
                left += one.left
                for kind, holds in one.inside:
                    inside[kind].append(holds)
            both = [*inside["own"], *inside["across"]]
            shares = [f"{np.mean(part):.3f}" if part else "-" for part in (both, inside["own"], inside["across"])]
            error = f"{np.sqrt(np.sum(left, axis=0) @ [1, 0] / np.sum(left, axis=0)[1]):.2f}" if left else "-"
            yield (
                f"{arm:<8}{sensor:<8}{np.exp(np.mean(np.log(ratios))):>16.3f}{max(ratios):>8.3f}"
                f"{shares[0]:>11}{shares[1]:>7}{shares[2]:>8}{error:>12}"
                f"{np.median(gains):>8.1f}{np.mean(np.array(gains) > WORTH_IT):>6.2f}"
            )


def real_study(data: Path, wanted: list[str], splits: int, gated: bool) -> Iterator[str]:
    """A line for each set and split, then the ratios that were aimed at."""
    yield (
        f"{'set':<18}{'split':<14}{'n':>3}{'nominal':>9}{'URDF':>8}{'pair':>8}{'ratio':>8}{'worst':>7}"
        f"{'reference':>11}{'URDF/ref':>10}{'pair/ref':>10}"
    )
    against: dict[str, list[tuple[float, float]]] = defaultdict(list)
    for robot in (each for each in ROBOTS if not wanted or each.folder in wanted):
        arm, whole = robot.load(data)
        found: dict[str, list[tuple[float, float, float]]] = defaultdict(list)
        for split in [*random_splits(whole, splits), *repeatable_splits(robot, whole)]:
            found[split.name].append(one_split(robot, arm, whole, split, gated))
        for name, rows in found.items():
            nominal, urdf, pair = np.sqrt(np.mean(np.square(rows), axis=0))
            ratios, reference = [row[2] / row[1] for row in rows], robot.reference.get(name)
            line = f"{robot.folder:<18}{name:<14}{len(rows):>3}{nominal:>9.3f}{urdf:>8.3f}{pair:>8.3f}"
            line += f"{np.exp(np.mean(np.log(ratios))):>8.3f}{max(ratios):>7.3f}"
            if reference is not None:
                means = np.mean(rows, axis=0)[1:]  # the reference is a mean of the splits' RMS
                against[robot.folder].append((means[0] / reference, means[1] / reference))
                line += f"{reference:>11.2f}{means[0] / reference:>10.3f}{means[1] / reference:>10.3f}"
            yield line
    if against:
        urdf, pair = np.exp([np.mean(np.log(rows), axis=0) for rows in against.values()]).T
        means = f"URDF {geometric(urdf):.3f}, pair {geometric(pair):.3f}; worst pair {pair.max():.3f}"
        yield f"against the references, geometric mean over the sets: {means}"


def geometric(values: Any) -> float:
    """Geometric mean."""
    return float(np.exp(np.mean(np.log(values))))


def one_split(robot: Any, arm: urdfcal.Robot, whole: urdfcal.Measurements, split: Split, gated: bool) -> tuple[float, float, float]:
    """Held-out RMS of the nominal robot, of geometry alone and of the pair, [mm], on the same poses."""
    train, test = robot.part(whole, split.train), replace(robot.part(whole, split.test), lengths=())
    calibration = urdfcal.fit(arm, train, test=test, gated=gated)
    sag = fit_sag(calibration, folds=0, compare_directions=False)
    assert sag is not None
    assert calibration.test is not None
    assert calibration.test_data is not None
    return rms_of(calibration.test[0]), rms_of(calibration.test[1]), held_out(calibration, sag, calibration.test_data)


def cost_study() -> Iterator[str]:
    """A line for each arm: seconds of the fit alone, of the joint fit, and of all that the command says of sag."""
    yield f"{'arm':<8}{'geometry s':>12}{'joint fit s':>13}{'with k-fold and directions s':>30}"
    for arm in ARMS:
        case = simulated(arm, "pose", SagScales(1 * MRAD, 0.5 * MRAD), 0)
        started = time.perf_counter()
        calibration = urdfcal.fit(case.robot, case.train)
        times = [time.perf_counter() - started]
        for options in ({"folds": 0, "compare_directions": False}, {}):
            started = time.perf_counter()
            fit_sag(calibration, **options)  # type: ignore[arg-type]
            times.append(time.perf_counter() - started)
        yield f"{arm:<8}{times[0]:>12.2f}{times[1]:>13.2f}{times[2]:>30.2f}"


def main() -> None:
    """Read the command line, run, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("study", choices=("truth", "none", "real", "cost"))
    parser.add_argument("--seeds", type=int, default=10, help="simulated arms a line (default 10)")
    parser.add_argument("--arm", action="append", choices=ARMS, help="simulated arm (default all)")
    parser.add_argument("--splits", type=int, default=5, help="random splits of every size (default 5)")
    parser.add_argument("--data", type=Path, default=ROOT.parent / "shared" / "data", help="folder of the real measurements")
    parser.add_argument("--set", action="append", default=[], help="real robot (default all)")
    parser.add_argument("--no-gate", action="store_true", help="real: fit and test every pose, outliers too")
    with_jobs(parser)
    given = parser.parse_args()
    if given.study == "real" and not given.data.is_dir():
        sys.exit(f"no folder {given.data} with the real measurements; say --data DIR")
    scales = SagScales(1 * MRAD, 0.5 * MRAD) if given.study == "truth" else SagScales()
    lines = (
        real_study(given.data, given.set, given.splits, not given.no_gate)
        if given.study == "real"
        else cost_study()
        if given.study == "cost"
        else simulated_study(given.arm or list(ARMS), scales, given)
    )
    for line in lines:
        print(line, flush=True)


if __name__ == "__main__":
    main()
