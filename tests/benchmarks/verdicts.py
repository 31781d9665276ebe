"""Is the verdict right? Many simulated sets, good ones and bad ones, judged, and put to the truth.

    python tests/benchmarks/verdicts.py [--seeds FIRST:LAST] [--jobs N] [-v]

Each seed draws a robot, what measures it (lasers, points, poses), how wrong it is (0.3 to 5 mm and as many tenths of a mrad and more,
six numbers a joint), the noise, 3 to 200 poses, and how they were taken: anywhere; a few poses again and again; on a line in joint
space; within a few degrees; with the noise stated in another unit; with one joint read in another unit; with the readings in
another unit. Of every set the error of the module or the target's link in the base frame over 200 random configurations is taken from the
true robot, nominal and calibrated, and the same up to a constant placement of base and tool.

*Usable ones that are better*: of the sets that `can be used` (with or without reservations), how many make the link's true RMS error in
the base frame smaller than the nominal robot's. *Good ones refused*: how many good sets are `do not use`. Good is what leaves less than
a third of the true error, in the base frame as well as up to constants, from no fewer numbers than unknowns. (Where a measuring frame and
a target are free, no data tell the placement of the base and the tool, and about half of the error in the base frame stays by chance
alone; to ask for less than that would count luck as goodness.)
"""

from __future__ import annotations

import argparse
import sys
import time
import warnings
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))

import numpy as np
import pinocchio as pin

import urdfcal
from tests.support.studies import over, with_jobs
from urdfcal.base.geometry import DEG, MM, SE3, Matrix
from urdfcal.base.rotations import skew
from urdfcal.calibration.analysis.prediction import base_link, default_tool
from urdfcal.calibration.analysis.verdict import Verdict, verdict_of
from urdfcal.calibration.reach import draw_poses
from urdfcal.robot.configurations import joint_limits, random_positions, whole_configurations
from urdfcal.robot.corrections import OriginCorrection, corrected_model
from urdfcal.robot.robot import Robot
from urdfcal.sensors.measurements import Measurements, spots_measured
from urdfcal.sensors.readings import Readings
from urdfcal.sensors.registry import SENSORS as HOW
from urdfcal.sensors.sensor import View
from urdfcal.simulation.readings import ReadingNoise, simulate
from urdfcal.simulation.setup import SENSOR_KINDS, SimulatedSetup, parse_sensors, seen_with, simulated_setup
from urdfcal.simulation.truth import random_truth

ROBOTS = Path(__file__).parents[2] / "robots"
LINKS = {"arm4": "slm", "arm7": "slm", "panda": "panda_link8", "ur5": "tool0", "tiago": "arm_tool_link"}
SENSORS = ("laser", "point", "pose")
WAYS = ("anywhere", "repeated", "line", "tiny", "noise in another unit", "joint in another unit", "readings in another unit")
WEIGHTS = (0.5, 0.1, 0.1, 0.1, 0.08, 0.06, 0.06)
GOOD_IN_BASE, GOOD_APART = 1 / 3, 1 / 3
CONFIGURATIONS = 200


@dataclass(frozen=True)
class Set:
    """What one seed gave.

    Attributes:
        seed: The seed.
        what: Robot, instruments, number of poses and how they were taken.
        way: How they were taken.
        use: The verdict, or `refused` where no fit was made.
        words: Its reasons.
        in_base, apart: True RMS errors of the link, nominal and calibrated, [m]: in the base frame, and up to constants.
        predicted: The same two after calibration, as predicted, [m].
        enough: Whether as many numbers were read, at poses that differ, as there are unknowns.
    """

    seed: int
    what: str
    way: str
    use: str
    words: str
    in_base: tuple[float, float] = (np.nan, np.nan)
    apart: tuple[float, float] = (np.nan, np.nan)
    predicted: tuple[float, float] = (np.nan, np.nan)
    enough: bool = False

    @property
    def usable(self) -> bool:
        """Whether it was said to be."""
        return self.use in ("yes", "reservations")

    @property
    def better(self) -> bool:
        """Whether the link is nearer to the truth."""
        return self.in_base[1] < self.in_base[0]

    @property
    def good(self) -> bool:
        """Whether the link is much nearer to the truth."""
        nearer = self.in_base[1] < GOOD_IN_BASE * self.in_base[0] and self.apart[1] < GOOD_APART * self.apart[0]
        return self.enough and nearer


@cache
def robot_named(name: str) -> Robot:
    """One of ours."""
    return urdfcal.load_robot(ROBOTS / name / f"{name}.urdf.xacro")


def drawn_setup(name: str, sensor: str, rng: np.random.Generator) -> SimulatedSetup:
    """A robot that is wrong everywhere, and what measures it."""
    robot = robot_named(name)
    sensors, lasers = parse_sensors([sensor if sensor == "laser" else f"{sensor}:{LINKS[name]}"], robot, 0)
    seen = seen_with(robot, sensors, "", lasers) if sensors else robot
    size = 10 ** rng.uniform(np.log10(0.3), np.log10(5.0))
    errors, x = random_truth(seen, rng, size * MM, size * 0.1 * 10 ** rng.uniform(-0.3, 0.3) * DEG)
    return simulated_setup(seen, errors, x, sensors, rng)


