"""Panda, UR5 and TIAGo with random errors on every joint: how well do spots and module agree with the truth afterwards?

The truth is a URDF with other origins, its spots come from yourdfpy; the answer is the URDF that `write_urdf` wrote, read back by
yourdfpy. So the whole line is held against a witness that shares no code with it. Poses that were fitted are not tested.
A last table: a Panda that is perfect but for its screen must get its joints back unmoved.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation
from second_witness import DEG, MM, link_poses, moved_urdf, observations_of, random_delta, transform

import urdfcal
from tests.support.studies import over, with_jobs
from urdfcal.calibration.reach import draw_poses
from urdfcal.simulation.truth import random_truth

Array = npt.NDArray[np.float64]

CASES = (("panda", "auto"), ("ur5", "auto"), ("ur5", "hayati"), ("ur5", "dh"), ("tiago", "auto"))
TRANSLATION, ROTATION, SPOT_NOISE = 5 * MM, 0.5 * DEG, 0.5 * MM
SCREEN_SIZE, LEAST_ZX = 3.0, 0.3
FIT, TEST = 100, 200


@dataclass(frozen=True)
class Views:
    """What yourdfpy says of one URDF at some poses: T_screen_module (n, 4, 4), spots and lengths of the beams, |zx|."""

    module: Array
    spots: Array
    lengths: Array
    zx: Array

    @property
    def on_screen(self) -> Array:
        """Poses at which every beam makes a spot on the screen, (n,)."""
        good = (self.lengths > 0) & (self.zx > LEAST_ZX) & (np.abs(self.spots) < SCREEN_SIZE / 2).all(axis=-1)
        return good.all(axis=1)


def look(robot: urdfcal.Robot, text: bytes, q: Array) -> Views:
    """Ask yourdfpy where module and spots are."""
    links = [robot.rig.tip, *robot.rig.lasers]
    poses = link_poses(text, robot.chain.input_names, q, robot.rig.base, links)
    spots, lengths = observations_of(poses[:, 1:])
    return Views(poses[:, 0], spots, lengths, np.abs(poses[:, 1:, 0, 2]))


def poses_on_screen(robot: urdfcal.Robot, truth: bytes, count: int, rng: np.random.Generator) -> Array:
    """Joint positions at which nominal and true robot have their spots on the screen."""
    errors, x = random_truth(robot, rng, 0.0, 0.0)
    q = draw_poses(robot, errors, x, count + count // 2 + 50, rng)
    return q[look(robot, truth, q).on_screen][:count]


def wrong_robot(robot: urdfcal.Robot, rng: np.random.Generator) -> bytes:
    """The robot's URDF with Gaussian errors on its joints, mount and screen."""
    names = [step.joint.name for step in robot.chain.moving] + [robot.chain.mount_joint.name, robot.chain.screen_joint.joint.name]
    return moved_urdf(robot.description.text, {name: random_delta(rng, TRANSLATION, ROTATION) for name in names})


