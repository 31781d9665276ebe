"""Boards in rendered pictures: corners found, whether their sigmas hold, numbers mistaken; and a wrist camera from pictures to the arm.

    python tests/benchmarks/boards.py [--cameras N] [--pictures N] [--arms N]

Simulated: every camera has a focal length, a middle and a distortion of its own; every picture a tilt of up to 60 deg about an axis in the
picture, a roll, a blur of up to 1.2 px and noise of 1 to 4 levels of 255; in every fourth a bar hides a part. A mistaken number is a corner
that is found nearer to another corner's true place than to its own.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

import cv2
import numpy as np
import pinocchio as pin

sys.path.insert(0, str(Path(__file__).parents[2]))

from tests.support.flat_boards import facing, rendered, true_pixels
from urdfcal.sensors.camera import Camera
from urdfcal.vision.camera.board_search import BoardSeen, find_boards
from urdfcal.vision.camera.sought import Sought, parse_board

SPECS = (
    "9x6:25mm",
    "charuco:7x5:40mm:30mm",
    "apriltag:36h11:6x4:30mm",
    "aruco:4X4_50:6x4:30mm",
    "aruco:4X4_50:1x1:80mm@7",
    "circles:4x11:20mm",
)
SIZE, WITHIN = (640, 480), 1.959964


def main() -> None:
    """Print the tables as Markdown."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cameras", type=int, default=10)
    parser.add_argument("--pictures", type=int, default=8, help="of every board by every camera")
    parser.add_argument("--board", action="append", help="Only this one; repeatable.")
    parser.add_argument("--arms", type=int, default=3)
    arguments = parser.parse_args()
    print(
        "| board | tilt, deg | corners found | of those hidden in part | error / sigma, RMS | within 1.96 sigma | mistaken |\n|"
        + "---|" * 7
    )
    for spec in arguments.board or SPECS:
        study(spec, arguments.cameras, arguments.pictures)
    if arguments.arms:
        wrist(arguments.arms)


def study(spec: str, cameras: int, pictures: int) -> None:
    """A row for each range of tilts."""
    sought, rows = parse_board(spec), {low: [] for low in (0, 20, 40)}
    for number in range(cameras):
        rng = np.random.default_rng(100 + number)
        camera = a_camera(rng)
        for shot in range(pictures):
            low = (0, 20, 40)[shot % 3]
            rows[low].append(looked(camera, sought, low, shot % 4 == 3, rng))
    for low, all_looks in rows.items():
        off = np.concatenate([look[0] for look in all_looks])
        counts = np.array([look[1:] for look in all_looks])
        open_, part = (counts[counts[:, 3] == hidden].sum(axis=0) for hidden in (0, 1))
        share = f"{part[0]} of {part[1]}" if part[1] else ""
        held = f"{np.sqrt(np.mean(off**2)):.2f} | {np.mean(np.abs(off) < WITHIN):.1%}" if len(off) else " | "
        print(f"| {spec} | {low} to {low + 20} | {open_[0]} of {open_[1]} | {share} | {held} | {counts[:, 2].sum()} |", flush=True)


def a_camera(rng: np.random.Generator) -> Camera:
    """Of 640 x 480 px."""
    focal = rng.uniform(500, 900)
    matrix = np.array([[focal, 0, 320 + rng.normal(0, 8)], [0, focal * rng.uniform(0.998, 1.002), 240 + rng.normal(0, 8)], [0, 0, 1]])
    return Camera(SIZE, matrix, np.array([rng.uniform(-0.25, 0.05), rng.uniform(-0.03, 0.05), *rng.normal(0, 5e-4, 2), 0.0]))


def looked(camera: Camera, sought: Sought, low: float, hiding: bool, rng: np.random.Generator) -> tuple[np.ndarray, int, int, int, int]:
    """Errors over sigmas, corners found, corners in the picture and not hidden, mistaken numbers, whether a bar hides a part."""
    points = np.array([sought.grid.at(corner) for corner in range(sought.grid.corners)])
    distance = camera.matrix[0, 0] * max(np.ptp(points, axis=0).max(), 0.08) / rng.uniform(250, 400)
    T = facing(sought, distance, rng.uniform(low, low + 20), rng.uniform(0, 360), rng.uniform(-40, 40))
    picture = rendered(camera, [(sought, T)], rng, noise=rng.uniform(1, 4), blur=rng.uniform(0.3, 1.2), rays=3)
    truth = true_pixels(camera, sought, T)
    there = ((truth > 0) & (truth < SIZE)).all(axis=1)
    if hiding:
        left = int(rng.uniform(120, 420))
        picture[:, left : left + 90] = 90
        there &= (truth[:, 0] < left - 2) | (truth[:, 0] > left + 92)
    (seen,) = find_boards(picture, camera, [sought])
    if not isinstance(seen, BoardSeen):
        return np.empty(0), 0, int(there.sum()), 0, int(hiding)
    nearest = np.linalg.norm(seen.pixels[:, None] - truth[None], axis=2).argmin(axis=1)
    off = (seen.pixels - truth[seen.corners]) / seen.sigmas[:, None]
    return off.ravel(), len(seen.corners), int(there.sum()), int((nearest != seen.corners).sum()), int(hiding)


