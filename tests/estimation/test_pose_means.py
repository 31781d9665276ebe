"""Readings of one pose: their means weighed as the whole covariance has it, and two variances found."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from urdfcal.estimation.ekf import Belief, degrees_of_freedom, iterated_schedule, posterior
from urdfcal.estimation.least_squares import levenberg_marquardt
from urdfcal.estimation.noise import Noise, misfits
from urdfcal.estimation.pose_means import scatter_within
from urdfcal.estimation.residual import Block, Linearisation
from urdfcal.estimation.robust import Observations, iteratively_reweighted

BLOCKS = (Block("one", slice(0, 2)), Block("other", slice(2, 4)))
JOINTS = np.array([0.1, 0.2, 0.3])


def read_again(rng: np.random.Generator, times: list[int], *, missing: bool = True, m: int = 4, p: int = 3) -> Linearisation:
    """Poses with random Jacobians, each read so many times and in mixed order; some readings miss a block."""
    poses = rng.permutation(np.repeat(np.arange(len(times)), times))
    poses = np.unique(poses, return_inverse=True)[1]
    measured = np.ones((len(poses), m), dtype=bool)
    measured[np.ix_(rng.choice(len(poses), len(poses) // 5 if missing else 0, replace=False), [2, 3])] = False
    J, J_q = rng.normal(size=(len(times), m, p))[poses], rng.normal(size=(len(times), m, 3))[poses]
    parts = [np.where(measured[..., None], part, 0.0) for part in (rng.normal(size=(len(poses), m, 1)), J, J_q)]
    return Linearisation(parts[0][..., 0], parts[1], parts[2], measured, np.full(measured.shape, np.nan), BLOCKS, None, poses)


def whole_covariance(here: Linearisation, common: float, joints: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Covariance of everything that was measured for sigma 1, number by number, and where those numbers are."""
    rows, columns = np.nonzero(here.measured)
    same_pose = here.poses[rows][:, None] == here.poses[rows]  # type: ignore[index]
    same_number = columns[:, None] == columns
    reach = (here.joint_jacobian * joints)[rows, columns]
    own = np.eye(len(rows)) * (1 - common) + common * (same_pose & same_number)
    return own + same_pose * (reach @ reach.T), np.flatnonzero(here.measured)


@pytest.mark.parametrize("joints", [np.zeros(3), JOINTS], ids=["joints exact", "joints noisy"])
@pytest.mark.parametrize("common", [0.0, 0.4, 0.99])
def test_means_hold_all_that_readings_say_of_the_state(common: float, joints: np.ndarray, rng: np.random.Generator) -> None:
    """Information and gradient are J' R^-1 J and J' R^-1 r with the covariance of all readings written out."""
    here = read_again(rng, [1, 2, 3, 5, 1, 10], missing=not joints.any())  # else means are no longer sufficient, but nearly
    R, seen = whole_covariance(here, common, joints)
    J, r = here.jacobian.reshape(-1, 3)[seen], here.residual.ravel()[seen]
    weights = Noise(1.0, joints, common=common).weights(here)
    H = weights.jacobian(here)
    np.testing.assert_allclose(H.T @ H, J.T @ np.linalg.solve(R, J), rtol=1e-9)
    np.testing.assert_allclose(H.T @ weights.residual(here), J.T @ np.linalg.solve(R, r), rtol=1e-8, atol=1e-9)


def test_determinants_differ_by_what_no_model_changes(rng: np.random.Generator) -> None:
    """Of two models, the means' log determinants differ as those of the whole covariances do, scatter within poses aside."""
    here = read_again(rng, [3, 3, 3], missing=False)
    by_joints = [Noise(1.0, joints, common=0.4).log_determinant(here) for joints in (np.zeros(3), JOINTS)]
    whole = [np.linalg.slogdet(whole_covariance(here, 0.4, joints)[0])[1] for joints in (np.zeros(3), JOINTS)]
    assert np.diff(by_joints) == pytest.approx(np.diff(whole), rel=1e-9)


