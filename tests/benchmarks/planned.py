"""Poses chosen by `plan_poses` against random ones of the same pool: how far off the tool is after a fit of them, and is predicted to be.

    python -m tests.benchmarks.planned [--data DIR] [--robots 20] [--only ROBOT SENSOR]

Measured by the robot's lasers; by points of its flange; or by a camera where the lasers are, which sees the 24 corners of a board 0.3 m
before the screen (`planned_scenes.py`). The pool: 1500 random poses without collisions at which all is seen and nothing hides it. Truths:
*Gaussian*, 1 mm and 2 mrad in the parameters of `auto`; *factory*, what a maker wrote for the joint frames of 15 UR arms (ur_factory in
DIR), six numbers a joint; for arms with more joints frames are drawn from all of them. Mount, screen, camera and board are 5 mm and 0.5 deg
off. Noise: spots 0.5 mm, points 0.1 mm, corners 0.3 px. Robots are fitted with the default priors; all poses see the same robots.

What is given is the tool's position error relative to the base link, RMS over 100 configurations, in mm: as it is, and with the best
constant placements of base and tool taken out, which no reading tells apart. Of the robots the RMS / the median. Predicted is the root of a
mean variance, of which the RMS over robots is the witness; the median of something so skewed is less by some 10 %. Not so with points: how
well they tell the tool depends on where their target sits on its link, which is drawn for each robot. The few that sit near the last axis
make up most of the mean, and the plan takes one in the middle, so there the median is the witness. *Own* is what the fits themselves say,
who know where it sits, RMS over the robots. Ratios are of the RMS / the geometric mean of each robot's own, which weighs all robots alike,
with the standard deviation over 2000 bootstrap draws of the robots as their error.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

import urdfcal
from tests.benchmarks.evidence import factory_truths
from tests.benchmarks.planned_scenes import ARMS, ROBOTS, SENSORS, Scene, scene_of
from tests.calibration.analysis.test_prediction import tool_poses
from urdfcal.base.geometry import MM, Matrix
from urdfcal.calibration.analysis.prediction import tool_jacobian
from urdfcal.robot.configurations import random_positions
from urdfcal.simulation.setup import SimulatedSetup

PLANNED, RANDOM = (20, 30), (20, 30, 60)
RATIOS = (("planned 30", "random 60"), ("planned 20", "random 30"), ("planned 30", "random 30"))
IN_BASE, UP_TO_CONSTANT, OWN = range(3)
DRAWS = 2000


def off(scene: Scene, setup: SimulatedSetup, q: Matrix, tool: str, seed: int) -> tuple[float, float, float]:
    """The tool's mean squared error over a workspace after a fit of some poses: IN_BASE, UP_TO_CONSTANT, and by OWN, [mm^2]."""
    data = scene.read(setup, q, seed)
    found = urdfcal.fit(setup.robot, data, sigmas=scene.sigmas, gated=False, evidence=False, asking=False, sane=False)
    workspace = random_positions(setup.robot, 100, np.random.default_rng(7))
    true = tool_poses(setup.robot, setup.errors, setup.x, tool, workspace)
    mine = tool_poses(setup.robot, found.errors, found.x, tool, workspace)
    error = np.array([a.translation - b.translation for a, b in zip(true, mine, strict=True)])
    rows = [np.hstack([np.eye(3), -_cross(pose.translation), pose.rotation]) for pose in mine]
    constant = np.linalg.lstsq(np.concatenate(rows), error.ravel(), rcond=None)[0]
    left = error - (np.array(rows) @ constant)
    J = tool_jacobian(setup.robot, found.errors, found.x, tool, workspace)[:, :3]
    variance = np.sum((J @ found.covariance) * J, axis=(1, 2))
    return tuple(float(each) / MM**2 for each in ((error**2).sum(axis=1).mean(), (left**2).sum(axis=1).mean(), variance.mean()))


def _cross(p: np.ndarray) -> np.ndarray:
    return np.array([[0, -p[2], p[1]], [p[2], 0, -p[0]], [-p[1], p[0], 0]])


