"""Where a wrist camera sits: `urdfcal.fit` from the corners of a board, beside OpenCV's hand-eye methods from the same corners.

    python tests/benchmarks/hand_eye.py [--cameras N] [--opencv PYTHON] [--factory CSV]

Simulated: every camera has a lens and a mount of its own on a UR5's flange and sees a ChArUco board that lies before the arm, 80 % of its
corners in the picture or more, with 0.1 px of noise; the lens is known. Arms are perfect, or have the errors that their makers measured
on UR arms (`ur_factory`). OpenCV gets each view's pose from solvePnP (IPPE, then Levenberg-Marquardt) and the nominal robot's flange.

OpenCV 5 lacks calibrateHandEye: PYTHON is an interpreter with NumPy and OpenCV 4; without it those rows are left out. What turns along with
the last joint (its own shift along, and turn about, its axis) is counted to the camera's place, for all alike.
"""

from __future__ import annotations

import argparse
import csv
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pinocchio as pin

sys.path.insert(0, str(Path(__file__).parents[2]))

import urdfcal
from tests.benchmarks.boards import a_camera
from tests.support.flat_boards import facing
from tests.support.paths import ROBOTS_DIR, SHARED_DATA
from urdfcal.output.text.instruments import frame_entries
from urdfcal.robot.robot import with_text
from urdfcal.robot.urdf_writer import with_origins
from urdfcal.sensors.camera import Camera
from urdfcal.vision.camera.sought import Sought, parse_board

BOARD, NOISE_PX, WITHIN = "charuco:7x5:40mm:30mm", 0.1, 1.959964
JOINTS = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")
FRAMES = ("shoulder", "upper_arm", "forearm", "wrist_1", "wrist_2", "wrist_3")  # as ur_factory names what those joints carry
HOME = np.array([0.3, -1.3, 1.6, -1.8, -1.4, 0.2])
OPENCV = """
import sys, numpy as np, cv2
given, found = np.load(sys.argv[1]), {}
methods = {name: getattr(cv2, f"CALIB_HAND_EYE_{name}") for name in ("TSAI", "PARK", "HORAUD", "ANDREFF", "DANIILIDIS")}
worlds = {f"robot-world {name}": getattr(cv2, f"CALIB_ROBOT_WORLD_HAND_EYE_{name}") for name in ("SHAH", "LI")}
for trial in range(int(given["trials"])):
    hand, pixels, K, d = (given[f"{name}{trial}"] for name in ("hand", "pixels", "K", "d"))
    board = []
    for view in pixels:
        seen = np.isfinite(view).all(axis=1)
        points, own = given["points"][seen], view[seen]
        _, turn, shift = cv2.solvePnP(points, own, K, d, flags=cv2.SOLVEPNP_IPPE)
        turn, shift = cv2.solvePnPRefineLM(points, own, K, d, turn, shift)
        T = np.eye(4)
        T[:3, :3], T[:3, 3:] = cv2.Rodrigues(turn)[0], shift
        board.append(T)
    R = lambda poses: [T[:3, :3] for T in poses]
    t = lambda poses: [T[:3, 3] for T in poses]
    back = [np.linalg.inv(T) for T in hand]
    for name in (*methods, *worlds):
        try:
            if name in methods:
                turn, shift = cv2.calibrateHandEye(R(hand), t(hand), R(board), t(board), method=methods[name])
            else:  # world is the board, base the flange's other end: base to gripper gives gripper to camera
                _, _, turn, shift = cv2.calibrateRobotWorldHandEye(R(board), t(board), R(back), t(back), method=worlds[name])
        except cv2.error:
            continue
        T = np.eye(4)
        T[:3, :3], T[:3, 3:] = turn, np.reshape(shift, (3, 1))
        found[f"{name}/{trial}"] = T if name in methods else np.linalg.inv(T)
np.savez(sys.argv[2], **found)
"""


@dataclass(frozen=True)
class Trial:
    """A camera on an arm and what it sees: positions (n, 6), the nominal flange (n, 4, 4), pixels (n, corners, 2), nan where unseen."""

    camera: Camera
    T_tool_camera: pin.SE3
    q: np.ndarray
    hand: np.ndarray
    pixels: np.ndarray


