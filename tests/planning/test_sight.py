"""What sensors see at some poses, told by other roads: OpenCV's projection, angles worked out pose by pose, Pinocchio's frames."""

from __future__ import annotations

import cv2
import numpy as np
import pinocchio as pin
import pytest

from tests.support.small_robot import robot_of
from urdfcal.base.errors import UsageError
from urdfcal.base.geometry import DEG, Matrix
from urdfcal.model.options import ModelOptions
from urdfcal.planning.measuring import Asked, Measuring, measuring
from urdfcal.planning.plan import plan_poses
from urdfcal.planning.sight import HIDDEN, Eyes
from urdfcal.robot.configurations import random_positions, whole_configurations
from urdfcal.robot.rig import Grid
from urdfcal.robot.robot import Robot
from urdfcal.robot.sheet import ScreenArea
from urdfcal.sensors.camera import Camera
from urdfcal.sensors.columns import Stations
from urdfcal.sensors.sensor import Sight

LENS = Camera((1200, 900), np.array([[900.0, 0, 610], [0, 905, 440], [0, 0, 1]]), np.array([-0.12, 0.05, 1e-3, -2e-3, 0.0]))
GRID = Grid(7, 5, 0.03)
BESIDE = '<link name="{name}"/><joint name="{name}_mount" type="fixed"><parent link="{parent}"/><child link="{name}"/>{origin}</joint>'


@pytest.fixture(scope="module")
def robot(robots: dict[str, Robot], tmp_path_factory: pytest.TempPathFactory) -> Robot:
    """A UR5 with a board before its flange, a camera beside it, and another one on its forearm."""
    places = {
        "board": ("tool0", '<origin xyz="-0.09 0.06 0.05" rpy="3.14159265 0 0"/>'),
        "camera": ("base_link", '<origin xyz="1.4 0.2 0.5" rpy="-1.5708 0 1.5708"/>'),
        "away": ("base_link", '<origin xyz="1.4 0.2 0.5" rpy="-1.5708 0 -1.5708"/>'),
        "eye": ("base_link", '<origin xyz="-1.2 0.4 0.6" rpy="-1.5708 0 -1.5708"/>'),
    }
    put = "".join(BESIDE.format(name=name, parent=parent, origin=origin) for name, (parent, origin) in places.items())
    text = robots["ur5"].description.text.decode().replace("</robot>", f"{put}</robot>")
    return robot_of(text, str(tmp_path_factory.mktemp("robot") / "board.urdf"))


def frames_of(robot: Robot, q: Matrix, *links: str) -> list[list[pin.SE3]]:
    """Where links are in the root, pose by pose."""
    data, found = robot.model.createData(), []
    for whole in whole_configurations(robot, q):
        pin.framesForwardKinematics(robot.model, data, whole)
        found.append([pin.SE3(data.oMf[robot.model.getFrameId(link)]) for link in links])
    return found


def made_of(robot: Robot, *sensors: str, **more: object) -> Measuring:
    """What measures."""
    return measuring(robot, Asked(sensors, **more), ModelOptions(), np.random.default_rng(0))  # type: ignore[arg-type]


def board_seen(camera: pin.SE3, board: pin.SE3) -> bool:
    """By cv2.projectPoints, and the angle at every outer corner between the board's normal and the line of sight."""
    T = camera.inverse() * board
    corners = np.array([[x * GRID.square, y * GRID.square, 0.0] for y in range(GRID.rows) for x in range(GRID.columns)])
    points = corners @ T.rotation.T + T.translation
    if (points[:, 2] <= 0.02).any():
        return False
    pixels, _ = cv2.projectPoints(corners, cv2.Rodrigues(T.rotation)[0], T.translation, LENS.matrix, LENS.distortion)
    inside = ((pixels[:, 0] >= -0.5) & (pixels[:, 0] <= np.array(LENS.size) - 0.5)).all()
    outer = points[[0, GRID.columns - 1, -GRID.columns, -1]]
    turned = np.degrees(np.arccos(outer @ T.rotation[:, 2] / np.linalg.norm(outer, axis=1)))
    rows = pixels[:, 0].reshape(GRID.rows, GRID.columns, 2)
    sides = [np.linalg.norm(np.diff(rows, axis=axis), axis=2).min() for axis in (0, 1)]
    return bool(inside and (turned <= 60).all() and min(sides) >= 8)


