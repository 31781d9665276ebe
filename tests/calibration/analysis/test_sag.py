"""Gravity sag beside geometry: found where it is, and only there."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
import yaml

import urdfcal
from tests.conftest import CliResult
from tests.support.paths import ROOT
from tests.support.small_robot import joint, robot_of, robot_text
from urdfcal.api import Calibration
from urdfcal.base.errors import UsageError
from urdfcal.base.geometry import DEG, MM, Vector
from urdfcal.base.minus import with_minus
from urdfcal.base.terminal import as_text
from urdfcal.calibration.analysis.sag import HeldOut, SagFit, _Setup, estimated_gravity, fit_sag
from urdfcal.calibration.error_table import error_table, rms_of
from urdfcal.calibration.problem import Problem
from urdfcal.calibration.richer import log_evidence
from urdfcal.estimation.ekf import Belief, Estimate
from urdfcal.estimation.noise import Noise
from urdfcal.estimation.residual import Linearisation
from urdfcal.model.error_model import ErrorModel
from urdfcal.model.gravity import Gravity
from urdfcal.model.parameters import Parameter
from urdfcal.output.text.sag import deflections, sag_blocks, sag_json, sag_words
from urdfcal.robot.robot import Robot
from urdfcal.sensors.measurements import Measurements
from urdfcal.simulation.readings import ReadingNoise, simulate_readings
from urdfcal.simulation.setup import parse_sensors, seen_with, simulated_setup
from urdfcal.simulation.truth import SagScales, random_truth, sag_scales, soft_truth

NOISE = ReadingNoise(length=0.05 * MM, angle=0.01 * DEG)
SOFT = SagScales(own=1e-3, across=0.5e-3)


def measured(robot: Robot, scales: SagScales, poses: int = 60, tests: int = 200) -> tuple[Calibration, Measurements, dict[str, float]]:
    """Geometry alone, fitted to simulated poses of a robot with errors and sag; further poses; compliances by name, [rad/(N m)]."""
    rng = np.random.default_rng(3)
    link = robot.tree.joints[robot.chain.moving[-1].joint.name].child
    sensors, _ = parse_sensors([f"pose:{link}"], robot, 1)
    seen = seen_with(robot, sensors)
    errors, x = random_truth(seen, rng, 0.5 * MM, 0.5e-3)
    errors, x = soft_truth(seen, errors, x, scales, rng) if scales else (errors, x)
    data = simulate_readings(simulated_setup(seen, errors, x, sensors, rng), poses + tests, rng, NOISE)
    terms = errors.soft.terms if errors.soft is not None else ()
    truth = {term.name: float(x[errors.names.index(term.name)]) / (term.largest or 1.0) for term in terms}
    return urdfcal.fit(seen, data.subset(np.arange(poses))), data.subset(np.arange(poses, poses + tests)), truth


@pytest.fixture(scope="module")
def soft_panda(robots: dict[str, Robot]) -> tuple[Calibration, Measurements, dict[str, float]]:
    return measured(robots["panda"], SOFT)


@pytest.fixture(scope="module")
def sagging(soft_panda: tuple[Calibration, Measurements, dict[str, float]]) -> SagFit:
    sag = fit_sag(soft_panda[0])
    assert sag is not None
    return sag


def rms(errors: ErrorModel, x: Vector, test: Measurements) -> float:
    return rms_of(error_table(Problem(errors, test).linearise(x), len(test)))


def test_sag_is_found(soft_panda: tuple[Calibration, Measurements, dict[str, float]], sagging: SagFit) -> None:
    """Held-out poses are predicted twice as well or better, k-fold says so too, and the compliances are those of the truth."""
    calibration, test, truth = soft_panda
    alone, both = rms(calibration.errors, calibration.x, test), rms(sagging.errors, sagging.estimate.belief.x, test)
    assert both < alone / 2
    assert both < 2.2 * NOISE.length / MM
    assert sagging.held_out is not None
    assert sagging.held_out.ratio == pytest.approx(both / alone, rel=0.35)
    assert sagging.gain > 100
    assert not sagging.warnings
    inside = []
    for term in sagging.softness.terms:
        value, sigma = sagging.soft_values[term.name]
        inside.append(abs(value - truth[term.name] * term.largest) < 1.96 * sigma)
    assert np.mean(inside) > 0.8


def test_a_rigid_arm_loses_nothing(robots: dict[str, Robot]) -> None:
    """With no sag in the truth the evidence gains next to nothing, and held-out poses lose less than 3 %."""
    calibration, test, _ = measured(robots["panda"], SagScales())
    sag = fit_sag(calibration, folds=0)
    assert sag is not None
    assert rms(sag.errors, sag.estimate.belief.x, test) < 1.03 * rms(calibration.errors, calibration.x, test)
    assert sag.gain < 3
    assert sag.warnings == ()
    assert "not worth a compensation" in as_text(sag_blocks(sag))


def test_deflections_are_told_as_they_are(soft_panda: tuple[Calibration, Measurements, dict[str, float]], sagging: SagFit) -> None:
    """The largest deflection of each joint is that of the compensation, and its millimetres those of the joint bent alone."""
    told = {each.joint: each for each in deflections(sagging)}
    terms, data = sagging.softness.terms, sagging.calibration.data
    angles = sagging.softness.basis(data.q) * [sagging.soft_values[term.name][0] for term in terms]
    names = [sagging.softness.chain.moving[term.joint].joint.name for term in terms]
    for one in set(names):
        own = [name == one for name in names]
        assert told[one].mrad == pytest.approx(1e3 * np.linalg.norm(angles[:, own], axis=1).max())
    errors, x = sagging.errors, sagging.estimate.belief.x
    model = Problem(errors, sagging.calibration.data)
    joint = names[3]
    still = x.copy()
    still[[errors.names.index(term.name) for term, name in zip(terms, names, strict=True) if name == joint]] = 0.0
    tip = [model.motion(state).frames[1][:, :, 3] for state in (x, still)]
    moved = np.linalg.norm(tip[0] - tip[1], axis=1).max() / MM
    assert told[joint].tool_mm == pytest.approx(moved, rel=0.01)
    text = " ".join(as_text(sag_blocks(sagging)).split())
    assert "--compensation FILE.yaml writes it" in text
    assert "written to c.yaml" in as_text(sag_blocks(sagging, "c.yaml"))
    assert with_minus(sag_words(sagging)) in text
    told_to_machines = json.loads(json.dumps(sag_json(sagging)))
    assert told_to_machines["held_out"]["folds"] == 5
    assert len(told_to_machines["parameters"]) == len(terms)


def test_the_data_say_where_down_is(robots: dict[str, Robot]) -> None:
    """On a robot that hangs on a wall the default direction draws a warning, and the estimate finds the true one within 8 deg."""
    truth = np.array([0.1, 0.98, -0.17])
    truth /= np.linalg.norm(truth)
    x, y, z = truth.tolist()
    calibration, _, _ = measured(robots["ur5"], replace(SOFT, gravity=Gravity((x, y, z))), poses=40, tests=1)
    wrong = fit_sag(calibration, folds=0)
    assert wrong is not None
    assert len(wrong.warnings) == 1
    assert wrong.warnings[0].startswith("the data prefer gravity along y of 'world' to the direction that was used (log evidence +")
    found = estimated_gravity(calibration)
    assert np.degrees(np.arccos(np.dot(found.direction, truth))) < 8
    right = fit_sag(calibration, found, folds=0)
    assert right is not None
    assert right.gain > wrong.gain + 10
    assert right.warnings == ()


def test_gravity_is_doubted_only_where_held_out_poses_gain(robots: dict[str, Robot], monkeypatch: pytest.MonkeyPatch) -> None:
    """Evidence for another direction is no reason to doubt the stated one if poses that were not fitted are no better for it."""
    calibration, _, _ = measured(robots["ur5"], replace(SOFT, gravity=Gravity((0.0, 1.0, 0.0))), poses=40, tests=1)
    doubted = fit_sag(calibration, folds=0)
    assert doubted is not None
    assert re.search(r"prefer gravity along y .*held-out poses \u2212\d+ %", doubted.warnings[0])
    monkeypatch.setattr(_Setup, "held_out", lambda *_: HeldOut(1.0, 1.001, 5, "mm", 1.0))
    trusted = fit_sag(calibration, folds=0)
    assert trusted is not None
    assert trusted.warnings == ()


def test_a_hanging_robot_bends_the_other_way(robots: dict[str, Robot]) -> None:
    """Upside down the same axes are loaded, so the evidence is the same; the signs of the deflections tell, and a warning says so."""
    calibration, _, _ = measured(robots["ur5"], replace(SOFT, gravity=Gravity((0.0, 0.0, 1.0))), poses=40, tests=1)
    sag = fit_sag(calibration, folds=0)
    assert sag is not None
    assert sag.warnings == (
        "the joints bend against gravity; does the robot hang from its root link 'world'? say --gravity X,Y,Z if it does",
    )


def test_terms_on_request_earn_their_place(
    robots: dict[str, Robot], soft_panda: tuple[Calibration, Measurements, dict[str, float]]
) -> None:
    """Eccentric joints are found and help; the same terms are left out where the truth has none, and so are scale and approach."""
    calibration, test, _ = measured(robots["panda"], replace(SOFT, eccentricity=2e-3))
    plain, sag = (fit_sag(calibration, folds=0, compare_directions=False, extras=extras) for extras in ((), ("eccentricity", "scale")))
    assert plain is not None
    assert sag is not None
    assert "eccentricity" not in sag.dropped
    assert any(name.endswith(".ecc_sin2") for name in sag.errors.names)
    assert rms(sag.errors, sag.estimate.belief.x, test) < 0.5 * rms(plain.errors, plain.estimate.belief.x, test)
    without = fit_sag(soft_panda[0], folds=0, extras=("approach", "eccentricity", "scale"))
    assert without is not None
    assert without.dropped == ("scale", "eccentricity", "approach") or set(without.dropped) == {"scale", "eccentricity"}
    assert "eccentricity" in as_text(sag_blocks(without))


GANTRY = robot_text(
    joint("x", "base", "a", '<origin xyz="0 0 1"/><axis xyz="1 0 0"/>', kind="prismatic"),
    joint("y", "a", "b", '<origin xyz="0 0.1 0"/><axis xyz="0 1 0"/>', kind="prismatic"),
    joint("z", "b", "tool0", '<origin xyz="0.05 0 -0.1"/><axis xyz="0 0 -1"/>', kind="prismatic"),
    links="base a b tool0",
)


def test_a_slide_that_is_read_too_long_is_found(tmp_path: Path, rng: np.random.Generator) -> None:
    """A gantry whose belt is 0.3 % long: found within its sigma, told in per cent, and made up for by commands that are as much shorter."""
    q = rng.uniform(0, 1, (40, 3))
    tool = q * [1.003, 1, -1] + [0.05, 0.1, 0.9]
    seen = tool @ pin.exp3(np.array([0.3, -0.2, 1.0])).T + [1.0, 2.0, 0.5] + rng.normal(0, 2e-5, (40, 3))
    np.savetxt(tmp_path / "m.csv", np.hstack([q, seen]), "%.9f", ",", header="x,y,z,tool0.x,tool0.y,tool0.z", comments="")
    robot = robot_of(GANTRY)
    sag = fit_sag(urdfcal.fit(robot, urdfcal.read_measurements(tmp_path / "m.csv", robot)), extras=("scale",), compare_directions=False)
    assert sag is not None
    assert sag.kept == ("scale",)
    value, sigma = sag.soft_values["x.scale"]
    assert abs(value - 0.003) < 4 * sigma < 1e-4
    assert sag.held_out is not None
    assert sag.held_out.sag < 0.05 < 0.3 < sag.held_out.geometry
    told = as_text(sag_blocks(sag))
    assert "+0.300" in told.split("x.scale")[1].split("%")[0] or "+0.299" in told.split("x.scale")[1].split("%")[0]
    assert next(own for own in sag_json(sag)["parameters"] if own["name"] == "x.scale")["unit"] == "1"
    assert sag.compensation().command(np.array([0.5, 0.5, 0.5]))[0] == pytest.approx(0.5 / (1 + value), abs=1e-5)


def test_stated_priors_of_single_parameters_stay(robots: dict[str, Robot]) -> None:
    """The joint fit chooses the scales again, but not those that the user stated."""
    calibration, _, _ = measured(robots["ur5"], SOFT, poses=40, tests=1)
    assert calibration.evidence is not None
    kept = replace(calibration.evidence, groups=("", *calibration.evidence.groups[1:]))
    parameters = (replace(calibration.errors.parameters[0], sigma=0.123), *calibration.errors.parameters[1:])
    stated = replace(calibration, evidence=kept, errors=replace(calibration.errors, parameters=parameters))
    sag = fit_sag(stated, folds=0, compare_directions=False)
    assert sag is not None
    assert sag.errors.parameters[0].sigma == 0.123
    assert sag.errors.parameters[1].sigma != calibration.errors.parameters[1].sigma


@pytest.mark.parametrize("jittery", [False, True], ids=["", "joint noise"])
def test_log_evidence_is_the_gaussians(jittery: bool, robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """On a linear problem it is log N(y; J m, J P0 J' + R), less the constant."""
    n, m, p, sigma, joint_sigma = 7, 3, 4, 0.3, np.array([0.2, 0.1]) * jittery
    J, Jq, y = rng.normal(size=(n, m, p)), rng.normal(size=(n, m, 2)), rng.normal(size=(n, m))
    prior = rng.uniform(0.1, 2, p)
    mean = rng.normal(size=p)
    parameters = tuple(Parameter(f"j.{k}", "m", "joint", float(mean[k]), float(prior[k])) for k in range(p))
    errors = ErrorModel(robots["ur5"].chain, (), parameters)
    R = np.zeros((n * m, n * m))
    for pose in range(n):
        own = slice(m * pose, m * pose + m)
        R[own, own] = sigma**2 * np.eye(m) + Jq[pose] @ np.diag(joint_sigma**2) @ Jq[pose].T
    H = J.reshape(-1, p)
    P = np.linalg.inv(H.T @ np.linalg.solve(R, H) + np.diag(prior**-2.0))
    x = P @ (H.T @ np.linalg.solve(R, y.ravel()) + mean / prior**2)
    S = H @ np.diag(prior**2) @ H.T + R
    r = y.ravel() - H @ mean
    expected = -0.5 * (r @ np.linalg.solve(S, r) + np.linalg.slogdet(S)[1])
    here = Linearisation(y - J @ x, J, Jq, np.ones((n, m), dtype=bool), np.full((n, m), np.nan))
    found = Estimate(Belief(x, 3 * P), "converged", Noise(sigma, joint_sigma))  # a covariance that knows more is no matter
    assert log_evidence(here, found, errors) == pytest.approx(expected, abs=1e-9)


def test_payloads_of_poses_are_part_of_the_model(robots: dict[str, Robot]) -> None:
    """An arm that carries 3 kg in half of its poses is explained by the payload column, and worse without it."""
    robot = robots["ur5"]
    calibration, _, _ = measured(robot, replace(SOFT, gravity=Gravity(payloads={"wrist_3_link": 3.0})), poses=40, tests=1)
    data = replace(calibration.data, payload=np.full(len(calibration.data), 3.0))
    known, unknown = (fit_sag(replace(calibration, data=each), folds=0, compare_directions=False) for each in (data, calibration.data))
    stated = fit_sag(calibration, Gravity(payloads={"wrist_3_link": 3.0}), folds=0, compare_directions=False)
    assert known is not None
    assert unknown is not None
    assert stated is not None
    assert known.gain > unknown.gain
    assert known.gain == pytest.approx(stated.gain, rel=0.05)  # its scales are those of the bare arm


def test_a_simulated_truth_is_written_and_refused(tmp_path: Path, run_cli: Callable[..., CliResult]) -> None:
    """`simulate --sag-mrad` writes each deflection with its moment; scales below zero and gravity on a rigid robot are refused."""
    panda = str(ROOT / "robots/panda/panda.urdf.xacro")
    soft = ["--sag-mrad", "1", "--sag-across-mrad", "0.5", "--gravity", "0,3,-4", "--payload", "2@panda_link8"]
    assert run_cli("simulate", panda, "-o", "s.csv", "--poses", "5", *soft).code == 0
    sag = yaml.safe_load((tmp_path / "s_truth.yaml").read_text())["sag"]
    assert sag["gravity"] == {"direction": [0.0, 0.6, -0.8], "payloads_kg": {"panda_link8": 2.0}}
    assert sag["deflections"]["panda_joint2.sag"]["value"] > 0
    assert sag["deflections"]["panda_joint2.sag"]["at_moment_Nm"] > 10
    assert "sag 1 mrad, sag-across 0.5 mrad" in (tmp_path / "s.csv").read_text()
    assert run_cli("simulate", panda, "-o", "t.csv", "--poses", "5", "--errors", "s_truth.yaml").code == 0
    refused = run_cli("simulate", panda, "-o", "u.csv", "--payload", "2@panda_link8")
    assert (refused.code, "bend no rigid robot" in refused.err) == (2, True)
    with pytest.raises(UsageError, match=r"--sag-across-mrad -1: expected a deflection in mrad, zero or above"):
        sag_scales(1.0, -1.0, 0.0)


def test_the_command_line_tells_writes_and_refuses(tmp_path: Path, run_cli: Callable[..., CliResult]) -> None:
    """fit says what sag gains and writes the pair; --no-sag is silent of it; options that mean nothing are refused in one line."""
    panda = str(ROOT / "robots/panda/panda.urdf.xacro")
    assert run_cli("simulate", panda, "-o", "s.csv", "--sag-mrad", "1", "--spot-noise-mm", "0.2").code == 0
    told = run_cli("fit", panda, "s.csv", "--compensation", "sag.yaml")
    assert told.code == 0, told.err
    assert "Sag: gravity along (0, 0, \u22121) of 'panda_link0', the URDF's masses" in told.out
    compensation = urdfcal.load_compensation(tmp_path / "sag.yaml")
    assert compensation.joints == tuple(f"panda_joint{number}" for number in range(1, 8))
    assert (tmp_path / "sag.urdf").is_file()
    assert (tmp_path / "panda_calibrated.urdf").read_bytes() != (tmp_path / "sag.urdf").read_bytes()
    pair = "sag.urdf belongs to sag.yaml: use the two together, and neither with another file"
    assert f"{pair}; panda_calibrated.urdf is geometry alone and stands by itself" in " ".join(told.out.split())
    short = compensation.shortfall()
    assert short.words in " ".join(told.out.split())
    written = yaml.safe_load((tmp_path / "sag.yaml").read_text())["joint_positions_fall_short_mm"]
    assert written == pytest.approx(short.in_mm(), rel=1e-6)
    rigid = run_cli("fit", panda, "s.csv", "--no-sag", "-o", "other.urdf")
    assert "Sag" not in rigid.out
    assert (tmp_path / "other.urdf").read_bytes() == (tmp_path / "panda_calibrated.urdf").read_bytes()
    for words in (["--also", "magic"], ["--gravity", "up"], ["--payload", "2@nothing"]):
        refused = run_cli("fit", panda, "s.csv", "-o", "no.urdf", *words)
        assert refused.code == 2, words
        assert refused.err.count("\n") == 1, refused.err
        assert not (tmp_path / "no.urdf").exists()
