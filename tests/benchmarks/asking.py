"""Does a fit name what its model lacks, and do its intervals hold all the same?

    python tests/benchmarks/asking.py [--robots panda ur5 tiago] [--what sag drift ...] [--seeds N] [--poses N] [--times T ...]
        [--jobs N] [--resume FOLDER]

Simulated arms with errors of 1 mm and 0.1 deg in every direction of every joint that do one thing beside (`tests/support/disturbed.py`:
its usual sizes, times T): Panda with lasers (0.5 mm), UR5 with points (0.1 mm), TIAGo with poses (0.1 mm, 0.02 deg). *first*, *second*:
sets in which it is what stands out most, or next; *RMS*: of readings at unseen poses against what a perfect instrument in a rig that
stands still reads of the real arm, with the URDF and, of what arms do, with the compensation (pair); *over told*: the nearer of the two
over that of a fit that is told what to look for; *hold*: 95 %
intervals of those readings that hold, by the covariance alone, of the URDF and of the pair. `none` counts sets in which anything is named.
"""

from __future__ import annotations

import argparse
import os
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).parents[2]))

import numpy as np

import urdfcal
from tests.support.disturbed import HARMONIC, USUAL, DisturbedArm, disturbed_arm, held_and_off
from tests.support.studies import over, with_jobs
from urdfcal.api import Calibration
from urdfcal.base.geometry import MM
from urdfcal.calibration.analysis.sag import fit_sag
from urdfcal.calibration.asking.disturbances import courses_of
from urdfcal.calibration.asking.rig import RigColumns
from urdfcal.calibration.problem import Problem, problem_of
from urdfcal.calibration.richer import usual_range
from urdfcal.estimation.ekf import Belief, iterated_schedule
from urdfcal.model.error_model import with_rig, with_softness
from urdfcal.model.gravity import Gravity, WeighedRobot
from urdfcal.model.softness import extra_terms, gear_terms, gravity_terms

ROBOTS = Path(__file__).parents[2] / "robots"
SENSORS = {"panda": "laser", "ur5": "point:tool0", "tiago": "pose:arm_tool_link"}
WHAT = {"two_cycles": "eccentricity", "walk": "drift"}  # what it is named, where that differs
RIGS = {"drift": "drift", "walk": "wander", "temperature": "temperature", "screen_bow": "screen_bow", "lens": "lens"}
RIGS["readings_scale"] = "readings_scale"


def told(arm: DisturbedArm, what: str, found: Calibration) -> float:
    """Mean square of a fit that has what there is in its model, and nothing else."""
    bare = tuple(parameter for parameter in found.errors.parameters if parameter.kind != "rig")
    errors, noise = replace(found.errors, parameters=bare, rig=None), found.estimate.noise
    noise = replace(noise, joint_sigma=np.zeros(len(arm.fit.joints)))
    chain = arm.robot.chain
    if what in RIGS:
        terms = [term for term in RigColumns(Problem(errors, arm.fit), np.zeros(len(bare))).terms if term.what == RIGS[what]]
        errors = with_rig(errors, terms, courses_of(arm.fit))
    elif what == "joint_noise":
        noise = replace(noise, joint_sigma=np.full(len(arm.fit.joints), USUAL[what]))
    elif what != "none":
        weighed = WeighedRobot(arm.robot, Gravity())
        extra = {"two_cycles": "eccentricity"}.get(what, what)
        soft = gravity_terms(chain, weighed.moments(usual_range(arm.robot, arm.fit))) if what == "sag" else extra_terms(chain, [extra])
        turning = [joint.name for joint in chain.inputs if not joint.prismatic]
        soft = gear_terms(chain, [(joint, HARMONIC) for joint in turning]) if what == "harmonics" else soft
        errors = with_softness(errors, soft, weighed, arm.robot.rig.tip)
    known = dict(zip(found.errors.names, found.x.tolist(), strict=True))
    start = np.array([known.get(name, 0.0) for name in errors.names])
    model = problem_of(errors, arm.fit, noise)
    fit = iterated_schedule(model.linearise, Belief.independent(errors.mean, errors.sigma), noise, start=start)
    return held_and_off(errors, fit.belief.x, fit.belief.P, arm)[1]


def run(robot: urdfcal.Robot, sensor: str, what: str, times: float, poses: int, seed: int) -> tuple[float, ...]:
    """Named first, or second; share held and mean square of the URDF and of the pair; mean square of a told fit; anything named."""
    arm = disturbed_arm(robot, sensor, what, seed, times=times, poses=poses)
    found = urdfcal.fit(arm.robot, arm.fit)
    names = [own.what for own in found.stands_out[:2]]
    held, square = held_and_off(found.errors, found.x, found.covariance, arm)
    pair = (np.nan, np.nan)
    if any(not own.entered for own in found.stands_out) and (joint := fit_sag(found, folds=0, compare_directions=False)) is not None:
        pair = held_and_off(joint.errors, joint.estimate.belief.x, joint.estimate.belief.P, arm)
    own = WHAT.get(what, what)
    return float(names[:1] == [own]), float(own in names), held, square, *pair, told(arm, what, found), float(bool(names))


def main() -> None:
    """Parse the command line and run the study."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robots", nargs="+", default=list(SENSORS), choices=list(SENSORS))
    parser.add_argument("--what", nargs="+", default=list(USUAL), choices=list(USUAL))
    parser.add_argument("--times", nargs="+", type=float, default=[1.0], help="times the usual size (default 1)")
    parser.add_argument("--seeds", type=int, default=20, help="sets of each (default 20)")
    parser.add_argument("--first", type=int, default=0, help="first seed (default 0)")
    parser.add_argument("--poses", type=int, default=60, help="poses of a set (default 60)")
    with_jobs(parser)
    arguments = parser.parse_args()
    print("robot  what            times  sets  first  second  RMS mm  pair mm  over told  hold  pair holds")
    seeds = range(arguments.first, arguments.first + arguments.seeds)
    for name in arguments.robots:
        robot = urdfcal.load_robot(ROBOTS / name / f"{name}.urdf.xacro")
        for what in arguments.what:
            for times in arguments.times if what != "none" else [1.0]:
                table = np.array(over(partial(run, robot, SENSORS[name], what, times, arguments.poses), seeds, arguments))
                first, second, held, square, pair_held, pair_square, told_square, named = table.T
                best = np.fmin(square, pair_square) if what not in (*RIGS, "joint_noise", "none") else square
                pairs = f"{np.sqrt(np.nanmean(pair_square)) / MM:8.3f}" if np.isfinite(pair_square).any() else " " * 8
                pair_holds = f"{np.nanmean(pair_held):.3f}" if np.isfinite(pair_held).any() else ""
                note = f"   named in {int(named.sum())}" if what == "none" else ""
                print(
                    f"{name:6s} {what:15s} {times:5g} {len(table):5d} {first.mean():6.2f} {second.mean():7.2f} "
                    f"{np.sqrt(square.mean()) / MM:7.3f} {pairs} {np.sqrt(best.mean() / told_square.mean()):10.2f} "
                    f"{held.mean():5.3f}  {pair_holds}{note}",
                    flush=True,
                )


if __name__ == "__main__":
    main()
