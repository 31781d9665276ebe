"""Random trees: whatever its joints, a robot's state is complete, and its correction moves no link for nothing."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from urdfcal.base.geometry import DEG, MM, SE3, Vector
from urdfcal.model.error_model import ErrorModel
from urdfcal.model.gauge import build_error_model
from urdfcal.model.options import ModelOptions
from urdfcal.model.parameters import DEFAULT_PRIORS, FLAT, PriorScale
from urdfcal.model.structure import full_pose_jacobian
from urdfcal.robot.description import Description
from urdfcal.robot.rig import SIX, Instruments, Target
from urdfcal.robot.robot import Robot, robot_from

NOISE = 0.1 * MM
NEIGHBOURS = ("random", "parallel", "antiparallel", "intersecting", "coincident", "crossed")
JOINT = (
    '<link name="{child}"/><joint name="{name}" type="{type}"><parent link="{parent}"/><child link="{child}"/><origin xyz="{xyz}" '
    'rpy="{rpy}"/><axis xyz="{axis}"/>{mimic}<limit lower="-2" upper="2" effort="1" velocity="1"/></joint>'
)


def words(numbers: Vector) -> str:
    """Numbers as a URDF has them."""
    return " ".join(repr(float(number)) for number in numbers)


def branch(rng: np.random.Generator, name: str, joints: int) -> str:
    """Joints of any kind, each somehow placed to the one before it at a lever of 1 mm to 1 m, and a link at the end of a fixed one."""
    text, above, axis = "", "base", np.array([0.0, 0.0, 1.0])
    for number in range(joints):
        kind, lever = rng.choice(NEIGHBOURS), 10 ** rng.uniform(-3, 0)
        along = axis if kind in ("intersecting", "coincident") else rng.normal(size=3)
        rpy = rng.uniform(-3, 3, 3) if kind == "random" else np.zeros(3)
        sign = {"parallel": 1, "coincident": 1, "antiparallel": -1}.get(kind)
        axis = np.roll(axis, 1) if kind == "crossed" else rng.normal(size=3) if sign is None else sign * axis
        axis = axis / np.linalg.norm(axis)
        leads = number > 0 and rng.random() < 0.1
        text += JOINT.format(
            name=f"{name}{number}",
            type="prismatic" if rng.random() < 0.15 else "revolute",
            parent=above,
            child=f"{name}_link{number}",
            xyz=words(lever * along / np.linalg.norm(along)),
            rpy=words(rpy),
            axis=words(axis),
            mimic=f'<mimic joint="{name}{number - 1}" multiplier="{rng.choice([-1, 0.5])}"/>' if leads else "",
        )
        above = f"{name}_link{number}"
    end = {"name": f"{name}_fixed", "type": "fixed", "parent": above, "child": f"{name}_end", "mimic": ""}
    return text + JOINT.format(xyz="0.1 0.02 0.03", rpy="0.1 0.2 0.3", axis="0 0 1", **end)


def random_tree(seed: int) -> tuple[Robot, np.random.Generator]:
    """A robot of one or two branches, the end of one seen from the end of the other, which may stand still."""
    rng = np.random.default_rng(seed)
    text = f'<robot name="tree"><link name="base"/>{branch(rng, "b", rng.integers(1, 8))}{branch(rng, "a", rng.integers(0, 5))}</robot>'
    robot = robot_from(Description(Path("tree.urdf"), text.encode(), expanded=False), lasers=())
    return robot.seen_by(Instruments((Target("b_end", "b_end", SIX),), "a_end", placed=True), ()), rng


def links_of(robot: Robot, origins: dict[str, SE3], q: dict[str, float]) -> dict[str, SE3]:
    """Where every link is in the root, by a walk of our own."""
    placed = {robot.tree.root: pin.SE3.Identity()}
    for joint in robot.tree.joints.values():
        axis, value = np.array(joint.axis), q.get(joint.name, 0.0)
        motion = pin.SE3(np.eye(3), axis * value) if joint.prismatic else pin.SE3(pin.exp3(axis * value), np.zeros(3))
        placed[joint.child] = placed[joint.parent] * origins.get(joint.name, joint.origin) * motion
    return placed


def moved(robot: Robot, origins: dict[str, SE3]) -> float:
    """How far a correction moves the robot's links in the root at most, turns counted at 100 mm, [m]."""
    rng, far = np.random.default_rng(1), 0.0
    for _ in range(12):
        q = {joint.name: rng.uniform(-2, 2) * (0.15 if joint.prismatic else 1) for joint in robot.tree.joints.values() if joint.moves}
        before, after = links_of(robot, {}, q), links_of(robot, origins, q)
        for link, placement in before.items():
            off = pin.log6(placement.inverse() * after[link])
            far = max(far, float(np.linalg.norm(off.linear) + 0.1 * np.linalg.norm(off.angular)))
    return far


def most_likely(errors: ErrorModel, jacobian: np.ndarray, seen: Vector) -> Vector:
    """The state that whole poses with a little noise say, under the default priors; linear algebra, no estimator of ours."""
    rows = np.vstack([jacobian / NOISE, np.diag(1 / errors.sigma)])
    return np.asarray(np.linalg.lstsq(rows, np.concatenate([seen / NOISE, np.zeros(len(errors.sigma))]), rcond=None)[0])


@pytest.mark.parametrize("seed", range(300))
def test_a_state_is_complete_and_harmless(seed: int) -> None:
    """auto spans what six numbers a joint span, and its correction moves the links hardly farther than that of all six does."""
    robot, rng = random_tree(seed)
    auto, every = (build_error_model(robot.chain, robot.rig, ModelOptions(error_model=model)) for model in ("auto", "placement"))
    own, all_six = (full_pose_jacobian(robot.chain, errors) for errors in (auto, every))
    units = all_six / np.linalg.norm(all_six, axis=0)
    scaled = own * auto.sigma
    missing = units - scaled @ np.linalg.lstsq(scaled, units, rcond=1e-14)[0]
    assert np.linalg.norm(missing, axis=0).max() < 1e-6
    size = {"m": 2 * MM, "rad": 0.2 * DEG}
    truth = np.array([rng.normal(0, size[each.unit] if each.kind == "joint" else 0.01) for each in every.parameters])
    corrections = [
        moved(robot, errors.corrected_origins(most_likely(errors, jacobian, all_six @ truth)))
        for errors, jacobian in ((auto, own), (every, all_six))
    ]
    assert corrections[0] < 3 * corrections[1]


@pytest.mark.parametrize("seed", range(9))
def test_stated_priors_decide_what_is_costly(seed: int) -> None:
    """Translations that are known to a micron enter only where nothing carries them, angles in their place; no prior is the usual one."""
    robot, _ = random_tree(seed)
    stated = (PriorScale(1e-6, DEFAULT_PRIORS["joint"].rotation), PriorScale(FLAT, FLAT))
    usual, tight, flat = (
        build_error_model(robot.chain, robot.rig, ModelOptions(priors={"joint": prior})) for prior in (DEFAULT_PRIORS["joint"], *stated)
    )
    lengths, known = ({each.name for each in errors.parameters if each.unit == "m"} for errors in (usual, tight))
    assert known <= lengths
    assert set(usual.names) - lengths <= set(tight.names)
    assert usual.names != tight.names
    assert usual.names == flat.names
