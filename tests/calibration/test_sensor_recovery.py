"""Known errors are found again by every sensor, within what the fit claims; and the noise of each kind is estimated right."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tests.benchmarks.evidence import factory_truths
from tests.support.paths import SHARED_DATA
from tests.support.sensor_cases import ARRANGED, CASES, NOISE, SINGLE, SensorCase, setup_of
from urdfcal.api import Calibration, fit
from urdfcal.base.geometry import DEG, MM
from urdfcal.calibration.error_table import error_table, rms_of
from urdfcal.calibration.problem import Problem
from urdfcal.model.gauge import build_error_model
from urdfcal.model.options import ModelOptions
from urdfcal.model.parameters import PriorScale
from urdfcal.robot.robot import Robot
from urdfcal.sensors.measurements import Measurements
from urdfcal.sensors.readings import KnownLength
from urdfcal.simulation.readings import simulate_readings
from urdfcal.simulation.setup import SimulatedSetup, simulated_setup

DATA = SHARED_DATA
SCALE = PriorScale(2 * MM, 0.2 * DEG)
POSES = {"every kind": 160, "plane": 120}
RECOVERED = [name for name in CASES if name != "points on the base"]
TRUE_NOISE = {"spot": NOISE.spot, "orientation": NOISE.angle, "inclination": NOISE.angle}


def measured(setup: SimulatedSetup, name: str, rng: np.random.Generator, poses: int) -> Measurements:
    """Noisy measurements; with a known length where touches alone would leave the scale open."""
    data = simulate_readings(setup, poses, rng, NOISE)
    if name != "socket":
        return data
    apart = float(np.linalg.norm(setup.place("socket:1") - setup.place("socket:2")))
    return replace(data, lengths=(KnownLength("socket:1", "socket:2", apart),))


def standardised(setup: SimulatedSetup, found: Calibration) -> np.ndarray:
    """Errors of the joints' and the mount's parameters over their claimed standard deviations."""
    truth = dict(zip(setup.errors.names, setup.x.tolist(), strict=True))
    own = [index for index, parameter in enumerate(found.errors.parameters) if parameter.kind in ("joint", "mount")]
    return np.asarray((found.x[own] - [truth[found.errors.names[index]] for index in own]) / found.sigma[own])


def unseen_share(setup: SimulatedSetup, found: Calibration, rng: np.random.Generator) -> tuple[np.ndarray, float, float]:
    """Errors of noise-free readings that were not fitted over what is claimed of them; their RMS before and after, [mm]."""
    unseen = simulate_readings(setup, 60, rng)
    here = Problem(found.errors, unseen).linearise(found.x)
    spread = np.sqrt(np.einsum("nmp,pq,nmq->nm", here.jacobian, found.covariance, here.jacobian))
    return here.residual[here.measured] / spread[here.measured], rms_of(found.nominal.table(unseen)), rms_of(error_table(here, len(unseen)))


@pytest.mark.parametrize("name", RECOVERED)
def test_the_truth_is_found_within_what_is_claimed(name: str, robots: dict[str, Robot]) -> None:
    """Gaussian errors: parameters and unseen readings lie within their intervals, the noise of every kind comes out within 15 %."""
    case, shares, unseen = CASES[name], [], []
    for seed in range(2):
        rng = np.random.default_rng([seed, 7])
        setup = setup_of(case, robots, rng, model="auto")
        data = measured(setup, name, rng, POSES.get(name, 100))
        found = fit(setup.robot, data, priors={"joint": SCALE}, options=ModelOptions(reference_known=case.known))
        assert found.converged, found.stop_reason
        for kind, sigma in zip(data.kinds, found.estimate.noise.sigma.tolist(), strict=True):
            assert sigma == pytest.approx(TRUE_NOISE.get(kind, NOISE.length), rel=0.25), kind
        share, before, after = unseen_share(setup, found, rng) if name != "plane" else (np.zeros(1), 1.0, 0.0)
        assert after < before / 15
        shares, unseen = [*shares, standardised(setup, found)], [*unseen, share]
    if name != "plane":  # whose scale is held, so that its parameters are right but for that
        assert np.abs(np.concatenate(shares)).max() < 4.5
        assert np.sqrt(np.mean(np.concatenate(shares) ** 2)) < 1.5
    assert np.sqrt(np.mean(np.concatenate(unseen) ** 2)) < 1.5


@pytest.mark.slow
@pytest.mark.parametrize("name", [*SINGLE, *(name for name in ARRANGED if name != "points on the base")])
def test_intervals_hold_the_truth_as_often_as_they_say(name: str, robots: dict[str, Robot]) -> None:
    """Over 20 robots 95 % intervals of parameters and of unseen readings hold the truth neither too often nor too seldom."""
    case, shares, unseen = CASES[name], [], []
    for seed in range(20):
        rng = np.random.default_rng([seed, 8])
        setup = setup_of(case, robots, rng, model="auto")
        data = measured(setup, name, rng, POSES.get(name, 100))
        found = fit(setup.robot, data, priors={"joint": SCALE}, gated=False, options=ModelOptions(reference_known=case.known))
        shares, unseen = [*shares, standardised(setup, found)], [*unseen, unseen_share(setup, found, rng)[0]]
    if name != "plane":
        assert 0.92 < np.mean(np.abs(np.concatenate(shares)) < 1.96) < 0.98
    assert 0.90 < np.mean(np.abs(np.concatenate(unseen)) < 1.96) < 0.985


@pytest.mark.parametrize("name", SINGLE)
def test_factory_calibrations_are_found_again(name: str, robots: dict[str, Robot]) -> None:
    """With the makers' own calibrations of UR arms as truth, unseen readings are right within what is claimed of them."""
    if not (DATA / "ur_factory").is_dir():
        pytest.skip(f"the makers' calibrations are not at {DATA / 'ur_factory'}")
    unseen = []
    for seed, truth in enumerate(factory_truths(DATA)[:2]):
        rng = np.random.default_rng([seed, 9])
        drawn = setup_of(SINGLE[name], robots, rng)
        errors = build_error_model(drawn.robot.chain, drawn.robot.rig, ModelOptions(error_model="placement"))
        x = np.zeros(len(errors.names))
        x[[parameter.kind == "joint" for parameter in errors.parameters]] = truth
        setup = simulated_setup(drawn.robot, errors, x, drawn.sensors, rng)
        found = fit(setup.robot, simulate_readings(setup, 120, rng, NOISE))
        share, before, after = unseen_share(setup, found, rng)
        assert after < before / 4
        unseen.append(share)
    assert np.sqrt(np.mean(np.concatenate(unseen) ** 2)) < 1.5