def test_boards_are_seen_as_opencv_projects_them(robot: Robot, rng: np.random.Generator) -> None:
    """In 3000 random poses the same boards are in the picture, turned to the camera and large enough; the plan's poses are all such."""
    made = made_of(robot, "pixels:board", reference="camera", camera=LENS, boards={"board": GRID})
    q = random_positions(made.robot, 3000, rng)
    expected = np.array([board_seen(camera, board) for camera, board in frames_of(made.robot, q, "camera", "board")])
    found = Eyes(made, Sight(area=made.area)).geometry(q)
    assert expected.sum() > 30
    assert (found.any != expected).sum() <= 3  # squares that are only just large enough
    assert found.read.shape == (3000, GRID.corners)
    assert not made.assumed
    plan = plan_poses(robot, candidates=60, n=8, sensors=["pixels:board"], reference="camera", camera=LENS, boards={"board": GRID})
    assert all(board_seen(camera, board) for camera, board in frames_of(plan.robot, plan.q, "camera", "board"))
    assert plan.looked > 60
    assert sum(plan.reasons.values()) < plan.looked
    assert plan.tool_sigma_mm[-1] < 0.1 * plan.tool_sigma_mm[0]


def test_either_camera_is_enough_and_reads_alone(robot: Robot, rng: np.random.Generator) -> None:
    """With two instruments a pose counts where one sees the board, and the other reads nothing there."""
    stations = Stations({"one": "camera", "two": "eye"}, {"one": LENS, "two": LENS})
    made = made_of(robot, "pixels:board@one", "pixels:board@two", boards={"board": GRID}, stations=stations)
    q = random_positions(made.robot, 1500, rng)
    found = Eyes(made, Sight(area=made.area)).geometry(q)
    frames = frames_of(made.robot, q, "camera", "eye", "board")
    both = [np.array([board_seen(own[index], own[2]) for own in frames]) for index in (0, 1)]
    assert both[0].sum() > 5
    assert both[1].sum() > 5
    assert (found.any != (both[0] | both[1])).sum() <= 3
    assert (found.read[:, 0] != both[0]).sum() <= 3
    assert (found.read[:, -1] != both[1]).sum() <= 3
    assert not made.assumed


def test_a_target_opens_along_its_z(robot: Robot, rng: np.random.Generator) -> None:
    """Within the angle between the target's z and the line to the tracker, pose by pose."""
    made = made_of(robot, "point:tool0", reference="camera")
    q = random_positions(made.robot, 500, rng)
    expected = []
    for camera, tool in frames_of(made.robot, q, "camera", "tool0"):
        towards = camera.translation - tool.translation
        expected.append(tool.rotation[:, 2] @ towards / np.linalg.norm(towards) >= np.cos(40 * DEG))
    found = Eyes(made, Sight(opening=40 * DEG)).geometry(q)
    assert np.array_equal(found.any, expected)
    assert 20 < np.sum(expected) < 200
    assert Eyes(made, Sight()).geometry(q).any.all()


def test_a_tracker_sees_from_its_least_to_its_largest_distance(robot: Robot, rng: np.random.Generator) -> None:
    """Of 500 random poses those whose target is 1 to 1.6 m from the tracker, by Pinocchio's frames; the reasons say which is which."""
    made = made_of(robot, "pose:tool0", reference="camera")
    q = random_positions(made.robot, 500, rng)
    far = np.array([np.linalg.norm(camera.translation - tool.translation) for camera, tool in frames_of(made.robot, q, "camera", "tool0")])
    found = Eyes(made, Sight(nearest=1.0, farthest=1.6)).geometry(q)
    assert np.array_equal(found.any, (far >= 1.0) & (far <= 1.6))
    assert np.array_equal(found.why == "are nearer to the instrument than 1 m", far < 1.0)
    assert np.array_equal(found.why == "are farther from the instrument than 1.6 m", far > 1.6)
    assert min((far < 1.0).sum(), (far > 1.6).sum(), found.any.sum()) > 20


