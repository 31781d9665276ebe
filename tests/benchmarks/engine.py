"""What the default `urdfcal.fit` costs, as ratios taken in one run: to another checkout of urdfcal, and to C++.

    python tests/benchmarks/engine.py [--against CHECKOUT] [--cpp] [--case NAME ...] [--poses N ...] [--runs N]

Points on a Panda (31 parameters), lasers on arm7, poses, two sessions, and the sag of a Panda behind its fit; CPU seconds of one
thread, medians. Every
run of one checkout is followed by one of the other, each in a process of its own that was warmed up before, so that whatever else the
machine does falls on both alike. Beside the times stands by how much the two estimates differ, in their own standard deviations.

`--cpp` builds `gauss_newton.cpp`, plain Gauss-Newton with priors and a covariance on Pinocchio's library, and gives it the same points
or lasers from the same start under the priors that the fit chose. It wants g++ and Eigen's headers (`pip install cmeel-eigen`, or those of
the system) and is left out without them.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

ROOT = Path(__file__).parents[2]
CPP = Path(__file__).with_name("gauss_newton.cpp")
CASES = {
    "points": ("panda", ("point:panda_link8",), ("",)),
    "lasers": ("arm7", ("laser",), ("",)),
    "poses": ("panda", ("pose:panda_link8",), ("",)),
    "sessions": ("ur5", ("point:tool0",), ("monday", "friday")),
    "sag": ("panda", ("point:panda_link8",), ("",)),
}
SIZES = {"points": (60, 600, 6000), "lasers": (60, 600, 6000)}


def main() -> None:
    """Print the table as Markdown."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--against", type=Path, help="another checkout of urdfcal")
    parser.add_argument("--cpp", action="store_true", help="beside plain Gauss-Newton in C++, too")
    parser.add_argument("--case", nargs="+", default=list(CASES), choices=list(CASES))
    parser.add_argument("--poses", nargs="+", type=int, default=None)
    parser.add_argument("--runs", type=int, default=7)
    parser.add_argument("--serve", nargs=2, metavar=("CASE", "POSES"), help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.serve:
        serve(*fit_of(arguments.serve[0], int(arguments.serve[1])))
        return
    checkouts = [ROOT, *([arguments.against] if arguments.against else [])]
    program = built() if arguments.cpp else None
    print("| case | poses | this, CPU ms | other | ratio | estimates differ by, sigma | C++ | ratio | sigma |\n|" + "---|" * 9)
    for case in arguments.case:
        for poses in arguments.poses or SIZES.get(case, (200,)):
            print(row(case, poses, checkouts, arguments.runs, program), flush=True)


def row(case: str, poses: int, checkouts: list[Path], runs: int, program: Path | None) -> str:
    """One line of the table."""
    servers = [started(checkout, case, poses) for checkout in checkouts]
    for server in servers:
        ask(server)  # imports, caches
    with tempfile.TemporaryDirectory() as folder:
        problem = Path(folder) / "problem" if program and case in SIZES else None
        if problem is not None:
            ask(servers[0], str(problem))
        tried = [([ask(server)["seconds"] for server in servers], in_cpp(program, problem)) for _ in range(runs)]
    times = np.median([own for own, _ in tried], axis=0) * 1e3
    found = [ask(server) for server in servers]
    for server in servers:
        server.stdin.close()
        server.wait()
    cells = [case, str(poses), f"{times[0]:.1f}"]
    if len(servers) > 1:
        apart = np.max(np.abs(np.subtract(found[0]["x"], found[1]["x"])) / np.array(found[1]["sigma"]))
        cells += [f"{times[1]:.1f}", f"{times[1] / times[0]:.2f}", f"{apart:.1e}"]
    if problem is not None:
        seconds, x = float(np.median([own[0] for _, own in tried])) * 1e3, tried[0][1][1]
        apart = np.max(np.abs(np.subtract(found[0]["x"], x)) / np.array(found[0]["sigma"]))
        cells += [""] * (3 if len(servers) < 2 else 0) + [f"{seconds:.2f}", f"{times[0] / seconds:.1f}", f"{apart:.1e}"]
    return "| " + " | ".join(cells) + " |"


def started(checkout: Path, case: str, poses: int) -> Any:
    """A process that fits whenever it is asked."""
    environment = os.environ | {"PYTHONPATH": str(checkout)}
    words = [sys.executable, __file__, "--serve", case, str(poses)]
    return subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment)