def test_points_on_the_base_are_seen_from_the_arm(robots: dict[str, Robot]) -> None:
    """A camera that the arm carries sees marks on the base: the same errors, found from the other end."""
    case = CASES["points on the base"]
    rng = np.random.default_rng(11)
    setup = setup_of(case, robots, rng, model="auto")
    found = fit(setup.robot, simulate_readings(setup, 100, rng, NOISE), priors={"joint": SCALE})
    share, before, after = unseen_share(setup, found, rng)
    assert after < before / 15
    assert np.sqrt(np.mean(share**2)) < 1.6


@pytest.mark.parametrize("missing", ["z", "y and z", "half of the cells", "all but the orientation"])
def test_axes_may_be_missing(missing: str, robots: dict[str, Robot]) -> None:
    """Points with an axis missing everywhere, or here and there, and orientations alone, still find frame, target and joints."""
    case = CASES["pose"] if missing == "all but the orientation" else CASES["point"]
    for seed in range(3):
        rng = np.random.default_rng([seed, 12])
        setup = setup_of(case, robots, rng, model="auto")
        data = simulate_readings(setup, 120, rng, NOISE)
        values = data.readings[0].values.copy()
        columns = {"z": [2], "y and z": [1, 2]}.get(missing, [])
        values[:, columns] = np.nan
        if missing == "half of the cells":
            values[rng.random(values.shape) < 0.5] = np.nan
        kept = (replace(data.readings[0], values=values), *data.readings[1:]) if len(data.readings) == 1 else data.readings[1:]
        found = fit(setup.robot, replace(data, readings=kept), priors={"joint": SCALE})
        kind = kept[0].noise
        assert found.converged
        assert found.estimate.noise.sigma[0] == pytest.approx(TRUE_NOISE.get(kind, NOISE.length), rel=0.25)
        assert np.abs(standardised(setup, found)).max() < 4.5


def test_the_reference_may_be_known(robots: dict[str, Robot]) -> None:
    """With --reference-known no placement is estimated; where that is not true the residual says so."""
    rng = np.random.default_rng(13)
    known, unknown = (setup_of(CASES[name], robots, rng, model="auto") for name in ("reference known", "pose"))
    options = ModelOptions(reference_known=True)
    for setup, right in ((known, True), (unknown, False)):
        found = fit(setup.robot, simulate_readings(setup, 60, rng, NOISE), options=options, gated=False)
        assert not any(slot.kind == "reference" for slot in found.errors.slots)
        assert (rms_of(found.after) < 0.5) is right


@pytest.mark.parametrize(("model", "per_joint"), [("offset", {}), ("auto", {"elbow_joint": "offset", "wrist_3_joint": "offset"})])
def test_zeros_alone_and_mixed_models_find_their_own_truth(model: str, per_joint: dict[str, str], robots: dict[str, Robot]) -> None:
    """Errors of the zeros, or of some joints' zeros alone, are found in just those parameters."""
    rng = np.random.default_rng(14)
    seen = setup_of(SensorCase("ur5", ("pose:tool0",)), robots, rng)
    options = ModelOptions(error_model=model, per_joint=per_joint)
    errors = build_error_model(seen.robot.chain, seen.robot.rig, options)
    joints = [name for name, parameter in zip(errors.names, errors.parameters, strict=True) if parameter.kind == "joint"]
    if per_joint:
        assert [name for name in joints if name.startswith("elbow_joint.")] == ["elbow_joint.d_theta"]
    else:
        assert all(name.endswith(".d_theta") for name in joints)
    x = rng.normal(0, 1, len(errors.names)) * [SCALE.sigma(unit) for unit in errors.units]
    setup = simulated_setup(seen.robot, errors, x, seen.sensors, rng)
    found = fit(setup.robot, simulate_readings(setup, 60, rng, NOISE), options=options, priors={"joint": SCALE})
    assert found.errors.names == errors.names
    assert np.abs(standardised(setup, found)).max() < 4.5
    assert rms_of(found.after) < 0.3
