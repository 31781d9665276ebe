"""One fit over a tree: several targets on several branches, seen by several instruments, against single fits and a second witness.

    python tests/benchmarks/trees.py [--seeds N] [--poses N] [--sets N] [--cells NAME ...] [--jobs N] [--resume FOLDER]

*Unseen poses*: every joint is off by 2 mm and 0.2 deg in six directions; at poses that were not measured, how far the target of every
pair is from where the true robot has it in its instrument's frame, before and after (RMS over poses, the worst pair; medians of the
seeds), and each hand in the root, plainly and up to a constant placement of root and hand. *Witness*: SciPy's least squares with six
numbers a joint by Pinocchio on the whole robot, the same priors: how far apart its pairs are from ours at unseen poses, and how much
better or worse than `auto` it is. *Rank*: of the full-pose Jacobian of `auto` and of six numbers a joint, and parameters of either.
*Time*: one fit, and all pairs fitted one by one. *Coverage*: over sets whose truth is in the model, how often 95 % intervals of
the joints' determined parameters, and of readings at unseen poses, hold. SIMULATED data; TIAGo and TALOS are public descriptions.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parents[2]))

import numpy as np
import pinocchio as pin
from scipy.optimize import least_squares

from tests.support.studies import over, with_jobs
from urdfcal.api import fit
from urdfcal.base.geometry import DEG, MM, Array3, Matrix, Vector
from urdfcal.calibration.problem import Problem
from urdfcal.calibration.result import FitResult
from urdfcal.estimation.identifiability import DETERMINED
from urdfcal.model.error_model import ErrorModel
from urdfcal.model.gauge import build_error_model
from urdfcal.model.options import ModelOptions
from urdfcal.model.structure import full_pose_jacobian
from urdfcal.output.stored import corrected_robot
from urdfcal.robot.configurations import random_positions
from urdfcal.robot.packages import resolve_uri
from urdfcal.robot.rig import Grid
from urdfcal.robot.robot import Robot, load_robot
from urdfcal.robot.sheet import ScreenArea
from urdfcal.sensors.columns import NONE, Stations
from urdfcal.sensors.measurements import Measurements, as_measured
from urdfcal.sensors.spots import beams_of
from urdfcal.simulation.readings import ReadingNoise, simulate_readings
from urdfcal.simulation.setup import Pair, SimulatedSetup, parse_sensors, seen_with, simulated_setup
from urdfcal.vision.render.usual_camera import usual_lens

UR5 = (
    ("pan", "0 0 0.089159", "0 0 0", "0 0 1"),
    ("lift", "0 0.13585 0", "0 1.570796327 0", "0 1 0"),
    ("elbow", "0 -0.1197 0.425", "0 0 0", "0 1 0"),
    ("wrist_1", "0 0 0.39225", "0 1.570796327 0", "0 1 0"),
    ("wrist_2", "0 0.093 0", "0 0 0", "0 0 1"),
    ("wrist_3", "0 0 0.09465", "0 0 0", "0 1 0"),
)
SEVEN = (  # as a PR2 has them
    ("shoulder_pan", "0 0 0", "0 0 0", "0 0 1"),
    ("shoulder_lift", "0.1 0 0", "0 0 0", "0 1 0"),
    ("upper_arm_roll", "0 0 0", "0 0 0", "1 0 0"),
    ("elbow_flex", "0.4 0 0", "0 0 0", "0 1 0"),
    ("forearm_roll", "0 0 0", "0 0 0", "1 0 0"),
    ("wrist_flex", "0.321 0 0", "0 0 0", "0 1 0"),
    ("wrist_roll", "0 0 0", "0 0 0", "1 0 0"),
)
GRID = Grid(6, 5, 0.03)
NOISE = ReadingNoise(spot=0.3 * MM, length=0.1 * MM, angle=0.02 * DEG, pixel=0.2)
SIZE = {"m": 2 * MM, "rad": 0.2 * DEG}
UNSEEN, WITNESSED, Z95 = 60, 40, 1.959963984540054
AIMED = {"mount": np.repeat([20 * MM, 2 * DEG], 3), "screen": np.repeat([100 * MM, 5 * DEG], 3)}  # of a laser, and of a screen
PRIOR = np.repeat([10 * MM, 1 * DEG], 3)  # the default one of a joint


@dataclass(frozen=True)
class Cell:
    """A robot, and what measures it.

    Attributes:
        path: Of a public description; the empty string for a text of our own.
        text: That.
        sensors: As `simulate` takes them.
        boards: Links that are boards.
        stations: Instruments by name.
    """

    path: str = ""
    text: str = ""
    sensors: tuple[str, ...] = ()
    boards: tuple[str, ...] = ()
    stations: Stations = NONE

    def robot(self) -> Robot:
        """The nominal robot."""
        if self.path:
            return load_robot(resolve_uri(f"package://{self.path}"))
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "cell.urdf"
            path.write_text(self.text)
            return load_robot(path)


def joint(
    name: str, parent: str, child: str, xyz: str, rpy: str = "0 0 0", axis: str = "", kind: str = "revolute", turn: float = 2.5
) -> str:
    """A joint and its child link; fixed without an axis."""
    moves = f'<axis xyz="{axis}"/><limit lower="{-turn}" upper="{turn}" effort="1" velocity="1"/>' if axis else ""
    return (
        f'<link name="{child}"/><joint name="{name}" type="{kind if axis else "fixed"}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{xyz}" rpy="{rpy}"/>{moves}</joint>'
    )


def arm(name: str, parent: str, xyz: str, rpy: str, rows: Sequence[tuple[str, str, str, str]], tool: str) -> str:
    """An arm on a link, ending in `<name>_hand`."""
    text, above = joint(f"{name}_mount", parent, f"{name}_base", xyz, rpy), f"{name}_base"
    for own, at, turned, axis in rows:
        text += joint(f"{name}_{own}", above, f"{name}_{own}_link", at, turned, axis)
        above = f"{name}_{own}_link"
    return text + joint(f"{name}_tool", above, f"{name}_hand", tool)


TABLE = (
    '<robot name="two_arms"><link name="table"/>'
    + arm("left", "table", "0 0.4 0", "0 0 0", UR5, "0 0.0823 0")
    + arm("right", "table", "0 -0.4 0", "0 0 3.1", UR5, "0 0.0823 0")
    + "</robot>"
)
SERVICE = (
    '<robot name="service"><link name="base"/>'
    + joint("lift", "base", "torso", "-0.05 0 0.8", "0 0 0", "0 0 1", "prismatic", 0.15)
    + arm("left", "torso", "0 0.19 0", "0 0 0.4", SEVEN, "0.18 0 0.02")
    + arm("right", "torso", "0 -0.19 0", "0 0 -0.4", SEVEN, "0.18 0 0.02")
    + joint("head_pan", "torso", "neck", "-0.02 0 0.38", "0 0 0", "0 0 1", turn=1.0)
    + joint("head_tilt", "neck", "head", "0.07 0 0", "0 0 0", "0 1 0", turn=0.8)
    + joint("eyes", "head", "eye", "0.1 0.03 0.1", "-1.570796327 0 -1.570796327")
    + "</robot>"
)
ONE = '<robot name="one"><link name="table"/>' + arm("ur5", "table", "0 0 0", "0 0 0", UR5, "0 0.0823 0") + "</robot>"
_TIAGO, _TALOS = "tiago_description/robots/tiago_no_hand.urdf", "talos_data/robots/talos_reduced.urdf"
_LEFT, _RIGHT = "wrist_left_ft_tool_link", "wrist_right_ft_tool_link"
LASERS = TABLE.replace(
    "</robot>",
    joint("left_module", "left_hand", "module", "0 0.05 0.03")
    + joint("first", "module", "laser_1", "0.03 0 0", "-1.570796327 0 0")
    + joint("second", "module", "laser_2", "-0.03 0 0", "-1.27 0.1 0")
    + joint("third", "right_hand", "laser_3", "0.02 0.05 0", "-1.57 0.2 0")
    + joint("holds", "right_hand", "card", "0 0.1 0", "0 0 1.570796327")
    + joint("stands", "table", "wall", "2 0 0.8")
    + "</robot>",
)
CELLS = {
    "TIAGo": Cell(
        _TIAGO,
        sensors=("pixels:arm_tool_link@eye", "point:arm_tool_link:ball@leica"),
        boards=("arm_tool_link",),
        stations=Stations({"eye": "xtion_rgb_optical_frame", "leica": ""}),
    ),
    "TALOS": Cell(
        _TALOS,
        sensors=(f"pixels:{_LEFT}@eye", f"pixels:{_RIGHT}@eye", f"pose:{_LEFT}:mark@leica", f"pose:{_RIGHT}:mark@leica"),
        boards=(_LEFT, _RIGHT),
        stations=Stations({"eye": "rgbd_rgb_optical_frame", "leica": ""}),
    ),
    "two-arm cell": Cell(
        text=TABLE,
        sensors=("pixels:right_hand@eye", "point:left_hand:ball@leica", "point:right_hand:ball@leica"),
        boards=("right_hand",),
        stations=Stations({"eye": "left_hand", "leica": "table"}),
    ),
    "service robot": Cell(
        text=SERVICE,
        sensors=(
            "pixels:left_hand@eye",
            "pixels:right_hand@eye",
            "pose:right_hand:mark@left_hand",
            "point:head@leica",
            "point:left_hand:ball@leica",
        ),
        boards=("left_hand", "right_hand"),
        stations=Stations({"eye": "eye", "leica": "base"}),
    ),
    "two-arm laser cell": Cell(
        text=LASERS,
        sensors=tuple(f"laser:{pair}" for pair in ("laser_1@card", "laser_2@card", "laser_1@wall", "laser_2@wall", "laser_3@wall")),
    ),
    "stereo pair": Cell(
        text=ONE,
        sensors=("pixels:ur5_hand@one", "pixels:ur5_hand@two"),
        boards=("ur5_hand",),
        stations=Stations({"one": "table", "two": "table"}),
    ),
}


@dataclass(frozen=True)
class Whole:
    """A robot by Pinocchio on its whole description, with everything that was put on its links.

    Attributes:
        model: The robot.
        on: Where instruments and targets are on their links, by the names of their parameters.
        links: Link of each.
    """

    model: Any
    on: dict[str, pin.SE3]
    links: dict[str, str]

    def seen(self, q: Vector, names: Sequence[tuple[str, str]]) -> list[pin.SE3]:
        """T_instrument_target of some (target, instrument), by those names; the root for the empty string."""
        data = self.model.createData()
        pin.framesForwardKinematics(self.model, data, q)

        def at(name: str) -> pin.SE3:
            if not name:
                return pin.SE3.Identity()
            return data.oMf[self.model.getFrameId(self.links[name], pin.FrameType.BODY)] * self.on.get(name, pin.SE3.Identity())

        return [at(instrument).actInv(at(target)) for target, instrument in names]


@dataclass(frozen=True)
class Names:
    """What the placements of a set-up are called."""

    setup: SimulatedSetup
    links: dict[str, str] = field(default_factory=dict)

    @staticmethod
    def of(setup: SimulatedSetup) -> Names:
        """Links by the names of parameters that place something on them."""
        frames = setup.errors.chain.frames
        every = {own.name: own.link for own in setup.robot.rig.instruments.every}
        links = {
            slot.label: every[frames[slot.frame].name] if slot.kind == "reference" else _link(setup, frames[slot.frame].name)
            for slot in setup.errors.slots
            if slot.frame is not None
        }
        return Names(setup, links)

    def pairs(self) -> list[tuple[str, str]]:
        """Names of target and instrument of every pair, a board being one target."""
        frames = setup_frames(self.setup)
        found = {}
        for sensor in self.setup.sensors:
            target = sensor.link if sensor.by_camera and sensor.link in self.setup.boards else sensor.target
            found[target, frames[sensor.instrument]] = None
        return list(found)


def setup_frames(setup: SimulatedSetup) -> dict[str, str]:
    """What the placement of every instrument is called."""
    chain = setup.errors.chain
    return {chain.frames[slot.frame].name: slot.label for slot in setup.errors.slots if slot.kind == "reference"}


def _link(setup: SimulatedSetup, target: str) -> str:
    return next(sensor.link for sensor in setup.sensors if sensor.target == target)


def set_up(cell: Cell, robot: Robot, rng: np.random.Generator, error_model: str) -> SimulatedSetup:
    """The cell with errors in every joint of an error model, instruments and targets somewhere."""
    boards, camera = dict.fromkeys(cell.boards, GRID), usual_lens()
    sensors, lasers = parse_sensors(cell.sensors, robot, 0, boards, cell.stations)
    seen = seen_with(robot, sensors, "", lasers, boards, cell.stations)
    errors = build_error_model(seen.chain, seen.rig, ModelOptions(error_model=error_model))
    x = np.array([rng.normal(0, SIZE[parameter.unit]) for parameter in errors.parameters])
    return simulated_setup(seen, errors, x, sensors, rng, camera=camera, boards=boards, stations=cell.stations)


def placed(errors: ErrorModel, x: Vector) -> dict[str, pin.SE3]:
    """Where instruments and targets are by a state."""
    found = {}
    for slot, values in zip(errors.slots, errors.slot_values(x), strict=True):
        if slot.frame is not None:
            at = slot.found.get("", pin.SE3.Identity())
            for screw, value in zip(slot.screws.T, values, strict=True):
                at = at * pin.exp6(screw * value)
            found[slot.label] = at
    return found


def whole(robot: Robot, errors: ErrorModel, x: Vector, links: dict[str, str]) -> Whole:
    """The whole robot with a state's origins, and all that is put on it."""
    return Whole(corrected_robot(robot, errors.corrected_origins(x)).model, placed(errors, x), links)


