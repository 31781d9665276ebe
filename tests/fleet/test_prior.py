"""The prior of a fleet: scales by evidence over robots of which some are hardly seen."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml
from scipy import optimize

from urdfcal.base.errors import InputError
from urdfcal.fleet.outcome import Outcome
from urdfcal.fleet.prior import FleetPrior, Likelihood, fleet_prior, prior_entries, read_prior

NAMES = ("a.d_a", "a.d_alpha", "a.d_theta", "b.d_a", "b.d_d", "b.d_alpha", "b.d_theta")
UNITS = ("m", "rad", "rad", "m", "m", "rad", "rad")
GROUPS = ("translation", "rotation", "zero", "translation", "translation", "rotation", "zero")
TRUE = {"translation": 0.6e-3, "rotation": 0.4e-3, "zero": 2e-3}


def robots(count: int, seed: int = 0, numbers: int = 6) -> dict[str, Likelihood]:
    """Robots whose errors have the true scales, with fewer numbers than parameters read of each; seen under another prior."""
    rng, found = np.random.default_rng(seed), {}
    for robot in range(count):
        x = rng.normal(size=len(NAMES)) * [TRUE[group] for group in GROUPS]
        H, sigma = rng.normal(size=(numbers, len(NAMES))), 2e-4
        y, prior = H @ x + sigma * rng.normal(size=numbers), np.where(np.array(UNITS) == "m", 10e-3, 17e-3)
        P = np.linalg.inv(H.T @ H / sigma**2 + np.diag(1 / prior**2))
        found[f"r{robot}"] = Likelihood.of(NAMES, UNITS, P @ H.T @ y / sigma**2, P, prior)
    return found


def test_what_a_posterior_has_beyond_its_prior_is_the_likelihood() -> None:
    """Under the prior that it was fitted with, the likelihood gives the posterior again."""
    (own,) = robots(1).values()
    x, P = own.posterior(np.where(np.array(UNITS) == "m", 10e-3, 17e-3) ** 2)
    again = Likelihood.of(NAMES, UNITS, x, P, np.where(np.array(UNITS) == "m", 10e-3, 17e-3))
    assert np.allclose(again.information, own.information, rtol=1e-6, atol=1e-3)
    assert np.allclose(again.vector, own.vector, rtol=1e-6)
    assert own.groups == GROUPS


def test_scales_are_where_the_evidence_is_greatest() -> None:
    """An optimiser of the same evidence ends in the same place, and it is near the truth."""
    fleet = robots(60)
    prior = fleet_prior(fleet)
    assert prior is not None
    groups = list(TRUE)

    def cost(logs: np.ndarray) -> float:
        scales = dict(zip(groups, np.exp(logs).tolist(), strict=True))
        return -sum(own.evidence(scales) for own in fleet.values())

    best = optimize.minimize(cost, np.log([1e-3] * 3), method="Nelder-Mead", options={"xatol": 1e-6, "fatol": 1e-9, "maxiter": 4000})
    assert [prior.scales[group] for group in groups] == pytest.approx(np.exp(best.x), rel=1e-3)
    assert [prior.scales[group] / TRUE[group] for group in groups] == pytest.approx([1, 1, 1], abs=0.25)
    assert min(prior.gains.values()) > 0


def test_a_fleets_prior_is_nearer_to_the_truth_than_the_usual_one() -> None:
    """Of robots with fewer numbers than parameters, the others' prior brings the estimates nearer to what they are."""
    fleet = robots(12, seed=5)
    prior = fleet_prior(fleet)
    assert prior is not None
    rng = np.random.default_rng(5)
    off = []
    for own in fleet.values():
        x = rng.normal(size=len(NAMES)) * [TRUE[group] for group in own.groups]
        rng.normal(size=(6, len(NAMES))), rng.normal(size=6)
        usual = np.where(np.array(UNITS) == "m", 10e-3, 17e-3) ** 2
        off.append([np.linalg.norm(own.posterior(variance)[0] - x) for variance in (usual, own.variances(prior.scales))])
    before, after = np.sqrt(np.mean(np.square(off), axis=0))
    assert after < 0.8 * before


def test_few_poses_with_noise_that_nobody_stated_tell_nothing_of_the_fleet() -> None:
    """Estimated from a few poses the noise is too small; stated, or of many poses, it is taken."""
    joints = {"names": ["a.d_a"], "units": ["m"], "values": [1e-3], "covariance": [[1e-8]], "prior_sigma": [1e-2]}
    kinds = [(10, 1.0), (10, 0.7), (40, 1.0)]
    told = [{"poses": {"count": count}, "chi_squared_per_degree_of_freedom": chi} for count, chi in kinds]
    assert [Outcome("a", 0, result=result, joints=joints).likelihood is not None for result in told] == [False, True, True]


def test_two_robots_are_no_fleet() -> None:
    """Fewer than three say nothing of the others."""
    assert fleet_prior(robots(2)) is None


def test_a_prior_is_read_as_it_was_written(tmp_path: Path) -> None:
    """Millimetres and degrees in the file, metres and radians behind it; zeros have their own."""
    prior = FleetPrior(TRUE, dict.fromkeys(TRUE, 10.0), {"a": 1.0})
    (tmp_path / "prior.yaml").write_text(yaml.safe_dump(prior_entries(prior)))
    read = read_prior(tmp_path / "prior.yaml")
    assert [read.sigma("m"), read.sigma("rad", "a.d_alpha"), read.sigma("rad", "a.d_theta")] == pytest.approx(list(TRUE.values()), rel=1e-5)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("screen: a", "p.yaml: is no prior: it is a rig file, which --rig takes; expected a file written by urdfcal fleet"),
        ("urdfcal: prior\njoint:\n  zero_deg: wide", "p.yaml:3: entry 'joint.zero_deg': found 'wide', expected a number above zero"),
        ("urdfcal: prior\njoint: {translation_mm: 0}", "p.yaml:2: entry 'joint.translation_mm': found 0, expected a number above zero"),
        ("[]", "p.yaml: is no prior: it has no entry 'joint'"),
    ],
)
def test_what_is_no_prior_is_refused(tmp_path: Path, text: str, said: str) -> None:
    """In a line with the file and where it stands."""
    (tmp_path / "p.yaml").write_text(text)
    with pytest.raises(InputError) as refused:
        read_prior(tmp_path / "p.yaml")
    assert said in str(refused.value)
