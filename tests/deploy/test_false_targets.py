"""False targets: the real tool comes where it was wanted."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from tests.support.paths import ROBOTS_DIR
from urdfcal import fit, fit_sag, read_measurements, simulate
from urdfcal.base.errors import ShapeMismatch, UsageError
from urdfcal.deploy.false_targets import FAR, LEFT_MM, false_joints, false_placements, sagging, solved, spoken
from urdfcal.output.stored import corrected_robot
from urdfcal.robot.robot import Robot, load_robot
from urdfcal.robot.way import Way

ARMS = {"ur5": ("ur_description/urdf/ur5_robot.urdf", "tool0"), "panda": ("panda_description/urdf/panda.urdf", "panda_link8")}


@pytest.fixture(scope="module", params=ARMS)
def ways(request: pytest.FixtureRequest, example_robots: Path) -> tuple[Way, Way]:
    """A nominal arm, and a real one that is off by millimetres and milliradians a joint."""
    path, tool = ARMS[request.param]
    robot, rng = load_robot(example_robots / path), np.random.default_rng(4)
    nominal = Way.between(robot, tool)
    errors = {name: rng.normal(0.0, [1e-3] * 3 + [2e-3] * 3) for name in nominal.names}
    origins = {name: robot.tree.joints[name].origin * pin.exp6(error) for name, error in errors.items()}
    return nominal, Way.between(corrected_robot(robot, origins), tool)


def positions(way: Way, rng: np.random.Generator, count: int) -> np.ndarray:
    """Positions within the limits at which every direction can be reached well."""
    lower, upper = 0.9 * np.maximum(way.limits[0], -np.pi), 0.9 * np.minimum(way.limits[1], np.pi)
    q = rng.uniform(lower, upper, (20 * count, len(lower)))
    _, J = way.jacobians(q)
    return q[np.linalg.svd(J, compute_uv=False)[:, -1] > 0.08][:count]


def test_the_real_tool_comes_where_the_nominal_one_would(ways: tuple[Way, Way], rng: np.random.Generator) -> None:
    """At the positions that are told the real robot has the tool where the nominal one has it at those that were wanted."""
    nominal, real = ways
    q = positions(nominal, rng, 100)
    found = false_joints(nominal, real.placements, q)
    assert np.allclose(real.placements(found.reached.q), nominal.placements(q), atol=1e-9)
    assert found.before_mm.mean() > 1
    assert np.abs(found.reached.moved).max() < FAR
    assert spoken(nominal, found) == [""] * len(q)


def test_a_controller_that_believes_its_geometry_goes_there(ways: tuple[Way, Way], rng: np.random.Generator) -> None:
    """The positions at which the nominal robot reaches the false placements bring the real tool to the true ones."""
    nominal, real = ways
    q = positions(nominal, rng, 20)
    wanted = nominal.placements(q)
    reached = solved(nominal, wanted, q + rng.normal(0.0, 0.02, q.shape))
    assert reached.whole.all()
    found = false_placements(nominal, real.placements, wanted, reached.q)
    told = solved(nominal, found.placements, found.reached.q)
    assert np.allclose(real.placements(told.q), wanted, atol=1e-8)


def test_what_is_left_over_at_a_limit_is_said(ways: tuple[Way, Way], rng: np.random.Generator) -> None:
    """Where the first joint stands at its limit, or the arm is stretched, no position is beyond a limit and what is left is named."""
    nominal, real = ways
    q = positions(nominal, rng, 10)
    q[:, 0] = nominal.limits[1, 0]
    found = false_joints(nominal, real.placements, q)
    assert (found.reached.q <= nominal.limits[1] + 1e-12).all()
    left = found.reached.left_mm > LEFT_MM
    words = spoken(nominal, found)
    assert [f"{nominal.names[0]}" in said and "left over" in said for said, over in zip(words, left, strict=True) if over] == [
        True
    ] * left.sum()
    assert (found.reached.left_mm <= found.before_mm + 1e-9).all() or (found.reached.left_deg < found.before_deg).all()


def test_a_far_target_is_found_from_elsewhere(ways: tuple[Way, Way], rng: np.random.Generator) -> None:
    """A placement far from the positions that are near is reached all the same."""
    nominal, _ = ways
    q = positions(nominal, rng, 5)
    reached = solved(nominal, nominal.placements(q), np.zeros_like(q) + 0.3)
    assert reached.whole.all()
    assert np.allclose(nominal.placements(reached.q), nominal.placements(q), atol=1e-8)


def test_an_arm_that_gives_way_comes_where_it_was_wanted(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """With a compensation the bent arm has its tool at the told positions where the nominal one has it at the wanted ones."""
    simulated = simulate(robots["panda"], 60, sensors=("pose:panda_link8",), errors=(1e-3, 1e-3), seed=3)
    sag = fit_sag(fit(simulated.nominal, simulated.measurements, asking=False))
    assert sag is not None
    compensation = sag.compensation()
    way = Way.between(simulated.nominal, "panda_link8")
    real = sagging(compensation, Way.between(compensation.robot, "panda_link8"))
    q = positions(way, rng, 30)
    found = false_joints(way, real, q)
    assert np.allclose(real(found.reached.q), way.placements(q), atol=1e-9)


def test_from_python(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """A calibration gives false positions and false placements for the same targets; other shapes are refused."""
    arm = robots["arm7"]
    data = read_measurements(ROBOTS_DIR / "arm7" / "measurements.csv", arm)
    calibration = fit(arm, data, asking=False)
    way = Way.between(arm, "slm")
    q = np.clip(data.q[:5], *way.limits)
    joints = calibration.false_targets(q)
    placed = calibration.false_targets(way.placements(q), near=q)
    assert np.allclose(joints.placements, placed.placements, atol=1e-6)
    with pytest.raises(ShapeMismatch, match="expected \\(n, 7\\) positions"):
        calibration.false_targets(q[:, :3])
    with pytest.raises(UsageError, match="near names positions"):
        calibration.false_targets(way.placements(q))
    assert repr(joints).startswith(f"<FalseTargets: 5, of which {joints.reached.whole.sum()} are reached; the real tool is ")
    assert f"{joints.before_mm.mean():.3g} mm off" in repr(joints)
    with pytest.raises(UsageError, match="row 1 holds what is no finite number"):
        calibration.false_targets(np.where(np.arange(5)[:, None] == 1, np.nan, q))
    with pytest.raises(UsageError, match="row 0 is no placement; expected a rotation"):
        calibration.false_targets(way.placements(q).transpose(0, 2, 1), near=q)
