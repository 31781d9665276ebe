"""Numbers of origins that are nearest to those that are written."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest

from urdfcal.output.sources.wishes import nearest_rpy

OLD = [[0, 0, 0], [3.14159265, 0, -3.14159265], [1.0, 2.5, -1.0], [0.3, np.pi / 2, 0.2], [0.3, -np.pi / 2, 0.2], [0, 7.0, 9.0]]


@pytest.mark.parametrize("old", OLD)
def test_the_nearest_of_all_that_say_the_same_is_taken(old: list[float]) -> None:
    """The rotation is the wanted one, an unchanged one has the old numbers, and a small turn changes them by little away from pitch 90."""
    at = np.array(old, dtype=float)
    there = pin.rpy.rpyToMatrix(at)
    np.testing.assert_allclose(nearest_rpy(pin.SE3(there, np.zeros(3)), at), at, atol=1e-7)
    turned = there @ pin.exp3(np.array([1e-3, -2e-3, 1e-3]))
    found = nearest_rpy(pin.SE3(turned, np.zeros(3)), at)
    np.testing.assert_allclose(pin.rpy.rpyToMatrix(found), turned, atol=1e-14)
    if abs(np.cos(at[1])) > 0.1:
        assert np.abs(found - at).max() < 0.02
