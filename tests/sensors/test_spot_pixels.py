"""Laser spots, and targets, read as pixels of a calibrated camera."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from tests.support.helpers import assert_poses_close
from urdfcal.api import fit
from urdfcal.base.errors import MeasurementError, UsageError
from urdfcal.calibration.problem import Problem
from urdfcal.calibration.reach import draw_poses
from urdfcal.calibration.start.frames import _nominal
from urdfcal.model.gauge import build_error_model
from urdfcal.robot.rig import SIX, Grid
from urdfcal.robot.robot import Robot
from urdfcal.sensors.camera import Camera
from urdfcal.sensors.measurements import Measurements, as_measured, as_spots, spots_measured
from urdfcal.sensors.measurements_csv import measurements_csv, read_measurements
from urdfcal.sensors.readings import Readings
from urdfcal.simulation.readings import true_spots
from urdfcal.vision.camera.camera_file import camera_yaml

NOISE_PX = 0.1
WRONG = np.array([2e-3, -1e-3, 3e-3, 2e-3, -3e-3, 1e-3])  # of the screen's calibration, [m] and [rad]
SCREEN_TO_CAMERA = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])


@pytest.fixture(scope="module")
def camera() -> Camera:
    """A camera three metres before the screen, looking at it obliquely."""
    placement = pin.SE3(pin.exp3(np.array([0.1, 0.5, 0.05])) @ SCREEN_TO_CAMERA, np.array([0.1, -0.1, 3.0]))
    matrix = np.array([[900.0, 0.0, 640.0], [0.0, 900.0, 480.0], [0.0, 0.0, 1.0]])
    return Camera((1280, 960), matrix, np.array([-0.2, 0.05, 0.0, 0.0, 0.0]), "plain", placement)


def in_pixels(robot: Robot, camera: Camera, rng: np.random.Generator, poses: int = 60) -> tuple[Measurements, dict[str, float]]:
    """Pixels of a Panda with errors, before a screen that does not stand quite where the camera's calibration has it; and its truth."""
    errors = build_error_model(robot.chain, robot.rig)
    x = rng.normal(0, 1, len(errors.names)) * np.where(np.array(errors.units) == "m", 1e-3, 2e-3)
    q = draw_poses(robot, errors, x, poses, rng)
    assert camera.T_camera_screen is not None
    true = replace(camera, T_camera_screen=camera.T_camera_screen * pin.exp6(pin.Motion(WRONG)))
    pixels = true.pixels_of_spots(true_spots(robot, errors, x, q).reshape(-1, 2)).reshape(-1, 2, 2)
    pixels = pixels + rng.normal(0, NOISE_PX, pixels.shape)
    blank, none = np.full(poses, ""), np.full(poses, np.nan)
    readings = tuple(Readings("spot_pixel", laser, laser, pixels[:, index], blank, none) for index, laser in enumerate(robot.rig.lasers))
    data = spots_measured(robot, q, np.full((poses, 2, 2), np.nan))
    return replace(data, camera=camera, readings=readings), dict(zip(errors.names, x.tolist(), strict=True))


def test_a_pixel_is_shown_where_its_ray_meets_the_screen(robots: dict[str, Robot], camera: Camera, rng: np.random.Generator) -> None:
    """Wherever the screen stands before the camera: what is read without noise is shown at the predicted spot."""
    data, _ = in_pixels(robots["panda"], camera, rng, 8)
    errors = build_error_model(robots["panda"].chain, as_measured(robots["panda"], data).rig)
    problem = Problem(errors, data)
    x = np.where([name.startswith("camera.") for name in errors.names], 2e-3, 0.0)
    for channel, view in zip(problem.channels, problem.views(x), strict=True):
        spots = channel.sensor.shown(view, channel.sensor.read(view))
        np.testing.assert_allclose(spots, channel.sensor.predicted(view), atol=1e-9)
        assert view.place.all()