def configurations(robot: Robot, names: Sequence[str], q: Matrix) -> list[Vector]:
    """Positions of named joints as configurations of the whole robot, its other joints at rest."""
    model, found = robot.model, []
    for row in q:
        own = pin.neutral(model)
        for name, value in zip(names, row, strict=True):
            joint_model = model.joints[model.getJointId(name)]
            own[joint_model.idx_q : joint_model.idx_q + joint_model.nq] = value if joint_model.nq == 1 else (np.cos(value), np.sin(value))
        found.append(own)
    return found


def apart(one: Whole, other: Whole, q: Sequence[Vector], pairs: Sequence[tuple[str, str]]) -> Array3:
    """Differences in position at some configurations, (configurations, pairs, 3), [mm]: of targets, or of lasers' spots where they are."""
    both = [(one.seen(row, pairs), other.seen(row, pairs)) for row in q]
    return np.array([[_moved(a, b, *own) for a, b, own in zip(*pair, pairs, strict=True)] for pair in both]) / MM


def _moved(one: pin.SE3, other: pin.SE3, target: str, instrument: str) -> Vector:
    if not instrument or not target.startswith("laser"):
        return np.asarray(one.translation - other.translation)
    p, along = (np.array([[part(own)] for own in (one, other)]) for part in (lambda T: T.translation, lambda T: T.rotation[:, 2]))
    beams = beams_of(p, along)
    near = beams.makes_spot(farthest=4.0).all() and ScreenArea().holds(beams.spots[:1]).all()
    return np.append(beams.spots[0, 0] - beams.spots[1, 0], 0.0) if near else np.full(3, np.nan)


