"""The estimators side by side on the paper's case 3: all 60 poses calibrate, 60 further ones, drawn likewise, are predicted.

    python tests/benchmarks/estimators.py [--seeds N]

One reading a pose with the paper's noise (uniform, 2 mm and 0.1 deg), which is stated; D-H parameters; the same priors for all (10 mm and
1 deg on joints, 20 mm and 2 deg on the mount). *Held out*: RMS distance to the noise-free spots of the unseen poses. *Off the filter*:
largest distance of any parameter from the iterated filter's estimate, in its own sigmas. *Iterations* are what the result's history
holds: sweeps of the filter, rounds of the others, in each of which SciPy or the filter takes steps of its own. *Linearised*: how often
residual and Jacobian of all poses were computed in the whole of `fit`, gate included.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass
from pathlib import Path
from unittest.mock import patch

import numpy as np
import numpy.typing as npt

import urdfcal
from urdfcal.base.geometry import DEG, MM
from urdfcal.calibration.problem import Problem
from urdfcal.model.error_model import ErrorModel
from urdfcal.model.gauge import build_error_model
from urdfcal.model.options import ModelOptions
from urdfcal.model.parameters import PriorScale
from urdfcal.sensors.measurements import spots_measured
from urdfcal.simulation.paper import JOINT_NOISE, SPOT_NOISE, paper_poses, paper_truth
from urdfcal.simulation.readings import SimulatedNoise, simulate, true_spots

Array = npt.NDArray[np.float64]

ROBOTS = Path(__file__).parents[2] / "robots"
FITS = {
    "ekf, iterated": {"estimator": "ekf"},
    "lse": {"estimator": "lse"},
    "robust": {"estimator": "robust"},
    "evolution": {"estimator": "evolution"},
    "ekf, paper": {"estimator": "ekf", "schedule": "paper"},
}
UNIFORM = 1 / np.sqrt(3)  # standard deviation of uniform noise of half-width 1


@dataclass(frozen=True)
class Run:
    """One estimator on one set: [mm] on unseen poses, [s], iterations, linearisations, sigmas from the iterated filter's answer."""

    held_out: float
    seconds: float
    iterations: int
    linearised: int
    away: float


def fitted(robot: urdfcal.Robot, data: urdfcal.Measurements, how: dict[str, str]) -> urdfcal.Calibration:
    """Case 3 with the noise that there is, and the same priors for every estimator."""
    return urdfcal.fit(
        robot,
        data,
        error_model="dh",
        priors={"joint": PriorScale(10 * MM, 1 * DEG), "mount": PriorScale(20 * MM, 2 * DEG)},
        spot_sigma=SPOT_NOISE * UNIFORM,
        joint_sigma=JOINT_NOISE * UNIFORM,
        **how,  # type: ignore[arg-type]
    )


def one_set(robot: urdfcal.Robot, errors: ErrorModel, seed: int) -> dict[str, Run]:
    """Every estimator on the same measurements."""
    rng, truth = np.random.default_rng(seed), paper_truth(errors)
    noise = SimulatedNoise(SPOT_NOISE, JOINT_NOISE, "uniform")
    data = simulate(robot, errors, truth, paper_poses(robot, errors, truth, rng), rng, noise)
    q = paper_poses(robot, errors, truth, rng)
    unseen = spots_measured(robot, q, true_spots(robot, errors, truth, q))
    runs, first = {}, None
    for label, how in FITS.items():
        begun = time.perf_counter()
        with patch.object(Problem, "linearise", autospec=True, side_effect=Problem.linearise) as linearise:
            found = fitted(robot, data, how)
        seconds, first = time.perf_counter() - begun, first or found
        if not found.converged:
            raise SystemExit(f"seed {seed}, {label}: {found.stop_reason}")
        off = np.stack(Problem(found.errors, unseen).read(found.x), axis=1) - unseen.spots
        held_out = float(np.sqrt(np.mean(np.sum(off**2, axis=-1))) / MM)
        away = float(np.max(np.abs(found.x - first.x) / first.sigma))
        runs[label] = Run(held_out, seconds, len(found.estimate.history) - 1, linearise.call_count, away)
    return runs


def main() -> None:
    """Parse the command line and run the study."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=20, help="how many draws of poses and noise (default 20)")
    arguments = parser.parse_args()
    robot = urdfcal.load_robot(ROBOTS / "arm7" / "arm7.urdf.xacro")
    errors = build_error_model(robot.chain, robot.rig, ModelOptions(error_model="dh"))
    sets = [one_set(robot, errors, seed) for seed in range(arguments.seeds)]
    print(f"arm7, case 3, {arguments.seeds} draws: median (worst)")
    print(f"{'estimator':16s}{'held out [mm]':>18s}{'time [ms]':>20s}{'iterations':>14s}{'linearised':>16s}{'off the filter [sigma]':>26s}")
    for label in FITS:
        runs = [runs[label] for runs in sets]
        held, seconds, away = ([getattr(run, name) for run in runs] for name in ("held_out", "seconds", "away"))
        iterations, linearised = [run.iterations for run in runs], [run.linearised for run in runs]
        print(
            f"{label:16s}{f'{np.median(held):.3f} ({max(held):.3f})':>18s}"
            f"{f'{1e3 * np.median(seconds):.0f} ({1e3 * max(seconds):.0f})':>20s}"
            f"{f'{np.median(iterations):.0f} ({max(iterations)})':>14s}"
            f"{f'{np.median(linearised):.0f} ({max(linearised)})':>16s}{f'{np.median(away):.1e} ({max(away):.1e})':>26s}"
        )


if __name__ == "__main__":
    main()