def built() -> Path | None:
    """The program in C++; None, and why, where it cannot be built."""
    import cmeel

    prefixes = [Path(path) / "cmeel.prefix" for path in (*sys.path, *os.environ.get("EIGEN", "").split(os.pathsep)) if path]
    prefix = Path(cmeel.__file__).parents[1] / "cmeel.prefix"
    eigen = [path for path in (*(each / "include" / "eigen3" for each in prefixes), Path("/usr/include/eigen3")) if path.is_dir()]
    if shutil.which("g++") is None or not eigen or not (prefix / "include" / "pinocchio").is_dir():
        print("without C++: it wants g++, and the headers of Eigen and Pinocchio", file=sys.stderr)
        return None
    program = Path(tempfile.gettempdir()) / f"gauss_newton_{os.getuid()}"
    if not program.exists() or program.stat().st_mtime < CPP.stat().st_mtime:
        limits = ["-DBOOST_MPL_LIMIT_LIST_SIZE=30", "-DBOOST_MPL_LIMIT_VECTOR_SIZE=30", "-DBOOST_MPL_CFG_NO_PREPROCESSED_HEADERS"]
        words = ["g++", "-O3", "-march=native", "-DNDEBUG", "-std=c++17", *limits, f"-I{prefix}/include", f"-I{eigen[0]}", str(CPP)]
        subprocess.run([*words, "-o", str(program), f"-L{prefix}/lib", "-lpinocchio_default", f"-Wl,-rpath,{prefix}/lib"], check=True)
    return program


def in_cpp(program: Path | None, problem: Path | None) -> tuple[float, Any]:
    """Seconds and estimate of a fit in C++; nan where there is none."""
    if program is None or problem is None:
        return np.nan, None
    lines = subprocess.run([str(program), str(problem), "7"], check=True, capture_output=True, text=True).stdout.splitlines()
    return float(lines[0]), np.array(lines[1].split(), dtype=float)


def write_problem(path: Path, found: Any) -> None:
    """What a fit solved at its end, for the program in C++: the chain, its constants, targets, positions, priors and start."""
    from urdfcal.calibration.problem import Problem

    errors, problem = found.errors, Problem(found.errors, found.data)
    walk, chain, p = errors.placements(found.x).walk, errors.chain, len(errors.names)
    spots = found.data.has_spots
    numbers = [[int(spots), walk.moving, -1 if spots else chain.measuring_frame, p, len(found.data)]]
    numbers += [[int(step.joint.prismatic), *step.joint.axis] for step in chain.moving]
    numbers += [[len(walk.stretches)]]
    for own in walk.stretches:
        numbers += [[own.anchor, len(own.factors)], own.end.homogeneous[:3].ravel()]
        numbers += [[column, *screw] for column, screw in own.factors]
    numbers += [[len(walk.moves)], *walk.moves.astype(int), [len(problem.channels)]]
    for channel in problem.channels:
        numbers += [[channel.target, chain.frames[channel.target].depth], channel.values.ravel()]
    numbers += [problem.positions.ravel(), errors.mean, errors.sigma, found.nominal.x]
    path.write_text("\n".join(" ".join(f"{number:.17g}" for number in line) for line in numbers))


def ask(server: Any, problem: str = "") -> dict[str, Any]:
    """One fit: seconds, estimate and standard deviations; what it solved goes into a file on request."""
    print(problem, file=server.stdin, flush=True)
    return dict(json.loads(server.stdout.readline()))


def serve(fit: Callable[[], Any], name: Callable[[Any], dict[str, Any]]) -> None:
    """Fit once for every line that comes in."""
    for line in sys.stdin:
        began = time.process_time()
        found = fit()
        seconds = time.process_time() - began
        if line.strip():
            write_problem(Path(line.strip()), found)
        print(json.dumps({"seconds": seconds, **name(found)}), flush=True)


def fit_of(case: str, poses: int) -> tuple[Callable[[], Any], Callable[[Any], dict[str, Any]]]:
    """The fit of a case, and what is told of it."""
    import urdfcal

    robot, data = measured(case, poses)
    if case == "sag":
        rigid = urdfcal.fit(robot, data)
        return lambda: urdfcal.fit_sag(rigid, folds=0, compare_directions=False), lambda found: told(found.estimate.belief)
    return lambda: urdfcal.fit(robot, data), lambda found: told(found.estimate.belief)


def told(belief: Any) -> dict[str, Any]:
    """An estimate as numbers."""
    return {"x": belief.x.tolist(), "sigma": np.sqrt(np.diag(belief.P)).tolist()}


def measured(case: str, poses: int) -> tuple[Any, Any]:
    """Robot and measurements of a case; the same in every checkout."""
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
    return robot, simulate_readings(setup, poses, rng, ReadingNoise(spot=0.3 * MM, length=0.1 * MM, angle=0.02 * DEG))


if __name__ == "__main__":
    main()