def rms(off: Array3) -> Vector:
    """Of every pair, (pairs,), [mm]."""
    return np.asarray(np.sqrt(np.nanmean((off**2).sum(axis=2), axis=0)))


def up_to_a_constant(true: Whole, off: Matrix, q: Sequence[Vector], hand: str) -> float:
    """RMS of differences (configurations, 3) of a hand in the root less what a constant placement of either explains, [mm]."""
    rows = []
    for row in q:
        (T,) = true.seen(row, [(hand, "")])
        rows.append(np.hstack([np.eye(3), -pin.skew(T.translation), T.rotation]))
    A, b = np.concatenate(rows), off.ravel()
    left = b - A @ np.linalg.lstsq(A, b, rcond=None)[0]
    return float(np.sqrt((left.reshape(-1, 3) ** 2).sum(axis=1).mean()))


def accuracy(cell: Cell, poses: int, seed: int) -> dict[str, float]:
    """What one truth gives at unseen poses, and how long its fits took."""
    robot, rng = cell.robot(), np.random.default_rng([11, seed])
    setup = set_up(cell, robot, rng, "placement")
    data = simulate_readings(setup, poses, rng, NOISE)
    started = time.perf_counter()
    found = fit(setup.robot, data)
    took = time.perf_counter() - started
    names = Names.of(setup)
    q = configurations(robot, data.joints, random_positions(setup.robot, UNSEEN, rng))
    true = whole(robot, setup.errors, setup.x, names.links)
    alone = found.nominal.alone
    before = Whole(robot.model, placed(alone, found.nominal.instruments), names.links)
    after = whole(robot, found.errors, found.x, names.links)
    pairs = names.pairs()
    hands = list(dict.fromkeys(target for target, _ in pairs if not any(target.startswith(f"{other}:") for other, _ in pairs)))
    root = [(hand, "") for hand in hands]
    bare = [replace(own, on={}) for own in (true, before, after)]
    offs = [apart(bare[0], own, q, root) for own in bare[1:]]
    constant = [max(up_to_a_constant(bare[0], off[:, number], q, hand) for number, hand in enumerate(hands)) for off in offs]
    return {
        "pairs before": float(rms(apart(true, before, q, pairs)).max()),
        "pairs after": float(rms(apart(true, after, q, pairs)).max()),
        "root to hand before": float(rms(offs[0]).max()),
        "root to hand after": float(rms(offs[1]).max()),
        "up to a constant before": constant[0],
        "up to a constant after": constant[1],
        "fit": took,
        "single fits": singly(robot, data),
        "verdict": float(found.verdict.use != "no"),
        "warnings": float(len(found.warnings)),
    }


