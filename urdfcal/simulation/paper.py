"""The paper's two studies, repeated: section IV, which is a simulation, and section V, an experiment, as a simulation.

Two protocols each. *One reading*: each pose is read once, with joint noise of +-0.1 deg and spot noise of +-2 mm, uniform. *Mean of
100* (section V: *of 2*): each pose is read so often and the mean is given to the estimator. What is published of the simulation is out
of reach of the first for any unbiased estimator, and appears with the second; what is published of the experiment lies between the two.

Distances are taken twice: to the noise-free spot at the true joint positions, which tells how good the model is, and to the measured
spot, predicted from the readings, which is all that an experimenter can see.

Section V's true errors are those that the paper estimated for its arm from all poses: Table V, case 3.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np

from urdfcal.base.errors import UsageError
from urdfcal.base.geometry import MM, Array3, Mask, Matrix, Vector
from urdfcal.calibration.analysis.check import check
from urdfcal.calibration.fitting import fit
from urdfcal.calibration.problem import Problem
from urdfcal.calibration.result import FitResult
from urdfcal.estimation.identifiability import HiddenSum
from urdfcal.model.error_model import ErrorModel
from urdfcal.model.gauge import build_error_model
from urdfcal.model.options import ModelOptions
from urdfcal.model.parameters import FLAT, Kind, PriorScale
from urdfcal.robot.robot import Robot
from urdfcal.sensors.measurements import Measurements, spots_measured
from urdfcal.simulation.published import SpotFigures
from urdfcal.simulation.readings import SimulatedNoise, simulate, true_spots
from urdfcal.simulation.study import ESTIMATORS as ESTIMATORS
from urdfcal.simulation.study import JOINT_NOISE, SECTION_4, SPOT_NOISE, Study, cases, paper_poses
from urdfcal.simulation.study import PROTOCOLS as PROTOCOLS
from urdfcal.simulation.study import paper_truth as paper_truth

FLAT_PRIOR: dict[Kind, PriorScale] = {"joint": PriorScale(FLAT, FLAT), "mount": PriorScale(FLAT, FLAT)}


@dataclass(frozen=True)
class Line:
    """Spot distances of one set of poses, averaged over the runs.

    Attributes:
        protocol: The study's name for it; empty before calibration.
        estimator: One of ESTIMATORS; empty before calibration.
        case: 1 to 3.
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
    published: SpotFigures | None


@dataclass(frozen=True)
class _Run:
    """One draw of poses and noise."""

    q: Matrix
    spots: Array3
    readings: dict[str, Measurements]


@dataclass(frozen=True)
class Repeated:
    """A study as it came out.

    Attributes:
        study: Which.
        robot: Its arm.
        errors: Names, order and units of its parameters.
        truth: Their true values, (p,), [m] and [rad].
        runs: How many draws of poses and noise there were.
        seed: Of the draws.
        lines: Distances, averaged over the draws: before calibration, then after it for each protocol.
        estimates: By protocol, estimator and case, (runs, p), [m] and [rad].
        first: Case 1 of the first draw by the EKF, for each protocol; its history is Fig. 4.
        hidden: Sums of which alone the poses of case 3 tell, in words.
    """

    study: Study
    robot: Robot
    errors: ErrorModel
    truth: Vector
    runs: int
    seed: int
    lines: list[Line]
    estimates: Mapping[tuple[str, str, int], Matrix]
    first: Mapping[str, FitResult]
    hidden: tuple[HiddenSum, ...]


def paper_tables(robot: Robot, runs: int = 10, seed: int = 0, progress: Callable[[], None] = lambda: None) -> list[Line]:
    """Repeat the paper's simulation; the lines of Table II, then those of Table III for both protocols."""
    return repeat(robot, SECTION_4, runs, seed, progress).lines


def repeat(robot: Robot, study: Study, runs: int = 5, seed: int = 0, progress: Callable[[], None] = lambda: None) -> Repeated:
    """Repeat a study.

    Args:
        robot: The 7-DOF arm of Table I for section IV, the 4-DOF arm of Table IV for section V.
        study: One of STUDIES.
        runs: How many draws of poses and noise are averaged.
        seed: Of the draws.
        progress: Called after every fit.

    Raises:
        UsageError: the robot cannot be the study's, or its spots are lost.
    """
    if len(robot.rig.lasers) != 2:
        raise UsageError(f"the paper's rig has two lasers, '{robot.name}' has {len(robot.rig.lasers)}")
    errors = build_error_model(robot.chain, robot.rig, ModelOptions(error_model="dh"))
    made = _Made(robot, study, errors, study.true_errors(errors), progress)
    for number in range(runs):
        made.run(np.random.default_rng([seed, number]))
    lines = [_averaged(study, key, values) for key, values in made.gathered.items()]
    estimates = {key: np.array(values) for key, values in made.estimates.items()}
    return Repeated(study, robot, errors, made.truth, runs, seed, lines, estimates, made.first, made.hidden)