def test_pixels_have_the_derivatives_of_their_differences(robots: dict[str, Robot], camera: Camera, rng: np.random.Generator) -> None:
    """The Jacobian, the camera's errors included, is that of central differences away from zero."""
    data, _ = in_pixels(robots["panda"], camera, rng, 8)
    found = build_error_model(robots["panda"].chain, robots["panda"].seen_by(data.instruments, None).rig)
    model, x = Problem(found, data), rng.normal(0, 3e-3, len(found.names))
    assert {"camera.trans_x", "camera.rot_z"} <= set(found.names)
    J, h = model.linearise(x).jacobian, 1e-6
    steps = h * np.eye(len(x))
    differences = np.stack([(model.linearise(x - dx).residual - model.linearise(x + dx).residual) / (2 * h) for dx in steps], axis=-1)
    np.testing.assert_allclose(J, differences, atol=1e-7 * np.abs(J).max())


def test_a_wrong_screen_calibration_is_found_and_kept_out_of_the_joints(
    robots: dict[str, Robot], camera: Camera, rng: np.random.Generator
) -> None:
    """Fitted as pixels the screen's tilt in front of the camera comes out, and the parameters are within what they claim."""
    robot = robots["panda"]
    data, truth = in_pixels(robot, camera, rng)
    found = fit(robot, data, spot_sigma=None)
    assert found.converged
    assert found.estimate.noise.sigma[-1] == pytest.approx(NOISE_PX, rel=0.15)
    tilt = found.errors.names.index("camera.rot_y")
    assert abs(found.x[tilt] - WRONG[4]) < 4 * found.sigma[tilt] < 2e-3
    off = np.array(
        [
            (value - truth[name]) / sigma
            for name, value, sigma in zip(found.errors.names, found.x, found.sigma, strict=True)
            if name in truth
        ]
    )
    assert np.sqrt(np.mean(off**2)) < 1.5
    as_calibrated = fit(robot, as_spots(data))
    assert as_calibrated.after["laser_1"].mean > 1.5 * NOISE_PX * 3.0 / 900 * 1e3  # such a tilt does not fit into a rigid screen's spots


def test_the_command_line_takes_the_camera(
    robots: dict[str, Robot], camera: Camera, rng: np.random.Generator, run_cli: Callable[..., object], tmp_path: Path
) -> None:
    """`fit --camera` reads .u and .v; without the camera they are refused in one line that says so."""
    data, _ = in_pixels(robots["panda"], camera, rng)
    (tmp_path / "camera.yaml").write_bytes(camera_yaml(camera))
    (tmp_path / "m.csv").write_bytes(measurements_csv(data))
    urdf = robots["panda"].description.path
    done = run_cli("fit", urdf, "m.csv", "--camera", "camera.yaml", "--no-sag")
    assert done.code == 0  # type: ignore[attr-defined]
    assert "pixel noise 0.1" in done.out  # type: ignore[attr-defined]
    stem = robots["panda"].description.stem
    written = f"wrote {stem}_calibrated.urdf, {stem}_calibration.yaml and {stem}_camera.yaml"
    assert written in done.out  # type: ignore[attr-defined]
    with pytest.raises(MeasurementError, match=r"column 'laser_1.u': pixels need the camera"):
        read_measurements(tmp_path / "m.csv", robots["panda"])


def test_the_corrected_camera_repeats_the_fits_figures(
    robots: dict[str, Robot], camera: Camera, rng: np.random.Generator, run_cli: Callable[..., object], tmp_path: Path
) -> None:
    """`evaluate` and `view` of the calibrated URDF with the camera that `fit` wrote have the fit's own errors; with the old one not."""
    data, _ = in_pixels(robots["panda"], camera, rng)
    (tmp_path / "old.yaml").write_bytes(camera_yaml(camera))
    (tmp_path / "m.csv").write_bytes(measurements_csv(data))
    (tmp_path / "arm.urdf").write_bytes(robots["panda"].description.text)
    fitted = json.loads(run_cli("fit", "arm.urdf", "m.csv", "--camera", "old.yaml", "--no-sag", "--json").out)  # type: ignore[attr-defined]
    assert fitted["files"]["camera"] == "arm_camera.yaml"

    def after(used: str) -> dict[str, dict[str, float]]:
        done = run_cli("evaluate", "arm_calibrated.urdf", "m.csv", "--camera", used, "--json")
        return dict(json.loads(done.out)["after"])  # type: ignore[attr-defined]

    for name, row in after("arm_camera.yaml").items():
        assert row == pytest.approx(fitted["after"][name], rel=1e-6)
    assert all(row["mean_px"] > 1.5 * fitted["after"][name]["mean_px"] for name, row in after("old.yaml").items())
    again = run_cli("fit", "arm.urdf", "m.csv", "--camera", "arm_camera.yaml", "--no-sag")
    assert again.code == 2  # type: ignore[attr-defined]
    assert "arm_camera.yaml: is an input of this command; name another output with -o" in again.err  # type: ignore[attr-defined]


