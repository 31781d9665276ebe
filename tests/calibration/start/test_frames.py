"""Closed forms find frames, targets and places from nothing; without noise they find them exactly, wherever they stand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
import pytest
from scipy.spatial.transform import Rotation

from tests.support.helpers import assert_poses_close
from tests.support.sensor_cases import CASES, SensorCase, setup_of
from urdfcal.base.closed_form import (
    common_point,
    nearest_rotation,
    plane_through,
    point_and_frame,
    robot_world_hand_eye,
    umeyama,
    wire_end,
)
from urdfcal.base.errors import UsageError
from urdfcal.base.geometry import Array3, Matrix
from urdfcal.calibration.problem import Problem
from urdfcal.calibration.start.frames import place_instruments
from urdfcal.calibration.start.nominal import nominal_fit, with_new_places
from urdfcal.estimation.noise import Noise
from urdfcal.model.gauge import build_error_model
from urdfcal.model.options import ModelOptions, ParameterPrior
from urdfcal.robot.robot import Robot
from urdfcal.sensors.measurements import Measurements, start_sigma
from urdfcal.simulation.readings import simulate_readings
from urdfcal.simulation.setup import SimulatedSetup

ANGLES = [0.0, 1e-6, 0.5, np.pi / 2, np.pi - 1e-2, np.pi - 1e-7, np.pi]


def turned(angle: float, axis: int) -> Matrix:
    """A rotation by an angle about a slanted axis, or about a coordinate axis."""
    direction = np.array([[1.0, 0, 0], [0, 1.0, 0], [0, 0, 1.0], [0.48, -0.6, 0.64]])[axis]
    return np.asarray(Rotation.from_rotvec(angle * direction).as_matrix())


def link_poses(rng: np.random.Generator, count: int = 12) -> tuple[Array3, Matrix]:
    return Rotation.random(count, random_state=rng.integers(2**31)).as_matrix(), rng.normal(0, 0.5, (count, 3))


@pytest.mark.parametrize("axis", range(4))
@pytest.mark.parametrize("angle", ANGLES, ids="{:g} rad".format)
def test_robot_world_and_hand_eye_are_found_together(angle: float, axis: int, rng: np.random.Generator) -> None:
    """Y A_i = B_i X gives back Y and X, half turns of either or both among them."""
    R, b = link_poses(rng)
    for Y_angle, X_angle in ((angle, 0.7), (0.7, angle), (angle, angle)):
        Y, X = pin.SE3(turned(Y_angle, axis), rng.normal(0, 2, 3)), pin.SE3(turned(X_angle, (axis + 1) % 4), rng.normal(0, 0.2, 3))
        A = [Y.actInv(pin.SE3(own, p) * X) for own, p in zip(R, b, strict=True)]
        found = robot_world_hand_eye(R, b, np.array([one.rotation for one in A]), np.array([one.translation for one in A]))
        for actual, desired in zip(found, (Y, X), strict=True):
            assert_poses_close(actual, desired)


@pytest.mark.parametrize("axis", [0, 3])
@pytest.mark.parametrize("angle", [0.0, 1.0, np.pi - 1e-2, np.pi], ids="{:g} rad".format)
def test_a_frame_and_the_offset_of_a_point_are_found_together(angle: float, axis: int, rng: np.random.Generator) -> None:
    """Points alone give the frame and the offset, for offsets of some centimetres and of half a metre."""
    R, b = link_poses(rng, 25)
    for offset in (np.zeros(3), np.array([0.02, -0.05, 0.1]), np.array([-0.4, 0.2, 0.3])):
        Y = pin.SE3(turned(angle, axis), rng.normal(0, 2, 3))
        points = (b + R @ offset - Y.translation) @ Y.rotation
        found, x = point_and_frame(R, b, points)
        assert_poses_close(found, Y, mm=1e-3, mrad=1e-3)
        np.testing.assert_allclose(x, offset, atol=1e-6)


@pytest.mark.parametrize("axis", range(4))
@pytest.mark.parametrize("angle", ANGLES, ids="{:g} rad".format)
def test_umeyama_finds_any_motion(angle: float, axis: int, rng: np.random.Generator) -> None:
    """Points and their images give the motion back: in space, and where they lie in one plane, never with a reflection."""
    Y = pin.SE3(turned(angle, axis), rng.normal(0, 2, 3))
    for thickness in (1.0, 0.0):
        points = rng.normal(0, 1, (6, 3)) * [1, 1, thickness]
        assert_poses_close(umeyama(points, points @ Y.rotation.T + Y.translation), Y)


def test_the_nearest_rotation_is_no_reflection(rng: np.random.Generator) -> None:
    """It is a rotation for any matrix, and agrees with the polar factor where that is one."""
    for _ in range(20):
        R = nearest_rotation(rng.normal(0, 1, (3, 3)))
        np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-14)
        assert np.linalg.det(R) == pytest.approx(1.0)
    exact = turned(2.0, 3)
    np.testing.assert_allclose(nearest_rotation(1.7 * exact), exact, atol=1e-14)


def test_sockets_planes_and_wires_are_found(rng: np.random.Generator) -> None:
    """The common point of several groups of poses, a plane, and the fixed end of a wire come out exactly."""
    R, _ = link_poses(rng, 20)
    x, group = np.array([0.1, -0.2, 0.3]), np.arange(20) % 3
    places = rng.normal(0, 1, (3, 3))
    np.testing.assert_allclose(common_point(R, places[group] - R @ x, group), x, atol=1e-12)
    normal, offset = np.array([0.6, 0, 0.8]), 0.7
    points = rng.normal(0, 1, (9, 3))
    points += np.outer(offset - points @ normal, normal)
    axes, found = plane_through(points)
    sign = np.sign(axes[:, 0] @ normal)
    np.testing.assert_allclose(sign * axes[:, 0], normal, atol=1e-12)
    assert (sign * found, np.linalg.det(axes)) == (pytest.approx(offset), pytest.approx(1.0))
    end = np.array([1.0, 2.0, -0.5])
    np.testing.assert_allclose(wire_end(points, np.linalg.norm(points - end, axis=1))[:2], end[:2], atol=5)  # flat points: no nan
    cloud = rng.normal(0, 1, (9, 3))
    np.testing.assert_allclose(wire_end(cloud, np.linalg.norm(cloud - end, axis=1)), end, atol=1e-9)


def perfect(case: SensorCase, robots: dict[str, Robot], seed: int, poses: int = 40) -> tuple[SimulatedSetup, Measurements]:
    """A robot without any error in its joints, whose instruments stand anywhere."""
    rng = np.random.default_rng(seed)
    setup = setup_of(case, robots, rng, translation=0.0, rotation=0.0)
    return setup, simulate_readings(setup, poses, rng)


CLOSED = [
    "point",
    "pose",
    "socket",
    "touches and points",
    "reference carried",
    "reference known",
    "head camera",
    "hand sees hand",
    "sessions",
]
WIRES = ["distance", "points on the base", "several targets", "every kind"]
STARTS = CASES | {"touches and points": SensorCase("ur5", ("point:tool0", "plane:tool0", "socket:tool0:ball"))}


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("name", [*CLOSED, "lasers and points"])
def test_a_robot_without_errors_is_explained_by_the_start_alone(name: str, seed: int, robots: dict[str, Robot]) -> None:
    """Wherever frames, targets and places stand, what is put in place in closed form leaves nothing over, in no session."""
    setup, data = perfect(STARTS[name], robots, seed)
    options = ModelOptions(reference_known=STARTS[name].known)
    errors = place_instruments(build_error_model(setup.robot.chain, setup.robot.rig, options, data.session_names), data)
    left = Problem(errors, data).linearise(errors.mean).residual
    assert np.abs(left).max() < 2e-6, f"{np.abs(left).max() * 1e3:.3g} mm left"
    for slot, truth in ((own, true) for own in errors.slots for true in setup.errors.slots if own.label == true.label and own.found):
        for session in data.session_names:
            if slot.kind == "reference" or len(slot.names) == 6:
                assert_poses_close(slot.found[session], truth.found[session], mm=5e-3, mrad=5e-3)


@pytest.mark.parametrize("name", WIRES)
def test_wires_need_the_least_squares_behind_the_start(name: str, robots: dict[str, Robot]) -> None:
    """The offset of a wire's target is not in the closed form; the fit of the instruments alone finds it, and nothing is left over."""
    for seed in range(2):
        setup, data = perfect(STARTS[name], robots, seed)
        errors = build_error_model(setup.robot.chain, setup.robot.rig)
        table = nominal_fit(errors, data, Noise(start_sigma(data), np.zeros(len(data.joints)), False)).table(data)
        assert {own: row.max for own, row in table.items() if row.max > 1e-3} == {}


