"""Is the claimed uncertainty true? Many seeds of the noisy paper arm against the Cramer-Rao bound.

The arm, its spots and their derivatives are written down here once more from Table I and equation (2) of the paper, so that truth
and bound owe nothing to urdfcal. With e = estimate - truth, sqrt(mean of e' C^-1 e / 33) is 1 where C tells the truth.
"""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import dataclass
from functools import partial
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))

import numpy as np
import numpy.typing as npt
from second_witness import DEG, MM, observations_of

import urdfcal
from tests.support.studies import over, with_jobs
from urdfcal.model.gauge import build_error_model
from urdfcal.model.options import ModelOptions
from urdfcal.model.parameters import FLAT, PriorScale
from urdfcal.simulation.paper import paper_poses, paper_truth

Array = npt.NDArray[np.float64]

TABLE_I = np.array(  # a [mm], d [mm], alpha [deg], theta [deg]
    [
        [-500, 0, -90, -90],
        [0, 100, -90, 90],
        [0, 0, -90, -90],
        [0, 200, 90, 0],
        [0, 0, -90, 0],
        [0, 200, 90, 90],
        [0, 0, 90, 0],
    ]
) * np.array([MM, MM, DEG, DEG])
MOUNT = (50 * MM, 0.0, 0.0, 180 * DEG)  # the SLM row; its errors are Trans x, Trans z of this row, then Rot x, Rot y, Rot z of the module
BEAMS = (-30 * DEG, 30 * DEG)
NAMES = [f"joint{joint}.{name}" for joint in range(1, 8) for name in ("d_a", "d_d", "d_alpha", "d_theta")] + [
    f"slm.{name}" for name in ("trans_x", "trans_z", "rot_x", "rot_y", "rot_z")
]
TRUTH = np.array([10 * MM, 10 * MM, 1 * DEG, 1 * DEG] * 7 + [0.0] * 5)
FLAT_PRIORS = {"joint": PriorScale(FLAT, FLAT), "mount": PriorScale(FLAT, FLAT)}
Z95 = 1.959963984540054


@dataclass(frozen=True)
class Run:
    """One seed: squared distances from the truth under the bound and under the claim, and e / sigma of every parameter."""

    bound: float
    claim: float
    standardised: Array


def slide(axis: int, length: npt.ArrayLike) -> Array:
    """Translations along an axis, (n, 4, 4)."""
    lengths = np.atleast_1d(length)
    matrix = np.tile(np.eye(4), (len(lengths), 1, 1))
    matrix[:, axis, 3] = lengths
    return matrix


def turn(axis: int, angle: npt.ArrayLike) -> Array:
    """Rotations about an axis, (n, 4, 4)."""
    angles = np.atleast_1d(angle)
    j, k = (axis + 1) % 3, (axis + 2) % 3
    matrix = np.tile(np.eye(4), (len(angles), 1, 1))
    matrix[:, j, j] = matrix[:, k, k] = np.cos(angles)
    matrix[:, k, j] = np.sin(angles)
    matrix[:, j, k] = -matrix[:, k, j]
    return matrix


def spots(x: Array, q: Array) -> Array:
    """Spots of the arm of Table I with errors x, (n, 2, 2), equations (2), (3), (7) and (8)."""
    rows, (mx, mz, rx, ry, rz) = TABLE_I + x[:28].reshape(7, 4), x[28:]
    T = np.eye(4)
    for (a, d, alpha, theta), angle in zip(rows, q.T, strict=True):
        T = T @ slide(0, a) @ slide(2, d) @ turn(0, alpha) @ turn(2, theta + angle)
    a, d, alpha, theta = MOUNT
    mount = slide(0, a + mx) @ slide(2, d + mz) @ turn(0, alpha) @ turn(2, theta) @ turn(0, rx) @ turn(1, ry) @ turn(2, rz)
    return observations_of(np.stack([T @ mount @ turn(0, beam) for beam in BEAMS], axis=1))[0]


def differences(function, at: Array, step: float = 1e-6) -> Array:
    """Central differences of spots by each number of `at`, (n, 4, numbers)."""
    columns = [(function(at + h) - function(at - h)) / (2 * step) for h in step * np.eye(len(at))]
    return np.stack(columns, axis=-1).reshape(len(columns[0]), 4, len(at))


