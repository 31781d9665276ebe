"""Readings that the nominal robot explains better than the calibrated one."""

from __future__ import annotations

import numpy as np
import pytest

from urdfcal.base.geometry import Matrix
from urdfcal.calibration.nominal_explains import _Compared, explained_by_nominal
from urdfcal.estimation.noise import Noise
from urdfcal.estimation.residual import Block, Linearisation

NOISE = Noise(1.0, np.zeros(0))


def points(residual: Matrix) -> Linearisation:
    """One point of three numbers a pose, that is off so far."""
    n, m = residual.shape
    blank = np.full((n, m), np.nan)
    return Linearisation(residual, np.zeros((n, m, 1)), np.empty((n, m, 0)), np.ones((n, m), dtype=bool), blank, (Block("p", slice(0, m)),))


@pytest.mark.parametrize("numbers", [1, 2, 3, 6])
def test_chance_of_a_direction_is_the_share_of_a_cap(numbers: int, rng: np.random.Generator) -> None:
    """Directions at random point as near to a given one as often as it is said."""
    directions = rng.normal(size=(100_000, numbers))
    cosines = directions[:, 0] / np.linalg.norm(directions, axis=1)
    for cosine in (-0.5, 0.2, 0.8) if numbers > 1 else (1.0,):
        one = np.ones(1)
        found = _Compared(one, one, cosine * one, numbers * np.ones(1)).chance
        assert found[0] == pytest.approx(np.mean(cosines >= cosine), abs=0.006)


@pytest.fixture
def residuals(rng: np.random.Generator) -> tuple[Matrix, Matrix]:
    """40 poses: the nominal robot is off by some 5, the calibrated one by 1, and at the first four by 30 where the nominal one is right."""
    nominal, calibrated = rng.normal(0, 5, (40, 3)), rng.normal(0, 1, (40, 3))
    calibrated[:4] = nominal[:4] + np.array([30, 0, 0])
    return calibrated, nominal


def test_outliers_that_lie_together_go_to_who_explains_them(residuals: tuple[Matrix, Matrix]) -> None:
    """Of outliers that lie together those that the nominal robot is nearer to are none, and those that are far from both remain."""
    calibrated, nominal = residuals
    calibrated[3] = nominal[3] = [0, 200, 0]
    out = (np.arange(40) < 4)[:, None]
    back = explained_by_nominal(points(calibrated), points(nominal - np.array([1e-3, 0, 0])), NOISE, out, together=True)
    np.testing.assert_array_equal(np.flatnonzero(back), [0, 1, 2])


def test_scattered_outliers_must_point_to_the_nominal_robot(rng: np.random.Generator) -> None:
    """A scattered outlier is none only where the nominal robot has it where it was read; nearer by chance is not enough."""
    nominal, calibrated = rng.normal(0, 5, (40, 3)), rng.normal(0, 1, (40, 3))
    calibrated[:2], nominal[0], nominal[1] = [30, 0, 0], [0.2, 0.1, 0], [9, 12, 0]
    back = explained_by_nominal(points(calibrated), points(nominal), NOISE, (np.arange(40) < 2)[:, None], together=False)
    np.testing.assert_array_equal(np.flatnonzero(back), [0])


def test_bad_readings_hardly_ever_come_back(rng: np.random.Generator) -> None:
    """Readings that are off in any direction, as far as the nominal robot is, stay outliers in all but a hundredth of the sets."""
    returned = 0
    for _ in range(200):
        calibrated = rng.normal(0, 1, (60, 3))
        nominal = calibrated + rng.normal(0, 20, (60, 3))
        off = rng.normal(0, 30, (6, 3))
        calibrated[:6] += off
        nominal[:6] += off
        returned += explained_by_nominal(points(calibrated), points(nominal), NOISE, (np.arange(60) < 6)[:, None], together=False).any()
    assert returned <= 7
