"""figaroh on the same rows: held-out errors and time of its calibration beside urdfcal's, on two real robots.

    python3 -m venv figaroh_venv && figaroh_venv/bin/pip install figaroh==1.0.2
    python tests/benchmarks/figaroh_rival.py figaroh_venv/bin/python [--data DIR] [--method NAME ...] [--set NAME ...]

figaroh runs in an environment of its own and reads the same poses as its own CSV (`x1, y1, z1`, joint names). It calibrates six numbers
a joint (`full_params`) with its default selection of parameters (`structural`) or, on request, with its priors of 1 mm and 2 mrad (`map`,
one to two minutes a fit) or with those scaled by cross-validation (`map_cv`, longer still). Base and tool frame are estimated, started
by its own closed form. Its cost is its default one; of whole poses, position and orientation weigh as the noise that urdfcal finds
(0.3 mm, 0.6 mrad). Outliers stay in on both sides. Errors are distances on the test poses of the repeatable splits of `real_robots.py`.
Times are CPU seconds from the URDF in memory to the parameters; figaroh's include reading the CSV, urdfcal's do not.
"""

from __future__ import annotations

import argparse
import csv
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

ROOT = Path(__file__).parents[2]
METHODS = ("structural", "map", "map_cv")
TARGETS = {"talos_left_arm": "arm_left_7_link", "ur10_leica": "tool0"}
NOISE = {"position": 0.3e-3, "orientation": 0.6e-3}


def main() -> None:
    """Print the table as Markdown."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("python", type=Path, help="interpreter of the environment that figaroh is installed in")
    parser.add_argument("--data", type=Path, default=ROOT.parent / "shared" / "data")
    parser.add_argument("--method", nargs="+", default=list(METHODS[:1]), choices=METHODS)
    parser.add_argument("--set", nargs="+", default=list(TARGETS), choices=list(TARGETS))
    parser.add_argument("--simulated", nargs="+", type=int, metavar="N", help="instead, times of so many simulated points on a Panda")
    arguments = parser.parse_args()
    if arguments.simulated:
        for poses in arguments.simulated:
            simulated(arguments.python, poses)
        return
    print("| set | split | trained | tested | tool | RMS mm | mean mm | 95 % mm | max mm | CPU s a fit |\n|" + "---|" * 10)
    for folder in arguments.set:
        for name, jobs in splits(folder, arguments.data).items():
            for tool in ("urdfcal", *arguments.method):
                runs = [run(arguments.python, TARGETS[folder], tool, *job) for job in jobs]
                sizes = str(len(jobs[0][1])), str(len(jobs[0][2]))
                print(
                    "| " + " | ".join([folder, name, *sizes, tool if tool == "urdfcal" else f"figaroh {tool}", *cells(runs)]) + " |",
                    flush=True,
                )


def simulated(python: Path, poses: int) -> None:
    """Print what the points of `engine.py` cost either; ours in the middle of seven fits."""
    from tests.benchmarks.engine import measured

    robot, data = measured("points", poses)
    (off, ours), (other_off, other) = with_urdfcal(robot, data, data), with_figaroh(python, "panda_link8", "structural", robot, data, data)
    ours = float(np.median([with_urdfcal(robot, data, data)[1] for _ in range(7)]))
    rms = (np.sqrt(np.mean(mm**2)) for mm in (off, other_off))
    print(
        f"{poses} points: RMS left {' and '.join(f'{own:.3f}' for own in rms)} mm; {ours:.4f} and {other:.2f} s: {other / ours:.0f} times"
    )


def run(python: Path, target: str, tool: str, robot: Any, train: Any, test: Any) -> tuple[Any, float]:
    """Distances on the test poses [mm] and CPU seconds of one tool."""
    return with_urdfcal(robot, train, test) if tool == "urdfcal" else with_figaroh(python, target, tool, robot, train, test)


def cells(runs: list[tuple[Any, float]]) -> list[str]:
    """RMS (mean over the splits), mean, 95 % and max of the distances, and the mean time."""
    every = np.concatenate([mm for mm, _ in runs])
    rms = np.mean([np.sqrt(np.mean(mm**2)) for mm, _ in runs])
    numbers = [f"{value:.3f}" for value in (rms, every.mean(), np.quantile(every, 0.95), every.max())]
    return [*numbers, f"{np.mean([seconds for _, seconds in runs]):.2f}"]


def splits(folder: str, data: Path) -> dict[str, list[Any]]:
    """Robot, training and test poses of every repeatable split, by name."""
    from tests.benchmarks.real_robots import ROBOTS, repeatable_splits

    robot = next(robot for robot in ROBOTS if robot.folder == folder)
    nominal, measured = robot.load(data)
    found: dict[str, list[Any]] = {}
    for split in repeatable_splits(robot, measured):
        found.setdefault(split.name, []).append((nominal, robot.part(measured, split.train), robot.part(measured, split.test)))
    return found


def with_urdfcal(robot: Any, train: Any, test: Any) -> tuple[Any, float]:
    """Distances on the test poses [mm] and CPU seconds of the default fit; outliers stay in."""
    import urdfcal
    from urdfcal.calibration.problem import Problem

    began = time.process_time()
    found = urdfcal.fit(robot, train, gated=False)
    seconds = time.process_time() - began
    left = Problem(found.errors, test).linearise(found.x).residual[:, :3]
    return np.linalg.norm(left, axis=1) * 1e3, seconds


def with_figaroh(python: Path, target: str, method: str, robot: Any, train: Any, test: Any) -> tuple[Any, float]:
    """The same by figaroh, in its own interpreter."""
    with tempfile.TemporaryDirectory() as folder:
        here = Path(folder)
        (here / "robot.urdf").write_bytes(robot.description.text)
        for name, data in (("train", train), ("test", test)):
            write_figaroh_csv(here / f"{name}.csv", data)
        (here / "config.yaml").write_text(json.dumps(figaroh_config(here, target, method, train)), encoding="utf-8")
        env = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}
        env.pop("PYTHONPATH", None)
        words = [str(python), __file__, "--in-figaroh", folder]
        done = subprocess.run(words, env=env, capture_output=True, text=True, check=False)
        if done.returncode:
            raise SystemExit(f"figaroh failed:\n{done.stderr[-3000:]}")
        answer = json.loads(done.stdout.splitlines()[-1])
        return np.array(answer["mm"]), float(answer["seconds"])


def write_figaroh_csv(path: Path, data: Any) -> None:
    """Poses with figaroh's columns: x1, y1, z1, of whole poses phix1, phiy1, phiz1 (roll, pitch, yaw), and the joints."""
    import pinocchio as pin

    point, *turned = data.readings
    columns = [point.values]
    names = ["x1", "y1", "z1"]
    if turned:
        columns.append(np.array([pin.rpy.matrixToRpy(pin.Quaternion(quaternion).matrix()) for quaternion in turned[0].values]))
        names += ["phix1", "phiy1", "phiz1"]
    with path.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream)
        writer.writerow([*names, *data.joints])
        writer.writerows(np.column_stack([*columns, data.q]).tolist())


