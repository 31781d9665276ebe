"""Cost of `corrected_configuration` and `command` against one forward kinematics of the model, and how well they do.

    python tests/benchmarks/compensation.py [--poses N]

Arms bend by 1 mrad (sigma) about every joint's own axis and 0.5 mrad across. Times are the best of several repetitions on one thread, for
one pose a call, and for each pose of a stack. `left` is what is off at the module's origin with the corrected configuration, as a share of
what is off without it, root mean square over random configurations within the limits; *median* of all, and the share of configurations
where more than a tenth is left (near singularities the joints cannot move the module every way).
"""

from __future__ import annotations

import argparse
import os
import sys
import timeit
from collections.abc import Callable
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).parents[2]))

import numpy as np
import pinocchio as pin

import urdfcal
from tests.calibration.analysis.test_compensation import bent_tips, tips
from urdfcal.calibration.analysis.compensation import Compensation
from urdfcal.model.gravity import Gravity, WeighedRobot
from urdfcal.model.softness import Softness, gravity_terms
from urdfcal.robot.configurations import joint_limits, whole_configurations
from urdfcal.robot.packages import find_package
from urdfcal.robot.robot import Robot

US = 1e-6
ROOT = Path(__file__).parents[2]


def bent(robot: Robot, rng: np.random.Generator) -> Compensation:
    """A robot whose joints all give way."""
    weighed, (lower, upper) = WeighedRobot(robot, Gravity()), joint_limits(robot)
    terms = gravity_terms(robot.chain, weighed.moments(rng.uniform(lower, upper, (400, len(lower)))))
    values = {term.name: float(abs(rng.normal(0, 1e-3 if term.axis is None else 0.5e-3))) for term in terms}
    return Compensation(robot, Softness(robot.chain, terms, weighed, robot.rig.tip), values, {})


def microseconds(call: Callable[[], object], number: int) -> float:
    """The best of several repetitions."""
    return min(timeit.repeat(call, number=number, repeat=7)) / number / US


def main() -> None:
    """Read the command line, measure, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--poses", type=int, default=1000, help="poses of a stack (default 1000)")
    given = parser.parse_args()
    print(f"{'':<8}{'':>6}{'FK':>7}{'corrected us':>18}{'command us':>18}{'left':>9}{'share':>8}")
    print(f"{'arm':<8}{'terms':>6}{'us':>7}{'single':>9}{'stacked':>9}{'single':>9}{'stacked':>9}{'median':>9}{'> 0.1':>8}")
    rng = np.random.default_rng(0)
    for name in ("panda", "ur5", "tiago", "ur10"):
        if name == "ur10":
            bare = find_package("example-robot-data") / "robots/ur_description/urdf/ur10_robot.urdf"
            robot = urdfcal.load_robot(bare, screen="base_link", lasers=["tool0"])
        else:
            robot = urdfcal.load_robot(ROOT / "robots" / name / f"{name}.urdf.xacro")
        compensation, (lower, upper) = bent(robot, rng), joint_limits(robot)
        q = rng.uniform(lower, upper, (given.poses, len(lower)))
        model, data, whole = robot.model, robot.model.createData(), whole_configurations(robot, q[:1])[0]
        times = [microseconds(lambda: pin.forwardKinematics(model, data, whole), 2000)]  # noqa: B023  # called at once
        for function in (compensation.corrected_configuration, compensation.command):
            times += [microseconds(lambda: function(q[0]), 200), microseconds(lambda: function(q), 1) / len(q)]  # noqa: B023
        there = bent_tips(compensation, q)
        off = [np.linalg.norm(tips(robot, each) - there, axis=1) for each in (compensation.corrected_configuration(q), q)]
        left = off[0] / off[1]
        shown = "".join(f"{each:>9.1f}" for each in times[1:])
        print(
            f"{name:<8}{len(compensation.values):>6}{times[0]:>7.2f}{shown}{np.median(left):>9.4f}{np.mean(left > 0.1):>8.3f}", flush=True
        )


if __name__ == "__main__":
    main()