def test_a_calibration_shows_itself_with_the_camera_that_it_found(
    robots: dict[str, Robot], camera: Camera, rng: np.random.Generator
) -> None:
    """In the view's scene the calibrated robot's spots, seen by the corrected camera, are as far from the pixels as in the fit's table."""
    data, _ = in_pixels(robots["panda"], camera, rng)
    found = fit(robots["panda"], data)
    scene = found.show().scene
    assert scene.after is not None
    off = [
        np.linalg.norm(found.corrected_camera().pixels_of_spots(scene.after.spots[:, laser]) - data.readings[laser].values, axis=1)
        for laser in range(2)
    ]
    np.testing.assert_allclose(np.mean(off, axis=1), [found.after[f"laser_{laser + 1} pixels"].mean for laser in range(2)], rtol=1e-6)
    metres_per_px = 3.0 / 900
    assert np.mean([row.means[1] for row in scene.compared]) < 1.5 * np.mean(off) * metres_per_px * 1e3


def test_the_corrected_camera_knows_how_well_its_screen_is_known(
    robots: dict[str, Robot], camera: Camera, rng: np.random.Generator
) -> None:
    """The true placement lies within its covariance; what is held stays as it was calibrated, and metres correct no camera."""
    robot, (data, _) = robots["panda"], in_pixels(robots["panda"], camera, rng)
    found = fit(robot, data).corrected_camera()
    assert camera.T_camera_screen is not None
    true = camera.T_camera_screen * pin.exp6(pin.Motion(WRONG))
    off = pin.log6(found.T_camera_screen.actInv(true)).vector
    assert found.screen_covariance is not None
    assert off @ np.linalg.solve(found.screen_covariance, off) < 22.5  # chi-square of six, one in a thousand
    known = replace(camera, screen_covariance=1e-8 * np.eye(6))
    held = fit(robot, replace(data, camera=known), fix=["camera.*"]).corrected_camera()
    assert_poses_close(held.T_camera_screen, camera.T_camera_screen)
    np.testing.assert_array_equal(held.screen_covariance, known.screen_covariance)
    with pytest.raises(UsageError, match="no laser spots were read as pixels"):
        fit(robot, as_spots(data)).corrected_camera()


def test_a_camera_without_a_screen_is_refused(robots: dict[str, Robot], camera: Camera, rng: np.random.Generator) -> None:
    """Pixels of spots mean nothing before the screen's place in front of the camera is known."""
    data, _ = in_pixels(robots["panda"], camera, rng, 20)
    with pytest.raises(UsageError, match="the camera knows no screen"):
        fit(robots["panda"], replace(data, camera=replace(camera, T_camera_screen=None)))


