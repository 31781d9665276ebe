"""Do the printed sigmas keep their promise? Many simulated robots whose errors are drawn from the priors of the fit.

    python tests/benchmarks/intervals.py [--sets N] [--joint-deg SIGMA] [--no-gate] [--jobs N] [--resume FOLDER]

*Parameters*: how often the 95 % intervals of determined parameters hold the truth, pooled, and of the worst single one. *Spots*: the
same of the coordinates of noise-free spots at unseen poses, by the covariance of the parameters alone; and their mean squared distance
from the truth over `spot_sigma` squared, 1 where it is right. *NEES*: the mean of e' P^-1 e less p, in standard deviations of a mean of
as many chi-squares; within 1.96 it is in its 95 % band. *Flat*: the same without priors, over the directions that the data determine;
`--flat-model dh` takes the paper's parameters for it, which leave some hardly seen. *Noise stated*: sets that are told so when the spot
noise is stated half or twice as large as it is; in all other fits it is estimated. `--evidence` draws the joints' errors from 1 mm and
0.1 deg and does not tell the fit, which then chooses the scales of their priors itself.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2]))

import numpy as np
import numpy.typing as npt

import urdfcal
from tests.support.studies import over, with_jobs
from urdfcal.base.errors import UsageError
from urdfcal.base.geometry import DEG, MM
from urdfcal.calibration.analysis.prediction import spot_jacobians, spot_sigma
from urdfcal.calibration.problem import Problem
from urdfcal.calibration.reach import draw_poses
from urdfcal.estimation.identifiability import DETERMINED
from urdfcal.model.error_model import ErrorModel
from urdfcal.model.gauge import build_error_model
from urdfcal.model.options import ModelOptions
from urdfcal.model.parameters import FLAT, Kind, PriorScale
from urdfcal.sensors.measurements import spots_measured
from urdfcal.simulation.readings import SimulatedNoise, simulate, true_spots

Array = npt.NDArray[np.float64]
Priors = dict[Kind, PriorScale]

ROBOTS = Path(__file__).parents[2] / "robots"
CASES = ("arm7", "panda", "arm4")
PRIORS: Priors = {"joint": PriorScale(10 * MM, 1 * DEG), "mount": PriorScale(20 * MM, 2 * DEG), "screen": PriorScale(100 * MM, 5 * DEG)}
FLAT_PRIORS: Priors = dict.fromkeys(PRIORS, PriorScale(FLAT, FLAT))
SPOT, UNSEEN = 1 * MM, 100
Z95 = 1.959963984540054


@dataclass(frozen=True)
class Study:
    """What all sets share: robot, poses a set, [rad] of joint noise, and whether the gate is on."""

    robot: urdfcal.Robot
    poses: int
    joint: float
    gated: bool
    evidence: bool

    @property
    def truths(self) -> Priors:
        """What errors are drawn from."""
        return {**PRIORS, "joint": PriorScale(1 * MM, 0.1 * DEG)} if self.evidence else PRIORS

    @property
    def priors(self) -> Priors:
        """What the fit is told of it."""
        return {kind: scale for kind, scale in PRIORS.items() if not (self.evidence and kind == "joint")}

    def fit(self, data: urdfcal.Measurements, priors: Priors, model: str = "auto", spot: float | None = None) -> urdfcal.Calibration:
        """Fit one set."""
        return urdfcal.fit(self.robot, data, error_model=model, priors=priors, spot_sigma=spot, joint_sigma=self.joint, gated=self.gated)


@dataclass(frozen=True)
class Simulated:
    """A robot with errors drawn from the prior, what was measured of it, and its spots at unseen poses."""

    errors: ErrorModel
    truth: Array
    data: urdfcal.Measurements
    unseen: urdfcal.Measurements


@dataclass
class Tally:
    """What sets of one robot said.

    Attributes:
        names: Of the parameters.
        inside: Of each set, for each parameter: 1 where its interval holds the truth, 0 where not, nan where it is not determined.
        spots: Of each set, share of the coordinates of unseen spots within their intervals.
        distance: Of each set, mean squared distance of unseen spots over `spot_sigma` squared.
        nees: e' P^-1 e of each set, and p.
        flat: The same without priors over the determined directions, and how many there are.
        noise: Estimated over true spot noise.
        notes: Everything else worth counting.
    """

    names: tuple[str, ...] = ()
    inside: list[Array] = field(default_factory=list)
    spots: list[float] = field(default_factory=list)
    distance: list[float] = field(default_factory=list)
    nees: list[tuple[float, int]] = field(default_factory=list)
    flat: list[tuple[float, int]] = field(default_factory=list)
    noise: list[float] = field(default_factory=list)
    notes: Counter[str] = field(default_factory=Counter)


def drawn(study: Study, model: str, rng: np.random.Generator) -> Simulated:
    """One robot, measured."""
    robot = study.robot
    errors = build_error_model(robot.chain, robot.rig, ModelOptions(error_model=model, priors=study.truths))
    while True:
        truth = rng.normal(errors.mean, errors.sigma)
        try:
            q = draw_poses(robot, errors, truth, study.poses + UNSEEN, rng)
        except UsageError:
            continue  # the beams of this robot hardly ever meet this screen
        data = simulate(robot, errors, truth, q[: study.poses], rng, SimulatedNoise(SPOT, study.joint))
        return Simulated(errors, truth, data, spots_measured(robot, q[study.poses :], true_spots(robot, errors, truth, q[study.poses :])))


def normalised(error: Array, covariance: Array) -> float:
    """e' P^-1 e, in units in which P has a unit diagonal."""
    sigma = np.sqrt(np.diag(covariance))
    return float(error / sigma @ np.linalg.solve(covariance / np.outer(sigma, sigma), error / sigma))


