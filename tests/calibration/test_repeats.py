"""Readings of one pose in whole fits: copies, several sensors, folds, and both variances."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.conftest import CliResult
from tests.support.paths import ROBOTS_DIR
from urdfcal.api import fit
from urdfcal.base.geometry import MM
from urdfcal.calibration.analysis.online import OnlineCalibrator
from urdfcal.calibration.analysis.validation import _folds, holdout
from urdfcal.output.text.result import calibration_json, text_report
from urdfcal.robot.robot import Robot
from urdfcal.sensors.measurements import Measurements
from urdfcal.sensors.measurements_csv import read_measurements

NOISE = 0.5 * MM


def example(robots: dict[str, Robot], poses: int = 40) -> tuple[Robot, Measurements]:
    """Poses of the example with its own noise in the readings."""
    robot = robots["arm7"]
    return robot, read_measurements(ROBOTS_DIR / "arm7" / "measurements.csv", robot).split()[0].subset(np.arange(poses))


def read_again(data: Measurements, times: int, own: float, rng: np.random.Generator, jitter: float = 0.0) -> Measurements:
    """Every pose read so many times, one after the other, each reading with noise of its own on top; [m], and [rad] of the joints."""
    again = data.subset(np.repeat(np.arange(len(data)), times))
    again = again.with_spots(again.spots + rng.normal(0, own, again.spots.shape))
    return replace(again, q=again.q + rng.normal(0, jitter, again.q.shape))


@pytest.mark.parametrize("how", [{}, {"spot_sigma": 1 * MM}, {"joint_sigma": 1e-4}, {"estimator": "lse"}, {"estimator": "robust"}], ids=str)
def test_ten_copies_of_a_file_are_one(how: dict[str, float], robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """The same estimate and the same sigma, also where each copy was printed with a few digits less."""
    robot, data = example(robots)
    one = fit(robot, data, **how)  # type: ignore[arg-type]
    ten = data.subset(np.tile(np.arange(len(data)), 10))
    rounded = replace(ten, q=ten.q + rng.uniform(-5e-10, 5e-10, ten.q.shape))
    for copies, close in ((ten, 1e-9), (rounded, 1e-4)):
        found = fit(robot, copies, **how)  # type: ignore[arg-type]
        np.testing.assert_allclose(found.x / one.sigma, one.x / one.sigma, atol=close)
        np.testing.assert_allclose(found.sigma, one.sigma, rtol=close)
        assert found.freedom == pytest.approx(one.freedom, rel=close)
        assert found.chi_squared == pytest.approx(one.chi_squared, rel=10 * close)


def test_copies_of_repeats_are_those_repeats(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Copies of a file in which poses were read three times do not make readings look more alike; a warning counts them."""
    robot, data = example(robots)
    three = read_again(data, 3, NOISE, rng)
    one, copied = fit(robot, three), fit(robot, three.subset(np.tile(np.arange(len(three)), 4)))
    np.testing.assert_allclose(copied.sigma, one.sigma, rtol=1e-12)
    assert any("360 rows are copies of others" in warning for warning in copied.warnings)
    assert not any("copies" in warning for warning in one.warnings)