def test_a_target_in_pictures_calibrates_the_arm(robots: dict[str, Robot], camera: Camera, rng: np.random.Generator) -> None:
    """A point on the last link, seen as pixels by a fixed camera whose place is not known, is predicted to its noise on unseen poses."""
    robot, n = robots["ur5"], 160
    target = "slm"
    bare = spots_measured(robot, rng.uniform(-2.0, 2.0, (n, 6)), np.full((n, 2, 2), np.nan))
    blank, none = np.full(n, ""), np.full(n, np.nan)
    point = Readings("point", target, target, np.zeros((n, 3)), blank, none)
    seen = robot.seen_by(replace(bare, readings=(point,)).instruments, ())
    errors = build_error_model(seen.chain, seen.rig)
    joints = np.array([parameter.kind == "joint" for parameter in errors.parameters])
    x = np.where(joints, rng.normal(0, 1, len(joints)) * np.where(np.array(errors.units) == "m", 1e-3, 2e-3), 0.0)
    places = -Problem(errors, replace(bare, readings=(point,))).linearise(x).residual
    T_camera_root = pin.SE3(SCREEN_TO_CAMERA, np.array([0.0, 0.3, 2.5]))
    pixels = camera.project(places @ T_camera_root.rotation.T + T_camera_root.translation)
    kept = np.isfinite(pixels).all(axis=1)
    read = Readings("pixel", target, target, (pixels + rng.normal(0, NOISE_PX, pixels.shape))[kept], blank[kept], none[kept])
    data = replace(replace(bare, readings=()).subset(kept), camera=camera, readings=(read,))
    half = np.arange(len(data)) < len(data) // 2
    found = fit(robot, data.subset(half), test=data.subset(~half))
    assert found.converged
    assert found.test is not None
    assert found.test[1][f"{target} pixels"].mean < 4 * NOISE_PX < found.test[0][f"{target} pixels"].mean


@pytest.mark.parametrize("carried", [False, True], ids=["camera fixed", "camera carried"])
def test_a_board_calibrates_the_arm(robots: dict[str, Robot], camera: Camera, rng: np.random.Generator, carried: bool) -> None:
    """Corners of one board, on the hand before a fixed camera or the other way round, share one placement that is found from nothing."""
    robot, n, grid = robots["ur5"], 60, Grid(4, 3, 0.03)
    board, reference = ("base_link", "slm") if carried else ("slm", "base_link")
    blank, none = np.full(n, ""), np.full(n, np.nan)
    q = np.array([0.0, -1.2, 1.4, -1.8, -1.5, 0.3]) + rng.uniform(-0.35, 0.35, (n, 6))
    bare = spots_measured(robot, q, np.full((n, 2, 2), np.nan))
    points = tuple(Readings("pixel", f"{board}:{k}", board, np.full((n, 2), 1.0), blank, none) for k in range(grid.corners))
    data = replace(bare, readings=points, camera=camera, boards={board: grid}, reference=reference)
    seen = robot.seen_by(data.instruments, ())
    order = [bare.joints.index(name) for name in seen.chain.input_names]  # the way starts at the camera
    q, data = q[:, order], replace(data, joints=seen.chain.input_names, q=q[:, order])
    errors = build_error_model(seen.chain, seen.rig)
    joints = np.array([parameter.kind == "joint" for parameter in errors.parameters])
    x = np.where(joints, rng.normal(0, 1, len(joints)) * np.where(np.array(errors.units) == "m", 1e-3, 2e-3), 0.0)
    R, b = _nominal(errors, q[:1], f"{board}:0", 0, "")
    offset = pin.SE3(pin.exp3(np.array([0.2, -0.1, 0.3])), np.array([0.05, 0.02, 0.04]))
    ahead = pin.SE3(pin.exp3(np.array([0.3, 0.2, 0.1])), np.array([0.0, 0.0, 0.9]))  # the board before the camera at the first pose
    frames = {"target": offset, "reference": pin.SE3(R[0], b[0]) * offset * ahead.inverse()}
    slots = tuple(replace(slot, found={"": frames[slot.kind]}) if slot.frame is not None else slot for slot in errors.slots)
    true = replace(errors, slots=slots)
    pixels = 1.0 - Problem(true, data).linearise(x).residual
    pixels = pixels + rng.normal(0, NOISE_PX, pixels.shape)
    read = tuple(replace(each, values=pixels[:, 2 * k : 2 * k + 2]) for k, each in enumerate(points))
    half = np.arange(n) < n // 2
    whole = replace(data, readings=read)
    found = fit(robot, whole.subset(half), test=whole.subset(~half))
    assert found.converged
    assert [name for name in found.errors.names if name.startswith(f"{board}.")] == [f"{board}.{name}" for name in SIX]
    assert found.test is not None
    before, after = (table[f"{board} pixels"].mean for table in found.test)
    assert after < min(1.6 * NOISE_PX, 0.8 * before)