def normalised_where_determined(error: Array, covariance: Array, scale: Array) -> tuple[float, int]:
    """The same within the directions that the data determine against a prior of the given scale, and how many they are."""
    variances, directions = np.linalg.eigh(covariance / np.outer(scale, scale))
    known = variances < DETERMINED**2
    along = directions[:, known].T @ (error / scale)
    return float(np.sum(along**2 / variances[known])), int(known.sum())


def under_priors(study: Study, one: Simulated, tally: Tally) -> None:
    """Fit with the priors that the truth was drawn from, or those that the fit chooses."""
    found = study.fit(one.data, study.priors)
    tally.names = found.errors.names
    tally.notes["not converged"] += not found.converged
    tally.notes["prior widened"] += any("widened to" in warning for warning in found.warnings)
    tally.notes["spots left out"] += len(found.outliers)
    error, P = found.x - one.truth, found.covariance
    tally.inside.append(np.where(found.identifiability.determined, np.abs(error) < Z95 * found.sigma, np.nan))
    tally.nees.append((normalised(error, P), len(error)))
    tally.noise.append(found.estimate.noise.spot_sigma / SPOT)
    J = spot_jacobians(found.errors, found.x, one.unseen.q)
    off = np.stack(Problem(found.errors, one.unseen).read(found.x), axis=1) - one.unseen.spots
    tally.spots.append(float(np.mean(np.abs(off) < Z95 * np.sqrt(np.einsum("nlkp,pr,nlkr->nlk", J, P, J)))))
    expected = spot_sigma(found.errors, P, found.x, one.unseen.q)
    tally.distance.append(float(np.mean(np.sum(off**2, axis=-1) / expected**2)))


def without_priors(study: Study, one: Simulated, tally: Tally, model: str) -> None:
    """Fit with flat priors."""
    found = study.fit(one.data, FLAT_PRIORS, model)
    tally.notes["flat: not converged"] += not found.converged
    tally.flat.append(normalised_where_determined(found.x - one.truth, found.covariance, one.errors.sigma))


def wrongly_stated(study: Study, one: Simulated, tally: Tally) -> None:
    """Fit with the spot noise stated half and twice as large as it is."""
    for factor in (0.5, 2.0):
        found = study.fit(one.data, study.priors, spot=factor * SPOT)
        said = any("scatter" in warning and "stated noise" in warning for warning in found.warnings)
        tally.notes[f"speaks at {factor:g} times"] += said