def singly(robot: Robot, data: Measurements) -> float:
    """Seconds of fitting every pair by itself."""
    seconds = 0.0
    boards = {own.link for own in data.readings if own.kind.by_camera}  # each laser's beam on each screen is one, too
    pairs = dict.fromkeys((own.link if own.link in boards and own.kind.by_camera else own.target, own.instrument) for own in data.readings)
    for pair in pairs:
        own = tuple(
            each
            for each in data.readings
            if (each.link if each.link in boards and each.kind.by_camera else each.target, each.instrument) == pair
        )
        seen = np.any([each.seen for each in own], axis=0)
        part = replace(data, readings=own)
        arm_alone = as_measured(robot, part)
        columns = [data.joints.index(name) for name in arm_alone.chain.input_names]
        part = replace(part, joints=arm_alone.chain.input_names, q=data.q[:, columns]).subset(seen)
        started = time.perf_counter()
        fit(arm_alone, part, sane=False)
        seconds += time.perf_counter() - started
    return seconds


def witness(cell: Cell, seed: int) -> dict[str, float]:
    """SciPy's batch answer by whole-robot Pinocchio beside ours, of a few poses."""
    robot, rng = cell.robot(), np.random.default_rng([12, seed])
    setup = set_up(cell, robot, rng, "placement")
    data = simulate_readings(setup, WITNESSED, rng, NOISE)
    sigmas = {
        kind: {"point": NOISE.length, "orientation": NOISE.angle, "pixel": NOISE.pixel, "spot": NOISE.spot}[kind] for kind in data.kinds
    }
    same: dict[str, Any] = {"sigmas": sigmas, "evidence": False, "sane": False, "asking": False, "gated": False}
    ours, usual = (fit(setup.robot, data, error_model=model, **same) for model in ("placement", "auto"))
    names = Names.of(setup)
    batch = Batch(robot, setup, data, names, ours).solved()
    q = configurations(robot, data.joints, random_positions(setup.robot, UNSEEN, rng))
    pairs, true = names.pairs(), whole(robot, setup.errors, setup.x, names.links)
    tried = {
        "ours": whole(robot, ours.errors, ours.x, names.links),
        "auto": whole(robot, usual.errors, usual.x, names.links),
        "batch": batch,
    }
    off = {name: float(rms(apart(true, own, q, pairs)).max()) for name, own in tried.items()}
    ranks = [full_pose_jacobian(own.errors.chain, own.errors, pairs=setup.robot.rig.instruments.pairs) for own in (usual, ours)]
    moving = [
        J[:, [p.kind in ("joint", "reference", "target") for p in own.errors.parameters]]
        for J, own in zip(ranks, (usual, ours), strict=True)
    ]
    rank = [int(np.linalg.matrix_rank(J / np.maximum(np.linalg.norm(J, axis=0), 1e-12), 1e-7)) for J in moving]
    return {
        "apart from the witness": float(rms(apart(batch, tried["ours"], q, pairs)).max()),
        "error of the witness": off["batch"],
        "error of auto": off["auto"],
        "rank of auto": rank[0],
        "rank of six a joint": rank[1],
        "parameters of auto": moving[0].shape[1],
        "parameters of six a joint": moving[1].shape[1],
    }