def test_lines_of_sight_end_at_tracker_and_target(robot: Robot, rng: np.random.Generator) -> None:
    """What is asked whether it is hidden are these two points, brought into the root by Pinocchio, and what is hidden is not read."""
    made = made_of(robot, "pose:tool0", reference="camera")
    q, asked = random_positions(made.robot, 20, rng), []

    def hidden(seen: Robot, q: Matrix, begin: Matrix, end: Matrix) -> np.ndarray:
        asked.append((begin, end))
        return np.arange(len(q)) % 2 == 0

    found = Eyes(made, Sight()).unhidden(q, hidden)
    assert np.array_equal(found.any, np.arange(20) % 2 == 1)
    assert set(found.why.tolist()) == {"", HIDDEN}
    assert not found.read[::2].any()
    (begin, end), *_ = asked
    for row, (base, camera, tool) in enumerate(frames_of(made.robot, q, made.robot.rig.base, "camera", "tool0")):
        assert np.allclose(base.act(begin[row]), camera.translation, atol=1e-9)
        assert np.allclose(base.act(end[row]), tool.translation, atol=1e-9)


def test_beams_meet_the_screen_not_too_flatly_and_apart(robots: dict[str, Robot], rng: np.random.Generator) -> None:
    """By where each beam meets the plane x = 0 of the screen, pose by pose: on it, from ahead, under 70 deg, and spots 20 mm apart."""
    made = made_of(robots["ur5"], "laser", area=ScreenArea((2.0, 1.2)))
    q = random_positions(made.robot, 4000, rng)
    expected, why = [], []
    for screen, *lasers in frames_of(made.robot, q, "screen", *made.robot.rig.lasers):
        spots, good = [], True
        for laser in (screen.inverse() * own for own in lasers):
            length = -laser.translation[0] / laser.rotation[0, 2]
            spots.append((laser.translation + length * laser.rotation[:, 2])[1:])
            good &= length > 0.1 and bool((np.abs(spots[-1]) <= [1.0, 0.6]).all()) and abs(laser.rotation[0, 2]) >= np.cos(70 * DEG)
        apart = np.linalg.norm(spots[0] - spots[1])
        expected.append(good and apart >= 0.02)
        why.append(good and apart < 0.02)
    found = Eyes(made, Sight(area=made.area)).geometry(q)
    assert np.array_equal(found.any, expected)
    assert np.array_equal(found.why == "have spots less than 20 mm apart", why)
    assert np.sum(expected) > 30


def test_what_is_assumed_is_said(robot: Robot) -> None:
    """A camera without a place is put where it sees much, a tracker without one asks for its link; neither where a link is named."""
    (camera,) = made_of(robot, "pixels:board", camera=LENS, boards={"board": GRID}).assumed
    assert "it is taken to be where it sees much, at xyz" in camera
    assert "name its link with --reference" in camera
    (tracker,) = made_of(robot, "point:tool0").assumed
    assert "nothing is known of its lines of sight" in tracker
    assert not made_of(robot, "point:tool0@camera").assumed
    with pytest.raises(UsageError, match="name the camera's lens with --camera"):
        made_of(robot, "pixels:board", boards={"board": GRID})
    with pytest.raises(UsageError, match="no instrument or link named 'leica'"):
        made_of(robot, "point:tool0@leica")


def test_too_few_that_can_be_measured_are_refused_with_reasons(robot: Robot) -> None:
    """A camera that looks away sees none, and how many fall to which reason is said."""
    with pytest.raises(UsageError, match=r"4 poses wanted of 0 candidates; 0 of \d+ random poses can be measured: \d+ are out of"):
        plan_poses(robot, candidates=20, n=4, sensors=["pixels:board"], reference="away", camera=LENS, boards={"board": GRID})
