"""Poses that figaroh picks, beside those of `plan_poses` and random ones: how far off the tool is after a fit, and is predicted to be.

    python3 -m venv figaroh_venv && figaroh_venv/bin/pip install figaroh==1.0.2
    python -m tests.benchmarks.planned_rival figaroh_venv/bin/python [--robots 20] [--only ROBOT ...] [--select NAME ...]

Pool, truths, noise, fit and errors are those of `planned.py`, points only (figaroh has no lasers): all choose from the same 1500 poses, and
whatever is chosen is read and fitted alike. figaroh runs in an environment of its own and chooses by its own regressor: six numbers a joint
(`full_params`), positions measured, as its example for a UR10 has it. *At the link*: its tool frame is the link that carries the target.
*At the target*: it is told a place on that link where targets of these robots may sit, as a frame in the URDF.

Its selections: *socp*, the D-optimal weights of its `BaseOptimalCalibration`, which takes no number and keeps all poses above 1e-5 (*weigh*
says how many); here the n heaviest. *detmax*, its exchange, n of them from one random start; it may take a pose twice, which is then
measured twice (*different*). *By D* is `plan_poses` with figaroh's criterion. *Own* is what the fits themselves predict. *Over planned*:
the geometric mean, with its standard error, of errors up to a constant over those of the same robots measured at the poses of `plan_poses`.
Seconds are wall and CPU from the robot and the pool in memory to the poses, Jacobians or regressors included, pictures left out.
"""

from __future__ import annotations

import argparse
import importlib
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np

ROOT = Path(__file__).parents[2]
MODULE = "figaroh.optimal.base_optimal_calibration"
CHOSEN = (20, 30)
ERRORS = "own | Gaussian | up to a constant | factory | up to a constant | over planned"
COLUMNS = f"robot | poses | {ERRORS} | different | weigh | wall s | CPU s"


@dataclass(frozen=True)
class Choice:
    """Which rows of the pool in how many seconds, and how many were above the threshold of weights; nothing of it at random."""

    rows: list[int] | None = None
    wall: float = np.nan
    cpu: float = np.nan
    weigh: int | None = None

    @property
    def cells(self) -> list[str]:
        """How many are different, how many weigh, and the times."""
        if self.rows is None:
            return ["–"] * 4
        return [str(len(set(self.rows))), "–" if self.weigh is None else str(self.weigh), f"{self.wall:.1f}", f"{self.cpu:.1f}"]


def main() -> None:
    """Print the table as Markdown, or why there is none."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("python", type=Path, help="interpreter of the environment that figaroh is installed in")
    parser.add_argument("--data", type=Path, default=ROOT.parent / "shared" / "data")
    parser.add_argument("--robots", type=int, default=20, help="how many robots a row (default 20)")
    parser.add_argument("--only", nargs="+", default=["ur5", "panda"], metavar="ROBOT", help="ur5, panda, tiago (default the first two)")
    parser.add_argument("--select", nargs="+", default=list(SELECTIONS), choices=list(SELECTIONS), help="of figaroh (default both)")
    arguments = parser.parse_args()
    if reason := missing(arguments.python):
        print(f"skipped, since figaroh cannot be asked ({reason}): the first lines of this script say how it is installed")
        return
    print(f"| {COLUMNS} |\n|" + "---|" * 12, flush=True)
    for name in arguments.only:
        study(name, arguments)


def missing(python: Path) -> str:
    """Why an interpreter cannot run figaroh's selection, in a line; empty where it can."""
    if not python.is_file():
        return f"there is no interpreter {python}"
    done = subprocess.run([str(python), "-c", f"import {MODULE}"], env=alone(), capture_output=True, text=True, check=False)
    return done.stderr.strip().splitlines()[-1] if done.returncode else ""


def alone() -> dict[str, str]:
    """The environment of the other interpreter: without our packages, and without windows."""
    env = {**os.environ, "MPLBACKEND": "Agg"}
    env.pop("PYTHONPATH", None)
    return env