@dataclass(frozen=True)
class Batch:
    """Everything that was measured as one least-squares problem, six numbers a joint, instrument and target."""

    robot: Robot
    setup: SimulatedSetup
    data: Measurements
    names: Names
    start: FitResult

    def solved(self) -> Whole:
        """The answer from where ours begins its instruments."""
        labels = list(self.names.links)
        joints = [step.joint.name for step in self.setup.errors.chain.moving]
        near = {slot.label: AIMED[slot.like] for slot in self.start.errors.slots if slot.like is not None}
        size = np.concatenate([np.tile(PRIOR, len(joints)), *(near.get(label, np.ones(6)) for label in labels)])
        told = np.concatenate([np.ones(6 * len(joints)), *(np.full(6, float(label in near)) for label in labels)])
        at = placed(self.start.errors, self.start.x) | dict.fromkeys(near, pin.SE3.Identity())
        q = configurations(self.robot, self.data.joints, self.data.q)
        frames = setup_frames(self.setup)

        def built(step: Vector) -> Whole:
            x, model = step * size, self.robot.model.copy()
            for number, name in enumerate(joints):
                index = model.getJointId(name)
                model.jointPlacements[index] = model.jointPlacements[index] * pin.exp6(x[6 * number : 6 * number + 6])
            beside = x[6 * len(joints) :].reshape(-1, 6)
            return Whole(model, {label: at[label] * pin.exp6(own) for label, own in zip(labels, beside, strict=True)}, self.names.links)

        def residual(step: Vector) -> Vector:
            robot = built(step)
            pairs = list(dict.fromkeys(self._pair(own, frames) for own in self.data.readings))
            poses = [robot.seen(row, pairs) for row in q]
            parts = [step * told]
            for own in self.data.readings:
                number = pairs.index(self._pair(own, frames))
                seen = [poses[row][number] for row in np.flatnonzero(own.seen)]
                parts.append(self._read(own, seen).ravel())
            return np.concatenate(parts)

        return built(least_squares(residual, np.zeros(len(size)), x_scale=1.0, max_nfev=20).x)

    def _pair(self, own: Any, frames: dict[str, str]) -> Pair:
        board = own.kind.by_camera and own.link in self.data.boards
        return (own.link if board else own.target), frames[own.instrument]

    def _read(self, own: Any, seen: Sequence[pin.SE3]) -> Matrix:
        """Whitened residuals of one sensor's readings of one target."""
        values = own.values[own.seen]
        if own.kind.by_camera:
            at = np.array(self.data.boards[own.link].at(int(own.target.partition(":")[2])))
            return np.asarray((values - self.data.camera.project(np.array([pose.act(at) for pose in seen]))) / NOISE.pixel)
        if own.sensor == "point":
            return np.asarray((values - np.array([pose.translation for pose in seen])) / NOISE.length)
        if own.kind.aimed:
            along = np.array([pose.rotation[:, 2] for pose in seen])
            p = np.array([pose.translation for pose in seen])
            return np.asarray((values - (p - along * (p[:, :1] / along[:, :1]))[:, 1:]) / NOISE.spot)
        turned = [pin.Quaternion(row).toRotationMatrix() for row in values]
        return np.array([pin.log3(pose.rotation.T @ R) for pose, R in zip(seen, turned, strict=True)]) / NOISE.angle


