"""The prior of a fleet: scales by evidence over robots of which some are hardly seen."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml
from scipy import optimize

from urdfcal.base.errors import InputError
from urdfcal.fleet.likelihood import Alike, Likelihood
from urdfcal.fleet.outcome import Outcome
from urdfcal.fleet.prior import FleetPrior, fleet_prior
from urdfcal.fleet.prior_file import prior_entries, read_prior
from urdfcal.fleet.scales import scales_of, without_each
from urdfcal.fleet.shared import Shared, fleet_of

NAMES = ("a.d_a", "a.d_alpha", "a.d_theta", "b.d_a", "b.d_d", "b.d_alpha", "b.d_theta")
UNITS = ("m", "rad", "rad", "m", "m", "rad", "rad")
GROUPS = ("translation", "rotation", "zero", "translation", "translation", "rotation", "zero")
TRUE = {"translation": 0.6e-3, "rotation": 0.4e-3, "zero": 2e-3}


def robots(count: int, seed: int = 0, numbers: int = 6, shared: float = 0.0) -> dict[str, Likelihood]:
    """Robots whose errors have the true scales, with fewer numbers than parameters read of each; seen under another prior.

    All of them may share one of b.d_a, [m].
    """
    rng, found = np.random.default_rng(seed), {}
    for robot in range(count):
        x = rng.normal(size=len(NAMES)) * [TRUE[group] for group in GROUPS] + shared * (np.array(NAMES) == "b.d_a")
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
    scales, _ = scales_of(Alike.stacked(list(fleet.values())))
    assert [scales[group] for group in groups] == pytest.approx(np.exp(best.x).tolist(), rel=1e-3)
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
    shared = [Shared("a.d_a", "m", 1.02e-3, 2e-5, 9.0), Shared("b.d_alpha", "rad", -2e-3, 1e-4, 8.0)]
    prior = FleetPrior(TRUE, dict.fromkeys(TRUE, 10.0), {"a": 1.0}, shared, "arm")
    (tmp_path / "prior.yaml").write_text(yaml.safe_dump(prior_entries(prior)))
    word = read_prior(tmp_path / "prior.yaml")
    read = word.scale
    assert word.mean == pytest.approx({"a.d_a": 1.02e-3, "b.d_alpha": -2e-3}, rel=1e-5)
    assert [read.sigma("m"), read.sigma("rad", "a.d_alpha"), read.sigma("rad", "a.d_theta")] == pytest.approx(list(TRUE.values()), rel=1e-5)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("screen: a", "p.yaml: is no prior: it is a rig file, which --rig takes; expected a file written by urdfcal fleet"),
        ("urdfcal: prior\njoint:\n  zero_deg: wide", "p.yaml:3: entry 'joint.zero_deg': found 'wide', expected a number above zero"),
        ("urdfcal: prior\njoint: {translation_mm: 0}", "p.yaml:2: entry 'joint.translation_mm': found 0, expected a number above zero"),
        ("[]", "p.yaml: is no prior: it has no entry 'joint'"),
        ("urdfcal: prior\njoint: {}\nshared: {a.d_a: 1}", "p.yaml:3: entry 'shared.a.d_a': expected a value_mm or a value_deg"),
        (
            "urdfcal: prior\njoint: {}\nshared: {a.d_a: {value_mm: .inf}}",
            "p.yaml:3: entry 'shared.a.d_a.value_mm': found inf, expected a number",
        ),
        ("urdfcal: prior\njoint: {}\nshared: [a]", "p.yaml:3: entry 'shared': expected parameters"),
    ],
)
def test_what_is_no_prior_is_refused(tmp_path: Path, text: str, said: str) -> None:
    """In a line with the file and where it stands."""
    (tmp_path / "p.yaml").write_text(text)
    with pytest.raises(InputError) as refused:
        read_prior(tmp_path / "p.yaml")
    assert said in str(refused.value)


@pytest.mark.parametrize("count", [3, 12, 60])
def test_what_all_robots_share_is_told_of_their_description(count: int) -> None:
    """Of 3 mm at one joint, also of three robots: named alone, within its sigma, and the scales are what they are without it."""
    prior, without = fleet_prior(robots(count, shared=3e-3)), fleet_prior(robots(count))
    assert prior is not None
    assert without is not None
    (own,) = prior.shared
    assert (own.name, own.unit, without.shared) == ("b.d_a", "m", [])
    assert abs(own.value - 3e-3) < 3 * own.sigma < 3.5e-3
    if count > 3:
        assert [prior.scales[group] / without.scales[group] for group in TRUE] == pytest.approx([1, 1, 1], abs=0.1)


def test_robots_that_share_nothing_are_not_said_to() -> None:
    """Of 16 fleets of few robots at most one is."""
    told = [fleet_prior(robots(count, seed)) for seed in range(8) for count in (3, 5)]
    assert sum(bool(prior.shared) for prior in told if prior is not None) <= 1


def test_the_evidence_of_a_shared_error_is_that_of_the_batch() -> None:
    """Of stacked robots, their shared error among the unknowns: a dense Gaussian has the same log evidence and mean."""
    fleet = robots(3, shared=2e-3)
    own = fleet_of(Alike.stacked(list(fleet.values())), ["b.d_a"])
    D, one = np.diag([own.scales[group] ** 2 for group in GROUPS]), np.array(NAMES) == "b.d_a"
    L = np.zeros((21, 21))
    for at, each in enumerate(fleet.values()):
        L[7 * at : 7 * at + 7, 7 * at : 7 * at + 7] = each.information
    h = np.concatenate([each.vector for each in fleet.values()])
    prior = np.kron(np.eye(3), D) + 10e-3**2 * np.kron(np.ones((3, 3)), np.outer(one, one))
    P = np.linalg.inv(L + np.linalg.inv(prior))
    assert own.evidence == pytest.approx(0.5 * (np.linalg.slogdet(P)[1] - np.linalg.slogdet(prior)[1] + h @ P @ h), rel=1e-6)
    x = (P @ h).reshape(3, 7)[:, 3] - own.mean[0]
    assert abs(x.sum()) < 0.1 * abs(own.mean[0])


def test_the_next_robot_is_told_of_wider_scales_by_few() -> None:
    """Of three robots the prior is wider than where the evidence is greatest, of many the same; a scale of nothing is not believed."""
    for fleet, wider in ((robots(4), (1.03, 1.5)), (robots(60), (1.0, 1.03))):
        prior, best = fleet_prior(fleet), scales_of(Alike.stacked(list(fleet.values())))[0]
        assert prior is not None
        assert all(wider[0] < prior.scales[group] / best[group] < wider[1] for group in ("translation", "zero"))
    names, units = ("a.d_a",), ("m",)
    exact = {str(robot): Likelihood.of(names, units, np.zeros(1), np.full((1, 1), 1e-4**2), np.array([1e-2])) for robot in range(4)}
    prior = fleet_prior(exact)
    assert prior is not None
    assert 2e-5 < prior.scales["translation"] < 2e-4  # read to 0.1 mm: no more is known


def test_leaving_out_each_of_many_at_once_is_leaving_out_one_after_the_other() -> None:
    """The fixed point's derivative gives the scales without a robot as a search of them does, robots with other parameters among them."""
    fleet = robots(40)
    short = {name: Likelihood(own.names[:5], own.groups[:5], own.information[:5, :5], own.vector[:5]) for name, own in robots(6, 3).items()}
    every = [*fleet.values(), *short.values()]
    stacks = Alike.stacked(every)
    scales, _ = scales_of(stacks)
    at_once = without_each(stacks, scales)
    for left in (0, 17, 39, 43):
        exactly, _ = scales_of(Alike.stacked([own for at, own in enumerate(every) if at != left]))
        moved = [np.log(exactly[group] / scales[group]) for group in TRUE]
        assert [np.log(at_once[left][group] / scales[group]) for group in TRUE] == pytest.approx(moved, rel=0.1, abs=2e-4)


def test_a_prior_that_was_not_about_zero_leaves_the_same_likelihood() -> None:
    """What the data say does not hang on the mean that the fit started from."""
    rng, sigma = np.random.default_rng(1), np.where(np.array(UNITS) == "m", 10e-3, 17e-3)
    H, y, mean = rng.normal(size=(6, 7)) / 2e-4, rng.normal(size=6), 1e-3 * rng.normal(size=7)
    P = np.linalg.inv(H.T @ H + np.diag(1 / sigma**2))
    own = Likelihood.of(NAMES, UNITS, P @ (H.T @ y + mean / sigma**2), P, sigma, mean)
    assert np.allclose(own.vector, H.T @ y, rtol=1e-6)
