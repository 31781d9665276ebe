"""A camera that looks at a board, or a target, simulated: what is in its pictures, and that a fit takes it back."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pinocchio as pin
import pytest
import yaml

from tests.conftest import CliResult
from tests.support.paths import ROBOTS_DIR
from tests.support.vision_scenes import random_camera
from urdfcal.api import fit
from urdfcal.base.errors import UsageError
from urdfcal.base.geometry import DEG, MM
from urdfcal.model.gauge import build_error_model
from urdfcal.model.options import ModelOptions
from urdfcal.model.parameters import PriorScale
from urdfcal.robot.rig import Grid
from urdfcal.robot.robot import Robot
from urdfcal.simulation.pictures import Subject, camera_place
from urdfcal.simulation.readings import ReadingNoise, simulate_readings, simulated_readings
from urdfcal.simulation.setup import SimulatedSetup, parse_sensors, seen_with, simulated_setup

Run = Callable[..., CliResult]
UR5 = ROBOTS_DIR / "ur5" / "ur5.urdf.xacro"
GRID = Grid(5, 4, 0.03)
CAMERA = replace(
    random_camera(np.random.default_rng(3)),
    size=(1280, 960),
    matrix=np.array([[1100.0, 0, 640], [0, 1100, 480], [0, 0, 1]]),
    distortion=np.array([-0.1, 0.02, 1e-3, -5e-4, 0.0]),
    lens="plain",
)


def setup_of(
    robot: Robot, board: str, rng: np.random.Generator, reference: str = "", words: tuple[str, ...] = (), known: bool = False
) -> SimulatedSetup:
    """A robot with errors, of 2 mm and 0.2 deg, and a board on one of its links before a camera on another."""
    boards = {board: GRID}
    sensors, lasers = parse_sensors((f"pixels:{board}", *words), robot, 1, boards)
    seen = seen_with(robot, sensors, reference, lasers, boards)
    errors = build_error_model(seen.chain, seen.rig, ModelOptions(error_model="auto"))
    x = rng.normal(0, 1, len(errors.names)) * np.where(np.array(errors.units) == "m", 2 * MM, 0.2 * DEG)
    return simulated_setup(seen, errors, x, sensors, rng, camera=CAMERA, boards=boards, reference_known=known)


ARRANGED = {"board on the robot": ("ur5", "tool0", ""), "camera on the robot": ("panda", "panda_link0", "panda_hand")}


@pytest.mark.parametrize("name", ARRANGED)
def test_corners_are_opencv_s_in_the_picture_and_from_the_front(name: str, robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """Every corner that is read is where OpenCV projects it, and those that are not are outside, behind, or on a back."""
    robot, board, reference = ARRANGED[name]
    setup = setup_of(robots[robot], board, rng, reference)
    data = simulate_readings(setup, 30, rng)
    (subject,) = setup.subjects(data.q, "")
    values = {int(own.target.partition(":")[2]): own.values for own in data.readings if own.kind.by_camera}
    for pose in range(len(data)):
        p, R = subject.p[pose], subject.R[pose]
        expected = cv2.projectPoints(GRID.points(), cv2.Rodrigues(R)[0], p, CAMERA.matrix, CAMERA.distortion)[0][:, 0]
        read = np.array([values[corner][pose] if corner in values else (np.nan, np.nan) for corner in range(GRID.corners)])
        seen = np.isfinite(read).all(axis=1)
        np.testing.assert_allclose(read[seen], expected[seen], atol=1e-6)
        points = p + GRID.points() @ R.T
        inside = (np.abs(expected - np.array([639.5, 479.5])) <= np.array([640, 480])).all(axis=1) & (points[:, 2] > 0)
        front = points @ R[:, 2] / np.linalg.norm(points, axis=1) > 0.3
        np.testing.assert_array_equal(seen, inside & front)
        assert seen.sum() >= GRID.corners / 2 - 1
    assert {board: GRID} == data.boards


@pytest.mark.parametrize("name", ARRANGED)
def test_the_truth_is_found_again(name: str, robots: dict[str, Robot]) -> None:
    """Parameters lie within their sigmas, and the pixel noise comes out as it was put in."""
    robot, board, reference = ARRANGED[name]
    rng = np.random.default_rng([7, len(name)])
    setup = setup_of(robots[robot], board, rng, reference)
    data = simulate_readings(setup, 50, rng, ReadingNoise(pixel=0.2))
    found = fit(setup.robot, data, priors={"joint": PriorScale(2 * MM, 0.2 * DEG)})
    assert found.converged
    assert found.estimate.noise.sigma == pytest.approx([0.2], rel=0.1)
    truth = dict(zip(setup.errors.names, setup.x.tolist(), strict=True))
    own = [index for index, parameter in enumerate(found.errors.parameters) if parameter.kind == "joint"]
    off = (found.x[own] - [truth[found.errors.names[index]] for index in own]) / found.sigma[own]
    assert np.abs(off).max() < 4.5
    assert np.sqrt(np.mean(off**2)) < 1.5


def test_noise_is_on_the_pixels_as_stated(robots: dict[str, Robot]) -> None:
    """The same poses with and without noise differ by it, and by nothing else."""
    setup = setup_of(robots["ur5"], "tool0", np.random.default_rng(1))
    still, noisy = (simulate_readings(setup, 60, np.random.default_rng(0), ReadingNoise(pixel=size)) for size in (0.0, 0.5))
    off = np.concatenate([one.values - other.values for one, other in zip(noisy.readings, still.readings, strict=True)])
    assert np.nanstd(off) == pytest.approx(0.5, rel=0.05)


def test_beams_and_board_are_both_in_view(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """With lasers each pose has both on the screen and most of the board in the picture; what was drawn again is counted."""
    found = simulated_readings(setup_of(robots["ur5"], "tool0", rng, words=("laser",)), 6, rng)
    assert all(own.seen.all() for own in found.data.readings if own.kind.beam)
    corners = sum(own.seen.astype(int) for own in found.data.readings if own.kind.by_camera)
    assert corners.min() >= GRID.corners / 2 - 1
    assert found.looked > 6


def test_a_camera_that_sees_nothing_is_refused(robots: dict[str, Robot], rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch) -> None:
    """From a known place that looks away; where no place would do; and without a camera."""
    monkeypatch.setattr("urdfcal.simulation.sights._MOST_PICTURES", 3000)
    setup = setup_of(robots["ur5"], "tool0", rng, known=True)
    away = replace(setup, camera=replace(CAMERA, matrix=CAMERA.matrix * np.array([[500.0], [500], [1]])))
    with pytest.raises(UsageError, match=r"the camera sees its target in \d+ of \d+ random poses, 5 were asked for"):
        simulate_readings(away, 5, rng)
    behind = Subject(np.zeros((9, 3)), np.tile(np.eye(3), (9, 1, 1)), GRID.points(), True)
    tiny = replace(CAMERA, size=(2, 2))
    with pytest.raises(UsageError, match=r"sees its target at 0\.0% of random poses at most"):
        camera_place(tiny, [behind], rng)
    with pytest.raises(UsageError, match="tool0:0 is to be read in pictures: name the camera's lens with --camera"):
        simulated_setup(setup.robot, setup.errors, setup.x, setup.sensors, rng, boards=setup.boards)


def test_a_camera_stands_before_what_it_looks_at(rng: np.random.Generator) -> None:
    """It stands on the front of a board that does not move, upright in no sense but proper, and sees all of it."""
    board = Subject(np.tile([0.3, 0.2, 0.5], (5, 1)), np.tile(pin.exp3(np.array([0.3, 1.0, 0.2])), (5, 1, 1)), GRID.points(), True)
    place = camera_place(CAMERA, [board], rng)
    assert np.linalg.det(place.rotation) == pytest.approx(1.0)
    assert (board.middle[0] - place.translation) @ board.R[0, :, 2] > 0
    assert board.seen_from(place).read(CAMERA).mean() > 0.5


WRONG = {
    ("--sensor", "pixels:tool0", "-o", "-"): "-o -: the camera of these pixels would not be kept; name its lens with --camera YAML",
    ("--camera", "camera.yaml"): "--camera camera.yaml: nothing is read by it; name a board with --board or --rig, or --sensor pixels:LINK",
    ("--camera", "camera.yaml", "--board", "9x6:25mm"): "--board 9x6:25mm: expected the link that it is, too, such as board=9x6:25mm",
    ("--camera", "camera.yaml", "--board", "tool0=9x6"): "--board 9x6: expected COLUMNSxROWS:SQUARE such as 9x6:25mm",
    ("--camera", "camera.yaml", "--board", "tool=9x6:25mm"): "no link named 'tool' among 15 links; did you mean 'tool0'?",
    ("--sensor", "pixels:tool0", "--camera", "no.yaml"): "no.yaml",
    ("--screen-size-m", "1,2,3"): "--screen-size-m 1,2,3: found 3 numbers; expected the screen's width and height in m",
    ("--sensor", "point:tool0", "--pixel-noise-px", "-1"): "noise must be finite and not negative",
}


@pytest.mark.parametrize("words", WRONG, ids=" ".join)
def test_what_cannot_be_pictured_is_refused(words: tuple[str, ...], run_cli: Run, tmp_path: Path) -> None:
    """One line, exit code 2, nothing written."""
    (tmp_path / "camera.yaml").write_text(
        "{size_px: [64, 48], lens: plain, intrinsics: {fx: 60, fy: 60, cx: 32, cy: 24, k1: 0, k2: 0, p1: 0, p2: 0, k3: 0}}"
    )
    code, out, err = run_cli("simulate", UR5, "-o", "m.csv", *words)
    assert WRONG[words] in err
    assert (code, out, err.count("\n")) == (2, "", 1)
    assert not (tmp_path / "m.csv").exists()


def test_the_file_says_what_a_fit_has_to_be_told(run_cli: Run, tmp_path: Path) -> None:
    """Its comments hold the options and the rig.yaml that read it; a smaller screen takes more poses, which is told."""
    intrinsics = "{fx: 1100, fy: 1100, cx: 640, cy: 480, k1: -0.1, k2: 0.02, p1: 0, p2: 0, k3: 0}"
    (tmp_path / "camera.yaml").write_text(f"{{size_px: [1280, 960], lens: plain, intrinsics: {intrinsics}}}")
    words = ("simulate", UR5, "-o", "m.csv", "--poses", "20", "--camera", "camera.yaml", "--board", "tool0=5x4:30mm")
    assert run_cli(*words, "--reference", "base").code == 0
    comments = [line for line in (tmp_path / "m.csv").read_text().splitlines() if line.startswith("#")]
    told = next(line for line in comments if "urdfcal fit ..." in line)
    rig = next(line for line in comments if "for a rig.yaml" in line)
    (tmp_path / "rig.yaml").write_text(rig.partition("rig.yaml: ")[2])
    assert yaml.safe_load((tmp_path / "rig.yaml").read_text()) == {"boards": {"tool0": "5x4:30mm"}}
    checked = run_cli("check", UR5, "m.csv", *told.partition("fit ... ")[2].split(), "--rig", "rig.yaml")
    assert checked.code == 0, checked.err
    assert "spots or targets in pictures" in checked.out
    assert not (tmp_path / "m_camera.yaml").exists()
    shares = []
    for side in ("3", "2,1"):
        said = run_cli("simulate", UR5, "-o", "s.csv", "--poses", "5", "--screen-size-m", side).out.splitlines()[-1]
        assert f"for 5 with every beam on the screen of {'3 x 3' if side == '3' else '2 x 1'} m" in said
        shares.append(int(said.split()[2]))
    assert shares[0] < shares[1]
