"""Mistaken measurements by instruments beside lasers: does `fit` name each kind of mistake, and leave healthy data alone?

    python tests/benchmarks/reading_mistakes.py [--seeds N] [--healthy N] [--only SENSOR ...] [--jobs N] [--resume FOLDER] [-v]

Truths of mistaken sets: Gaussian errors of 2 mm and 0.2 deg on the parameters that fit has. Truths of healthy sets: by turns 1 mm and
0.1 deg, 10 mm and 1 deg, and these with 10 % of the readings up to 200 mm off. Measuring frames, targets and places stand anywhere.
Mistakes of one joint take the joints in turn. *named*: `fit` refused the data and said which mistake it is, or named it beside
another that explains them as well; *other*: it refused them for something else; *rejected*: it fitted them, and found the result
not to be trusted; *carried*: the mistake is no mistake, since frame or target stand for it: what is left over is noise; *silent*: the
rest. Any but *silent* is an alarm where the data are healthy.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))

import numpy as np
from mistakes import Answer, fitted

from tests.support.studies import over, with_jobs
from urdfcal.base.geometry import DEG, MM
from urdfcal.base.rotations import quaternions_of
from urdfcal.calibration.start.mistakes import mistakes_of_joints, mistakes_of_readings
from urdfcal.model.gauge import build_error_model
from urdfcal.model.options import ModelOptions
from urdfcal.robot.robot import Robot, load_robot
from urdfcal.sensors.measurements import Measurements
from urdfcal.simulation.readings import ReadingNoise, simulate_readings
from urdfcal.simulation.setup import SimulatedSetup, parse_sensors, seen_with, simulated_setup

ROBOTS = {"panda": "panda_link8", "ur5": "tool0", "tiago": "arm_tool_link"}
SENSORS = {
    "point": ("point:{}",),
    "pose": ("pose:{}",),
    "distance": ("distance:{}",),
    "plane": ("plane:{}:probe",),
    "socket": ("socket:{}:ball",),
}
NOISE = ReadingNoise(length=0.1 * MM, angle=0.02 * DEG)
HEALTHY = ((1.0, 0.1, 0.0), (10.0, 1.0, 0.0), (10.0, 1.0, 0.1))  # mm, deg, share of outliers
CARRIED = 3.0  # times the noise
Change = Callable[[Measurements], Measurements]
OPPOSITES = {"read as degrees": "read as radians", "row before": "row behind"}
OPPOSITES |= {new: old for old, new in OPPOSITES.items()}


def setup_of(robot: Robot, name: str, link: str, mm: float, deg: float, rng: np.random.Generator) -> SimulatedSetup:
    """A robot with Gaussian errors, and instruments that stand anywhere."""
    sensors, _ = parse_sensors(tuple(each.format(link) for each in SENSORS[name]), robot, 4)
    seen = seen_with(robot, sensors)
    errors = build_error_model(seen.chain, seen.rig, ModelOptions())
    x = rng.normal(0, np.where(np.array(errors.units) == "m", mm * MM, deg * DEG))
    return simulated_setup(seen, errors, x, sensors, rng)


def with_outliers(data: Measurements, share: float, rng: np.random.Generator) -> Measurements:
    """The same with a share of the points and distances far off."""
    readings = []
    for each in data.readings:
        bad = (rng.random(len(data)) < share)[:, None] & np.isin(each.sensor, ["point", "distance"])
        readings.append(replace(each, values=each.values + bad * rng.uniform(-200 * MM, 200 * MM, each.values.shape)))
    return replace(data, readings=tuple(readings))


def of_orientation(change: Callable[[np.ndarray], np.ndarray]) -> Change:
    """A mistake in quaternions."""
    return lambda data: replace(
        data, readings=tuple(replace(each, values=change(each.values)) if each.sensor == "orientation" else each for each in data.readings)
    )


def angles_of(quaternions: np.ndarray) -> np.ndarray:
    """Roll, pitch and yaw, by Pinocchio."""
    import pinocchio as pin

    return np.array([pin.rpy.matrixToRpy(pin.Quaternion(*np.roll(each, 1)).toRotationMatrix()) for each in quaternions])


def turning(quaternions: np.ndarray) -> np.ndarray:
    """Quaternions whose angles about fixed axes are those of the given ones about axes that turn along, by SciPy."""
    from scipy.spatial.transform import Rotation

    return quaternions_of(Rotation.from_quat(quaternions).as_euler("XYZ"))


def backwards(undone: str) -> str:
    """What names the mistake that undoing another one makes."""
    for old, new in OPPOSITES.items():
        if old in undone:
            return undone.replace(old, new).split(" in place")[0]
    if " in place of " in undone:
        return undone.replace("metres in place of ", "")
    if any(unit in undone for unit in ("millimetres", "centimetres", "inches")):
        return undone.replace("read as ", "read as metres in place of ")
    return undone.split(" (")[0]


def mistakes(data: Measurements, robot: Robot) -> dict[str, list[tuple[str, Change]]]:
    """Every kind of mistake, by name: the words that name it, and what makes it."""
    found: dict[str, list[tuple[str, Change]]] = {}
    if any(each.sensor == "orientation" for each in data.readings):
        found["quaternion order"] = [("the quaternions read as w, x, y, z", of_orientation(lambda values: np.roll(values, 1, axis=1)))]
        found["turning axes"] = [("about axes that turn along", of_orientation(turning))]
        degrees = of_orientation(lambda values: quaternions_of(angles_of(values) * DEG))
        found["rpy: rad as deg"] = [("roll, pitch and yaw read as radians", degrees)]
    for mistake in (*mistakes_of_readings(data, beams=False), *mistakes_of_joints(data, robot.chain.inputs)):
        if any(word in mistake.undone for word in ("quaternions", "roll, pitch")):
            continue
        words = backwards(mistake.undone)
        if " deg added" in words and "180" not in words:
            words = words[1:] if words.startswith("-") else f"-{words}"
        kind = mistake.undone
        for name in data.joints:
            kind = kind.replace(name, "*")
        found.setdefault(kind.split(" (")[0], []).append((words, mistake.change))
    return found


def said_of(robot: Robot, data: Measurements) -> tuple[str, str, float]:
    """What `fit` makes of some measurements, in a word, its own words, and how long it took, [s]."""
    found, why, seconds = fitted(robot, data)
    if found is None:
        return "refused", why, seconds
    if found.rejection:
        return "rejected", found.rejection, seconds
    true = [NOISE.angle if each.sensor == "orientation" else NOISE.length for each in data.readings]
    return "carried" if np.all(found.estimate.noise.sigma < CARRIED * np.array(true)) else "silent", "", seconds


def main() -> None:
    """Parse the command line and run the study."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=2, help="seeds for each kind of mistake (default 2)")
    parser.add_argument("--healthy", type=int, default=30, help="healthy sets for each robot and sensor (default 30)")
    parser.add_argument("--poses", type=int, default=60, help="how many poses (default 60)")
    parser.add_argument("--robots", type=Path, default=Path("robots"), help="folder of the robots (default robots)")
    parser.add_argument("--only", nargs="*", default=list(SENSORS), help="sensors (default all)")
    with_jobs(parser)
    parser.add_argument("-v", "--verbose", action="store_true", help="print every answer that was not the right one")
    arguments = parser.parse_args()
    for name, link in ROBOTS.items():
        robot = load_robot(arguments.robots / name / f"{name}.urdf.xacro")
        for sensor in arguments.only:
            runs = over(partial(tried, robot, sensor, link, arguments.poses), range(arguments.seeds), arguments)
            print(row(f"{name:7s}{sensor:10s}", runs, arguments.verbose), flush=True)
            false = [
                said for said in over(partial(alarm, robot, sensor, link, arguments.poses), range(arguments.healthy), arguments) if said
            ]
            print(f"{name:7s}{sensor:10s}{arguments.healthy:4d} healthy: {len(false)} alarms {' | '.join(false[:3])}", flush=True)