def test_what_is_stated_stays_where_it_is_stated(robots: dict[str, Robot]) -> None:
    """A target whose offset is held, or has a prior of its own, is not moved by the start; the frame is found for it."""
    setup, data = perfect(CASES["point"], robots, 0)
    offset = next(slot.found[""].translation for slot in setup.errors.slots if slot.kind == "target")
    single = {f"tool0.trans_{axis}": ParameterPrior(float(value), None, True) for axis, value in zip("xyz", offset, strict=True)}
    errors = place_instruments(build_error_model(setup.robot.chain, setup.robot.rig, ModelOptions(single=single)), data)
    assert not any(slot.found for slot in errors.slots if slot.kind == "target")
    assert np.abs(Problem(errors, data).linearise(errors.mean).residual).max() < 1e-9
    narrow = {"tool0.trans_x": ParameterPrior(None, 0.01)}
    kept = place_instruments(build_error_model(setup.robot.chain, setup.robot.rig, ModelOptions(single=narrow)), data)
    assert not any(slot.found for slot in kept.slots if slot.kind == "target")


def test_a_plane_of_two_touches_is_refused(robots: dict[str, Robot]) -> None:
    """Three touches are the least that a plane has; fewer are refused by pose and label."""
    setup, data = perfect(CASES["plane"], robots, 0, poses=11)
    with pytest.raises(UsageError, match=r"pose 4: plane .4. is touched twice, expected three times or more"):
        place_instruments(build_error_model(setup.robot.chain, setup.robot.rig), data)


def test_places_of_further_measurements_are_found_with_everything_else_held(robots: dict[str, Robot]) -> None:
    """Sockets that only the test poses touch are put where the fitted robot has them, and the test table means something."""
    setup, data = perfect(CASES["socket"], robots, 0, poses=60)
    touched = data.readings[0].labels
    known, further = data.subset(np.isin(touched, ["1", "2", "3"])), data.subset(touched == "4")
    robot = setup.robot.seen_by(replace(known.instruments, reference=setup.robot.instruments.reference), ())
    noise = Noise(start_sigma(data), np.zeros(6), False)
    nominal = nominal_fit(build_error_model(robot.chain, robot.rig), known, noise)
    errors, x = with_new_places(nominal.errors, nominal.x, further, noise)
    assert errors.names == ("socket:4.x", "socket:4.y", "socket:4.z")
    np.testing.assert_allclose(x, setup.place("socket:4"), atol=1e-7)
    assert nominal.table(further)["tool0:ball socket"].max < 1e-3
