"""J = Jac2 Jac1 of every sensor against differences, and what it predicts against Pinocchio on the corrected robot."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest

from tests.support.helpers import central_differences
from tests.support.sensor_cases import CASES, SensorCase, session_errors, setup_of
from urdfcal.base.geometry import Matrix, Vector
from urdfcal.base.rotations import matrices, rotation_vectors
from urdfcal.calibration.problem import Problem
from urdfcal.model.error_model import with_softness
from urdfcal.model.gravity import Gravity, WeighedRobot
from urdfcal.model.options import ModelOptions
from urdfcal.model.softness import gravity_terms, unit_terms
from urdfcal.robot.configurations import joint_limits
from urdfcal.robot.corrections import OriginCorrection, applied
from urdfcal.robot.robot import Robot
from urdfcal.sensors.measurements import Measurements
from urdfcal.sensors.readings import KnownLength
from urdfcal.simulation.readings import simulate_readings
from urdfcal.simulation.setup import SimulatedSetup

OTHER_MODELS = [(name, model) for name in ("head camera", "hand sees hand", "points on the base") for model in ("dh", "placement")]


def far_state(setup: SimulatedSetup, data: Measurements, model: str, case: SensorCase, rng: np.random.Generator) -> tuple[Problem, Vector]:
    """A model of some measurements, and a state some millimetres and tenths of a degree from the truth and from zero."""
    errors, x = session_errors(setup, ModelOptions(error_model=model, reference_known=case.known), data)
    return Problem(errors, data, joints=True), x + rng.normal(0, 5e-3, len(x))


@pytest.mark.parametrize(("name", "model"), [*((name, "auto") for name in CASES), *OTHER_MODELS])
def test_jacobians_are_the_derivatives_of_what_is_predicted(
    name: str, model: str, robots: dict[str, Robot], rng: np.random.Generator
) -> None:
    """By every parameter of joints, mount, frames, targets and places, away from zero, in every arrangement and session."""
    case = CASES[name]
    setup = setup_of(case, robots, rng)
    data = simulate_readings(setup, 5, rng)
    spots, x = far_state(setup, data, model, case, rng)
    here = spots.linearise(x)
    assert np.abs(here.residual).max() > 1e-3
    numeric = -central_differences(lambda state: spots.linearise(state).residual, x)
    assert here.usable
    np.testing.assert_allclose(here.jacobian, numeric, atol=2e-8 * max(1.0, np.abs(numeric).max()))
    used = np.abs(numeric).max(axis=(0, 1)) > 1e-6
    least = 0.5 if name == "inclination" else 0.7  # it sees no length
    assert used.sum() > least * len(x)  # the parameters do something, or nothing would have been compared


@pytest.mark.parametrize("name", ["sessions", "every kind", "hand sees hand"])
def test_sums_of_parts_are_those_of_the_whole(
    name: str, robots: dict[str, Robot], rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Sums taken part by part, known lengths included, are those of the whole Jacobian, which is the same in parts or if asked for late."""
    setup = setup_of(CASES[name], robots, rng)
    data = simulate_readings(setup, 23, rng)
    lengths = (KnownLength("socket:1", "socket:2", 0.3, 1e-4),) if "socket:1" in {place.name for place in data.instruments.places} else ()
    whole, x = far_state(setup, replace(data, lengths=lengths), "auto", CASES[name], rng)
    whole = replace(whole, joints=False)
    here = whole.linearise(x)
    monkeypatch.setattr("urdfcal.calibration.problem.CHUNK", 4)
    parts = replace(whole).linearise(x)
    np.testing.assert_allclose(parts.jacobian, here.jacobian, atol=1e-12)
    np.testing.assert_allclose(parts.jacobian, replace(whole, joints=True).linearise(x).jacobian, atol=1e-12)
    dense, alone = replace(here, residual=here.residual), replace(whole).residuals(x)
    np.testing.assert_array_equal(alone.residual, parts.residual)
    for own, other in ((parts.sums, dense.sums), (here.sums, dense.sums), (alone.sums, dense.sums)):
        for what in ("plain", "stated", "known"):
            expected = getattr(other, what)
            np.testing.assert_allclose(getattr(own, what), expected, atol=1e-12 * max(1.0, np.abs(expected).max()))