def main() -> None:
    """Print the table as Markdown."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cameras", type=int, default=40)
    parser.add_argument("--poses", type=int, nargs="+", default=[15, 30])
    parser.add_argument("--opencv", type=Path, help="Interpreter with OpenCV 4.")
    parser.add_argument("--factory", type=Path, default=SHARED_DATA / "ur_factory" / "joint_frame_deltas.csv")
    arguments = parser.parse_args()
    print("| arm | poses | method | off, mm: median | 95 % | deg: median | 95 % | within 1.96 sigma |\n|" + "---|" * 8)
    for kind in ("perfect", *(("ur_factory",) if arguments.factory.is_file() else ())):
        arms = factory(arguments.factory) if kind == "ur_factory" else [np.zeros((6, 6))]
        for poses in arguments.poses:
            compare(kind, arms, arguments.cameras, poses, arguments.opencv)


def compare(kind: str, arms: list[np.ndarray], cameras: int, poses: int, opencv: Path | None) -> None:
    """The rows of one kind of arm and number of poses."""
    sought = parse_board(BOARD)
    robot = urdfcal.load_robot(ROBOTS_DIR / "ur5" / "ur5.urdf.xacro")
    trials = [trial_of(robot, arms[number % len(arms)], sought, poses, np.random.default_rng(1000 + number)) for number in range(cameras)]
    for name, fix in (("`urdfcal.fit`", ()), ("the same, joints held", tuple(f"{joint}_joint.*" for joint in JOINTS))):
        found = [fitted(robot, trial, sought, fix) for trial in trials]
        scaled = np.concatenate([own[1] for own in found])
        row(kind, poses, name, trials, [own[0] for own in found], f"{np.mean(np.abs(scaled) < WITHIN):.1%}")
    if opencv is None:
        print(f"| {kind} | {poses} | OpenCV: skipped, no --opencv |")
        return
    for name, Ts in by_opencv(opencv, trials, sought).items():
        row(kind, poses, name, trials, Ts, "")


def row(kind: str, poses: int, name: str, trials: list[Trial], Ts: list[pin.SE3 | None], held: str) -> None:
    """Errors of the camera's place."""
    off = [trial.T_tool_camera.actInv(T) for trial, T in zip(trials, Ts, strict=True) if T is not None]
    mm = [1e3 * np.linalg.norm(T.translation) for T in off]
    deg = [np.degrees(np.linalg.norm(pin.log3(T.rotation))) for T in off]
    cells = " | ".join(f"{np.median(own):.3f} | {np.quantile(own, 0.95):.3f}" for own in (mm, deg))
    failed = "" if len(off) == len(trials) else f" ({len(trials) - len(off)} failed)"
    print(f"| {kind} | {poses} | {name}{failed} | {cells} | {held} |", flush=True)


def factory(path: Path) -> list[np.ndarray]:
    """Twists (6, 6) of the joints' frames of every UR arm."""
    arms: dict[str, np.ndarray] = {}
    with path.open() as file:
        for line in csv.DictReader(file):
            twist = [float(line[name]) for name in ("dx_m", "dy_m", "dz_m", "rx_rad", "ry_rad", "rz_rad")]
            arms.setdefault(line["robot"], np.zeros((6, 6)))[FRAMES.index(line["joint_frame"])] = twist
    return list(arms.values())


def trial_of(robot: urdfcal.Robot, twists: np.ndarray, sought: Sought, poses: int, rng: np.random.Generator) -> Trial:
    """Poses from which the board is seen, and its corners with noise."""
    names = [f"{joint}_joint" for joint in JOINTS]
    origins = {name: robot.tree.joints[name].origin * pin.exp6(twist) for name, twist in zip(names, twists, strict=True)}
    true = with_text(robot, with_origins(robot.description, origins)) if twists.any() else robot
    camera, T_tool_camera = a_camera(rng), pin.SE3(pin.exp3(rng.normal(0, 0.15, 3)), rng.normal([0, 0, 0.04], 0.04))
    T_base_board = flange(true, HOME) * T_tool_camera * facing(sought, 0.5 * camera.matrix[0, 0] / 620, 10, rng.uniform(0, 360))
    points, q, pixels = sought.grid.points(), [], []
    while len(q) < poses:
        trial = HOME + rng.uniform(-1, 1, 6) * [0.4, 0.3, 0.4, 0.6, 0.6, 1.2]
        T = (flange(true, trial) * T_tool_camera).actInv(T_base_board)
        seen = camera.project(points @ T.rotation.T + T.translation) + rng.normal(0, NOISE_PX, (len(points), 2))
        inside = ((seen > 5) & (seen < np.array(camera.size) - 5)).all(axis=1)
        if T.translation[2] > 0.25 and (T.rotation[:, 2] @ T.act(points.mean(axis=0))) > 0 and inside.mean() > 0.8:
            q.append(trial)
            pixels.append(np.where(inside[:, None], seen, np.nan))
    along = np.abs(robot.tree.joints[names[-1]].axis)
    turned = pin.exp6(twists[-1] * [*along, *along])  # what turns along with the last joint
    hand = np.array([flange(robot, own).homogeneous for own in q])
    return Trial(camera, on_flange(robot, turned) * T_tool_camera, np.array(q), hand, np.array(pixels))