def drawn_positions(setup: SimulatedSetup, sensor: str, way: str, poses: int, rng: np.random.Generator) -> Matrix:
    """Where the poses are taken, (poses, inputs)."""

    def anywhere(count: int) -> Matrix:
        if sensor == "laser":
            return draw_poses(setup.robot, setup.errors, setup.x, count, rng)
        return random_positions(setup.robot, count, rng)

    if way == "repeated":
        few = anywhere(int(rng.integers(1, 6)))
        return np.asarray(few[rng.integers(0, len(few), poses)])
    if way == "line":
        first, last = anywhere(2) if sensor != "laser" else (one := anywhere(1)[0], one + rng.normal(0, 3 * DEG, one.shape))
        return np.asarray(first + np.sort(rng.uniform(0, 1, poses))[:, None] * (last - first))
    if way == "tiny":
        return np.asarray(anywhere(1) + rng.uniform(0.2, 3) * DEG * rng.normal(0, 1, (poses, len(setup.robot.chain.inputs))))
    return anywhere(poses)


def readings_at(setup: SimulatedSetup, q: Matrix, rng: np.random.Generator, noise: ReadingNoise) -> Measurements:
    """What points and poses read at some positions."""
    readings, seen = [], setup.motion(q, "")[1]
    for sensor in setup.sensors:
        p, R = seen[sensor.target][:2]
        view = View(p, R, np.empty((len(q), 0)), np.broadcast_to(np.eye(3), (len(q), 3, 3)))
        for kind in SENSOR_KINDS[sensor.kind]:
            scale = noise.angle if HOW[kind].words.unit == "deg" else noise.length
            values = HOW[kind].disturbed(HOW[kind].read(view), lambda shape, scale=scale: noise.draw(rng, scale, shape))
            readings.append(Readings(kind, sensor.target, sensor.link, values, np.full(len(q), ""), np.full(len(q), np.nan)))
    blank = spots_measured(setup.robot, q, np.zeros((len(q), 0, 2)))
    return replace(blank, readings=tuple(readings), reference=setup.robot.instruments.reference)


def measured(setup: SimulatedSetup, sensor: str, way: str, poses: int, rng: np.random.Generator) -> Measurements:
    """What is read, and what is written down of it."""
    size = 10 ** rng.uniform(np.log10(0.03), np.log10(1.0)) * MM
    noise = ReadingNoise(spot=size, length=size, angle=0.02 * DEG)
    q = drawn_positions(setup, sensor, way, poses, rng)
    if sensor == "laser":
        data = simulate(setup.robot, setup.errors, setup.x, q, rng, noise)
    else:
        data = readings_at(setup, q, rng, noise)
    if way == "noise in another unit":
        stated = size * (1000.0 if rng.random() < 0.7 else 1e-3)
        return replace(data, readings=tuple(replace(own, sigma=np.full(len(data), stated)) for own in data.readings))
    if way == "joint in another unit":
        q = data.q.copy()
        q[:, int(rng.integers(q.shape[1]))] *= DEG
        return replace(data, q=q)
    if way == "readings in another unit":
        first = data.readings[0]
        return replace(data, readings=(replace(first, values=first.values * rng.choice([1e3, 1e-3, 25.4, 1 / 25.4])), *data.readings[1:]))
    return data


def places_of(robot: Robot, origins: dict[str, SE3], link: str, q: Matrix) -> tuple[Matrix, Matrix]:
    """Origin (n, 3) and axes (n, 3, 3) of the link in its base link, with corrected origins."""
    joints = robot.tree.joints
    corrections = {name: OriginCorrection(joints[name].origin, origin, joints[name].moves) for name, origin in origins.items()}
    model = corrected_model(robot.model, corrections)
    data, base, tool = model.createData(), model.getFrameId(base_link(robot, link)), model.getFrameId(link)
    origin, axes = np.empty((len(q), 3)), np.empty((len(q), 3, 3))
    for pose, configuration in enumerate(whole_configurations(robot, q)):
        pin.framesForwardKinematics(model, data, configuration)
        place = data.oMf[base].actInv(data.oMf[tool])
        origin[pose], axes[pose] = place.translation, place.rotation
    return origin, axes


def true_errors(off: Matrix, origin: Matrix, axes: Matrix) -> tuple[float, float]:
    """RMS of displacements (n, 3): as they are, and without what constant placements of base and tool explain, [m]."""
    G = np.concatenate([np.broadcast_to(np.eye(3), axes.shape), -skew(origin), axes], axis=2).reshape(-1, 9)
    left = off.ravel() - G @ np.linalg.lstsq(G, off.ravel(), rcond=1e-6)[0]
    return tuple(float(np.sqrt(np.sum(each**2) / len(off))) for each in (off, left))  # type: ignore[return-value]