def figaroh_config(folder: Path, target: str, method: str, data: Any) -> dict[str, Any]:
    """figaroh's unified configuration; JSON is YAML, too."""
    whole = len(data.readings) > 1
    return {
        "robot": {"name": "robot", "properties": {"joints": {"active_joints": list(data.joints)}}},
        "tasks": {
            "calibration": {
                "enabled": True,
                "kinematics": {"base_frame": "universe", "tool_frame": target},
                "measurements": {
                    "markers": [{"name": "marker", "measurable_dof": [True] * 3 + [whole] * 3}],
                    "poses": {"base_pose": [0.0] * 6, "tool_pose": [0.0] * 6},
                },
                "parameters": {
                    "calibration_level": "full_params",
                    "include_non_geometric": False,
                    "outlier_threshold": 3.0,
                    "estimation": {"method": method},
                },
                "data": {"source_file": str(folder / "train.csv"), "number_of_samples": len(data)},
            }
        },
    }


def in_figaroh(folder: Path) -> None:
    """What runs in figaroh's environment: calibrate, predict the test poses, print distances and seconds as JSON."""
    import importlib
    import warnings

    warnings.simplefilter("ignore")
    base = importlib.import_module("figaroh.calibration.base_calibration")
    tools = importlib.import_module("figaroh.calibration.calibration_tools")
    loader = importlib.import_module("figaroh.calibration.data_loader")
    pin = importlib.import_module("pinocchio")
    calibration = base.BaseCalibration(bare_robot(pin, folder / "robot.urdf"), str(folder / "config.yaml"))
    config = calibration.calib_config
    config.update(known_baseframe=False, known_tipframe=False, measurement_std=NOISE)
    began = time.process_time()
    calibration.initialize()
    result, _ = calibration.solve_optimisation()
    seconds = time.process_time() - began
    tested = dict(config)
    measured, q = loader.load_data(str(folder / "test.csv"), calibration.model, tested)
    predicted = tools.calc_updated_fkm(calibration.model, calibration.data, result.x, q, tested)
    off = (measured - predicted).reshape(-1, len(q))[:3]
    print(json.dumps({"mm": (np.linalg.norm(off, axis=0) * 1e3).tolist(), "seconds": seconds, "parameters": len(result.x)}))


def bare_robot(pin: Any, urdf: Path) -> Any:
    """What figaroh needs of its `Robot`, without meshes."""
    model = pin.buildModelFromUrdf(str(urdf))

    class Bare:
        """Model, data and neutral configuration."""

        def __init__(self) -> None:
            self.model, self.data, self.q0 = model, model.createData(), pin.neutral(model)

    return Bare()


if __name__ == "__main__":
    if sys.argv[1:2] == ["--in-figaroh"]:
        in_figaroh(Path(sys.argv[2]))
    else:
        sys.path.append(str(ROOT))
        main()