def flange(robot: urdfcal.Robot, q: np.ndarray) -> pin.SE3:
    """T_base_tool."""
    data = robot.model.createData()
    pin.framesForwardKinematics(robot.model, data, q)
    return (data.oMf[robot.model.getFrameId("base_link")].inverse() * data.oMf[robot.model.getFrameId("tool0")]).copy()


def on_flange(robot: urdfcal.Robot, turned: pin.SE3) -> pin.SE3:
    """A displacement in the last joint's frame as one of tool0."""
    T_joint_tool = robot.model.frames[robot.model.getFrameId("tool0")].placement
    return T_joint_tool.inverse() * turned * T_joint_tool


def fitted(robot: urdfcal.Robot, trial: Trial, sought: Sought, fix: tuple[str, ...]) -> tuple[pin.SE3, np.ndarray]:
    """T_tool_camera, and its error's six numbers over their sigmas."""
    columns: dict[str, np.ndarray] = {f"{joint}_joint": trial.q[:, number] for number, joint in enumerate(JOINTS)}
    for corner in range(sought.grid.corners):
        columns |= {f"base_link:{corner}.{ending}": trial.pixels[:, corner, axis] for axis, ending in enumerate("uv")}
    data = urdfcal.measurements_from(robot, columns, reference="tool0", camera=trial.camera, boards={"base_link": sought.grid})
    calibration = urdfcal.fit(robot, data, fix=fix)
    (entry,) = (own for own in frame_entries(calibration) if own["link"] == "tool0")
    T = pin.SE3(pin.rpy.rpyToMatrix(*entry["rpy"]), np.array(entry["xyz"]))
    return T, pin.log6(T.actInv(trial.T_tool_camera)).vector / sigmas_of(calibration)


def sigmas_of(calibration: urdfcal.Calibration) -> np.ndarray:
    """Of the camera's placement, six numbers, in its own axes."""
    names = list(calibration.errors.names)
    label = next(slot.label for slot in calibration.errors.slots if slot.kind == "reference")
    ends = ("trans_x", "trans_y", "trans_z", "rot_x", "rot_y", "rot_z")
    return np.array([calibration.sigma[names.index(f"{label}.{end}")] for end in ends])


def by_opencv(python: Path, trials: list[Trial], sought: Sought) -> dict[str, list[pin.SE3 | None]]:
    """T_tool_camera of every trial by each of OpenCV's methods; None where it failed."""
    with tempfile.TemporaryDirectory() as folder:
        given, found = Path(folder) / "given.npz", Path(folder) / "found.npz"
        arrays = {f"{name}{i}": own for i, trial in enumerate(trials) for name, own in _given(trial).items()}
        np.savez(given, trials=len(trials), points=sought.grid.points(), **arrays)
        subprocess.run([str(python), "-c", OPENCV, str(given), str(found)], check=True)
        with np.load(found) as answers:
            names = dict.fromkeys(key.rpartition("/")[0] for key in answers.files)
            keys = {name: [f"{name}/{number}" for number in range(len(trials))] for name in names}
            return {name: [pin.SE3(answers[key]) if key in answers.files else None for key in own] for name, own in keys.items()}


def _given(trial: Trial) -> dict[str, np.ndarray]:
    return {"hand": trial.hand, "pixels": trial.pixels, "K": trial.camera.matrix, "d": trial.camera.distortion}


if __name__ == "__main__":
    main()
