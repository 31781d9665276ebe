"""The simulation of section IV: Tables II and III beside the published values.

Two protocols. *One reading*: each pose is read once, with joint noise of +-0.1 deg and spot noise of +-2 mm, uniform. *Mean of 100*:
each pose is read a hundred times and the mean is given to the estimator. The published accuracy is out of reach of the first for any
unbiased estimator; it appears with the second.

Distances are taken twice: to the noise-free spot at the true joint positions, which tells how good the model is, and to the measured
spot, predicted from the readings, which is all that an experimenter can see.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from urdfcal.base.errors import UsageError
from urdfcal.base.geometry import DEG, MM, Array3, Mask, Matrix, Vector
from urdfcal.calibration.fitting import fit
from urdfcal.calibration.problem import Problem
from urdfcal.calibration.reach import draw_poses
from urdfcal.model.error_model import ErrorModel
from urdfcal.model.gauge import build_error_model
from urdfcal.model.options import ModelOptions
from urdfcal.model.parameters import FLAT, Kind, PriorScale
from urdfcal.robot.configurations import joint_limits
from urdfcal.robot.robot import Robot
from urdfcal.robot.sheet import ScreenArea
from urdfcal.sensors.measurements import Measurements, spots_measured
from urdfcal.simulation.readings import SimulatedNoise, simulate, true_spots

HALF = 30  # poses near home, and poses over the whole ranges
NEAR = 10 * DEG
JOINT_NOISE, SPOT_NOISE = 0.1 * DEG, 2.0 * MM
TRUTH = {"m": 10 * MM, "rad": 1 * DEG}
SCREEN_SIZE = 1.5  # [m]; the published errors leave every spot on a screen of about this size
PROTOCOLS = {"one reading": 1, "mean of 100": 100}
ESTIMATORS = ("LSE", "EKF", "EKF, noise stated")
FLAT_PRIOR: dict[Kind, PriorScale] = {"joint": PriorScale(FLAT, FLAT), "mount": PriorScale(FLAT, FLAT)}

Figures = tuple[float, float, float]  # mean, std, max [mm]

PUBLISHED_BEFORE: dict[tuple[int, str], tuple[Figures, Figures]] = {
    (1, "fit"): ((84.06, 4.54, 96.03), (15.94, 6.83, 29.11)),
    (1, "test"): ((89.16, 20.48, 154.18), (29.73, 19.63, 85.49)),
    (2, "fit"): ((84.34, 15.62, 154.18), (27.07, 18.70, 85.49)),
    (2, "test"): ((88.88, 14.10, 143.93), (18.59, 11.89, 55.34)),
    (3, "fit"): ((86.61, 15.05, 154.18), (22.83, 16.24, 85.49)),
}
PUBLISHED_AFTER: dict[tuple[str, int, str], tuple[Figures, Figures]] = {
    ("LSE", 1, "fit"): ((0.42, 0.14, 0.79), (0.32, 0.13, 0.62)),
    ("LSE", 1, "test"): ((0.77, 0.52, 2.19), (0.82, 0.57, 2.98)),
    ("LSE", 2, "fit"): ((0.18, 0.13, 0.49), (0.15, 0.10, 0.53)),
    ("LSE", 2, "test"): ((0.22, 0.19, 0.81), (0.20, 0.17, 0.72)),
    ("LSE", 3, "fit"): ((0.15, 0.10, 0.47), (0.12, 0.09, 0.44)),
    ("EKF", 1, "fit"): ((0.12, 0.04, 0.23), (0.08, 0.04, 0.16)),
    ("EKF", 1, "test"): ((0.27, 0.14, 0.69), (0.29, 0.13, 0.65)),
    ("EKF", 2, "fit"): ((0.09, 0.05, 0.26), (0.09, 0.06, 0.25)),
    ("EKF", 2, "test"): ((0.09, 0.06, 0.27), (0.09, 0.06, 0.28)),
    ("EKF", 3, "fit"): ((0.10, 0.06, 0.29), (0.08, 0.06, 0.23)),
}


@dataclass(frozen=True)
class Line:
    """Spot distances of one set of poses, averaged over the runs.

    Attributes:
        protocol: Key of PROTOCOLS; empty for Table II.
        estimator: One of ESTIMATORS; empty for Table II.
        case: 1 to 3, as in section IV.
        poses: `fit` or `test`.
        to_true: Mean, std and max distance to the noise-free spot for each laser, [mm].
        to_measured: The same to the measured spot.
        published: The paper's figures for each laser, where it has any.
    """

    protocol: str
    estimator: str
    case: int
    poses: str
    to_true: Matrix
    to_measured: Matrix | None
    published: tuple[Figures, Figures] | None


@dataclass(frozen=True)
class _Run:
    """One draw of poses and noise."""

    q: Matrix
    spots: Array3
    readings: dict[str, Measurements]


def paper_tables(robot: Robot, runs: int = 10, seed: int = 0, progress: Callable[[], None] = lambda: None) -> list[Line]:
    """Repeat the paper's simulation.

    Args:
        robot: The 7-DOF arm of Table I.
        runs: How many draws of poses and noise are averaged.
        seed: Of the first draw.
        progress: Called after every run.

    Returns:
        The lines of Table II, then those of Table III for both protocols.
    """
    if len(robot.rig.lasers) != 2:
        raise UsageError(f"the paper's rig has two lasers, '{robot.name}' has {len(robot.rig.lasers)}")
    errors = build_error_model(robot.chain, robot.rig, ModelOptions(error_model="dh"))
    truth = paper_truth(errors)
    gathered: dict[tuple[str, str, int, str], list[tuple[Matrix, Matrix | None]]] = {}
    for number in range(runs):
        run = _draw(robot, errors, truth, np.random.default_rng([seed, number]))
        for key, figures in _lines(robot, errors, run):
            gathered.setdefault(key, []).append(figures)
        progress()
    return [_averaged(key, values) for key, values in gathered.items()]


def paper_truth(errors: ErrorModel) -> Vector:
    """(10 mm, 10 mm, 1 deg, 1 deg) on every joint, a perfect module."""
    return np.array([TRUTH[parameter.unit] if parameter.kind == "joint" else 0.0 for parameter in errors.parameters])


def paper_poses(robot: Robot, errors: ErrorModel, truth: Vector, rng: np.random.Generator) -> Matrix:
    """30 poses with every joint within +-10 deg (joint 4 not positive), then 30 over the whole ranges; every spot on the screen."""
    whole = joint_limits(robot)
    near = np.clip(np.array([[-NEAR], [NEAR]]) * np.ones_like(whole), whole[0], whole[1])
    area = ScreenArea(SCREEN_SIZE, _home_centre(robot, errors))
    return np.vstack([draw_poses(robot, errors, truth, HALF, rng, area=area, limits=limits) for limits in (near, whole)])


def cases() -> Iterator[tuple[int, str, Mask]]:
    """Case, set, and the poses that belong to it."""
    number = np.arange(2 * HALF)
    near, first_half = number < HALF, number % HALF < HALF // 2
    yield 1, "fit", near
    yield 1, "test", ~near
    yield 2, "fit", first_half
    yield 2, "test", ~first_half
    yield 3, "fit", number >= 0


def _home_centre(robot: Robot, errors: ErrorModel) -> tuple[float, float]:
    home = true_spots(robot, errors, np.zeros(len(errors.names)), np.zeros((1, len(robot.chain.inputs))))[0]
    y, z = home.mean(axis=0)
    return float(y), float(z)


def _draw(robot: Robot, errors: ErrorModel, truth: Vector, rng: np.random.Generator) -> _Run:
    q = paper_poses(robot, errors, truth, rng)
    readings = {
        name: simulate(robot, errors, truth, q, rng, SimulatedNoise(SPOT_NOISE, JOINT_NOISE, "uniform", count))
        for name, count in PROTOCOLS.items()
    }
    return _Run(q, true_spots(robot, errors, truth, q), readings)


def _lines(robot: Robot, errors: ErrorModel, run: _Run) -> Iterator[tuple[tuple[str, str, int, str], tuple[Matrix, Matrix | None]]]:
    nominal = np.zeros(len(errors.names))
    exact = Problem(errors, spots_measured(robot, run.q, run.spots))
    for case, name, rows in cases():
        yield ("", "", case, name), (_figures(exact, nominal, run.spots, rows), None)
    for protocol, data in run.readings.items():
        read = Problem(errors, data)
        for estimator in ESTIMATORS:
            x = nominal
            for case, name, rows in cases():
                if name == "fit":
                    x = _estimated(robot, data.subset(rows), estimator, PROTOCOLS[protocol])
                yield (protocol, estimator, case, name), (_figures(exact, x, run.spots, rows), _figures(read, x, data.spots, rows))


def _estimated(robot: Robot, data: Measurements, estimator: str, readings: int) -> Vector:
    if estimator == "LSE":
        return fit(robot, data, estimator="lse", error_model="dh", priors=FLAT_PRIOR, spot_sigma=1 * MM, asking=False).x
    if estimator == "EKF":
        return fit(robot, data, error_model="dh", schedule="paper").x
    uniform = 1 / np.sqrt(3 * readings)  # standard deviation of the mean of uniform noise of half-width 1
    return fit(robot, data, error_model="dh", spot_sigma=SPOT_NOISE * uniform, joint_sigma=JOINT_NOISE * uniform, asking=False).x


def _figures(model: Problem, x: Vector, spots: Array3, rows: Mask) -> Matrix:
    """Mean, std and max distance of each laser, (lasers, 3), [mm]."""
    distance = np.linalg.norm(np.stack(model.read(x), axis=1) - spots, axis=-1)[rows] / MM
    return np.array([distance.mean(axis=0), distance.std(axis=0), distance.max(axis=0)]).T


def _averaged(key: tuple[str, str, int, str], values: list[tuple[Matrix, Matrix | None]]) -> Line:
    protocol, estimator, case, poses = key
    measured = [figures for _, figures in values if figures is not None]
    published = PUBLISHED_AFTER.get((estimator, case, poses)) if estimator else PUBLISHED_BEFORE[case, poses]
    return Line(
        protocol,
        estimator,
        case,
        poses,
        np.mean([figures for figures, _ in values], axis=0),
        np.mean(measured, axis=0) if measured else None,
        published,
    )
