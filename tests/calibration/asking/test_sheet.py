"""Sums that questions stand on, taken strip by strip, against a whole Jacobian of a model that has everything in it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from tests.support.sensor_cases import CASES, NOISE, session_errors, setup_of
from urdfcal.base.geometry import DEG, Matrix
from urdfcal.calibration.asking.beside import Bare, Beside
from urdfcal.calibration.asking.disturbances import courses_of
from urdfcal.calibration.asking.ground import Ground
from urdfcal.calibration.asking.interview import Interview
from urdfcal.calibration.asking.questions import Answer
from urdfcal.calibration.asking.sheet import Sheet
from urdfcal.calibration.problem import Problem
from urdfcal.estimation.ekf import Belief, Estimate
from urdfcal.estimation.noise import Noise
from urdfcal.model.error_model import with_rig, with_softness
from urdfcal.model.options import ModelOptions
from urdfcal.model.softness import EXTRAS, Term, extra_terms, gear_terms, gravity_terms, unit_terms
from urdfcal.robot.robot import Robot
from urdfcal.sensors.readings import KnownLength
from urdfcal.simulation.readings import simulate_readings

POSES, OF_JOINTS = 23, 0.03 * DEG


@dataclass(frozen=True)
class Case:
    """A fit, and what of its measurements makes it hard."""

    sensors: str
    again: bool = False
    of_joints: bool = False


FITS = {
    "every kind": Case("every kind"),
    "sessions": Case("sessions"),
    "poses read again": Case("lasers and points", again=True),
    "noise of joints": Case("hand sees hand", of_joints=True),
}


@pytest.fixture(params=FITS)
def ground(request: pytest.FixtureRequest, robots: dict[str, Robot], rng: np.random.Generator) -> Ground:
    """At some state near what was measured."""
    case = FITS[request.param]
    setup = setup_of(CASES[case.sensors], robots, rng)
    data = simulate_readings(setup, POSES, rng, NOISE)
    data = replace(data, payload=rng.uniform(0, 2, POSES), temperature=rng.uniform(20, 30, POSES))
    data = replace(data, approach=rng.choice([-1.0, 1.0], data.q.shape))
    if "socket:1" in {place.name for place in data.instruments.places}:
        data = replace(data, lengths=(KnownLength("socket:1", "socket:2", 0.3, 1e-4),))
    if case.again:
        data = data.subset(np.repeat(np.arange(POSES), np.arange(POSES) % 3 + 1)[::-1])
    errors, x = session_errors(setup, ModelOptions(), data)
    noise = Noise(np.full(len(data.kinds), 1e-3), np.full(len(data.joints), 1e-3 * case.of_joints), common=0.5)
    belief = Belief(x + rng.normal(0, 1e-5, len(x)), np.eye(len(x)))
    return Ground(setup.robot, Problem(errors, data, joints=case.of_joints), Estimate(belief, "converged", noise, []))


@pytest.fixture
def in_strips(monkeypatch: pytest.MonkeyPatch) -> None:
    """Four poses at a time, of which none is kept."""
    monkeypatch.setattr("urdfcal.calibration.problem.CHUNK", 4)
    monkeypatch.setattr("urdfcal.calibration.asking.sheet._FEW", 9)
    monkeypatch.setattr("urdfcal.calibration.asking.sheet._KEPT", 0)


def dense(ground: Ground, sheet: Sheet, gear: tuple[int, int], noise: float) -> Matrix:
    """Whitened columns of the fit, of all questions, of one gear, and the residual, (N, columns + 1), from one model with all of them."""
    chain, data, weighed = ground.robot.chain, ground.model.data, ground.pulls[0]
    sag = gravity_terms(chain, weighed.moments(data.q))
    gears = gear_terms(chain, [(tuple(ground.joints)[gear[0]], gear[1])])
    extras = extra_terms(chain, EXTRAS)
    soft: tuple[Term, ...] = (*sag, *extras, *gears, *unit_terms(chain))
    errors = with_rig(with_softness(ground.model.errors, soft, weighed, ground.robot.rig.tip), [*sheet.terms.values()], courses_of(data))
    x = np.concatenate([ground.estimate.belief.x, np.zeros(len(errors.names) - sheet.p)])
    whole = Problem(errors, data).linearise(x)
    bare = Problem(errors, replace(data, payload=None)).linearise(x)  # what a payload adds is what is not there without it
    here, weights = ground.linearisation, ground.weights
    of = {name: number for number, name in enumerate(errors.names)}

    def columns(jacobian: Matrix, names: list[str], sigma: list[float]) -> Matrix:
        return weights.of_poses(jacobian[:, :, [of[name] for name in names]] * sigma).reshape(-1, len(names))

    rig = [*sheet.terms.values()]
    parts = [
        columns(whole.jacobian, [*ground.model.errors.names], ground.model.errors.sigma.tolist()),
        columns(whole.jacobian, [term.name for term in sag], [term.sigma for term in sag]),
        columns(whole.jacobian - bare.jacobian, [term.name for term in sag], [term.sigma for term in sag]),
        columns(whole.jacobian, [term.name for term in extras], [term.sigma for term in extras]),
        columns(whole.jacobian, [term.name for term in rig], [term.sigma for term in rig]),
        columns(whole.jacobian, [term.name for term in gears], [term.sigma for term in gears]),
        weights.of_poses(here.residual[..., None]).reshape(-1, 1),
    ]
    turns = [f"{joint}.turn" for joint in ground.joints]
    return np.linalg.solve(root_of(columns(whole.jacobian, turns, [noise] * len(turns)), here.residual.shape[1]), np.hstack(parts))


def root_of(E: Matrix, m: int) -> Matrix:
    """L with L L' = I + E E' within each row of m numbers, (N, N)."""
    row = np.arange(len(E)) // m
    return np.linalg.cholesky(np.eye(len(E)) + np.where(row[:, None] == row, E @ E.T, 0.0))


@pytest.mark.usefixtures("in_strips")
@pytest.mark.parametrize("noise", [0.0, OF_JOINTS], ids=["plain", "with noise of joints"])
def test_products_are_those_of_a_model_with_everything_in_it(ground: Ground, noise: float) -> None:
    """Columns of the fit, arm, rig and gears and the residual, side by side."""
    sheet, gear = Sheet(ground), (1, 7)
    rows = dense(ground, sheet, gear, noise)
    expected = rows.T @ rows
    scale = np.sqrt(np.where(np.diag(expected) > 0, np.diag(expected), 1.0))
    np.testing.assert_allclose(Bare(sheet).products((gear,), noise) / np.outer(scale, scale), expected / np.outer(scale, scale), atol=1e-9)
    assert np.count_nonzero(np.diag(expected)) > 0.8 * len(expected)


def test_answers_do_not_depend_on_strips(ground: Ground, request: pytest.FixtureRequest) -> None:
    """What stands out, what it does and whether it pays are the same of all rows at once and of few at a time."""
    told = [told_of(ground)]
    request.getfixturevalue("in_strips")
    told.append(told_of(replace(ground, model=replace(ground.model))))
    np.testing.assert_allclose(told[1], told[0], rtol=1e-6)


def told_of(ground: Ground) -> list[float]:
    """Sums of a fit with some answers of every sort in it, and what follows from them."""
    interview = Interview(replace(ground, anywhere=True))
    sheet = Sheet(interview.ground)
    rig = [number for number, term in sheet.terms.items() if term.what == "drift"]
    found = [
        Answer("sag", "", 5.0, sheet.questions[0].columns, 0.3),
        Answer("harmonics", "", 4.0, gear=(0, 5), size=3.0),
        Answer("drift", "", 3.0, np.array(rig), 1.0),
        Answer("joint_noise", "", 2.0, noise=OF_JOINTS),
    ]
    beside, lacking = Beside(Bare(sheet), found), interview.lacking(found)
    assert lacking is not None
    length = lacking.length if np.isfinite(lacking.length) else 0.0
    gain = interview.foretold(found) - interview.foretold()
    return [beside.fitted.total, beside.fitted.log_evidence, gain, lacking.left, length, *lacking.reaches]
