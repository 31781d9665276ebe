"""One end of a robot seen from another on a different branch: how far are both from the link that they hang on, before and after?

    python tests/benchmarks/two_branches.py [--seeds N] [--poses N]

Every joint between the ends is off by 2 mm and 0.2 deg (Gaussian, six numbers a joint); poses of the hand are seen with 0.1 mm and
0.02 deg of noise from a camera, or from the other hand. Tested on poses anywhere within the limits that were not measured, by
Pinocchio on the robots' whole descriptions: the hand and the camera in the link where the branches part, and one in the other.
SIMULATED data on public descriptions.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass
from functools import partial
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))

import numpy as np
import pinocchio as pin

from tests.support.studies import over, with_jobs
from urdfcal.api import fit
from urdfcal.base.geometry import DEG, MM, Vector
from urdfcal.model.gauge import build_error_model
from urdfcal.model.options import ModelOptions
from urdfcal.output.stored import corrected_robot
from urdfcal.robot.packages import resolve_uri
from urdfcal.robot.robot import Robot, load_robot
from urdfcal.simulation.readings import ReadingNoise, simulate_readings
from urdfcal.simulation.setup import parse_sensors, seen_with, simulated_setup

ROBOTS = {
    "TIAGo, head and arm": ("tiago_description/robots/tiago.urdf", "head_2_link", "arm_tool_link"),
    "TIAGo dual, head and left arm": ("tiago_description/robots/tiago_dual.urdf", "head_2_link", "arm_left_tool_link"),
    "TALOS, head and left arm": ("talos_data/robots/talos_reduced.urdf", "head_2_link", "wrist_left_ft_tool_link"),
    "TALOS, both arms": ("talos_data/robots/talos_reduced.urdf", "wrist_right_ft_tool_link", "wrist_left_ft_tool_link"),
    "PR2, head and right arm": ("pr2_description/urdf/pr2.urdf", "head_tilt_link", "r_gripper_tool_frame"),
    "Baxter, both arms": ("baxter_description/urdf/baxter.urdf", "right_hand_camera_link", "left_hand_camera_link"),
    "G1, both arms": ("g1_description/urdf/g1_29dof_rev_1_0.urdf", "right_wrist_yaw_link", "left_wrist_yaw_link"),
    "iCub, both arms": ("icub_description/robots/icub_reduced.urdf", "r_hand_dh_frame", "l_hand_dh_frame"),
    "Romeo, both arms": ("romeo_description/urdf/romeo_small.urdf", "r_wrist", "l_wrist"),
}
NOISE = ReadingNoise(length=0.1 * MM, angle=0.02 * DEG)
SIZE = {"m": 2 * MM, "rad": 0.2 * DEG}
MODELS = ("auto", "placement")


@dataclass(frozen=True)
class Ways:
    """Which frames are compared: from the link where the branches part to either end, and from end to end."""

    parting: str
    one: str
    other: str

    def distances(self, true: Robot, tried: Robot, configurations: list[Vector]) -> np.ndarray:
        """RMS over configurations of the error in position, (3,), [mm]: parting to the one, to the other, from one to the other."""
        ways = ((self.parting, self.one), (self.parting, self.other), (self.one, self.other))
        off = np.zeros((len(configurations), len(ways)))
        for row, q in enumerate(configurations):
            places = [links_at(robot, q) for robot in (true, tried)]
            for column, (start, end) in enumerate(ways):
                relative = [place[start].actInv(place[end]).translation for place in places]
                off[row, column] = np.linalg.norm(relative[0] - relative[1])
        return np.asarray(np.sqrt(np.mean(off**2, axis=0)) / MM)


def links_at(robot: Robot, q: Vector) -> dict[str, pin.SE3]:
    """Where every link is in the root."""
    model = robot.model
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    return {frame.name: data.oMf[number] for number, frame in enumerate(model.frames) if frame.type == pin.FrameType.BODY}


def anywhere(robot: Robot, rng: np.random.Generator) -> Vector:
    """A configuration within the limits of joints that have some."""
    lower, upper = (np.clip(limit, -2.0, 2.0) for limit in (robot.model.lowerPositionLimit, robot.model.upperPositionLimit))
    return np.asarray(rng.uniform(np.minimum(lower, upper), np.maximum(lower, upper)))


def study(robot: Robot, one: str, other: str, poses: int, seed: int) -> dict[str, np.ndarray]:
    """Distances with the nominal robot, and with those that each error model calibrates."""
    rng = np.random.default_rng(seed)
    sensors, _ = parse_sensors([f"pose:{other}"], robot, 0)
    seen = seen_with(robot, sensors, one)
    every = build_error_model(seen.chain, seen.rig, ModelOptions(error_model="placement"))
    x = np.array([rng.normal(0, SIZE[parameter.unit]) for parameter in every.parameters])
    setup = simulated_setup(seen, every, x, sensors, rng)
    data = simulate_readings(setup, poses, rng, NOISE)
    parting = next(step.joint.parent for step in seen.chain.moving if step.forward)
    ways, configurations = Ways(parting, one, other), [anywhere(robot, rng) for _ in range(100)]
    true = corrected_robot(robot, setup.errors.corrected_origins(setup.x))
    tried = {"nominal": robot}
    for model in MODELS:
        found = fit(seen, data, error_model=model, evidence=False, priors={})
        tried[model] = corrected_robot(robot, found.errors.corrected_origins(found.x))
    return {name: ways.distances(true, candidate, configurations) for name, candidate in tried.items()}


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--poses", type=int, default=60)
    with_jobs(parser)
    arguments = parser.parse_args()
    print(
        f"{arguments.poses} poses, median of {arguments.seeds} truths, RMS in mm: the parting link to one end / to the other / end to end"
    )
    for title, (path, one, other) in ROBOTS.items():
        robot = load_robot(resolve_uri(f"package://{path}"))
        runs = over(partial(study, robot, one, other, arguments.poses), range(arguments.seeds), arguments)
        medians = {name: np.median([run[name] for run in runs], axis=0) for name in runs[0]}
        worst = max(float((run["auto"] / run["placement"]).max()) for run in runs)
        harm = max(float((run["auto"] / run["nominal"]).max()) for run in runs)
        columns = "   ".join(f"{name} {' / '.join(f'{value:.2f}' for value in values)}" for name, values in medians.items())
        print(f"{title:30} {columns}   worst auto/placement {worst:.2f}, auto/nominal {harm:.2f}", flush=True)


if __name__ == "__main__":
    main()
