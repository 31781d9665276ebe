"""Beam angles from simulated bench readings: the paper's module (16), four distances, 0.2 mm of noise, each bench with a tilt of its own.

python tests/benchmarks/module_bench.py [--trials N]
"""

from __future__ import annotations

import argparse

import numpy as np

from urdfcal.vision.bench.beams import BenchReadings, beams_from_bench, predicted_readings

TRUE = np.radians([[-27.80, 1.27], [31.07, 0.82]])
ORIGINS = np.array([[0.002, -0.001], [-0.001, 0.0015]])
DISTANCE = np.array([0.3, 0.5, 0.7, 0.9])


def readings(rng: np.random.Generator, noise: float, squareness: float) -> BenchReadings:
    """Readings of a bench whose plane is tilted at random."""
    state = np.concatenate([np.hstack([TRUE, ORIGINS]).ravel(), rng.normal(0, squareness, 2)])
    found = predicted_readings(state, DISTANCE)
    return BenchReadings(("laser_1", "laser_2"), DISTANCE, found + rng.normal(0, noise, found.shape))


def main() -> None:
    """Print error over sigma, by angle."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trials", type=int, default=200)
    parser.add_argument("--noise-mm", type=float, default=0.2)
    parser.add_argument("--squareness-deg", type=float, default=0.2)
    arguments = parser.parse_args()
    noise, squareness = arguments.noise_mm * 1e-3, np.radians(arguments.squareness_deg)
    for label, stated, assumed in (
        ("noise estimated", None, squareness),
        ("noise stated", noise, squareness),
        ("squareness taken as 0, noise stated", noise, 0.0),
    ):
        rng = np.random.default_rng(5)
        results = [beams_from_bench(readings(rng, noise, squareness), assumed, stated) for _ in range(arguments.trials)]
        errors = np.array([result.angles - TRUE for result in results])
        ratios = errors / np.array([result.angle_sigmas for result in results])
        rms = np.degrees(np.sqrt((errors**2).mean(axis=0))).ravel()
        print(f"{label}, {arguments.trials} trials; in the order laser_1 a, b, laser_2 a, b")
        print("    RMS error [deg]          ", *(f"{x:.4f}" for x in rms))
        print("    RMS of error over sigma  ", *(f"{x:.2f}" for x in np.sqrt((ratios**2).mean(axis=0)).ravel()))
        print(f"    within 1.96 sigma {np.mean(np.abs(ratios) < 1.96):.1%}, within 3 {np.mean(np.abs(ratios) < 3):.1%}")


if __name__ == "__main__":
    main()