def wrist(arms: int) -> None:
    """UR5s with errors in every joint and a camera on the wrist: pictures of a board on the base, boards, fit."""
    print("\n| UR5 | poses | tool up to a constant, mm RMS: before | after | verdict | angle, deg RMS: before | after |\n|" + "---|" * 7)
    for seed in range(arms):
        print(f"| {seed} | {arm(seed)} |", flush=True)


def arm(seed: int) -> str:
    """The cells of one arm; its files go through the commands."""
    import json
    import os
    import subprocess

    import urdfcal
    from tests.support.paths import ROBOTS_DIR
    from urdfcal.robot.robot import with_text
    from urdfcal.robot.urdf_writer import with_origins
    from urdfcal.vision.camera.camera_file import camera_yaml

    rng, sought = np.random.default_rng(seed), parse_board("charuco:7x5:40mm:30mm")
    robot, camera = urdfcal.load_robot(ROBOTS_DIR / "ur5" / "ur5.urdf.xacro"), a_camera(rng)
    joints = [joint for joint in robot.tree.joints.values() if joint.type == "revolute" and joint.name.endswith("_joint")]
    noise = rng.normal(0, 1, (len(joints), 6)) * np.repeat([1e-3, np.radians(0.1)], 3)
    origins = {joint.name: joint.origin * pin.exp6(own) for joint, own in zip(joints, noise, strict=True)}
    true = with_text(robot, with_origins(robot.description, origins))
    urdf = robot.description.path
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        poses = pictured(true, camera, sought, folder, rng, [joint.name for joint in joints])
        (folder / "poses.csv").write_text(poses)
        (folder / "camera.yaml").write_bytes(camera_yaml(camera, {}))
        spec = ["--board", "base_link=charuco:7x5:40mm:30mm", "--camera", "camera.yaml", "--camera-link", "tool0"]
        for words in (
            ["boards", *sorted(path.name for path in folder.glob("*.png")), *spec, "--poses", "poses.csv", "-o", "m.csv", "-q"],
            ["fit", str(urdf), "m.csv", "--camera", "camera.yaml", "--rig", "m_rig.yaml", "-o", "out.urdf", "--json"],
        ):
            environment = os.environ | {"PYTHONPATH": str(Path(__file__).parents[2])}
            done = subprocess.run([sys.executable, "-m", "urdfcal", *words], cwd=folder, capture_output=True, text=True, env=environment)
            if done.returncode not in (0, 3):
                raise SystemExit(done.stderr)
        result = json.loads(done.stdout)
        before, after = (urdfcal.compare(true, other, tool="tool0").at_tool for other in (robot, urdfcal.load_robot(folder / "out.urdf")))
    rms = [1e3 * np.sqrt(np.mean(own.apart**2)) for own in (before, after)]
    turned = [np.degrees(np.sqrt(np.mean(own.angle**2))) for own in (before, after)]
    return f"{result['poses']['count']} | {rms[0]:.2f} | {rms[1]:.3f} | {result['verdict']['use']} | {turned[0]:.2f} | {turned[1]:.3f}"


def pictured(true: object, camera: Camera, sought: Sought, folder: Path, rng: np.random.Generator, names: list[str]) -> str:
    """40 pictures of the board in a folder; the poses as CSV."""
    model, data = true.model, true.model.createData()
    tool, home = model.getFrameId("tool0"), np.array([0.3, -1.3, 1.6, -1.8, -1.4, 0.2])

    def placed(q: np.ndarray) -> pin.SE3:
        pin.framesForwardKinematics(model, data, q)
        return data.oMf[tool].copy()

    T_tool_camera = pin.SE3(pin.exp3(np.array([0.1, -0.05, 0.2])), np.array([0.03, 0.05, 0.04]))
    T_base_board = placed(home) * T_tool_camera * facing(sought, 0.5 * camera.matrix[0, 0] / 620, 10, 40)
    rows = [["image", *names]]
    while len(rows) < 41:
        q = home + rng.uniform(-1, 1, 6) * [0.4, 0.3, 0.4, 0.6, 0.6, 1.2]
        T = (placed(q) * T_tool_camera).actInv(T_base_board)
        pixels = true_pixels(camera, sought, T)
        if T.translation[2] > 0.25 and ((pixels > 5) & (pixels < np.array(SIZE) - 5)).all(axis=1).mean() > 0.8:
            cv2.imwrite(str(folder / f"p{len(rows):02d}.png"), rendered(camera, [(sought, T)], rng, blur=0.6, rays=2))
            rows.append([f"p{len(rows):02d}.png", *map(repr, q.tolist())])
    return "\n".join(map(",".join, rows))


if __name__ == "__main__":
    main()
