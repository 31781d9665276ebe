"""Many robots at once: how fast, how well shared, what is left after a kill, and what the fleet's prior is worth. Everything is simulated.

    python tests/benchmarks/fleet.py [--robots N] [--poses N] [--factory] [--data DIR]

UR5s with random errors (1 mm, 0.1 deg in six directions of every joint), read by a tracker to 0.1 mm. One process and two fit the same
robots in turn; wall-clock seconds, and processor seconds a robot. Then the run with two processes is killed (-9) half-way and run again.

`--factory`: truths are what a maker wrote for 15 arms (ur_factory in DIR: joint frames against nominal); each is read at 10 poses to
0.1 mm, which is stated. For each arm in turn the prior is that of the 14 others; beside the fit with its own priors alone stands the
one with it: RMS distance of the tool, up to a constant, over the workspace.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).parents[2]))

import numpy as np

import urdfcal
from tests.benchmarks.evidence import SIX, factory_truths
from urdfcal.fleet.likelihood import Likelihood
from urdfcal.fleet.prior import fleet_prior
from urdfcal.model.options import ModelOptions, ParameterPrior
from urdfcal.model.parameters import PriorScale

ROOT = Path(__file__).parents[2]
UR5 = ROOT / "robots" / "ur5" / "ur5.urdf.xacro"
ENVIRONMENT = os.environ | {"PYTHONPATH": str(ROOT)}
NOISE = {"point": 1e-4}
JOINTS = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")


def main() -> None:
    """Print what was measured."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--robots", type=int, default=200)
    parser.add_argument("--poses", type=int, default=60)
    parser.add_argument("--factory", action="store_true")
    parser.add_argument("--data", type=Path, default=ROOT.parent / "shared" / "data")
    arguments = parser.parse_args()
    if arguments.factory:
        factory(arguments.data)
        return
    with tempfile.TemporaryDirectory() as folder:
        shared(Path(folder), arguments.robots, arguments.poses)


def shared(folder: Path, robots: int, poses: int) -> None:
    """One process, two, and two after a kill."""
    words = ("-o", folder / "made", "--robots", robots, "--poses", poses, "--sensor", "point:tool0", "--errors", "1mm,0.1deg", "-q")
    subprocess.run([sys.executable, "-m", "urdfcal", "simulate", *map(str, (UR5, *words))], env=ENVIRONMENT, check=True)
    times = {}
    for workers in (1, 2):
        times[workers] = wall(folder, workers)
        told = json.loads((folder / "told.json").read_text())
        seconds = np.array([row["seconds"] for row in told["robots"]])
        usable = sum(row["use"] == "yes" for row in told["robots"])
        print(
            f"{workers} processes: {times[workers]:.1f} s, {np.median(seconds):.3f} s of cpu a robot (median), {usable} of {robots} usable"
        )
    print(f"two over one: {times[1] / times[2]:.2f} times as fast")
    shutil.rmtree(folder / "out2")
    process = started(folder, 2)
    time.sleep(times[2] / 2)
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    done = len(list((folder / "out2").glob("*/result.json")))
    again = wall(folder, 2)
    kept = json.loads((folder / "told.json").read_text())["kept"]
    print(f"killed half-way: {done} done, {kept} of them kept, the rest in {again:.1f} s")


def started(folder: Path, workers: int) -> subprocess.Popen[bytes]:
    """The command, as a group of processes."""
    words = ["-m", "urdfcal", "fleet", "made/manifest.csv", "-o", f"out{workers}", "--workers", str(workers), "--json", "-q"]
    with (folder / "told.json").open("wb") as out:
        return subprocess.Popen([sys.executable, *words], cwd=folder, stdout=out, env=ENVIRONMENT, start_new_session=True)


def wall(folder: Path, workers: int) -> float:
    """Seconds that it takes."""
    began = time.perf_counter()
    started(folder, workers).wait()
    return time.perf_counter() - began


def factory(data: Path) -> None:
    """Every arm with its own priors alone, and with that of the 14 others."""
    nominal, arms = urdfcal.load_robot(UR5), factory_truths(data)
    names = [f"{joint}_joint.{part}" for joint in JOINTS for part in SIX]
    made, fits = [], []
    for seed, arm in enumerate(arms):
        errors = dict(zip(names, arm.tolist(), strict=True))
        made.append(urdfcal.simulate(nominal, 10, sensors=["point:tool0"], errors=errors, length_noise=1e-4, seed=seed))
        fits.append(urdfcal.fit(made[-1].nominal, made[-1].measurements, sigmas=NOISE))
    told = [likelihood(fit) for fit in fits]
    rows = []
    for number, (own, simulation) in enumerate(zip(fits, made, strict=True)):
        prior = fleet_prior({str(other): each for other, each in enumerate(told) if other != number})
        assert prior is not None
        scale = PriorScale(prior.scales["translation"], prior.scales["rotation"], prior.scales["zero"])
        single = {each.name: ParameterPrior(mean=each.value) for each in prior.shared}
        options = ModelOptions(priors={"joint": scale}, single=single)
        shared_prior = urdfcal.fit(simulation.nominal, simulation.measurements, sigmas=NOISE, options=options)
        rows.append([off(simulation, simulation.nominal), off(simulation, own), off(simulation, shared_prior)])
        print(f"arm {number}: nominal {rows[-1][0]:.3f}, own prior {rows[-1][1]:.3f}, the others' {rows[-1][2]:.3f} mm", flush=True)
    print({name: f"{scale:.2e}" for name, scale in prior.scales.items()}, [f"{each.name} {each.value:.2e}" for each in prior.shared])
    rms = np.sqrt(np.mean(np.square(rows), axis=0))
    print(f"RMS over {len(rows)} arms: {rms[0]:.3f}, {rms[1]:.3f}, {rms[2]:.3f} mm; {1 - rms[2] / rms[1]:.0%} less than the own prior's")


def likelihood(fit: Any) -> Likelihood:
    """What an arm's data say of its joints."""
    joints = [index for index, parameter in enumerate(fit.errors.parameters) if parameter.kind == "joint"]
    names, units = ([told[index] for index in joints] for told in (fit.errors.names, fit.errors.units))
    return Likelihood.of(names, units, fit.x[joints], fit.covariance[np.ix_(joints, joints)], fit.errors.sigma[joints])


def off(simulation: Any, other: Any) -> float:
    """RMS distance of the tool from the true robot's, up to a constant, [mm]."""
    return float(np.sqrt(np.mean(urdfcal.compare(simulation.robot, other, tool="tool0").at_tool.apart ** 2)) * 1e3)


if __name__ == "__main__":
    main()
