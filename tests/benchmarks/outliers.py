"""Held-out error under gross outliers and swapped beams, relative to the clean fit: the gated filter and the robust estimator.

python tests/benchmarks/outliers.py [--seeds N]
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np

from urdfcal.calibration import fit, with_test
from urdfcal.fit_result import rms_mm
from urdfcal.measurements import Measurements, measurements_from
from urdfcal.robot import Robot, load_robot
from urdfcal.simulation import SimulatedNoise, draw_poses, random_truth, simulate, true_spots

ROBOTS = Path(__file__).parents[2] / "robots"
SHARES = (0.0, 0.05, 0.10, 0.20, 0.30)
FITS = {"ekf, gated": {}, "robust": {"estimator": "robust"}, "ekf, no gate": {"gated": False}}


def with_outliers(data: Measurements, share: float, rng: np.random.Generator) -> Measurements:
    """A share of the spots thrown off by up to 200 mm."""
    spots = data.spots.copy()
    hit = rng.random(data.seen.shape) < share
    angle, length = rng.uniform(0, 2 * np.pi, hit.sum()), rng.uniform(10e-3, 200e-3, hit.sum())
    spots[hit] += np.stack([np.cos(angle), np.sin(angle)], axis=-1) * length[:, None]
    return replace(data, spots=spots)


def with_swapped(data: Measurements, share: float, rng: np.random.Generator) -> Measurements:
    """A share of the poses with the first beam read as the second."""
    spots = data.spots.copy()
    hit = rng.random(len(data)) < share
    spots[hit] = spots[hit][:, ::-1]
    return replace(data, spots=spots)


def held_out(robot: Robot, data: Measurements, unseen: Measurements, **arguments: object) -> float:
    """RMS distance on unseen, noise-free spots, [mm]."""
    found = with_test(fit(robot, data, **arguments), unseen)  # type: ignore[arg-type]
    assert found.test is not None
    return rms_mm(found.test[1])


def main() -> None:
    """Print a table per robot."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--robots", nargs="+", default=["panda", "ur5"])
    parser.add_argument("--poses", type=int, default=100)
    arguments = parser.parse_args()
    for name in arguments.robots:
        robot = load_robot(ROBOTS / name / f"{name}.urdf.xacro")
        print(
            f"{name}, {arguments.poses} poses, 1 mm noise, {arguments.seeds} seeds: held-out RMS relative to the clean fit (median, worst)"
        )
        ratios: dict[tuple[str, str], list[float]] = {}
        for seed in range(arguments.seeds):
            rng = np.random.default_rng(seed)
            model, truth = random_truth(robot, rng, 5e-3, np.radians(0.5))
            q = draw_poses(robot, model, truth, arguments.poses + 200, rng)
            data = simulate(robot, model, truth, q[: arguments.poses], rng, SimulatedNoise(1e-3))
            unseen = measurements_from(robot, q[arguments.poses :], true_spots(robot, model, truth, q[arguments.poses :]))
            clean = held_out(robot, data, unseen, gated=False)
            cases = {f"{share:.0%} outliers": with_outliers(data, share, rng) for share in SHARES} | {
                "10% swapped": with_swapped(data, 0.1, rng)
            }
            for case, spoilt in cases.items():
                for label, how in FITS.items():
                    ratios.setdefault((case, label), []).append(held_out(robot, spoilt, unseen, **how) / clean)
        for case in dict.fromkeys(case for case, _ in ratios):
            cells = [f"{np.median(ratios[case, label]):7.2f} {np.max(ratios[case, label]):8.2f}" for label in FITS]
            print(f"  {case:14s}" + "   ".join(f"{label}: {cell}" for label, cell in zip(FITS, cells, strict=True)))


if __name__ == "__main__":
    main()
