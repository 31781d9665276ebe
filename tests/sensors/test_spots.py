"""Beams on the screen and Jac2."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from tests.support.helpers import central_differences
from urdfcal.sensors.spots import spot_jacobian, spots_on_screen


def random_beams(rng: np.random.Generator, n: int = 50) -> tuple[np.ndarray, np.ndarray]:
    """Sources in front of the screen and directions toward it."""
    direction = rng.normal(0, 0.4, (n, 2, 3)) + np.array([1.0, 0, 0])
    return rng.uniform([-2, -1, -1], [-0.3, 1, 1], (n, 2, 3)), direction / np.linalg.norm(direction, axis=-1, keepdims=True)


def test_a_spot_is_source_plus_length_times_direction(rng: np.random.Generator) -> None:
    """Equations (7) and (8): the point at distance k lies on the plane x = 0, at the spot."""
    source, direction = random_beams(rng)
    spots, length = spots_on_screen(source, direction)
    points = source + length[..., None] * direction
    np.testing.assert_allclose(points, np.concatenate([np.zeros((50, 2, 1)), spots], axis=-1), atol=1e-14)


def test_jac2_is_equation_11_moved_to_the_screen(rng: np.random.Generator) -> None:
    """The rows are those printed as (11) (with the scan's misprint corrected), for the twist taken at the laser."""
    source, direction = random_beams(rng)
    spots, _ = spots_on_screen(source, direction)
    jac2 = spot_jacobian(spots, direction)
    for pose in range(len(source)):
        for laser in range(2):
            px, (zx, zy, zz) = source[pose, laser, 0], direction[pose, laser]
            equation_11 = np.array(
                [
                    [-zy / zx, 1, 0, zz * px / zx, zz * zy * px / zx**2, -(1 - zz**2) * px / zx**2],
                    [-zz / zx, 0, 1, -zy * px / zx, (1 - zy**2) * px / zx**2, -zz * zy * px / zx**2],
                ]
            )
            to_laser = pin.SE3(np.eye(3), source[pose, laser]).toActionMatrixInverse()
            np.testing.assert_allclose(jac2[pose, laser], equation_11 @ to_laser, atol=1e-12)


def test_jac2_is_the_derivative_of_the_spot(rng: np.random.Generator) -> None:
    """Moving the laser by a small twist moves its spot by Jac2 times that twist."""
    source, direction = random_beams(rng, 1)
    spots, _ = spots_on_screen(source, direction)

    def moved(twist: np.ndarray) -> np.ndarray:
        T = pin.exp6(twist)
        return spots_on_screen(source @ T.rotation.T + T.translation, direction @ T.rotation.T)[0]

    np.testing.assert_allclose(spot_jacobian(spots, direction), central_differences(moved, np.zeros(6)), atol=1e-8)


def test_a_beam_away_from_the_screen_has_negative_length() -> None:
    """A beam that leaves the screen behind it, or runs along it, is told by its length."""
    source = np.array([[[-1.0, 0, 0], [-1.0, 0, 0]]])
    direction = np.array([[[-1.0, 0, 0], [0, 1.0, 0]]])
    _, length = spots_on_screen(source, direction)
    assert length[0, 0] < 0
    assert not np.isfinite(length[0, 1])