def study(name: str, arguments: argparse.Namespace) -> None:
    """Print the rows of one robot."""
    from tests.benchmarks.evidence import factory_truths
    from tests.benchmarks.planned_scenes import scene_of
    from urdfcal.planning.plan import plan_poses

    scene = scene_of(name, "point")
    arms = factory_truths(arguments.data) if (arguments.data / "ur_factory").is_dir() else []
    ours = partial(plan_poses, scene.robot, candidates=scene.pool, sensors=scene.asked.sensors, sigmas=scene.sigmas)
    choices = {f"{what} {n}": timed(partial(ours, criterion=by, n=n)) for what, by in OURS.items() for n in CHOSEN}
    choices |= chosen_by_figaroh(arguments, scene, scene.read(scene.truth("Gaussian", 0, arms), scene.pool, 0))
    choices |= {f"random {n}": Choice() for n in CHOSEN}
    trial = Trial(scene, arms, arguments.robots, ours(n=2).tool)
    measured: dict[str, list[np.ndarray]] = {}
    for what, choice in choices.items():
        n = int(what.split()[-1])
        own, *measured[what] = trial.off_mm(n, choice.rows)
        cells = [f"{np.median(each):.3f}" for each in (own, *measured[what])] + ["–"] * (0 if arms else 2)
        times = ratio(measured[what][1::2], measured[f"planned {n}"][1::2])
        print("| " + " | ".join([name, what, *cells, times, *choice.cells]) + " |", flush=True)


@dataclass(frozen=True)
class Trial:
    """Robots with errors, the same for all that is compared, and what of them is to be right."""

    scene: Any
    arms: list[np.ndarray]
    robots: int
    tool: str

    def off_mm(self, n: int, rows: list[int] | None) -> list[np.ndarray]:
        """Each robot's tool: what its fit says itself, and errors in the base and up to a constant for each kind of truth, [mm]."""
        from tests.benchmarks import planned

        found = []
        for kind in ("Gaussian", *(["factory"] if self.arms else [])):
            sets = [planned.at_random(self.scene, seed, n) if rows is None else self.scene.pool[rows] for seed in range(self.robots)]
            truths = [self.scene.truth(kind, seed, self.arms) for seed in range(self.robots)]
            off = [planned.off(self.scene, truth, sets[seed], self.tool, seed) for seed, truth in enumerate(truths)]
            found += list(np.sqrt(np.transpose(off)))
        return [found[planned.OWN], *(each for index, each in enumerate(found) if index % 3 != planned.OWN)]


def ratio(errors: list[np.ndarray], reference: list[np.ndarray]) -> str:
    """The geometric mean of errors over those of the same robots measured at other poses, and its standard error."""
    logs = np.log(np.concatenate(errors) / np.concatenate(reference))
    mean = np.exp(logs.mean())
    return f"{mean:.2f} ± {mean * logs.std(ddof=1) / np.sqrt(len(logs)):.2f}" if logs.any() else "1"


OURS = {"planned": "I", "planned by D": "D"}


def timed(plan: Callable[[], Any]) -> Choice:
    """What `plan_poses` chooses, with its seconds."""
    wall, cpu = time.perf_counter(), time.process_time()
    rows = plan().chosen.tolist()
    return Choice(rows, time.perf_counter() - wall, time.process_time() - cpu)


def chosen_by_figaroh(arguments: argparse.Namespace, scene: Any, data: Any) -> dict[str, Choice]:
    """What figaroh chooses of the positions of some measurements, by what it is called in the table."""
    link, found = target_of(scene)[0], {}
    for where, frame in (("at the link", link), ("at the target", "calibration_target")):
        with tempfile.TemporaryDirectory() as folder:
            (Path(folder) / "robot.urdf").write_bytes(with_target(scene))
            write_job(Path(folder), frame, data, arguments.select)
            words = [str(arguments.python), __file__, "--in-figaroh", folder]
            done = subprocess.run(words, env=alone(), capture_output=True, text=True, check=False)
        if done.returncode:
            raise SystemExit(f"figaroh failed:\n{done.stderr[-3000:]}")
        for what, choice in json.loads(done.stdout.splitlines()[-1]).items():
            selection, _, n = what.partition(" ")
            found[f"figaroh {selection} {where} {n}"] = Choice(**choice)
    return found