def written(calibration: urdfcal.Calibration) -> bytes:
    """The calibrated URDF as it stands on the disk."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "calibrated.urdf"
        calibration.write_urdf(path)
        return path.read_bytes()


def measured(robot: urdfcal.Robot, truth: bytes, q: Array, noise: float, rng: np.random.Generator) -> urdfcal.Measurements:
    """Noisy measurements of the true robot."""
    spots = look(robot, truth, q).spots
    return urdfcal.measurements_from(robot, q, spots + rng.normal(0, noise, spots.shape))


def differences(found: Views, true: Views) -> Array:
    """Mean distance of the spots [mm], mean distance of the module [mm], mean angle of the module [deg]."""
    spots = np.linalg.norm(found.spots - true.spots, axis=-1).mean() / MM
    off = np.linalg.inv(true.module) @ found.module
    angle = Rotation.from_matrix(off[:, :3, :3]).magnitude().mean() / DEG
    return np.array([spots, np.linalg.norm(off[:, :3, 3], axis=1).mean() / MM, angle])


def calibrate(robot: urdfcal.Robot, model: str, seed: int) -> tuple[Array, Array, Array]:
    """Differences from the truth on unseen poses, before and after; and whether the fit may be trusted."""
    rng = np.random.default_rng(seed)
    truth = wrong_robot(robot, rng)
    q = poses_on_screen(robot, truth, FIT + TEST, rng)
    calibration = urdfcal.fit(robot, measured(robot, truth, q[:FIT], SPOT_NOISE, rng), error_model=model)
    true = look(robot, truth, q[FIT:])
    before, after = (differences(look(robot, text, q[FIT:]), true) for text in (robot.description.text, written(calibration)))
    return before, after, np.full(3, not calibration.rejection)


def moved_origins(robot: urdfcal.Robot, noise: float, seed: int) -> Array:
    """A perfect robot whose screen is 50 mm and 2 deg off: how far did its joints move, and how far is its screen still off?

    Returns:
        Largest correction of a joint's origin [mm, mrad], what is left of the screen's error [mm, mrad], and the largest joint
        parameter over its claimed sigma, (5,).
    """
    rng = np.random.default_rng(seed)
    direction, axis = (vector / np.linalg.norm(vector) for vector in rng.normal(size=(2, 3)))
    delta = transform(50 * MM * direction, Rotation.from_rotvec(2 * DEG * axis))
    screen = robot.chain.screen_joint.joint.name
    truth = moved_urdf(robot.description.text, {screen: delta})
    q = poses_on_screen(robot, truth, FIT, rng)
    calibration = urdfcal.fit(robot, measured(robot, truth, q, noise, rng))
    corrections = calibration.corrections
    joints = [sizes(correction.delta.homogeneous) for correction in corrections.values() if correction.moving]
    left = sizes(np.linalg.inv(delta) @ corrections[screen].delta.homogeneous)
    of_joint = [parameter.kind == "joint" for parameter in calibration.errors.parameters]
    return np.array([*np.max(joints, axis=0), *left, np.max(np.abs(calibration.x / calibration.sigma)[of_joint])])


def sizes(delta: Array) -> tuple[float, float]:
    """Length [mm] and angle [mrad] of a small motion."""
    return float(np.linalg.norm(delta[:3, 3]) / MM), float(Rotation.from_matrix(delta[:3, :3]).magnitude() * 1e3)


def rows(arguments: argparse.Namespace) -> Iterator[str]:
    """The main table, one robot and error model a row."""
    yield f"{'robot':7s}{'model':8s}{'spots before':>13s}{'after':>11s}{'worst':>11s} | {'module before':>19s}{'after':>22s} | accepted"
    for name, model in CASES:
        robot = urdfcal.load_robot(arguments.robots / name / f"{name}.urdf.xacro")
        runs = np.array(over(partial(calibrate, robot, model), range(arguments.seeds), arguments))  # (seeds, before after accepted, 3)
        (before, mm0, deg0), (after, mm1, deg1), (accepted, *_) = runs.mean(axis=0)
        agreed = f"{accepted * len(runs):.0f} of {len(runs)}"
        spots = f"{before:10.2f} mm{after:8.3f} mm{runs[:, 1, 0].max():8.3f} mm"
        yield f"{name:7s}{model:8s}{spots} | {mm0:7.2f} mm {deg0:4.2f} deg{mm1:9.3f} mm {deg1:6.4f} deg | {agreed}"


def main() -> None:
    """Parse the command line and run the study."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=5, help="how many seeds (default 5)")
    parser.add_argument("--robots", type=Path, default=Path("robots"), help="folder of the robots (default robots)")
    with_jobs(parser)
    arguments = parser.parse_args()
    start = time.perf_counter()
    for row in rows(arguments):
        print(row, flush=True)
    panda = urdfcal.load_robot(arguments.robots / "panda" / "panda.urdf.xacro")
    print("\nperfect Panda, screen 50 mm and 2 deg off; worst of all seeds")
    for noise in (SPOT_NOISE, 0.0):
        mm, mrad, screen_mm, screen_mrad, sigmas = np.max(
            over(partial(moved_origins, panda, noise), range(arguments.seeds), arguments), axis=0
        )
        moved, left = f"{mm:.2g} mm, {mrad:.2g} mrad ({sigmas:.2g} sigma)", f"{screen_mm:.2g} mm, {screen_mrad:.2g} mrad"
        print(f"spot noise {noise / MM:.1f} mm: joint origins moved by at most {moved}; screen still off by {left}")
    print(f"{arguments.seeds} seeds, {time.perf_counter() - start:.0f} s")


if __name__ == "__main__":
    main()