@pytest.mark.parametrize("name", ["every kind", "hand sees hand", "reference carried", "head camera"])
def test_turns_of_joints_are_what_soft_joints_do(name: str, robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """About its own axis and the two across it, also of joints that are walked backward, and of such that give way already."""
    setup = setup_of(CASES[name], robots, rng)
    data = simulate_readings(setup, 5, rng)
    spots, x = far_state(setup, data, "auto", CASES[name], rng)
    weighed, chain, tip = WeighedRobot(setup.robot, Gravity()), setup.robot.chain, setup.robot.rig.tip
    units, sag = unit_terms(chain), gravity_terms(chain, weighed.moments(data.q))
    for before in ((), sag):
        errors = with_softness(spots.errors, before, weighed, tip) if before else spots.errors
        at = np.concatenate([x, rng.normal(0, 1e-3, len(before))])
        found = np.concatenate([turns for *_, turns in Problem(errors, data).by_parts(at)], axis=2)
        softer = with_softness(spots.errors, (*before, *units), weighed, tip)
        expected = Problem(softer, data).jacobian(np.concatenate([at, np.zeros(len(units))]))[:, :, len(at) :]
        np.testing.assert_allclose(found.transpose(2, 1, 0), expected, atol=1e-12 * np.abs(expected).max())


@pytest.mark.parametrize("name", CASES)
def test_joint_jacobians_are_the_derivatives_by_the_joints_readings(name: str, robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """By every measured joint: mimic joints, slides, and joints that carry the reference, walked backward."""
    case = CASES[name]
    setup = setup_of(case, robots, rng)
    data = simulate_readings(setup, 5, rng)
    spots, x = far_state(setup, data, "auto", case, rng)

    def residual(shift: Vector) -> Matrix:
        return Problem(spots.errors, replace(data, q=data.q + shift)).linearise(x).residual

    numeric = -central_differences(residual, np.zeros(len(data.joints)))
    here = spots.linearise(x)
    np.testing.assert_allclose(here.joint_jacobian, numeric, atol=2e-8 * max(1.0, np.abs(numeric).max()))


@pytest.mark.parametrize("name", CASES)
def test_simulated_readings_are_pinocchios(name: str, robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Without noise every reading is what forward kinematics of the corrected robot gives with frame, offset and places at their truth."""
    setup = setup_of(CASES[name], robots, rng)
    data = simulate_readings(setup, 8, rng)
    joints = setup.robot.tree.joints
    corrections = {
        joint: OriginCorrection(joints[joint].origin, origin, joints[joint].moves)
        for joint, origin in setup.errors.corrected_origins(setup.x).items()
    }
    model = applied(setup.robot.model, (), corrections)
    found = {slot.label if slot.kind == "target" else slot.kind: slot.found for slot in setup.errors.slots}
    limits = joint_limits(setup.robot)
    assert ((data.q >= limits[0]) & (data.q <= limits[1])).all()
    for reading in (each for each in data.readings if not each.kind.beam):
        for pose, session in enumerate(data.sessions):
            frames = [placed(setup.robot, model, data.q[pose], link) for link in (setup.robot.rig.instruments.reference, reading.link)]
            Y = found.get("reference", {}).get(session, pin.SE3.Identity())
            T = (frames[0] * Y).actInv(frames[1]) * found[reading.target][session]
            assert off(setup, reading, pose, T) < 1e-9, (reading.sensor, pose)


def placed(robot: Robot, model: pin.Model, q: Vector, link: str) -> pin.SE3:
    """Placement of a link in Pinocchio's model of the whole robot; joints that were not measured stay at neutral, mimics follow."""
    data, full = model.createData(), pin.neutral(model)
    value = dict(zip(robot.chain.input_names, q.tolist(), strict=True))
    for own in robot.tree.joints.values():
        if own.mimic is not None and own.mimic.joint in value:
            value[own.name] = own.mimic.multiplier * value[own.mimic.joint] + own.mimic.offset
    for joint, angle in value.items():
        index = model.joints[model.getJointId(joint)]
        full[index.idx_q : index.idx_q + index.nq] = [angle] if index.nq == 1 else [np.cos(angle), np.sin(angle)]
    pin.framesForwardKinematics(model, data, full)
    return data.oMf[model.getFrameId(link)]


def off(setup: SimulatedSetup, reading, pose: int, T: pin.SE3) -> float:
    """How far a reading is from the target's pose in the measuring frame, [m] or [rad]."""
    if reading.sensor == "point":
        return float(np.linalg.norm(reading.values[pose] - T.translation))
    if reading.sensor == "orientation":
        return float(np.linalg.norm(rotation_vectors((matrices(reading.values[pose][None])[0] @ T.rotation.T)[None])))
    if reading.sensor == "distance":
        return abs(float(reading.values[pose, 0] - np.linalg.norm(T.translation - setup.place(f"{reading.target}:wire"))))
    if not reading.labels[pose]:
        return 0.0
    name = f"{reading.sensor}:{reading.labels[pose]}"
    if reading.sensor == "socket":
        return float(np.linalg.norm(T.translation - setup.place(name)))
    return abs(float(setup.errors.planes[name][:, 0] @ T.translation - setup.place(name)[2]))


def test_what_was_not_read_counts_for_nothing(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """A missing axis of a point has no residual, no derivative and no count; the other axes are as they were."""
    case = CASES["several targets"]
    setup = setup_of(case, robots, rng)
    data = simulate_readings(setup, 5, rng)
    values = data.readings[0].values.copy()
    values[2, 1], values[3] = np.nan, np.nan
    less = replace(data, readings=(replace(data.readings[0], values=values), *data.readings[1:]))
    (whole, x), (partly, _) = (far_state(setup, each, "auto", case, np.random.default_rng(0)) for each in (data, less))
    all_of, some = whole.linearise(x), partly.linearise(x)
    gone = np.zeros_like(all_of.measured)
    gone[2, 1], gone[3, :3] = True, True
    assert not some.measured[gone].any()
    assert not some.residual[gone].any()
    assert not some.jacobian[gone].any()
    assert not some.joint_jacobian[gone].any()
    np.testing.assert_array_equal(some.jacobian[~gone], all_of.jacobian[~gone])
    assert some.count == all_of.count - 4 == less.numbers


def test_known_lengths_and_held_sums_are_rows_of_their_own(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """A distance between sockets, and a sum that is held, have the residual, derivative and sigma that they should have."""
    case = CASES["socket"]
    setup = setup_of(case, robots, rng)
    data = simulate_readings(setup, 8, rng)
    apart = float(np.linalg.norm(setup.place("socket:1") - setup.place("socket:2")))
    data = replace(data, lengths=(KnownLength("socket:1", "socket:2", apart, 3e-5),))
    errors, x = session_errors(setup, ModelOptions(), data)
    weights = {"elbow_joint.d_a": 0.6, "wrist_1_joint.d_a": 0.8}
    spots = Problem(replace(errors, held_sum=weights), data)
    known = spots.linearise(x)
    assert known.residual.shape[0] == 10
    np.testing.assert_allclose(known.residual[8:], 0.0, atol=1e-12)
    x = x + rng.normal(0, 5e-3, len(x))
    here = spots.linearise(x)
    numeric = -central_differences(lambda state: spots.linearise(state).residual, x)
    np.testing.assert_allclose(here.jacobian, numeric, atol=1e-8)
    assert (here.stated_sigma[8, 0], here.measured[8:].sum(), here.measured[8:, 0].all()) == (3e-5, 2, True)
    total = sum(weight * x[errors.names.index(name)] for name, weight in weights.items())
    assert here.residual[9, 0] == pytest.approx(-total)


def test_a_plane_may_be_held(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Places that are fixed keep their stated numbers, and have no columns."""
    case = CASES["plane"]
    setup = setup_of(case, robots, rng)
    data = simulate_readings(setup, 8, rng)
    errors, x = session_errors(setup, ModelOptions(), data)
    free = np.array([not name.startswith("plane:2.") for name in errors.names])
    held = {name: float(value) for name, value, kept in zip(errors.names, x, free, strict=True) if not kept}
    fewer = replace(errors, parameters=tuple(own for own, kept in zip(errors.parameters, free, strict=True) if kept), held=held)
    whole, part = Problem(errors, data).linearise(x), Problem(fewer, data).linearise(x[free])
    np.testing.assert_array_equal(part.residual, whole.residual)
    np.testing.assert_array_equal(part.jacobian, whole.jacobian[..., free])


def test_blocks_name_what_was_measured(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Every spot, point, orientation, distance and touch is a block of its own, with its own kind of noise and unit."""
    setup = setup_of(CASES["every kind"], robots, rng)
    data = simulate_readings(setup, 10, rng)
    spots = Problem(session_errors(setup, ModelOptions(), data)[0], data)
    blocks = [(block.name, block.columns.stop - block.columns.start, data.kinds[block.kind], block.unit) for block in spots.blocks]
    assert blocks == [
        ("laser_1", 2, "spot", "mm"),
        ("laser_2", 2, "spot", "mm"),
        ("tool0", 3, "point", "mm"),
        ("wrist_1_link", 3, "point", "mm"),
        ("wrist_1_link orientation", 3, "orientation", "deg"),
        ("slm:bar distance", 1, "distance", "mm"),
        ("tool0:probe plane", 1, "plane", "mm"),
        ("tool0:ball socket", 3, "socket", "mm"),
    ]
    columns = np.concatenate([np.arange(block.columns.start, block.columns.stop) for block in spots.blocks])
    np.testing.assert_array_equal(columns, np.arange(spots.measured.shape[1]))