def test_copies_are_worth_one_reading(rng: np.random.Generator) -> None:
    """Ten copies of every row, all in common, leave posterior, chi-squared, counts and degrees of freedom where they were."""
    one = read_again(rng, [1] * 8)
    one = replace(one, poses=None)
    rows = np.tile(np.arange(8), 10)
    parts = (one.residual, one.jacobian, one.joint_jacobian, one.measured, one.stated_sigma)
    ten = Linearisation(*(part[rows] for part in parts), BLOCKS, None, rows)
    prior = Belief.independent(np.zeros(3), np.full(3, 5.0))
    for joints in (np.zeros(3), JOINTS):
        noise = Noise(0.3, joints)
        P = posterior(one, prior, noise)
        np.testing.assert_allclose(posterior(ten, prior, noise), P, rtol=1e-10)
        assert noise.chi_squared(ten) == pytest.approx(noise.chi_squared(one), rel=1e-12)
        assert (ten.count, *ten.counts) == pytest.approx((one.count, *one.counts), rel=1e-12)
        free = [degrees_of_freedom(each, noise, Belief(np.zeros(3), P)) for each in (one, ten)]
        np.testing.assert_allclose(*free, rtol=1e-10)
        assert misfits(ten, noise, P)[0].chi_squared == pytest.approx(misfits(one, noise, P)[0].chi_squared, rel=1e-9)


def linear(rng: np.random.Generator, times: np.ndarray, pose: float, own: float) -> tuple[Linearisation, np.ndarray]:
    """Readings m = J x + p + e of many poses with stated deviations of p and e, and x."""
    poses = np.repeat(np.arange(len(times)), times)
    J, x = rng.normal(size=(len(times), 4, 3))[poses], rng.normal(size=3)
    noise = rng.normal(0, pose, (len(times), 4))[poses] + rng.normal(0, own, (len(poses), 4))
    blank = np.full((len(poses), 4), np.nan)
    return Linearisation(J @ x + noise, J, np.zeros((len(poses), 4, 0)), np.isnan(blank), blank, BLOCKS, None, poses), x


@pytest.mark.parametrize(("pose", "own"), [(0.3, 0.1), (0.1, 0.3), (0.2, 0.0), (0.0, 0.2)])
@pytest.mark.parametrize("method", [iterated_schedule, levenberg_marquardt, iteratively_reweighted])
def test_both_variances_are_found(method: object, pose: float, own: float, rng: np.random.Generator) -> None:
    """From 600 poses read once, three or ten times every estimator finds what poses share and what readings have of their own."""
    data, x = linear(rng, rng.choice([1, 3, 10], 600), pose, own)

    def linearise(state: np.ndarray) -> Linearisation:
        return replace(data, residual=data.residual - data.jacobian @ state)

    prior, noise = Belief.independent(np.zeros(3), np.full(3, 10.0)), Noise(1.0, np.zeros(0), stated=False)
    first = Observations.of(linearise, prior.x) if method is iteratively_reweighted else linearise
    found = method(first, prior, noise)  # type: ignore[operator]
    assert found.converged
    loose = 0.1 if method is iteratively_reweighted else 0.06
    assert found.noise.sigma_in_common[0] == pytest.approx(pose, rel=loose, abs=0.05)
    assert np.sqrt(found.noise.sigma[0] ** 2 - found.noise.sigma_in_common[0] ** 2) == pytest.approx(own, rel=loose, abs=1e-9)
    assert np.all(np.abs(found.belief.x - x) < 4 * np.sqrt(np.diag(found.belief.P)))


def test_too_few_repeats_tell_nothing(rng: np.random.Generator) -> None:
    """With two poses read twice all noise is the pose's, as large as without their second readings but for chance."""
    data, _ = linear(rng, np.array([2, 2, *[1] * 100]), 0.2, 0.2)
    found = iterated_schedule(
        lambda state: replace(data, residual=data.residual - data.jacobian @ state),
        Belief.independent(np.zeros(3), np.full(3, 10.0)),
        Noise(1.0, np.zeros(0), stated=False),
    )
    assert found.noise.common[0] == 1
    assert found.noise.sigma[0] == pytest.approx(0.2 * np.sqrt(2), rel=0.15)


def test_a_bad_reading_does_not_hide_that_the_others_agree(rng: np.random.Generator) -> None:
    """The median scatter within poses is that of the good readings, the mean one is not."""
    data, _ = linear(rng, np.full(50, 3), 0.2, 0.01)
    bad = data.residual.copy()
    bad[::15] += 5.0
    sigma = np.full(bad.shape, 0.01)
    wrong = replace(data, residual=bad)
    assert 0.7 < scatter_within(wrong, sigma, robust=True).variance[0] < 2
    assert scatter_within(wrong, sigma).variance[0] > 100
