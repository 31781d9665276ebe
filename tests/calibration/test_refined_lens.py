"""Lenses of cameras in the fit: refined under the covariance of their calibration, or taken as they are and what that leaves out said."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from tests.conftest import CliResult
from tests.simulation.test_pictures import CAMERA, GRID
from tests.support.paths import ROBOTS_DIR
from urdfcal.api import Calibration, fit
from urdfcal.base.errors import UsageError
from urdfcal.calibration.analysis.uncounted_lens import moved_by_lenses
from urdfcal.calibration.problem import Problem
from urdfcal.robot.robot import Robot
from urdfcal.sensors.camera import Camera, usual_covariance
from urdfcal.sensors.columns import Stations
from urdfcal.sensors.measurements import Measurements, refining
from urdfcal.sensors.measurements_csv import measurements_csv
from urdfcal.simulation.simulated import Simulation, simulate
from urdfcal.vision.camera.camera_file import camera_yaml, read_camera

Run = Callable[..., CliResult]
SIGMA = np.array([2.0, 2.0, 1.5, 1.5, 0.01, 0.03, 5e-4, 5e-4, 0.05])
CORRELATION = np.eye(9)
for _one, _other, _value in ((0, 1, 0.9), (4, 5, -0.9), (5, 8, -0.9), (4, 8, 0.75)):
    CORRELATION[_one, _other] = CORRELATION[_other, _one] = _value
FILE = replace(CAMERA, lens_covariance=CORRELATION * np.outer(SIGMA, SIGMA))
QUICK = {"evidence": False, "asking": False, "gated": False, "sane": False}


@dataclass(frozen=True)
class Pair:
    """Two cameras before a UR5, whose lenses are not quite what their files say."""

    true: dict[str, Camera]
    made: Simulation
    data: Measurements
    refined: Calibration
    taken: Calibration


@pytest.fixture(scope="module")
def pair(robots: dict[str, Robot]) -> Pair:
    """Lenses drawn from the covariance of their files, 30 poses with 0.2 px of noise."""
    rng = np.random.default_rng(8)
    true = {name: FILE.refined(rng.normal(0, 1, 9)) for name in ("one", "two")}
    stations = Stations(dict.fromkeys(true, "base_link"), cameras=true)
    made = simulate(robots["ur5"], 30, sensors=[f"pixels:tool0@{name}" for name in true], boards={"tool0": GRID}, stations=stations, seed=1)
    data = replace(made.measurements, cameras=dict.fromkeys(true, FILE))
    return Pair(true, made, data, fit(robots["ur5"], data, estimate=["lens"], **QUICK), fit(robots["ur5"], data, **QUICK))


def test_a_lens_s_factor_is_its_covariance(rng: np.random.Generator) -> None:
    """F F' is what the file states, also where it states that something is known for certain; refining goes along it."""
    flat = FILE.lens_covariance.copy()
    flat[8], flat[:, 8] = 0.0, 0.0
    for covariance in (FILE.lens_covariance, flat):
        camera = replace(FILE, lens_covariance=covariance)
        np.testing.assert_allclose(camera.lens_factor @ camera.lens_factor.T, covariance, atol=1e-12)
    off = rng.normal(0, 1, 9)
    np.testing.assert_allclose(FILE.refined(off).intrinsics - FILE.intrinsics, FILE.lens_factor @ off, atol=1e-12)
    unstated = replace(FILE, lens_covariance=None)
    np.testing.assert_allclose(unstated.lens_factor @ unstated.lens_factor.T, usual_covariance(unstated), atol=1e-12)


def test_the_jacobian_is_that_of_differences(pair: Pair, rng: np.random.Generator) -> None:
    """Pixels go with every parameter, those of both lenses included, as central differences say, away from the file's lens."""
    problem = Problem(pair.refined.errors, refining(pair.data.subset(np.arange(4)), lens=True))
    x, h = pair.refined.x + rng.normal(0, 1e-3, len(pair.refined.x)), 1e-6
    jacobian = problem.linearise(x).jacobian
    for column in range(len(x)):
        step = h * (np.arange(len(x)) == column)
        numeric = (problem.linearise(x - step).residual - problem.linearise(x + step).residual) / (2 * h)
        np.testing.assert_allclose(jacobian[:, :, column], numeric, rtol=2e-5, atol=5e-5)