def study(name: str, sensor: str, robots: int, arms: list[np.ndarray]) -> None:
    """Print the rows of one robot with one sensor, and the ratios of some of them."""
    scene, kinds = scene_of(name, sensor), ("Gaussian", *(["factory"] if arms else []))
    sets, predicted, tool = chosen(scene)
    squares: dict[tuple[str, str], Matrix] = {}
    for what, q in sets.items():
        for kind in kinds:
            squares[what, kind] = np.array(
                [
                    off(scene, scene.truth(kind, seed, arms), at_random(scene, seed, int(what.split()[1])) if q is None else q, tool, seed)
                    for seed in range(robots)
                ]
            )
        cells = [cell for kind in kinds for cell in told(squares[what, kind])]
        print(f"| {name} | {sensor} | {what} | {predicted[what]:.3f} | {' | '.join(cells)} |", flush=True)
    for one, other in RATIOS:
        ratios = [between(squares[one, kind], squares[other, kind], column) for kind in kinds for column in (IN_BASE, UP_TO_CONSTANT)]
        cells = [cell for index, ratio in enumerate(ratios) for cell in (ratio, *([""] if index % 2 else []))]
        print(f"| {name} | {sensor} | {one} : {other} | {predicted[one] / predicted[other]:.3f} | {' | '.join(cells)} |", flush=True)


def chosen(scene: Scene) -> tuple[dict[str, Matrix | None], dict[str, float], str]:
    """Planned sets of poses, None for those that are drawn for each robot; what is predicted after them, [mm]; and of which link."""
    sets: dict[str, Matrix | None] = {}
    predicted = {}
    for n in RANDOM:
        plan = scene.planned(n)
        if n in PLANNED:
            sets[f"planned {n}"], predicted[f"planned {n}"] = plan.q, float(plan.tool_sigma_mm[-1])
        sets[f"random {n}"], predicted[f"random {n}"] = None, plan.at_random_mm
    return sets, predicted, plan.tool


def at_random(scene: Scene, seed: int, n: int) -> Matrix:
    """Some poses of the pool, others for each robot."""
    return scene.pool[np.random.default_rng([seed, n]).choice(len(scene.pool), n, replace=False)]


def told(squares: Matrix) -> list[str]:
    """Cells of some robots, (robots, 3): RMS / median, and the fits' own prediction."""
    both = [f"{np.sqrt(own.mean()):.3f} / {np.sqrt(np.median(own)):.3f}" for own in squares.T[:OWN]]
    return [*both, f"{np.sqrt(squares[:, OWN].mean()):.3f}"]


def between(one: Matrix, other: Matrix, column: int) -> str:
    """The same robots after other poses: ratio of RMS / geometric mean of each robot's own ratio, with their bootstrap errors."""
    rows = np.random.default_rng(0).integers(len(one), size=(DRAWS, len(one)))
    a, b = one[:, column], other[:, column]
    rms = np.sqrt(a.mean() / b.mean()), np.sqrt(a[rows].mean(axis=1) / b[rows].mean(axis=1)).std()
    logs = np.log(a / b) / 2
    each = np.exp(logs.mean()), np.exp(logs[rows].mean(axis=1)).std()
    return " / ".join(f"{ratio:.2f} ± {error:.2f}" for ratio, error in (rms, each))


def main() -> None:
    """Parse the command line and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robots", type=int, default=20, help="how many robots a row (default 20)")
    parser.add_argument("--data", type=Path, default=ROBOTS.parents[1] / "shared" / "data")
    parser.add_argument("--only", nargs=2, metavar=("ROBOT", "SENSOR"), help=f"one robot with {', '.join(SENSORS)}")
    arguments = parser.parse_args()
    arms = factory_truths(arguments.data) if (arguments.data / "ur_factory").is_dir() else []
    columns = ["robot", "sensor", "poses", "predicted"]
    for kind in ("Gaussian", *(["factory"] if arms else [])):
        columns += [kind, "up to a constant", "own"]
    print(f"| {' | '.join(columns)} |\n|{'---|' * len(columns)}", flush=True)
    for name in ARMS:
        for sensor in SENSORS:
            if arguments.only is None or tuple(arguments.only) == (name, sensor):
                study(name, sensor, arguments.robots, arms)


if __name__ == "__main__":
    main()