def cramer_rao(q: Array, spot_sigma: float, joint_sigma: float) -> Array:
    """The least covariance an unbiased estimator can have at the truth, (33, 33)."""
    J = differences(lambda x: spots(x, q), TRUTH)
    J_q = differences(lambda step: spots(TRUTH, q + step), np.zeros(7))
    R = spot_sigma**2 * np.eye(4) + joint_sigma**2 * J_q @ J_q.transpose(0, 2, 1)
    return np.linalg.inv((J.transpose(0, 2, 1) @ np.linalg.solve(R, J)).sum(axis=0))


def mahalanobis(error: Array, covariance: Array) -> float:
    """e' C^-1 e, in units in which C has a unit diagonal."""
    sigma = np.sqrt(np.diag(covariance))
    return float(error / sigma @ np.linalg.solve(covariance / np.outer(sigma, sigma), error / sigma))


def run(robot: urdfcal.Robot, spot_sigma: float, joint_sigma: float, seed: int) -> Run:
    """Draw poses and noise, fit, and compare with the truth."""
    rng = np.random.default_rng(seed)
    errors = build_error_model(robot.chain, robot.rig, ModelOptions(error_model="dh"))
    q = paper_poses(robot, errors, paper_truth(errors), rng)
    readings = q + rng.normal(0, joint_sigma, q.shape)
    seen = spots(TRUTH, q) + rng.normal(0, spot_sigma, (len(q), 2, 2))
    found = urdfcal.fit(
        robot,
        urdfcal.measurements_from(robot, readings, seen),
        error_model="dh",
        priors=FLAT_PRIORS,
        spot_sigma=spot_sigma,
        joint_sigma=joint_sigma,
    )
    if not found.converged:
        raise SystemExit(f"seed {seed}: {found.stop_reason}")
    order = [found.errors.names.index(name) for name in NAMES]
    error, claim = found.x[order] - TRUTH, found.covariance[np.ix_(order, order)]
    bound = cramer_rao(q, spot_sigma, joint_sigma)
    return Run(mahalanobis(error, bound), mahalanobis(error, claim), error / np.sqrt(np.diag(claim)))


def report(runs: list[Run]) -> None:
    """Print the table."""
    p = len(NAMES)
    squares = {"Cramer-Rao bound at the truth": [one.bound for one in runs], "covariance that fit claims": [one.claim for one in runs]}
    for name, values in squares.items():
        mean, median = np.sqrt(np.mean(values) / p), np.sqrt(np.median(values) / p)
        print(f"{name:34s} sqrt(mean e' C^-1 e / {p}) = {mean:.4f}  (of the median {median:.4f})")
    inside = np.abs([one.standardised for one in runs]) < Z95
    print(f"{'95 % intervals that hold the truth':34s} {inside.mean():.2%} of {inside.size}")
    share = inside.mean(axis=0)
    print(f"{'  worst and best parameter':34s} {NAMES[share.argmin()]} {share.min():.0%}, {NAMES[share.argmax()]} {share.max():.0%}")
    bias = np.mean([one.standardised for one in runs], axis=0) * np.sqrt(len(runs))
    print(f"{'  largest mean error':34s} {bias[np.abs(bias).argmax()]:+.2f} standard errors ({NAMES[np.abs(bias).argmax()]})")


def main() -> None:
    """Parse the command line and run the study."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=100, help="how many seeds (default 100)")
    parser.add_argument("--spot-mm", type=float, default=1.15, help="standard deviation of a spot coordinate (default 1.15)")
    parser.add_argument("--joint-deg", type=float, default=0.058, help="standard deviation of a joint reading (default 0.058)")
    parser.add_argument("--robot", default="robots/arm7/arm7.urdf.xacro", help="the arm of Table I")
    with_jobs(parser)
    arguments = parser.parse_args()
    start, robot = time.perf_counter(), urdfcal.load_robot(arguments.robot)
    runs = over(partial(run, robot, arguments.spot_mm * MM, arguments.joint_deg * DEG), range(arguments.seeds), arguments)
    report(runs)
    print(f"{arguments.seeds} seeds, {time.perf_counter() - start:.0f} s")


if __name__ == "__main__":
    main()
