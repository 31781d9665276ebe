"""What an earlier calibration decided, as the prior of a later one."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from urdfcal.model.earlier import EarlierJoints

NAMES = ("waist.d_theta", "waist.d_a", "left.d_theta", "left.d_a", "left.d_d")
STATE = ("waist.d_theta", "waist.d_a", "right.d_theta")
WAIST = ("waist", "right")


def decided(rng: np.random.Generator) -> EarlierJoints:
    """A Gaussian over two joints of a waist and three of an arm, narrower than its priors."""
    root = rng.normal(size=(8, 5))
    covariance = np.linalg.inv(root.T @ root + np.eye(5))
    return EarlierJoints(NAMES, np.ones(5), rng.normal(size=(6, 5)), covariance, dict.fromkeys(("waist", "left"), pin.SE3.Identity()))


def test_rows_and_followers_are_those_of_the_whole_gaussian(rng: np.random.Generator) -> None:
    """A measurement of the shared joints alone gives what conditioning the whole Gaussian on it gives, means and covariances."""
    earlier = decided(rng)
    H, R, seen = rng.normal(size=(2, 2)), np.diag([0.3, 0.5]), rng.normal(size=2)
    whole = np.hstack([H, np.zeros((2, 3))])
    gain = earlier.covariance @ whole.T @ np.linalg.inv(whole @ earlier.covariance @ whole.T + R)
    expected, left = gain @ seen, earlier.covariance - gain @ whole @ earlier.covariance
    rows = earlier.rows(WAIST, STATE)
    own = np.hstack([H, np.zeros((2, 1))])
    information = rows.T @ rows + np.eye(3) + own.T @ np.linalg.inv(R) @ own
    x = np.linalg.solve(information, own.T @ np.linalg.inv(R) @ seen)
    np.testing.assert_allclose(x[:2], expected[:2], atol=1e-12)
    twist = earlier.followers(WAIST, STATE)["left"] @ x
    np.testing.assert_allclose(twist, earlier.screws[:, 2:] @ expected[2:], atol=1e-12)
    updated, cross = earlier.updated(WAIST, STATE, np.linalg.inv(information))
    np.testing.assert_allclose(updated.covariance, left[2:, 2:], atol=1e-12)
    np.testing.assert_allclose(cross[:, :2], left[2:, :2], atol=1e-12)


def test_what_is_held_stands_where_it_is(rng: np.random.Generator) -> None:
    """With one shared parameter held the rows are those of the others given that it is nothing."""
    earlier = decided(rng)
    rows = earlier.rows(WAIST, ("waist.d_a",))
    shared = np.linalg.inv(earlier.covariance[:2, :2])
    np.testing.assert_allclose(rows.T @ rows, shared[1:, 1:] - 1, atol=1e-12)
