"""What a calibrated model gains a controller, and what it costs: errors at inverse-kinematics targets, time of a call.

All robots are simulated; see `examples/inverse_kinematics.py`, which this script runs over several seeds. The cost is the time of
forward kinematics with all frames, of a frame's Jacobian and of the inverse dynamics, on the corrected model over the nominal one,
in turns; and the time of `apply_to` itself.
"""

from __future__ import annotations

import argparse
import runpy
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

import urdfcal
from urdfcal.robot.corrections import OriginCorrection, corrected_model

ROOT = Path(__file__).parents[2]
ROUNDS, CALLS = 31, 1000


def errors(robot: urdfcal.Robot, study: Callable[..., Any], seeds: int, **options: Any) -> Iterator[str]:
    """Mean over the seeds of the mean error, and the largest of all, by model."""
    found = [study(robot, np.random.default_rng(seed), **options) for seed in range(seeds)]
    for name in ("nominal", "calibrated"):
        every = np.array([run.errors[name] for run in found])
        mm, mrad = every.mean(axis=(0, 1))
        yield f"{robot.name:8}{name:12}{mm:9.3f} mm{every[..., 0].max():9.3f} mm{mrad:9.3f} mrad{every[..., 1].max():9.3f} mrad"


def calls(model: Any, q: Any, v: Any) -> dict[str, Callable[[], Any]]:
    """What a controller asks of a model."""
    data, frame = model.createData(), model.nframes - 1
    return {
        "forward kinematics": lambda: pin.framesForwardKinematics(model, data, q),
        "frame Jacobian": lambda: pin.computeFrameJacobian(model, data, q, frame),
        "inverse dynamics": lambda: pin.rnea(model, data, q, v, v),
    }


def seconds(call: Callable[[], Any], count: int = CALLS) -> float:
    """Time of one call, [s]."""
    start = time.perf_counter()
    for _ in range(count):
        call()
    return (time.perf_counter() - start) / count


def cost(robot: urdfcal.Robot) -> Iterator[str]:
    """Shortest times on both models, taken in turns (others may be busy on the machine), and their ratio."""
    rng = np.random.default_rng(0)
    joints = [step.joint for step in robot.chain.steps]
    corrections = {
        joint.name: OriginCorrection(joint.origin, joint.origin * pin.exp6(rng.normal(0, 0.01, 6)), joint.moves) for joint in joints
    }
    corrected = corrected_model(robot.model, corrections)
    q = pin.integrate(robot.model, pin.neutral(robot.model), rng.uniform(-0.5, 0.5, robot.model.nv))
    pairs = [calls(model, q, rng.normal(size=robot.model.nv)) for model in (robot.model, corrected)]
    for name in pairs[0]:
        times = np.array([[seconds(pair[name]) for pair in pairs] for _ in range(ROUNDS)]) * 1e6
        nominal, other = times.min(axis=0)
        yield f"{robot.name:8}{name:20}{nominal:8.2f} us{other:8.2f} us   ratio {other / nominal:.3f}"
    once = min(seconds(lambda: corrected_model(robot.model, corrections), 10) for _ in range(ROUNDS))
    yield f"{robot.name:8}{'apply_to itself':20}{once * 1e3:8.2f} ms"


def main() -> None:
    """Parse the command line and run the study."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=5, help="true robots of each kind (default 5)")
    parser.add_argument("--targets", type=int, default=50, help="targets a robot (default 50)")
    parser.add_argument("--no-cost", action="store_true", help="leave the times out")
    given = parser.parse_args()
    example = runpy.run_path(str(ROOT / "examples" / "inverse_kinematics.py"))
    robots = {name: urdfcal.load_robot(ROOT / "robots" / name / f"{name}.urdf.xacro") for name in ("arm7", "panda", "ur5", "tiago")}
    for poses in (60, 100):
        print(f"position and rotation at {given.targets} targets, {poses} poses, {given.seeds} seeds: mean, max, mean, max")
        for name in ("arm7", "panda"):
            for row in errors(robots[name], example["study"], given.seeds, poses=poses, count=given.targets):
                print(row, flush=True)
    if given.no_cost:
        return
    print("\ntime of a call on the nominal and on the corrected model")
    for robot in robots.values():
        for row in cost(robot):
            print(row, flush=True)


if __name__ == "__main__":
    main()
