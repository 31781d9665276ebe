"""One fit over a tree of joints: several targets on several branches, seen by several instruments."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from scipy.optimize import least_squares

from tests.conftest import CliResult
from urdfcal.api import fit, load_robot, measurements_from
from urdfcal.base.errors import MeasurementError
from urdfcal.base.geometry import DEG, MM, Matrix, Vector
from urdfcal.calibration.problem import Problem
from urdfcal.calibration.result import FitResult
from urdfcal.robot.rig import Grid
from urdfcal.robot.robot import Robot
from urdfcal.sensors.camera import Camera
from urdfcal.sensors.columns import Stations
from urdfcal.sensors.measurements import Measurements
from urdfcal.vision.camera.camera_file import camera_yaml

JOINTS = ("lift", "turn", "left_1", "left_2", "left_3", "right_1", "right_2", "right_3", "head_1", "head_2")
TYPES = {"lift": "prismatic"}
TREE = {  # joint: parent, child, xyz, rpy, axis
    "lift": ("base", "column", "0.1 0 0.4", "0 0 0.1", "0 0 1"),
    "turn": ("column", "torso", "0 0.02 0.3", "0.1 0 0", "0 0 1"),
    "left_1": ("torso", "l1", "0 0.2 0.3", "-1.5 0 0.1", "0 0 1"),
    "left_2": ("l1", "l2", "0.05 0 0.3", "1.5 0.1 0", "0 0 1"),
    "left_3": ("l2", "left_hand", "0.3 0.03 0", "0 1.4 0", "0 0 1"),
    "right_1": ("torso", "r1", "0 -0.2 0.3", "1.5 0 -0.1", "0 0 1"),
    "right_2": ("r1", "r2", "0.05 0 0.3", "-1.5 0.1 0", "0 0 1"),
    "right_3": ("r2", "right_hand", "0.3 -0.03 0", "0 1.4 0", "0 0 1"),
    "head_1": ("torso", "neck", "0 0 0.5", "0 0 0", "0 0 1"),
    "head_2": ("neck", "head", "0.05 0 0.1", "1.5 0 0", "0 0 1"),
}
PAIRS = (("left_hand", "leica"), ("right_hand", "leica"), ("right_hand", "head"), ("left_hand", "head"))
STATIONS = Stations({"leica": "base", "head": "head"})
LENGTH, ANGLE = 0.1 * MM, 0.02 * DEG


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    """A column, a torso, two arms and a head."""
    links = {link for parent, child, *_ in TREE.values() for link in (parent, child)}
    text = "".join(f'<link name="{link}"/>' for link in sorted(links))
    for name, (parent, child, xyz, rpy, axis) in TREE.items():
        text += (
            f'<joint name="{name}" type="{TYPES.get(name, "revolute")}"><parent link="{parent}"/><child link="{child}"/>'
            f'<origin xyz="{xyz}" rpy="{rpy}"/><axis xyz="{axis}"/><limit lower="-1.5" upper="1.5" effort="1" velocity="1"/></joint>'
        )
    text += '<link name="plate"/><joint name="screws" type="fixed"><parent link="left_hand"/><child link="plate"/></joint>'
    path = tmp_path_factory.mktemp("tree") / "tree.urdf"
    path.write_text(f'<robot name="tree">{text}</robot>')
    return load_robot(path)


@dataclass(frozen=True)
class Cell:
    """A true robot, by whole-robot Pinocchio, with instruments and targets on it."""

    model: pin.Model
    on: dict[str, pin.SE3]

    def where(self, q: Vector, link: str) -> pin.SE3:
        data = self.model.createData()
        pin.framesForwardKinematics(self.model, data, q)
        return data.oMf[self.model.getFrameId(link, pin.FrameType.BODY)]

    def seen(self, q: Vector, target: str, instrument: str) -> pin.SE3:
        """T_instrument_target."""
        there = self.where(q, STATIONS.links[instrument]) * self.on[instrument]
        return there.actInv(self.where(q, target) * self.on[target])


def cell_with(robot: Robot, errors: Vector, placed: Vector) -> Cell:
    """Every joint's placement off by six numbers, and where the two targets and the two instruments are, six numbers each."""
    model = robot.model.copy()
    for index, error in enumerate(errors.reshape(-1, 6), start=1):
        model.jointPlacements[index] = model.jointPlacements[index] * pin.exp6(error)
    names = ("left_hand", "right_hand", "leica", "head")
    return Cell(model, dict(zip(names, map(pin.exp6, placed.reshape(-1, 6)), strict=True)))


def positions(robot: Robot, n: int, rng: np.random.Generator) -> Matrix:
    return rng.uniform(-1.2, 1.2, (n, robot.model.nv))


