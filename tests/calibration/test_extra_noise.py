"""Noise beyond what readings state of themselves: found where there is some, not invented where there is none."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from tests.conftest import CliResult
from tests.support.paths import ROBOTS_DIR
from tests.support.sensor_cases import NOISE, SensorCase, setup_of
from urdfcal.api import fit
from urdfcal.base.errors import UsageError
from urdfcal.base.geometry import DEG, MM
from urdfcal.output.text.result import calibration_json, text_report
from urdfcal.robot.robot import Robot
from urdfcal.sensors.measurements import Measurements
from urdfcal.simulation.readings import simulate_readings

ARM = ROBOTS_DIR / "arm7" / "arm7.urdf.xacro"
LASERS = SensorCase("arm7", ("laser",))
POINTS = SensorCase("ur5", ("point:tool0", "pose:wrist_1_link"))


def stating(data: Measurements, length: float, angle: float = NOISE.angle) -> Measurements:
    """The same measurements, every one with a standard deviation of its own."""
    readings = tuple(
        replace(each, sigma=np.where(each.seen, angle if each.sensor == "orientation" else length, np.nan)) for each in data.readings
    )
    return replace(data, readings=readings)


def of_lasers(robots: dict[str, Robot], rng: np.random.Generator, poses: int = 60) -> tuple[Robot, Measurements]:
    setup = setup_of(LASERS, robots, rng, model="dh")
    return setup.robot, simulate_readings(setup, poses, rng, NOISE)


def test_what_is_stated_rightly_stays(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Readings that scatter as they state get nothing on top, and no warning."""
    robot, data = of_lasers(robots, rng)
    found = fit(robot, stating(data, NOISE.spot))
    assert not found.extra_noise
    assert not any("scatter more" in warning for warning in found.warnings)
    assert found.chi_squared == pytest.approx(1, abs=0.4)


