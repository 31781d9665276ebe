"""Sensors of targets against finite differences of their own residual, and their rotations against SciPy's."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from urdfcal.base.geometry import Array3, Matrix, Vector
from urdfcal.base.rotations import inverse_right_jacobian, matrices, rotation_vectors, skew
from urdfcal.sensors.registry import SENSORS
from urdfcal.sensors.sensor import View

STEP = 1e-6
POSES = 7
PLACES = {"point": 0, "orientation": 0, "distance": 3, "plane": 3, "socket": 3, "inclination": 2}
VALUES = {"point": 3, "orientation": 4, "distance": 1, "plane": 0, "socket": 0, "inclination": 2}
ANGLES = [0.0, 1e-12, 1e-9, 1e-5, 9e-5, 1.1e-4, 1e-2, 1.0, 3.0, np.pi - 1e-2, np.pi - 2e-3]
KINDS = sorted(PLACES)


def view_of(kind: str, rng: np.random.Generator) -> View:
    axes = Rotation.random(POSES, random_state=rng.integers(2**31)).as_matrix()
    turned = Rotation.random(POSES, random_state=rng.integers(2**31)).as_matrix()
    return View(rng.normal(0, 1, (POSES, 3)), turned, rng.normal(0, 0.3, (POSES, PLACES[kind])), axes)


def values_of(kind: str, view: View, rng: np.random.Generator) -> Matrix:
    """Readings near what the target shows; orientations up to 0.5 rad off, so that their right Jacobian matters."""
    if kind == "orientation":
        off = Rotation.from_rotvec(rng.normal(0, 0.3, (POSES, 3))) * Rotation.from_matrix(view.R)
        return off.as_quat()
    if kind == "inclination":
        return SENSORS[kind].read(view) + rng.normal(0, 0.3, (POSES, 2))
    return rng.normal(0, 1, (POSES, VALUES[kind]))


def moved(view: View, twist: Vector) -> View:
    """The target displaced along a twist that is a pure translation or a pure rotation about the measuring frame's origin."""
    turn = Rotation.from_rotvec(twist[3:]).as_matrix()
    return View(view.p @ turn.T + twist[:3], turn @ view.R, view.place, view.axes)


@pytest.mark.parametrize("kind", KINDS)
def test_jac2_is_the_derivative_by_the_targets_twist(kind: str, rng: np.random.Generator) -> None:
    """Jac2 of every sensor equals central differences of h = m - residual along each unit twist, away from a zero residual."""
    view = view_of(kind, rng)
    values, sensor = values_of(kind, view, rng), SENSORS[kind]
    look = sensor.look(view, values)
    assert look.residual.shape == (POSES, sensor.numbers)
    assert np.abs(look.residual).max() > 0.1
    for column, unit in enumerate(np.eye(6)):
        ahead, behind = (sensor.look(moved(view, sign * STEP * unit), values).residual for sign in (1.0, -1.0))
        np.testing.assert_allclose(look.jac2[:, :, column], -(ahead - behind) / (2 * STEP), atol=1e-8)


@pytest.mark.parametrize("kind", KINDS)
def test_places_have_their_derivatives(kind: str, rng: np.random.Generator) -> None:
    """The derivative by a place's numbers equals central differences: tilted planes, sockets, ends of wires."""
    view = view_of(kind, rng)
    values, sensor = values_of(kind, view, rng), SENSORS[kind]
    by_place = sensor.look(view, values).by_place
    if not PLACES[kind]:
        assert by_place is None
        return
    assert by_place.shape == (POSES, sensor.numbers, PLACES[kind])
    for column, unit in enumerate(np.eye(PLACES[kind])):
        ahead, behind = (
            sensor.look(View(view.p, view.R, view.place + sign * STEP * unit, view.axes), values).residual for sign in (1.0, -1.0)
        )
        np.testing.assert_allclose(by_place[:, :, column], -(ahead - behind) / (2 * STEP), atol=1e-8)


def test_what_each_sensor_reads(rng: np.random.Generator) -> None:
    """Residuals vanish at what the sensors' definitions say, written down here a second time."""
    p, R = rng.normal(0, 1, (POSES, 3)), Rotation.random(POSES, random_state=1)
    end, normal, offset = np.array([0.4, -0.2, 0.7]), np.array([0.6, 0.0, 0.8]), 0.3
    axes = np.column_stack([normal, [0.0, 1.0, 0.0], [-0.8, 0.0, 0.6]])
    on_plane = p - np.outer(p @ normal - offset, normal)
    still = np.tile(axes, (POSES, 1, 1))
    cases = {
        "point": (p, np.empty((POSES, 0)), p),
        "orientation": (p, np.empty((POSES, 0)), R.as_quat()),
        "distance": (p, np.tile(end, (POSES, 1)), np.linalg.norm(p - end, axis=1)[:, None]),
        "plane": (on_plane, np.tile([0.0, 0.0, offset], (POSES, 1)), np.empty((POSES, 0))),
        "socket": (np.tile(end, (POSES, 1)), np.tile(end, (POSES, 1)), np.empty((POSES, 0))),
    }
    for kind, (point, place, values) in cases.items():
        look = SENSORS[kind].look(View(point, R.as_matrix(), place, still), values)
        np.testing.assert_allclose(look.residual, 0.0, atol=1e-14, err_msg=kind)


