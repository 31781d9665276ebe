"""What the default `urdfcal.fit` costs, as ratios taken in one run: to another checkout of urdfcal, and to C++.

    python tests/benchmarks/engine.py [--against CHECKOUT] [--cpp] [--case NAME ...] [--poses N ...] [--runs N]

Points on a Panda (31 parameters), lasers on arm7, poses, pixels of 12 targets, two sessions, and the sag of a Panda behind its fit with
its cross-validation; `online`, one update of an online calibrator that holds so many poses, where it does not look at all of them again;
`paper`, so many sweeps of the paper's own filter over 60 poses; `large`, 100 000 poses of lasers; and commands: help, fit, check, dh, the
report and the view of a Panda, imports included. CPU seconds of one thread, medians; behind them the largest memory of the process. Every
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
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
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
    "pixels": ("panda", tuple(f"pixels:panda_link8:{number}" for number in range(12)), ("",)),
    "sessions": ("ur5", ("point:tool0",), ("monday", "friday")),
    "sag": ("panda", ("point:panda_link8",), ("",)),
    "online": ("arm7", ("laser",), ("",)),
    "paper": ("arm7", ("laser",), ("",)),
    "large": ("arm7", ("laser",), ("",)),
}
ARM, PANDA = (str(ROOT / f"robots/{name}/{name}.urdf.xacro") for name in ("arm7", "panda"))
DATA = str(ROOT / "robots/arm7/measurements.csv")
COMMANDS = {
    "help": ("--help",),
    "fit": ("fit", ARM, DATA, "-o", "{folder}/arm7.urdf"),
    "check": ("check", ARM, DATA),
    "dh": ("dh", ARM),
    "report": ("fit", ARM, DATA, "-o", "{folder}/arm7.urdf", "--report", "{folder}/report.html"),
    "view": ("view", PANDA, "--html", "{folder}/panda.html"),
}
SIZES = {"points": (60, 600, 6000), "lasers": (60, 600, 6000), "online": (200,), "paper": (5000,), "large": (100_000,)}
COMPARED = ("points", "lasers")
UPDATES = 20  # of which one run is made


def main() -> None:
    """Print the table as Markdown."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--against", type=Path, help="another checkout of urdfcal")
    parser.add_argument("--cpp", action="store_true", help="beside plain Gauss-Newton in C++, too")
    parser.add_argument("--case", nargs="+", default=[*CASES, *COMMANDS], choices=[*CASES, *COMMANDS])
    parser.add_argument("--poses", nargs="+", type=int, default=None)
    parser.add_argument("--runs", type=int, default=7)
    parser.add_argument("--serve", nargs=2, metavar=("CASE", "POSES"), help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.serve:
        serve(*fit_of(arguments.serve[0], int(arguments.serve[1])))
        return
    checkouts = [ROOT, *([arguments.against] if arguments.against else [])]
    program = built() if arguments.cpp else None
    print(f"load {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores\n")
    print("| case | poses | this, CPU ms | MiB | other | ratio | estimates differ by, sigma | C++ | ratio | sigma |\n|" + "---|" * 10)
    for case in [case for case in arguments.case if case in CASES]:
        for poses in arguments.poses or SIZES.get(case, (200,)):
            print(row(case, poses, checkouts, arguments.runs, program), flush=True)
    for case in [case for case in arguments.case if case in COMMANDS]:
        print(command_row(case, checkouts, arguments.runs), flush=True)


def command_row(case: str, checkouts: list[Path], runs: int) -> str:
    """The same of a command."""
    with tempfile.TemporaryDirectory() as folder:
        words = [word.format(folder=folder) for word in COMMANDS[case]]
        tried = [[seconds_of(checkout, words, folder) for checkout in checkouts] for _ in range(runs + 1)][1:]
    times = np.median(tried, axis=0) * 1e3
    cells = [f"`{case}`", "", f"{times[0]:.0f}", ""] + ([f"{times[1]:.0f}", f"{times[1] / times[0]:.2f}"] if len(times) > 1 else [])
    return "| " + " | ".join(cells) + " |"


def seconds_of(checkout: Path, words: list[str], folder: str) -> float:
    """CPU of a command with all processes that it starts; compiled modules are kept in a folder, as after any first run."""
    environment = os.environ | {"PYTHONPATH": str(checkout), "PYTHONPYCACHEPREFIX": f"{folder}/{checkout.name}"}
    environment.pop("PYTHONDONTWRITEBYTECODE", None)
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    options = ["--overwrite"] if "-o" in words else []
    subprocess.run([sys.executable, "-m", "urdfcal", *words, *options], cwd=folder, env=environment, check=True, capture_output=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def row(case: str, poses: int, checkouts: list[Path], runs: int, program: Path | None) -> str:
    """One line of the table."""
    servers = [started(checkout, case, poses) for checkout in checkouts]
    for server in servers:
        ask(server)  # imports, caches
    with tempfile.TemporaryDirectory() as folder:
        problem = Path(folder) / "problem" if program and case in COMPARED else None
        if problem is not None:
            ask(servers[0], str(problem))
        tried = [([ask(server)["seconds"] for server in servers], in_cpp(program, problem)) for _ in range(runs)]
    times = np.median([own for own, _ in tried], axis=0) * 1e3
    found = [ask(server) for server in servers]
    for server in servers:
        server.stdin.close()
        server.wait()
    cells = [case, str(poses), f"{times[0]:.4g}", f"{found[0]['memory']:.0f}"]
    if len(servers) > 1:
        apart = np.max(np.abs(np.subtract(found[0]["x"], found[1]["x"])) / np.array(found[1]["sigma"]))
        cells += [f"{times[1]:.4g}", f"{times[1] / times[0]:.2f}", f"{apart:.1e}"]
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
        seconds = getattr(found, "seconds", time.process_time() - began)
        if line.strip():
            write_problem(Path(line.strip()), found)
        print(
            json.dumps({"seconds": seconds, "memory": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024, **name(found)}), flush=True
        )


def fit_of(case: str, poses: int) -> tuple[Callable[[], Any], Callable[[Any], dict[str, Any]]]:
    """The fit of a case, and what is told of it."""
    import urdfcal

    robot, data = measured(case, poses)
    if case == "sag":
        rigid = urdfcal.fit(robot, data)
        return lambda: urdfcal.fit_sag(rigid), lambda found: told(found.estimate.belief)
    if case == "online":
        return updates(robot, data), lambda found: told(found.state.belief)
    if case == "paper":
        return lambda: sweeps(robot, data, poses), lambda found: told(found.belief)
    return lambda: urdfcal.fit(robot, data), lambda found: told(found.estimate.belief)


@dataclass(frozen=True)
class Updated:
    """Updates one after the other: seconds for one, in the middle of those that look at no other pose again, and the last state."""

    seconds: float
    state: Any


def updates(robot: Any, data: Any) -> Callable[[], Updated]:
    """A calibrator that holds all poses but those that come, again and again as if they were others."""
    import urdfcal
    from urdfcal.base.geometry import MM

    calibrator, held = urdfcal.OnlineCalibrator(robot, spot_sigma=0.3 * MM), len(data) - 9 * UPDATES
    for q, spots in zip(data.q[:held], data.spots[:held], strict=True):
        calibrator.update(q, spots)
    coming = iter(range(held, len(data)))

    def run() -> Updated:
        took = []
        for _, pose in zip(range(UPDATES), coming, strict=False):
            began = time.process_time_ns()
            calibrator.update(data.q[pose], data.spots[pose])
            took += [] if calibrator.state.relinearised else [1e-9 * (time.process_time_ns() - began)]
        return Updated(float(np.median(took)) if took else np.nan, calibrator.state)

    return run


def sweeps(robot: Any, data: Any, count: int) -> Any:
    """The paper's filter, so many sweeps of it."""
    from urdfcal.calibration.problem import Problem
    from urdfcal.estimation.ekf import Belief, paper_schedule
    from urdfcal.estimation.noise import Noise
    from urdfcal.model.gauge import build_error_model
    from urdfcal.model.options import ModelOptions

    errors = build_error_model(robot.chain, robot.rig, ModelOptions(error_model="dh"))
    noise, prior = Noise(1e-3, np.zeros(len(data.joints))), Belief.independent(errors.mean, errors.sigma)
    return paper_schedule(Problem(errors, data).linearise, prior, noise, tolerance=0.0, max_sweeps=count)


def told(belief: Any) -> dict[str, Any]:
    """An estimate as numbers."""
    return {"x": belief.x.tolist(), "sigma": np.sqrt(np.diag(belief.P)).tolist()}


def measured(case: str, poses: int) -> tuple[Any, Any]:
    """Robot and measurements of a case; the same in every checkout."""
    from urdfcal.base.geometry import DEG, MM
    from urdfcal.model.gauge import build_error_model
    from urdfcal.robot.robot import load_robot
    from urdfcal.sensors.camera import Camera
    from urdfcal.simulation.readings import ReadingNoise, simulate_readings
    from urdfcal.simulation.setup import parse_sensors, seen_with, simulated_setup

    name, words, sessions = CASES[case]
    robot = load_robot(ROOT / "robots" / name / f"{name}.urdf.xacro")
    sensors, lasers = parse_sensors(words, robot, 4)
    robot, rng = seen_with(robot, sensors, "", lasers), np.random.default_rng(3)
    errors = build_error_model(robot.chain, robot.rig, sessions=sessions)
    truth = rng.normal(size=len(errors.names)) * np.where(np.array(errors.units) == "m", 1 * MM, 0.1 * DEG)
    lens = Camera((1280, 960), np.array([[1400.0, 0, 640], [0, 1400, 480], [0, 0, 1]]), np.zeros(5)) if case == "pixels" else None
    setup = simulated_setup(robot, errors, truth, sensors, rng, sessions=sessions, camera=lens)
    count = {"online": poses + 9 * UPDATES, "paper": 60}.get(case, poses)
    return robot, simulate_readings(setup, count, rng, ReadingNoise(spot=0.3 * MM, length=0.1 * MM, angle=0.02 * DEG, pixel=0.2))


if __name__ == "__main__":
    main()