@dataclass
class _Made:
    """A study while it is repeated: what its draws have brought so far."""

    robot: Robot
    study: Study
    errors: ErrorModel
    truth: Vector
    progress: Callable[[], None]
    gathered: dict[tuple[str, str, int, str], list[tuple[Matrix, Matrix | None]]] = field(default_factory=dict)
    estimates: dict[tuple[str, str, int], list[Vector]] = field(default_factory=dict)
    first: dict[str, FitResult] = field(default_factory=dict)
    hidden: tuple[HiddenSum, ...] = ()

    def run(self, rng: np.random.Generator) -> None:
        """One draw of poses and noise."""
        run = _draw(self.robot, self.study, self.errors, self.truth, rng)
        if not self.gathered:
            options = ModelOptions(error_model="dh")
            self.hidden = check(self.robot, spots_measured(self.robot, run.q, run.spots), options=options).observability.hidden
        for key, figures in self._lines(run):
            self.gathered.setdefault(key, []).append(figures)

    def _lines(self, run: _Run) -> Iterator[tuple[tuple[str, str, int, str], tuple[Matrix, Matrix | None]]]:
        nominal, sets = np.zeros(len(self.errors.names)), list(cases(self.study.half))
        exact = Problem(self.errors, spots_measured(self.robot, run.q, run.spots))
        for case, name, rows in sets:
            yield ("", "", case, name), (self._figures(exact, nominal, run.spots, rows, "nominal model"), None)
        for protocol, data in run.readings.items():
            read = Problem(self.errors, data)
            for estimator in self.study.estimators:
                x = nominal
                for case, name, rows in sets:
                    if name == "fit":
                        x = self._estimated(data.subset(rows), protocol, estimator, case)
                    whose = f"model that {estimator} finds in case {case}"
                    own = (self._figures(exact, x, run.spots, rows, whose), self._figures(read, x, data.spots, rows, whose))
                    yield (protocol, estimator, case, name), own

    def _figures(self, model: Problem, x: Vector, spots: Array3, rows: Mask, whose: str) -> Matrix:
        """Mean, std and max distance of each laser, (lasers, 3), [mm]."""
        distance = np.linalg.norm(np.stack(model.read(x), axis=1) - spots, axis=-1)[rows] / MM
        if lost := int((~np.isfinite(distance)).sum()):
            raise UsageError(
                f"'{self.robot.name}': the {whose} has {lost} of {distance.size} spots nowhere on the screen's plane; the paper's "
                "studies need a rig whose beams meet the screen at every pose: see where they go with `urdfcal view`"
            )
        return np.array([distance.mean(axis=0), distance.std(axis=0), distance.max(axis=0)]).T

    def _estimated(self, data: Measurements, protocol: str, estimator: str, case: int) -> Vector:
        found = _fitted(self.robot, data, estimator, self.study.protocols[protocol], self.study.max_sweeps)
        self.estimates.setdefault((protocol, estimator, case), []).append(found.x)
        if (estimator, case) == ("EKF", 1):
            self.first.setdefault(protocol, found)
        self.progress()
        return found.x


def _draw(robot: Robot, study: Study, errors: ErrorModel, truth: Vector, rng: np.random.Generator) -> _Run:
    q = paper_poses(robot, errors, truth, rng, study.half)
    readings = {
        name: simulate(robot, errors, truth, q, rng, SimulatedNoise(SPOT_NOISE, JOINT_NOISE, "uniform", count))
        for name, count in study.protocols.items()
    }
    return _Run(q, true_spots(robot, errors, truth, q), readings)


def _fitted(robot: Robot, data: Measurements, estimator: str, readings: int, max_sweeps: int) -> FitResult:
    if estimator == "LSE":
        return fit(robot, data, estimator="lse", error_model="dh", priors=FLAT_PRIOR, spot_sigma=1 * MM, asking=False)
    if estimator == "EKF":
        return fit(robot, data, error_model="dh", schedule="paper", max_sweeps=max_sweeps)
    uniform = 1 / np.sqrt(3 * readings)  # standard deviation of the mean of uniform noise of half-width 1
    return fit(robot, data, error_model="dh", spot_sigma=SPOT_NOISE * uniform, joint_sigma=JOINT_NOISE * uniform, asking=False)


def _averaged(study: Study, key: tuple[str, str, int, str], values: list[tuple[Matrix, Matrix | None]]) -> Line:
    protocol, estimator, case, poses = key
    measured = [figures for _, figures in values if figures is not None]
    published = study.after.get((estimator, case, poses)) if estimator else study.before[case, poses]
    return Line(
        protocol,
        estimator,
        case,
        poses,
        np.mean([figures for figures, _ in values], axis=0),
        np.mean(measured, axis=0) if measured else None,
        published,
    )