def run(study: Study, flat: str, seed: int) -> Tally:
    """One set; `flat` is the error model of the fit without priors."""
    rng, tally = np.random.default_rng(seed), Tally()
    one = drawn(study, "auto", rng)
    under_priors(study, one, tally)
    wrongly_stated(study, one, tally)
    without_priors(study, one if flat == "auto" else drawn(study, flat, rng), tally, flat)
    return tally


def together(tallies: Sequence[Tally]) -> Tally:
    """All sets in one."""
    every = Tally(tallies[0].names)
    for own in tallies:
        every.inside += own.inside
        every.spots += own.spots
        every.distance += own.distance
        every.nees += own.nees
        every.flat += own.flat
        every.noise += own.noise
        every.notes.update(own.notes)
    return every


def standing(values: list[tuple[float, int]]) -> str:
    """Mean of squares that should be chi-squared beside its expectation, and how far off in standard deviations of such a mean."""
    squares, freedom = np.array(values, dtype=float).T
    away = (squares.mean() - freedom.mean()) / np.sqrt(2 * freedom.mean() / len(squares))
    return f"{squares.mean():.2f} (median {np.median(squares):.2f}) of {freedom.mean():.2f} ({away:+.2f})"


def report(name: str, tally: Tally) -> None:
    """Print what one robot's sets said."""
    inside = np.array(tally.inside)
    share, counted = np.nanmean(inside, axis=0), np.sum(~np.isnan(inside), axis=0)
    often = np.where(counted >= len(inside) / 2, share, np.inf)
    worst = int(often.argmin())
    print(f"{name}: {len(inside)} sets, {inside.shape[1]} parameters, {np.isfinite(inside).mean():.0%} of them determined")
    print(f"  parameters   {np.nanmean(inside):7.2%} of {counted.sum()}; worst {tally.names[worst]} {share[worst]:.1%} of {counted[worst]}")
    print(f"  spots        {np.mean(tally.spots):7.2%} +- {np.std(tally.spots) / np.sqrt(len(tally.spots)):.2%}", end="; ")
    print(f"mean squared distance over spot_sigma^2 {np.mean(tally.distance):.3f}")
    print(f"  NEES         {standing(tally.nees)}; flat, projected: {standing(tally.flat)}")
    print(f"  spot noise   estimated {np.mean(tally.noise):.4f} +- {np.std(tally.noise):.4f} of the true")
    print(f"  {', '.join(f'{note} {count}' for note, count in tally.notes.items())}", flush=True)


def main() -> None:
    """Parse the command line and run the study."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sets", type=int, default=300, help="sets for each robot (default 300)")
    parser.add_argument("--poses", type=int, default=60, help="how many poses (default 60)")
    parser.add_argument("--joint-deg", type=float, default=0.0, help="sigma of the joint readings, stated to the fit (default 0)")
    parser.add_argument("--robots", nargs="+", default=CASES, choices=CASES)
    parser.add_argument("--flat-model", default="auto", help="error model of the fits without priors (default auto)")
    parser.add_argument("--evidence", action="store_true", help="let the fit choose the scales of the joints' priors")
    parser.add_argument("--no-gate", action="store_true", help="leave the outlier gate off")
    with_jobs(parser)
    arguments = parser.parse_args()
    begun, flat, tallies = time.perf_counter(), arguments.flat_model, list[Tally]()
    for name in arguments.robots:
        robot = urdfcal.load_robot(ROBOTS / name / f"{name}.urdf.xacro")
        study = Study(robot, arguments.poses, arguments.joint_deg * DEG, not arguments.no_gate, arguments.evidence)
        tallies.append(together(over(partial(run, study, flat), range(arguments.sets), arguments)))
        report(name, tallies[-1])
    pooled = np.concatenate([np.ravel(tally.inside) for tally in tallies])
    spots = np.concatenate([tally.spots for tally in tallies])
    print(f"all: parameters {np.nanmean(pooled):.2%} of {np.isfinite(pooled).sum()}, spots {spots.mean():.2%}", end="; ")
    print(f"{time.perf_counter() - begun:.0f} s")


if __name__ == "__main__":
    main()