def measured(robot: Robot, cell: Cell, q: Matrix, rng: np.random.Generator, pairs: Sequence[tuple[str, str]] = PAIRS) -> Measurements:
    """Poses of each pair, with noise."""
    table: dict[str, object] = {name: q[:, robot.model.joints[robot.model.getJointId(name)].idx_q] for name in JOINTS}
    for target, instrument in pairs:
        poses = [cell.seen(row, target, instrument) for row in q]
        noisy = [
            pin.SE3(pose.rotation @ pin.exp3(rng.normal(0, ANGLE, 3)), pose.translation + rng.normal(0, LENGTH, 3)).homogeneous
            for pose in poses
        ]
        table[f"{target}@{instrument}.pose"] = np.array(noisy)
    return measurements_from(robot, table, stations=STATIONS)


@dataclass(frozen=True)
class Fitted:
    cell: Cell
    data: Measurements
    result: FitResult


@pytest.fixture(scope="module")
def fitted(robot: Robot) -> Fitted:
    """The tree with errors of 2 mm and 0.2 deg, 60 poses, all four pairs at once."""
    rng = np.random.default_rng(5)
    errors = rng.normal(0, 1, (len(TREE), 6)) * np.repeat([2 * MM, 0.2 * DEG], 3)
    placed = rng.normal(0, 1, (4, 6)) * np.array([0.1] * 3 + [1.0] * 3)
    cell = cell_with(robot, errors.ravel(), placed.ravel())
    data = measured(robot, cell, positions(robot, 60, rng), rng)
    return Fitted(cell, data, fit(robot, data, priors={}))


def off(one: Callable[[Vector, str, str], pin.SE3], other: Callable[[Vector, str, str], pin.SE3], q: Matrix) -> dict[str, float]:
    """RMS distance of every pair's target between two robots, [mm]."""
    return {
        f"{target}@{instrument}": float(
            np.sqrt(
                np.mean([np.sum((one(row, target, instrument).translation - other(row, target, instrument).translation) ** 2) for row in q])
            )
            / MM
        )
        for target, instrument in PAIRS
    }


def calibrated(robot: Robot, result: FitResult) -> Cell:
    """The whole robot as the fit has it, by Pinocchio alone, with the frames that it found."""
    frames = {}
    for slot in (slot for slot in result.errors.slots if slot.frame is not None):
        values = result.errors.slot_values(result.x)[result.errors.slots.index(slot)]
        own = slot.found.get("", pin.SE3.Identity())
        for screw, value in zip(slot.screws.T, values, strict=True):
            own = own * pin.exp6(screw * value)
        frames[slot.label.removesuffix(":frame")] = own
    return Cell(result.apply_to(robot.model), frames)


def test_every_joint_is_in_the_tree_once(fitted: Fitted) -> None:
    """Each moving joint on any way is one joint of the chain, whatever it is shared by."""
    assert sorted(step.joint.name for step in fitted.result.errors.chain.moving) == sorted(JOINTS)


def test_the_jacobian_is_that_of_differences(fitted: Fitted, rng: np.random.Generator) -> None:
    """Readings of every pair go with every parameter as central differences say, far from zero too."""
    problem = Problem(fitted.result.errors, fitted.data.subset(np.arange(5)))
    x, h = rng.normal(0, 0.02, len(fitted.result.x)), 1e-6
    jacobian = problem.linearise(x).jacobian
    for column in range(len(x)):
        step = h * (np.arange(len(x)) == column)
        numeric = (problem.linearise(x - step).residual - problem.linearise(x + step).residual) / (2 * h)
        np.testing.assert_allclose(jacobian[:, :, column], numeric, atol=2e-8)


def test_unseen_poses_of_every_pair(robot: Robot, fitted: Fitted, rng: np.random.Generator) -> None:
    """At poses that were not measured, every pair's target is where the true robot has it, by whole-robot Pinocchio."""
    q = positions(robot, 40, rng)
    after = off(fitted.cell.seen, calibrated(robot, fitted.result).seen, q)
    assert max(after.values()) < 0.25


def test_it_is_the_batch_answer(robot: Robot, fitted: Fitted, rng: np.random.Generator) -> None:
    """SciPy's least squares over whole-robot Pinocchio, with six numbers a joint and the same priors, predicts the same unseen poses."""
    few = fitted.data.subset(np.arange(12))
    found = fit(
        robot, few, error_model="placement", sigmas={"point": LENGTH, "orientation": ANGLE}, evidence=False, sane=False, asking=False
    )
    q = few.q[:, [few.joints.index(name) for name in robot.model.names[1:]]]
    read = {own.label: own for own in few.readings if own.sensor == "point"}
    turned = {own.label: own for own in few.readings if own.sensor == "orientation"}
    size = np.concatenate([np.tile(np.repeat([10 * MM, 1 * DEG], 3), len(TREE)), np.ones(24)])
    ours = calibrated(robot, found)
    placed = np.concatenate([pin.log6(ours.on[name]).vector for name in ("left_hand", "right_hand", "leica", "head")])
    begin = np.concatenate([np.zeros(6 * len(TREE)), placed])

    def residual(step: Vector) -> Vector:
        x = begin + step * size
        cell, parts = cell_with(robot, x[: 6 * len(TREE)], x[6 * len(TREE) :]), [step[: 6 * len(TREE)]]
        for row, (target, instrument) in ((row, pair) for row in range(len(q)) for pair in PAIRS):
            pose, label = cell.seen(q[row], target, instrument), f"{target}@{instrument}"
            R = pin.Quaternion(turned[label].values[row]).toRotationMatrix()
            parts += [(read[label].values[row] - pose.translation) / LENGTH, pin.log3(pose.rotation.T @ R) / ANGLE]
        return np.concatenate(parts)

    batch = begin + least_squares(residual, np.zeros(len(begin)), x_scale=1.0, max_nfev=3).x * size
    witness = cell_with(robot, batch[: 6 * len(TREE)], batch[6 * len(TREE) :])
    apart = off(witness.seen, ours.seen, positions(robot, 20, rng))
    assert max(apart.values()) < 2e-3