def test_noise_that_the_camera_does_not_know_of_is_found(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """With a tenth of the noise stated, the rest is found, said, and enters the sigmas: the truth stays within them."""
    robot, data = of_lasers(robots, rng)
    usual, found = fit(robot, data), fit(robot, stating(data, NOISE.spot / 10))
    assert found.extra_noise["spot"] == pytest.approx(NOISE.spot, rel=0.2)
    assert found.rejection == ""
    np.testing.assert_allclose(found.sigma, usual.sigma, rtol=0.1)
    assert np.abs((found.x - usual.x) / usual.sigma).max() < 0.3
    assert f"(stated, and {found.extra_noise['spot'] / MM:.3g} mm on top)" in text_report(found)
    assert calibration_json(found)["extra_noise"] == found.extra_noise
    assert sum("spots scatter more than their .sigma columns state" in warning for warning in found.warnings) == 1


def test_shares_of_noise_stay(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """A spot that states much noise keeps it; a single one that is declared useless does not hide that the others scatter."""
    robot, data = of_lasers(robots, rng)
    sigma = np.full_like(data.sigma, NOISE.spot / 10)
    sigma[0, 0] = 1.0
    stated = data.with_spots(data.spots, sigma)
    found = fit(robot, stated)
    assert found.extra_noise["spot"] == pytest.approx(NOISE.spot, rel=0.2)
    assert found.data.sigma[0, 0] == pytest.approx(1.0, rel=1e-3)


def test_kinds_are_told_apart(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Points that scatter more than they state do not widen the orientations beside them, which do not."""
    setup = setup_of(POINTS, robots, rng)
    data = stating(simulate_readings(setup, 80, rng, NOISE), NOISE.length / 10)
    found = fit(setup.robot, data)
    assert set(found.extra_noise) == {"point"}
    assert found.extra_noise["point"] == pytest.approx(NOISE.length, rel=0.2)


def test_test_poses_are_judged_by_the_same_noise(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Ordinary test poses are no outliers only because their columns state too little."""
    robot, data = of_lasers(robots, rng, 90)
    stated = stating(data, NOISE.spot / 30)
    found = fit(robot, stated.subset(np.arange(60)), test=stated.subset(np.arange(60, 90)))
    assert not found.test_outliers
    assert found.test is not None
    assert sum(row.n for row in found.test[1].values()) == 60


def test_the_paper_s_schedule_takes_the_columns_as_they_are(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """One pass, R as stated: nothing is estimated that the paper does not estimate."""
    robot, data = of_lasers(robots, rng)
    assert not fit(robot, stating(data, NOISE.spot / 10), error_model="dh", schedule="paper").extra_noise


def test_stated_noise_of_other_readings(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """rig.yaml's noise by kind is used as it is; chi-square tells where it is wrong."""
    setup = setup_of(POINTS, robots, rng)
    data = simulate_readings(setup, 80, rng, NOISE)
    right, wrong = (fit(setup.robot, data, sigmas={"point": times * NOISE.length, "orientation": NOISE.angle}) for times in (1, 2))
    np.testing.assert_allclose(right.estimate.noise.sigma, [NOISE.length, NOISE.angle])
    assert right.chi_squared == pytest.approx(1, abs=0.3)
    assert any("the points scatter 0.5 times as much as the stated noise explains" in warning for warning in wrong.warnings)
    with pytest.raises(UsageError, match="noise of a distance is stated, but the measurements have none; they have point, orientation"):
        fit(setup.robot, data, sigmas={"distance": 1e-3})


def test_noise_of_joints_is_not_counted_twice(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """What the stated noise of the joints explains needs nothing on top of right columns."""
    setup = setup_of(LASERS, robots, rng, model="dh")
    noise = replace(NOISE, joint=0.05 * DEG)
    data = stating(simulate_readings(setup, 200, rng, noise), NOISE.spot)
    found = fit(setup.robot, data, joint_sigma=noise.joint)
    assert not found.extra_noise
    assert found.chi_squared == pytest.approx(1, abs=0.2)


def test_columns_do_not_excuse_what_no_instrument_reads(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Orientations that scatter by tens of degrees are rejected, however small they say they are."""
    setup = setup_of(POINTS, robots, rng)
    data = stating(simulate_readings(setup, 80, rng, NOISE), NOISE.length)
    mixed = tuple(replace(each, values=each.values[:, [3, 0, 1, 2]]) if each.sensor == "orientation" else each for each in data.readings)
    found = fit(setup.robot, replace(data, readings=mixed), sane=False)
    assert "orientations scatter by" in found.rejection


def test_exchanged_beams_take_their_noise_along(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """A spot that was read for the other beam keeps the standard deviation that was stated with it."""
    robot, data = of_lasers(robots, rng)
    spots, sigma = data.spots.copy(), np.full_like(data.sigma, NOISE.spot)
    sigma[5], spots[5] = [NOISE.spot, 3 * NOISE.spot], spots[5, ::-1].copy()
    stated = data.with_spots(spots, sigma)
    found = fit(robot, stated)
    assert "read for each other" in found.outliers[0].reason
    np.testing.assert_allclose(found.data.sigma[5], [3 * NOISE.spot, NOISE.spot])


def test_the_command_states_noise_by_rig_file(run_cli: Callable[..., CliResult], tmp_path_factory: pytest.TempPathFactory) -> None:
    """`noise: {point_mm: 0.1}` reaches the fit; what the rig says of kinds that were not measured this time does not matter."""
    folder = tmp_path_factory.mktemp("rig")
    (folder / "rig.yaml").write_text("noise: {point_mm: 0.1, distance_mm: 0.1, spot_mm: 1.0}\n")
    done = run_cli("simulate", ARM, "-o", "m.csv", "--poses", "30", "--sensor", "point:slm", "--target-noise-mm", "0.1")
    assert done.code == 0, done.err
    done = run_cli("fit", ARM, "m.csv", "--rig", folder / "rig.yaml", "--no-sag")
    assert done.code == 0, done.err
    assert "point noise 0.1 mm (stated)" in done.out
    done = run_cli("check", ARM, "m.csv", "--rig", folder / "rig.yaml")
    assert "with 0.1 mm of point noise a fit would determine" in " ".join(done.out.split())


def test_options_that_would_be_ignored_are_refused(run_cli: Callable[..., CliResult]) -> None:
    """Noise of spots where there are none, and how arms sag where that is not asked, say so."""
    run_cli("simulate", ARM, "-o", "m.csv", "--poses", "30", "--sensor", "point:slm")
    done = run_cli("fit", ARM, "m.csv", "--spot-sigma-mm", "1")
    assert (done.code, "--spot-sigma-mm: no laser spots are measured" in done.err) == (2, True)
    for words in (("--gravity", "0,0,-1"), ("--payload", "1@slm"), ("--also", "approach")):
        done = run_cli("fit", ARM, "m.csv", "--no-sag", *words)
        assert (done.code, "--no-sag leaves out" in done.err) == (2, True)


def test_some_that_state_their_noise_leave_the_others_alone(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """One beam's column, ten times too large or too small, costs the other beam no spot, and is said or made up for."""
    robot, data = of_lasers(robots, rng)
    for times in (10.0, 0.1):
        sigma = np.column_stack([np.full(len(data), times * NOISE.spot), np.full(len(data), np.nan)])
        found = fit(robot, data.with_spots(data.spots, sigma))
        assert not found.outliers
        assert found.after["laser_2"].mean == pytest.approx(found.after["laser_1"].mean, rel=0.5)
        assert any("scatter 0.1" in words or "scatter more than their" in words for words in found.warnings)


def test_columns_are_no_matter_of_the_gate(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Noise beyond columns is found without the gate, too; and the robust estimator needs none to tell outliers from noise."""
    robot, data = of_lasers(robots, rng)
    assert fit(robot, stating(data, NOISE.spot / 10), gated=False).extra_noise["spot"] == pytest.approx(NOISE.spot, rel=0.2)
    spots = data.spots.copy()
    spots[::10, 0] += 0.05
    wild = stating(data.with_spots(spots), NOISE.spot)
    assert not fit(robot, wild, estimator="robust", gated=False).extra_noise


def test_noise_that_columns_state_is_not_stated_again(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Where every spot states its own noise, one number for all of them would mean nothing."""
    robot, data = of_lasers(robots, rng)
    with pytest.raises(UsageError, match="every spot states its own noise"):
        fit(robot, stating(data, NOISE.spot), spot_sigma=1e-3)
