"""Held-out errors on measurements of four real robots, by error model, prior and number of training poses.

    python tests/benchmarks/real_robots.py [--data DIR] [--set NAME ...] [--splits N] [--options NAME ...]

DIR holds one folder a robot with its `measurements.csv` (`robots/README.md` says where they come from); the default is `shared/data`
beside this project. Every figure is of poses that were not fitted. Per pose and target the error is the distance from where the
calibrated robot has the target to where it was measured, in mm, and the angle between both orientations, in deg. Balls in sockets are
measured nowhere: their error is the distance from the mean of their socket over the tested poses (*consistency*), and all sockets that
are tested stand at places that were left out of the fit. `nominal` is the robot of the URDF; its measuring frame and target are placed
by least squares on the training poses as well.

*Random* splits draw the training poses; at most 300 of the others are tested. *Repeatable* ones are those anyone can make again: the
first n rows train and the last 300 test (UR10), row mod 3 or mod 5 (FR3, TALOS), places in front or in the back (sockets). `reference`
is a plain ridge-regularised fit of six numbers a joint on random splits of the same sizes.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
import numpy.typing as npt

import urdfcal
from urdfcal.base.geometry import DEG, MM
from urdfcal.calibration.analysis.sag import fit_sag
from urdfcal.calibration.problem import Problem
from urdfcal.calibration.start.nominal import with_new_places
from urdfcal.robot.packages import find_package
from urdfcal.sensors.readings import known_lengths

Array = npt.NDArray[np.float64]
Rows = npt.NDArray[np.intp]

ROOT = Path(__file__).parents[2]
SIZES = (30, 60, 100, 200)
MOST_TESTED = 300
OPTIONS: dict[str, dict[str, Any]] = {
    "default": {},
    "hayati": {"error_model": "hayati"},
    "placement": {"error_model": "placement"},
    "dh": {"error_model": "dh"},
    "offset": {"error_model": "offset"},
    "auto, 10 mm 1 deg": {"evidence": False},
    "placement, 10 mm 1 deg": {"error_model": "placement", "evidence": False},
    "auto, no gate": {"gated": False},
}
SAG = "default, with sag"


@dataclass(frozen=True)
class Split:
    """Which rows train and which test.

    Attributes:
        name: What tables call it; splits of one name are averaged.
        train, test: Row numbers.
    """

    name: str
    train: Rows
    test: Rows


@dataclass(frozen=True)
class RealRobot:
    """One data set.

    Attributes:
        folder: Of the data.
        urdf: Within example-robot-data.
        reference: Held-out RMS of a plain ridge-regularised fit of six numbers a joint, by name of the repeatable split, [mm].
        distances: Known distances between sockets, by pattern, [m].
    """

    folder: str
    urdf: str
    reference: dict[str, float]
    distances: tuple[tuple[str, float], ...] = ()

    def load(self, data: Path) -> tuple[urdfcal.Robot, urdfcal.Measurements]:
        """The nominal robot and all of its measurements."""
        robot = urdfcal.load_robot(find_package("example-robot-data") / "robots" / self.urdf)
        return robot, self.with_distances(urdfcal.read_measurements(data / self.folder / "measurements.csv", robot))

    def part(self, data: urdfcal.Measurements, rows: Rows) -> urdfcal.Measurements:
        """Some of the poses, with the known distances between the sockets that are left."""
        return self.with_distances(data.subset(rows))

    def with_distances(self, data: urdfcal.Measurements) -> urdfcal.Measurements:
        """The same measurements with the known distances."""
        return replace(data, lengths=known_lengths(self.distances, data.readings)) if self.distances else data


ROBOTS = (
    RealRobot("ur10_leica", "ur_description/urdf/ur10_robot.urdf", {"first 60": 0.53, "first 200": 0.50}),
    RealRobot("fr3_camera_board", "panda_description/urdf/panda.urdf", {"row mod 3": (2.29 + 1.40 + 1.50) / 3}),
    RealRobot("talos_left_arm", "talos_data/robots/talos_reduced.urdf", {"row mod 5": 1.01}),
    RealRobot("panda_sockets", "panda_description/urdf/panda.urdf", {"front trains": 0.23, "back trains": 0.23}, (("*/0 - */1", 50 * MM),)),
)


def places_of(data: urdfcal.Measurements) -> npt.NDArray[np.str_]:
    """The place of each pose's socket, (n,): what stands before the `/` of its label."""
    return np.array([str(label).split("/")[0] for label in data.readings[0].labels])


def repeatable_splits(robot: RealRobot, data: urdfcal.Measurements) -> Iterator[Split]:
    """The splits that anyone can make again."""
    rows = np.arange(len(data))
    if robot.folder == "ur10_leica":
        for size in SIZES:
            yield Split(f"first {size}", rows[:size], rows[-MOST_TESTED:])
    elif robot.folder == "panda_sockets":
        front = np.char.startswith(places_of(data), "front")
        yield Split("front trains", rows[front], rows[~front])
        yield Split("back trains", rows[~front], rows[front])
    else:
        folds = 3 if robot.folder == "fr3_camera_board" else 5
        for fold in range(folds):
            yield Split(f"row mod {folds}", rows[rows % folds != fold], rows[rows % folds == fold])


