"""What the default `urdfcal.fit` costs, as ratios taken in one run: to another checkout of urdfcal.

    python tests/benchmarks/engine.py [--against CHECKOUT] [--case NAME ...] [--poses N ...] [--runs N]

Points on a Panda (31 parameters), lasers on arm7, poses, pixels, two sessions and sag; CPU seconds of one thread, medians. Every
run of one checkout is followed by one of the other, each in a process of its own that was warmed up before, so that whatever else the
machine does falls on both alike. Beside the times stands by how much the two estimates differ, in their own standard deviations.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

ROOT = Path(__file__).parents[2]
CASES = {
    "points": ("panda", ("point:panda_link8",), ("",)),
    "lasers": ("arm7", ("laser",), ("",)),
    "poses": ("panda", ("pose:panda_link8",), ("",)),
    "pixels": ("panda", ("pixels:panda_link8",), ("",)),
    "sessions": ("ur5", ("point:tool0",), ("monday", "friday")),
    "sag": ("panda", ("point:panda_link8",), ("",)),
}
SIZES = {"points": (60, 600, 6000), "lasers": (60, 600, 6000)}


def main() -> None:
    """Print the table as Markdown."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--against", type=Path, help="another checkout of urdfcal")
    parser.add_argument("--case", nargs="+", default=list(CASES), choices=list(CASES))
    parser.add_argument("--poses", nargs="+", type=int, default=None)
    parser.add_argument("--runs", type=int, default=7)
    parser.add_argument("--serve", nargs=2, metavar=("CASE", "POSES"), help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.serve:
        serve(*fit_of(arguments.serve[0], int(arguments.serve[1])))
        return
    checkouts = [ROOT, *([arguments.against] if arguments.against else [])]
    print("| case | poses | this, CPU ms | other | ratio | estimates differ by, sigma |\n|" + "---|" * 6)
    for case in arguments.case:
        for poses in arguments.poses or SIZES.get(case, (200,)):
            print(row(case, poses, checkouts, arguments.runs), flush=True)


def row(case: str, poses: int, checkouts: list[Path], runs: int) -> str:
    """One line of the table."""
    servers = [started(checkout, case, poses) for checkout in checkouts]
    for server in servers:
        ask(server)  # imports, caches
    times = np.median([[ask(server)["seconds"] for server in servers] for _ in range(runs)], axis=0) * 1e3
    found = [ask(server) for server in servers]
    for server in servers:
        server.stdin.close()
        server.wait()
    cells = [case, str(poses), f"{times[0]:.1f}"]
    if len(servers) > 1:
        apart = np.max(np.abs(np.subtract(found[0]["x"], found[1]["x"])) / np.array(found[1]["sigma"]))
        cells += [f"{times[1]:.1f}", f"{times[1] / times[0]:.2f}", f"{apart:.1e}"]
    return "| " + " | ".join(cells) + " |"


def started(checkout: Path, case: str, poses: int) -> Any:
    """A process that fits whenever it is asked."""
    environment = os.environ | {"PYTHONPATH": str(checkout)}
    words = [sys.executable, __file__, "--serve", case, str(poses)]
    return subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment)


def ask(server: Any) -> dict[str, Any]:
    """One fit: seconds, estimate and standard deviations."""
    print("fit", file=server.stdin, flush=True)
    return dict(json.loads(server.stdout.readline()))


def serve(fit: Callable[[], Any], name: Callable[[Any], dict[str, Any]]) -> None:
    """Fit once for every line that comes in."""
    for _ in sys.stdin:
        began = time.process_time()
        found = fit()
        print(json.dumps({"seconds": time.process_time() - began, **name(found)}), flush=True)


def fit_of(case: str, poses: int) -> tuple[Callable[[], Any], Callable[[Any], dict[str, Any]]]:
    """The fit of a case, and what is told of it."""
    import urdfcal

    robot, data, options = measured(case, poses)
    return lambda: urdfcal.fit(robot, data, **options), lambda found: {"x": found.x.tolist(), "sigma": found.sigma.tolist()}


def measured(case: str, poses: int) -> tuple[Any, Any, dict[str, Any]]:
    """Robot, measurements and options of a case; the same in every checkout."""
    from urdfcal.base.geometry import DEG, MM
    from urdfcal.model.gauge import build_error_model
    from urdfcal.robot.robot import load_robot
    from urdfcal.simulation.readings import ReadingNoise, simulate_readings
    from urdfcal.simulation.setup import parse_sensors, seen_with, simulated_setup

    name, words, sessions = CASES[case]
    robot = load_robot(ROOT / "robots" / name / f"{name}.urdf.xacro")
    sensors, lasers = parse_sensors(words, robot, 4)
    robot, rng = seen_with(robot, sensors, "", lasers), np.random.default_rng(3)
    errors = build_error_model(robot.chain, robot.rig, sessions=sessions)
    truth = rng.normal(size=len(errors.names)) * np.where(np.array(errors.units) == "m", 1 * MM, 0.1 * DEG)
    setup = simulated_setup(robot, errors, truth, sensors, rng, sessions=sessions)
    return robot, simulate_readings(setup, poses, rng, ReadingNoise(spot=0.3 * MM, length=0.1 * MM, angle=0.02 * DEG)), {}


if __name__ == "__main__":
    main()
