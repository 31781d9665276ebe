"""Poses chosen by `plan_poses` against random ones of the same pool: how far off the tool is after a fit of them, and is predicted to be.

    python -m tests.benchmarks.planned [--data DIR] [--robots 20] [--only ROBOT SENSOR]

The pool: 1500 random poses without collisions (with every beam on the screen). Truths: *Gaussian*, 1 mm and 2 mrad in the parameters of
`auto`; *factory*, what a maker wrote for the joint frames of 15 UR arms (ur_factory in DIR), six numbers a joint; for arms with more
joints frames are drawn from all of them. Mount and screen are 5 mm and 0.5 deg off. Noise: spots 0.5 mm, points 0.1 mm. Robots are fitted
with the default priors. What is given is the tool's position error relative to the base link, RMS over 100 configurations, median over the
robots, in mm: as it is, and with the best constant placements of base and tool taken out, which no reading tells apart. (How well points
tell the tool depends on where their target sits on its link, which the prediction knows for one draw of it; hence medians.)
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

import urdfcal
from tests.benchmarks.evidence import factory_truths
from tests.calibration.analysis.test_prediction import tool_poses
from urdfcal.base.geometry import DEG, MM, Matrix
from urdfcal.calibration.analysis.next_pose import read_at
from urdfcal.cell.collisions import Cell, cell_of
from urdfcal.model.gauge import build_error_model
from urdfcal.model.options import ModelOptions
from urdfcal.planning.plan import plan_poses
from urdfcal.robot.configurations import random_positions
from urdfcal.robot.robot import Robot
from urdfcal.sensors.measurements import Measurements
from urdfcal.simulation.readings import simulate_readings
from urdfcal.simulation.setup import SimulatedSetup, parse_sensors, seen_with, simulated_setup

ROOT = Path(__file__).parents[2]
ARMS = {"ur5": "point:tool0", "panda": "point:panda_link8", "tiago": "point:arm_7_link"}
NOISE = {"spot": 0.5 * MM, "point": 0.1 * MM}
POOL = 1500
PLANNED, RANDOM = (20, 30), (20, 30, 60)


@dataclass(frozen=True)
class Errors:
    """Squared errors of the tool over a workspace, (configurations,), [m^2]."""

    in_base: np.ndarray
    up_to_constant: np.ndarray


def true_setup(robot: Robot, sensor: str, kind: str, seed: int, frames: list[np.ndarray]) -> SimulatedSetup:
    """A robot with errors, and instruments somewhere."""
    rng = np.random.default_rng([seed, kind == "factory"])
    named, lasers = parse_sensors([sensor], robot, 0)
    seen = seen_with(robot, named, "", lasers) if named else robot
    errors = build_error_model(seen.chain, seen.rig, ModelOptions(error_model="auto" if kind == "Gaussian" else "placement"))
    metres = np.array(errors.units) == "m"
    joints = np.array([parameter.kind == "joint" for parameter in errors.parameters])
    x = rng.normal(size=len(metres)) * np.where(metres, 5 * MM, 0.5 * DEG)
    if kind == "Gaussian":
        x[joints] *= np.where(metres, 0.2, 2e-3 / (0.5 * DEG))[joints]
    else:
        x[joints] = factory(int(joints.sum()) // 6, seed, frames, rng)
    return simulated_setup(seen, errors, x, named, rng)


def factory(count: int, seed: int, arms: list[np.ndarray], rng: np.random.Generator) -> np.ndarray:
    """Errors of so many joints' frames, as an arm has them, or drawn from all arms where that has not as many joints."""
    if count == 6:
        return np.asarray(arms[seed % len(arms)] * (-1.0) ** (seed // len(arms)))
    every = np.concatenate(arms).reshape(-1, 6)
    return np.asarray(every[rng.integers(len(every), size=count)] * rng.choice([-1.0, 1.0], (count, 1))).ravel()


def read(setup: SimulatedSetup, q: Matrix, seed: int) -> Measurements:
    """What is read at some poses."""
    rng = np.random.default_rng([seed, len(q)])
    template = simulate_readings(setup, 3, rng)
    exact = read_at(setup.robot, setup.errors, setup.x, template, q)
    noisy = (replace(own, values=own.values + rng.normal(size=own.values.shape) * NOISE[own.noise]) for own in exact.readings)
    return replace(exact, readings=tuple(noisy), poses=np.arange(len(q)).astype(str), order=np.arange(float(len(q))))


def off(setup: SimulatedSetup, q: Matrix, tool: str, workspace: Matrix, seed: int) -> Errors:
    """How far off the tool is after a fit of readings at some poses."""
    data = read(setup, q, seed)
    found = urdfcal.fit(
        setup.robot, data, sigmas={kind: NOISE[kind] for kind in data.kinds}, gated=False, evidence=False, asking=False, sane=False
    )
    true = tool_poses(setup.robot, setup.errors, setup.x, tool, workspace)
    mine = tool_poses(setup.robot, found.errors, found.x, tool, workspace)
    error = np.array([a.translation - b.translation for a, b in zip(true, mine, strict=True)])
    rows = [np.hstack([np.eye(3), -_cross(pose.translation), pose.rotation]) for pose in mine]
    constant = np.linalg.lstsq(np.concatenate(rows), error.ravel(), rcond=None)[0]
    left = error - (np.array(rows) @ constant)
    return Errors((error**2).sum(axis=1), (left**2).sum(axis=1))


def _cross(p: np.ndarray) -> np.ndarray:
    return np.array([[0, -p[2], p[1]], [p[2], 0, -p[0]], [-p[1], p[0], 0]])


def study(name: str, sensor: str, robots: int, arms: list[np.ndarray]) -> None:
    """Print the rows of one robot with one sensor."""
    robot = urdfcal.load_robot(ROOT / "robots" / name / f"{name}.urdf.xacro")
    found: list[Matrix] = []
    plan_poses(robot, candidates=POOL, n=2, sensors=[sensor], allowed=partial(_kept, found, []))
    pool = np.concatenate(found)[:POOL]
    sigmas = {kind: NOISE[kind] for kind in (["spot"] if sensor == "laser" else ["point"])}
    planned = partial(plan_poses, robot, candidates=pool, sensors=[sensor], sigmas=sigmas)
    sets: dict[str, tuple[Matrix | None, int, float]] = {}
    for n in RANDOM:
        plan = planned(n=n)
        if n in PLANNED:
            sets[f"planned {n}"] = plan.q, n, float(plan.tool_sigma_mm[-1])
        sets[f"random {n}"] = None, n, plan.at_random_mm
    tool = plan.tool
    workspace = random_positions(plan.robot, 100, np.random.default_rng(7))
    for what, (q, n, predicted) in sets.items():
        cells = []
        for kind in ("Gaussian", *(["factory"] if arms else [])):
            errors = []
            for seed in range(robots):
                rows = pool[np.random.default_rng([seed, n]).choice(len(pool), n, replace=False)] if q is None else q
                errors.append(off(true_setup(robot, sensor, kind, seed, arms), rows, tool, workspace, seed))
            cells += [middle([each.in_base for each in errors]), middle([each.up_to_constant for each in errors])]
        print(
            f"| {name} | {sensor.partition(':')[0]} | {what} | {predicted:.3f} | " + " | ".join(f"{c:.3f}" for c in cells) + " |",
            flush=True,
        )


def _kept(found: list[Matrix], cells: list[Cell], seen: Robot, q: Matrix) -> np.ndarray:
    """Which positions are free, which are kept."""
    if not cells:
        cells.append(cell_of(seen))
    free = cells[0].free(q)
    found.append(q[free])
    return free


def middle(squares: list[np.ndarray]) -> float:
    """The median over robots of the RMS over their workspace, [mm]."""
    return float(np.median([np.sqrt(own.mean()) for own in squares])) / MM


def main() -> None:
    """Parse the command line and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robots", type=int, default=20, help="how many robots a row (default 20)")
    parser.add_argument("--data", type=Path, default=ROOT.parent / "shared" / "data")
    parser.add_argument("--only", nargs=2, metavar=("ROBOT", "SENSOR"), help="one robot with `laser` or `point`")
    arguments = parser.parse_args()
    arms = factory_truths(arguments.data) if (arguments.data / "ur_factory").is_dir() else []
    print("| robot | sensor | poses | predicted | Gaussian | up to a constant | factory | up to a constant |\n|" + "---|" * 8, flush=True)
    for name, point in ARMS.items():
        for sensor in ("laser", point):
            if arguments.only is None or tuple(arguments.only) == (name, sensor.partition(":")[0]):
                study(name, sensor, arguments.robots, arms)


if __name__ == "__main__":
    main()