def test_noise_of_poses_and_of_readings_is_told_apart(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """The sensor's own noise is found beside what poses share, jitter of the joints or not, and both are said."""
    robot, data = example(robots)
    once = fit(robot, data).estimate.noise.sigma[0]
    found = fit(robot, read_again(data, 5, NOISE, rng, jitter=1e-6))
    noise = found.estimate.noise
    assert np.sqrt(noise.sigma[0] ** 2 - noise.sigma_in_common[0] ** 2) == pytest.approx(NOISE, rel=0.15)
    assert noise.sigma_in_common[0] == pytest.approx(once, rel=0.15)
    assert "40 poses (read 200 times)" in text_report(found)
    assert "is common to all readings of a pose" in text_report(found)
    entry = calibration_json(found)
    assert entry["poses"] == {"count": 40, "readings": 200}
    assert entry["noise_in_common"]["spot"] == pytest.approx(noise.sigma_in_common[0])


def test_sigmas_shrink_with_readings_only_as_far_as_their_noise_is_their_own(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Nine readings with independent noise are worth nearly nine, and nine that agree are worth one."""
    robot, data = example(robots)
    how = {"evidence": False, "gated": False}
    clean = data.with_spots(data.spots + rng.normal(0, 5 * MM, data.spots.shape))
    one = fit(robot, clean, spot_sigma=5 * MM, **how)  # type: ignore[arg-type]
    alike = fit(robot, read_again(clean, 9, 0.05 * MM, rng), spot_sigma=5 * MM, **how)  # type: ignore[arg-type]
    free = fit(robot, read_again(data, 9, 5 * MM, rng), spot_sigma=5 * MM, **how)  # type: ignore[arg-type]
    seen = np.array(one.identifiability.determined)
    assert np.median((alike.sigma / one.sigma)[seen]) == pytest.approx(1, abs=0.02)
    assert np.median((free.sigma / one.sigma)[seen]) == pytest.approx(0.42, abs=0.06)  # priors hold, and poses differ


def test_no_pose_is_fitted_and_tested(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Folds and hold-outs take all readings of a pose, every pose once, and as many poses as are asked for."""
    _, data = example(robots)
    again = read_again(data, 3, NOISE, rng, jitter=1e-6)
    again = again.subset(rng.permutation(len(again)))
    poses = again.configuration_of
    folds = _folds(again, 5, rng)
    assert sorted(np.concatenate(folds).tolist()) == list(range(120))
    assert sorted(np.concatenate([np.unique(poses[rows]) for rows in folds]).tolist()) == list(range(40))
    marked = holdout(again, 0.25, rng)
    held = marked.sets == "test"
    assert np.count_nonzero(held) == 30
    assert not np.isin(poses[held], poses[~held]).any()


def test_readings_of_fitted_poses_are_no_good_test(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """A warning counts test readings at joint positions that were fitted; poses of their own have none."""
    robot, data = example(robots)
    again = read_again(data, 2, NOISE, rng, jitter=1e-6)
    rows = np.arange(80)
    leaking = replace(again, sets=np.where((rows % 2 == 1) & (rows < 20), "test", "fit"))
    assert any("10 of 10 test readings were made at joint positions" in warning for warning in fit(robot, leaking).warnings)
    apart = replace(again, sets=np.where(rows < 20, "test", "fit"))
    assert not any("test readings were made" in warning for warning in fit(robot, apart).warnings)


def test_a_pose_that_comes_again_online_is_no_new_one(robots: dict[str, Robot]) -> None:
    """Reading every pose three times over leaves the belief where reading it once does."""
    robot, data = example(robots, 15)
    beliefs = []
    for times in (1, 3):
        online = OnlineCalibrator(robot, spot_sigma=1 * MM)
        for pose in np.repeat(np.arange(len(data)), times).tolist():
            online.update(data.q[pose], data.spots[pose])
        beliefs.append(online)
    one, three = (online.calibration() for online in beliefs)
    np.testing.assert_allclose(three.sigma, one.sigma, rtol=1e-9)
    np.testing.assert_allclose(beliefs[1].state.sigma, one.sigma, rtol=0.02)


def test_the_command_line_says_how_often_poses_were_read(run_cli: Callable[..., CliResult], tmp_path: Path) -> None:
    """A file whose rows stand in it twice, the second time a hair off, is fitted as it is once."""
    lines = (ROBOTS_DIR / "arm7" / "measurements.csv").read_text().splitlines()
    header, *rows = [line.split(",") for line in lines if not line.startswith("#")]
    off = [[label, f"{joint}01", *rest] for label, joint, *rest in rows]
    reports = []
    for name, content in (("once", rows), ("twice", rows + off)):
        file = tmp_path / f"{name}.csv"
        file.write_text("\n".join(",".join(row) for row in [header, *content]) + "\n")
        result = run_cli("fit", ROBOTS_DIR / "arm7" / "arm7.urdf.xacro", file, "--json", "-o", tmp_path / f"{name}.urdf")
        assert result.code == 0
        reports.append(json.loads(result.out))
    once, twice = reports
    assert twice["poses"] == {"count": once["poses"]["count"], "readings": 2 * once["poses"]["count"]}
    sigmas = [[entry["sigma"] for entry in report["parameters"]] for report in reports]
    np.testing.assert_allclose(sigmas[1], sigmas[0], rtol=1e-3)
