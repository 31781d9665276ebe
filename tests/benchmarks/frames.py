"""Do the covariances of frames keep their promise? Where instruments and targets are said to be, against where they were put.

    python tests/benchmarks/frames.py [--sets N] [--poses N] [--case NAME] [--six] [--jobs N] [--resume FOLDER]

Robots with errors of 2 mm and 0.2 deg in the parameters of the automatic model, so that the truth is told in the gauge of the fit; the
scales of the joints' priors are chosen by the fit. With `--six` they are wrong in all six directions of every joint, and the truth is what
a fit makes of readings without noise. *Hold*: how often the 95 % intervals of a frame's numbers (x, y, z, rot_x, rot_y, rot_z
in its own axes) hold the truth, pooled. *Whole*: how often the six of a frame together lie in their 95 % ellipsoid. *Error* and *sigma*:
RMS of what a frame is off by, and of what is claimed. *Read back*: how far the written URDF, frames included, is from what the fit
predicts of target and instrument, at the poses that were fitted.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))

import numpy as np
import numpy.typing as npt
import pinocchio as pin
from scipy.stats import chi2

import urdfcal
from tests.support.studies import over, with_jobs
from urdfcal.base.geometry import DEG, MM
from urdfcal.calibration.problem import Problem
from urdfcal.model.found_frames import found_frames
from urdfcal.model.gauge import build_error_model
from urdfcal.model.options import ModelOptions
from urdfcal.robot.description import Description
from urdfcal.robot.frames import FoundFrame
from urdfcal.robot.placed_frames import FramesWish
from urdfcal.robot.rig import Grid
from urdfcal.robot.robot import robot_from
from urdfcal.robot.sheet import ScreenArea
from urdfcal.sensors.camera import Camera
from urdfcal.simulation.readings import ReadingNoise, simulated_readings
from urdfcal.simulation.setup import SimulatedSetup, parse_sensors, seen_with
from urdfcal.simulation.simulated import simulated_by

Array = npt.NDArray[np.float64]
ROBOTS = Path(__file__).parents[2] / "robots"
NOISE = ReadingNoise(length=0.1 * MM, angle=0.02 * DEG, pixel=0.2)
CAMERA = Camera((1920, 1200), np.array([[1200.0, 0, 960.0], [0, 1200.0, 600.0], [0, 0, 1.0]]), np.zeros(5))
BOARD = Grid(5, 4, 0.03)
Z95 = 1.959963984540054


@dataclass(frozen=True)
class Case:
    """A robot, what reads, what it is read from, and whether it is wrong in all six directions of every joint."""

    robot: str
    sensors: tuple[str, ...]
    reference: str = ""
    boards: Mapping[str, Grid] = field(default_factory=dict)
    six: bool = False


CASES = {
    "UR5, tracker, reflector on tool0": Case("ur5", ("point:tool0",)),
    "UR5, tracker, marker on tool0": Case("ur5", ("pose:tool0",)),
    "UR5, camera beside it, board on tool0": Case("ur5", ("pixels:tool0",), boards={"tool0": BOARD}),
    "UR5, camera on tool0, board beside it": Case("ur5", ("pixels:base_link",), "tool0", {"base_link": BOARD}),
    "TIAGo, head camera, marker in the hand": Case("tiago", ("pose:arm_tool_link",), "xtion_optical_frame"),
    "Panda, tracker, three reflectors": Case("panda", ("point:panda_link8:a", "point:panda_link8:b", "point:panda_link5")),
}


@dataclass
class Tally:
    """What was counted over sets, by frame."""

    held: dict[str, list[float]] = field(default_factory=dict)
    whole: dict[str, list[float]] = field(default_factory=dict)
    squares: dict[str, list[tuple[float, float, float, float]]] = field(default_factory=dict)
    off: float = 0.0

    def add(self, truth: FoundFrame, found: FoundFrame) -> None:
        """One frame of one set."""
        twist = pin.log6(found.on_link.actInv(truth.on_link)).vector
        known = np.isfinite(np.diag(found.covariance))
        P, e = found.covariance[np.ix_(known, known)], twist[known]
        self.held.setdefault(found.child, []).extend((np.abs(e) < Z95 * np.sqrt(np.diag(P))).astype(float))
        self.whole.setdefault(found.child, []).append(float(e @ np.linalg.solve(P, e) < chi2.ppf(0.95, len(e))))
        spread = np.where(known, np.diag(found.covariance), np.nan)
        self.squares.setdefault(found.child, []).append(
            (float(np.mean(twist[:3] ** 2)), float(spread[:3].mean()), float(np.mean(twist[3:] ** 2)), float(spread[3:].mean()))
        )


def run(case: Case, poses: int, seed: int) -> tuple[list[tuple[FoundFrame, FoundFrame]], float]:
    """Simulate and fit: every frame, true and found; and by how much the written URDF is read differently, [m]."""
    rng = np.random.default_rng(seed)
    robot = urdfcal.load_robot(ROBOTS / case.robot / f"{case.robot}.urdf.xacro")
    sensors, _ = parse_sensors(case.sensors, robot, 0, case.boards)
    seen = seen_with(robot, sensors, case.reference, False, case.boards)
    errors = build_error_model(seen.chain, seen.rig, ModelOptions(error_model="placement" if case.six else "auto"))
    x = rng.normal(0, 1, len(errors.names)) * np.where(np.array(errors.units) == "m", 2 * MM, 0.2 * DEG)
    camera = CAMERA if case.boards else None
    setup, found = simulated_by(seen, errors, x, sensors, (poses, 0), rng, NOISE, area=ScreenArea(3.0), camera=camera, boards=case.boards)
    calibration = urdfcal.fit(robot, found.data)
    truth = in_gauge(setup, robot, poses, seed) if case.six else true_frames(setup)
    assert [true.child for true in truth] == [own.child for own in calibration.frames]
    return list(zip(truth, calibration.frames, strict=True)), read_back(calibration)


def true_frames(setup: SimulatedSetup) -> tuple[FoundFrame, ...]:
    """Where instruments and targets were put, on the links of a robot with errors in the parameters of the fit."""
    return found_frames(setup.robot.tree, setup.robot.rig, setup.errors, setup.x, np.zeros((len(setup.x), len(setup.x))), ())


def in_gauge(setup: SimulatedSetup, robot: urdfcal.Robot, poses: int, seed: int) -> tuple[FoundFrame, ...]:
    """The same of a robot with errors in all directions, as a fit has it that is told them all: by readings without any noise."""
    exact = simulated_readings(setup, 3 * poses, np.random.default_rng(seed), ReadingNoise()).data
    sigmas = dict.fromkeys(exact.kinds, 1e-7)
    return urdfcal.fit(robot, exact, sigmas=sigmas, evidence=False, gated=False, asking=False, sane=False).frames


def read_back(calibration: urdfcal.Calibration) -> float:
    """Largest distance, [m], from Pinocchio's placement of targets in instruments of the written URDF to the fit's own."""
    wish = FramesWish(write=True, add=True)
    chosen = wish.chosen(calibration.frames, calibration.robot.tree)
    link = {frame.label: frame.link for frame in chosen.written} | {frame.label: frame.child for frame in chosen.added}
    text = calibration.deployed(frames=wish).content("urdf")
    model = robot_from(Description(Path("written.urdf"), text, expanded=False)).model
    data, problem = model.createData(), Problem(calibration.errors, calibration.data)
    frames, worst = calibration.errors.chain.frames, 0.0
    views = problem.views(calibration.x)
    for pose, q in enumerate(calibration.data.q):
        full = pin.neutral(model)
        for name, value in zip(calibration.data.joints, q.tolist(), strict=True):
            full[model.joints[model.getJointId(name)].idx_q] = value
        pin.framesForwardKinematics(model, data, full)
        for channel, view in zip(problem.channels, views, strict=True):
            target = frames[channel.target]
            label = calibration.data.instruments.targets[channel.target - 1].placed_by
            instrument = calibration.robot.rig.instruments.every[0].name
            there, here = (data.oMf[model.getFrameId(link[name])] for name in (instrument, label))
            T_there_target = there.actInv(here * pin.SE3(np.eye(3), np.array(target.at)))
            worst = max(worst, float(np.linalg.norm(T_there_target.translation - view.p[pose])))
    return worst


def main() -> None:
    """Every case, a line a frame."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--sets", type=int, default=40)
    parser.add_argument("--poses", type=int, default=40)
    parser.add_argument("--case", default="")
    parser.add_argument("--six", action="store_true")
    with_jobs(parser)
    asked = parser.parse_args()
    print(f"{asked.sets} sets of {asked.poses} poses\n")
    print(f"{'':40} {'frame':20} hold  whole  error mm  sigma mm  error deg  sigma deg")
    held: list[float] = []
    for name, case in CASES.items():
        if asked.case not in name:
            continue
        tally = Tally()
        for frames, off in over(partial(run, replace(case, six=asked.six), asked.poses), range(asked.sets), asked):
            tally.off = max(tally.off, off)
            for true, own in frames:
                tally.add(true, own)
        for child, own in tally.held.items():
            sizes = np.sqrt(np.mean(np.array(tally.squares[child]), axis=0)) / [MM, MM, DEG, DEG]
            figures = "  ".join(f"{size:8.4f}" for size in sizes)
            print(f"{name:40} {child:20} {np.mean(own):.3f} {np.mean(tally.whole[child]):.3f}  {figures}")
            held += own
        print(f"{'':40} read back within {tally.off:.1e} m", flush=True)
    print(f"\nall: {np.mean(held) * 100:.1f} % of {len(held)} numbers")


if __name__ == "__main__":
    main()
