"""Mistaken measurements: does `fit` name each kind of mistake, and leave healthy data alone?

    python tests/benchmarks/mistakes.py [--seeds N] [--healthy N] [--jobs N] [--resume FOLDER]

Truths of mistaken sets: Gaussian errors of 3 mm and 0.3 deg on the parameters that fit has. Truths of healthy sets: by turns 1 mm and
0.1 deg, 10 mm and 1 deg, and these with 20 % of the spots up to 200 mm off; by turns on the parameters of fit and in all six
directions of every joint, mount and screen. Mistakes of one joint take the joints in turn. *named*: `fit` refused the data and said
which mistake it is; *other*: it refused them for something else; *start*: it took the data for those of a rig placed elsewhere, and
said so; *rejected*: it fitted them, and found the result not to be trusted; *silent*: nothing was said. Each of these but the last is
an alarm where the data are healthy.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))

import numpy as np
import numpy.typing as npt

import urdfcal
from tests.support.studies import over, with_jobs
from urdfcal.base.geometry import DEG, MM
from urdfcal.calibration.reach import draw_poses
from urdfcal.model.gauge import build_error_model
from urdfcal.simulation.readings import SimulatedNoise, simulate
from urdfcal.simulation.truth import random_truth

Array = npt.NDArray[np.float64]
Data = urdfcal.Measurements
Mistake = Callable[[Data], tuple[Data, str]]

ROBOTS = ("arm7", "panda", "ur5")
HEALTHY = ((1.0, 0.1, 0.0), (10.0, 1.0, 0.0), (10.0, 1.0, 0.2))  # mm, deg, share of outliers


def drawn(robot: urdfcal.Robot, size: tuple[float, float, float], six: bool, poses: int, seed: int) -> Data:
    """Measurements of a robot with random errors of some size [mm], [deg], and share of outliers; in all six directions on request."""
    mm, deg, outliers = size
    rng, errors = np.random.default_rng(seed), build_error_model(robot.chain, robot.rig)
    scale = np.where(np.array(errors.units) == "m", mm * MM, deg * DEG)
    true, x = random_truth(robot, rng, mm * MM, deg * DEG) if six else (errors, rng.normal(0, scale))
    data = simulate(robot, true, x, draw_poses(robot, true, x, poses, rng), rng, SimulatedNoise(1 * MM))
    bad = rng.random(data.seen.shape) < outliers
    return data.with_spots(data.spots + bad[..., None] * rng.uniform(-200 * MM, 200 * MM, data.spots.shape))


def fitted(robot: urdfcal.Robot, data: Data) -> tuple[urdfcal.Calibration | None, str, float]:
    """A fit, or None and why it was refused; and how long that took, [s]."""
    at = time.perf_counter()
    try:
        return urdfcal.fit(robot, data), "", time.perf_counter() - at
    except urdfcal.FitRejected as refused:
        return None, str(refused), time.perf_counter() - at


def said_of(robot: urdfcal.Robot, data: Data) -> tuple[str, str, float]:
    """What `fit` makes of some measurements: refused, start, rejected or silent; its words; and how long it took, [s]."""
    found, why, seconds = fitted(robot, data)
    if found is None:
        return "refused", why, seconds
    widened = [warning for warning in found.warnings if "widened to" in warning]
    if widened:
        return "start", widened[0], seconds
    return ("rejected", found.rejection, seconds) if found.rejection else ("silent", "", seconds)


def spots(matrix: list[list[float]], words: str) -> Mistake:
    """A mistake in what was read off the screen."""
    return lambda data: (data.with_spots(data.spots @ np.array(matrix, dtype=float).T), words)


def swapped(data: Data) -> tuple[Data, str]:
    """The beams taken for each other."""
    return data.with_spots(data.spots[:, ::-1]), "laser_1 and laser_2 swapped"


def joint(index: int | None, factor: float, shift: float, words: str) -> Mistake:
    """A mistake in the readings of one joint, or of all."""

    def made(data: Data) -> tuple[Data, str]:
        q = data.q.copy()
        columns = slice(None) if index is None else index
        q[:, columns] = q[:, columns] * factor + shift
        return replace(data, q=q), words.format(data.joints[index] if index is not None else "all joints")

    return made


def pair_swapped(one: int, other: int) -> Mistake:
    """The readings of two joints taken for each other."""

    def made(data: Data) -> tuple[Data, str]:
        q = data.q.copy()
        q[:, [one, other]] = q[:, [other, one]]
        return replace(data, q=q), f"{data.joints[one]} and {data.joints[other]} swapped"

    return made


def shifted(data: Data) -> tuple[Data, str]:
    """The joints of each row written one row too low."""
    return replace(data, q=np.roll(data.q, 1, axis=0)), "the joints taken from the row behind"


def mistakes(joints: int) -> dict[str, list[Mistake]]:
    """Every kind of mistake, by name; each joint's in turn."""
    each = range(joints)
    return {
        "lasers swapped": [swapped],
        "y and z swapped": [spots([[0, 1], [1, 0]], "y and z of the spots swapped")],
        "y mirrored (behind)": [spots([[-1, 0], [0, 1]], "y of the spots mirrored")],
        "z mirrored": [spots([[1, 0], [0, -1]], "z of the spots mirrored")],
        "mm as m": [spots([[1e3, 0], [0, 1e3]], "the spots read as millimetres")],
        "m as mm": [spots([[1e-3, 0], [0, 1e-3]], "the spots read as metres")],
        "all deg as rad": [joint(None, 1 / DEG, 0, "{} read as degrees")],
        "all rad as deg": [joint(None, DEG, 0, "{} read as radians")],
        "one deg as rad": [joint(index, 1 / DEG, 0, "{} read as degrees") for index in each],
        "one rad as deg": [joint(index, DEG, 0, "{} read as radians") for index in each],
        "sign flipped": [joint(index, -1, 0, "the sign of {} flipped") for index in each],
        "zero off by 90": [joint(index, 1, -90 * DEG, "90 deg added to {}") for index in each],
        "zero off by 180": [joint(index, 1, np.pi, "180 deg added to {}") for index in each],
        "two joints swapped": [pair_swapped(one, other) for one, other in combinations(each, 2)],
        "off by a row": [shifted],
    }


