"""Size of the view's page and time to its first picture, for every robot. The measurements are simulated.

python -m tests.benchmarks.view [--pictures DIR]
"""

from __future__ import annotations

import argparse
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

import urdfcal
from tests.support.browser import Browser, find_browser
from urdfcal.calibration.reach import ScreenArea, draw_poses
from urdfcal.robot.robot import Robot
from urdfcal.sensors.measurements import Measurements
from urdfcal.simulation.readings import SimulatedNoise, simulate
from urdfcal.simulation.truth import random_truth

ROBOTS = ("arm7", "arm4", "panda", "ur5", "tiago")
TRANSLATION, ROTATION, SPOT_NOISE = 5e-3, np.radians(0.5), 5e-4  # [m], [rad], [m]


def simulated(robot: Robot, poses: int, seed: int = 1) -> Measurements:
    """Measurements of a robot with errors in all six directions of every joint."""
    rng = np.random.default_rng(seed)
    errors, truth = random_truth(robot, rng, TRANSLATION, ROTATION)
    q = draw_poses(robot, errors, truth, poses, rng, area=ScreenArea(1.5))
    return replace(simulate(robot, errors, truth, q, rng, SimulatedNoise(SPOT_NOISE)), source="simulated")


def measure(name: str, poses: int, folder: Path, browser: Browser | None, pictures: bool) -> str:
    """One robot; a line of figures."""
    robot = urdfcal.load_robot(f"robots/{name}/{name}.urdf.xacro")
    view = urdfcal.fit(robot, simulated(robot, poses)).show()
    start = time.perf_counter()
    view.write_html(folder / f"{name}.html")
    line = f"{name:6s} page {(folder / f'{name}.html').stat().st_size / 1e6:.1f} MB, made in {time.perf_counter() - start:.1f} s"
    if browser is None:
        return line + "; no chromium here"
    ready = browser.open(folder / f"{name}.html")
    browser.picture(folder / f"{name}.png" if pictures else None)
    return line + f", first picture after {ready:.1f} s"


def main() -> None:
    """Parse the command line and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--poses", type=int, default=40, help="how many poses (default 40)")
    parser.add_argument("--pictures", type=Path, help="keep pages and pictures in this folder")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        folder = arguments.pictures or Path(scratch)
        folder.mkdir(exist_ok=True)
        browser = Browser(1400, 850) if find_browser() else None
        for name in ROBOTS:
            print(measure(name, arguments.poses, folder, browser, arguments.pictures is not None), flush=True)
        if browser is not None:
            browser.close()


if __name__ == "__main__":
    main()
