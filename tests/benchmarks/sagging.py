"""Arms that sag, of which a tenth of the poses stand near upright: does a calibration make them worse without a word?

    python tests/benchmarks/sagging.py [--cases N] [--estimator ekf|robust] [--bad SHARE] [--data DIR] [--jobs N] [--resume FOLDER]

Robots and sensors take turns; joints sag by 1 to 2 mrad, noise is 0.1 mm and 0.02 deg; 150 poses are fitted, 60 tested, a tenth of both
near upright (`tests/support/sagging.py`). Each line says of how many readings the fit rests and how many of the upright ones it left
out; *worst*: the farthest of all test readings with the calibrated URDF over the farthest with the nominal one; *RMS*: the same; *sag*:
test RMS with the joints' sag beside the calibrated URDF, over that of a fit that is told which readings are bad; what the verdict is told.
`--bad` throws a share of the readings off by 2 to 50 mm, and says how many of these were found. `--data` takes the real robots of
`real_robots.py` instead, on their repeatable splits.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).parents[2]))

import numpy as np

import urdfcal
from tests.benchmarks.real_robots import ROBOTS, repeatable_splits
from tests.support.sagging import SaggingArm, sagging_arm
from tests.support.studies import over, with_jobs
from urdfcal.api import Calibration
from urdfcal.base.geometry import MM, Mask
from urdfcal.calibration.analysis.clusters import pose_distances
from urdfcal.calibration.analysis.concerns import objections, reservations
from urdfcal.calibration.analysis.sag import fit_sag
from urdfcal.calibration.error_table import error_table, rms_of
from urdfcal.calibration.problem import Problem
from urdfcal.robot.packages import find_package

ROOT = Path(__file__).parents[2] / "robots"
ARMS = (
    ("panda", "pose:panda_link8"),
    ("arm7", "laser"),
    ("ur5", "pose:tool0"),
    ("panda", "laser"),
    ("ur10", "pose:tool0"),
    ("ur5", "point:tool0"),
    ("tiago", "pose:arm_tool_link"),
    ("arm7", "pose:link7"),
)


@dataclass(frozen=True)
class Outcome:
    """What became of one case.

    Attributes:
        label: Robot, sensor and seed, or data set and split.
        worst, rms: With the calibrated URDF over the nominal one, of all test readings.
        sag: With sag, over a fit that is told which readings are bad; nan where there is none.
        note: What was left out.
        words: What the verdict is told.
        refused: Whether it is told not to use it.
    """

    label: str
    worst: float
    rms: float
    sag: float
    note: str
    words: tuple[str, ...]
    refused: bool

    @property
    def silent(self) -> bool:
        """Whether the worst pose became worse and nobody says so."""
        return self.worst > 1 and not self.words

    def line(self) -> str:
        """For people."""
        said = "do not use" if self.refused else f"{len(self.words)} reservations" if self.words else ""
        return f"{self.label:34s} worst {self.worst:5.2f}  RMS {self.rms:5.2f}  sag {self.sag:5.2f}  {self.note:34s} {said}"


def load(name: str) -> urdfcal.Robot:
    """One of the arms."""
    if name == "ur10":
        return urdfcal.load_robot(find_package("example-robot-data") / "robots/ur_description/urdf/ur10_robot.urdf")
    return urdfcal.load_robot(ROOT / name / f"{name}.urdf.xacro")


def thrown_off(data: urdfcal.Measurements, share: float, rng: np.random.Generator) -> tuple[urdfcal.Measurements, Mask]:
    """The measurements with some spots or points thrown off, and which, (n, readings)."""
    readings, hits = [], []
    for reading in data.readings:
        hit = (rng.random(len(data)) < share) & (reading.values.shape[1] < 4)  # quaternions are left alone
        way = rng.normal(size=reading.values.shape)
        way *= (rng.uniform(2 * MM, 50 * MM, len(data)) / np.linalg.norm(way, axis=1))[:, None]
        readings.append(replace(reading, values=reading.values + way * hit[:, None]))
        hits.append(hit)
    return replace(data, readings=tuple(readings)), np.column_stack(hits)


def with_sag(calibration: Calibration, test: urdfcal.Measurements) -> float:
    """Test RMS of the pair of URDF and compensation."""
    sag = fit_sag(calibration, folds=0, compare_directions=False)
    if sag is None:
        return float("nan")
    return rms_of(error_table(Problem(sag.errors, test).linearise(sag.estimate.belief.x), len(test)))


def simulated(estimator: str, bad: float, case: int) -> Outcome:
    """One simulated arm."""
    (name, sensor), seed = ARMS[case % len(ARMS)], case // len(ARMS)
    arm = sagging_arm(load(name), sensor, seed)
    data, hit = thrown_off(arm.fit, bad, np.random.default_rng(seed))
    found = urdfcal.fit(arm.robot, data, test=arm.test, estimator=estimator)
    told = urdfcal.fit(arm.robot, data.without(hit), gated=False)
    out = np.column_stack([~reading.measured.any(axis=1) for reading in found.data.readings])
    after, before = pose_distances(found)
    words = (*objections(found), *reservations(found))
    note = _note(arm, out, hit)
    sag = with_sag(found, arm.test) / with_sag(told, arm.test)
    rms = float(np.linalg.norm(after) / np.linalg.norm(before))
    return Outcome(f"{name} {sensor} {seed}", after.max() / before.max(), rms, sag, note, words, bool(objections(found)))


def _note(arm: SaggingArm, out: Mask, hit: Mask) -> str:
    upright = f"upright out {int((out & ~hit)[arm.upright].sum())} of {int((~hit)[arm.upright].sum())}"
    others = f", others {int((out & ~hit)[~arm.upright].sum())}"
    return upright + others + (f", bad {int((out & hit).sum())} of {int(hit.sum())}" if hit.any() else "")


def real(data: Path) -> Iterator[Outcome]:
    """The real robots."""
    for robot in ROBOTS:
        arm, whole = robot.load(data)
        for number, split in enumerate(repeatable_splits(robot, whole)):
            found = urdfcal.fit(arm, robot.part(whole, split.train), test=robot.part(whole, split.test))
            after, before = pose_distances(found)
            words = (*objections(found), *reservations(found))
            rms = float(np.linalg.norm(after) / np.linalg.norm(before))
            label, note = f"{robot.folder} {split.name} {number}", f"{len(found.outliers)} outliers"
            yield Outcome(label, after.max() / before.max(), rms, float("nan"), note, words, bool(objections(found)))


def main() -> None:
    """Print a line a case, and what they come to."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, default=40)
    parser.add_argument("--estimator", default="ekf", choices=("ekf", "lse", "robust"))
    parser.add_argument("--bad", type=float, default=0.0, help="share of the readings that are thrown off (default 0)")
    parser.add_argument("--data", type=Path, help="the real robots' measurements")
    with_jobs(parser)
    arguments = parser.parse_args()
    work = partial(simulated, arguments.estimator, arguments.bad)
    outcomes = list(real(arguments.data)) if arguments.data else over(work, range(arguments.cases), arguments)
    for outcome in outcomes:
        print(outcome.line(), flush=True)
    worst, silent = [outcome.worst for outcome in outcomes], [outcome.label for outcome in outcomes if outcome.silent]
    sag = [outcome.sag for outcome in outcomes if np.isfinite(outcome.sag)]
    print(f"worst pose: median {np.median(worst):.2f}, largest {max(worst):.2f}, above 1 in {sum(ratio > 1 for ratio in worst)} cases,")
    print(f"of which without a word: {', '.join(silent) or 'none'}; do not use: {sum(outcome.refused for outcome in outcomes)}")
    if sag:
        print(f"with sag, over a fit that is told: median {np.median(sag):.3f}, largest {max(sag):.3f}")


if __name__ == "__main__":
    main()
