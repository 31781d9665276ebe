"""Held-out error under gross outliers, swapped beams and wrong joint readings, relative to the clean fit: gate and robust estimator.

    python tests/benchmarks/outliers.py [--seeds N] [--robots NAME ...] [--jobs N] [--resume FOLDER]

Truths: Gaussian errors of 5 mm and 0.5 deg in six directions of every joint, mount and screen. A robot whose screen has no placement of
its own is fitted with `--estimate screen`, so that the model can follow. *Told*: the gate's task with the answer known, a fit of what
nobody has touched; nothing that finds outliers can do better. *Refused*: `fit` gave no result.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))

import numpy as np

from tests.support.studies import over, with_jobs
from urdfcal.api import fit
from urdfcal.base.errors import FitRejected
from urdfcal.base.geometry import MM
from urdfcal.calibration.problem import Problem
from urdfcal.calibration.reach import draw_poses
from urdfcal.robot.robot import Robot, load_robot
from urdfcal.sensors.measurements import Measurements, spots_measured
from urdfcal.simulation.readings import SimulatedNoise, simulate, true_spots
from urdfcal.simulation.truth import random_truth

ROBOTS = Path(__file__).parents[2] / "robots"
SHARES = (0.0, 0.05, 0.10, 0.20, 0.30)
FITS = {"ekf, gated": {}, "robust": {"estimator": "robust"}, "ekf, no gate": {"gated": False}}
TOLD = "told"
Ratios = dict[str, list[float]]  # of each case, in the order of FITS, and told


def with_outliers(data: Measurements, share: float, rng: np.random.Generator) -> Measurements:
    """A share of the spots thrown off by up to 200 mm."""
    spots = data.spots.copy()
    hit = rng.random(data.seen.shape) < share
    angle, length = rng.uniform(0, 2 * np.pi, hit.sum()), rng.uniform(10e-3, 200e-3, hit.sum())
    spots[hit] += np.stack([np.cos(angle), np.sin(angle)], axis=-1) * length[:, None]
    return data.with_spots(spots)


def with_swapped(data: Measurements, share: float, rng: np.random.Generator) -> Measurements:
    """A share of the poses with the first beam read as the second."""
    spots = data.spots.copy()
    hit = rng.random(len(data)) < share
    spots[hit] = spots[hit][:, ::-1]
    return data.with_spots(spots)


def with_wrong_readings(data: Measurements, share: float, rng: np.random.Generator) -> Measurements:
    """A share of the poses with one joint read 90 deg wrong, so that beams may miss the screen altogether."""
    q = data.q.copy()
    for pose in np.flatnonzero(rng.random(len(data)) < share):
        q[pose, rng.integers(q.shape[1])] += rng.choice([-0.5, 0.5]) * np.pi
    return replace(data, q=q)


def untouched(spoilt: Measurements, data: Measurements) -> Measurements:
    """What is left of the measurements without all that was spoilt."""
    touched = (spoilt.spots != data.spots).any(axis=-1) | (spoilt.q != data.q).any(axis=1)[:, None]
    return data.with_spots(np.where(touched[..., None], np.nan, data.spots))


def held_out(robot: Robot, data: Measurements, unseen: Measurements, **arguments: object) -> float:
    """RMS distance on unseen, noise-free spots, [mm]; infinite where the data were refused."""
    try:
        found = fit(robot, data, **arguments)  # type: ignore[arg-type]
    except FitRejected:
        return np.inf
    off = np.stack(Problem(found.errors, unseen).read(found.x), axis=1) - unseen.spots
    return float(np.sqrt(np.mean(np.sum(off**2, axis=-1))) / MM)


def run(robot: Robot, poses: int, seed: int) -> Ratios:
    """Held-out errors of one robot over that of the clean fit."""
    rng = np.random.default_rng(seed)
    model, truth = random_truth(robot, rng, 5e-3, np.radians(0.5))
    q = draw_poses(robot, model, truth, poses + 200, rng)
    data = simulate(robot, model, truth, q[:poses], rng, SimulatedNoise(1e-3))
    unseen = spots_measured(robot, q[poses:], true_spots(robot, model, truth, q[poses:]))
    clean = held_out(robot, data, unseen, **FITS["ekf, no gate"])
    cases = {f"{share:.0%} outliers": with_outliers(data, share, rng) for share in SHARES} | {
        "10% swapped": with_swapped(data, 0.1, rng),
        "10% misread": with_wrong_readings(data, 0.1, rng),
    }
    ratios: Ratios = {}
    for case, spoilt in cases.items():
        fits = [(spoilt, how) for how in FITS.values()] + [(untouched(spoilt, data), FITS["ekf, no gate"])]
        ratios[case] = [held_out(robot, seen, unseen, **how) / clean for seen, how in fits]
    return ratios


def row(case: str, ratios: Sequence[Sequence[float]]) -> str:
    """One line of the table: median and worst of each fit."""
    cells = []
    for label, own in zip((*FITS, TOLD), np.array(ratios).T, strict=True):
        refused = np.count_nonzero(np.isinf(own))
        cells.append(f"{label}: {np.median(own):7.2f} {np.max(own):8.2f}" + (f" ({refused} refused)" if refused else ""))
    return f"  {case:14s}" + "   ".join(cells)


def main() -> None:
    """Print a table per robot."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--robots", nargs="+", default=["panda", "ur5", "arm7"])
    parser.add_argument("--poses", type=int, default=100)
    with_jobs(parser)
    arguments = parser.parse_args()
    for name in arguments.robots:
        robot = load_robot(ROBOTS / name / f"{name}.urdf.xacro")
        print(
            f"{name}, {arguments.poses} poses, 1 mm noise, {arguments.seeds} seeds: held-out RMS relative to the clean fit (median, worst)"
        )
        runs = over(partial(run, robot, arguments.poses), range(arguments.seeds), arguments)
        for case in runs[0]:
            print(row(case, [ratios[case] for ratios in runs]))


if __name__ == "__main__":
    main()