def write_job(folder: Path, frame: str, data: Any, selections: list[str]) -> None:
    """The pool and the configuration as figaroh reads them, and what it is to do."""
    from tests.benchmarks.figaroh_rival import figaroh_config

    config = figaroh_config(folder, frame, "structural", data)
    config["tasks"]["calibration"]["data"]["sample_configurations_file"] = str(folder / "pool.yaml")
    pool = {"calibration_joint_names": list(data.joints), "calibration_joint_configurations": data.q.tolist()}
    for name, content in (("config.yaml", config), ("pool.yaml", pool), ("job.json", selections)):
        (folder / name).write_text(json.dumps(content), encoding="utf-8")  # JSON is YAML, too


def target_of(scene: Any) -> tuple[str, Any]:
    """The link that carries the target, and a place on it where targets of such robots may sit, as a placement."""
    slot = next(slot for slot in scene.made.errors.slots if slot.kind == "target")
    return scene.asked.sensors[0].partition(":")[2], next(iter(slot.found.values()))


def with_target(scene: Any) -> bytes:
    """The URDF with a frame at such a place."""
    from urdfcal.base.geometry import xyz_rpy

    link, placement = target_of(scene)
    xyz, rpy = (" ".join(map(str, numbers)) for numbers in xyz_rpy(placement))
    added = (
        '<link name="calibration_target"/><joint name="calibration_target_joint" type="fixed">'
        f'<parent link="{link}"/><child link="calibration_target"/><origin xyz="{xyz}" rpy="{rpy}"/></joint></robot>'
    )
    return bytes(scene.robot.description.text.replace(b"</robot>", added.encode()))


def in_figaroh(folder: Path) -> None:
    """What runs in figaroh's environment: print each choice as JSON."""
    import warnings

    warnings.simplefilter("ignore")
    module, pin = importlib.import_module(MODULE), importlib.import_module("pinocchio")
    robot = importlib.import_module("figaroh_rival").bare_robot(pin, folder / "robot.urdf")
    found: dict[str, Any] = {}
    for selection in json.loads((folder / "job.json").read_text(encoding="utf-8")):
        found |= SELECTIONS[selection](module, type("Design", (module.BaseOptimalCalibration,), {}), robot, str(folder / "config.yaml"))
    print(json.dumps(found))


def by_socp(module: Any, design: Any, robot: Any, config: str) -> dict[str, Any]:
    """The heaviest poses of figaroh's D-optimal weights."""
    wall, cpu = time.perf_counter(), time.process_time()
    made = design(robot, config)
    made.initialize()
    made.calculate_optimal_configurations()
    told = {"wall": time.perf_counter() - wall, "cpu": time.process_time() - cpu, "weigh": made.nb_chosen}
    return {f"socp {n}": {"rows": [int(row) for row in list(made.w_dict_sort)[:n]], **told} for n in CHOSEN}


def by_detmax(module: Any, design: Any, robot: Any, config: str) -> dict[str, Any]:
    """What figaroh's exchange ends with: the set whose determinant it computes last, since it keeps no other record of it."""
    import random

    class Recorded(module.Detmax):  # type: ignore[misc,name-defined]
        """Remembers the last set."""

        last: list[int]

        def get_critD(self, set: list[int]) -> float:
            self.last = [int(row) for row in set]
            return float(super().get_critD(set))

    found = {}
    for n in CHOSEN:
        random.seed(0)
        wall, cpu = time.perf_counter(), time.process_time()
        made = design(robot, config)
        made.initialize()
        exchange = Recorded(made._subX_dict, n)
        exchange.main_algo()
        found[f"detmax {n}"] = {"rows": exchange.last, "wall": time.perf_counter() - wall, "cpu": time.process_time() - cpu}
    return found


SELECTIONS = {"socp": by_socp, "detmax": by_detmax}


if __name__ == "__main__":
    if sys.argv[1:2] == ["--in-figaroh"]:
        in_figaroh(Path(sys.argv[2]))
    else:
        main()