def random_splits(data: urdfcal.Measurements, count: int) -> Iterator[Split]:
    """Random ones of every size that leaves something to test; of sockets, three places train and the others test."""
    for size in SIZES:
        for seed in range(count):
            rng = np.random.default_rng([seed, size])
            order = rng.permutation(len(data))
            if data.readings[0].sensor == "socket":
                names = places_of(data)
                trains = np.isin(names, rng.permutation(np.unique(names))[:3])
                rest, order = order[~trains[order]], order[trains[order]]
            else:
                rest = order[size:]
            if len(order) >= size and len(rest) >= 10:
                yield Split(f"{size} random", np.sort(order[:size]), np.sort(rest[:MOST_TESTED]))


@dataclass
class Errors:
    """Errors of the tested poses of several splits, each pose by its distance, [mm] and [deg]."""

    mm: list[Array] = field(default_factory=list)
    deg: list[Array] = field(default_factory=list)

    def add(self, here: urdfcal.noise.Linearisation, data: urdfcal.Measurements) -> None:
        """Take in what is left at one state."""
        for block in here.blocks:
            rows = here.measured[: len(data), block.columns].any(axis=1)
            left = here.residual[: len(data), block.columns][rows]
            if data.readings[0].sensor == "socket":
                left = np.concatenate([about_mean(left[own[rows]]) for own in sockets_of(data)])
            into, size = (self.deg, DEG) if block.unit == "deg" else (self.mm, MM)
            into.append(np.linalg.norm(left, axis=1) / size)

    def cells(self) -> list[str]:
        """RMS (from and to over the splits), mean, median, 95 % and max in mm; RMS in deg."""
        rms = [float(np.sqrt(np.mean(each**2))) for each in self.mm]
        every = np.concatenate(self.mm)
        span = f"{np.mean(rms):.3f}" + (f" ({min(rms):.3f} to {max(rms):.3f})" if len(rms) > 1 else "")
        turned = f"{np.mean([np.sqrt(np.mean(each**2)) for each in self.deg]):.4f}" if self.deg else "-"
        return [span, *(f"{value:.3f}" for value in (every.mean(), *np.quantile(every, [0.5, 0.95, 1.0]))), turned]


def about_mean(points: Array) -> Array:
    """Points (n, 3) about their mean."""
    return np.asarray(points - points.mean(axis=0))


def sockets_of(data: urdfcal.Measurements) -> Iterable[npt.NDArray[np.bool_]]:
    """The poses of each socket."""
    return [data.readings[0].labels == label for label in data.readings[0].touched]


def left_over(found: urdfcal.Calibration, test: urdfcal.Measurements, sag: bool = False) -> urdfcal.noise.Linearisation:
    """Residuals of test poses at the calibrated state, on request with joints that yield to gravity."""
    bent = fit_sag(found, folds=0, compare_directions=False) if sag else None
    errors, estimate = (bent.errors, bent.estimate) if bent else (found.errors, found.estimate)
    errors, x = with_new_places(errors, estimate.belief.x, test, estimate.noise)
    return Problem(errors, test).linearise(x)


def study(robot: RealRobot, folder: Path, splits: int, names: Iterable[str]) -> Iterator[list[str]]:
    """Rows of the table."""
    nominal, data = robot.load(folder)
    grouped: dict[str, list[Split]] = {}
    for split in [*repeatable_splits(robot, data), *random_splits(data, splits)]:
        grouped.setdefault(split.name, []).append(split)
    for name, group in grouped.items():
        before = Errors()
        for number, option in enumerate(names):
            after, began = Errors(), time.process_time()
            for split in group:
                train, test = robot.part(data, split.train), robot.part(data, split.test)
                found = urdfcal.fit(nominal, train, **OPTIONS.get(option, {}))
                after.add(left_over(found, test, option == SAG), test)
                if number == 0:
                    before.add(found.nominal.residuals(test), test)
            seconds = (time.process_time() - began) / len(group)
            size, tested = len(group[0].train), len(group[0].test)
            if number == 0:
                yield [robot.folder, name, str(size), str(tested), "nominal", *before.cells(), ""]
                if name in robot.reference:
                    yield [robot.folder, name, str(size), str(tested), "reference", f"{robot.reference[name]:.2f}", "", "", "", "", "", ""]
            yield [robot.folder, name, str(size), str(tested), option, *after.cells(), f"{seconds:.2f}"]


def main() -> None:
    """Print the table as Markdown."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=ROOT.parent / "shared" / "data")
    parser.add_argument("--set", nargs="+", default=[robot.folder for robot in ROBOTS], help="folders of DIR")
    parser.add_argument("--splits", type=int, default=5, help="random splits of every size (default 5)")
    parser.add_argument(
        "--options", nargs="+", default=[*OPTIONS, SAG], choices=[*OPTIONS, SAG], metavar="NAME", help=", ".join([*OPTIONS, SAG])
    )
    arguments = parser.parse_args()
    head = ("set", "split", "trained", "tested", "robot", "RMS mm", "mean mm", "median mm", "95 % mm", "max mm", "RMS deg", "CPU s a fit")
    print("| " + " | ".join(head) + " |\n|" + "---|" * len(head))
    for robot in ROBOTS:
        if robot.folder not in arguments.set:
            continue
        if not (arguments.data / robot.folder).is_dir():
            print(f"{robot.folder}: no folder of this name in {arguments.data}; left out", file=sys.stderr)
            continue
        for row in study(robot, arguments.data, arguments.splits, arguments.options):
            print("| " + " | ".join(row) + " |", flush=True)


if __name__ == "__main__":
    main()