def coverage(cell: Cell, poses: int, seed: int) -> tuple[int, int, int, int]:
    """How many 95 % intervals of joints' parameters, and of readings at unseen poses, hold; and how many there are."""
    robot, rng = cell.robot(), np.random.default_rng([13, seed])
    setup = set_up(cell, robot, rng, "auto")
    data = simulate_readings(setup, poses, rng, NOISE)
    test = simulate_readings(setup, UNSEEN, rng, NOISE)
    found = fit(setup.robot, data)
    truth = dict(zip(setup.errors.names, setup.x.tolist(), strict=True))
    joints = [number for number, own in enumerate(found.errors.parameters) if own.kind == "joint"]
    joints = [number for number in joints if found.sigma[number] < DETERMINED * found.errors.sigma[number]]
    off = np.array([found.x[number] - truth[found.errors.names[number]] for number in joints])
    held = np.abs(off) < Z95 * found.sigma[joints]
    problem = Problem(found.errors, test)
    swept = problem.linearise(found.x)
    J = problem.jacobian(found.x)
    sizes = np.array(found.estimate.noise.sigma)
    own = np.concatenate(
        [
            np.full(block.columns.stop - block.columns.start, sizes[found.data.kinds.index(test.kinds[block.kind])])
            for block in problem.blocks
        ]
    )
    spread = np.sqrt(np.einsum("nmp,pq,nmq->nm", J, found.estimate.belief.P, J) + own**2)
    read = np.abs(swept.residual[problem.measured] / spread[problem.measured]) < Z95
    return int(held.sum()), len(held), int(read.sum()), read.size


def main() -> None:
    """Print the figures of every cell."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--poses", type=int, default=60)
    parser.add_argument("--sets", type=int, default=40)
    parser.add_argument("--cells", nargs="*", default=list(CELLS))
    with_jobs(parser)
    arguments = parser.parse_args()
    for name in arguments.cells:
        cell = CELLS[name]
        runs = over(partial(accuracy, cell, arguments.poses), range(arguments.seeds), arguments)
        print(
            f"{name}: " + ", ".join(f"{key} {np.median([run[key] for run in runs]):.3f}" for key in runs[0]) if runs else name, flush=True
        )
        beside = over(partial(witness, cell), range(min(arguments.seeds, 2)), arguments)
        print("   " + ", ".join(f"{key} {max(run[key] for run in beside):.4g}" for key in beside[0]) if beside else "", flush=True)
        if arguments.sets:
            held, of, read, numbers = np.sum(over(partial(coverage, cell, arguments.poses), range(arguments.sets), arguments), axis=0)
            print(f"   95 % intervals: {held / of:.1%} of {of} parameters, {read / numbers:.1%} of {numbers} unseen readings", flush=True)


if __name__ == "__main__":
    main()