@dataclass(frozen=True)
class Answer:
    """What `fit` made of one mistake: the verdict, the mistake, the words it used and how long it took, [s]."""

    verdict: str
    mistake: str
    said: str
    seconds: float


def tried(robot: urdfcal.Robot, poses: int, outliers: float, seed: int) -> dict[str, Answer]:
    """What is made of one set with each kind of mistake."""
    data, answers = drawn(robot, (3, 0.3, outliers), False, poses, seed), {}
    for kind, variants in mistakes(len(robot.chain.inputs)).items():
        wrong, words = variants[seed % len(variants)](data)
        verdict, said, seconds = said_of(robot, wrong)
        if verdict == "refused":
            verdict = "named" if words in said else "other"
        answers[kind] = Answer(verdict, words, said, seconds)
    return answers


def alarm(robot: urdfcal.Robot, poses: int, seed: int) -> str:
    """What was said of a healthy set, empty where nothing was."""
    verdict, words, _ = said_of(robot, drawn(robot, HEALTHY[seed % 3], bool(seed // 3 % 2), poses, 1000 + seed))
    return f"set {seed}, {verdict}: {words}" if verdict != "silent" else ""


def main() -> None:
    """Parse the command line and run the study."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=10, help="seeds for each kind of mistake (default 10)")
    parser.add_argument("--healthy", type=int, default=100, help="healthy sets for each robot (default 100)")
    parser.add_argument("--poses", type=int, default=60, help="how many poses (default 60)")
    parser.add_argument("--outliers", type=float, default=0.0, help="share of gross outliers in mistaken sets (default 0)")
    parser.add_argument("--robots", type=Path, default=Path("robots"), help="folder of the robots (default robots)")
    parser.add_argument("-v", "--verbose", action="store_true", help="print every answer that was not the right one")
    with_jobs(parser)
    arguments = parser.parse_args()
    for name in ROBOTS:
        robot = urdfcal.load_robot(arguments.robots / name / f"{name}.urdf.xacro")
        runs = over(partial(tried, robot, arguments.poses, arguments.outliers), range(arguments.seeds), arguments)
        for kind in runs[0] if runs else ():
            answers = [run[kind] for run in runs]
            counts = ", ".join(f"{count} {verdict}" for verdict, count in Counter(own.verdict for own in answers).most_common())
            for seed, own in enumerate(answers):
                if arguments.verbose and own.verdict != "named":
                    print(f"    {own.mistake}, seed {seed}, {own.verdict}: {own.said or 'nothing said'}")
            print(f"{name:7s}{kind:22s}{len(answers):5d} tried: {counts}", flush=True)
        if times := [own.seconds for run in runs for own in run.values()]:
            print(f"{name:7s}seconds for a mistaken set: {np.median(times):.2f}, at most {max(times):.2f}")
        false = [said for said in over(partial(alarm, robot, arguments.poses), range(arguments.healthy), arguments) if said]
        print(f"{name:7s}healthy sets: {arguments.healthy}, alarms: {len(false)} {' | '.join(false[:3])}", flush=True)


if __name__ == "__main__":
    main()