def run(seed: int, asked: bool = False) -> Set:
    """Draw, fit, judge, and look at the truth."""
    warnings.simplefilter("ignore")
    rng = np.random.default_rng(seed)
    name, sensor = str(rng.choice(list(LINKS))), str(rng.choice(SENSORS))
    way, poses = str(rng.choice(WAYS, p=WEIGHTS)), round(float(np.exp(rng.uniform(np.log(3), np.log(200)))))
    what = f"{name}, {sensor}, {poses} poses, {way}"
    try:
        setup = drawn_setup(name, sensor, rng)
        data = measured(setup, sensor, way, poses, rng)
        found = urdfcal.fit(setup.robot, data)
        link = default_tool(setup.robot)
        verdict = verdict_of(replace(found, tool=link if asked else ""))
    except urdfcal.UrdfcalError as refused:
        return Set(seed, what, way, "refused", str(refused))
    q = np.random.default_rng([seed, 1]).uniform(*joint_limits(setup.robot), (CONFIGURATIONS, len(setup.robot.chain.inputs)))
    truth, axes = places_of(setup.robot, setup.errors.corrected_origins(setup.x), link, q)
    nominal, calibrated = (
        places_of(setup.robot, origins, link, q)[0] for origins in ({}, {name: own.corrected for name, own in found.corrections.items()})
    )
    before, after = true_errors(truth - nominal, truth, axes), true_errors(truth - calibrated, truth, axes)
    return Set(
        seed, what, way, verdict.use, verdict.words, (before[0], after[0]), (before[1], after[1]), _predicted(verdict), _enough(found)
    )


def _predicted(verdict: Verdict) -> tuple[float, float]:
    return (verdict.tool.in_base.after.rms, verdict.tool.up_to_constant.after.rms) if verdict.tool is not None else (np.nan, np.nan)


def _enough(found: urdfcal.Calibration) -> bool:
    poses = len({tuple(row) for row in found.data.q.round(4).tolist()})
    return found.data.numbers / len(found.data) * poses >= len(found.errors.names)


def share(part: Sequence[Set], whole: Sequence[Set]) -> str:
    """`199 of 200 (99.5 %)`."""
    return f"{len(part)} of {len(whole)} ({len(part) / max(len(whole), 1):.1%})"


def report(sets: Sequence[Set]) -> None:
    """Print what the verdicts were worth."""
    for way in WAYS:
        own = [each for each in sets if each.way == way]
        usable, good = [each for each in own if each.usable], [each for each in own if each.good]
        counts = ", ".join(f"{use} {count}" for use, count in sorted(Counter(each.use for each in own).items()))
        print(f"{way}: {len(own)} sets ({counts})")
        print(f"  usable ones that are better {share([each for each in usable if each.better], usable)}", end="; ")
        print(f"good ones refused {share([each for each in good if not each.usable], good)}")
    plain = [each for each in sets if each.use == "yes"]
    print(f"all: of those without reservations better {share([each for each in plain if each.better], plain)}")
    usable, good = [each for each in sets if each.usable], [each for each in sets if each.good]
    print(f"all: usable ones that are better {share([each for each in usable if each.better], usable)}", end="; ")
    print(f"good ones refused {share([each for each in good if not each.usable], good)}")
    off = np.array([[each.in_base[1] / each.predicted[0], each.apart[1] / each.predicted[1]] for each in usable])
    if len(off):
        low, middle, high = np.quantile(off, (0.05, 0.5, 0.95), axis=0).T.round(2).T
        print(f"true over predicted error of usable ones, 5 %, median, 95 %: in base {low[0]}, {middle[0]}, {high[0]}", end="; ")
        print(f"up to constants {low[1]}, {middle[1]}, {high[1]}")


def _told(each: Set) -> str:
    (before, after), (apart_before, apart_after) = np.array(each.in_base) / MM, np.array(each.apart) / MM
    figures = f"in base {before:.2f} -> {after:.2f} mm, apart {apart_before:.2f} -> {apart_after:.2f} mm"
    return f"  seed {each.seed}: {each.what}: {figures}: {each.words}"


def main() -> None:
    """Parse the command line and run the study."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", default="0:2000", help="first seed and the one behind the last (default 0:2000)")
    with_jobs(parser)
    parser.add_argument("--tool", action="store_true", help="judge as `--tool LINK` does, by the link in the base frame")
    parser.add_argument("-v", "--verbose", action="store_true", help="name the sets that were judged wrongly")
    arguments = parser.parse_args()
    first, last = (int(word) for word in arguments.seeds.split(":"))
    begun, seeds = time.perf_counter(), range(first, last)
    sets = over(partial(run, asked=arguments.tool), seeds, arguments)
    report(sets)
    if arguments.verbose:
        print("usable, and worse:", *(_told(each) for each in sets if each.usable and not each.better), sep="\n")
        print("good, and refused:", *(_told(each) for each in sets if each.good and not each.usable), sep="\n")
    print(f"{len(sets)} sets in {time.perf_counter() - begun:.0f} s")


if __name__ == "__main__":
    main()