def test_residuals_have_the_sign_and_size_of_what_is_off(rng: np.random.Generator) -> None:
    """A point 1 mm beyond, an orientation 2 mrad beyond, a distance 1 mm long and a tip 1 mm short of its plane say so."""
    p, unit = np.array([[1.0, 2.0, 2.0]]), np.eye(3)[None]
    assert SENSORS["point"].look(View(p, unit, np.empty((1, 0)), unit), p + np.array([0.001, 0, 0])).residual[0, 0] == pytest.approx(0.001)
    turned = Rotation.from_rotvec([[0, 0.002, 0]]).as_quat()
    assert SENSORS["orientation"].look(View(p, unit, np.empty((1, 0)), unit), turned).residual[0] == pytest.approx([0, 0.002, 0])
    assert SENSORS["distance"].look(View(p, unit, np.zeros((1, 3)), unit), np.array([[3.001]])).residual[0, 0] == pytest.approx(0.001)
    assert SENSORS["plane"].look(View(p, unit, np.array([[0, 0, 1.001]]), unit), np.empty((1, 0))).residual[0, 0] == pytest.approx(0.001)


def test_a_target_at_the_end_of_its_wire_is_no_trouble() -> None:
    """Where the distance is zero there is no direction, but no nan either."""
    p = np.ones((1, 3))
    look = SENSORS["distance"].look(View(p, np.eye(3)[None], p, np.eye(3)[None]), np.array([[0.5]]))
    assert np.isfinite(look.residual).all()
    assert np.isfinite(look.jac2).all()


@pytest.mark.parametrize("angle", ANGLES, ids="{:g} rad".format)
def test_logarithms_are_scipys(angle: float, rng: np.random.Generator) -> None:
    """Rotation vectors agree with SciPy's from zero to nearly half a turn."""
    vectors = angle * unit_vectors(rng)
    np.testing.assert_allclose(rotation_vectors(Rotation.from_rotvec(vectors).as_matrix()), vectors, atol=1e-12)


def test_half_turns_have_a_logarithm_of_half_a_turn(rng: np.random.Generator) -> None:
    """At and within rounding of half a turn the axis is right up to its sign, which is free there."""
    axes = np.vstack([np.eye(3), unit_vectors(rng)])
    for angle in (np.pi, np.pi - 1e-9, np.pi - 1e-6, np.pi - 1e-4):
        found = rotation_vectors(Rotation.from_rotvec(angle * axes).as_matrix())
        np.testing.assert_allclose(np.abs(np.sum(found * axes, axis=1)), angle, atol=1e-7)
        np.testing.assert_allclose(np.linalg.norm(found, axis=1), angle, atol=1e-7)


@pytest.mark.parametrize("angle", ANGLES, ids="{:g} rad".format)
def test_the_inverse_right_jacobian_is_that_of_the_logarithm(angle: float, rng: np.random.Generator) -> None:
    """log(exp(e) exp(d)) = e + Jr^-1(e) d, by differences from zero to nearly half a turn."""
    e = angle * unit_vectors(rng)
    for column, unit in enumerate(np.eye(3)):
        ahead, behind = ((Rotation.from_rotvec(e) * Rotation.from_rotvec(sign * STEP * unit)).as_rotvec() for sign in (1.0, -1.0))
        np.testing.assert_allclose(inverse_right_jacobian(e)[:, :, column], (ahead - behind) / (2 * STEP), rtol=1e-6, atol=2e-7)


def test_matrices_of_quaternions_are_scipys(rng: np.random.Generator) -> None:
    """Rotation matrices of x, y, z, w agree with SciPy's, for a quaternion and its negative."""
    turns = Rotation.random(20, random_state=3)
    for sign in (1.0, -1.0):
        np.testing.assert_allclose(matrices(sign * turns.as_quat()), turns.as_matrix(), atol=1e-14)


def test_skew_is_the_cross_product(rng: np.random.Generator) -> None:
    """[v]x w = v x w."""
    v, w = rng.normal(0, 1, (2, POSES, 3))
    np.testing.assert_allclose((skew(v) @ w[..., None])[..., 0], np.cross(v, w), atol=1e-15)


def unit_vectors(rng: np.random.Generator) -> Array3:
    vectors = rng.normal(0, 1, (POSES, 3))
    return np.asarray(vectors / np.linalg.norm(vectors, axis=1)[:, None])