def test_an_unknown_instrument_is_refused(robot: Robot) -> None:
    """A column whose instrument is neither named nor a link says so, with what comes near."""
    table = {**{name: [0.1] for name in JOINTS}, **{f"left_hand@lieca.{axis}": [0.1] for axis in "xyz"}}
    with pytest.raises(MeasurementError, match=r"no instrument named 'lieca'.*did you mean 'leica'"):
        measurements_from(robot, table, stations=STATIONS)


def test_two_cameras_and_a_tracker_in_one_file(robot: Robot, run_cli: Callable[..., CliResult], tmp_path: Path) -> None:
    """A fixed and a carried camera, each with its lens, see a board in a hand that a tracker sees too: pixels come down to their noise."""
    rng, grid = np.random.default_rng(3), Grid(4, 3, 0.04)
    size = np.repeat([1 * MM, 0.1 * DEG], 3)
    cell = cell_with(robot, (rng.normal(0, 1, (len(TREE), 6)) * size).ravel(), rng.normal(0, 0.05, 24))
    middle = np.array([0.1, 0.1, 0.3, 0.5, -0.3, 0.2, 0.2, 0.1, 0.4, 0.2])
    board = cell.where(middle, "left_hand") * cell.on["left_hand"]
    lenses = {"near": camera_of(900.0), "eye": camera_of(1300.0)}
    views = {"near": ("base", np.array([0.3, 0.2, 0.1]), 0.7), "eye": ("head", np.array([-0.2, 0.3, 0.4]), 1.0)}
    on = {}
    for name, (link, turn, far) in views.items():
        T_camera_board = pin.SE3(pin.exp3(turn), np.array([-0.06, -0.04, far]))
        on[name] = cell.where(middle, link).actInv(board * T_camera_board.inverse())
    q = middle + rng.uniform(-0.25, 0.25, (50, len(middle)))
    table: dict[str, object] = {name: q[:, robot.model.joints[robot.model.getJointId(name)].idx_q] for name in JOINTS[:5] + JOINTS[8:]}
    for name, (link, *_) in views.items():
        seen = [(cell.where(row, link) * on[name]).actInv(cell.where(row, "left_hand") * cell.on["left_hand"]) for row in q]
        for corner in range(grid.corners):
            at = np.array(grid.at(corner))
            pixels = lenses[name].project(np.array([pose.act(at) for pose in seen])) + rng.normal(0, 0.1, (len(q), 2))
            table |= {f"plate:{corner}@{name}.u": pixels[:, 0], f"plate:{corner}@{name}.v": pixels[:, 1]}
    points = np.array([cell.seen(row, "left_hand", "leica").translation for row in q]) + rng.normal(0, LENGTH, (len(q), 3))
    table |= {f"left_hand@leica.{axis}": column for axis, column in zip("xyz", points.T, strict=True)}
    names = list(table)
    lines = [",".join(names), *(",".join(f"{table[name][row]:.9g}" for name in names) for row in range(len(q)))]  # type: ignore[index]
    (tmp_path / "m.csv").write_text("\n".join(lines) + "\n")
    for name, lens in lenses.items():
        (tmp_path / f"{name}.yaml").write_bytes(camera_yaml(lens))
    instruments = "{near: {link: base, camera: near.yaml}, eye: {link: head, camera: eye.yaml}, leica: {}}"
    (tmp_path / "rig.yaml").write_text(f"boards: {{plate: '4x3:40mm'}}\ninstruments: {instruments}\n")
    done = run_cli("fit", str(robot.description.path), "m.csv", "--rig", "rig.yaml", "-o", "out.urdf", "--json")
    assert done.code == 0, done.err
    after = {name: row["mean_px"] for name, row in json.loads(done.out)["after"].items() if "mean_px" in row}
    assert set(after) == {"plate@near pixels", "plate@eye pixels"}
    assert max(after.values()) < 0.16
    assert run_cli("view", str(robot.description.path), "m.csv", "--rig", "rig.yaml", "--html", "view.html").code == 0


def camera_of(focal: float) -> Camera:
    """A camera with a lens of its own."""
    return Camera((1280, 960), np.array([[focal, 0, 640.0], [0, focal, 480.0], [0, 0, 1]]), np.array([-0.1, 0.02, 0, 0, 0]))