def test_the_true_lens_is_found_within_its_sigmas(pair: Pair) -> None:
    """Intrinsics end within their claimed sigmas of the truth, which are well below the calibration's for what pictures tell."""
    found = pair.refined.refined_cameras()
    assert set(found) == {"one", "two"}
    for name, camera in found.items():
        sigma = np.sqrt(np.diag(camera.lens_covariance))
        off = (camera.intrinsics - pair.true[name].intrinsics) / sigma
        assert np.abs(off).max() < 3.5
        assert (sigma <= SIGMA * 1.0001).all()
        assert (sigma[:2] < 0.4 * SIGMA[:2]).all()
    assert pair.refined.estimate.noise.sigma == pytest.approx([0.2], rel=0.1)
    assert "Lenses refined with the fit" in str(pair.refined.report())
    assert pair.taken.refined_cameras() == {}


def test_what_a_lens_moves_is_what_a_fit_with_another_one_gives(pair: Pair, robots: dict[str, Robot]) -> None:
    """A considered parameter's share is how far the answer goes if the file has another focal length, a sigma off."""
    sigmas, certain = {"pixel": float(pair.taken.estimate.noise.sigma[0])}, np.zeros((9, 9))
    certain[:2, :2] = 4.0
    lens = replace(FILE, lens_covariance=certain)
    off = 0.02 * 2.0 * np.array([[1.0, 0, 0], [0, 1.0, 0], [0, 0, 0]])
    cameras = ({"one": own, "two": FILE} for own in (lens, replace(lens, matrix=lens.matrix + off)))
    near, there = (fit(robots["ur5"], replace(pair.data, cameras=own), sigmas=sigmas, **QUICK) for own in cameras)
    moved = np.abs(there.x - near.x) / 0.02 / near.sigma
    joints = np.array([own.kind == "joint" for own in near.errors.parameters])
    np.testing.assert_allclose(moved[joints], moved_by_lenses(near, ["one"])[joints], rtol=0.1, atol=0.03)


def test_what_is_left_out_is_a_reservation(pair: Pair) -> None:
    """A fit that takes lenses as they are says that its sigmas leave them out; one that refines them has nothing to say."""
    said = [reason for reason in pair.taken.verdict.reasons if "--estimate lens" in reason]
    assert len(said) == 1
    assert "the lenses of one and two are known is not in the sigmas" in said[0]
    assert not [reason for reason in pair.refined.verdict.reasons if "lens" in reason]


def test_refined_cameras_are_written_beside(pair: Pair, run_cli: Run, tmp_path: Path) -> None:
    """Each camera goes into a file of its own, which is read back as it was found; without pixels of targets the option is refused."""
    (tmp_path / "file.yaml").write_bytes(camera_yaml(FILE))
    (tmp_path / "rig.yaml").write_text(
        "boards: {tool0: '5x4:30mm'}\ninstruments: {one: {link: base_link, camera: file.yaml}, two: {link: base_link, camera: file.yaml}}\n"
    )
    (tmp_path / "m.csv").write_bytes(measurements_csv(pair.data, []))
    robot = ROBOTS_DIR / "ur5" / "ur5.urdf.xacro"
    done = run_cli("fit", robot, "m.csv", "--rig", "rig.yaml", "-o", "out.urdf", "--estimate", "lens", "--no-ask", "--no-sag")
    assert done.code == 0, done.err
    for name, true in pair.true.items():
        camera = read_camera(tmp_path / f"out_{name}_camera.yaml")
        assert abs(camera.intrinsics[0] - true.intrinsics[0]) < 4 * np.sqrt(camera.lens_covariance[0, 0])
    assert "out_one_camera.yaml and out_two_camera.yaml" in done.out
    with pytest.raises(UsageError, match="estimate lens: no camera sees a target"):
        refining(replace(pair.data, readings=()), lens=True)