def tried(robot: Robot, sensor: str, link: str, poses: int, seed: int) -> dict[str, Answer]:
    """What is made of one set with each kind of mistake."""
    rng, answers = np.random.default_rng([seed, 1]), {}
    setup = setup_of(robot, sensor, link, 2, 0.2, rng)
    data = simulate_readings(setup, poses, rng, NOISE)
    for kind, variants in mistakes(data, setup.robot).items():
        words, change = variants[seed % len(variants)]
        verdict, said, seconds = said_of(setup.robot, change(data))
        verdict = ("named" if words in said else "other") if verdict == "refused" else verdict
        answers[kind] = Answer(verdict, words, said, seconds)
    return answers


def row(title: str, runs: list[dict[str, Answer]], verbose: bool) -> str:
    """One line of the table, and before it, if wanted, every answer that was not the right one."""
    answers = [(seed, kind, own) for seed, run in enumerate(runs) for kind, own in run.items()]
    robot_and_sensor = " ".join(title.split())
    for seed, kind, own in answers:
        if verbose and own.verdict != "named":
            print(f"    {robot_and_sensor}, {kind}: {own.mistake}, seed {seed}, {own.verdict}: {own.said or 'nothing said'}")
    counts = ", ".join(f"{count} {verdict}" for verdict, count in Counter(own.verdict for _, _, own in answers).most_common())
    times = [own.seconds for _, _, own in answers]
    return f"{title}{len(answers):4d} mistakes: {counts}; {np.median(times):.1f} s, at most {max(times):.1f}"


def alarm(robot: Robot, sensor: str, link: str, poses: int, seed: int) -> str:
    """What was said of a healthy set, empty where nothing was."""
    mm, deg, share = HEALTHY[seed % 3]
    rng = np.random.default_rng([seed, 2])
    setup = setup_of(robot, sensor, link, mm, deg, rng)
    data = with_outliers(simulate_readings(setup, poses, rng, NOISE), share, rng)
    verdict, words, _ = said_of(setup.robot, data)
    return f"set {seed}, {verdict}: {words}" if verdict in ("refused", "rejected") else ""


if __name__ == "__main__":
    main()
