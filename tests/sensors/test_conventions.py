"""Orientations in other makers' conventions, against SciPy's rotations."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from urdfcal.base.geometry import DEG, Matrix
from urdfcal.base.rotations import product_of_quaternions, quaternions_of, quaternions_of_vectors
from urdfcal.sensors.conventions import angles_of, orientation_mistakes

ROTATIONS = Rotation.random(200, rng=np.random.default_rng(3))
READ = "roll, pitch and yaw read as"
WRITTEN: dict[str, Matrix] = {
    "roll, pitch and yaw taken about axes that turn along": ROTATIONS.as_euler("XYZ"),
    f"{READ} a rotation vector (Rx, Ry, Rz, as Universal Robots has it)": ROTATIONS.as_rotvec(),
    f"{READ} A, B, C about z, y', x'' (as KUKA has them)": ROTATIONS.as_euler("ZYX"),
    f"{READ} O, A, T about z, y', z'' (as Kawasaki has them)": ROTATIONS.as_euler("ZYZ"),
    f"{READ} O, A, T about z, y', z'' (as Kawasaki has them), A beyond 90 deg": ROTATIONS.as_euler("ZYZ"),
    f"{READ} radians in place of degrees": ROTATIONS.as_euler("xyz") * DEG,
    f"{READ} degrees": ROTATIONS.as_euler("xyz") * 1.0,
}


def meant(words: str) -> Rotation:
    """The rotations that such numbers were written for."""
    return Rotation.from_euler("xyz", WRITTEN[words], degrees=True) if words.endswith("degrees") and "place" not in words else ROTATIONS


def told_apart(words: str) -> np.ndarray:
    """Where the three numbers can be read back from the rotation that they were taken for."""
    numbers = WRITTEN[words]
    if "rotation vector" in words:
        return np.abs(numbers).sum(axis=1) < 1.5 * np.pi
    if "O, A, T" in words:
        return (np.abs(numbers[:, 1]) > np.pi / 2) == ("beyond" in words)
    return np.abs(numbers[:, 1]) < np.pi / 2


@pytest.mark.parametrize("words", WRITTEN)
def test_a_convention_is_undone(words: str) -> None:
    """Numbers of each convention, read as roll, pitch and yaw, come back as the rotations that were meant."""
    undone = orientation_mistakes()[words](quaternions_of(WRITTEN[words]))
    own = told_apart(words)
    assert own.sum() > 50
    apart = (Rotation.from_quat(undone) * meant(words).inv()).magnitude()[own]
    assert apart.max() < 1e-7


def test_products_and_exponentials_are_scipys() -> None:
    """Of quaternions, also of rotation vectors that are zero."""
    one, other = ROTATIONS[:100], ROTATIONS[100:]
    product = Rotation.from_quat(product_of_quaternions(one.as_quat(), other.as_quat()))
    assert (product * (one * other).inv()).magnitude().max() < 1e-12
    vectors = np.vstack([one.as_rotvec(), np.zeros((1, 3)), [[1e-9, 0, 0]]])
    np.testing.assert_allclose(quaternions_of_vectors(vectors), Rotation.from_rotvec(vectors).as_quat(), atol=1e-12)


def test_angles_come_back() -> None:
    """Roll, pitch and yaw of quaternions are SciPy's."""
    np.testing.assert_allclose(angles_of(ROTATIONS.as_quat()), ROTATIONS.as_euler("xyz"), atol=1e-12)
